"""Tests of the baseline methods and of their report."""

import importlib.util
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.hidden_effects import baselines, catalogue, force_balance, generate, report, run, score, simulate
from benchmarks.hidden_effects.metrics import DatasetResult

from klute_sim.datasets.dataset import load_dataset, split_dataset
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.effects import catalogue as public

pytestmark = pytest.mark.slow

SILENT = simulate.Noise(1e-9, 1e-9, 1e-9, 0.0, 1e-9, 1e-9)


def effect(name: str, form: str, **parameters: float) -> list[dict[str, Any]]:
    return [{"name": name, "form": form, "parameters": parameters}]


def fault(name: str, channel: str, **parameters: float) -> list[dict[str, Any]]:
    form = next(form for each, form in catalogue.instrument_forms(channel) if each == name)
    return [{"name": name, "form": form, "channel": channel, "parameters": parameters}]


def without_most(folder: Path) -> Path:
    """The dataset ``folder`` with one group of each use: a third of the work."""
    file = folder / "dataset.toml"
    head, *trials = file.read_text("utf-8").split("[[trial]]")
    kept = [trial for trial in trials if '"fit_2' not in trial and '"fit_3' not in trial]
    assert len(kept) == len(trials) - 4
    file.write_text("[[trial]]".join([head, *kept]), "utf-8")
    return folder


