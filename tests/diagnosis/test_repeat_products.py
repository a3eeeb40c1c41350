"""Products of different repeats' residuals: their p-values are uniform where only noise is left."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import helmert
from scipy.stats import kstest

from klute_sim.datasets.trial import SensorLimits
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.p_value import IRRELEVANT_MEAN_SQUARES, compute_p_value, convert_to_p_value
from klute_sim.diagnosis.noise.repeat_products import (
    RepeatContrasts,
    RepeatProducts,
    compute_repeat_products,
    sum_products,
)
from klute_sim.diagnosis.noise.repeats import estimate_noise_from_repeats
from tests.diagnosis.synthetic_dataset import make_correlated_noise, make_repeats

SAMPLES, INTERVAL = 1600, 0.005
TIME = np.arange(SAMPLES) * INTERVAL
SHARED_SCALE = 3.0 * np.sqrt(8.0)
"""Amplitude of the shared misfit, a squared sine less its mean, whose root mean square is the stationary noise."""
ONLY_NOISE = (0.0, 0.0), 0.0
"""Mean squares and spread of the irrelevant misfit where there is none."""
UNCERTAINTIES = tuple((f"tendon.stiffness_{k}_n_per_mm", 40.0) for k in (1, 2))


def make_stationary_noise(rng: np.random.Generator) -> np.ndarray:
    return make_correlated_noise(rng, SAMPLES, 3.0, 0.02)


def make_local_noise(rng: np.random.Generator) -> np.ndarray:
    """Return noise that is ten times as large for a quarter of the time."""
    return make_correlated_noise(rng, SAMPLES, 0.3, 0.02) * np.where((TIME > 2.0) & (TIME < 4.0), 10.0, 1.0)


def make_skewed_level_noise(rng: np.random.Generator) -> np.ndarray:
    """Return noise with a level of its own in each trial."""
    return make_correlated_noise(rng, SAMPLES, 1.0, 0.02) * np.exp(rng.normal(0.0, 0.5))


def draw_misfits(
    make_noise: Callable[[np.random.Generator], np.ndarray], n_draws: int, *, misfit: float = 0.0, n_repeats: int = 2
) -> list[RepeatProducts]:
    """Return what linear fits of two numbers to three trials leave, whose repeats share a ``misfit``."""
    device, rng, simulator = load_device("klute-3-4-pair"), np.random.default_rng(7), Simulator(1)
    hypothesis = Hypothesis(device, UNCERTAINTIES, ())
    shapes = np.array([[np.sin((k + 1.3) * TIME + group) for group in range(3)] for k in range(2)])
    shared = misfit * np.array([np.sin(1.7 * TIME + group) ** 2 - 0.5 for group in range(3)])
    misfits = []
    for _ in range(n_draws):
        deviations = rng.normal(size=2)
        rows = [
            shared[group] + make_noise(rng) - np.tensordot(deviations, shapes[:, group], 1)
            for group in range(3)
            for _ in range(n_repeats)
        ]
        experiments = [
            replace(e, name=f"{group}{e.name}")
            for group in range(3)
            for e in make_repeats(rows[group * n_repeats : (group + 1) * n_repeats], str(group))
        ]
        data = WeightedData(
            simulator, experiments, estimate_noise_from_repeats(experiments, [{"force": row} for row in rows])
        )
        columns = [
            data.weight_residuals([{"force": shape[k // n_repeats]} for k in range(len(rows))]) for shape in shapes
        ]
        jacobian = np.concatenate([np.stack(columns, axis=1), np.eye(2)])
        target = np.append(data.weight_residuals([{"force": row} for row in rows]), np.zeros(2))
        x = -np.linalg.pinv(jacobian) @ target
        weighted_residuals = target + jacobian @ x
        residuals = data.split_weighted_residuals(weighted_residuals)
        result = compute_repeat_products(data, Fit(hypothesis, x, weighted_residuals, jacobian, True, residuals))
        assert result is not None
        misfits.append(result)
    simulator.close()
    return misfits


@pytest.mark.slow
@pytest.mark.parametrize(
    "make_noise",
    [make_stationary_noise, make_local_noise, make_skewed_level_noise],
)
@pytest.mark.parametrize("n_repeats", [2, 3])
def test_p_values_are_uniform_where_only_noise_is_left(
    make_noise: Callable[[np.random.Generator], np.ndarray], n_repeats: int
) -> None:
    misfits = draw_misfits(make_noise, 100, n_repeats=n_repeats)
    p_values = [convert_to_p_value(shared, *ONLY_NOISE) for shared in misfits]
    assert kstest(p_values, "uniform").pvalue > 0.01
    assert np.mean(np.array(p_values) <= 0.05) < 0.1


def test_shared_misfit_as_large_as_the_noise_has_the_sum_one_per_sample() -> None:
    misfits = draw_misfits(make_stationary_noise, 40, misfit=SHARED_SCALE)
    ratios = [shared.products.sum() / shared.n_samples.sum() for shared in misfits]
    assert np.mean(ratios) == pytest.approx(1.0, rel=0.25)  # the noise is estimated, and the fit absorbs a part


@pytest.mark.slow
def test_an_irrelevant_misfit_has_no_small_p_value() -> None:
    misfits = draw_misfits(make_stationary_noise, 100, misfit=SHARED_SCALE * np.sqrt(IRRELEVANT_MEAN_SQUARES[0]))
    p_values = [convert_to_p_value(shared) for shared in misfits]
    assert np.mean(np.array(p_values) <= 0.05) < 0.1


def test_a_misfit_of_a_part_of_the_noise_has_a_small_p_value() -> None:
    weak = [convert_to_p_value(m) for m in draw_misfits(make_stationary_noise, 20, misfit=SHARED_SCALE * 0.6)]
    strong = [convert_to_p_value(m) for m in draw_misfits(make_stationary_noise, 20, misfit=SHARED_SCALE * 3.0)]
    assert np.median(weak) < 0.1
    assert max(strong) < 1e-3


@pytest.mark.slow
def test_a_disturbance_of_all_channels_makes_no_p_value_small() -> None:
    """Each repeat has a disturbance of its own, as large as the other noise, in both channels."""
    rng, p_values = np.random.default_rng(11), []
    for _ in range(200):
        contrasts = []
        for group in ("a", "b", "c"):
            disturbance = np.array([make_stationary_noise(rng) for _ in range(2)])
            for channel in ("force", "pressure"):
                residuals = disturbance + [make_stationary_noise(rng) for _ in range(2)]
                rotated = np.array([residuals.sum(axis=0), residuals[0] - residuals[1]]) / np.sqrt(2.0)
                contrasts.append(RepeatContrasts(channel, group, ("0", "1"), rotated, np.empty((0, SAMPLES)), 16, 1.0))
        shared = sum_products(contrasts)
        assert shared is not None
        p_values.append(convert_to_p_value(shared, *ONLY_NOISE))
    assert kstest(p_values, "uniform").pvalue > 0.01
    assert np.mean(np.array(p_values) <= 0.05) < 0.1


def test_products_are_those_of_all_pairs_of_repeats() -> None:
    rng = np.random.default_rng(2)
    residuals = rng.normal(size=(3, 200))
    contrasts = helmert(3, full=True) @ residuals / 2.0  # four samples carry the information of one
    empty = np.empty((0, 200))
    trials, channels = ("0", "1", "2"), ("force_x", "angle_x")
    shared = sum_products([RepeatContrasts(name, "g", trials, contrasts, empty, 8, 4.0) for name in channels])
    assert shared is not None
    assert shared.products.sum() == pytest.approx(2.0 * sum((residuals[i] * residuals[i - 1]).sum() for i in range(3)))
    assert shared.n_samples.sum(axis=0) == pytest.approx([600.0, 600.0])


@pytest.mark.parametrize(
    ("channel", "is_load"),
    [
        *[(name, True) for name in ("force", "pressure", "ankle_moment", "moment_knee", "force_flexor")],
        *[(name, True) for name in ("pressure_flexor", "sensor_force_plate", "sensor_moment_x")],
        *[(name, False) for name in ("muscle_length", "ankle_angle", "angle_knee", "position_sled", "site_x_tip")],
        *[(name, False) for name in ("sensor_angle_knee", "sensor_position_sled", "unit_length_flexor")],
    ],
)
def test_unit_of_a_channel_tells_a_load_from_a_motion(channel: str, is_load: bool) -> None:
    contrasts = RepeatContrasts(channel, "g", ("0", "1"), np.ones((2, 200)), np.empty((0, 200)), 8, 1.0)
    shared = sum_products([contrasts])
    assert shared is not None
    assert shared.n_samples.sum(axis=0) == pytest.approx([400.0, 0.0] if is_load else [0.0, 400.0])


def compute_products_with_a_missing_pressure(residuals: np.ndarray) -> tuple[RepeatProducts | None, np.ndarray]:
    """Return the products of force and pressure (2, 3, samples), which the first repeat lacks, and their noise."""
    simulator, (force, pressure) = Simulator(1), residuals
    experiments = [
        replace(e, measured=dict.fromkeys(("force", "pressure") if k else ("force",), e.measured["force"]))
        for k, e in enumerate(make_repeats(list(force)))
    ]
    rows = [{"force": force[0]}, *({"force": f, "pressure": p} for f, p in zip(force[1:], pressure[1:], strict=True))]
    data = WeightedData(simulator, experiments, estimate_noise_from_repeats(experiments, rows))
    weighted, hypothesis = data.weight_residuals(rows), Hypothesis(load_device("klute-3-4-pair"), (), ())
    fit = Fit(hypothesis, np.zeros(0), weighted, np.empty((len(weighted), 0)), True, rows)
    simulator.close()
    return compute_repeat_products(data, fit), np.array([data.noise[name].std for name in ("force", "pressure")])


def test_a_pair_of_repeats_has_one_product_in_each_interval_over_the_channels_that_both_measured() -> None:
    residuals = np.random.default_rng(4).normal(size=(2, 3, SAMPLES))
    shared, noise = compute_products_with_a_missing_pressure(residuals)
    assert shared is not None
    assert len(shared.products) == 3 * 15  # pairs times intervals
    force, pressure = residuals / noise[:, np.newaxis, np.newaxis]
    both = force[1] @ force[2] + 2.0 * pressure[1] @ pressure[2]
    sums = sorted(shared.products.reshape(3, 15).sum(axis=1))
    assert sums == pytest.approx(sorted([force[0] @ force[1], force[0] @ force[2], both]))
    assert shared.n_samples.sum() == pytest.approx(5 * SAMPLES)


def test_intervals_count_once_where_one_repeat_lacks_a_channel() -> None:
    shared, _ = compute_products_with_a_missing_pressure(np.random.default_rng(4).normal(size=(2, 3, SAMPLES // 3)))
    assert shared is None  # five intervals


def test_a_short_trial_has_no_p_value() -> None:
    rng, simulator = np.random.default_rng(0), Simulator(1)
    rows = [rng.normal(size=200) for _ in range(2)]  # one second
    residuals = [{"force": row} for row in rows]
    experiments = make_repeats(rows)
    data = WeightedData(simulator, experiments, estimate_noise_from_repeats(experiments, residuals))
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), (), ())
    weighted = data.weight_residuals(residuals)
    fit = Fit(hypothesis, np.zeros(0), weighted, np.empty((len(weighted), 0)), True, residuals)
    assert compute_p_value(data, fit) is None
    simulator.close()


def test_samples_beyond_a_limit_are_left_out_of_the_fit_as_well() -> None:
    """All repeats agree there, so only the residuals say which samples are left out, not what the fit takes."""
    rng, simulator = np.random.default_rng(3), Simulator(1)
    rows = [make_stationary_noise(rng) * (TIME > 1.0) for _ in range(2)]
    experiments = [replace(e, limits={"force": SensorLimits(-np.inf, 100.0)}) for e in make_repeats(rows, "0")]
    residuals = [{"force": row} for row in rows]
    data = WeightedData(simulator, experiments, estimate_noise_from_repeats(experiments, residuals))
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), UNCERTAINTIES[:1], ())
    weighted = np.append(data.weight_residuals(residuals), 0.0)
    jacobian = np.append(data.weight_residuals([{"force": np.sin(1.3 * TIME)}] * 2), 1.0)[:, np.newaxis]
    result = compute_repeat_products(data, Fit(hypothesis, np.zeros(1), weighted, jacobian, True, residuals))
    simulator.close()
    assert result is not None
    assert result.n_samples.sum() == pytest.approx(np.count_nonzero(TIME > 1.0) * 2, rel=0.01)
