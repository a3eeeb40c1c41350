"""A command that acts between two samples of its log: corrected where pressures show it, and no effect."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest

from klute_sim.diagnosis.command_delay import (
    DELAY_DEVIATION_INTERVALS,
    add_command_delay,
    complete_with_command_delay,
    explains_pressures,
    has_pressure_misfit,
)
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


def weigh(simulator: Simulator, walks: Sequence[GaitExperiment], hypothesis: Hypothesis) -> WeightedData:
    (residuals,) = WeightedData(simulator, walks, {}).compute_residuals(hypothesis, [hypothesis.initial_point()])
    return WeightedData(simulator, walks, estimate_noise_from_repeats(walks, residuals))


def fit_delayed(simulator: Simulator, delay: float) -> tuple[WeightedData, Fit]:
    """Return walks whose log is late by ``delay`` [s], and the fit of their registration without it."""
    hypothesis = Hypothesis(DEVICE, (), (), registration=tuple(REGISTRATION_DEVIATIONS.items()))
    data = weigh(simulator, [log_late(walk, delay) for walk in make_walks()], hypothesis)
    return data, fit_hypothesis(data, hypothesis)


@pytest.mark.parametrize("delay", [pytest.param(1.5e-3, marks=pytest.mark.slow), -1.5e-3, 5e-3])
def test_delay_of_the_log_is_found_and_corrected(simulator: Simulator, delay: float) -> None:
    data, base_fit = fit_delayed(simulator, delay)
    assert has_pressure_misfit(data, base_fit)
    extended = add_command_delay(data, base_fit)
    assert extended is not None
    assert extended.registration[-1] == (COMMAND_DELAY, pytest.approx(1e3 * DELAY_DEVIATION_INTERVALS * INTERVAL))
    corrected = fit_hypothesis(data, extended)
    assert corrected.values[-1] == pytest.approx(1e3 * delay, abs=0.1)
    assert explains_pressures(data, corrected)


@pytest.mark.parametrize(
    ("delay", "is_of_log"),
    [(1.5e-3, True), pytest.param(5e-3, True, marks=pytest.mark.slow), (0.0, False), (9e-3, False)],
)
def test_a_fit_is_completed_with_a_delay_of_the_log(simulator: Simulator, delay: float, is_of_log: bool) -> None:
    data, fit = fit_delayed(simulator, delay)
    completed = complete_with_command_delay(data, fit)
    assert (completed is not None) is is_of_log
    if completed is not None:
        assert completed.values[-1] == pytest.approx(1e3 * delay, abs=0.1)
        assert not has_pressure_misfit(data, completed)
        assert complete_with_command_delay(data, completed) is None


def test_without_a_pressure_no_fit_is_completed(simulator: Simulator) -> None:
    data, fit = fit_delayed(simulator, 1.5e-3)
    blind = replace(data, noise={name: noise for name, noise in data.noise.items() if name != "pressure"})
    assert complete_with_command_delay(blind, fit) is None


def test_no_delay_is_none(simulator: Simulator) -> None:
    assert add_command_delay(*fit_delayed(simulator, 0.0)) is None


@pytest.mark.parametrize("delay", [-4e-3, 9e-3])
def test_other_delay_is_no_matter_of_the_log(simulator: Simulator, delay: float) -> None:
    """A command that acts late has a dead time, and none is logged two samples late."""
    data, base_fit = fit_delayed(simulator, delay)
    assert has_pressure_misfit(data, base_fit)
    assert add_command_delay(data, base_fit) is None


@pytest.mark.parametrize(("has_logged_updates", "is_of_log"), [(True, True), (False, False)])
def test_delay_of_an_assumed_hold_is_short(simulator: Simulator, has_logged_updates: bool, is_of_log: bool) -> None:
    data, base_fit = fit_delayed(simulator, 1.5e-3)
    held = [
        replace(walk, has_zero_order_hold=True, has_logged_updates=has_logged_updates)
        for walk in data.experiments
        if isinstance(walk, GaitExperiment)
    ]
    assert (add_command_delay(data.with_experiments(held), base_fit) is not None) is is_of_log


def test_without_repeats_or_a_pressure_nothing_shows_a_delay(simulator: Simulator) -> None:
    data, base_fit = fit_delayed(simulator, 1.5e-3)
    blind = replace(data, noise={name: noise for name, noise in data.noise.items() if name != "pressure"})
    assert add_command_delay(blind, base_fit) is None
    single = data.with_experiments(data.experiments[::2])
    assert add_command_delay(single, replace(base_fit, residuals=base_fit.residuals[::2])) is None


def test_inputs_are_delayed_by_parts_of_a_step() -> None:
    inputs = compute_inputs(1.0)
    assert delay_inputs(inputs, 0.0) is inputs
    later = delay_inputs(inputs, 2.5)
    for series, delayed in zip(inputs, later, strict=True):
        assert delayed[10:] == pytest.approx(0.5 * (series[8:-2] + series[7:-3]))
        assert delayed[0] == series[0]
