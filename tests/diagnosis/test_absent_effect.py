"""Effects of a selected model whose interval contains their absence."""

import numpy as np
import pytest

from klute_sim.device.device import load_device
from klute_sim.diagnosis import absent_effect
from klute_sim.diagnosis.absent_effect import find_term_without_effect, remove_absent_effects
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.final_model import FinalModel
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.result import Verdict
from tests.diagnosis.synthetic_dataset import make_repeats

DEVICE = load_device("klute-3-4-pair")
FRICTION, GAIN = EffectTerm("seal_friction", "coulomb"), EffectTerm("sensor_gain", "linear", "force")
RADIUS = EffectTerm("number_error", "value", number="muscle.bladder_radius_mm")


def make_fit(terms: tuple[EffectTerm, ...], x: list[float] | None = None) -> Fit:
    hypothesis = Hypothesis(DEVICE, (), (("force", 3.0),), terms)
    point = hypothesis.initial_point() + 1.0 if x is None else np.array(x)
    return Fit(hypothesis, point, np.zeros(1), np.ones((1, len(point))), True, [])


def test_effect_whose_interval_contains_its_absence_is_found() -> None:
    fit = make_fit((FRICTION, GAIN), [1.0, 1.0])
    assert find_term_without_effect(fit, [(5.0, 60.0), (0.97, 0.99)]) is None
    assert find_term_without_effect(fit, [(5.0, 60.0), (0.97, 1.01)]) == (GAIN, 1.0)
    assert find_term_without_effect(fit, [(0.0, 60.0), (0.97, 0.99)]) == (FRICTION, 0.0)
    shaped = make_fit((EffectTerm("volume_coupling", "polytropic"),), [1.0, 0.0])  # the shape may explain it
    assert find_term_without_effect(shaped, [(0.0, 0.1), (1.0, 1.4)]) is None
    declared = DEVICE.spec.collect_values()["muscle.bladder_radius_mm"]
    assert find_term_without_effect(make_fit((RADIUS,)), [(declared - 0.2, declared + 0.1)]) == (RADIUS, declared)
    assert find_term_without_effect(make_fit((RADIUS,)), [(declared + 0.1, declared + 0.2)]) is None


@pytest.mark.parametrize(
    ("verdict", "interval", "expected"),
    [
        ("identified", (0.97, 1.01), "unexplained"),
        ("identified-in-part", (0.97, 1.01), "identified-in-part"),
        ("identified", (0.97, 0.99), "identified"),
        ("indistinguishable", (0.97, 1.01), "indistinguishable"),
    ],
)
def test_effect_that_may_be_absent_is_not_identified(
    verdict: Verdict, interval: tuple[float, float], expected: str
) -> None:
    fit, simulator = make_fit((GAIN,), [1.0]), Simulator(1)
    data = WeightedData(simulator, make_repeats([np.linspace(0.0, 500.0, 100)] * 2), {})
    selected = FinalModel(verdict, ["a reason"], data, make_fit(()), fit, [interval], [], [], has_converged=True)
    doubted = remove_absent_effects(selected, 0)
    assert doubted.verdict == expected
    assert doubted.reasons[-1] == "a reason"
    assert ("is a proxy: its 95 % interval contains the value without effect, 1" in doubted.reasons[0]) == (
        expected != verdict
    )
    simulator.close()


def test_effect_beside_one_that_may_be_absent_is_identified_in_part(monkeypatch: pytest.MonkeyPatch) -> None:
    fit, reduced, simulator = make_fit((FRICTION, GAIN), [1.0, 1.0]), make_fit((FRICTION,), [1.0]), Simulator(1)
    restarted = make_fit((FRICTION,), [1.1])
    monkeypatch.setattr(absent_effect, "refit_without_term", lambda data, current, term: reduced)
    monkeypatch.setattr(
        absent_effect,
        "check_convergence",
        lambda data, fit, rng: (restarted, False) if fit is reduced else pytest.fail("another fit is restarted"),
    )
    monkeypatch.setattr(absent_effect, "compute_equation_residuals", lambda data, fit: [fit])
    intervals = {"after": [(5.0, 60.0)]}
    monkeypatch.setattr(absent_effect, "compute_confidence_intervals", lambda data, current: intervals["after"])
    data = WeightedData(simulator, make_repeats([np.linspace(0.0, 500.0, 100)] * 2), {})
    before = [(5.0, 60.0), (0.97, 1.01)]
    found = [f"{GAIN}: BIC falls by 20.", f"{FRICTION}: BIC falls by 90."]
    selected = FinalModel("identified", found, data, make_fit(()), fit, before, [], [], has_converged=True)
    partial = remove_absent_effects(selected, 0)
    assert (partial.verdict, partial.final_fit, len(partial.reasons)) == ("identified-in-part", restarted, 2)
    assert (partial.has_converged, partial.equation_residuals) == (False, [restarted])
    assert partial.absent_terms == (GAIN,)
    assert partial.reasons[1] == found[1]
    assert "was found, too, and is left out: its 95 % interval" in partial.reasons[0]
    intervals["after"] = [(-1.0, 60.0)]
    neither = remove_absent_effects(selected, 0)
    assert (neither.verdict, neither.final_fit, len(neither.reasons)) == ("unexplained", restarted, 3)
    simulator.close()
