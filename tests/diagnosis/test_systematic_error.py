"""What repeats share is in the intervals of walks, as large as it would be at any time, less the noise's part."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.stats import norm

from klute_sim.datasets import dataset as datasets
from klute_sim.datasets.trial import Series
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.base import Simulator
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.diagnosis.experiments.gait import GaitExperiment
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.fitting import confidence_intervals
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit, WeightedData, fit_hypothesis
from klute_sim.diagnosis.noise.repeats import estimate_noise_from_repeats
from klute_sim.diagnosis.noise.systematic_error import (
    SharedMisfit,
    collect_shared_misfits,
    estimate_misfit_error,
    estimate_preparation_errors,
)
from klute_sim.gait.replay.prescribed import CUTOFF_FREQUENCY_HZ, prepare_prescribed_motion
from tests.diagnosis import synthetic_gait_dataset as gait_made

SURE = norm.ppf(0.975)


def drawn(random: np.random.Generator, *shape: int) -> np.ndarray:
    return np.asarray(gaussian_filter1d(random.normal(size=shape), 2.0, axis=-1, mode="wrap"))


def test_what_is_shared_counts_as_it_would_on_average_at_any_time() -> None:
    random = np.random.default_rng(1)
    follow, mean = drawn(random, 2, 3, 60), drawn(random, 2, 60)
    silent = [np.zeros((2, 60))] * 2
    each = []
    for k in range(-15, 16):  # what meets the trial, as if it were all of it
        here, there = slice(max(0, k), 60 + min(0, k)), slice(max(0, -k), 60 - max(0, k))
        each.append(60 / (60 - abs(k)) * sum(f[:, here] @ m[there] for f, m in zip(follow, mean, strict=True)))
    alone = estimate_misfit_error([SharedMisfit(follow, mean, silent)])
    assert alone == pytest.approx(SURE * np.sqrt(np.mean(np.square(each), axis=0)), rel=1e-6)
    # It is wrong in the same sense in every group, so groups add up: no square root of two.
    assert estimate_misfit_error([SharedMisfit(follow, mean, silent)] * 2) == pytest.approx(2.0 * np.asarray(alone))


def test_noise_alone_shares_nothing_on_average() -> None:
    random = np.random.default_rng(2)
    follow = drawn(random, 1, 4, 400)
    squares, noises = [], []
    for _ in range(400):
        rows = drawn(random, 2, 400)
        mean = rows.mean(axis=0)
        apart = np.sqrt(2.0) * (rows - mean)
        squares.append(np.square(estimate_misfit_error([SharedMisfit(follow, [mean], [apart])]) / SURE))
        noises.append(np.square(estimate_misfit_error([SharedMisfit(follow, [mean], [np.zeros((2, 400))])]) / SURE))
    # Half of the time chance leaves a little more than the noise explains.
    assert (np.mean(squares, axis=0) < 0.4 * np.mean(noises, axis=0)).all()


def test_a_bench_has_nothing_prepared() -> None:
    """So intervals there are as they were without this."""
    device, rest, time = load_device("klute-3-4-pair"), np.zeros(3), 0.01 * np.arange(40)
    rows = {"force": Series(time, np.sin(time))}
    trials = [BenchExperiment(f"{k}", "g", "fit", device, 0.0, 0.01, rest, rows, unit_length=rest) for k in range(2)]
    residuals = [{"force": np.sin(time) + k * np.cos(9.0 * time)} for k in range(2)]
    evidence = WeightedData(Simulator(1), trials, estimate_noise_from_repeats(trials, residuals))
    hypothesis = Hypothesis(device, (("tendon.stiffness_1_n_per_mm", 6.0),), ())
    vector = np.append(evidence.weight_residuals(residuals), 0.0)
    found = Fit(hypothesis, np.zeros(1), vector, np.ones((len(vector), 1)), True, residuals)
    solver = np.linalg.pinv(found.jacobian)
    assert estimate_preparation_errors(evidence, found, solver) == []
    assert collect_shared_misfits(evidence, found, solver) == []
    assert estimate_misfit_error([]) == 0.0
    evidence.simulator.close()


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> datasets.Dataset:
    return datasets.load_dataset(gait_made.dataset(tmp_path_factory.mktemp("gait") / "clean"))


def fitted(trials: Sequence[GaitExperiment], bench: Simulator) -> tuple[WeightedData, Fit, np.ndarray]:
    """At the nominal device, with the Jacobian of one number, and its pseudoinverse."""
    hypothesis = Hypothesis(load_device(gait_made.DEVICE), (("tendon.stiffness_1_n_per_mm", 6.0),), ())
    here, aside = np.zeros(1), np.full(1, 1e-3)
    found, moved = WeightedData(bench, trials, {}).compute_residuals(hypothesis, [here, aside])
    evidence = WeightedData(bench, trials, estimate_noise_from_repeats(trials, found))
    vector, other = (np.append(evidence.weight_residuals(each), at[0]) for each, at in ((found, here), (moved, aside)))
    jacobian = ((other - vector) / 1e-3)[:, np.newaxis]
    return evidence, Fit(hypothesis, here, vector, jacobian, True, found), np.linalg.pinv(jacobian)


def test_a_walk_is_prepared_otherwise_by_half_the_cutoff(clean: datasets.Dataset) -> None:
    trial = clean.trials[0]
    ready = prepare_prescribed_motion(trial.prescribed, "trial", cutoff=0.5 * CUTOFF_FREQUENCY_HZ)
    one = next(
        e
        for e in prepare_experiments(clean, datasets.split_dataset(clean))
        if isinstance(e, GaitExperiment) and e.name == trial.name
    )
    (other,) = one.preparation_variants
    assert isinstance(other, GaitExperiment)
    since = one.start_time + one.dt * np.arange(float(len(one.command)))
    assert other.inputs.shank_angular_acceleration == pytest.approx(ready.interpolate(since).shank_angular_acceleration)
    assert not np.allclose(other.inputs.shank_angular_acceleration, one.inputs.shank_angular_acceleration, rtol=0.01)
    assert other.measured is one.measured
    assert other.command is one.command


def half_width(walk: GaitExperiment, later: float) -> float:
    """Of one number that follows the stride, from two repeats, the second of which begins ``later`` strides later."""
    bench, hypothesis = Simulator(1), Hypothesis(walk.device, (("tendon.stiffness_1_n_per_mm", 6.0),), ())
    trials, residuals, follow = [], [], []
    for number, begin in enumerate((0.0, later)):
        time = walk.start_time + walk.foot_strikes[0] + walk.mean_stride_time * np.arange(begin, begin + 20.0, 0.01)
        trials.append(replace(walk, name=str(number), group="g", measured={"force": Series(time, np.zeros(len(time)))}))
        phase = 2.0 * np.pi * trials[-1].compute_stride_phase(time - walk.start_time)
        residuals.append({"force": np.cos(phase) + 0.1 * np.sin(20.0 * phase + 2.0 * number)})
        follow.append({"force": np.sin(phase)})
    evidence = WeightedData(bench, trials, estimate_noise_from_repeats(trials, residuals))
    jacobian = np.append(evidence.weight_residuals(follow), 1.0)[:, np.newaxis]
    found = Fit(hypothesis, np.zeros(1), np.zeros(len(jacobian)), jacobian, True, residuals)
    bench.close()
    return float(estimate_misfit_error(collect_shared_misfits(evidence, found, np.linalg.pinv(jacobian)))[0])


def test_repeats_share_as_much_wherever_they_begin(clean: datasets.Dataset) -> None:
    walk = next(e for e in prepare_experiments(clean, datasets.split_dataset(clean)) if isinstance(e, GaitExperiment))
    together = half_width(walk, 0.0)
    assert together > 0.5
    for later in (0.25, 0.5):
        assert half_width(walk, later) == pytest.approx(together, rel=0.1)


def test_intervals_of_walks_hold_what_could_have_been_done_otherwise(clean: datasets.Dataset) -> None:
    trials = [
        e
        for e in prepare_experiments(clean, datasets.split_dataset(clean))
        if isinstance(e, GaitExperiment) and e.use == "fit"
    ]
    bench = Simulator(1)
    evidence, found, solver = fitted(trials, bench)
    steps, smoothed = estimate_preparation_errors(evidence, found, solver)
    assert (steps > 0.0).all()
    # What a second fit, to the smoother motion, has otherwise.
    smoother = evidence.with_experiments([e.preparation_variants[0] for e in trials])
    one, other = (fit_hypothesis(each, found.hypothesis, fine=True).x for each in (evidence, smoother))
    assert smoothed == pytest.approx(np.abs(other - one), rel=0.1)
    bare = evidence.with_experiments([replace(e, smoothed_inputs=e.inputs) for e in trials])
    assert estimate_preparation_errors(bare, found, solver)[1] == pytest.approx(np.zeros(1), abs=1e-12)
    common = estimate_misfit_error(collect_shared_misfits(evidence, found, solver))
    ((low, high),) = confidence_intervals.compute_confidence_intervals(evidence, found)
    unknown = found.hypothesis.parameters[0]
    least = np.sqrt(steps**2 + smoothed**2 + common**2)[0]
    assert low < unknown.denormalize(-least)
    assert high > unknown.denormalize(least)
    bench.close()
