"""Formatting of numbers, identifiers and sentences in reports of diagnoses."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from klute_sim.device.device import load_device
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.localization.equation_residuals import EquationResidual
from klute_sim.diagnosis.probability import estimate_probabilities
from klute_sim.diagnosis.result import Diagnosis, Verdict
from klute_sim.report.diagnosis import text as words


@pytest.mark.parametrize(
    ("numbers", "expected"),
    [
        (
            (1.00034, 0.99991, 1.00112),
            ("1.0003", "0.9999", "1.0011"),
        ),  # four digits do not suffice
        ((7.0, 6.912, 7.088), ("7.000", "6.912", "7.088")),
        ((41234.0, 41233.95, 41234.5), ("41234.00", "41233.95", "41234.50")),
        ((41234.0, 40000.0, 42000.0), ("41234", "40000", "42000")),
        ((0.0, 0.0, 0.02), ("0.00000", "0.00000", "0.02000")),
        ((1.0, 1.0, 1.0), ("1", "1", "1")),
        ((0.002 + 1e-12, 0.002, 0.3), ("0.0020", "0.0020", "0.3000")),
        ((1.0, 0.5, math.inf), ("1", "0.5", "∞")),
        ((1.0, math.nan, math.nan), ("1", "unknown", "unknown")),
    ],
)
def test_interval_has_enough_decimals_to_distinguish_its_numbers(
    numbers: tuple[float, ...], expected: tuple[str, ...]
) -> None:
    assert words.format_interval(*numbers) == expected


def test_keys_split_into_name_and_unit() -> None:
    assert words.split_key("stiffness_n_per_mm") == ("stiffness", "N/mm")
    assert words.split_key("damper.orifice_concentric_mm")[1] == "mm"


@pytest.mark.parametrize(
    ("value", "expected"),
    [(12.0956, "12.1"), (0.010694, "0.01069"), (118.4, "118.4"), (0.0, "0"), (829501.3, "829500"), (2e-7, "2.000e-07")],
)
def test_numbers_have_four_significant_digits(value: float, expected: str) -> None:
    assert words.format_number(value) == expected


def test_identifiers_in_sentences_are_humanized() -> None:
    assert words.format_sentence("braid_hysteresis (maxwell_slip) fits 'muscle_length'") == (
        "Braid hysteresis (Maxwell slip) fits 'muscle length'"
    )
    assert words.format_sentence("group 'my_sensor_gain_2' gets worse") == "Group 'my_sensor_gain_2' gets worse"


def test_title_of_the_table_tells_effects_from_numbers(diagnosis: Diagnosis) -> None:
    effect = diagnosis.added_terms[0]
    number = EffectTerm("number_error", "value", number="muscle.bladder_radius_mm")
    assert words.format_effects_title(diagnosis) == "Added effects"
    assert words.format_effects_title(replace(diagnosis, added_terms=(number,))) == "Corrected numbers"
    both = replace(diagnosis, added_terms=(effect, number))
    assert words.format_effects_title(both) == "Added effects and corrected numbers"


def test_what_a_tolerance_permits_may_be_missing(diagnosis: Diagnosis) -> None:
    nothing = replace(diagnosis, verdict="nothing-missing", added_terms=(), final_fit=diagnosis.base_fit)
    tolerated = replace(nothing, selection_history=[])
    assert words.describe_verdict(tolerated).endswith("within the stated tolerance.")
    searched, unsearched = (estimate_probabilities(one) for one in (nothing, tolerated))
    assert searched is not None
    assert unsearched is not None
    assert searched.nothing_missing > 0.9
    assert unsearched.nothing_missing < 0.2  # the misfit is several times the noise


def test_motion_that_no_fitted_trial_has_is_asked_for(diagnosis: Diagnosis) -> None:
    unexplained = replace(diagnosis, verdict="unexplained", added_terms=(), final_fit=diagnosis.base_fit)
    assert words.describe_verdict(unexplained).endswith("no candidate effect explains the deviation.")
    still = [replace(e, unit_length=np.full(len(e.command), 0.34)) for e in diagnosis.fitted_experiments]
    sentence = words.describe_verdict(replace(unexplained, fitted_experiments=still))
    assert "no fitted trial moves, so effects of motion cannot be found" in sentence
    assert "no candidate effect" in words.describe_verdict(
        replace(unexplained, fitted_experiments=still, experiments=still)
    )


def test_weights_of_coarse_inputs_are_mentioned(diagnosis: Diagnosis) -> None:
    assert words.describe_weights(diagnosis) == ""
    coarse = [
        replace(e, input_error_scale={"force": np.where(e.measured["force"].time < 0.5, 1.0, 3.0)})
        for e in diagnosis.experiments
    ]
    weighted = replace(diagnosis, experiments=coarse)
    assert words.describe_weights(weighted).endswith("figures show all.")
    for factor, is_told in ((1.2, False), (5.0, True)):  # the weights hide much of the misfit
        gaps = {c: replace(gap, nominal_unweighted=factor * gap.nominal) for c, gap in diagnosis.channel_rms.items()}
        sentence = words.describe_weights(replace(weighted, channel_rms=gaps))
        force = words.format_number(factor * gaps["force"].nominal, 3)
        assert (f"the nominal device would miss 'force' by {force} N" in sentence) == is_told


def test_supply_that_agrees_to_the_noise_lacks_nothing(diagnosis: Diagnosis) -> None:
    residuals = [
        EquationResidual("supply", 8e3, 50.0, 1e3),
        EquationResidual("muscle, damper or tendon", 30.0, 50.0, 3.0),
    ]
    gap = diagnosis.channel_rms["pressure"]
    agreeing = replace(diagnosis, equation_residuals=residuals)
    deviating_gap = replace(gap, refitted=10.0 * (gap.noise_floor or 1.0))
    deviating = replace(agreeing, channel_rms={**diagnosis.channel_rms, "pressure": deviating_gap})
    assert "0.08 bar" not in words.describe_equation_residuals(agreeing)
    assert "30 N" in words.describe_equation_residuals(agreeing)
    assert "0.08 bar" in words.describe_equation_residuals(deviating)


@pytest.mark.parametrize(
    ("sections", "name"),
    [
        (
            "[tendon]\nslack_length_mm = 100.0\nstiffness_1_n_per_mm = 30.0\nstiffness_2_n_per_mm = 20.0\n"
            "engagement_mm = 4.0\n",
            "the tendon",
        ),
        ("[cylinder]\nextended_length_mm = 200.0\nstroke_mm = 60.0\n", "the cylinder"),
    ],
)
def test_equation_of_a_device_names_the_parts_that_it_has(
    diagnosis: Diagnosis, sections: str, name: str, tmp_path: Path
) -> None:
    (tmp_path / "part.toml").write_text(f'name = "part"\ndescription = "alone"\n{sections}')
    dataset = replace(diagnosis.dataset, device=load_device(tmp_path / "part.toml"))
    residuals = [EquationResidual("muscle, damper or tendon", 30.0, 50.0, 3.0)]
    alone = replace(diagnosis, dataset=dataset, equation_residuals=residuals)
    assert f"the equation of {name} leaves a force" in words.describe_equation_residuals(alone)


def test_effects_that_explain_all_leave_no_rest(diagnosis: Diagnosis) -> None:
    verdicts: tuple[Verdict, ...] = ("identified-in-part", "indistinguishable")
    for share, end in ((0.9997, "practically all of the"), (0.8, "80 % of the")):
        for verdict in verdicts:
            prediction = SimpleNamespace(share=share)
            sentence = words.describe_verdict(replace(diagnosis, verdict=verdict, prediction=prediction))
            assert f"; this explains {end} squared error" in sentence
            assert ("the rest is unexplained" in sentence) == (share < 0.99)


def test_ankle_lacks_a_moment(diagnosis: Diagnosis) -> None:
    residuals = [EquationResidual("ankle", 3.0, 50.0, 0.3), EquationResidual("tendon", 0.0, 0.0, 3.0)]
    assert words.describe_equation_residuals(replace(diagnosis, equation_residuals=residuals)) == (
        "If the instruments are correct, the equation of the ankle leaves a moment of 3 N·m rms; "
        "that of the tendon holds within the noise."
    )


def test_number_at_a_limit_of_the_fit_is_said(diagnosis: Diagnosis) -> None:
    assert words.describe_numbers_at_bounds(diagnosis) == ""
    fit = diagnosis.recommended_fit
    x = fit.x.copy()
    x[0] = fit.hypothesis.bounds()[0][0]
    at_limit = replace(diagnosis, base_fit=replace(fit, x=x), final_fit=replace(fit, x=x))
    name = fit.hypothesis.parameters[0].name
    sentence = words.describe_numbers_at_bounds(at_limit)
    assert sentence.startswith(f"{name} (")
    assert ") is at a limit of the fit: the data contradict" in sentence


def test_probabilities_name_their_source(diagnosis: Diagnosis) -> None:
    sentence = words.describe_probabilities(diagnosis)
    assert sentence.startswith("Probabilities, calibrated on ")
    assert "simulated datasets of the benchmark: " in sentence
    assert "that nothing as large as the noise is missing" in sentence
    assert words.describe_probabilities(replace(diagnosis, verdict="insufficient-data")) == ""
    sentence = words.describe_probabilities(replace(diagnosis, verdict="indistinguishable"))
    assert sentence.endswith("these data do not prefer it to the others.")


def test_effect_that_test_trials_do_not_show_is_as_large_as_in_the_fitted_ones(diagnosis: Diagnosis) -> None:
    unseen = estimate_probabilities(replace(diagnosis, held_out="not-tested", channel_rms={}))
    confirmed = estimate_probabilities(replace(diagnosis, held_out="confirmed"))
    assert unseen.nothing_missing == pytest.approx(confirmed.nothing_missing, abs=0.1)
    blind = estimate_probabilities(replace(diagnosis, held_out="confirmed", channel_rms={}))
    assert blind.nothing_missing > unseen.nothing_missing + 0.2


FRICTION, GAIN = EffectTerm("seal_friction", "coulomb"), EffectTerm("sensor_gain", "linear", "force")
RADIUS = EffectTerm("number_error", "value", number="muscle.bladder_radius_mm")


@pytest.mark.parametrize(
    ("has_uncertain_numbers", "term", "content"),
    [
        (True, FRICTION, "the refitted numbers and the effects"),
        (True, GAIN, "the refitted numbers"),
        (False, GAIN, "the device as declared"),
        (False, RADIUS, "the refitted numbers"),
        (False, RADIUS._replace(specimen="a"), "the device as declared"),
        (False, FRICTION, "the effects"),
    ],
)
def test_device_file_holds_what_was_found_of_the_device(
    diagnosis: Diagnosis, has_uncertain_numbers: bool, term: EffectTerm, content: str
) -> None:
    hypothesis = diagnosis.base_fit.hypothesis
    base = replace(hypothesis, uncertainties=hypothesis.uncertainties if has_uncertain_numbers else ())
    fits = [
        replace(diagnosis.base_fit, hypothesis=each, x=each.initial_point()) for each in (base, base.with_term(term))
    ]
    found = replace(diagnosis, base_fit=fits[0], final_fit=fits[1], added_terms=(term,))
    assert f"device.toml in this folder holds {content}; 'klute-sim bench steps " in words.describe_next_step(found)
    declared = replace(found, is_declared_best=True)
    assert "holds the device as declared;" in words.describe_next_step(declared)
    worse = words.describe_next_step(replace(found, is_worse_on_test=True))
    assert ("the refitted numbers;" in worse) == has_uncertain_numbers
    assert "effects" not in worse


def test_files_of_a_mechanism_are_described_by_their_content(diagnosis: Diagnosis) -> None:
    joint = replace(diagnosis, dataset=replace(diagnosis.dataset, rig="mjcf"))
    for recommended, content in (
        (joint, "the refitted numbers and the effects"),
        (replace(joint, is_worse_on_test=True), "the refitted numbers"),
        (replace(joint, is_declared_best=True), "what was declared"),
    ):
        assert words.describe_next_step(recommended).endswith(f"and of the model in this folder hold {content}.")


def test_protocol_that_the_device_allows_is_recommended(diagnosis: Diagnosis, tmp_path: Path) -> None:
    tendon = "slack_length_mm = 100.0\nstiffness_1_n_per_mm = 30.0\nstiffness_2_n_per_mm = 20.0\nengagement_mm = 4.0\n"
    (tmp_path / "part.toml").write_text(f'name = "part"\ndescription = "alone"\n[tendon]\n{tendon}')
    alone = replace(diagnosis, fitted_device=load_device(tmp_path / "part.toml"))
    assert "'klute-sim bench ramps device.toml'" in words.describe_next_step(alone)
