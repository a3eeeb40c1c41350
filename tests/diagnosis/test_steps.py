"""Time steps of experiments: Richardson extrapolation, and steps aligned with delayed commands."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.datasets.trial import TimeSeries, Trial
from klute_sim.device.device import load_device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.diagnosis.experiments.base import SimulationSetup
from klute_sim.diagnosis.experiments.bench import BenchExperiment, prepare_bench_trial
from klute_sim.diagnosis.experiments.simulator import Simulator, simulate_extrapolated
from klute_sim.diagnosis.experiments.time_step import choose_time_step
from klute_sim.effects import catalogue

DEVICE = load_device("klute-3-4-pair")
SAMPLES = np.arange(5, 400) * 5e-3


def make_experiment(dt: float) -> BenchExperiment:
    """Return two seconds with length ramps and pressure steps, all at multiples of 5 ms."""
    time = dt * np.arange(1, round(2.0 / dt) + 1)
    length = np.interp(time, [0.0, 0.3, 0.8, 1.2, 2.0], [0.335, 0.335, 0.35, 0.332, 0.345])
    command = np.interp(time, [0.0, 0.4, 0.405, 1.0, 1.005, 1.6, 2.0], [1e5, 1e5, 4e5, 3e5, 1e5, 1e5, 5e5])
    measured = {name: TimeSeries(SAMPLES, SAMPLES) for name in ("force", "pressure", "muscle_length")}
    return BenchExperiment("a", "a", "fit", DEVICE, 0.0, dt, command, measured, unit_length=length)


@pytest.mark.parametrize(("interval", "step"), [(5e-5, 2.5e-4), (2e-4, 2.5e-4), (1e-3, 5e-4)])
def test_fast_logs_have_short_time_steps(interval: float, step: float) -> None:
    assert choose_time_step(interval, 5e-4, 5e-3) == pytest.approx(step)
    time = interval * np.arange(400)
    inputs = {"length": TimeSeries(time, np.full(400, 0.34)), "pressure_command": TimeSeries(time, np.full(400, 2e5))}
    trial = Trial(name="a", group="a", use="fit", device=DEVICE, files=(Path("a.csv"),), prescribed=inputs, measured={})
    experiment = prepare_bench_trial(trial, "fit")
    assert experiment.dt == pytest.approx(step)
    assert experiment.duration == pytest.approx(399 * interval, abs=5e-4)


@given(st.floats(5e-4, 0.1), st.sampled_from([(6, 2), (12, 4)]))
def test_sampling_interval_is_a_whole_number_of_merged_steps(interval: float, steps: tuple[int, int]) -> None:
    step = choose_time_step(interval, 5e-4, 5e-3, *steps)
    assert min(2.5e-4, interval / steps[0]) <= step <= 5e-3 * (1.0 + 1e-6)
    if step > 2.5e-4 * (1.0 + 1e-6):
        assert interval / (steps[1] * step) == pytest.approx(round(interval / (steps[1] * step)))


@pytest.mark.parametrize("interval", [5e-4, 8e-4, 1e-3, 1.5e-3, 2.5e-3, 1.0 / 300.0, 1.0 / 220.0, 5e-3])
def test_pressure_is_right_at_any_sampling_rate(interval: float) -> None:
    """A command that changes between two samples begins to act at the first of them."""
    time = interval * np.arange(int(2.0 / interval))
    command = np.where(np.sin(19.0 * time - 4.0) > 0.0, 4e5, 1e5)
    inputs = {"length": TimeSeries(time, np.full(len(time), 0.34)), "pressure_command": TimeSeries(time, command)}
    measured = {"pressure": TimeSeries(SAMPLES, SAMPLES)}
    trial = Trial(
        name="a", group="a", use="fit", device=DEVICE, files=(Path("a.csv"),), prescribed=inputs, measured=measured
    )
    experiment = prepare_bench_trial(trial, "fit")
    fine_time = 1e-5 * np.arange(1, round(time[-1] / 1e-5))
    fine = replace(experiment, dt=1e-5, command=np.interp(fine_time, time, command), unit_length=0.34 + 0.0 * fine_time)
    setup = SimulationSetup(make_parameters())
    responses = (simulate_extrapolated(setup, experiment), fine.simulate(setup))
    pressures = [np.interp(SAMPLES[:-10], r.time, r.pressure) for r in responses]
    assert np.sqrt(np.mean((pressures[0] - pressures[1]) ** 2)) < 150.0  # Pa; a gauge has a noise of 1000 Pa


def make_parameters(true_effects: dict[tuple[str, str], dict[str, float]] | None = None) -> DeviceParameters:
    return DEVICE.parameters._replace(effects=catalogue.pack_effects(true_effects or {}))


@pytest.mark.parametrize(
    "true_effects",
    [
        {},
        {("braid_hysteresis", "maxwell_slip"): {"slope_n_per_bar": 8.0, "stiffness_n_per_mm": 40.0}},
        {("bladder_relaxation", "maxwell"): {"stiffness_n_per_mm": 3.0, "time_constant_s": 0.3}},
        {("pressure_lag", "first_order"): {"time_constant_s": 0.04}},
    ],
    ids=["plain", "braid", "relaxation", "lag"],
)
def test_extrapolation_removes_most_of_the_integration_error(true_effects: dict) -> None:
    setup = SimulationSetup(make_parameters(true_effects))
    reference, trial = make_experiment(2e-5).simulate(setup), make_experiment(5e-4)
    reference_tension = np.interp(SAMPLES, reference.time, reference.tension)
    errors = [
        np.sqrt(np.mean((np.interp(SAMPLES, response.time, response.tension) - reference_tension) ** 2))
        for response in (trial.simulate(setup), simulate_extrapolated(setup, trial))
    ]
    assert errors[1] < 0.2 * errors[0]
    assert errors[1] < 0.1  # N; a load cell has a noise of 3 N


@pytest.mark.parametrize("delay", [0.0123, 0.02, 0.0400499])
def test_delayed_command_delays_the_pressure(delay: float) -> None:
    """A rate limit acts from the start of the command, not from the next time step."""
    trial = make_experiment(5e-4)
    nominal = trial.simulate(SimulationSetup(make_parameters()))
    delayed = trial.simulate(SimulationSetup(make_parameters({("pressure_delay", "dead_time"): {"delay_s": delay}})))
    is_covered = delayed.time > delay + 2.0 * trial.dt
    shifted = np.interp(delayed.time[is_covered] - delay, nominal.time, nominal.pressure)
    assert np.abs(delayed.pressure[is_covered] - shifted).max() < 1.0  # Pa


def test_simulator_runs_each_device_once() -> None:
    simulator, trial = Simulator(2), make_experiment(1e-3)
    try:
        setup = SimulationSetup(make_parameters())
        twice = simulator.simulate([[setup], [setup]], [trial], coarse=True)
        assert simulator.n_rollouts == 1
        assert np.array_equal(twice[0][0]["force"], twice[1][0]["force"])
        fine = simulator.simulate([[setup]], [trial])[0][0]
        assert simulator.n_rollouts == 2  # the coarse simulation is cached
        response = simulate_extrapolated(setup, trial)
        assert np.array_equal(fine["force"], np.interp(SAMPLES, response.time, response.tension))
        longer = replace(trial, unit_length=trial.unit_length + 1e-3)
        assert not np.array_equal(simulator.simulate([[setup]], [longer])[0][0]["force"], fine["force"])
    finally:
        simulator.close()
