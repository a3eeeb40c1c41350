"""Bench: a tensile tester that moves the length of the muscle-tendon unit, and the protocols that run on it.

Modules in order of dependence: ``trajectory``, ``validation``, ``channels``, ``build``, ``tester`` (MuJoCo) and
``device_only`` (no MuJoCo); then ``limits``, ``metrics``, ``protocols`` and ``run``.
"""

from klute_sim.bench.channels import CHANNELS
from klute_sim.bench.tester import simulate_tester

__all__ = ["CHANNELS", "simulate_tester"]
