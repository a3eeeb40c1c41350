"""Confidence intervals of fitted parameters: nominal coverage for different kinds of noise."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from klute_sim.datasets.trial import TimeSeries
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.confidence_intervals import (
    NOISE_BLOCK_TIME,
    ChannelInfluence,
    align_deviations,
    combine_degrees_of_freedom,
    compute_confidence_intervals,
    convert_reciprocal_errors,
    estimate_block_variances,
    estimate_spectral_variances,
)
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.repeats import AlignedRepeats, estimate_noise_from_repeats
from tests.diagnosis.synthetic_dataset import make_correlated_noise, make_repeats

SAMPLES, INTERVAL, TRUE_VALUE = 800, 0.005, 70.0
TIME = np.arange(SAMPLES) * INTERVAL


def make_fast_noise(rng: np.random.Generator, bump: np.ndarray) -> np.ndarray:
    return make_correlated_noise(rng, SAMPLES, 3.0, 0.02)


def make_slow_noise(rng: np.random.Generator, bump: np.ndarray) -> np.ndarray:
    """Return noise with a random zero and a periodic disturbance."""
    disturbance = np.sin(2.0 * np.pi * np.exp(rng.uniform(-2.0, 0.0)) * TIME + rng.uniform(0.0, 2.0 * np.pi))
    return make_correlated_noise(rng, SAMPLES, 1.0, 0.02) + 2.0 * disturbance + rng.normal(0.0, 1.0)


def make_local_noise(rng: np.random.Generator, bump: np.ndarray) -> np.ndarray:
    """Return noise that is large where the parameter has most influence."""
    return make_correlated_noise(rng, SAMPLES, 0.3, 0.02) + 10.0 * bump * make_correlated_noise(rng, SAMPLES, 1.0, 0.02)


def compute_coverage(noise: Callable[[np.random.Generator, np.ndarray], np.ndarray], n_draws: int) -> float:
    """Return the coverage for a parameter with influence on three trials of two repeats each."""
    device, rng, simulator, zeros = load_device("klute-3-4-pair"), np.random.default_rng(5), Simulator(1), np.zeros(3)
    hypothesis = Hypothesis(device, (("tendon.stiffness_1_n_per_mm", 40.0),), (("force", 3.0),))
    shape = gaussian_filter1d(rng.normal(size=(3, SAMPLES)), 40.0, axis=1)
    shape = 30.0 * shape / shape.std()
    bump = np.exp(-0.5 * ((TIME - 2.0) / 0.05) ** 2)
    shape += 300.0 * bump if noise is make_local_noise else 0.0
    (parameter,) = hypothesis.parameters
    n_covered = 0
    for _ in range(n_draws):
        rows = [noise(rng, bump) for _ in range(6)]
        experiments = [
            BenchExperiment(
                f"{k}",
                f"g{k // 2}",
                "fit",
                device,
                0.0,
                INTERVAL,
                zeros,
                {"force": TimeSeries(TIME, row)},
                unit_length=zeros,
            )
            for k, row in enumerate(rows)
        ]
        residuals = [{"force": row} for row in rows]
        data = WeightedData(simulator, experiments, estimate_noise_from_repeats(experiments, residuals))
        weighted_residuals = np.append(data.weight_residuals(residuals), 0.0)
        columns = -data.weight_residuals([{"force": shape[k // 2]} for k in range(6)])
        jacobian = np.append(columns, 1.0)[:, np.newaxis]
        x = np.array([parameter.normalize(TRUE_VALUE)]) - np.linalg.pinv(jacobian) @ weighted_residuals
        ((low, high),) = compute_confidence_intervals(
            data, Fit(hypothesis, x, weighted_residuals, jacobian, True, residuals)
        )
        n_covered += low <= TRUE_VALUE <= high
    simulator.close()
    return n_covered / n_draws


@pytest.mark.slow
@pytest.mark.parametrize("noise", [make_fast_noise, make_slow_noise, make_local_noise])
def test_intervals_have_nominal_coverage(
    noise: Callable[[np.random.Generator, np.ndarray], np.ndarray],
) -> None:
    assert 0.92 <= compute_coverage(noise, 300) <= 0.99


def test_parameter_without_influence_may_have_any_value_in_its_bounds() -> None:
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), (), (("force", 3.0),), (EffectTerm("leak", "orifice"),))
    x = hypothesis.initial_point() + 0.1
    trials = make_repeats([np.random.default_rng(k).normal(0.0, 3.0, 400) for k in range(2)])
    residuals = [{"force": e.measured["force"].value} for e in trials]
    simulator = Simulator(1)
    data = WeightedData(simulator, trials, estimate_noise_from_repeats(trials, residuals))
    fit = Fit(hypothesis, x, data.weight_residuals(residuals), np.zeros((800, 1)), True, residuals)
    ((low, high),) = compute_confidence_intervals(data, fit, profiled=[])
    simulator.close()
    (parameter,) = hypothesis.terms[0].parameters
    assert (low, high) == pytest.approx((parameter.lower, parameter.upper))


def test_noise_of_a_repeat_is_placed_where_it_occurred() -> None:
    repeats = AlignedRepeats(
        "g", np.array([2.0, 3.0, 4.0]), np.array([[1.0, 2.0, 3.0], [0.0, 0.0, 0.0]]), np.ones((2, 3)), ("a", "b")
    )
    placed = align_deviations(repeats, np.arange(6.0))
    np.testing.assert_allclose(placed[:, 2:5], repeats.deviations)
    assert placed.shape == (2, 6)


def test_spectral_variance_is_the_mean_over_all_shifts() -> None:
    """Channels of a trial are shifted together, whatever their sampling rates."""
    rng = np.random.default_rng(1)
    samples = gaussian_filter1d(rng.normal(size=(2, 4, 60)), 2.0, axis=-1, mode="wrap")
    sensitivity, noise = samples[:, :3], samples[:, 3]
    result = estimate_spectral_variances(
        [[ChannelInfluence(f, n[np.newaxis], INTERVAL) for f, n in zip(sensitivity, noise, strict=True)]]
    )
    change = [sum(f @ np.roll(n, k) for f, n in zip(sensitivity, noise, strict=True)) for k in range(60)]
    assert result.components.sum(axis=1) == pytest.approx(np.mean(np.square(change), axis=0), rel=1e-6)
    slower = ChannelInfluence(sensitivity[1][:, ::2], noise[1][np.newaxis, ::2], 2.0 * INTERVAL)
    both = estimate_spectral_variances([[ChannelInfluence(sensitivity[0], noise[0][np.newaxis], INTERVAL), slower]])
    change = [sensitivity[0] @ np.roll(noise[0], k) + 0.5 * sensitivity[1] @ np.roll(noise[1], k) for k in range(60)]
    assert both.components.sum(axis=1) == pytest.approx(np.mean(np.square(change), axis=0), rel=1e-3)


def test_block_variance_is_the_square_of_the_change_by_each_block() -> None:
    rng, samples = np.random.default_rng(2), round(4 * NOISE_BLOCK_TIME / INTERVAL)
    sensitivity, noise = rng.normal(size=(2, samples)), rng.normal(size=(2, samples))
    result = estimate_block_variances([[ChannelInfluence(sensitivity, noise, INTERVAL)]])
    products = (sensitivity[:, np.newaxis] * noise).reshape(2, 2, 4, -1).sum(axis=-1) ** 2
    assert result.components == pytest.approx(products.mean(axis=1))
    assert result.degrees_of_freedom == pytest.approx(np.ones(4))
    # Two trials of a group share the noise: twice the variance with equal degrees of freedom.
    twice = estimate_block_variances([[ChannelInfluence(sensitivity, noise, INTERVAL)]] * 2)
    assert twice.components == pytest.approx(2.0 * result.components)
    assert len(twice.degrees_of_freedom) == 4


@pytest.mark.parametrize(("parts", "freedom"), [(1, 1.0), (1, 5.0), (6, 1.0), (30, 2.0)])
def test_degrees_of_freedom_add_up_over_components(parts: int, freedom: float) -> None:
    rng = np.random.default_rng(0)
    samples = rng.chisquare(freedom, (4000, parts)) / freedom
    result = [combine_degrees_of_freedom(change, np.full(parts, freedom)) for change in samples]
    assert np.mean(result) == pytest.approx(parts * freedom, rel=0.25)
    assert min(result) >= freedom
    assert combine_degrees_of_freedom(samples[0], np.full(parts, freedom), exact_variance=1e6) > 1e6
    assert combine_degrees_of_freedom(np.zeros(3), np.ones(3)) == np.inf


@pytest.mark.parametrize("half_width", [1e-4, 1.0, 5.0, 6.0, np.inf])
def test_interval_of_a_rate_is_symmetric_in_its_reciprocal(half_width: float) -> None:
    """Linear errors of a rate that is too large for the data reach beyond 0; those of a duration do not."""
    names = "muscle.turns_per_m", "supply.rate_bar_per_s"
    terms = tuple(EffectTerm("number_error", "value", number=name) for name in names)
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), (), (), terms)
    fit = Fit(hypothesis, np.array([0.5, 4.5]), np.zeros(1), np.ones((1, 2)), True, [])
    converted = convert_reciprocal_errors(fit, np.full(2, half_width))
    if not np.isfinite(half_width):
        assert converted == {}
        return
    ((index, (lower, upper)),) = converted.items()
    assert index == 1
    rate, scale = fit.values[1], hypothesis.parameters[1].scale
    assert 0.0 < rate - lower * scale < rate
    if half_width * scale >= rate:
        assert upper == np.inf
        return
    assert 1.0 / (rate - lower * scale) - 1.0 / rate == pytest.approx(1.0 / rate - 1.0 / (rate + upper * scale))
    assert lower == pytest.approx(half_width, rel=2.0 * half_width * scale / rate)
