"""Names against data-driven terms of the same size: true names stand, imitations of a missing effect do not."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from klute_sim.datasets.trial import TimeSeries
from klute_sim.diagnosis.discrepancy import data_driven_comparison
from klute_sim.diagnosis.discrepancy.data_driven_comparison import DataDrivenComparison, compare_with_data_driven_models
from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.law_error_weights import weight_by_law_error
from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.predictive_model import PredictiveResult
from klute_sim.diagnosis.selection.predictive_selection import PredictiveSelection
from klute_sim.units import BAR
from tests.diagnosis.test_data_driven_rival import add_terms
from tests.diagnosis.test_sparse_regression import create_search

pytestmark = pytest.mark.slow

BRAID_FRICTION = EffectTerm("braid_hysteresis", "coulomb")
SEAL_FRICTION = EffectTerm("seal_friction", "coulomb")
DAMPING = EffectTerm("muscle_damping", "viscous")
CROSS_TALK_N_PER_BAR = 12.0


@pytest.fixture(scope="module")
def with_friction(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[ForwardSelection, Fit]]:
    folder = tmp_path_factory.mktemp("friction") / "d"
    yield from create_search(folder, {("braid_hysteresis", "coulomb"): {"slope_n_per_bar": 6.0}})


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[ForwardSelection, Fit]]:
    yield from create_search(tmp_path_factory.mktemp("clean") / "d", {})


def add_cross_talk(experiment: Experiment) -> Experiment:
    """Return ``experiment`` with a load cell that responds to the pressure."""
    force, pressure = experiment.measured["force"], experiment.measured["pressure"]
    part = CROSS_TALK_N_PER_BAR / BAR * np.interp(force.time, pressure.time, pressure.value)
    return replace(experiment, measured={**experiment.measured, "force": TimeSeries(force.time, force.value + part)})


def judge(
    search: ForwardSelection, base: Fit, named: Fit, exclude: tuple[str, ...] = (), specimens: str = ""
) -> DataDrivenComparison:
    """Return the data-driven terms beside the names of ``named``, whose error is that of the law, with all trials of
    ``search``; with ``specimens``, each group has its own."""
    groups = sorted({e.group for e in search.data.experiments})
    experiments = [
        replace(e, specimen=specimens[groups.index(e.group)]) if specimens else e for e in search.data.experiments
    ]
    data = weight_by_law_error(search.data, experiments, named.residuals)
    selection = PredictiveSelection(data, {c: n.std for c, n in search.data.noise.items()}, [])
    base_model, chosen = (selection.assess(fit_hypothesis(data, fit.hypothesis, fit.x)) for fit in (base, named))
    noise = float(np.mean([search.data.noise[c].std ** 2 / law.std**2 for c, law in data.noise.items()]))
    share = (base_model.error - chosen.error) / (base_model.error - noise)
    stability = dict.fromkeys(chosen.terms, 1.0)
    result = PredictiveResult(
        base_model, chosen, [], [chosen, base_model], stability, share, noise, selection.fold_kind, len(selection.folds)
    )
    return compare_with_data_driven_models(search, base, selection, result, exclude)


def test_imitations_of_a_missing_friction_are_refused(with_friction: tuple[ForwardSelection, Fit]) -> None:
    search, base = with_friction
    imitation = add_terms(search, base, SEAL_FRICTION, DAMPING)
    data_driven_model = judge(search, base, imitation).better
    assert data_driven_model is not None
    assert "in one equation (F += " in data_driven_model.description
    assert "N p d" in data_driven_model.description
    assert data_driven_model.fit is not None
    assert judge(search, base, imitation, ("unknown_force",)).better is None


def test_true_name_stands(with_friction: tuple[ForwardSelection, Fit]) -> None:
    search, base = with_friction
    assert judge(search, base, add_terms(search, base, BRAID_FRICTION)) == DataDrivenComparison()


def test_term_elsewhere_that_predicts_as_well_is_a_rival(
    with_friction: tuple[ForwardSelection, Fit], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(data_driven_comparison, "locate_term", lambda term: term.effect)
    search, base = with_friction
    better, rival = judge(search, base, add_terms(search, base, BRAID_FRICTION))
    assert better is None
    assert rival is not None
    assert "N p d" in rival.description  # the same friction, as a function
    assert judge(search, base, add_terms(search, base, BRAID_FRICTION), ("unknown_force",)).rival is None


def test_term_beside_the_name_is_a_rival_if_it_does_not_contain_it(
    with_friction: tuple[ForwardSelection, Fit], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(data_driven_comparison, "contains_names", lambda *_: False)
    search, base = with_friction
    named = add_terms(search, base, BRAID_FRICTION)
    rival = judge(search, base, named).rival
    assert rival is not None
    assert "N p d" in rival.description
    assert judge(search, base, named, specimens="AB").rival is None


def test_cross_talk_into_the_load_cell_is_found(clean: tuple[ForwardSelection, Fit]) -> None:
    search, clean_base = clean
    data = search.data.with_experiments([add_cross_talk(e) for e in search.data.experiments])
    base = fit_hypothesis(data, clean_base.hypothesis, clean_base.x)
    disturbed = replace(search, data=data, history=[])
    data_driven_model = judge(disturbed, base, add_terms(disturbed, base, SEAL_FRICTION)).better
    assert data_driven_model is not None
    assert data_driven_model.fit is None
    assert "in the reading of 'force'" in data_driven_model.description
    coefficient, unit = data_driven_model.description.split("(+")[1].split(" ", 1)
    assert float(coefficient) == pytest.approx(CROSS_TALK_N_PER_BAR, rel=0.15)  # by one linear step
    assert unit == "N per bar of 'pressure')"


def test_one_channel_has_fewer_functions_than_three_names(with_friction: tuple[ForwardSelection, Fit]) -> None:
    search, full_base = with_friction
    experiments = [replace(e, measured={"force": e.measured["force"]}) for e in search.data.experiments]
    data = WeightedData(search.data.simulator, experiments, {"force": search.data.noise["force"]})
    base = fit_hypothesis(data, full_base.hypothesis, full_base.x)
    force_only = replace(search, data=data, history=[])
    three = add_terms(force_only, base, BRAID_FRICTION, SEAL_FRICTION, DAMPING)
    assert judge(force_only, base, three).better is None


def multiply_force(clean: tuple[ForwardSelection, Fit], gain: float) -> tuple[ForwardSelection, Fit]:
    """Return search and fit of ``clean`` data whose load cell reads ``gain`` times the force."""
    search, clean_base = clean
    experiments = [
        replace(
            e, measured={**e.measured, "force": e.measured["force"]._replace(value=gain * e.measured["force"].value)}
        )
        for e in search.data.experiments
    ]
    data = search.data.with_experiments(experiments)
    return replace(search, data=data, history=[]), fit_hypothesis(data, clean_base.hypothesis, clean_base.x)


def test_wrong_gain_is_not_refused(clean: tuple[ForwardSelection, Fit]) -> None:
    """The gain of an instrument is a linear function of its reading, too."""
    disturbed, base = multiply_force(clean, 1.08)
    gain = add_terms(disturbed, base, EffectTerm("sensor_gain", "linear", "force"))
    assert judge(disturbed, base, gain).better is None


def test_gain_of_a_load_cell_refuses_other_names(clean: tuple[ForwardSelection, Fit]) -> None:
    disturbed, base = multiply_force(clean, 1.2)
    better = judge(disturbed, base, add_terms(disturbed, base, DAMPING)).better
    assert better is not None
    gain, unit = better.description.removeprefix("in the reading of 'force' (+").split(" ", 1)
    assert float(gain) == pytest.approx(0.2, rel=0.1)  # the numbers of the device take a part
    assert unit == "N per N of 'force')"


def test_gain_that_no_load_cell_has_refuses_no_name(clean: tuple[ForwardSelection, Fit]) -> None:
    disturbed, base = multiply_force(clean, 1.6)
    better = judge(disturbed, base, add_terms(disturbed, base, DAMPING), ("unknown_force",)).better
    assert better is None or "per N of 'force'" not in better.description
