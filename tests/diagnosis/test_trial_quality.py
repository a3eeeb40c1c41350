"""Trials that differ from the ideal: noisier than their repeats, logged slowly, begun in motion."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from klute_sim.datasets.trial import TimeSeries, Trial
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.bench import prepare_bench_trial, starts_in_motion
from klute_sim.diagnosis.noise.trial_noise import describe_noisy_trials, estimate_fast_noise, estimate_noise_ratios
from tests.diagnosis.synthetic_dataset import make_correlated_noise, make_repeats

DEVICE = load_device("klute-3-4-pair")


def make_trial(interval: float, command: np.ndarray, length: np.ndarray | None = None) -> Trial:
    time = interval * np.arange(len(command))
    lengths = np.full(len(command), 0.34) if length is None else length
    return Trial(
        name="a",
        group="a",
        use="fit",
        device=DEVICE,
        files=(Path("a.csv"),),
        prescribed={"length": TimeSeries(time, lengths), "pressure_command": TimeSeries(time, command)},
        measured={"force": TimeSeries(time, np.zeros(len(time))), "pressure": TimeSeries(time, 0.8 * command)},
    )


@settings(max_examples=25, deadline=None)
@given(ratio=st.floats(2.5, 10.0), seed=st.integers(0, 1000))
def test_noisy_repeat_is_found_under_a_common_misfit(ratio: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    misfit = 20.0 * np.sin(np.linspace(0.0, 20.0, 500))
    rows = [misfit + rng.normal(size=500) for _ in range(3)]
    rows[1] = misfit + ratio * rng.normal(size=500)
    trials = make_repeats(rows)
    found = estimate_noise_ratios(trials, [{"force": row} for row in rows])
    assert [row["force"] for row in (found[0], found[2])] == [1.0, 1.0]
    assert found[1]["force"] == pytest.approx(ratio, rel=0.25)
    (sentence,) = describe_noisy_trials(trials, found)
    assert "times as noisy as in its repeats" in sentence


def test_equal_repeats_and_single_trials_have_no_noise_of_their_own() -> None:
    rng = np.random.default_rng(1)
    rows = [rng.normal(size=300) for _ in range(4)]
    assert all(row["force"] == 1.0 for row in estimate_noise_ratios(make_repeats(rows), [{"force": r} for r in rows]))
    assert estimate_noise_ratios(make_repeats(rows[:1]), [{"force": rows[0]}]) == [{"force": 1.0}]


def test_slow_repeat_of_correlated_noise_is_no_noisier() -> None:
    """Differences between successive samples of correlated noise grow with the interval."""
    rng = np.random.default_rng(4)
    rows = [make_correlated_noise(rng, 3000, 3.0, 0.01) for _ in range(3)]
    trials = make_repeats(rows)
    series = trials[2].measured["force"]
    trials[2] = replace(trials[2], measured={"force": TimeSeries(series.time[::5], series.value[::5])})
    found = estimate_noise_ratios(trials, [{"force": e.measured["force"].value} for e in trials])
    assert [row["force"] for row in found] == [1.0, 1.0, 1.0]


def test_noise_of_slow_inputs_is_no_interpolation_error() -> None:
    rng = np.random.default_rng(3)
    length = 0.34 + 20e-6 * rng.normal(size=400)
    command = 2e5 + 500.0 * rng.normal(size=400)
    held = prepare_bench_trial(make_trial(0.01, command, length), "fit")
    for variants, attribute in zip(held.input_variants, ("unit_length", "command"), strict=True):
        for variant in variants:
            change = getattr(variant, attribute) - getattr(held, attribute)
            assert np.abs(change).max() < 1e-9 * np.abs(getattr(held, attribute)).max()


def test_motion_before_the_inputs_begin_is_no_motion_at_the_start() -> None:
    trial = make_trial(0.005, np.full(400, 2e5))
    early = np.arange(-100, 400) * 0.005
    pressure = np.where(early < 0.0, 1e5 + 2e5 * (early + 0.5), 2e5)
    before = replace(trial, measured={**trial.measured, "pressure": TimeSeries(early, pressure)})
    assert not starts_in_motion(before)
    after = replace(trial, measured={**trial.measured, "pressure": TimeSeries(early + 0.5, pressure)})
    assert starts_in_motion(after)


def test_slow_logging_leaves_the_interpolation_open() -> None:
    command = np.repeat([1e5, 3e5, 2e5], 40)
    slow = prepare_bench_trial(make_trial(0.02, command), "fit")
    lengths, (early, late) = slow.input_variants
    assert [variant.command is slow.command for variant in lengths] == [True, True]
    # A step between two samples happens up to one interval apart; levels are the same.
    delay = np.mean(early.command < late.command - 1.0) * slow.duration
    assert delay == pytest.approx(0.02, rel=0.2)
    assert prepare_bench_trial(make_trial(0.005, command), "fit").input_variants == ()


def test_trial_in_motion_starts_with_its_measured_pressure() -> None:
    rest = np.concatenate([np.full(200, 2e5), np.full(200, 3e5)])
    assert not starts_in_motion(make_trial(0.005, rest))
    assert prepare_bench_trial(make_trial(0.005, rest), "fit").initial_pressure is None
    ramp = np.linspace(1e5, 4e5, 400)
    moving = make_trial(0.005, ramp)
    assert starts_in_motion(moving)
    experiment = prepare_bench_trial(moving, "fit")
    assert experiment.initial_pressure == pytest.approx(0.8 * ramp[1])
    assert experiment.measured["force"].time[0] > 0.5
    stretched = make_trial(0.005, np.full(400, 2e5), 0.34 + 0.01 * np.linspace(0.0, 1.0, 400))
    assert starts_in_motion(stretched)


@settings(max_examples=20, deadline=None)
@given(st.floats(0.5, 20.0), st.sampled_from([0.0, 0.005, 0.02]), st.floats(0.0, 100.0), st.integers(0, 100))
def test_fast_noise_is_that_beside_a_slow_misfit(std: float, correlation: float, misfit: float, seed: int) -> None:
    rng, time = np.random.default_rng(seed), 0.005 * np.arange(4000)
    slow = misfit * np.sin(2.0 * np.pi * 0.3 * time)
    noise = make_correlated_noise(rng, 4000, std, correlation) if correlation else rng.normal(0.0, std, 4000)
    found = estimate_fast_noise(make_repeats([slow + noise]), [{"force": slow + noise}])["force"]
    bend = misfit * (2.0 * np.pi * 0.3 * 0.05) ** 2  # of the misfit within 0.05 s on both sides
    assert 0.9 * std < found < 1.15 * std + bend


def test_slow_or_constant_channels_show_no_fast_noise() -> None:
    values = np.random.default_rng(0).normal(size=400)
    fast = make_repeats([values])
    slow = [
        replace(e, measured={"force": TimeSeries(20.0 * s.time, s.value)}) for e in fast for s in [e.measured["force"]]
    ]
    assert estimate_fast_noise(slow, [{"force": values}]) == {}
    assert estimate_fast_noise(fast, [{"force": np.ones(400)}]) == {}
    assert estimate_fast_noise(make_repeats([values[:40]]), [{"force": values[:40]}]) == {}
