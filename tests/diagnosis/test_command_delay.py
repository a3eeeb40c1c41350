"""A command that acts between two samples of its log: corrected where pressures show it, and no effect."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest

from klute_sim.diagnosis.command_delay import estimate_command_delay, has_pressure_misfit
from klute_sim.diagnosis.experiments.gait import GaitExperiment
from klute_sim.diagnosis.experiments.registration import COMMAND_DELAY, REGISTRATION_DEVIATIONS, delay_inputs
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.repeats import estimate_noise_from_repeats
from tests.diagnosis.synthetic_walk import DEVICE, STEP, compute_inputs, make_walks

INTERVAL = 5e-3


@pytest.fixture
def simulator() -> Iterator[Simulator]:
    simulator = Simulator(1)
    yield simulator
    simulator.close()


def log_late(walk: GaitExperiment, delay: float) -> GaitExperiment:
    """Return ``walk`` with a command whose log is late by ``delay`` [s] and has a sample every :data:`INTERVAL`."""
    steps = np.arange(len(walk.command), dtype=np.float64)
    command = np.interp(steps - delay / STEP, steps, walk.command)
    return replace(walk, command=command, command_interval=INTERVAL)


def fit_walks(
    simulator: Simulator, walks: Sequence[GaitExperiment], registration: dict[str, float]
) -> tuple[WeightedData, Fit]:
    hypothesis = Hypothesis(DEVICE, (), (), registration=tuple(registration.items()))
    (residuals,) = WeightedData(simulator, walks, {}).compute_residuals(hypothesis, [hypothesis.initial_point()])
    data = WeightedData(simulator, walks, estimate_noise_from_repeats(walks, residuals))
    return data, fit_hypothesis(data, hypothesis)


@pytest.mark.parametrize("delay", [1.5e-3, -1.5e-3])
def test_delay_below_half_an_interval_is_found_and_corrected(simulator: Simulator, delay: float) -> None:
    walks = [log_late(walk, delay) for walk in make_walks()]
    data, base_fit = fit_walks(simulator, walks, REGISTRATION_DEVIATIONS)
    assert has_pressure_misfit(data, base_fit)
    added = estimate_command_delay(data, base_fit)
    assert added == pytest.approx({COMMAND_DELAY: 1e3 * INTERVAL / np.sqrt(12.0)})
    data, corrected = fit_walks(simulator, walks, REGISTRATION_DEVIATIONS | added)
    assert corrected.values[-1] == pytest.approx(1e3 * delay, abs=0.1)
    assert not has_pressure_misfit(data, corrected)


def test_no_delay_is_none(simulator: Simulator) -> None:
    walks = [log_late(walk, 0.0) for walk in make_walks()]
    assert estimate_command_delay(*fit_walks(simulator, walks, REGISTRATION_DEVIATIONS)) == {}


def test_longer_delay_is_no_matter_of_the_log(simulator: Simulator) -> None:
    walks = [log_late(walk, 4e-3) for walk in make_walks()]
    data, base_fit = fit_walks(simulator, walks, REGISTRATION_DEVIATIONS)
    assert has_pressure_misfit(data, base_fit)
    assert estimate_command_delay(data, base_fit) == {}


def test_without_repeats_or_a_pressure_nothing_shows_a_delay(simulator: Simulator) -> None:
    walks = [log_late(walk, 1.5e-3) for walk in make_walks()]
    data, base_fit = fit_walks(simulator, walks, REGISTRATION_DEVIATIONS)
    blind = replace(data, noise={name: noise for name, noise in data.noise.items() if name != "pressure"})
    assert estimate_command_delay(blind, base_fit) == {}
    single = data.with_experiments(walks[::2])
    assert estimate_command_delay(single, replace(base_fit, residuals=base_fit.residuals[::2])) == {}


def test_inputs_are_delayed_by_parts_of_a_step() -> None:
    inputs = compute_inputs(1.0)
    assert delay_inputs(inputs, 0.0) is inputs
    later = delay_inputs(inputs, 2.5)
    for series, delayed in zip(inputs, later, strict=True):
        assert delayed[10:] == pytest.approx(0.5 * (series[8:-2] + series[7:-3]))
        assert delayed[0] == series[0]
