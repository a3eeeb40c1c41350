"""Two step lengths tell what shorter and shorter ones tend to, and steps begin where delayed commands do."""

from dataclasses import replace

import numpy as np
import pytest

from klute_sim.datasets.trial import Series
from klute_sim.device.device import load_device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.diagnosis.experiments.base import SimulationSetup, Simulator, simulate_extrapolated
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.effects import catalogue

DEVICE = load_device("klute-3-4-pair")
SAMPLES = np.arange(5, 400) * 5e-3


def experiment(step: float) -> BenchExperiment:
    """Two seconds with ramps of length and steps of pressure, all of them at whole samples of 5 ms."""
    grid = step * np.arange(1, round(2.0 / step) + 1)
    length = np.interp(grid, [0.0, 0.3, 0.8, 1.2, 2.0], [0.335, 0.335, 0.35, 0.332, 0.345])
    command = np.interp(grid, [0.0, 0.4, 0.405, 1.0, 1.005, 1.6, 2.0], [1e5, 1e5, 4e5, 3e5, 1e5, 1e5, 5e5])
    measured = {name: Series(SAMPLES, SAMPLES) for name in ("force", "pressure", "muscle_length")}
    return BenchExperiment("a", "a", "fit", DEVICE, 0.0, step, command, measured, unit_length=length)


def device(hidden: dict[tuple[str, str], dict[str, float]] | None = None) -> DeviceParameters:
    return DEVICE.parameters._replace(effects=catalogue.pack_effects(hidden or {}))


@pytest.mark.parametrize(
    "hidden",
    [
        {},
        {("braid_hysteresis", "maxwell_slip"): {"slope_n_per_bar": 8.0, "stiffness_n_per_mm": 40.0}},
        {("bladder_relaxation", "maxwell"): {"stiffness_n_per_mm": 3.0, "time_constant_s": 0.3}},
        {("pressure_lag", "first_order"): {"time_constant_s": 0.04}},
    ],
    ids=["plain", "braid", "relaxation", "lag"],
)
def test_what_longer_steps_change_is_what_is_wrong(hidden: dict) -> None:
    setting = SimulationSetup(device(hidden))
    exact, one = experiment(2e-5).simulate(setting), experiment(5e-4)
    there = np.interp(SAMPLES, exact.time, exact.tension)
    off = [
        np.sqrt(np.mean((np.interp(SAMPLES, found.time, found.tension) - there) ** 2))
        for found in (one.simulate(setting), simulate_extrapolated(setting, one))
    ]
    assert off[1] < 0.2 * off[0]
    assert off[1] < 0.1  # N, of a load cell's 3


@pytest.mark.parametrize("delay", [0.0123, 0.02, 0.0400499])
def test_a_delayed_pressure_is_the_pressure_later(delay: float) -> None:
    """A limited rate starts when the command does, not at the first step after it."""
    one = experiment(5e-4)
    plain = one.simulate(SimulationSetup(device()))
    late = one.simulate(SimulationSetup(device({("pressure_delay", "dead_time"): {"delay_s": delay}})))
    inside = late.time > delay + 2.0 * one.dt
    shifted = np.interp(late.time[inside] - delay, plain.time, plain.pressure)
    assert np.abs(late.pressure[inside] - shifted).max() < 1.0  # Pa


def test_a_bench_looks_at_a_device_once_however_many_instruments_do() -> None:
    bench, one = Simulator(2), experiment(1e-3)
    try:
        setting = SimulationSetup(device())
        twice = bench.simulate([[setting], [setting]], [one], coarse=True)
        assert bench.n_rollouts == 1
        assert np.array_equal(twice[0][0]["force"], twice[1][0]["force"])
        fine = bench.simulate([[setting]], [one])[0][0]
        assert bench.n_rollouts == 2  # the longer steps are known
        again = simulate_extrapolated(setting, one)
        assert np.array_equal(fine["force"], np.interp(SAMPLES, again.time, again.tension))
        other = replace(one, unit_length=one.unit_length + 1e-3)
        assert not np.array_equal(bench.simulate([[setting]], [other])[0][0]["force"], fine["force"])
    finally:
        bench.close()
