"""Intervals of fitted numbers: they hold the truth as often as they say, whatever the noise."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from klute_sim.datasets.trial import Series
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.base import Simulator
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.diagnosis.fitting.confidence_intervals import (
    NOISE_BLOCK_TIME,
    ChannelInfluence,
    combine_degrees_of_freedom,
    compute_confidence_intervals,
    estimate_block_variances,
    estimate_spectral_variances,
)
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit, WeightedData
from klute_sim.diagnosis.noise.repeats import estimate_noise_from_repeats
from tests.diagnosis.synthetic_dataset import coloured

SAMPLES, STEP, TRUE = 800, 0.005, 70.0
TIME = np.arange(SAMPLES) * STEP


def quick(random: np.random.Generator, where: np.ndarray) -> np.ndarray:
    return coloured(random, SAMPLES, 3.0, 0.02)


def slow(random: np.random.Generator, where: np.ndarray) -> np.ndarray:
    """With a zero of its own, and a disturbance of the pressure on top."""
    wander = np.sin(2.0 * np.pi * np.exp(random.uniform(-2.0, 0.0)) * TIME + random.uniform(0.0, 2.0 * np.pi))
    return coloured(random, SAMPLES, 1.0, 0.02) + 2.0 * wander + random.normal(0.0, 1.0)


def in_one_place(random: np.random.Generator, where: np.ndarray) -> np.ndarray:
    """Loud where the number shows most."""
    return coloured(random, SAMPLES, 0.3, 0.02) + 10.0 * where * coloured(random, SAMPLES, 1.0, 0.02)


def covered(noise: Callable[[np.random.Generator, np.ndarray], np.ndarray], draws: int) -> float:
    """Share of intervals that hold the truth, of a number that shows in three trials of two repeats each."""
    device, random, bench, nothing = load_device("klute-3-4-pair"), np.random.default_rng(5), Simulator(1), np.zeros(3)
    hypothesis = Hypothesis(device, (("tendon.stiffness_1_n_per_mm", 40.0),), (("force", 3.0),))
    shape = gaussian_filter1d(random.normal(size=(3, SAMPLES)), 40.0, axis=1)
    shape = 30.0 * shape / shape.std()
    where = np.exp(-0.5 * ((TIME - 2.0) / 0.05) ** 2)
    shape += 300.0 * where if noise is in_one_place else 0.0
    (unknown,) = hypothesis.parameters
    held = 0
    for _ in range(draws):
        rows = [noise(random, where) for _ in range(6)]
        experiments = [
            BenchExperiment(
                f"{k}",
                f"g{k // 2}",
                "fit",
                device,
                0.0,
                STEP,
                nothing,
                {"force": Series(TIME, row)},
                unit_length=nothing,
            )
            for k, row in enumerate(rows)
        ]
        residuals = [{"force": row} for row in rows]
        evidence = WeightedData(bench, experiments, estimate_noise_from_repeats(experiments, residuals))
        vector = np.append(evidence.weight_residuals(residuals), 0.0)
        columns = -evidence.weight_residuals([{"force": shape[k // 2]} for k in range(6)])
        jacobian = np.append(columns, 1.0)[:, np.newaxis]
        steps = np.array([unknown.normalize(TRUE)]) - np.linalg.pinv(jacobian) @ vector
        ((low, high),) = compute_confidence_intervals(
            evidence, Fit(hypothesis, steps, vector, jacobian, True, residuals)
        )
        held += low <= TRUE <= high
    bench.close()
    return held / draws


@pytest.mark.parametrize("noise", [quick, slow, in_one_place])
def test_intervals_hold_the_truth_as_often_as_they_say(
    noise: Callable[[np.random.Generator, np.ndarray], np.ndarray],
) -> None:
    assert 0.92 <= covered(noise, 300) <= 0.99


def test_noise_that_is_shifted_is_the_mean_over_all_shifts() -> None:
    """And channels of a trial, logged at different rates or not, are shifted together."""
    random = np.random.default_rng(1)
    drawn = gaussian_filter1d(random.normal(size=(2, 4, 60)), 2.0, axis=-1, mode="wrap")
    follow, noise = drawn[:, :3], drawn[:, 3]
    found = estimate_spectral_variances(
        [[ChannelInfluence(f, n[np.newaxis], STEP) for f, n in zip(follow, noise, strict=True)]]
    )
    each = [sum(f @ np.roll(n, k) for f, n in zip(follow, noise, strict=True)) for k in range(60)]
    assert found.components.sum(axis=1) == pytest.approx(np.mean(np.square(each), axis=0), rel=1e-6)
    slower = ChannelInfluence(follow[1][:, ::2], noise[1][np.newaxis, ::2], 2.0 * STEP)
    both = estimate_spectral_variances([[ChannelInfluence(follow[0], noise[0][np.newaxis], STEP), slower]])
    each = [follow[0] @ np.roll(noise[0], k) + 0.5 * follow[1] @ np.roll(noise[1], k) for k in range(60)]
    assert both.components.sum(axis=1) == pytest.approx(np.mean(np.square(each), axis=0), rel=1e-3)


def test_noise_in_place_is_the_square_of_what_each_block_did() -> None:
    random, samples = np.random.default_rng(2), round(4 * NOISE_BLOCK_TIME / STEP)
    follow, noise = random.normal(size=(2, samples)), random.normal(size=(2, samples))
    found = estimate_block_variances([[ChannelInfluence(follow, noise, STEP)]])
    products = (follow[:, np.newaxis] * noise).reshape(2, 2, 4, -1).sum(axis=-1) ** 2
    assert found.components == pytest.approx(products.mean(axis=1))
    assert found.degrees_of_freedom == pytest.approx(np.ones(4))
    # Two trials of a group are met by the same noise: twice the square, known no better.
    twice = estimate_block_variances([[ChannelInfluence(follow, noise, STEP)]] * 2)
    assert twice.components == pytest.approx(2.0 * found.components)
    assert len(twice.degrees_of_freedom) == 4


@pytest.mark.parametrize(("parts", "freedom"), [(1, 1.0), (1, 5.0), (6, 1.0), (30, 2.0)])
def test_degrees_of_freedom_are_those_of_the_parts(parts: int, freedom: float) -> None:
    random = np.random.default_rng(0)
    drawn = random.chisquare(freedom, (4000, parts)) / freedom
    found = [combine_degrees_of_freedom(each, np.full(parts, freedom)) for each in drawn]
    assert np.mean(found) == pytest.approx(parts * freedom, rel=0.25)
    assert min(found) >= freedom
    assert combine_degrees_of_freedom(drawn[0], np.full(parts, freedom), exact_variance=1e6) > 1e6
    assert combine_degrees_of_freedom(np.zeros(3), np.ones(3)) == np.inf
