"""Pressures that are commands, repeats that drift and wrong units; none is reported of clean data."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from klute_sim.datasets.dataset import load_dataset, split_dataset
from klute_sim.datasets.trial import SensorLimits
from klute_sim.device.device import load_device
from klute_sim.diagnosis.data_quality import select_usable_data
from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.experiments.bench import prepare_bench_trial
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.recording_faults import (
    describe_differing_repeats,
    find_copied_pressures,
    find_drifting_repeats,
    limit_buckled_forces,
    limit_forces_at_zero,
    suspect_absolute_pressures,
    suspect_wrong_scales,
)
from klute_sim.diagnosis.result import DiagnosisOptions
from klute_sim.diagnosis.workflow import diagnose
from tests.diagnosis import synthetic_joint_dataset as joint
from tests.diagnosis.synthetic_dataset import make_correlated_noise, make_repeats, write_dataset
from tests.diagnosis.test_trial_quality import make_trial


def make_groups(n_groups: int, n_repeats: int, shift: float, seed: int) -> tuple[list[Experiment], list[dict]]:
    """Return repeats whose force shifts by ``shift`` [N] from one to the next, beside correlated noise of 3 N."""
    rng = np.random.default_rng(seed)
    experiments: list[Experiment] = []
    for group in range(n_groups):
        noise = [make_correlated_noise(rng, 400, 3.0, 0.02) + k * shift for k in range(n_repeats)]
        experiments += make_repeats(noise, f"g{group}")
    return experiments, [{"force": e.measured["force"].value} for e in experiments]


@settings(max_examples=25, deadline=None)
@given(st.sampled_from([(1, 5), (3, 3), (7, 2)]), st.sampled_from([-5.0, 5.0]), st.integers(0, 1000))
def test_drift_beyond_the_noise_is_found(shape: tuple[int, int], shift: float, seed: int) -> None:
    (drift,) = find_drifting_repeats(*make_groups(*shape, shift, seed))
    assert drift.channel == "force"
    assert drift.shift == pytest.approx(shift * (shape[1] - 1), abs=3.0)
    assert drift.noise == pytest.approx(3.0, rel=0.3)


@settings(max_examples=50, deadline=None)
@given(st.sampled_from([(1, 5), (3, 3), (7, 2), (1, 2), (4, 4)]), st.integers(0, 1000))
def test_noise_is_no_drift(shape: tuple[int, int], seed: int) -> None:
    assert find_drifting_repeats(*make_groups(*shape, 0.0, seed)) == []


def test_few_or_unordered_repeats_are_no_drift() -> None:
    """Zeros that differ from trial to trial are ordered by chance in few groups, and in no order in many."""
    for shape in ((1, 2), (1, 4), (2, 3), (5, 2)):
        assert find_drifting_repeats(*make_groups(*shape, 5.0, 0)) == []
    rng = np.random.default_rng(1)
    zeros = rng.normal(0.0, 10.0, (7, 3))
    experiments, residuals = make_groups(7, 3, 0.0, 1)
    shifted = [{"force": row["force"] + zero} for row, zero in zip(residuals, zeros.ravel(), strict=True)]
    assert find_drifting_repeats(experiments, shifted) == []
    (sentence,) = describe_differing_repeats(experiments, shifted)
    assert sentence.startswith("Repeats of 'force' differ mostly by a constant, ")
    assert describe_differing_repeats(experiments, residuals) == []
    assert describe_differing_repeats(experiments[:6], shifted[:6]) == []  # two groups


def select(folder: Path) -> tuple[list[Experiment], list[str]]:
    dataset = load_dataset(folder)
    experiments = prepare_experiments(dataset, split_dataset(dataset))
    usable = select_usable_data(dataset, experiments, Simulator(1))
    return usable.experiments, usable.remarks


def change_columns(file: Path, change: dict[str, object]) -> None:
    """Replace columns of a trial file; values are functions of the table by heading."""
    headings = file.read_text("utf-8").splitlines()[0].split(",")
    table = np.loadtxt(file, delimiter=",", skiprows=1)
    columns = dict(zip(headings, table.T, strict=True))
    for heading, function in change.items():
        columns[heading] = function(columns)
    rows = "\n".join(",".join(f"{x:.9g}" for x in row) for row in np.array(list(columns.values())).T)
    file.write_text(",".join(headings) + "\n" + rows + "\n", "utf-8")


def test_clean_data_raise_no_remark(tmp_path: Path) -> None:
    folder = write_dataset(tmp_path / "clean", groups=("fit_1", "fit_2", "test_1"), repeats=3, seconds=1.5)
    experiments, remarks = select(folder)
    assert remarks == []
    assert all(e.measured.keys() == {"force", "pressure"} for e in experiments)


FORCE = 30.0 * np.sin(np.linspace(0.0, 9.0, 120))


@pytest.mark.parametrize(
    ("force", "is_limited"),
    [
        pytest.param(np.maximum(FORCE, 0.0), True, id="ends at zero"),
        pytest.param(np.maximum(FORCE, 1.0), False, id="is never zero"),
        pytest.param(np.minimum(FORCE, 0.0), False, id="ends at zero from below"),
        pytest.param(np.where(np.arange(120) < 9, 0.0, np.abs(FORCE) + 1.0), False, id="is zero by chance"),
        pytest.param(np.zeros(120), False, id="is dead"),
    ],
)
def test_force_that_ends_at_zero_is_limited(force: np.ndarray, is_limited: bool) -> None:
    plain = make_trial(0.005, np.full(120, 2e5))
    trial = replace(plain, measured={"force": plain.measured["force"]._replace(value=force)})
    (experiment,), sentence = limit_forces_at_zero([trial], [prepare_bench_trial(trial, "fit")])
    assert experiment.limits == ({"force": SensorLimits(0.0, np.inf)} if is_limited else {})
    assert ("never negative" in sentence) is is_limited
    stated = replace(trial, limits={"force": SensorLimits(-5.0, np.inf)})
    assert limit_forces_at_zero([stated], [experiment]) == ([experiment], "")


@pytest.mark.parametrize(
    ("force", "simulated", "is_limited"),
    [
        pytest.param(np.maximum(FORCE, 0.0), FORCE, True, id="buckles where the simulated one pushes"),
        pytest.param(FORCE, FORCE, False, id="pushes as simulated"),
        pytest.param(0.5 * FORCE, FORCE, False, id="pushes half as much"),
        pytest.param(np.maximum(FORCE, 0.0), np.maximum(FORCE, 0.0), False, id="neither pushes"),
        pytest.param(np.maximum(FORCE, 0.0) - 4.0, FORCE, False, id="slack with an offset of the load cell"),
        pytest.param(np.abs(FORCE), FORCE, False, id="pulls where the simulated one pushes"),
    ],
)
def test_force_of_a_muscle_that_buckles_ends_at_the_noise(
    force: np.ndarray, simulated: np.ndarray, is_limited: bool
) -> None:
    """The simulated bare muscle pushes between its clamps; the reading of a slack one is zero and noise."""
    plain = make_trial(0.005, np.full(120, 2e5))
    noisy = force + np.random.default_rng(3).normal(0.0, 2.0, len(force))
    trial = replace(plain, measured={"force": plain.measured["force"]._replace(value=noisy)})
    experiment = prepare_bench_trial(trial, "fit")
    is_compared = np.isin(noisy, experiment.measured["force"].value)
    residuals = [{"force": (noisy - simulated)[is_compared]}]
    (limited,), sentence = limit_buckled_forces([experiment], [experiment], residuals, 2.0)
    assert limited.limits == ({"force": SensorLimits(8.0, np.inf)} if is_limited else {})
    assert limited.measured["force"].value.min() >= 8.0 or not is_limited
    assert ("buckles" in sentence) is is_limited


def test_pressure_that_is_the_command_is_not_used(tmp_path: Path) -> None:
    folder = write_dataset(tmp_path / "copied", groups=("fit_1", "fit_2", "test_1"), seconds=1.5)
    for file in folder.glob("*.csv"):
        change_columns(file, {"pressure [bar]": lambda columns: columns["pressure_command [bar]"]})
    experiments, remarks = select(folder)
    assert remarks == [
        "'pressure' equals 'pressure_command' in all trials: it is the command and not a measurement, so it is not "
        "used. Record a gauge at the device."
    ]
    assert all(e.measured.keys() == {"force"} for e in experiments)  # also in the test trials


def test_only_the_copied_pressure_of_a_trial_is_removed(tmp_path: Path) -> None:
    folder = write_dataset(tmp_path / "one", groups=("fit_1", "test_1"), repeats=3, seconds=1.5)
    copy = {"pressure [bar]": lambda columns: columns["pressure_command [bar]"]}
    change_columns(folder / "fit_1_0.csv", copy)
    experiments, remarks = select(folder)
    assert "'pressure' equals 'pressure_command' in fit_1_0:" in remarks[0]
    assert [e.name for e in experiments if "pressure" not in e.measured] == ["fit_1_0"]
    gauge = {"pressure [bar]": lambda columns: np.round(columns["pressure_command [bar]"], 1) + 0.01}
    change_columns(folder / "fit_1_0.csv", gauge)
    assert find_copied_pressures(load_dataset(folder).trials) == set()


def test_coarse_gauge_equals_a_constant_command_by_right(tmp_path: Path) -> None:
    folder = write_dataset(tmp_path / "constant", groups=("fit_1", "fit_2", "test_1"), seconds=1.5)
    steady = dict.fromkeys(
        ("pressure [bar]", "pressure_command [bar]"), lambda columns: 0.0 * columns["time [s]"] + 3.0
    )
    change_columns(folder / "fit_1_0.csv", steady)
    trials = load_dataset(folder).trials
    assert find_copied_pressures(trials) == set()
    assert find_copied_pressures([trial for trial in trials if trial.name == "fit_1_0"]) == set()
    copy = {"pressure [bar]": lambda columns: columns["pressure_command [bar]"]}
    for file in folder.glob("*.csv"):
        change_columns(file, copy)
    assert find_copied_pressures(load_dataset(folder).trials) == {trial.name for trial in trials}


def test_vented_gauge_is_no_copy(tmp_path: Path) -> None:
    folder = write_dataset(tmp_path / "vented", groups=("fit_1", "test_1"), seconds=1.5)
    zeros = dict.fromkeys(("pressure [bar]", "pressure_command [bar]"), lambda columns: 0.0 * columns["time [s]"])
    for file in folder.glob("*.csv"):
        change_columns(file, zeros)
    assert find_copied_pressures(load_dataset(folder, accept=["force-unit"]).trials) == set()


def test_warming_up_is_reported(tmp_path: Path) -> None:
    groups = ("fit_1", "fit_2", "fit_3", "test_1")
    folder = write_dataset(tmp_path / "warm", groups=groups, repeats=3, seconds=1.5)
    for file in folder.glob("*.csv"):
        warmth = 0.02 * int(file.stem[-1])
        change_columns(file, {"force [N]": lambda columns, w=warmth: columns["force [N]"] * (1.0 - w)})
    _, remarks = select(folder)
    (remark,) = [remark for remark in remarks if "drifts" in remark]
    assert remark.startswith("From the first to the last of the repeats of all 3 groups, force drifts by -")
    assert "record repeats in random order" in remark


@pytest.mark.parametrize(
    ("threshold_bar", "lowest_bar", "is_suspected"),
    [(1.02, 1.01, True), (1.11, 1.21, True), (1.02, 0.0, False), (0.4, 1.2, False), (2.0, 1.2, False)],
)
def test_threshold_of_one_atmosphere_is_suspected_to_be_absolute_pressure(
    threshold_bar: float, lowest_bar: float, is_suspected: bool, tmp_path: Path
) -> None:
    dataset = load_dataset(write_dataset(tmp_path / "data", groups=("fit_1",), seconds=1.0))
    commands = [trial.prescribed["pressure_command"] for trial in dataset.trials]
    trials = [
        replace(
            trial,
            prescribed={
                **trial.prescribed,
                "pressure_command": command._replace(value=1e5 * lowest_bar + np.abs(command.value)),
            },
        )
        for trial, command in zip(dataset.trials, commands, strict=True)
    ]
    hypothesis = Hypothesis(dataset.device, (), (), (EffectTerm("threshold_pressure", "constant"),))
    parameter = threshold_bar * dataset.device.parameters.muscle.bladder_radius / 0.005  # that of 10 mm
    x = np.array([hypothesis.parameters[0].normalize(parameter)])
    fit = Fit(hypothesis, x, np.zeros(1), np.ones((1, 1)), True, [])
    sentence = suspect_absolute_pressures(trials, fit)
    assert ("subtract 1.013 bar" in sentence) == is_suspected
    assert bool(sentence) == is_suspected


@pytest.mark.parametrize(("threshold_bar", "is_suspected"), [(1.3, True), (0.5, False)])  # of 10 mm; these have 12.8
def test_absolute_pressures_of_a_mechanism_are_suspected(
    threshold_bar: float, is_suspected: bool, tmp_path: Path
) -> None:
    dataset = load_dataset(joint.write_dataset(tmp_path, groups=("fit_1",), repeats=1, seconds=1.5))
    hypothesis = Hypothesis(dataset.device, (), (), (EffectTerm("threshold_pressure", "constant"),))
    x = np.array([hypothesis.parameters[0].normalize(threshold_bar)])
    fit = Fit(hypothesis, x, np.zeros(1), np.ones((1, 1)), True, [])
    assert bool(suspect_absolute_pressures(dataset.trials, fit)) == is_suspected
    low = [
        replace(
            t, prescribed={**t.prescribed, joint.INPUTS[0]: t.prescribed[joint.INPUTS[0]]._replace(value=np.zeros(3))}
        )
        for t in dataset.trials
    ]
    assert suspect_absolute_pressures(low, fit) == ""


def suspect(experiments: list[Experiment], scale: float, error: np.ndarray) -> list[str]:
    """Return the sentences about forces that are ``scale`` times those of the device, with a relative ``error``."""
    residuals = [{"force": e.measured["force"].value * (1.0 - (1.0 + error) / scale)} for e in experiments]
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), (), ())
    return suspect_wrong_scales(experiments, cast(Fit, SimpleNamespace(residuals=residuals, hypothesis=hypothesis)))


@settings(max_examples=30, deadline=None)
@given(st.sampled_from([2.2046, 1.0 / 2.2046, 4.448, 2.0]), st.floats(0.0, 0.05), st.integers(0, 100))
def test_scale_of_another_unit_is_found(scale: float, error: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    experiments = make_repeats([500.0 + 100.0 * rng.normal(size=400)], "g")
    (sentence,) = suspect(experiments, scale, error * rng.uniform(-1.0, 1.0, 400))
    units = {
        2.2046: "lbf that are declared as kgf",
        1 / 2.2046: "kgf that are declared as lbf",
        4.448: "declared as lbf",
    }
    expected = units.get(scale, f"muscle.count = {2 * scale:.0f} instead of 2 ")
    assert expected in sentence
    assert "'force'" in sentence


@pytest.mark.parametrize("scale", [1.0, 0.9, 1.1, 1.25, 1.75, 7.0, 0.05])
def test_other_scales_are_no_units(scale: float) -> None:
    assert suspect(make_repeats([np.linspace(100.0, 900.0, 400)], "g"), scale, np.zeros(400)) == []


def test_misfit_that_is_no_scale_is_no_unit() -> None:
    experiments = make_repeats([np.linspace(100.0, 900.0, 400)], "g")
    assert suspect(experiments, 2.2046, np.linspace(-0.9, 0.9, 400)) == []


@pytest.mark.slow
def test_unit_of_a_file_is_suspected_first(tmp_path: Path) -> None:
    data = write_dataset(tmp_path / "data", distort={"force": lambda time, force: 2.2046 * force})
    diagnosis = diagnose(load_dataset(data), DiagnosisOptions(n_jobs=1, only=("seal_friction",)))
    assert "lbf that are declared as kgf (2.2 times)" in diagnosis.reasons[0]
    assert diagnosis.verdict == "unexplained"
