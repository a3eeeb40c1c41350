"""Screening and selection of effects."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from klute_sim.datasets import dataset as datasets
from klute_sim.device.device import load_device, parse_device
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import fit_hypothesis
from klute_sim.diagnosis.selection.candidates import check_effect_names, list_candidate_terms
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.screening import (
    Candidate,
    screen_candidates,
    select_best_causes,
    select_best_effects,
    select_shortlist,
)
from klute_sim.diagnosis.workflow import fit_base_device
from klute_sim.effects import catalogue
from klute_sim.errors import InputError
from tests.diagnosis.synthetic_dataset import write_dataset

pytestmark = pytest.mark.slow

NOT_SHOWN = ("bladder", "friction_offset", "leak")
"""Effects that the device has already or that its regulator compensates."""


@pytest.mark.parametrize(
    "key",
    [
        (s.effect, s.form.name)
        for s in catalogue.get_device_slots()
        if s.effect in catalogue.get_named_effects() and s.effect not in NOT_SHOWN and not s.form.candidate_sections
    ],
    ids="-".join,
)
def test_screening_ranks_the_true_effect_first(key: tuple[str, str], fitted_data: tuple, tmp_path: Path) -> None:
    """Screening uses one simulation per candidate, from a fit without the effect; its other forms may tie."""
    size = 1.0 if key[0] == "braid_extensibility" else 0.4  # the uncertain values of the muscle absorb most of it
    slot = catalogue.find_slot(*key)
    true_values = {
        p.key: p.typical if p.neutral is None else p.neutral + size * (p.typical - p.neutral)
        for p in slot.form.parameters
    }
    data = datasets.load_dataset(write_dataset(tmp_path / "d", {key: true_values}, groups=("fit_1", "fit_2")))
    simulator = Simulator(2)
    base, weighted_data = fit_base_device(data, prepare_experiments(data, datasets.split_dataset(data)), simulator)
    result = screen_candidates(weighted_data, base, list_candidate_terms(weighted_data, data))
    # The base fit absorbs most of a taper; the rest resembles a threshold or a load cell offset.
    tie_fraction = 0.5 if key[0] == "end_taper" else 0.95
    assert key[0] in {c.term.effect for c in result if c.predicted_gain > tie_fraction * result[0].predicted_gain}
    assert result[0].predicted_gain > 20.0
    simulator.close()


def test_shortlist_has_all_forms_of_a_promising_effect() -> None:
    data = [("braid_hysteresis", "coulomb"), ("seal_friction", "coulomb")]
    others = [(f"x{k}", "f") for k in range(12)]
    zeros = np.zeros(1)
    synthetic = [
        Candidate(EffectTerm(*name), 100.0 - k, 1.0, zeros, zeros, 1.0, zeros, zeros)
        for k, name in enumerate([*data, *others, ("braid_hysteresis", "maxwell_slip")])
    ]
    names = [(c.term.effect, c.term.form) for c in select_shortlist(synthetic)]
    assert ("braid_hysteresis", "maxwell_slip") in names
    assert len(names) == 9


def test_forms_and_owners_of_one_effect_leave_room_for_others() -> None:
    frictions = [EffectTerm("braid_hysteresis", "coulomb", tendon=owner) for owner in (None, *map(str, range(9)))]
    others = [EffectTerm("joint_friction", form, part="joint") for form in ("coulomb", "stribeck")]
    zeros = np.zeros(1)
    candidates = [
        Candidate(term, 100.0 - k, 1.0, zeros, zeros, 1.0, zeros, zeros) for k, term in enumerate([*frictions, *others])
    ]
    assert [c.term for c in select_shortlist(candidates)] == [*frictions[:8], others[0]]
    assert [c.term for c in select_best_effects(candidates, 6)] == [frictions[0], others[0]]
    assert [c.term for c in select_best_causes(candidates, 6)] == frictions[:6]


def test_candidates_exclude_effects_of_the_device(fitted_data: tuple) -> None:
    data, weighted_data, _ = fitted_data
    names = {t.effect for t in list_candidate_terms(weighted_data, data)}
    assert not any((t.number or "").startswith("mounting.") for t in list_candidate_terms(weighted_data, data))
    assert "bladder" not in names
    assert {"end_taper", "sensor_gain"} <= names
    assert {t.channel for t in list_candidate_terms(weighted_data, data) if t.effect == "sensor_gain"} == {
        "force",
        "pressure",
    }
    assert {t.effect for t in list_candidate_terms(weighted_data, data, only=("end_taper",))} == {"end_taper"}
    assert "end_taper" not in {t.effect for t in list_candidate_terms(weighted_data, data, exclude=("end_taper",))}
    terms = list_candidate_terms(weighted_data, data, exclude=("sensor_gain@force", "muscle.turns_per_m"))
    assert {t.channel for t in terms if t.effect == "sensor_gain"} == {"pressure"}
    assert "muscle.turns_per_m" not in {t.number for t in terms}
    numbers = list_candidate_terms(weighted_data, data, only=("number_error@muscle.turns_per_m",))
    assert [(n.number, n.form) for n in numbers] == [("muscle.turns_per_m", form) for form in ("value", "same_radius")]
    with pytest.raises(InputError, match=r"'sensor_gain@froce' is no candidate.*did you mean 'sensor_gain@force'"):
        list_candidate_terms(weighted_data, data, exclude=("sensor_gain@froce",))
    with pytest.raises(InputError, match=r"no effect or number 'taper'.* numbers are named as 'muscle\.count'"):
        check_effect_names(data, ("taper",), ())
    content = load_device("klute-3-4-pair").content + b"\n[effects.end_taper]\ncone_ratio = 1.0\n"
    tapering = parse_device(content, "tapering")
    with pytest.raises(InputError, match=r"has effect 'end_taper' already.*effects\.end_taper\."):
        check_effect_names(replace(data, device=tapering), ("end_taper",), ())


def test_names_to_test_without_a_candidate_are_refused(fitted_data: tuple) -> None:
    data, weighted_data, _ = fitted_data
    with pytest.raises(InputError, match=r"'foot_stiffness' acts in gait only, and these data are of rig = 'bench'"):
        check_effect_names(data, ("foot_stiffness",), ())
    with pytest.raises(InputError, match="'joint_friction' acts on a mechanism only"):
        check_effect_names(data, ("joint_friction",), ())
    check_effect_names(data, (), ("foot_stiffness",))
    for name in ("bladder", "mounting.neutral_muscle_ratio", "muscle.count"):  # built in, not here, a count
        check_effect_names(data, (name,), ())
        with pytest.raises(InputError, match=f"'{name}' is no candidate for these data"):
            list_candidate_terms(weighted_data, data, only=(name, "end_taper"))


def test_validation_trials_reject_effects_that_do_not_improve_them(fitted_data: tuple) -> None:
    data, weighted_data, simulator = fitted_data
    base, _ = fit_base_device(data, weighted_data.experiments, simulator)
    spoiled = base.hypothesis.with_term(EffectTerm("sensor_offset", "linear", "force"))
    after = fit_hypothesis(weighted_data, spoiled, max_nfev=2)
    search = ForwardSelection(weighted_data, [weighted_data], [])
    worse = after.x.copy()
    worse[-1] = 20.0
    bad = type(after)(spoiled, worse, after.weighted_residuals, after.jacobian, True, after.residuals)
    gains = search.compute_validation_gains(base, bad)
    assert gains["fit_1"] < -0.5
    assert "explains no more than noise" in search.rejection_reason(base, bad, {"a": 0.5})
    good = type(after)(spoiled, worse, 0.9 * base.weighted_residuals, after.jacobian, True, after.residuals)
    assert "validation trials get worse: 'fit_1' by" in search.rejection_reason(base, good, gains)
    assert not search.has_misfit(base)  # without misfit, the threshold for an effect is higher
    assert "improve by no more than 10 %" in search.rejection_reason(base, good, {"a": 0.08, "b": 0.11})
    without_validation = replace(search, validation_data=[])
    reason = without_validation.rejection_reason(base, good, {"a": 0.08, "b": 0.11})
    assert "fits, but the fitted groups, each left out in turn, improve by no more than 10 %" in reason
    assert search.rejection_reason(base, good, {"a": 0.5, "b": -0.01}) == ""
    error = type(base)(
        base.hypothesis, base.x, base.weighted_residuals, base.jacobian, True, shift_force(base.residuals, 5.0)
    )
    assert search.has_misfit(error)
    assert search.rejection_reason(error, good, {"a": 0.08, "b": 0.11}) == ""
    assert "improve by no more than 5 %" in search.rejection_reason(error, good, {"a": 0.02, "b": 0.07})


def test_simplify_replaces_a_form_that_a_later_effect_makes_redundant(tmp_path: Path) -> None:
    friction, error = EffectTerm("seal_friction", "coulomb"), EffectTerm("sensor_offset", "linear", "force")
    folder = write_dataset(
        tmp_path / "d",
        {("seal_friction", "coulomb"): {"force_n": 20.0}},
        device="klute-1-1-4-pair",
        distort={"force": lambda time, value: value + 10.0},
    )
    result, simulator = datasets.load_dataset(folder), Simulator(2)
    fit_experiments = [e for e in prepare_experiments(result, datasets.split_dataset(result)) if e.use == "fit"]
    base, weighted_data = fit_base_device(result, fit_experiments, simulator)
    search = ForwardSelection(weighted_data, [], [])
    shaped = fit_hypothesis(
        weighted_data, base.hypothesis.with_term(EffectTerm("seal_friction", "stribeck")).with_term(error)
    )
    simple = search.simplify(shaped, base)
    assert simple.hypothesis.terms == (friction, error)
    force = next(v for u, v in zip(simple.hypothesis.parameters, simple.values, strict=True) if u.name == "force_n")
    assert force == pytest.approx(20.0, rel=0.1)
    simulator.close()


def shift_force(residuals: list, shift: float) -> list:
    return [{channel: values + shift * (channel == "force") for channel, values in row.items()} for row in residuals]
