"""Friction with which trials begin: it is estimated where a device that rubs leaves a misfit, and not elsewhere."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import klute_sim.device as device_package
from klute_sim.datasets.dataset import load_dataset, split_dataset
from klute_sim.datasets.write import write_trial
from klute_sim.device.device import load_device
from klute_sim.device.equilibrium import compute_resting_state
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.diagnosis.command_interpolation import Outcome, Preparation
from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.initial_friction import reconsider_initial_friction
from klute_sim.diagnosis.noise.misfit import has_misfit
from klute_sim.diagnosis.result import Verdict
from klute_sim.diagnosis.verdict import verdict_to_dict
from klute_sim.diagnosis.workflow import diagnose, fit_base_device

INTERVAL, STEPS_PER_SAMPLE = 0.005, 5
FRICTION = '[effects.braid_hysteresis]\nform = "dahl"\nslope_n_per_bar = 15.0\nstiffness_n_per_mm = 60.0\n'
FRACTIONS = {"fit_1": 1.0, "fit_2": -1.0, "fit_3": 0.5, "validation_1": -0.6, "test_1": 1.0}


PRESET = Path(device_package.__file__).parent / "presets" / "klute-3-4-pair.toml"


def write_rested_dataset(folder: Path, *, fractions: dict[str, float], zeros: dict[str, float] | None = None) -> Path:
    """Write trials that rest for 0.8 s, with the friction of an earlier motion and errors of the zero [N] by group."""
    rng = np.random.default_rng(3)
    folder.mkdir(parents=True)
    numbers = PRESET.read_text("utf-8").partition("[sources]")[0]
    numbers = numbers.replace("friction_offset_n", "friction = false\nfriction_offset_n")
    (folder / "device.toml").write_text(numbers + FRICTION, "utf-8")
    device = load_device(folder / "device.toml").parameters
    text = ['format = "klute-sim-dataset/2"', 'rig = "bench"', 'device = "device.toml"']
    time = np.arange(0.0, 3.0, INTERVAL)
    fine = np.arange((len(time) - 1) * STEPS_PER_SAMPLE + 1) * INTERVAL / STEPS_PER_SAMPLE
    for index, (group, fraction) in enumerate(fractions.items()):
        motion = np.clip(fine - 0.8, 0.0, None)
        length = 0.340 - 4e-3 * (1.0 + 0.2 * index) * (1.0 - np.cos(2 * np.pi * (0.6 + 0.1 * index) * motion))
        command = np.full(len(fine), (1.5 + 0.5 * index) * 1e5)
        state = compute_resting_state(device, float(length[0]), float(command[0]), fraction)
        trace = simulate_rollouts(device, length[1:], command[1:], fine[1], initial_state=state, n_jobs=1)
        force = trace.tension[STEPS_PER_SAMPLE - 1 :: STEPS_PER_SAMPLE] + (zeros or {}).get(group, 0.0)
        for repeat in "ab":
            columns = {
                "time [s]": time[1:],
                "length [mm]": 1e3 * length[STEPS_PER_SAMPLE::STEPS_PER_SAMPLE],
                "pressure_command [bar]": np.full(len(force), 1e-5 * command[0]),
                "force [N]": force + rng.normal(0.0, 2.0, len(force)),
            }
            write_trial(folder / f"{group}_{repeat}.csv", columns)
            use = group.partition("_")[0]
            text += ["[[trial]]", f'files = ["{group}_{repeat}.csv"]', f'group = "{group}"', f'use = "{use}"']
    (folder / "dataset.toml").write_text("\n".join(text) + "\n", "utf-8")
    return folder


def reconsider(folder: Path, verdict: Verdict = "unexplained") -> tuple[Outcome, Outcome, list[str]]:
    """Return the outcome before and after, and the remarks, where nothing was found but a misfit (``verdict``).

    The search after it finds nothing either, and its verdict says whether that leaves a misfit.
    """
    dataset, simulator = load_dataset(folder), Simulator(1)

    def prepare(trials: list[Experiment]) -> Preparation:
        fit, data = fit_base_device(dataset, [e for e in trials if e.use == "fit"], simulator)
        return Preparation(trials, data, fit, [])

    def search_model(prepared: Preparation, verdict: Verdict | None = None) -> Outcome:
        experiments, data, fit, _ = prepared
        is_left = has_misfit(data.experiments, fit.residuals, data.noise)
        found = verdict or ("unexplained" if is_left else "nothing-missing")
        selected = cast(Any, SimpleNamespace(verdict=found, prediction=None, final_fit=fit))
        search = cast(Any, SimpleNamespace(history=[]))
        return Outcome(experiments, data, search, fit, selected, [])

    before = search_model(prepare(prepare_experiments(dataset, split_dataset(dataset))), verdict)
    after, remarks = reconsider_initial_friction(before, prepare, search_model)
    simulator.close()
    return before, after, remarks


def test_friction_before_each_condition_is_estimated(tmp_path: Path) -> None:
    """In the fitted trials, in those for validation, and in those of the test."""
    before, after, remarks = reconsider(write_rested_dataset(tmp_path / "data", fractions=FRACTIONS))
    assert before.selected.verdict == "unexplained"
    assert after.selected.verdict == "nothing-missing"
    for e in after.experiments:
        assert e.initial_friction == pytest.approx(FRACTIONS[e.group], abs=0.1)
    (sentence,) = remarks
    assert "'fit_2' (shortened)" in sentence
    assert "'test_1' (lengthened)" in sentence


@pytest.mark.slow
def test_relaxed_trials_and_other_errors_stay_as_they_are(tmp_path: Path) -> None:
    relaxed = dict.fromkeys(FRACTIONS, 0.0)
    before, after, remarks = reconsider(write_rested_dataset(tmp_path / "clean", fractions=relaxed), "nothing-missing")
    assert after is before
    assert not remarks
    zeros = {"fit_1": 15.0, "fit_2": -20.0, "fit_3": 10.0, "test_1": -12.0}
    before, after, remarks = reconsider(write_rested_dataset(tmp_path / "zeros", fractions=relaxed, zeros=zeros))
    assert after is before
    assert not remarks


@pytest.mark.slow
def test_diagnosis_finds_nothing_missing_but_the_friction_before(tmp_path: Path) -> None:
    folder = write_rested_dataset(tmp_path / "data", fractions=FRACTIONS)
    diagnosis = diagnose(load_dataset(folder))
    assert diagnosis.verdict == "nothing-missing"
    assert any("holds dry friction" in reason for reason in diagnosis.reasons)
    assert not diagnosis.added_terms
    stated = verdict_to_dict(diagnosis)["initial_friction"]
    assert stated["fit_2_a"] == stated["fit_2_b"] == pytest.approx(FRACTIONS["fit_2"], abs=0.1)
