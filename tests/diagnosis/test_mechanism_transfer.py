"""Prediction of another joint by what was found on one: every device and the model have fitted numbers."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from klute_sim.api.rendering import render_text
from klute_sim.datasets.dataset import Dataset, load_dataset, split_dataset
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.result import Diagnosis
from klute_sim.diagnosis.transfer import (
    _compute_diameter_ratios,
    _declare_rig_numbers,
    _describe_rule,
    _list_numbers,
    predict_dataset,
)
from klute_sim.diagnosis.transfer_prediction import TransferredNumber
from klute_sim.errors import InputError
from klute_sim.report.diagnosis.prediction import build_numbers_table
from tests.diagnosis.synthetic_joint_dataset import write_dataset

SLACK, STIFFNESS, MASS = "flexor/tendon.slack_length_mm", "tendon.stiffness_1_n_per_mm", "model.geom.load.mass"
WIDE_RADIUS = 25.6  # [mm]
NUMBERS = {SLACK: "1 %", STIFFNESS: "10 %", MASS: "5 %"}
OTHER = """
[devices.flexor]
changes = {"tendon.slack_length_mm" = 104.0, "tendon.stiffness_1_n_per_mm" = 30.0}
[devices.extensor]
"""


def make_diagnosis(dataset: Dataset, *terms: EffectTerm, x: list[float]) -> Diagnosis:
    """Return a diagnosis whose numbers are wrong by the standard deviations ``x``."""
    rig_numbers = tuple({**dataset.model_values, **dataset.nominal_numbers}.items())
    base = Hypothesis(dataset.device, tuple(dataset.uncertainties.items()), (), (), (), rig_numbers)
    hypothesis = base
    for term in terms:
        hypothesis = hypothesis.with_term(term)
    values: Any = np.array(x)
    n_base = len(base.parameters)
    fits = [
        Fit(h, values[: len(h.parameters)], np.zeros(1), np.ones((1, len(h.parameters))), True, [])
        for h in (base, hypothesis)
    ]
    assert n_base + sum(len(term.parameters) for term in terms) == len(values)
    split = split_dataset(dataset)
    return Diagnosis(
        dataset=dataset,
        split=split,
        verdict="nothing-missing",
        reasons=[],
        base_fit=fits[0],
        final_fit=fits[1],
        added_terms=terms,
        experiments=prepare_experiments(dataset, split),
    )


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("first")
    return load_dataset(write_dataset(folder, uncertain=NUMBERS, groups=("fit_1",), repeats=1, seconds=2.0))


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """The flexor has another tendon; what the first joint shows is true of this one."""
    flexor = load_device("klute-3-4-pair").with_changes(
        {"tendon.slack_length_mm": 104.0 * 1.02, "tendon.stiffness_1_n_per_mm": 30.0 * 1.1}
    )
    extensor = load_device("klute-3-4-pair").with_changes({"tendon.stiffness_1_n_per_mm": 60.0 * 1.1})
    folder = write_dataset(
        tmp_path_factory.mktemp("other"),
        truth={"flexor": flexor, "extensor": extensor},
        true_numbers={MASS: 0.95},
        extra=OTHER,
        groups=("fit_1", "test_1"),
        repeats=1,
        seconds=2.0,
    )
    return load_dataset(folder)


def test_numbers_of_tendons_and_model_are_carried_over(first: Dataset, other: Dataset) -> None:
    prediction = predict_dataset(make_diagnosis(first, x=[2.0, 1.0, -1.0]), other)
    angle = prediction.channels["angle_joint"]
    assert angle.with_effects < 0.1 * angle.nominal
    numbers = {number.name: number for number in prediction.numbers}
    expected = {
        SLACK: (102.0, 104.0 * 1.02),
        f"flexor/{STIFFNESS}": (66.0, 33.0),
        f"extensor/{STIFFNESS}": (66.0, 66.0),
        MASS: (0.95, 0.95),
    }
    assert numbers.keys() == expected.keys()
    for name, pair in expected.items():
        assert (numbers[name].fitted, numbers[name].used) == pytest.approx(pair)
    assert numbers[SLACK].rule == "the declared 104, changed as much as in the fit"
    assert numbers[f"flexor/{STIFFNESS}"].rule == "the declared 30, changed as much as in the fit"
    text = render_text([build_numbers_table(prediction)])
    assert all(name in text for name in expected)


def test_coordinate_keeps_its_change_and_a_declared_zero_stays(first: Dataset, other: Dataset) -> None:
    """The same for an uncertain coordinate and for one that is wrong."""
    coordinate = "model.site.end.pos_x"
    assert _describe_rule(coordinate, 0.04, 0.044) == "the declared 0.04, moved by as much as in the fit"
    assert _describe_rule("muscle.friction_offset_n", 0.0, 0.0) == "the declared 0, which a relative change leaves"
    base = Hypothesis(first.device, ((coordinate, 0.002),), (), (), (), ((coordinate, 0.02),))
    wrong = Hypothesis(first.device, (), (), (make_error(coordinate),), (), ((coordinate, 0.02),))
    assert other.mechanism is not None
    moved = replace(other.mechanism, model_values={**other.mechanism.model_values, coordinate: 0.04})
    for hypothesis in (base, wrong):
        carried, x = _declare_rig_numbers(hypothesis, np.array([2.0]), replace(other, mechanism=moved))
        (value,) = carried.values(x)
        assert value == pytest.approx(0.044)


def test_wrong_number_of_one_tendon_has_the_error_and_the_limits_of_its_kind(first: Dataset, other: Dataset) -> None:
    """A tape is wrong by 2 mm whatever the length; no rubber is softer than all others, on one tendon either."""
    c10 = "flexor/muscle.c10_kpa"
    uncertain = {**first.uncertainties, c10: 1000.0}
    numbers = make_diagnosis(replace(first, uncertainties=uncertain), x=[0.0] * 4).final_fit
    assert numbers is not None
    shared = Hypothesis(first.device, (("muscle.c10_kpa", 1000.0),), ())
    assert numbers.hypothesis.parameters[3].bounds == shared.parameters[0].bounds
    term = make_error(SLACK)
    (number,) = predict_wrong_number(first, other, term)
    assert term.qualified_name == "number_error@flexor/tendon.slack_length_mm"
    assert (number.fitted, number.used) == pytest.approx((102.0, 104.0 * 1.02))


def predict_wrong_number(first: Dataset, other: Dataset, term: EffectTerm) -> list[TransferredNumber]:
    """Return the entries for the number of ``term``, which is one plausible error too small and not uncertain."""
    diagnosis = make_diagnosis(first, term, x=[0.0, 0.0, 0.0, 1.0])
    assert diagnosis.final_fit is not None
    hypothesis = replace(diagnosis.final_fit.hypothesis, uncertainties=())
    diagnosis.final_fit = replace(diagnosis.final_fit, hypothesis=hypothesis, x=np.array([1.0]))
    return [number for number in predict_dataset(diagnosis, other).numbers if number.name == term.number]


@pytest.mark.parametrize("key", ["flexor/supply.gas_temperature_c", "supply.gas_temperature_c"])
def test_temperature_keeps_its_absolute_change(key: str, first: Dataset, other: Dataset) -> None:
    """Of one tendon and of all; a ratio of degrees Celsius means nothing, least of all near 0."""
    cold = load_device("klute-3-4-pair").with_changes({"supply.gas_temperature_c": 0.5})
    assert other.mechanism is not None
    devices = {**other.mechanism.devices, "flexor": cold}
    outdoors = replace(other, device=cold, mechanism=replace(other.mechanism, devices=devices))
    prediction = predict_dataset(make_diagnosis(replace(first, uncertainties={key: 4.0}), x=[2.0]), outdoors)
    number = next(n for n in prediction.numbers if n.name == "flexor/supply.gas_temperature_c")
    assert (number.fitted, number.used) == pytest.approx((28.0, 8.5))
    assert number.rule == "the declared 0.5, moved by as much as in the fit"


@pytest.mark.parametrize("owner", [None, "flexor"])
def test_effect_of_the_muscle_follows_the_diameter_of_its_own_tendon(owner: str | None, first: Dataset) -> None:
    assert first.mechanism is not None
    thin = first.mechanism.devices["flexor"]
    radius = thin.spec.collect_values()["muscle.bladder_radius_mm"]
    wide = thin.with_changes({"muscle.bladder_radius_mm": 2.0 * radius, "muscle.turns_per_m": 4.103})
    mechanism = replace(first.mechanism, devices={"flexor": thin, "extensor": wide})
    if owner:
        mechanism = replace(first.mechanism, devices={"flexor": wide, "extensor": thin})
    term = EffectTerm("muscle_damping", "pressure", tendon=owner)
    diagnosis = make_diagnosis(first, term, x=[0.0, 0.0, 0.0, 1.0])
    prediction = predict_dataset(diagnosis, replace(first, mechanism=mechanism))
    used = {n.name: n.used / n.fitted for n in prediction.numbers if n.name.startswith("muscle_damping")}
    key = "coefficient_n_s_per_m"
    expected = {f"muscle_damping@flexor.{key}": 4.0}
    if owner is None:
        expected = {f"muscle_damping@flexor.{key}": 1.0, f"muscle_damping@extensor.{key}": 4.0}
    assert used == pytest.approx(expected)


def test_effect_of_all_tendons_holds_for_tendons_of_other_names(first: Dataset) -> None:
    """The muscles of the first joint are equal, so each muscle of the other one is compared with them."""
    assert first.mechanism is not None
    thin = first.mechanism.devices["flexor"]
    wide = thin.with_changes({"muscle.bladder_radius_mm": WIDE_RADIUS, "muscle.turns_per_m": 4.103 / 2.0})
    devices = {"front": thin, "back": wide}
    other = replace(first, mechanism=replace(first.mechanism, devices=devices))
    ratios = _compute_diameter_ratios(first, other)
    own = thin.spec.collect_values()["muscle.bladder_radius_mm"]
    assert ratios == {"front": 1.0, "back": pytest.approx(WIDE_RADIUS / own)}
    with pytest.raises(InputError, match="muscles of different diameters"):
        _compute_diameter_ratios(other, first)


def test_shared_numbers_of_tendons_of_other_names_are_listed(first: Dataset) -> None:
    """Found is the number of the device that the first joint's tendons share."""
    shared = replace(first, uncertainties={STIFFNESS: 6.0})
    assert first.mechanism is not None
    strong = load_device("klute-3-4-pair").with_changes({STIFFNESS: 30.0})
    devices = {**first.mechanism.devices, "flexor": strong}
    renamed = {"front": devices["flexor"], "back": devices["extensor"]}
    other = replace(first, mechanism=replace(first.mechanism, devices=renamed))
    diagnosis = make_diagnosis(shared, x=[1.0])
    assert diagnosis.final_fit is not None
    hypothesis, values = diagnosis.final_fit.hypothesis, np.array([1.0])
    listed = _list_numbers(diagnosis, other, hypothesis, values, values, {None: 1.0})
    numbers = {number.name: (number.fitted, number.used) for number in listed}
    assert numbers == {
        f"front/{STIFFNESS}": pytest.approx((66.0, 33.0)),
        f"back/{STIFFNESS}": pytest.approx((66.0, 66.0)),
    }