@pytest.mark.long
@pytest.mark.parametrize(
    ("formula", "true", "hidden", "faults"),
    [
        ("n p sign(v)", 10.0, effect("braid_hysteresis", "coulomb", slope_n_per_bar=10.0), []),
        ("n v", 150.0, effect("muscle_damping", "viscous", coefficient_n_s_per_m=150.0), []),
        ("sign(v)", 15.0, effect("seal_friction", "coulomb", force_n=15.0), []),
        ("c |v| v", 1 / 0.7**2 - 1, effect("discharge_loss", "constant", discharge_coefficient=0.7), []),
        ("-(1 - L/L0) F_gas", 1.0, effect("end_taper", "strain", factor=1.0), []),
        (
            "n (L - relaxed L)",
            3.0,
            effect("bladder_relaxation", "maxwell", stiffness_n_per_mm=3.0, time_constant_s=1.0),
            [],
        ),
        ("F/2k sign(dx/dt) dF/dL", 0.12, effect("tendon_hysteresis", "slip", loss_fraction=0.12), []),
        ("F_law", 0.05, [], fault("sensor_gain", "force", gain=1.05)),
        ("-dF/dp", 0.08, [], fault("sensor_offset", "pressure", offset=0.08)),
        ("-t dF/dL", 0.08, [], fault("sensor_drift", "muscle_length", drift_per_s=0.08)),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_coefficient_of_term_is_parameter_of_effect(
    tmp_path: Path, formula: str, true: float, hidden: list[Any], faults: list[Any]
) -> None:
    folder = tmp_path / "silent"
    generate.make_dataset(folder, 5, effects=hidden, instruments=faults, noise=SILENT)
    dataset = load_dataset(folder)
    trials = [
        e for e in prepare_experiments(dataset, split_dataset(dataset)) if e.use == "fit" and e.name.endswith("_a")
    ]
    balances = [force_balance.compute_balance(dataset, trial) for trial in trials]
    missing_force = np.concatenate([b.missing_force for b in balances])
    base = np.concatenate([b.base_columns for b in balances])
    terms = np.concatenate([b.term_columns for b in balances])
    (number,) = (i for i, term in enumerate(force_balance.BALANCE_TERMS) if term.formula == formula)
    fitted = np.linalg.lstsq(np.column_stack([base, terms[:, number]]), missing_force, rcond=None)[0]
    assert fitted[-1] * force_balance.BALANCE_TERMS[number].typical_size == pytest.approx(true, rel=0.25)


def test_candidates_of_terms_are_in_catalogue() -> None:
    for term in force_balance.BALANCE_TERMS:
        for meaning in term.candidates:
            public.find_form(meaning.name, meaning.form)
            assert (public.get_effects()[meaning.name].kind == "instrument") == (meaning.channel is not None)


@pytest.mark.parametrize(
    ("formula", "measured", "exclude", "positive", "names"),
    [
        ("-dF/dp", False, (), True, ["threshold_pressure", "sensor_offset"]),
        ("-dF/dp", False, (), False, ["sensor_offset"]),
        ("-dF/dp", False, ("sensor_offset",), True, ["threshold_pressure"]),
        ("-dF/dL", False, (), True, ["tendon_slack"]),
        ("-dF/dL", True, (), True, ["sensor_offset"]),
        ("sign(v)", True, (), False, []),
    ],
)
def test_term_lists_only_possible_effects(
    formula: str, measured: bool, exclude: tuple[str, ...], positive: bool, names: list[str]
) -> None:
    (term,) = (term for term in force_balance.BALANCE_TERMS if term.formula == formula)
    assert [meaning.name for meaning in term.possible_effects(measured, exclude, positive)] == names


@pytest.mark.long
def test_sparse_regression_identifies_effects_and_ambiguities(tmp_path: Path) -> None:
    pytest.importorskip("pysindy")
    hidden = effect("muscle_damping", "viscous", coefficient_n_s_per_m=600.0)
    truth = generate.make_dataset(tmp_path / "thick", 2, effects=hidden)
    found = baselines.regress_sparsely(tmp_path / "thick")
    assert found["verdict"] == "indistinguishable"
    assert score.list_named_effects(found) == ["muscle_damping"]
    assert found["alternatives"] == [["laminar_orifice"]]
    assert found["terms"]["n v"] == pytest.approx(600.0, rel=0.1)
    assert score.score_verdict(truth, found) == "right"
    assert found["gap"]["force"]["after"] < 0.5 * found["gap"]["force"]["refitted"]
    assert json.loads(json.dumps(found)) == found
    less = baselines.regress_sparsely(tmp_path / "thick", ["muscle_damping"])
    assert score.list_named_effects(less) == ["laminar_orifice"]

    generate.make_dataset(tmp_path / "clean", 2)
    assert baselines.regress_sparsely(tmp_path / "clean")["verdict"] == "nothing-missing"


@pytest.mark.long
def test_bic_identifies_strong_effect(tmp_path: Path) -> None:
    hidden = effect("braid_hysteresis", "coulomb", slope_n_per_bar=12.0)
    generate.make_dataset(tmp_path / "rough", 3, effects=hidden)
    few = [name for name in public.get_effects() if name not in ("braid_hysteresis", "seal_friction")]
    found = baselines.select_by_bic(without_most(tmp_path / "rough"), few)
    assert found["verdict"] == "identified"
    (braid,) = (each for each in found["effects"] if each["name"] == "braid_hysteresis")
    if braid["form"] == "coulomb":
        assert braid["parameters"]["slope_n_per_bar"]["value"] == pytest.approx(12.0, rel=0.1)
    gap = found["gap"]["force"]
    assert gap["after"] < 1.3 * gap["floor"] < 0.3 * gap["refitted"]
    assert json.loads(json.dumps(found)) == found


def test_unreadable_data_is_refused(tmp_path: Path) -> None:
    found = baselines.select_by_bic(tmp_path / "nowhere")
    assert found["verdict"] == "insufficient-data"
    assert "nowhere" in found["said"]


def test_missing_pysindy_raises_installation_advice(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ModuleNotFoundError, match=r"^PySINDy is not installed: install it with 'pip install"):
        run.load_baselines()


def test_results_are_stored(tmp_path: Path) -> None:
    answers = iter([{"verdict": "identified"}])
    for _ in range(2):
        assert run.load_or_compute(tmp_path / "a.json", lambda: next(answers)) == {"verdict": "identified"}


def test_report_compares_methods(capsys: pytest.CaptureFixture[str]) -> None:
    truth = {"effects": effect("seal_friction", "coulomb", force_n=15.0), "instruments": [], "strangers": []}
    truth |= {"block": "single", "size": 3.0}

    def row(verdict: str, after: float, outcome: str) -> DatasetResult:
        gap = {
            "force": {"refitted": 11.0, "after": after, "floor": 3.0},
            "pressure": {"refitted": 1, "after": 1, "floor": 1},
        }
        told = [
            {**e, "channel": None, "parameters": {"force_n": {"value": 15.0, "low": 14.0, "high": 16.0}}}
            for e in truth["effects"]
        ]
        found = {"verdict": verdict, "effects": told, "alternatives": [], "gap": gap, "s": 2.0}
        return DatasetResult("one", truth, found, outcome)

    rows = [row("identified", 3.0, "right"), row("identified", 5.0, "right"), row("nothing-missing", 11.0, "missed")]
    others = {"sindy": [row("identified", 7.0, "wrong")] * 3}
    report.print_report(rows, others, as_json=True)
    told = json.loads(capsys.readouterr().out)
    methods = told["methods"]
    assert methods["klute-sim"] == {"outcomes": {"right": 2, "missed": 1}, "median_s": 2.0, "gap_removed": 0.75}
    assert methods["sindy"] == {"outcomes": {"wrong": 3}, "median_s": 2.0, "gap_removed": 0.5}
    assert methods["refit only"] == {"names": 0, "gap_over_floor": pytest.approx(11 / 3)}
    assert told["rows"][0]["sindy"]["outcome"] == "wrong"
    report.print_report(rows, others, as_json=False)
    text = capsys.readouterr().out
    assert "0.75" in text
    assert "gap left / floor" in " ".join(text.split())
