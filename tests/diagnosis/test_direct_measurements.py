"""Direct measurements that separate equivalent models: what is worth measuring, and what it would show."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from klute_sim.device.device import load_device
from klute_sim.diagnosis import workflow
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.number_error import LENGTH_ZERO
from klute_sim.diagnosis.imperfect_law import compute_jackknife_intervals
from klute_sim.diagnosis.planning.direct_measurements import (
    DECISIVE_RATIO,
    EFFECT_METHODS,
    NUMBER_METHODS,
    DirectMeasurement,
    list_direct_measurements,
)
from klute_sim.diagnosis.selection.predictive_model import PredictiveModel, PredictiveResult
from klute_sim.effects import catalogue

DEVICE = load_device("klute-3-4-pair")
TURNS = EffectTerm("number_error", "value", number="muscle.turns_per_m")
GAIN = EffectTerm("sensor_gain", "linear", "force")
TAPER = EffectTerm("end_taper", "strain")
OIL = EffectTerm("oil_temperature", "walther")


def make_fit(*values: tuple[EffectTerm, tuple[float, ...]], sensitivity: float = 1e4) -> Fit:
    hypothesis = Hypothesis(DEVICE, (), (("force", 3.0),), tuple(term for term, _ in values))
    numbers = [number for _, row in values for number in row]
    x = [p.normalize(number) for p, number in zip(hypothesis.parameters, numbers, strict=True)]
    return Fit(hypothesis, np.array(x), np.zeros(len(x)), sensitivity * np.eye(len(x)), True, [])


def compute_interval(fit: Fit, index: int) -> tuple[float, float]:
    """Return the value and two standard errors on both sides, where residuals are linear."""
    parameter, x, error = fit.hypothesis.parameters[index], fit.x[index], 2.0 / fit.jacobian[index, index]
    ends = parameter.denormalize(x - error), parameter.denormalize(x + error)
    return min(ends), max(ends)


def list_measurements(fits: list[Fit]) -> list[DirectMeasurement]:
    return list_direct_measurements(fits, compute_interval)


def test_numbers_and_instruments_that_only_some_models_blame_are_measured() -> None:
    turns = DEVICE.spec.collect_values()["muscle.turns_per_m"]
    fits = [
        make_fit((TAPER, (0.4,))),
        make_fit((TURNS, (1.05 * turns,))),
        make_fit((GAIN, (1.08,))),
    ]
    count, weight = list_measurements(fits)
    assert count.name == "number_error@muscle.turns_per_m"
    assert (count.expected, count.otherwise) == pytest.approx((1.05 * turns, turns))
    assert weight.name == "sensor_gain@force"
    assert (weight.expected, weight.otherwise, weight.unit) == pytest.approx((1.08, 1.0, ""))
    assert "known weight" in weight.to_dict()["sentence"]
    assert "1.08 confirms sensor_gain@force, 1 refutes it" in weight.to_dict()["sentence"]


def test_a_zero_is_read_at_the_unloaded_instrument() -> None:
    offset = EffectTerm("sensor_offset", "linear", "force")
    (zero,) = list_measurements([make_fit((TAPER, (0.4,))), make_fit((offset, (-14.4,)))])
    assert (zero.name, zero.otherwise, zero.unit) == ("sensor_offset@force", 0.0, "N")
    assert zero.expected == pytest.approx(-14.4)
    assert zero.to_dict()["sentence"].startswith("Unload the cell of 'force' and read it: ")
    too_small = make_fit((offset, (0.9 * DECISIVE_RATIO * zero.accuracy,)))
    assert list_measurements([make_fit((TAPER, (0.4,))), too_small]) == []


def test_what_all_models_share_needs_no_measurement() -> None:
    fits = [make_fit((GAIN, (1.08,)), (TAPER, (0.4,))), make_fit((GAIN, (1.07,)), (OIL, (40.0, 50.0)))]
    (oil,) = list_measurements(fits)
    assert (oil.quantity, oil.expected, oil.unit) == ("temperature_c", pytest.approx(40.0), "°C")
    assert list_measurements(fits[:1]) == []


def test_difference_below_the_accuracy_is_not_proposed() -> None:
    accuracy = list_measurements([make_fit(), make_fit((GAIN, (1.1,)))])[0].accuracy
    for ratio, count in ((0.99 * DECISIVE_RATIO, 0), (1.01 * DECISIVE_RATIO, 1)):
        fit = make_fit((GAIN, (1.0 - ratio * accuracy,)))
        assert len(list_measurements([make_fit(), fit])) == count


def test_value_that_the_fit_hardly_knows_is_not_proposed() -> None:
    """A temperature of 40 °C that may be anything above 20 °C refutes nothing when 22 °C is read."""
    for sensitivity, low, count in ((1e4, 40.0, 1), (2.5, 28.0, 1), (1.5, 20.0, 0)):
        fit = make_fit((OIL, (40.0, 50.0)), sensitivity=sensitivity)
        found = list_measurements([make_fit(), fit])
        assert len(found) == count
        assert all(m.interval[0] == pytest.approx(low, abs=0.1) for m in found)
    (oil,) = list_measurements([make_fit(), make_fit((OIL, (40.0, 50.0)), sensitivity=2.5)])
    assert "28 to 52 °C confirms oil_temperature, 20 °C refutes it" in oil.to_dict()["sentence"]


def test_number_of_a_model_has_its_unit() -> None:
    name = "model.geom.load.mass"
    term = EffectTerm("number_error", "value", number=name)
    hypothesis = Hypothesis(DEVICE, (), (("force", 3.0),), (term,), rig_numbers=((name, 1.0),))
    x = np.array([hypothesis.parameters[0].normalize(1.08)])
    heavier = Fit(hypothesis, x, np.zeros(1), np.full((1, 1), 1e4), True, [])
    (weight,) = list_measurements([make_fit(), heavier])
    assert (weight.expected, weight.otherwise, weight.unit) == (pytest.approx(1.08), 1.0, "kg")
    assert "Weigh the part: 1.08 kg confirms" in weight.to_dict()["sentence"]


@pytest.mark.parametrize(
    ("term", "value", "words"),
    [
        (
            EffectTerm("return_spring_error", "rest"),
            3.0,
            "further in dorsiflexion the unloaded ankle rests than the return spring of the model:",
        ),
        (
            EffectTerm("number_error", "value", number="muscle.bladder_radius_mm"),
            6.8,
            "half the outer diameter of the bladder with calipers:",
        ),
        (TURNS, 8.8, "and divide by its length in metres:"),
        (EffectTerm("rod_side_area", "single_rod"), 9.0, "take 0 if it passes through both ends:"),
        (
            EffectTerm("return_spring_error", "stiffness"),
            1.2,
            "divide its stiffness by that of the model:",
        ),
    ],
)
def test_measured_quantity_is_the_one_that_is_expected(term: EffectTerm, value: float, words: str) -> None:
    (measurement,) = list_measurements([make_fit(), make_fit((term, (value,)))])
    assert words in measurement.to_dict()["sentence"]


def test_number_of_turns_that_a_person_counts_is_that_of_a_twentieth() -> None:
    turns = DEVICE.spec.collect_values()["muscle.turns_per_m"]
    (count,) = list_measurements([make_fit(), make_fit((TURNS, (1.05 * turns,)))])
    n_turns = turns * 1e-3 * DEVICE.spec.collect_values()["muscle.resting_length_mm"]
    assert count.accuracy / turns * n_turns >= 0.05 / np.sqrt(12.0)


def test_methods_belong_to_numbers_and_parameters_that_exist() -> None:
    known = {
        key for name in ("klute-3-4-pair", "klute-1-1-4-pair-valve") for key in load_device(name).spec.collect_values()
    }
    assert set(NUMBER_METHODS) <= {*known, LENGTH_ZERO}
    parameters = {
        (effect.name, p.key)
        for effect in catalogue.get_effects().values()
        for form in effect.forms
        for p in form.parameters
    }
    assert set(EFFECT_METHODS) <= parameters


def test_interval_is_that_of_the_effect_where_predictions_decide(monkeypatch: pytest.MonkeyPatch) -> None:
    """Else a verdict would state two 95 % intervals of one parameter."""
    fit, other = make_fit((GAIN, (1.08,))), make_fit((TAPER, (0.4,)))
    points = np.array([[0.9], [1.0], [1.2]]) * fit.x
    model = PredictiveModel(fit, np.ones(3), points)
    prediction = PredictiveResult(model, model, [], [model], {}, 1.0, 0.0, "condition", 3)
    monkeypatch.setattr(workflow, "compute_confidence_intervals", lambda data, each, indices: {0: (0.0, 1.0)})
    selected: Any = SimpleNamespace(prediction=prediction, data=None)
    assert workflow._compute_interval(selected, fit, 0) == compute_jackknife_intervals(model)[0]
    assert workflow._compute_interval(selected, other, 0) == (0.0, 1.0)
    assert workflow._compute_interval(SimpleNamespace(prediction=None, data=None), fit, 0) == (0.0, 1.0)
