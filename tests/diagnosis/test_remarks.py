"""Remarks about fitted numbers and tolerances say what, how much, and beside what."""

from dataclasses import replace

import numpy as np
import pytest

from klute_sim.datasets.trial import TimeSeries, Trial
from klute_sim.diagnosis import remarks
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.quantization import Quantizer
from klute_sim.diagnosis.noise.repeats import estimate_noise_from_repeats
from klute_sim.diagnosis.remarks import (
    describe_contradicted_numbers,
    describe_excessive_commands,
    describe_length_zero,
    describe_quantization,
    describe_reference_diameter,
    describe_refitted_numbers,
    describe_rubber,
    describe_tested_candidates,
    describe_tolerance,
    describe_undetermined_parameters,
)
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.laws import mckibben
from tests.diagnosis import test_numbers as numbers_test
from tests.diagnosis.synthetic_dataset import make_repeats
from tests.diagnosis.test_numbers import NOMINAL, make_fit, make_number_term

SLACK = "tendon.slack_length_mm"


def make_trial(name: str, command_bar: float) -> Trial:
    time = np.arange(1000.0)
    prescribed = {"pressure_command": TimeSeries(time, np.full(1000, 1e5 * command_bar))}
    return Trial(name=name, group=name, use=None, device=NOMINAL, files=(), prescribed=prescribed, measured={})


def test_commands_beyond_the_supply_are_stated_with_the_excess() -> None:
    supply = NOMINAL.spec.collect_values()["supply.pressure_bar"]
    low, high, higher = (make_trial(name, supply + excess) for name, excess in (("a", 0.0), ("b", 1.0), ("c", 2.5)))
    spiked = make_trial("d", supply)
    spiked.prescribed["pressure_command"].value[7] = 1e7
    assert describe_excessive_commands([low, spiked]) == []
    (sentence,) = describe_excessive_commands([low, high, higher])
    assert f"commands of 2 of 3 trials exceed supply.pressure_bar = {supply:.3g} of the device" in sentence
    assert "by up to 2.5 bar in 'c'" in sentence


def test_twins_of_a_wrong_zero_of_the_length_are_told() -> None:
    trial, slack = make_trial("a", 1.0), EffectTerm("tendon_slack", "dead_length")
    leak = EffectTerm("leak", "orifice")
    fits = [make_fit(Hypothesis(NOMINAL, (), (), (term,)), np.zeros(1)) for term in (slack, make_number_term(SLACK))]
    assert describe_length_zero([trial], fits) == []  # no length is prescribed
    trial.prescribed["length"] = TimeSeries(np.arange(1000.0), np.full(1000, 0.3))
    (sentence,) = describe_length_zero([trial], fits)
    assert f"looks like {SLACK} and tendon_slack in every reading" in sentence
    assert describe_length_zero([trial], [make_fit(Hypothesis(NOMINAL, (), (), (leak,)), np.zeros(2))]) == []


def test_stiffer_rubber_is_told_beside_a_thicker_wall() -> None:
    """Both moduli together change the tension as the volume of the wall does."""
    term = make_number_term("muscle.bladder_thickness_mm")
    fit = make_fit(Hypothesis(NOMINAL, (), (), (term,)), np.array([4.0]))
    (sentence,) = describe_rubber([fit])
    factor = float(sentence.partition(" times as stiff")[0].rpartition(" ")[2])
    (setup,) = fit.hypothesis.build_setups(fit.x, [numbers_test.make_trial()])
    muscle, length = NOMINAL.parameters.muscle, 0.9 * NOMINAL.parameters.muscle.resting_length
    stiffer = muscle._replace(c10=factor * muscle.c10, c01=factor * muscle.c01)
    nominal, *pulls = (mckibben.force(m, 2e5, length) for m in (muscle, setup.parameters.muscle, stiffer))
    assert abs(pulls[0] - nominal) > 1.0
    assert pulls[1] - nominal == pytest.approx(pulls[0] - nominal, rel=0.03)
    assert describe_rubber([make_fit(Hypothesis(NOMINAL, (), (), (make_number_term(SLACK),)), np.zeros(1))]) == []


def test_diameter_that_parameters_refer_to_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    threshold, leak = EffectTerm("threshold_pressure", "constant"), EffectTerm("leak", "orifice")
    (sentence,) = describe_reference_diameter(make_fit(Hypothesis(NOMINAL, (), (), (threshold,)), np.zeros(1)))
    diameter = 2e3 * NOMINAL.parameters.muscle.bladder_radius
    assert f"of {diameter:.3g} mm a threshold pressure is {10.0 / diameter:.3g} times as high" in sentence
    assert describe_reference_diameter(make_fit(Hypothesis(NOMINAL, (), (), (leak,)), np.zeros(2))) == []
    monkeypatch.setattr(remarks, "REFERENCE_DIAMETER", 1.01e-3 * diameter)
    assert describe_reference_diameter(make_fit(Hypothesis(NOMINAL, (), (), (threshold,)), np.zeros(1))) == []