def test_effect_that_is_built_in_is_not_added(first: Dataset) -> None:
    diagnosis = make_diagnosis(first, EffectTerm("bladder", "mooney_rivlin"), x=[0.0, 0.0, 0.0, 0.1])
    with pytest.raises(InputError, match="cannot have the effect 'bladder'"):
        predict_dataset(diagnosis, first)


@pytest.mark.parametrize(
    ("form", "number", "is_refused"),
    [
        ("coulomb", "frictionloss", True),
        ("stribeck", "frictionloss", True),
        ("viscous", "damping", True),
        ("viscous", "frictionloss", False),
    ],
)
def test_friction_is_not_added_to_what_the_joint_declares(
    form: str, number: str, is_refused: bool, first: Dataset
) -> None:
    """The number and the effect describe the same, so both together are twice as much."""
    name = f"model.joint.joint.{number}"
    assert first.mechanism is not None
    values, numbers = first.model_values, first.mechanism.numbers
    free = replace(first.mechanism, model_values={**values, name: 0.0}, numbers={**numbers, name: 0.0})
    rough = replace(first.mechanism, model_values={**values, name: 0.2}, numbers={**numbers, name: 0.2})
    term = EffectTerm("joint_friction", form, part="joint")
    x = [0.0, 0.0, 0.0, *(0.1 for _ in term.parameters)]
    diagnosis = make_diagnosis(replace(first, mechanism=free), term, x=x)
    other = replace(first, mechanism=rough)
    if is_refused:
        with pytest.raises(InputError, match=rf"'{name}' = 0.2 already.*'joint_friction@joint'; set the number to 0"):
            predict_dataset(diagnosis, other)
    else:
        assert predict_dataset(diagnosis, other).channels
    replaced = make_diagnosis(replace(first, mechanism=rough), term, x=x)  # found beside a declared friction
    assert predict_dataset(replaced, other).channels


