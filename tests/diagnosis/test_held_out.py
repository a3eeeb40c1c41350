"""What test trials decide: they confirm names, demote a verdict, and reveal a misfit that other trials do not show."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from klute_sim.api.rendering import render_text
from klute_sim.datasets import dataset as datasets
from klute_sim.device.device import load_device
from klute_sim.diagnosis import held_out
from klute_sim.diagnosis.confirmation import (
    leaves_more_than_in_fit,
    record_confirmation,
    record_declared_advantage,
)
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import fit_hypothesis
from klute_sim.diagnosis.held_out import (
    BASE_MODEL,
    FINAL_MODEL,
    NOMINAL_MODEL,
    claims_no_misfit,
    record_divergence,
    record_test_misfit,
)
from klute_sim.diagnosis.noise.misfit import Misfit
from klute_sim.diagnosis.noise.quantization import Quantizer
from klute_sim.diagnosis.result import ChannelRms, Diagnosis, DiagnosisOptions, Verdict
from klute_sim.diagnosis.selection.robustness import EquivalentModel
from klute_sim.diagnosis.transfer_prediction import ChannelPrediction, TransferPrediction
from klute_sim.diagnosis.workflow import diagnose, fit_base_device
from klute_sim.report.diagnosis.prediction import build_prediction_table
from tests.diagnosis import synthetic_dataset
from tests.diagnosis.synthetic_dataset import write_dataset


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> datasets.Dataset:
    folder: Path = write_dataset(tmp_path_factory.mktemp("held_out") / "d", groups=("fit_1", "test_1"), seconds=1.0)
    return datasets.load_dataset(folder)


def make_diagnosis(dataset: datasets.Dataset, verdict: Verdict, **rms: Any) -> Diagnosis:
    return Diagnosis(
        dataset=dataset,
        split=datasets.split_dataset(dataset),
        verdict=verdict,
        reasons=["a reason"],
        channel_rms={"force": ChannelRms(**({"nominal": 50.0, "noise_floor": 3.0} | rms))} if rms else {},
    )


@pytest.mark.parametrize(
    ("verdict", "expected"),
    [
        ("nothing-missing", "unexplained"),
        ("identified", "identified-in-part"),
        ("indistinguishable", "unexplained"),
    ],
)
def test_misfit_of_test_trials_demotes_a_verdict_that_denies_it(
    verdict: Verdict, expected: str, dataset: datasets.Dataset
) -> None:
    diagnosis = make_diagnosis(dataset, verdict)
    record_test_misfit(diagnosis, {"force": Misfit(6.0, 20.0, 3.0)}, is_absorbed=False)
    assert diagnosis.verdict == expected
    assert "'force' in the test trials show a misfit of 2.00 times the noise" in diagnosis.reasons[0]
    assert "which the other trials do not show" in diagnosis.reasons[0]


@pytest.mark.parametrize(("n_effects", "verdict"), [(1, "identified-in-part"), (2, "unexplained")])
def test_several_effects_that_hold_on_the_fitted_trials_alone_are_proxies(
    n_effects: int, verdict: str, dataset: datasets.Dataset
) -> None:
    diagnosis = make_diagnosis(dataset, "identified")
    diagnosis.added_terms = (EffectTerm("seal_friction", "coulomb"), EffectTerm("end_taper", "strain"))[:n_effects]
    record_test_misfit(diagnosis, {"force": Misfit(6.0, 20.0, 3.0)}, is_absorbed=False)
    assert diagnosis.verdict == verdict
    assert ("proxies" in diagnosis.reasons[0]) == (n_effects > 1)


def test_misfit_that_validation_trials_show_too_is_not_that_of_the_test_alone(dataset: datasets.Dataset) -> None:
    diagnosis = make_diagnosis(dataset, "nothing-missing")
    misfit, other = Misfit(6.0, 20.0, 3.0), Misfit(4.5, 20.0, 3.0)
    record_test_misfit(diagnosis, {"force": misfit}, {"force": other}, is_absorbed=False)
    assert "those for validation 1.50 times, which the fitted trials do not show" in diagnosis.reasons[0]
    assert "other trials" not in diagnosis.reasons[0]


def test_equivalent_models_deny_a_misfit_of_the_test_trials_unless_one_explains_it(tmp_path: Path) -> None:
    folder = write_dataset(
        tmp_path / "d", groups=("fit_1", "test_1"), seconds=1.0, distort={"pressure": lambda time, value: 1.05 * value}
    )
    distorted = datasets.load_dataset(folder)
    experiments = prepare_experiments(distorted, datasets.split_dataset(distorted))
    base, data = fit_base_device(distorted, [e for e in experiments if e.use == "fit"], Simulator(1))
    gain = fit_hypothesis(data, base.hypothesis.with_term(EffectTerm("sensor_gain", "linear", "pressure")))
    evaluated = data.with_experiments([e for e in experiments if e.use == "test"])
    diagnosis = make_diagnosis(distorted, "indistinguishable")
    diagnosis.equivalent_models = [EquivalentModel(base, 1.0)]
    diagnosis.fitted_experiments, diagnosis.noise, diagnosis.final_fit = list(data.experiments), dict(data.noise), base
    assert not claims_no_misfit(diagnosis, evaluated)  # the named model leaves a misfit in the fitted trials already
    diagnosis.final_fit = gain
    assert claims_no_misfit(diagnosis, evaluated)
    diagnosis.prediction = cast(Any, object())  # the law is imperfect: no model reached the noise before
    assert not claims_no_misfit(diagnosis, evaluated)
    diagnosis.prediction = None
    diagnosis.equivalent_models.append(EquivalentModel(gain, 2.0, reaches_noise=False))
    assert claims_no_misfit(diagnosis, evaluated)  # a model that leaves a misfit in the fitted trials does not count
    diagnosis.equivalent_models.append(EquivalentModel(gain, 2.0))
    assert not claims_no_misfit(diagnosis, evaluated)


@pytest.mark.parametrize("verdict", ["nothing-missing", "identified", "indistinguishable"])
def test_misfit_that_a_refit_absorbs_demotes_no_verdict(verdict: Verdict, dataset: datasets.Dataset) -> None:
    diagnosis = make_diagnosis(dataset, verdict)
    record_test_misfit(diagnosis, {"force": Misfit(6.0, 20.0, 3.0)}, is_absorbed=True)
    assert diagnosis.verdict == verdict
    assert diagnosis.reasons[0] == "a reason"
    assert "do not determine the parameters well enough" in diagnosis.reasons[-1]


@pytest.mark.parametrize(
    ("refitted", "with_effects", "held_out", "verdict", "is_worse"),
    [
        (12.0, 3.1, "confirmed", "identified", False),
        (12.0, 11.0, "not-confirmed", "unexplained", False),
        (6.0, 12.0, "not-confirmed", "unexplained", True),
        (2.0, 3.1, "confirmed", "identified", False),  # both are as near as the noise permits
        (2.0, 3.3, "not-confirmed", "unexplained", True),
    ],
)
def test_names_hold_only_if_the_gap_of_test_trials_shrinks(
    refitted: float, with_effects: float, held_out: str, verdict: str, is_worse: bool, dataset: datasets.Dataset
) -> None:
    diagnosis = make_diagnosis(dataset, "identified", refitted=refitted, with_effects=with_effects)
    record_confirmation(diagnosis)
    assert (diagnosis.held_out, diagnosis.verdict, diagnosis.is_worse_on_test) == (held_out, verdict, is_worse)


@pytest.mark.parametrize(("with_effects", "held_out"), [(3.09, "not-tested"), (3.4, "not-confirmed")])
def test_gap_that_is_small_from_the_start_refutes_no_part_of_an_imperfect_law(
    with_effects: float, held_out: str, dataset: datasets.Dataset
) -> None:
    diagnosis = make_diagnosis(dataset, "identified-in-part", refitted=3.1, with_effects=with_effects)
    diagnosis.prediction = cast(Any, SimpleNamespace(share=0.9))
    record_confirmation(diagnosis, is_exercised=False)
    assert diagnosis.held_out == held_out


def test_channel_below_the_noise_makes_up_for_no_other(dataset: datasets.Dataset) -> None:
    diagnosis = make_diagnosis(dataset, "identified", refitted=4.0, with_effects=4.5)
    quiet = ChannelRms(nominal=1.0, refitted=0.8, with_effects=0.1, noise_floor=1.0)
    diagnosis.channel_rms["pressure"] = quiet
    record_confirmation(diagnosis)
    assert (diagnosis.held_out, diagnosis.is_worse_on_test) == ("not-confirmed", True)


def test_trials_in_which_the_effects_do_not_act_confirm_none(dataset: datasets.Dataset) -> None:
    diagnosis = make_diagnosis(dataset, "identified", refitted=12.0, with_effects=3.1)
    record_confirmation(diagnosis, is_exercised=False)
    assert (diagnosis.held_out, diagnosis.verdict) == ("not-tested", "identified")
    assert "Set use = 'test' for a trial that shows them." in diagnosis.reasons[-1]
    refuted = make_diagnosis(dataset, "identified", refitted=6.0, with_effects=12.0)
    record_confirmation(refuted, is_exercised=False)
    assert (refuted.held_out, refuted.verdict) == ("not-confirmed", "unexplained")


@pytest.mark.parametrize(("fitted_rms", "held_out"), [(5.0, "not-tested"), (3.0, "not-confirmed")])
def test_error_of_the_law_where_the_effects_do_not_act_refutes_none(
    fitted_rms: float, held_out: str, dataset: datasets.Dataset
) -> None:
    """A friction was denied by a clamped trial, which left what the other trials leave."""
    diagnosis = make_diagnosis(dataset, "identified-in-part", refitted=12.0, with_effects=12.0)
    diagnosis.final_fit = cast(Any, SimpleNamespace(residuals=[{"force": np.full(9, fitted_rms)}]))
    assert leaves_more_than_in_fit(diagnosis) == (held_out == "not-confirmed")
    record_confirmation(diagnosis, is_exercised=False, leaves_more=leaves_more_than_in_fit(diagnosis))
    assert diagnosis.held_out == held_out


@pytest.mark.parametrize(("is_exercised", "held_out"), [(False, "not-tested"), (True, "not-confirmed")])
def test_noise_of_single_trials_in_which_the_effects_do_not_act_refutes_none(
    is_exercised: bool, held_out: str, dataset: datasets.Dataset
) -> None:
    diagnosis = make_diagnosis(dataset, "identified-in-part", refitted=3.0, with_effects=3.0, noise_floor=None)
    record_confirmation(diagnosis, is_exercised=is_exercised)
    assert diagnosis.held_out == held_out
    assert diagnosis.verdict == ("unexplained" if is_exercised else "identified-in-part")
    assert not diagnosis.is_worse_on_test


@pytest.mark.parametrize(
    ("nominal", "refitted", "with_effects", "recommended"),
    [
        (50.0, 12.0, 3.1, "with-effects"),
        (50.0, 6.0, 12.0, "without-effects"),
        (10.0, 20.0, 12.0, "as-declared"),  # the effects repair what the fit has spoiled, and no more
        (10.0, 12.0, 20.0, "as-declared"),
        (11.6, 20.0, 12.0, "with-effects"),  # a difference of 3 % decides nothing
        (3.0, 3.1, 3.1, "with-effects"),
    ],
)
def test_device_that_predicts_the_test_trials_best_is_recommended(
    nominal: float, refitted: float, with_effects: float, recommended: str, dataset: datasets.Dataset
) -> None:
    gaps = {"nominal": nominal, "refitted": refitted, "with_effects": with_effects}
    diagnosis = make_diagnosis(dataset, "identified-in-part", **gaps)
    diagnosis.added_terms = (EffectTerm("braid_hysteresis", "proportional"),)
    record_confirmation(diagnosis)
    verdict = diagnosis.verdict
    record_declared_advantage(diagnosis)
    assert (diagnosis.recommended_device, diagnosis.verdict) == (recommended, verdict)
    assert ("device as declared predicts better" in diagnosis.reasons[0]) == (recommended == "as-declared")


@pytest.mark.parametrize("noise_floor", [3.0, None])
def test_declared_device_is_recommended_where_refitted_numbers_do_not_hold(
    noise_floor: float | None, dataset: datasets.Dataset
) -> None:
    gaps = {"nominal": 20.0, "refitted": 30.0, "with_effects": 30.0, "noise_floor": noise_floor}
    diagnosis = make_diagnosis(dataset, "unexplained", **gaps)
    record_declared_advantage(diagnosis)
    assert diagnosis.recommended_device == "as-declared"
    assert "predicts better than with the refitted numbers: it misses 'force' by 20 instead" in diagnosis.reasons[0]


@pytest.mark.parametrize("noise_floor", [0.0, None])
@pytest.mark.parametrize(
    ("gaps", "held_out", "recommended"),
    [
        ((0.0, 0.0, 0.0), "not-tested", "with-effects"),
        ((5.0, 0.0, 0.0), "not-tested", "with-effects"),
        ((5.0, 0.0, 2.0), "not-confirmed", "without-effects"),
        ((0.0, 5.0, 5.0), "not-confirmed", "as-declared"),
    ],
)
def test_gap_of_zero_is_no_unit_of_other_gaps(
    gaps: tuple[float, float, float],
    held_out: str,
    recommended: str,
    noise_floor: float | None,
    dataset: datasets.Dataset,
) -> None:
    names = ("nominal", "refitted", "with_effects")
    diagnosis = make_diagnosis(dataset, "identified", noise_floor=noise_floor, **dict(zip(names, gaps, strict=True)))
    diagnosis.added_terms = (EffectTerm("braid_hysteresis", "proportional"),)
    record_confirmation(diagnosis)
    record_declared_advantage(diagnosis)
    assert (diagnosis.held_out, diagnosis.recommended_device) == (held_out, recommended)


@pytest.mark.parametrize(
    ("diverged", "has_effects", "verdict", "held_out", "is_worse"),
    [
        ((), True, "identified", "confirmed", False),
        ((NOMINAL_MODEL,), True, "identified", "confirmed", False),
        ((NOMINAL_MODEL, BASE_MODEL), True, "identified", "confirmed", False),  # the names make it possible
        ((FINAL_MODEL,), True, "unexplained", "not-confirmed", True),
        ((BASE_MODEL, FINAL_MODEL), True, "unexplained", "not-confirmed", False),
        ((BASE_MODEL,), False, "unexplained", "not-tested", False),
    ],
)
def test_diverging_test_trial_counts_as_failed_prediction(
    diverged: tuple[str, ...],
    has_effects: bool,
    verdict: str,
    held_out: str,
    is_worse: bool,
    dataset: datasets.Dataset,
) -> None:
    diagnosis = make_diagnosis(dataset, "identified" if has_effects else "nothing-missing")
    if has_effects:
        diagnosis.added_terms, diagnosis.held_out = (EffectTerm("braid_hysteresis", "proportional"),), "confirmed"
    diagnosis.diverged_trials = dict.fromkeys(diverged, ("test_1_0",))
    record_divergence(diagnosis)
    assert (diagnosis.verdict, diagnosis.held_out, diagnosis.is_worse_on_test) == (verdict, held_out, is_worse)
    if diverged:
        models = " and with ".join(diverged)
        assert diagnosis.reasons[0].startswith(f"The simulation of 'test_1_0' with {models} diverges: the prediction")
    else:
        assert diagnosis.reasons == ["a reason"]


def test_prediction_that_diverges_is_no_number() -> None:
    channels = {"force": ChannelPrediction(nominal=4.0, refitted=2.0, with_effects=np.inf, measured_range=100.0)}
    prediction = TransferPrediction("other", channels)
    assert prediction.to_dict()["channels"] == {
        "force": {
            **{"unit": "N", "nominal": 4.0, "refitted": 2.0, "with_effects": None},
            **{"range": 100.0, "nominal_pct_of_range": 4.0, "refitted_pct_of_range": 2.0},
            "with_effects_pct_of_range": None,
        }
    }
    assert "diverges" in render_text([build_prediction_table(prediction)])


def diagnose_few_candidates(folder: Path) -> Diagnosis:
    return diagnose(datasets.load_dataset(folder), DiagnosisOptions(only=("braid_hysteresis", "threshold_pressure")))


def test_validation_trials_with_the_fault_of_the_test_trials_are_found(tmp_path: Path) -> None:
    groups = ("fit_1", "fit_2", "validation_1", "test_1")
    folder = write_dataset(tmp_path / "d", groups=groups, seconds=2.0)
    for path in [*folder.glob("test_1*.csv"), *folder.glob("validation_1*.csv")]:
        change_force(path)
    diagnosis = diagnose_few_candidates(folder)
    assert diagnosis.verdict == "unexplained"
    assert "those for validation" in diagnosis.reasons[0]


def change_force(path: Path) -> None:
    """Give the force in the file at ``path`` another gain and offset."""
    heading, *rows = path.read_text("utf-8").splitlines()
    column = heading.split(",").index("force [N]")
    cells = [row.split(",") for row in rows]
    for row in cells:
        row[column] = repr(1.1 * float(row[column]) + 20.0)
    path.write_text("\n".join([heading, *map(",".join, cells)]), "utf-8")


def write_constant_pressure(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Write fitted trials at one pressure, which tell the sum of friction slope and offset only, and test trials."""

    default_inputs = synthetic_dataset.make_inputs

    def make_inputs(index: int, seconds: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        fine_length, length, command = default_inputs(index, seconds)
        return fine_length, length, np.full(len(command), 3e5) if index == 0 else command

    true = load_device("klute-3-4-pair").with_changes(
        {"muscle.friction_slope_n_per_bar": 36.0, "muscle.friction_offset_n": -62.2}
    )
    with monkeypatch.context() as patch:
        patch.setattr("tests.diagnosis.synthetic_dataset.make_inputs", make_inputs)
        write_dataset(folder, base=true.parameters, groups=("fit_1", "test_1"), seconds=2.0)
    file = folder / "dataset.toml"
    number = '"muscle.friction_slope_n_per_bar" = "10 %"'
    text = file.read_text("utf-8")
    assert number in text
    file.write_text(text.replace(number, f'{number}\n"muscle.friction_offset_n" = "50 %"'), "utf-8")


def test_numbers_that_the_fitted_trials_do_not_determine_are_no_missing_effect(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_constant_pressure(tmp_path / "d", monkeypatch)
    diagnosis = diagnose_few_candidates(tmp_path / "d")
    assert diagnosis.verdict == "nothing-missing"
    assert "do not determine the parameters well enough" in diagnosis.reasons[-2]


def test_fault_that_only_the_test_trials_have_is_not_absorbed(tmp_path: Path) -> None:
    folder = write_dataset(tmp_path / "d", groups=("fit_1", "fit_2", "test_1"), seconds=2.0)
    for path in folder.glob("test_1*.csv"):
        change_force(path)
    diagnosis = diagnose_few_candidates(folder)
    assert diagnosis.verdict == "unexplained"
    assert "which the other trials do not show" in diagnosis.reasons[0]


def test_proxies_have_no_alternatives(dataset: datasets.Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    """Equivalent models that test trials refute are no choice between names, and no experiment separates them."""
    diagnosis = make_diagnosis(dataset, "indistinguishable", refitted=20.0, with_effects=3.0)
    diagnosis.equivalent_models = [cast(Any, object())]
    diagnosis.direct_measurements, diagnosis.next_experiment = [cast(Any, object())], {"protocol": "sines"}
    diagnosis.evaluated_on = "fit"
    monkeypatch.setattr(held_out, "_compute_residuals", lambda *_: (None, []))
    held_out.evaluate_held_out(diagnosis, cast(Any, None))
    assert diagnosis.equivalent_models
    diagnosis.diverged_trials = {BASE_MODEL: ("test_1_a",)}
    held_out.evaluate_held_out(diagnosis, cast(Any, None))
    assert diagnosis.verdict == "unexplained"
    assert not diagnosis.equivalent_models
    assert not diagnosis.direct_measurements
    assert diagnosis.next_experiment is None


@pytest.mark.parametrize(
    ("nominal", "with_effects", "recommended"),
    [(50.0, 12.0, "without-effects"), (4.0, 12.0, "as-declared"), (50.0, 3.1, "with-effects")],
)
def test_one_device_is_recommended(
    nominal: float, with_effects: float, recommended: str, dataset: datasets.Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    diagnosis = make_diagnosis(dataset, "identified", nominal=nominal, refitted=6.0, with_effects=with_effects)
    diagnosis.added_terms = (EffectTerm("braid_hysteresis", "proportional"),)
    monkeypatch.setattr(held_out, "_compute_residuals", lambda *_: (cast(Any, SimpleNamespace(experiments=[])), []))
    monkeypatch.setattr(held_out, "estimate_misfit", lambda *_: {})
    monkeypatch.setattr(held_out, "exercises_effects", lambda *_: True)
    monkeypatch.setattr(held_out, "leaves_more_than_in_fit", lambda *_: True)
    held_out.evaluate_held_out(diagnosis, cast(Any, SimpleNamespace(noise={})))
    assert diagnosis.recommended_device == recommended
    sentences = [reason for reason in diagnosis.reasons if "recommended" in reason]
    assert sentences == [held_out.RECOMMENDATIONS[name] for name in [recommended] if name != "with-effects"]


@pytest.mark.parametrize(("nominal", "recommended"), [(10.0, "as-declared"), (50.0, "without-effects")])
def test_declared_device_is_compared_with_the_one_that_a_divergence_leaves(
    nominal: float, recommended: str, dataset: datasets.Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The effects help in one test trial and diverge in another one, which leaves the refitted device."""
    diagnosis = make_diagnosis(dataset, "identified", nominal=nominal, refitted=12.0, with_effects=5.0)
    diagnosis.added_terms = (EffectTerm("braid_hysteresis", "proportional"),)
    diagnosis.diverged_trials = {FINAL_MODEL: ("test_1_a",)}
    monkeypatch.setattr(held_out, "_compute_residuals", lambda *_: (cast(Any, SimpleNamespace(experiments=[])), []))
    monkeypatch.setattr(held_out, "estimate_misfit", lambda *_: {})
    monkeypatch.setattr(held_out, "exercises_effects", lambda *_: True)
    monkeypatch.setattr(held_out, "leaves_more_than_in_fit", lambda *_: True)
    held_out.evaluate_held_out(diagnosis, cast(Any, SimpleNamespace(noise={})))
    assert diagnosis.recommended_device == recommended
    assert "diverges" in diagnosis.reasons[0]
    assert ("predicts better than with the refitted numbers" in diagnosis.reasons[1]) == (recommended == "as-declared")


@pytest.mark.parametrize(("has_misfit", "verdict"), [(False, "identified"), (True, "unexplained")])
def test_quantized_channel_is_no_name_for_a_misfit_of_the_test_trials(
    has_misfit: bool, verdict: str, dataset: datasets.Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    diagnosis = make_diagnosis(dataset, "nothing-missing", refitted=3.0, with_effects=3.0)
    diagnosis.quantizers = {"force": Quantizer(8.0, 0.01, 0.0, 0.3)}
    misfits = {"force": Misfit(6.0, 20.0, 3.0)} if has_misfit else {}
    monkeypatch.setattr(held_out, "_compute_residuals", lambda *_: (cast(Any, SimpleNamespace(experiments=[])), []))
    monkeypatch.setattr(held_out, "estimate_misfit", lambda *_: misfits)
    monkeypatch.setattr(held_out, "estimate_validation_misfits", lambda *_: {})
    monkeypatch.setattr(held_out, "can_refit_explain_all", lambda *_: False)
    held_out.evaluate_held_out(diagnosis, cast(Any, SimpleNamespace(noise={})))
    assert diagnosis.verdict == verdict


@pytest.mark.slow
@pytest.mark.parametrize("is_constant", [True, False])
def test_delay_is_not_tested_at_constant_pressure(
    is_constant: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    default_inputs = synthetic_dataset.make_inputs

    def make_inputs(index: int, seconds: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        fine_length, length, command = default_inputs(index, seconds)
        return fine_length, length, np.full(len(command), 3e5) if is_constant and index == 2 else command

    monkeypatch.setattr("tests.diagnosis.synthetic_dataset.make_inputs", make_inputs)
    delay = {("pressure_delay", "dead_time"): {"delay_s": 0.06}}
    folder = write_dataset(tmp_path / "d", delay, groups=("fit_1", "fit_2", "test_1"))
    diagnosis = diagnose(datasets.load_dataset(folder), DiagnosisOptions(only=("pressure_delay", "threshold_pressure")))
    assert [term.effect for term in diagnosis.added_terms] == ["pressure_delay"]
    assert diagnosis.held_out == ("not-tested" if is_constant else "confirmed")
    assert any("cannot confirm the added effects" in reason for reason in diagnosis.reasons) == is_constant
