"""Position of a joint at the start of a trial: the mean at rest, the start of the trajectory in motion."""

import numpy as np
import pytest

from klute_sim.datasets.trial import TimeSeries
from klute_sim.diagnosis.experiments.initial_motion import begins_late, estimate_initial_position

TIME = 1.0 + 0.005 * np.arange(200.0)


@pytest.mark.parametrize("seed", range(5))
def test_noise_is_averaged_at_rest(seed: int) -> None:
    noise = 1e-3 * np.random.default_rng(seed).normal(size=len(TIME))
    assert estimate_initial_position(TimeSeries(TIME, 0.5 + noise), 1.0) == pytest.approx(0.5, abs=8e-4)


def test_moving_joint_starts_at_the_beginning_of_its_trajectory() -> None:
    elapsed = TIME - 1.0
    noise = 1e-4 * np.random.default_rng(0).normal(size=len(TIME))
    value = 0.5 + 2.0 * elapsed - 3.0 * elapsed**2 + noise
    assert estimate_initial_position(TimeSeries(TIME, value), 1.0) == pytest.approx(0.5, abs=3e-4)


def test_missing_and_few_samples_are_interpolated() -> None:
    value = np.where(TIME < 1.02, np.nan, 0.5)
    assert estimate_initial_position(TimeSeries(TIME, value), 1.0) == pytest.approx(0.5)
    assert estimate_initial_position(TimeSeries(np.array([1.0, 1.2]), np.array([0.4, 0.6])), 1.1) == pytest.approx(0.5)


@pytest.mark.parametrize(("delay", "is_late"), [(0.0, False), (0.02, False), (0.05, True), (np.inf, True)])
def test_sensor_that_begins_later_does_not_tell_the_start(delay: float, is_late: bool) -> None:
    """The trajectory 50 ms after a step was extrapolated to a start 16 degrees away, at 600 degrees per second."""
    assert begins_late(TimeSeries(TIME, np.where(1.0 + delay - 1e-9 > TIME, np.nan, 0.5)), 1.0) == is_late
