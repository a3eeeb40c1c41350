"""The data-driven term: what it finds, what it leaves alone, and how it comes back as a device."""

import sys
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.hidden_effects.generate import make_dataset

from klute_sim.cli.diagnose import _print
from klute_sim.cli.diagnose import write_results as write_results
from klute_sim.datasets import dataset as datasets
from klute_sim.device.device import load_device, parse_device
from klute_sim.diagnosis.experiments.base import Simulator
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.fitting.fit_cache import FitCache
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.noise import repeats as noises
from klute_sim.diagnosis.selection.equation_residuals import EquationResidual, compute_equation_residuals
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.screening import check_effect_names, list_candidate_terms
from klute_sim.diagnosis.selection.sparse_regression import find_supports, fit_discrepancy_term, format_formula
from klute_sim.diagnosis.verdict import verdict_to_dict
from klute_sim.diagnosis.workflow import Diagnosis, DiagnosisOptions, diagnose, fit_base_device
from klute_sim.effects import catalogue
from klute_sim.effects.families import discrepancy_terms
from klute_sim.errors import InputError
from klute_sim.report.diagnosis import page
from klute_sim.report.diagnosis import text as words
from tests.diagnosis.synthetic_dataset import dataset as made

FORCE = ("unknown_force", "sparse")
HIDDEN = {FORCE: {"begin_n": -120.0, "pressure_friction_n": 60.0}}
"""No effect of the catalogue does both."""
LACKING = [EquationResidual("muscle, damper or tendon", 30.0, 1000.0, 3.0)]


def searched(folder: Path, hidden: dict[tuple[str, str], dict[str, float]]) -> Iterator[tuple[ForwardSelection, Fit]]:
    """A search that knows no effect, and the fit it begins with."""
    data = datasets.load_dataset(made(folder, hidden, groups=("fit_1", "fit_2", "select_1"), seconds=2.0))
    # What one test has fitted, the next need not.
    every, bench, store = prepare_experiments(data, datasets.split_dataset(data)), Simulator(2), FitCache(str(folder))
    base, evidence = fit_base_device(data, [e for e in every if e.use == "fit"], bench, store)
    kept = [e for e in every if e.use == "select"]
    selection = [
        evidence.with_experiments([e for e in kept if e.group == group]) for group in noises.group_repeats(kept)
    ]
    yield ForwardSelection(evidence, selection, []), base
    bench.close()
    store.clear()


@pytest.fixture(scope="module")
def lacking(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[ForwardSelection, Fit]]:
    yield from searched(tmp_path_factory.mktemp("lacking") / "d", HIDDEN)


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[ForwardSelection, Fit]]:
    yield from searched(tmp_path_factory.mktemp("clean") / "d", {})


def own(found: Fit) -> dict[str, float]:
    """The fitted numbers of what was added."""
    rows = zip(found.hypothesis.parameters, found.values, strict=True)
    return {u.key: value for u, value in rows if u.term_index is not None}


def test_functions_and_coefficients_that_are_there_are_found(lacking: tuple[ForwardSelection, Fit]) -> None:
    pytest.importorskip("pysindy")
    search, base = lacking
    found = fit_discrepancy_term(search, base, base, compute_equation_residuals(search.data, base))
    assert found.fit is not None, found.reason
    assert own(found.fit) == pytest.approx(HIDDEN[FORCE], rel=0.05)
    assert "A data-driven term at the equation of muscle, damper or tendon stands in" in found.reason
    assert not search.has_misfit(found.fit)
    assert search.has_misfit(base)


@pytest.mark.long
def test_a_supply_that_lags_is_found_in_its_own_equation(tmp_path: Path) -> None:
    pytest.importorskip("pysindy")
    for search, base in searched(tmp_path / "d", {("pressure_lag", "first_order"): {"time_constant_s": 0.05}}):
        found = fit_discrepancy_term(search, base, base, compute_equation_residuals(search.data, base))
        assert "at the equation of supply" in found.reason
        assert found.fit is not None
        assert own(found.fit) == pytest.approx({"lag_s": 0.05}, rel=0.03)