def test_choice_of_candidates_is_repeated() -> None:
    assert describe_tested_candidates((), ()) == []
    (sentence,) = describe_tested_candidates(("sensor_gain@force", "leak"), ("number_error",))
    assert "only sensor_gain@force, leak may be named, and number_error may not be named" in sentence
    assert sentence.endswith(
        "whether other causes explain the data was not examined, and the probabilities do not count them."
    )
    (sentence,) = describe_tested_candidates((), ("number_error",))
    assert sentence.endswith("whether other causes explain the data was not examined.")


def test_change_of_an_uncertain_number_is_stated_from_two_standard_deviations_on() -> None:
    declared = NOMINAL.spec.collect_values()[SLACK]
    hypothesis = Hypothesis(NOMINAL, ((SLACK, 1.0),), ())
    assert describe_refitted_numbers(make_fit(hypothesis, np.array([1.9]))) == []
    (sentence,) = describe_refitted_numbers(make_fit(hypothesis, np.array([2.5])))
    assert f"{SLACK} from {declared:.4g} to {declared + 2.5:.4g} (2.5)" in sentence


def test_number_that_is_wrong_by_more_than_it_is_uncertain_is_compared_with_its_deviation() -> None:
    hypothesis = Hypothesis(NOMINAL, ((SLACK, 1.0),), (), (make_number_term(SLACK),))
    parameter = hypothesis.parameters[-1]
    fit = make_fit(hypothesis, np.array([0.0, parameter.normalize(parameter.initial + 4.0)]))
    (sentence,) = describe_contradicted_numbers(fit)
    assert "standard deviation of 1; the fitted value is 4.0 standard deviations away" in sentence
    assert describe_contradicted_numbers(make_fit(Hypothesis(NOMINAL, ((SLACK, 1.0),), ()), np.zeros(1))) == []


def test_parameter_whose_interval_covers_its_range_is_not_determined() -> None:
    hypothesis = Hypothesis(NOMINAL, ((SLACK, 1.0),), ()).with_term(EffectTerm("hose", "tube"))
    fit = make_fit(hypothesis, hypothesis.initial_point())
    keys = [parameter.name for parameter in hypothesis.parameters]
    narrow = [(parameter.initial, parameter.initial) for parameter in hypothesis.parameters]
    assert describe_undetermined_parameters(fit, narrow) == []
    diameter = keys.index("inner_diameter_mm")
    bounds = hypothesis.parameters[diameter].bounds
    whole = tuple(hypothesis.parameters[diameter].denormalize(end) for end in bounds)
    (sentence,) = describe_undetermined_parameters(fit, [*narrow[:diameter], whole, *narrow[diameter + 1 :]])
    assert sentence.startswith("The data hardly determine 'inner_diameter_mm' of hose (")
    # Declared numbers have a prior.
    assert describe_undetermined_parameters(fit, [(0.0, 1e3), *narrow[1:]]) == []


@pytest.mark.parametrize(
    ("dither", "ratio"), [(0.05, "at least 20 times the noise"), (0.2, "5.0 times the noise"), (1.0, "no more than")]
)
def test_resolution_is_compared_with_the_noise(dither: float, ratio: str) -> None:
    sentence = describe_quantization("force", Quantizer(2.0, 0.01, 0.0, dither))
    assert sentence.startswith("'force' is quantized in steps of 2 N")
    assert ratio in sentence


@pytest.mark.parametrize(
    ("amplitude", "tolerance_n", "relation"),
    [
        (8.0, 2.0, "(tolerance 2 N): more than the stated tolerance."),
        (8.0, 20.0, "(tolerance 20 N): more than the noise, and within the stated tolerance."),
        (0.0, 20.0, "The misfit is within the stated tolerance (force 20 N)."),
    ],
)
def test_misfit_is_compared_with_its_tolerance(amplitude: float, tolerance_n: float, relation: str) -> None:
    rng, wave = np.random.default_rng(0), amplitude * np.sin(np.linspace(0.0, 20.0, 400))
    rows = [wave + rng.normal(0.0, 0.5, 400) for _ in range(4)]
    trials = make_repeats(rows)
    residuals = [{"force": row} for row in rows]
    fit = replace(make_fit(Hypothesis(NOMINAL, (), ()), np.zeros(0)), residuals=residuals)
    simulator = Simulator(1)
    data = WeightedData(simulator, trials, estimate_noise_from_repeats(trials, residuals))
    search = ForwardSelection(data, [], [], tolerance={"force": tolerance_n})
    (sentence,) = describe_tolerance(search, fit)
    assert ("force by 5.6" in sentence) == (amplitude > 0.0)
    assert sentence.endswith(relation)
    simulator.close()
