"""Calibration, localization and p-values of the benchmark against known answers."""

import math

import numpy as np
import pytest
from benchmarks.hidden_effects import calibrate, localization, p_values
from benchmarks.hidden_effects.inputs import InputProgram

from klute_sim.diagnosis.noise.p_value import convert_to_p_value
from klute_sim.diagnosis.noise.repeat_products import RepeatProducts
from klute_sim.diagnosis.probability import compute_logistic


def test_calibration_recovers_the_probabilities_of_its_events() -> None:
    """Events that are true with the probability of a known logistic law give its coefficients back."""
    rng, coefficients = np.random.default_rng(0), (1.5, -0.8)
    features = np.column_stack([np.ones(4000), rng.normal(size=4000)])
    is_true = rng.random(4000) < 1.0 / (1.0 + np.exp(-features @ coefficients))
    events = [calibrate.Event(list(row), bool(flag)) for row, flag in zip(features, is_true, strict=True)]
    assert calibrate.fit_logistic(events) == pytest.approx(coefficients, abs=0.15)
    *_, last = calibrate.tabulate_reliability(coefficients, events)
    brier = np.mean([(compute_logistic(coefficients, e.features) - e.is_true) ** 2 for e in events])
    assert last == f"Brier score {brier:.4f} of 4000 events, {is_true.sum()} true."


def test_names_are_events_that_are_true_if_they_are_hidden() -> None:
    truth = {"effects": [{"name": "seal_friction"}], "instruments": [], "strangers": [], "size": 2.0}
    verdict = {
        "verdict": "identified",
        "p_value": 2e-4,
        "gap": {"force": {"refitted": 5.0, "with_effects": 3.0, "noise_floor": 3.0}},
        "effects": [
            {"name": "seal_friction", "channel": None, "evidence": {"margin": 0.3}},
            {"name": "sensor_gain", "channel": "force", "evidence": {"margin": 0.01}},
            {"name": "unknown_force", "channel": None},
        ],
    }
    events = calibrate.collect_events([(truth, verdict), ({}, {"verdict": "insufficient-data"})])
    assert [event.is_true for event in events["names"]] == [True, False]
    assert [event.is_true for event in events["nothing_missing"]] == [False]


@pytest.mark.parametrize(("tendons", "are_true"), [(("flexor", "extensor"), [True, True]), (("flexor",), [False])])
def test_hidden_effect_of_all_devices_is_named_if_each_has_it(tendons: tuple[str, ...], are_true: list[bool]) -> None:
    """As in the score of a verdict."""
    truth = {"effects": [{"name": "braid_hysteresis"}], "size": 2.0}
    effects = [{"name": "braid_hysteresis", "tendon": tendon, "evidence": {"margin": 0.3}} for tendon in tendons]
    events = calibrate.collect_events([(truth, {"verdict": "identified", "p_value": 0.0, "effects": effects})])
    assert [event.is_true for event in events["names"]] == are_true


@pytest.mark.parametrize(("size", "is_nothing_missing"), [(0.0, True), (0.7, True), (1.0, False)])
def test_what_is_smaller_than_the_noise_does_not_count_as_missing(size: float, is_nothing_missing: bool) -> None:
    truth = {"effects": [{"name": "seal_friction"}], "size": size}
    verdict = {"verdict": "nothing-missing", "p_value": 0.4, "effects": []}
    (event,) = calibrate.collect_events([(truth, verdict)])["nothing_missing"]
    assert event.is_true == is_nothing_missing
    (with_law_error,) = calibrate.collect_events([(truth | {"law_error": {"fraction": 0.02}}, verdict)])[
        "nothing_missing"
    ]
    assert not with_law_error.is_true


def test_one_cell_of_each_kind() -> None:
    """F1 of one true positive, one false positive and one false negative is 1/2; cells beyond the map do not count."""
    true_map = {("force", "a"): 1.0, ("force", "b"): 0.0, ("force", "c"): 2.0, ("force", "d"): 0.1}
    sizes = {"a": (1.0, 9.0), "b": (0.5, 5.0), "c": (0.6, 3.0), "d": (0.1, 0.5), "e": (9.0, 99.0)}
    cells = [
        {"channel": "force", "region": region, "misfit_over_noise": size, "significance": significance}
        for region, (size, significance) in sizes.items()
    ]
    counts = localization.count_cells(true_map, {"misfit_map": cells})
    assert counts == (1, 1, 1, 1)
    assert localization.score_cells([counts]) == {"cells": 4.0, "f1": 0.5, "precision": 0.5, "recall": 0.5}
    assert math.isnan(localization.score_cells([(0, 0, 0, 5)])["f1"])


def test_interval_of_f1_covers_it_and_ends_at_it_where_all_datasets_are_alike() -> None:
    counts = [(3, 1, 0, 2), (1, 0, 2, 3), (2, 0, 0, 4), (0, 1, 1, 4)]
    low, high = localization.bootstrap_f1(counts)
    assert 0.0 <= low < localization.score_cells(counts)["f1"] < high <= 1.0
    assert localization.bootstrap_f1(counts[:1] * 5) == pytest.approx([6.0 / 7.0] * 2)


def test_conditions_of_a_program_are_those_of_its_inputs() -> None:
    time = np.arange(4000) * 1e-3
    length = 0.3 + 0.02 * np.clip(time - 2.0, 0.0, 1.0)
    command = np.where(np.arange(800) * 5e-3 > 1.0, 2e5, 1e5)
    labels = localization.label_program(InputProgram("p", "fit", 4.0, length, command), 0.02)
    assert labels[50] == "held, steady pressure"
    assert labels[100] == "held, pressure changes"
    assert labels[250] == "lengthening, steady pressure"


def test_uniform_p_values_pass_and_small_ones_fail() -> None:
    rng = np.random.default_rng(3)
    uniform = p_values.summarize_p_values(rng.random(400))
    assert uniform["ks_p_value"] > 0.05
    assert uniform["low"] < 0.05 < uniform["high"]
    small = p_values.summarize_p_values(rng.random(400) ** 2)
    assert small["ks_p_value"] < 1e-6
    assert small["low"] > 0.05


def test_null_distribution_is_recovered_and_makes_p_values_uniform() -> None:
    """Sums of 400 datasets whose irrelevant misfit is drawn from a known distribution."""
    rng, mean_squares, spread = np.random.default_rng(4), np.array([0.04, 0.1]), 0.02
    misfits = []
    for _ in range(400):
        n_samples = rng.uniform(300.0, 500.0, (25, 2)) * np.array([1.0, rng.integers(2)])
        irrelevant = n_samples @ mean_squares + spread * rng.normal() * n_samples.sum(axis=1)
        misfits.append(RepeatProducts(irrelevant + rng.normal(0.0, 30.0, 25), n_samples))
    fitted, fitted_spread = p_values.fit_null_distribution(misfits)
    assert fitted == pytest.approx(tuple(mean_squares), rel=0.1)
    assert fitted_spread == pytest.approx(spread, rel=0.2)
    summary = p_values.summarize_p_values([convert_to_p_value(m, fitted, fitted_spread) for m in misfits])
    assert summary["ks_p_value"] > 0.05
