"""One specimen of several that has a wrong number."""

from pathlib import Path

import numpy as np
import pytest

import klute_sim as ks
from klute_sim.datasets.trial import TimeSeries
from klute_sim.device.device import Device, load_device
from klute_sim.diagnosis.device_file import augment_device
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.number_error import NUMBER_ERROR_NAME, compute_plausible_error
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.remarks import describe_contradicted_numbers
from klute_sim.diagnosis.selection.candidates import SPECIMEN_NUMBERS, list_further_terms, list_specimen_numbers
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from tests.diagnosis.synthetic_dataset import write_dataset

NOMINAL = load_device("klute-3-4-pair")
LENGTH = "muscle.resting_length_mm"


def make_device(resting_length: float) -> Device:
    x = np.array([resting_length / NOMINAL.spec.collect_values()[LENGTH] - 1.0])
    uncertainties = ((LENGTH, NOMINAL.spec.collect_values()[LENGTH]),)
    return augment_device(make_fit(Hypothesis(NOMINAL, uncertainties, ()), x), "a test")


def make_trial(specimen: str, device: Device = NOMINAL, group: str = "g") -> BenchExperiment:
    zeros = np.zeros(3)
    measured = {"force": TimeSeries(np.arange(3) * 0.01, zeros)}
    return BenchExperiment(
        f"{specimen}_{group}",
        group,
        "fit",
        device,
        0.0,
        0.01,
        zeros,
        measured,
        unit_length=np.full(3, 0.34),
        specimen=specimen,
    )


def make_fit(hypothesis: Hypothesis, x: np.ndarray) -> Fit:
    return Fit(hypothesis, x, np.zeros(len(x)), np.eye(len(x)), True, [])


def make_term(specimen: str, declared: float, number: str = LENGTH) -> EffectTerm:
    return EffectTerm(NUMBER_ERROR_NAME, "value", number=number, specimen=specimen, declared=declared)


def test_wrong_turns_of_one_specimen_leave_the_radius_of_the_others_uncertain() -> None:
    """The radius of a braid follows its uncertain turns, except where these are wrong in the file."""
    turns, radius = "muscle.turns_per_m", "muscle.bladder_radius_mm"
    declared = NOMINAL.spec.collect_values()[turns]
    plain = Hypothesis(NOMINAL, ((turns, 0.1 * declared),), ())
    extended = plain.with_term(make_term("C", declared, turns))
    point = [1.03 * declared]
    followed = plain.correct_numbers(NOMINAL, None, point)[radius]
    assert followed < NOMINAL.spec.collect_values()[radius]
    values = [*point, extended.parameters[-1].initial]
    assert extended.correct_numbers(NOMINAL, None, values, "A")[radius] == followed
    assert radius not in extended.correct_numbers(NOMINAL, None, values, "C")


def test_number_of_one_specimen_changes_that_specimen_only() -> None:
    own = make_device(150.0)
    term = make_term("C", 150.0)
    hypothesis = Hypothesis(NOMINAL, ((LENGTH, 2.0),), ()).with_term(term)
    (parameter,) = hypothesis.parameters[1:]
    assert (parameter.initial, parameter.scale) == (150.0, compute_plausible_error(LENGTH, 150.0))
    declared = NOMINAL.spec.collect_values()[LENGTH]
    x = np.array([1.0, 3.0])
    trials = [make_trial("A"), make_trial("C", own), make_trial("C"), make_trial("B", own)]
    lengths = [1e3 * setup.parameters.muscle.resting_length for setup in hypothesis.build_setups(x, trials)]
    shared, error = (declared + 2.0) / declared, 3.0 * parameter.scale
    assert lengths == pytest.approx([declared + 2.0, 150.0 * shared + error, declared + 2.0 + error, 150.0 * shared])
    # The device of all specimens does not have the error of one of them.
    fit = make_fit(hypothesis, x)
    assert augment_device(fit, "data").spec.collect_values()[LENGTH] == pytest.approx(declared + 2.0)
    assert describe_contradicted_numbers(fit) == []
    neutral = hypothesis.build_setups(np.zeros(2), trials)
    assert neutral == Hypothesis(NOMINAL, (), ()).build_setups(np.zeros(0), trials)


def test_names_of_a_number_of_one_specimen() -> None:
    term = make_term("C", 150.0)
    assert str(term) == "muscle.resting_length_mm of specimen 'C'"
    assert term.qualified_name == "number_error@muscle.resting_length_mm@C"
    assert term.identity != make_term("B", 150.0).identity