def test_effect_of_a_tendon_that_is_not_there_is_one_sentence(first: Dataset) -> None:
    assert first.mechanism is not None
    flexor = {"flexor": first.mechanism.devices["flexor"]}
    term = EffectTerm("muscle_damping", "pressure", tendon="extensor")
    diagnosis = make_diagnosis(first, term, x=[0.0, 0.0, 0.0, 1.0])
    with pytest.raises(InputError, match=r"no tendon 'extensor'.*tendons: flexor"):
        predict_dataset(diagnosis, replace(first, mechanism=replace(first.mechanism, devices=flexor)))


def make_error(key: str) -> EffectTerm:
    return EffectTerm("number_error", "value", number=key)


def test_prediction_without_added_effects_mentions_none(first: Dataset, other: Dataset) -> None:
    """The final fit is finer than the one without effects, so its numbers differ a little."""
    diagnosis = make_diagnosis(first, x=[-2.0, 1.0, -1.0])
    assert diagnosis.base_fit is not None
    diagnosis.base_fit = replace(diagnosis.base_fit, x=np.array([-1.99, 1.0, -1.0]))
    prediction = predict_dataset(diagnosis, other)
    assert prediction.best == "best: as-declared"
    (warning,) = prediction.warnings
    assert "added effects" not in warning


def test_effects_of_two_tendons_have_names_of_their_own(first: Dataset, other: Dataset) -> None:
    terms = [EffectTerm("seal_friction", "coulomb", tendon=tendon) for tendon in ("flexor", "extensor")]
    prediction = predict_dataset(make_diagnosis(first, *terms, x=[2.0, 1.0, -1.0, 0.1, 0.2]), other)
    names = [number.name for number in prediction.numbers if number.name.startswith("seal_friction")]
    assert len(set(names)) == len(names) == 2
    assert names[0].startswith("seal_friction@flexor.")


def test_joint_without_a_fitted_number_is_not_predicted(first: Dataset, tmp_path: Path) -> None:
    extra = "[devices.extensor]\n"
    text = write_dataset(tmp_path, extra=extra, groups=("fit_1",), repeats=1, seconds=1.0) / "dataset.toml"
    content = text.read_text("utf-8").replace("'pressure_command_flexor', ", "")
    text.write_text(content, "utf-8")
    with pytest.raises(InputError, match=r"mechanism of dataset .* has no number 'flexor/tendon\.slack_length_mm'"):
        predict_dataset(make_diagnosis(first, x=[2.0, 1.0, -1.0]), load_dataset(tmp_path))
