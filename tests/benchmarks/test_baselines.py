"""Tests of the baseline methods and of their report."""

import importlib
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.hidden_effects import baselines, catalogue, generate, page, report, run, score, simulate
from benchmarks.hidden_effects.baselines import force_balance
from benchmarks.hidden_effects.baselines.calibration import Calibration
from benchmarks.hidden_effects.baselines.holdout_f_test import compute_p_value
from benchmarks.hidden_effects.baselines.petab_search import find_best_set
from benchmarks.hidden_effects.baselines.sysid_bic import fit_with_sysid
from benchmarks.hidden_effects.baselines.trials import load_trials
from benchmarks.hidden_effects.metrics import DatasetResult
from benchmarks.hidden_effects.release.scorer import read_answer
from scipy.stats import kstest

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


def check_scorer_reads(found: dict[str, Any], path: Path) -> None:
    """Assert that the scorer of a release reads the verdict ``found``, written to ``path``."""
    path.write_text(json.dumps(found), "utf-8")
    kinds = {name: each.kind for name, each in public.get_named_effects().items()} | {"number_error": "number"}
    answer = read_answer(path, kinds)
    assert (answer["verdict"], answer["effects"]) == (found["verdict"], found["effects"])


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
@pytest.mark.extras
def test_sparse_regression_identifies_effects_and_ambiguities(tmp_path: Path) -> None:
    pytest.importorskip("pysindy")
    hidden = effect("muscle_damping", "viscous", coefficient_n_s_per_m=600.0)
    truth = generate.make_dataset(tmp_path / "thick", 2, effects=hidden)
    found = baselines.run_method("sindy", tmp_path / "thick")
    assert found["verdict"] == "indistinguishable"
    assert score.list_named_effects(found) == ["muscle_damping"]
    assert found["alternatives"] == [["laminar_orifice"]]
    assert found["terms"]["n v"] == pytest.approx(600.0, rel=0.1)
    assert score.score_verdict(truth, found) == "right"
    assert found["gap"]["force"]["with_effects"] < 0.5 * found["gap"]["force"]["refitted"]
    check_scorer_reads(found, tmp_path / "d0000.json")
    less = baselines.run_method("sindy", tmp_path / "thick", ["muscle_damping"])
    assert score.list_named_effects(less) == ["laminar_orifice"]

    generate.make_dataset(tmp_path / "clean", 2)
    assert baselines.run_method("sindy", tmp_path / "clean")["verdict"] == "nothing-missing"


@pytest.mark.long
def test_bic_identifies_strong_effect(tmp_path: Path) -> None:
    hidden = effect("braid_hysteresis", "coulomb", slope_n_per_bar=12.0)
    generate.make_dataset(tmp_path / "rough", 3, effects=hidden)
    few = [name for name in public.get_effects() if name not in ("braid_hysteresis", "seal_friction")]
    found = baselines.run_method("plain_bic", without_most(tmp_path / "rough"), few)
    assert found["verdict"] == "identified"
    (braid,) = (each for each in found["effects"] if each["name"] == "braid_hysteresis")
    if braid["form"] == "coulomb":
        assert braid["parameters"]["slope_n_per_bar"]["value"] == pytest.approx(12.0, rel=0.1)
    gap = found["gap"]["force"]
    assert gap["with_effects"] < 1.3 * gap["noise_floor"] < 0.3 * gap["refitted"]
    check_scorer_reads(found, tmp_path / "d0000.json")


