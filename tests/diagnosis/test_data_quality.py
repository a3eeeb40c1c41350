"""Data quality: insufficient data, dead and saturated channels."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np

from klute_sim.datasets.dataset import load_dataset
from klute_sim.datasets.trial import TimeSeries
from klute_sim.device.device import load_device
from klute_sim.diagnosis import data_quality
from klute_sim.diagnosis.data_quality import find_contradicted_channels
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.diagnosis.result import DiagnosisOptions
from klute_sim.diagnosis.workflow import diagnose
from tests.diagnosis.synthetic_dataset import write_dataset


def make_experiment(name: str, force: np.ndarray, group: str = "g", moving: bool = True) -> BenchExperiment:
    n_steps = 2000
    wave = np.sin(np.arange(n_steps) / 100) if moving else np.zeros(n_steps)
    time = np.arange(len(force)) * (0.5 / len(force)) + 1e-3
    length, command, measured = 0.34 + 0.005 * wave, 2.5e5 + 2e5 * wave, {"force": TimeSeries(time, force)}
    return BenchExperiment(
        name, group, "fit", load_device("klute-3-4-pair"), 0.0, 2.5e-4, command, measured, unit_length=length
    )


def test_insufficient_data_are_reported_with_the_fix() -> None:
    rng = np.random.default_rng(0)
    sufficient = [make_experiment(n, rng.normal(size=200)) for n in "ab"] * 4
    assert data_quality.find_blocking_problems(sufficient) == []
    (reduced,) = data_quality.find_limitations([replace(e, group=str(k)) for k, e in enumerate(sufficient)])
    assert "Record every input at least twice" in reduced
    (too_short,) = data_quality.find_blocking_problems(sufficient[:2])
    assert "last 1.0 s in total" in too_short
    (motionless,) = data_quality.find_blocking_problems(
        [make_experiment(n, rng.normal(size=200), moving=False) for n in "ab"] * 4
    )
    assert motionless.startswith("The device does not move")
    (uninformative,) = data_quality.find_blocking_problems(
        [replace(e, measured={"ankle_moment": e.measured["force"]}) for e in sufficient]
    )
    assert uninformative.startswith("Neither 'force' nor 'muscle_length' is usable")
    assert uninformative.endswith("Record 'force'.")
    pressure_only = [replace(e, measured={"pressure": e.measured["force"]}) for e in sufficient]
    assert len(data_quality.find_blocking_problems(pressure_only)) == 1
    assert data_quality.find_blocking_problems(pressure_only, judges_supply=True) == []
    (limitation,) = data_quality.find_limitations(pressure_only)
    assert "the supply is judged" in limitation
    assert data_quality.find_limitations(sufficient) == []
    assert (
        len(data_quality.find_limitations([make_experiment("a", np.zeros(20), moving=False)])) == 3
    )  # constant pressure, constant length, no repeats


def test_unknown_length_does_not_block() -> None:
    """The joint of a mechanism may move although nothing measures it."""

    class UnmeasuredExperiment(BenchExperiment):
        length_range = None

    rng = np.random.default_rng(0)
    still = make_experiment("a", rng.normal(size=200), moving=False)
    unknown = UnmeasuredExperiment(**{f.name: getattr(still, f.name) for f in fields(still)})
    assert "does not move" in data_quality.find_blocking_problems([still] * 8)[0]
    assert data_quality.find_blocking_problems([unknown] * 8) == []
    assert not any("The length changes" in sentence for sentence in data_quality.find_limitations([unknown] * 8))
    assert data_quality.find_moving_trials([unknown]) == []


def test_repeats_with_few_common_samples_are_none() -> None:
    rng = np.random.default_rng(0)
    first, second = (make_experiment(name, rng.normal(size=200)) for name in "ab")
    assert data_quality.has_repeats([first, second])
    (time, value), pressure = second.measured["force"], TimeSeries(*first.measured["force"])
    apart = replace(second, measured={"force": TimeSeries(time[10:] + 0.45, value[10:])})
    assert not data_quality.has_repeats([first, apart])
    (reason,) = data_quality.find_unrepeated_channels(
        [replace(e, measured={**e.measured, "pressure": pressure}) for e in (first, apart)]
    ).values()
    assert reason.startswith("'force' was never recorded twice")
    few = [make_experiment(name, rng.normal(size=10)) for name in "abcdefgh"]
    assert not data_quality.has_repeats(few)
    (problem,) = data_quality.find_blocking_problems(few)
    assert "a channel has at most 10 samples" in problem


def test_copied_repeat_is_not_used_where_other_repeats_show_the_noise() -> None:
    rng = np.random.default_rng(8)
    rows = rng.normal(0.0, 3.0, (4, 500))
    trials = [
        make_experiment("copied_a", rows[0], "copied"),
        make_experiment("copied_b", rows[0], "copied"),
        make_experiment("copied_c", rows[3], "copied"),
        make_experiment("genuine_a", rows[1], "genuine"),
        make_experiment("genuine_b", rows[2], "genuine"),
    ]
    residuals = [{"force": e.measured["force"].value} for e in trials]
    contradicted, problems = find_contradicted_channels(trials, residuals)
    assert list(contradicted) == [("copied_b", "force")]
    assert "one is a copy" in contradicted["copied_b", "force"]
    assert not problems
    pairs = [k for k, e in enumerate(trials) if e.name != "copied_c"]
    contradicted, problems = find_contradicted_channels([trials[k] for k in pairs], [residuals[k] for k in pairs])
    assert list(contradicted) == [("copied_b", "force")]
    assert not problems


def test_recordings_without_enough_samples_are_called_short(tmp_path: Path) -> None:
    folder = write_dataset(tmp_path / "d", groups=("fit_1", "test_1"), seconds=1.0)
    for path in folder.glob("*.csv"):
        path.write_text("\n".join(path.read_text("utf-8").splitlines()[:12]), "utf-8")
    diagnosis = diagnose(load_dataset(folder), DiagnosisOptions(n_jobs=1))
    assert diagnosis.verdict == "insufficient-data"
    assert "too short or too slow: a channel has at most" in diagnosis.reasons[-1]


def test_moving_trials_that_are_not_fitted_are_named() -> None:
    force = np.random.default_rng(0).normal(size=200)
    fitted = [make_experiment(name, force, moving=False) for name in ("a", "b")]
    moving = [replace(make_experiment("ramp", force), use="test")]
    sentence = data_quality.find_limitations(fitted, moving)[0]
    assert "changes by at most 0.00 mm within a fitted trial" in sentence
    assert sentence.endswith("Not fitted, but moving: 'ramp'. Set use = 'fit' for some of them.")
    assert data_quality.find_limitations(fitted, fitted)[0].endswith("hardly visible.")


def test_dead_and_saturated_channels_are_detected() -> None:
    rng = np.random.default_rng(0)
    dead = [make_experiment(n, np.full(200, 7.0)) for n in "ab"]
    dead_channels, _ = data_quality.find_faulty_channels(dead)
    assert dead_channels == {"force": "'force' is constant at 7 N: the channel is dead"}
    assert data_quality.remove_channels(dead, {("a", "force")})[0].measured == {}
    assert data_quality.remove_channels(dead, {("a", "force")})[1].measured
    clipped = [make_experiment(n, np.minimum(rng.normal(0.0, 3.0, 200), 2.0)) for n in "ab"]
    dead_channels, remarks = data_quality.find_faulty_channels(clipped)
    assert dead_channels == {}
    assert "equals 2 N in" in remarks[0]
    unsaturated = data_quality.remove_saturated_samples(clipped, clipped)[0].measured["force"]
    assert unsaturated.value.max() < 2.0
    assert len(unsaturated.time) == len(unsaturated.value)
    assert data_quality.find_faulty_channels([make_experiment("a", rng.normal(size=200))]) == ({}, [])
    # Coarse digits repeat everywhere, and a vented sensor reads 0: neither is saturated.
    quantized = np.round(8.0 * np.sin(np.arange(400) / 40.0))
    assert data_quality.find_faulty_channels([make_experiment("a", quantized)]) == ({}, [])
    assert data_quality.find_faulty_channels(
        [make_experiment("a", np.abs(rng.normal(size=200)) * (np.arange(200) > 80))]
    ) == (
        {},
        [],
    )
    # A coarse gauge between two levels is not saturated at either.
    levels = np.repeat([1.0, 3.0, 1.0, 3.0], 50)
    levels[49:53] = 1.5, 2.0, 2.5, 2.9
    assert data_quality.find_faulty_channels([make_experiment("a", levels)]) == ({}, [])
    slack_or_clipped = np.clip(rng.normal(3.0, 3.0, 400), 0.0, 5.0)
    assert "equals 5 N in" in data_quality.find_faulty_channels([make_experiment("a", slack_or_clipped)])[1][0]
    force = rng.normal(0.0, 3.0, 5000)  # 12 of 5000 samples are saturated
    ceiling = np.sort(force)[-12]
    assert (
        "12 of 5000 samples"
        in data_quality.find_faulty_channels([make_experiment("a", np.minimum(force, ceiling))])[1][0]
    )