def test_regression_goes_from_many_functions_to_few(lacking: tuple[ForwardSelection, Fit]) -> None:
    pytest.importorskip("pysindy")
    search, base = lacking
    found = find_supports(search.data, base, discrepancy_terms.UNKNOWN_FORCE)
    assert [len(each.term.parameter_keys) for each in found] == [1, 2, 3, 4]
    for fewer, more in pairwise(found):
        assert set(fewer.term.parameter_keys) < set(more.term.parameter_keys)
    assert set(found[1].term.parameter_keys) == set(HIDDEN[FORCE])
    assert max(found, key=lambda each: each.predicted_bic_gain) is found[1]
    # Three functions are few enough to be all there.
    assert len(find_supports(search.data, base, discrepancy_terms.UNKNOWN_TENDON_FORCE)[-1].term.parameter_keys) <= 3


def test_clean_data_get_no_term(clean: tuple[ForwardSelection, Fit]) -> None:
    pytest.importorskip("pysindy")
    search, base = clean
    nothing = fit_discrepancy_term(search, base, base, compute_equation_residuals(search.data, base))
    assert nothing.fit is None
    assert "it is not known which equation lacks something" in nothing.reason
    assert fit_discrepancy_term(search, base, base, LACKING).fit is None  # nor if an equation were suspected


def test_what_other_trials_lose_from_is_not_kept(
    lacking: tuple[ForwardSelection, Fit], clean: tuple[ForwardSelection, Fit]
) -> None:
    pytest.importorskip("pysindy")
    search, base = lacking
    elsewhere = replace(search, validation_data=clean[0].validation_data, history=[])
    found = fit_discrepancy_term(elsewhere, base, base, LACKING)
    assert found.fit is None
    assert "tried and not kept: unknown_force fits, but trials that were not fitted get worse" in found.reason