@pytest.fixture(scope="module")
def thick(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a dataset with strong viscous damping, with one group of each use."""
    folder = tmp_path_factory.mktemp("thick") / "thick"
    generate.make_dataset(folder, 2, effects=effect("muscle_damping", "viscous", coefficient_n_s_per_m=600.0))
    return without_most(folder)


@pytest.mark.long
@pytest.mark.extras
@pytest.mark.parametrize("method", ["petab_forward", "petab_famos", "sysid_bic", "holdout_f_test"])
def test_method_identifies_strong_effect(thick: Path, tmp_path: Path, method: str) -> None:
    if baselines.list_missing_packages([method]):
        pytest.skip(f"{method} needs a package")
    exclude = ["number_error", "laminar_orifice", "sensor_lag", "clock_skew", "braid_hysteresis"]
    found = run.run_baseline(method, thick, tuple(exclude))
    assert found["verdict"] == "identified"
    (damping,) = (each for each in found["effects"] if each["name"] == "muscle_damping")
    if damping["form"] == "viscous":
        assert damping["parameters"]["coefficient_n_s_per_m"]["value"] == pytest.approx(600.0, rel=0.15)
    gap = found["gap"]["force"]
    assert gap["with_effects"] < 0.5 * gap["refitted"]
    assert found["cpu_s"] > 0.0
    assert not any(each["name"] in exclude for each in found["effects"])
    check_scorer_reads(found, tmp_path / "d0000.json")


@pytest.mark.long
@pytest.mark.extras
def test_gaussian_process_says_that_something_is_missing(tmp_path: Path) -> None:
    pytest.importorskip("sklearn")
    hidden = effect("muscle_damping", "viscous", coefficient_n_s_per_m=600.0)
    generate.make_dataset(tmp_path / "thick", 2, effects=hidden)  # one group of trials is too little to learn from
    found = baselines.run_method("gp_discrepancy", tmp_path / "thick")
    assert (found["verdict"], found["effects"]) == ("unexplained", [])
    assert found["gap"]["force"]["with_effects"] < found["gap"]["force"]["refitted"]
    check_scorer_reads(found, tmp_path / "d0000.json")


def test_sysid_finds_the_optimum_of_the_package(thick: Path) -> None:
    sysid = pytest.importorskip("mujoco.sysid")
    if not hasattr(sysid, "optimize"):
        pytest.skip("mujoco.sysid is empty without the packages of mujoco[sysid]")
    with Calibration(load_trials(thick), ()) as calibration:
        base = calibration.base
        refit = fit_with_sysid(calibration.data, base.hypothesis, base.hypothesis.initial_point())
        (drift,) = (t for t in calibration.terms if (t.effect, t.channel) == ("sensor_drift", "force"))
        hypothesis = base.hypothesis.with_term(drift)
        assert not np.isfinite(hypothesis.bounds()).all()  # mujoco.sysid refuses such bounds
        with_drift, own = (
            fit_with_sysid(calibration.data, hypothesis, hypothesis.initial_point()),
            calibration.fit([drift]),
        )
    assert refit.chi2 == pytest.approx(base.chi2, rel=1e-3)
    assert own is not None
    assert with_drift.chi2 == pytest.approx(own.chi2, rel=1e-3)


@pytest.mark.extras
@pytest.mark.parametrize("method", ["forward", "famos"])
def test_petab_search_finds_best_set_and_ends(method: str) -> None:
    pytest.importorskip("petab_select")
    gains = {"a": 10.0, "b": 8.0, "c": 8.0, "d": 0.0}

    def compute_criterion(names: Sequence[str]) -> float:
        """Return a BIC in which each name costs 3; ``b`` and ``c`` explain what ``a`` does."""
        assert len(names) == len(set(names))
        overlap = 12.0 * sum({"a", other} <= set(names) for other in "bc")
        return math.inf if len(names) > 3 else 3.0 * len(names) - sum(gains[n] for n in names) + overlap

    assert find_best_set(tuple(gains), method, compute_criterion) == ("a",)  # as greedy as forward selection
    assert find_best_set(("b", "c", "d"), method, compute_criterion) == ("b", "c")
    assert find_best_set(("d",), method, compute_criterion) == ()
    assert find_best_set((), method, compute_criterion) == ()


@pytest.mark.extras
def test_famos_swaps_what_forward_search_cannot() -> None:
    pytest.importorskip("petab_select")
    bic = {"": 0.0, "a": -10.0, "b": -9.0, "c": -1.0, "ab": -11.0, "ac": -14.0, "bc": -20.0, "abc": -12.0}

    def compute_criterion(names: Sequence[str]) -> float:
        return bic["".join(sorted(names))]

    assert find_best_set("abc", "forward", compute_criterion) == ("a", "c")
    assert find_best_set("abc", "famos", compute_criterion) == ("b", "c")


def test_holdout_p_values_are_uniform_without_effect_and_small_with_it() -> None:
    random = np.random.default_rng(3)
    n_samples = 60
    jacobian = random.normal(size=(n_samples, 4))

    def draw_p_value(size: float, change_sign: float = 1.0) -> float:
        change = random.normal(size=n_samples)
        residual = random.normal(size=n_samples) + jacobian @ random.normal(size=4) + size * change
        return compute_p_value(residual, change_sign * change, jacobian, n_samples)

    p_values = [draw_p_value(0.0) for _ in range(1000)]
    assert kstest(p_values, "uniform").pvalue > 0.05
    assert draw_p_value(1.0) < 1e-6
    assert draw_p_value(1.0, change_sign=-1.0) > 0.99  # an effect of the opposite sign is contradicted
    assert compute_p_value(jacobian[:, 0], np.zeros(n_samples), jacobian, n_samples) == 1.0


def test_unreadable_data_is_refused(tmp_path: Path) -> None:
    found = baselines.run_method("plain_bic", tmp_path / "nowhere")
    assert found["verdict"] == "insufficient-data"
    assert "nowhere" in found["reasons"][0]


def test_missing_packages_are_named_with_installation_advice(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def import_module(name: str) -> Any:
        if name in ("pysindy", "petab_select"):
            raise ModuleNotFoundError(name)
        return math  # a module without the attributes: installed, but not complete

    monkeypatch.setattr(importlib, "import_module", import_module)
    with pytest.raises(ModuleNotFoundError, match=r"^PEtab Select, mujoco-core\[sysid\], PySINDy, scikit-learn not"):
        run.load_baselines()
    assert baselines.main(["sindy", "somewhere"]) == 1
    assert "PySINDy not found: install it with 'pip install --group benchmark'" in capsys.readouterr().err


def test_results_are_stored(tmp_path: Path) -> None:
    answers = iter([{"verdict": "identified"}])
    for _ in range(2):
        assert run.load_or_compute(tmp_path / "a.json", lambda: next(answers)) == {"verdict": "identified"}


def test_tables_compare_methods(capsys: pytest.CaptureFixture[str]) -> None:
    hidden = {"effects": effect("seal_friction", "coulomb", force_n=15.0), "instruments": [], "strangers": []}
    hidden |= {"block": "single", "size": 3.0}
    clean = {"effects": [], "instruments": [], "strangers": [], "block": "clean", "size": 0.0}
    outside = {**hidden, "block": "outside", "deleted": True}

    def row(truth: dict[str, Any], verdict: str, after: float, outcome: str, seconds: float = 2.0) -> DatasetResult:
        gap = {
            "force": {"refitted": 11.0, "with_effects": after, "noise_floor": 3.0},
            "pressure": {"refitted": 1, "with_effects": 1, "noise_floor": 1},
        }
        effects = [
            {**e, "channel": None, "parameters": {"force_n": {"value": 15.0, "low": 14.0, "high": 16.0}}}
            for e in truth["effects"]
        ]
        found = {"verdict": verdict, "effects": effects if verdict == "identified" else [], "alternatives": []}
        found |= {"gap": gap, "cpu_s": seconds}
        return DatasetResult(f"{truth['block']}_{outcome}", truth, found, outcome)

    rows = [
        row(hidden, "identified", 3.0, "right"),
        row(clean, "nothing-missing", 11.0, "right", 4.0),
        row(outside, "unexplained", 7.0, "flagged", 6.0),
    ]
    others = {
        "sindy": [
            row(hidden, "identified", 7.0, "right")._replace(outcome="wrong"),
            row(clean, "unexplained", 7.0, "flagged")._replace(name="clean_right"),
            row(outside, "identified", 7.0, "wrong")._replace(name="outside_flagged"),
        ]
    }
    report.print_report(rows, others, as_json=True)
    printed = json.loads(capsys.readouterr().out)
    methods = printed["methods"]
    own, other = methods["klute-sim"], methods["sindy"]
    assert (own["alarms"], own["clean"], other["alarms"], other["clean"]) == (0, 1, 1, 1)
    assert (own["right"], own["known"], other["right"], other["wrong"]) == (1, 1, 0, 1)
    assert (own["flagged"], own["outside"], other["flagged"]) == (1, 1, 0)
    assert (own["median_cpu_s"], other["gap_removed"]) == (4.0, 0.5)
    assert methods["refit only"] == {"names": 0, "gap_over_floor": pytest.approx(11 / 3)}
    assert printed["rows"][0]["sindy"]["outcome"] == "wrong"
    report.print_report(rows, others, as_json=False)
    text = " ".join(capsys.readouterr().out.split())
    assert "1 of 1" in text
    lines = page.render_page(rows, others, {"split": "development"}).splitlines()
    assert "| klute-sim | 0 of 1 | 1 of 1 | 1 of 1 | 0 of 1 | 1 of 1 | 0.50 | 4.00 |" in lines
    assert "| sindy | 1 of 1 | 0 of 1 | 1 of 1 | 1 of 1 | 0 of 1 | 0.50 | 2.00 |" in lines