def test_numbers_of_each_specimen_are_candidates_where_there_are_several() -> None:
    own = make_device(150.0)
    assert list_specimen_numbers([make_trial("A"), make_trial("A")], NOMINAL) == []
    terms = list_specimen_numbers([make_trial("A"), make_trial("C", own)], NOMINAL)
    assert {(term.specimen, term.number) for term in terms} == {(s, key) for s in "AC" for key in SPECIMEN_NUMBERS}
    assert {term.declared for term in terms if term.number == LENGTH} == {NOMINAL.spec.collect_values()[LENGTH], 150.0}
    # They are open although the number is declared uncertain for all specimens together.
    assert list_further_terms(terms, make_fit(Hypothesis(NOMINAL, ((LENGTH, 2.0),), ()), np.zeros(1))) == terms


def test_groups_of_other_specimens_do_not_validate(monkeypatch: pytest.MonkeyPatch) -> None:
    simulator = Simulator(1)
    trials = [make_trial("A", group="1"), make_trial("C", group="2"), make_trial("C", group="4")]
    data = WeightedData(simulator, trials, {})
    search = ForwardSelection(data, [data.with_experiments([make_trial("A", group="3")])], [])
    left_out = []
    monkeypatch.setattr(
        "klute_sim.diagnosis.selection.validation.fit_hypothesis",
        lambda training, hypothesis, x, **_: (
            left_out.append([e.group for e in training.experiments]) or make_fit(hypothesis, x)
        ),
    )
    monkeypatch.setattr(WeightedData, "compute_residuals", lambda self, *_, **__: [[]])
    monkeypatch.setattr(WeightedData, "weight_residuals", lambda self, _: np.ones(2))
    monkeypatch.setattr("klute_sim.diagnosis.selection.validation._differ", lambda *_: True)
    before = make_fit(Hypothesis(NOMINAL, (), ()), np.zeros(0))
    after = make_fit(before.hypothesis.with_term(make_term("C", 150.0)), np.zeros(1))
    assert search.compute_validation_gains(before, after) == {"2": 0.0, "4": 0.0}
    assert left_out == [["1", "4"], ["1", "4"], ["1", "2"], ["1", "2"]]
    of_all = make_fit(before.hypothesis.with_term(EffectTerm(NUMBER_ERROR_NAME, "value", number=LENGTH)), np.zeros(1))
    assert search.compute_validation_gains(before, of_all) == {"3": 0.0}
    search.data = data.with_experiments(trials[:2])  # the only group of a specimen does not validate its own number
    assert search.compute_validation_gains(before, after) == {}
    simulator.close()


@pytest.mark.slow
def test_wrong_length_of_one_specimen_is_named_beside_an_effect(tmp_path: Path) -> None:
    effects = {("passive_tension", "exponential"): {"rise_n": 60.0, "offset_n": 0.0, "contraction_scale": 0.035}}
    values = NOMINAL.spec.collect_values()
    longer = make_device(1.02 * values[LENGTH]).spec.to_parameters()
    folder = tmp_path / "specimens"
    folder.mkdir()
    trials, head = [], ""
    for seed, specimen in enumerate("ABC"):
        part = tmp_path / specimen
        other = "validation_1" if specimen == "A" else "test_1"
        base = longer if specimen == "C" else None
        write_dataset(part, effects, base=base, groups=("fit_1", "fit_2", other), seed=seed)
        head, *parts = (part / "dataset.toml").read_text("utf-8").split("[[trial]]")
        for group in ("fit_1", "fit_2", other):
            parts = [text.replace(f'"{group}', f'"{specimen}_{group}') for text in parts]
        trials += [f'specimen = "{specimen}"{text}' for text in parts]
        for file in part.glob("*.csv"):
            file.rename(folder / f"{specimen}_{file.name}")
    (folder / "dataset.toml").write_text("[[trial]]\n".join([head, *trials]), "utf-8")
    result = ks.diagnose(folder)
    assert result.verdict == "identified"
    fit = result.diagnosis.final_fit
    assert {str(term) for term in fit.hypothesis.terms} == {
        "passive_tension (exponential)",
        f"{LENGTH} of specimen 'C'",
    }
    found = dict(zip((p.name for p in fit.hypothesis.parameters), fit.values, strict=True))
    assert found[LENGTH] == pytest.approx(1.02 * values[LENGTH], rel=1e-3)
    assert found["rise_n"] == pytest.approx(60.0, rel=0.05)
    assert result.device.spec.collect_values()[LENGTH] == values[LENGTH]
