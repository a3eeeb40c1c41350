"""The bench: a tensile tester that moves the unit's whole length, a pressure regulator, and tests to run with them."""

from klute_sim.bench.channels import CHANNELS
from klute_sim.bench.tester import simulate_tester

__all__ = ["CHANNELS", "simulate_tester"]
