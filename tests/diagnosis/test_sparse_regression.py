"""The data-driven term: what it finds, what it leaves alone, and how it comes back as a device."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from benchmarks.hidden_effects.generate import make_dataset

from klute_sim.api.diagnosis import DiagnosisResult
from klute_sim.datasets import dataset as datasets
from klute_sim.device.device import load_device, parse_device
from klute_sim.diagnosis.discrepancy import sparse_regression
from klute_sim.diagnosis.discrepancy.sparse_regression import (
    add_data_driven_term,
    find_supports,
    format_formula,
    list_data_driven_terms,
)
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.fit_cache import FitCache
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.localization.equation_residuals import EquationResidual, compute_equation_residuals
from klute_sim.diagnosis.noise import repeats as noises
from klute_sim.diagnosis.result import Diagnosis, DiagnosisOptions
from klute_sim.diagnosis.selection.candidates import check_effect_names, list_candidate_terms
from klute_sim.diagnosis.selection.forward_selection import DIVERGENCE_REASON, ForwardSelection
from klute_sim.diagnosis.verdict import verdict_to_dict
from klute_sim.diagnosis.workflow import diagnose, fit_base_device
from klute_sim.effects import catalogue
from klute_sim.effects.families import discrepancy_formulas, discrepancy_terms
from klute_sim.errors import InputError
from klute_sim.report.diagnosis import page
from klute_sim.report.diagnosis import text as words
from tests.diagnosis.synthetic_dataset import write_dataset

pytestmark = pytest.mark.slow

FORCE = ("unknown_force", "sparse")
HIDDEN = {FORCE: {"begin_n": -120.0, "pressure_friction_n": 60.0}}
"""No effect of the catalogue does both."""
RESIDUALS = [EquationResidual("muscle, damper or tendon", 30.0, 1000.0, 3.0)]


def create_search(
    folder: Path, hidden: dict[tuple[str, str], dict[str, float]]
) -> Iterator[tuple[ForwardSelection, Fit]]:
    """Yield a selection without candidates, and its base fit."""
    data = datasets.load_dataset(write_dataset(folder, hidden, groups=("fit_1", "fit_2", "validation_1"), seconds=2.0))
    # The tests share the cache of fits.
    experiments = prepare_experiments(data, datasets.split_dataset(data))
    simulator, cache = Simulator(2), FitCache(str(folder))
    base, weighted = fit_base_device(data, [e for e in experiments if e.use == "fit"], simulator, cache)
    held_out = [e for e in experiments if e.use == "validation"]
    validation = [
        weighted.with_experiments([e for e in held_out if e.group == group]) for group in noises.group_repeats(held_out)
    ]
    yield ForwardSelection(weighted, validation, []), base
    simulator.close()
    cache.clear()


@pytest.fixture(scope="module")
def with_hidden_term(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[ForwardSelection, Fit]]:
    yield from create_search(tmp_path_factory.mktemp("lacking") / "d", HIDDEN)


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[ForwardSelection, Fit]]:
    yield from create_search(tmp_path_factory.mktemp("clean") / "d", {})


def get_effect_values(fit: Fit) -> dict[str, float]:
    """Return the fitted parameters of the added effects."""
    rows = zip(fit.hypothesis.parameters, fit.values, strict=True)
    return {p.name: value for p, value in rows if p.term_index is not None}


def test_true_functions_and_coefficients_are_recovered(with_hidden_term: tuple[ForwardSelection, Fit]) -> None:
    search, base = with_hidden_term
    result = add_data_driven_term(search, base, base, compute_equation_residuals(search.data, base))
    assert result.fit is not None, result.reason
    assert get_effect_values(result.fit) == pytest.approx(HIDDEN[FORCE], rel=0.05)
    assert "A data-driven term in the equation of muscle and damper represents" in result.reason
    assert not search.has_misfit(result.fit)
    assert search.has_misfit(base)


@pytest.mark.long
@pytest.mark.parametrize(
    ("hidden", "expected"),
    [
        ({("pressure_lag", "first_order"): {"time_constant_s": 0.05}}, {"lag_s": 0.05}),
        ({("pressure_delay", "dead_time"): {"delay_s": 0.012}}, {"delay_s": 0.012}),
    ],
    ids=["lag", "dead time"],
)
def test_lag_and_dead_time_are_found_in_the_supply_equation(
    tmp_path: Path, hidden: dict[tuple[str, str], dict[str, float]], expected: dict[str, float]
) -> None:
    for search, base in create_search(tmp_path / "d", hidden):
        result = add_data_driven_term(search, base, base, compute_equation_residuals(search.data, base))
        assert "in the equation of supply" in result.reason
        assert result.fit is not None
        assert get_effect_values(result.fit) == pytest.approx(expected, rel=0.03)


def test_muscle_and_tendon_both_have_a_term_where_the_data_do_not_separate_them(
    clean: tuple[ForwardSelection, Fit],
) -> None:
    _, base = clean
    terms = list_data_driven_terms(base, RESIDUALS)
    assert {equation: term.effect for equation, term in terms.items()} == {
        "muscle and damper": "unknown_force",
        "tendon": "unknown_tendon_force",
    }
    assert list(list_data_driven_terms(base, RESIDUALS, ["unknown_force"])) == ["tendon"]


def test_regression_eliminates_functions(with_hidden_term: tuple[ForwardSelection, Fit]) -> None:
    search, base = with_hidden_term
    supports = find_supports(search.data, base, EffectTerm(*FORCE))
    assert [len(support.term.parameter_keys) for support in supports] == [1, 2, 3, 4]
    for fewer, more in pairwise(supports):
        assert set(fewer.term.parameter_keys) < set(more.term.parameter_keys)
    assert set(supports[1].term.parameter_keys) == set(HIDDEN[FORCE])
    assert max(supports, key=lambda support: support.predicted_bic_gain) is supports[1]
    # The tendon's library has only three functions.
    assert (
        len(find_supports(search.data, base, EffectTerm("unknown_tendon_force", "sparse"))[-1].term.parameter_keys) <= 3
    )


def test_term_with_which_every_simulation_diverges_is_not_added(
    with_hidden_term: tuple[ForwardSelection, Fit], monkeypatch: pytest.MonkeyPatch
) -> None:
    search, base = with_hidden_term
    supports = find_supports(search.data, base, EffectTerm(*FORCE))
    diverged = replace(base, weighted_residuals=np.full_like(base.weighted_residuals, np.inf))
    with monkeypatch.context() as context:
        context.setattr(sparse_regression, "fit_hypothesis", lambda *_, **__: diverged)
        assert sparse_regression._fit_supports(search, base, supports) is None
    monkeypatch.setattr(sparse_regression, "_fit_supports", lambda *_: None)
    result = add_data_driven_term(search, base, base, RESIDUALS)
    assert result.fit is None
    assert result.reason.endswith(f"was tested, but {DIVERGENCE_REASON}.")


def test_clean_data_get_no_term(clean: tuple[ForwardSelection, Fit]) -> None:
    search, base = clean
    result = add_data_driven_term(search, base, base, compute_equation_residuals(search.data, base))
    assert result.fit is None
    assert "no equation has a significant residual" in result.reason
    assert add_data_driven_term(search, base, base, RESIDUALS).fit is None  # nor for a given residual


def test_term_that_worsens_validation_trials_is_rejected(
    with_hidden_term: tuple[ForwardSelection, Fit], clean: tuple[ForwardSelection, Fit]
) -> None:
    search, base = with_hidden_term
    elsewhere = replace(search, validation_data=clean[0].validation_data, history=[])
    result = add_data_driven_term(elsewhere, base, base, RESIDUALS)
    assert result.fit is None
    assert "tested and rejected: unknown_force fits, but validation trials get worse" in result.reason


def test_excluded_and_existing_terms_are_not_candidates(with_hidden_term: tuple[ForwardSelection, Fit]) -> None:
    search, base = with_hidden_term
    result = add_data_driven_term(search, base, base, RESIDUALS, ("unknown_force", "unknown_tendon_force"))
    assert "no equation has a significant residual" in result.reason


def test_data_driven_term_is_not_a_candidate_effect(with_hidden_term: tuple[ForwardSelection, Fit]) -> None:
    device, data = load_device("klute-3-4-pair"), with_hidden_term[0].data
    dataset = SimpleNamespace(rig="bench", device=device, uncertainties={}, model_values={}, mechanism=None, trials=[])
    assert not {term.effect for term in list_candidate_terms(data, dataset, exclude=("number_error",))} - set(
        catalogue.get_named_effects()
    )
    with pytest.raises(InputError, match="'unknown_force' is not a candidate effect: it is data-driven"):
        check_effect_names(dataset, ("unknown_force",), ())
    check_effect_names(dataset, (), ("unknown_force",))


def test_formula_uses_units() -> None:
    values = {"pressure_n": -12.34, "pressure_friction_n": 60.0, "speed_squared_n": 0.0}
    assert discrepancy_formulas.format_equation(discrepancy_terms.UNKNOWN_FORCE, values) == (
        "F += - 12.3 N p + 60 N p d; p = P/(5 bar); d = v/sqrt(v^2 + (0.05 mm/s)^2)"
    )
    values = {"offset_bar": -0.1, "command_bar": 0.2, "dead_band_bar": 0.05, "lag_s": 0.02, "falling_lag_s": -0.01}
    values["delay_s"] = 0.004
    assert discrepancy_formulas.format_equation(discrepancy_terms.UNKNOWN_PRESSURE, values) == (
        "target = command - 0.1 bar + 0.2 bar c; dead band = 0.05 bar; dP/dt = (target - P)/tau, "
        "tau = 0.02 s - 0.01 s f; dead time = 0.004 s; c = command/(5 bar); f = 1 while P falls"
    )


def test_device_file_may_omit_neutral_parameters() -> None:
    text = load_device("klute-3-4-pair").content.decode() + "\n[effects.unknown_force]\npressure_friction_n = 60.0\n"
    device = parse_device(text.encode(), "test")
    slot = catalogue.find_slot(*FORCE)
    values = device.parameters.effects[slot.switch_index : slot.switch_index + 1 + len(slot.form.parameters)]
    assert [k for k, value in enumerate(values) if value] == [0, 10]
    with pytest.raises(InputError, match=r"pressure_friction_n = -1.0 is refused; allowed: 0 to 1000"):
        parse_device(text.replace("friction_n = 60.0", "friction_n = -1.0").encode(), "test")


def test_library_functions_match_the_formula() -> None:
    """Compare all functions with values computed by hand at 2.5 bar, 7/8 of the resting length and 100 mm/s."""
    muscle = load_device("klute-3-4-pair").parameters.muscle
    arguments = ((), 7.0, muscle, 2.5e5, 0.875 * muscle.resting_length, 0.1)
    p, b, e, d, s = 0.5, 2.5 / 3.0, 0.5, 1.0, np.sqrt(0.5)
    expected = [p, p * p, b, b * e, e, e * e, p * e, p * e * e, d, p * d, e * d, s, p * s, s * s]
    force, tendon_force, pressure = (
        effect.forms[0].parameter_type
        for effect in (
            discrepancy_terms.UNKNOWN_FORCE,
            discrepancy_terms.UNKNOWN_TENDON_FORCE,
            discrepancy_terms.UNKNOWN_PRESSURE,
        )
    )
    for row, value in zip(np.eye(len(expected)), expected, strict=True):
        assert discrepancy_terms.sparse_force(force(*row), *arguments) - 7.0 == pytest.approx(value, rel=1e-3)
    tendon = load_device("klute-3-4-pair").parameters.tendon
    for row, value in zip(np.eye(3), [0.2, 0.04, 2.0 / 3.0], strict=True):
        tension = discrepancy_terms.sparse_tendon_force(tendon_force(*row), (), 7.0, 2e-3, tendon)
        assert tension - 7.0 == pytest.approx(value)
        assert discrepancy_terms.sparse_tendon_force(tendon_force(*row), (), 0.0, -2e-3, tendon) == 0.0
    for values, measured, dt, expected_pressure in (
        ({"offset": 0.1e5}, 1e5, 1e-3, 3.1e5),
        ({"dead_band": 0.1e5}, 2.95e5, 1e-3, 2.95e5),
        ({"dead_band": 0.1e5}, 1e5, 1e-3, 2.9e5),
        ({"lag": 0.01}, 1e5, 0.01, 2e5),
        ({"falling_lag": 0.01}, 1e5, 0.01, 3e5),
        ({"delay": 0.01}, 1e5, 0.01, 3e5),  # the caller delays the command
    ):
        coefficients = pressure(**{name: values.get(name, 0.0) for name in pressure._fields})
        assert discrepancy_terms.sparse_pressure(coefficients, (), 3e5, measured, dt) == pytest.approx(
            expected_pressure
        )


@pytest.fixture(scope="module")
def unexplained(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    """Return a diagnosis of hidden dry friction without friction among the candidates."""
    folder = write_dataset(
        tmp_path_factory.mktemp("unexplained") / "d",
        {("braid_hysteresis", "coulomb"): {"slope_n_per_bar": 6.0}},
        seed=5,
    )
    return diagnose(datasets.load_dataset(folder), DiagnosisOptions(only=("end_taper", "threshold_pressure")))


def test_data_driven_term_closes_the_gap_of_an_unexplained_verdict(unexplained: Diagnosis) -> None:
    verdict = verdict_to_dict(unexplained)
    assert verdict["verdict"] == "unexplained"
    *proxies, term = verdict["effects"]
    assert all(proxy["proxy"] and "data_driven" not in proxy for proxy in proxies)
    assert term["name"] == "unknown_force"
    assert term["data_driven"]
    assert "proxy" not in term
    # Two muscles with 6 N/bar each, at 5 bar.
    friction = term["parameters"]["pressure_friction_n"]
    assert friction["value"] == pytest.approx(60.0, rel=0.05)
    assert friction["low"] < friction["value"] < friction["high"]
    assert f"{friction['value']:.3g} N p d" in term["formula"]
    gap = verdict["gap"]["force"]
    assert unexplained.evaluated_on == "test"
    remainder = (gap["with_effects"] ** 2 - gap["noise_floor"] ** 2) / (gap["refitted"] ** 2 - gap["noise_floor"] ** 2)
    assert remainder < 0.05
    assert verdict["alternatives"] == []
    assert verdict["device_file"] == "device.toml"


def test_device_file_contains_the_term(unexplained: Diagnosis, tmp_path: Path) -> None:
    DiagnosisResult(unexplained).write_files(tmp_path, report=False)
    device = load_device(str(tmp_path / "device.toml"))
    assert unexplained.final_fit is not None
    assert device.spec.effects["unknown_force"].keys() == {"form", *unexplained.added_terms[-1].parameter_keys}
    data = datasets.load_dataset(unexplained.dataset.folder, device)
    simulator, fit_experiments = Simulator(2), unexplained.experiments
    file_experiments = prepare_experiments(data, datasets.split_dataset(data))
    setups = unexplained.final_fit.hypothesis.build_setups(unexplained.final_fit.x, fit_experiments)
    (fitted,) = simulator.simulate([setups], fit_experiments)
    setups = Hypothesis(device, (), ()).build_setups(np.zeros(0), file_experiments)
    (written,) = simulator.simulate([setups], file_experiments)
    simulator.close()
    for a, b in zip(fitted, written, strict=True):
        for channel in a:
            assert np.abs(a[channel] - b[channel]).max() < 1e-9 * np.abs(a[channel]).max()


def test_page_and_terminal_mark_the_data_driven_term(unexplained: Diagnosis) -> None:
    assert unexplained.final_fit is not None
    sentence, formula = words.describe_verdict(unexplained), format_formula(unexplained.final_fit)
    assert "a data-driven term, which identifies no effect, represents it" in sentence
    html = page.render_page(unexplained, {})
    assert formula in html
    assert "unknown force (data-driven)" in html
    assert "unknown force (a proxy)" not in html
    printed = " ".join(str(DiagnosisResult(unexplained)).split())
    assert sentence in printed
    assert f"Data-driven term: {formula}" in printed
    assert any(reason.startswith("A data-driven term in the equation of") for reason in unexplained.reasons)


@pytest.mark.long
def test_unknown_friction_is_explained_by_a_data_driven_term(tmp_path: Path) -> None:
    """Without the true effect in the catalogue, a data-driven term closes the gap on test trials."""
    parameters = {"slope_n_per_bar": 6.0}
    truth: list[dict[str, Any]] = [{"name": "braid_hysteresis", "form": "coulomb", "parameters": parameters}]
    make_dataset(tmp_path / "d", 11, muscle_length=False, effects=truth)
    diagnosis = diagnose(datasets.load_dataset(tmp_path / "d"), DiagnosisOptions(exclude=("braid_hysteresis",)))
    assert diagnosis.verdict == "unexplained", diagnosis.reasons
    (term,) = diagnosis.added_terms
    assert term.effect_definition.data_driven
    # Two muscles with 6 N/bar each, at 5 bar.
    assert diagnosis.final_fit is not None
    assert get_effect_values(diagnosis.final_fit) == {"pressure_friction_n": pytest.approx(60.0, rel=0.05)}
    gap = diagnosis.channel_rms["force"]
    assert gap.noise_floor is not None
    assert 1.0 - (gap.with_effects**2 - gap.noise_floor**2) / (gap.refitted**2 - gap.noise_floor**2) > 0.98


def test_term_has_the_parameters_of_its_functions() -> None:
    term = EffectTerm(*FORCE, None, ("pressure_n", "speed_n"))
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), (), (), (term,))
    assert [u.name for u in hypothesis.parameters] == ["pressure_n", "speed_n"]