def test_without_the_extra_that_is_said(lacking: tuple[ForwardSelection, Fit], monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("pysindy", "pysindy.optimizers"):
        monkeypatch.setitem(sys.modules, module, None)
    found = fit_discrepancy_term(*lacking, lacking[1], LACKING)
    assert found.fit is None
    assert found.reason.startswith(
        "No data-driven term was looked for: a data-driven term needs the optional extra 'spar"
    )
    assert found.reason.count(". ") == 0


def test_what_is_excluded_or_there_already_is_not_looked_for(lacking: tuple[ForwardSelection, Fit]) -> None:
    assert "not known which equation" in fit_discrepancy_term(*lacking, lacking[1], LACKING, ("unknown_force",)).reason


def test_no_diagnosis_takes_it_for_a_name(lacking: tuple[ForwardSelection, Fit]) -> None:
    device = load_device("klute-3-4-pair")
    assert not {term.effect for term in list_candidate_terms(lacking[0].data, device)} - set(
        catalogue.get_named_effects()
    )
    with pytest.raises(InputError, match="'unknown_force' is no effect to look for: it is data-driven"):
        check_effect_names(device, ("unknown_force",), ())
    check_effect_names(device, (), ("unknown_force",))


def test_a_formula_reads_in_units() -> None:
    values = {"pressure_n": -12.34, "pressure_friction_n": 60.0, "speed_squared_n": 0.0}
    assert discrepancy_terms.format_equation(discrepancy_terms.UNKNOWN_FORCE, values) == (
        "F += - 12.3 N p + 60 N p d; p = P/(5 bar); d = v/sqrt(v^2 + (1 mm/s)^2)"
    )
    values = {"offset_bar": -0.1, "command_bar": 0.2, "dead_band_bar": 0.05, "lag_s": 0.02, "falling_lag_s": -0.01}
    assert discrepancy_terms.format_equation(discrepancy_terms.UNKNOWN_PRESSURE, values) == (
        "target = command - 0.1 bar + 0.2 bar c; dead band = 0.05 bar; dP/dt = (target - P)/tau, "
        "tau = 0.02 s - 0.01 s f; c = command/(5 bar); f = 1 while P falls"
    )


def test_a_device_file_may_leave_out_what_is_neutral() -> None:
    text = load_device("klute-3-4-pair").content.decode() + "\n[effects.unknown_force]\npressure_friction_n = 60.0\n"
    device = parse_device(text.encode(), "test")
    place = catalogue.find_slot(*FORCE)
    given = device.parameters.effects[place.switch_index : place.switch_index + 1 + len(place.form.parameters)]
    assert [k for k, value in enumerate(given) if value] == [0, 10]
    with pytest.raises(InputError, match=r"pressure_friction_n = -1.0 is refused; allowed: 0 to 1000"):
        parse_device(text.replace("friction_n = 60.0", "friction_n = -1.0").encode(), "test")


def test_the_functions_are_what_the_formula_says() -> None:
    """At 2.5 bar, an eighth shorter, 100 mm/s: every function by hand."""
    muscle = load_device("klute-3-4-pair").parameters.muscle
    arguments = ((), 7.0, muscle, 2.5e5, 0.875 * muscle.resting_length, 0.1)
    p, b, e, d, s = 0.5, 2.5 / 3.0, 0.5, 1.0, np.sqrt(0.5)
    wanted = [p, p * p, b, b * e, e, e * e, p * e, p * e * e, d, p * d, e * d, s, p * s, s * s]
    for row, value in zip(np.eye(len(wanted)), wanted, strict=True):
        assert discrepancy_terms.sparse_force(row, *arguments) - 7.0 == pytest.approx(value, rel=1e-3)
    for row, value in zip(np.eye(3), [0.2, 0.04, 2.0 / 3.0], strict=True):
        assert discrepancy_terms.sparse_tendon_force(row, (), 7.0, 2e-3) - 7.0 == pytest.approx(value)
        assert discrepancy_terms.sparse_tendon_force(row, (), 0.0, -2e-3) == 0.0
    rest = [0.0] * 6
    assert discrepancy_terms.sparse_pressure([0.1e5, *rest], (), 3e5, 1e5, 1e-3) == pytest.approx(3.1e5)
    assert discrepancy_terms.sparse_pressure(
        [0.0, 0.0, 0.0, 0.1e5, 0.0, 0.0, 0.0], (), 3e5, 2.95e5, 1e-3
    ) == pytest.approx(2.95e5)
    assert discrepancy_terms.sparse_pressure(
        [0.0, 0.0, 0.0, 0.1e5, 0.0, 0.0, 0.0], (), 3e5, 1e5, 1e-3
    ) == pytest.approx(2.9e5)
    assert discrepancy_terms.sparse_pressure([*[0.0] * 4, 0.01, 0.0, 0.0], (), 3e5, 1e5, 0.01) == pytest.approx(2e5)
    assert discrepancy_terms.sparse_pressure([*[0.0] * 4, 0.0, 0.0, 0.01], (), 3e5, 1e5, 0.01) == 3e5


@pytest.fixture(scope="module")
def unnamed(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    """A diagnosis of hidden dry friction by someone who knows of no friction."""
    pytest.importorskip("pysindy")
    folder = made(
        tmp_path_factory.mktemp("unnamed") / "d", {("braid_hysteresis", "coulomb"): {"slope_n_per_bar": 6.0}}, seed=5
    )
    return diagnose(datasets.load_dataset(folder), DiagnosisOptions(only=("end_taper", "threshold_pressure")))


def test_the_verdict_stays_unexplained_and_the_gap_closes(unnamed: Diagnosis) -> None:
    verdict = verdict_to_dict(unnamed)
    assert verdict["verdict"] == "unexplained"
    *proxies, term = verdict["effects"]
    assert all(each["proxy"] and "data_driven" not in each for each in proxies)
    assert term["name"] == "unknown_force"
    assert term["data_driven"]
    assert "proxy" not in term
    # Two muscles with 6 N/bar each, at 5 bar.
    friction = term["parameters"]["pressure_friction_n"]
    assert friction["value"] == pytest.approx(60.0, rel=0.05)
    assert friction["low"] < friction["value"] < friction["high"]
    assert f"{friction['value']:.3g} N p d" in term["formula"]
    gap = verdict["gap"]["force"]
    assert unnamed.evaluated_on == "show"
    left = (gap["after"] ** 2 - gap["floor"] ** 2) / (gap["before"] ** 2 - gap["floor"] ** 2)
    assert left < 0.05
    assert verdict["alternatives"] == []
    assert verdict["device_file"] == "device.toml"


def test_the_device_file_is_the_fit_with_the_term_in_it(unnamed: Diagnosis, tmp_path: Path) -> None:
    write_results(unnamed, tmp_path, report=False)
    device = load_device(str(tmp_path / "device.toml"))
    assert unnamed.final_fit is not None
    assert device.spec.effects["unknown_force"].keys() == {"form", *unnamed.added_terms[-1].parameter_keys}
    data = datasets.load_dataset(unnamed.dataset.folder, device)
    bench, ours, theirs = Simulator(2), unnamed.experiments, prepare_experiments(data, datasets.split_dataset(data))
    (fitted,) = bench.simulate([unnamed.final_fit.hypothesis.build_setups(unnamed.final_fit.x, ours)], ours)
    (written,) = bench.simulate([Hypothesis(device, (), ()).build_setups(np.zeros(0), theirs)], theirs)
    bench.close()
    for a, b in zip(fitted, written, strict=True):
        for channel in a:
            assert np.abs(a[channel] - b[channel]).max() < 1e-9 * np.abs(a[channel]).max()


def test_page_and_terminal_say_that_it_is_no_name(unnamed: Diagnosis, capsys: pytest.CaptureFixture[str]) -> None:
    assert unnamed.final_fit is not None
    said, line = words.describe_verdict(unnamed), format_formula(unnamed.final_fit)
    assert "a data-driven term, which names nothing, stands in for it" in said
    html = page.render_page(unnamed, {})
    assert line in html
    assert "unknown force (data-driven)" in html
    assert "unknown force (a proxy)" not in html
    _print(unnamed, Path("here"))
    printed = " ".join(capsys.readouterr().out.split())
    assert said in printed
    assert f"Data-driven term: {line}" in printed
    assert any(reason.startswith("A data-driven term at the equation of") for reason in unnamed.reasons)


STRUCK: dict[str, tuple[int, str, dict[str, float], float]] = {
    "braid_hysteresis": (11, "coulomb", {"slope_n_per_bar": 6.0}, 0.98),
    "threshold_pressure": (16, "constant", {"pressure_bar": 0.6}, 0.95),
}
"""Effect -> seed, form, parameters, and the share of the gap that has to go at least (measured: 1.00 and 0.99)."""


@pytest.mark.long
@pytest.mark.parametrize("name", STRUCK)
def test_most_of_what_has_no_name_goes(name: str, tmp_path: Path) -> None:
    """Data of laws that are not ours, the truth struck from the catalogue: most of the gap on show trials goes."""
    pytest.importorskip("pysindy")
    seed, form, parameters, least = STRUCK[name]
    truth: list[dict[str, Any]] = [{"name": name, "form": form, "parameters": parameters}]
    make_dataset(tmp_path / "d", seed, muscle_length=False, effects=truth)
    found = diagnose(datasets.load_dataset(tmp_path / "d"), DiagnosisOptions(exclude=(name,)))
    assert found.verdict == "unexplained", found.reasons
    assert found.added_terms[-1].effect_definition.data_driven
    gap = found.channel_rms["force"]
    assert gap.noise_floor is not None
    assert 1.0 - (gap.with_effects**2 - gap.noise_floor**2) / (gap.refitted**2 - gap.noise_floor**2) > least


def test_a_term_of_some_functions_has_only_those_unknowns() -> None:
    term = EffectTerm(*FORCE, None, ("pressure_n", "speed_n"))
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), (), (), (term,))
    assert [u.key for u in hypothesis.parameters] == ["pressure_n", "speed_n"]
