"""Test that the diagnosis, told the truth, leaves next to nothing of noise-free data."""

import pytest
from benchmarks.hidden_effects.simulation_error import measure_bench_error, measure_walk_error

from klute_sim.diagnosis.experiments.gait import SIMULATION_ERROR
from klute_sim.diagnosis.experiments.simulator import Simulator

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    "key",
    [None, ("braid_hysteresis", "coulomb"), ("choked_valve", "asymmetric"), ("leak", "orifice")],
    ids=lambda key: "no effect" if key is None else key[0],
)
@pytest.mark.parametrize("seed", [1, 2])
def test_error_is_far_below_the_noise(key: tuple[str, str] | None, seed: int) -> None:
    simulator = Simulator(1)
    errors = measure_bench_error(key, seed, simulator)
    simulator.close()
    assert 0.0 < errors["force"] < 0.12
    assert max(errors.values()) < 0.15  # a misfit is relevant from a quarter of the noise on


@pytest.mark.parametrize("key", [None, ("socket_pistoning", "axial")], ids=["no effect", "socket_pistoning"])
def test_error_of_walks_is_far_below_the_noise(key: tuple[str, str] | None) -> None:
    simulator = Simulator(1)
    errors = measure_walk_error(key, 3, simulator)
    simulator.close()
    assert errors["force"] > 0.0
    assert max(errors.values()) < 2.0 * SIMULATION_ERROR  # a misfit is relevant from a quarter of the noise on
