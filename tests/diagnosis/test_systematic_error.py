"""Systematic errors in the confidence intervals of gait trials: shared misfit and preparation of the inputs."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.stats import norm

from klute_sim.datasets import dataset as datasets
from klute_sim.datasets.trial import TimeSeries
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.diagnosis.experiments.gait import GaitExperiment
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting import confidence_intervals
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.fitting.systematic_error import (
    MisfitInfluence,
    collect_shared_misfits,
    estimate_misfit_error,
    estimate_preparation_errors,
)
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.repeats import estimate_noise_from_repeats
from klute_sim.gait.replay.prescribed import PASS_CUTOFF_HZ, prepare_prescribed_motion
from tests.diagnosis import synthetic_gait_dataset as synthetic_gait_dataset

pytestmark = pytest.mark.slow

QUANTILE = norm.ppf(0.975)


def make_samples(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return np.asarray(gaussian_filter1d(rng.normal(size=shape), 2.0, axis=-1, mode="wrap"))


def test_misfit_error_is_the_rms_over_time_shifts() -> None:
    rng = np.random.default_rng(1)
    sensitivities, mean = make_samples(rng, 2, 3, 60), make_samples(rng, 2, 60)
    no_noise = [np.zeros((2, 60))] * 2
    change = []
    for k in range(-15, 16):  # the overlap, scaled to the whole trial
        x, there = slice(max(0, k), 60 + min(0, k)), slice(max(0, -k), 60 - max(0, k))
        change.append(60 / (60 - abs(k)) * sum(f[:, x] @ m[there] for f, m in zip(sensitivities, mean, strict=True)))
    error = estimate_misfit_error([MisfitInfluence(sensitivities, mean, no_noise)])
    assert error == pytest.approx(QUANTILE * np.sqrt(np.mean(np.square(change), axis=0)), rel=1e-6)
    # The error may have the same sign in every group, so groups add linearly.
    assert estimate_misfit_error([MisfitInfluence(sensitivities, mean, no_noise)] * 2) == pytest.approx(
        2.0 * np.asarray(error)
    )


def test_noise_alone_has_no_misfit_error_on_average() -> None:
    rng = np.random.default_rng(2)
    sensitivities = make_samples(rng, 1, 4, 400)
    squares, squares_without_noise = [], []
    for _ in range(400):
        rows = make_samples(rng, 2, 400)
        mean = rows.mean(axis=0)
        deviations = np.sqrt(2.0) * (rows - mean)
        squares.append(
            np.square(estimate_misfit_error([MisfitInfluence(sensitivities, [mean], [deviations])]) / QUANTILE)
        )
        squares_without_noise.append(
            np.square(estimate_misfit_error([MisfitInfluence(sensitivities, [mean], [np.zeros((2, 400))])]) / QUANTILE)
        )
    # By chance, half of the estimates are slightly above 0.
    assert (np.mean(squares, axis=0) < 0.4 * np.mean(squares_without_noise, axis=0)).all()


def test_bench_has_no_systematic_error() -> None:
    """Intervals on the bench contain the noise only."""
    device, zeros, time = load_device("klute-3-4-pair"), np.zeros(3), 0.01 * np.arange(40)
    rows = {"force": TimeSeries(time, np.sin(time))}
    trials = [BenchExperiment(f"{k}", "g", "fit", device, 0.0, 0.01, zeros, rows, unit_length=zeros) for k in range(2)]
    residuals = [{"force": np.sin(time) + k * np.cos(9.0 * time)} for k in range(2)]
    data = WeightedData(Simulator(1), trials, estimate_noise_from_repeats(trials, residuals))
    hypothesis = Hypothesis(device, (("tendon.stiffness_1_n_per_mm", 6.0),), ())
    weighted_residuals = np.append(data.weight_residuals(residuals), 0.0)
    fit = Fit(hypothesis, np.zeros(1), weighted_residuals, np.ones((len(weighted_residuals), 1)), True, residuals)
    pseudoinverse = np.linalg.pinv(fit.jacobian)
    assert estimate_preparation_errors(data, fit, pseudoinverse) == []
    assert collect_shared_misfits(data, fit, pseudoinverse) == []
    assert estimate_misfit_error([]) == 0.0
    data.simulator.close()


@pytest.fixture(scope="module")
def clean_dataset(tmp_path_factory: pytest.TempPathFactory) -> datasets.Dataset:
    return datasets.load_dataset(synthetic_gait_dataset.write_dataset(tmp_path_factory.mktemp("gait") / "clean"))


def build_fit(trials: Sequence[GaitExperiment], simulator: Simulator) -> tuple[WeightedData, Fit, np.ndarray]:
    """Return a fit at the nominal device with the Jacobian of one parameter, and its pseudoinverse."""
    hypothesis = Hypothesis(load_device(synthetic_gait_dataset.DEVICE), (("tendon.stiffness_1_n_per_mm", 6.0),), ())
    x, x_perturbed = np.zeros(1), np.full(1, 1e-3)
    fit, perturbed = WeightedData(simulator, trials, {}).compute_residuals(hypothesis, [x, x_perturbed])
    data = WeightedData(simulator, trials, estimate_noise_from_repeats(trials, fit))
    weighted_residuals, variant = (
        np.append(data.weight_residuals(change), at[0]) for change, at in ((fit, x), (perturbed, x_perturbed))
    )
    jacobian = ((variant - weighted_residuals) / 1e-3)[:, np.newaxis]
    return data, Fit(hypothesis, x, weighted_residuals, jacobian, True, fit), np.linalg.pinv(jacobian)


def test_preparation_variant_has_half_the_cutoff_frequency(clean_dataset: datasets.Dataset) -> None:
    trial = clean_dataset.trials[0]
    motion = prepare_prescribed_motion(trial.prescribed, "trial", pass_cutoff=0.5 * PASS_CUTOFF_HZ)
    nominal = next(
        e
        for e in prepare_experiments(clean_dataset, datasets.split_dataset(clean_dataset))
        if isinstance(e, GaitExperiment) and e.name == trial.name
    )
    (variant,) = nominal.preparation_variants
    assert isinstance(variant, GaitExperiment)
    time = nominal.start_time + nominal.dt * np.arange(float(len(nominal.command)))
    assert variant.inputs.shank_angular_acceleration == pytest.approx(
        motion.interpolate(time).shank_angular_acceleration
    )
    assert not np.allclose(
        variant.inputs.shank_angular_acceleration, nominal.inputs.shank_angular_acceleration, rtol=0.01
    )
    assert variant.measured is nominal.measured
    assert variant.command is nominal.command


def half_width(experiment: GaitExperiment, later: float) -> float:
    """Return the half width of a parameter from two repeats, the second of which starts ``later`` strides later."""
    simulator, hypothesis = Simulator(1), Hypothesis(experiment.device, (("tendon.stiffness_1_n_per_mm", 6.0),), ())
    trials, residuals, sensitivities = [], [], []
    for number, start in enumerate((0.0, later)):
        time = (
            experiment.start_time
            + experiment.foot_strikes[0]
            + experiment.mean_stride_time * np.arange(start, start + 20.0, 0.01)
        )
        trials.append(
            replace(experiment, name=str(number), group="g", measured={"force": TimeSeries(time, np.zeros(len(time)))})
        )
        phase = 2.0 * np.pi * trials[-1].compute_stride_phase(time - experiment.start_time)
        residuals.append({"force": np.cos(phase) + 0.1 * np.sin(20.0 * phase + 2.0 * number)})
        sensitivities.append({"force": np.sin(phase)})
    data = WeightedData(simulator, trials, estimate_noise_from_repeats(trials, residuals))
    jacobian = np.append(data.weight_residuals(sensitivities), 1.0)[:, np.newaxis]
    fit = Fit(hypothesis, np.zeros(1), np.zeros(len(jacobian)), jacobian, True, residuals)
    simulator.close()
    return float(estimate_misfit_error(collect_shared_misfits(data, fit, np.linalg.pinv(jacobian)))[0])


def test_shared_misfit_is_independent_of_the_start_of_repeats(clean_dataset: datasets.Dataset) -> None:
    experiment = next(
        e
        for e in prepare_experiments(clean_dataset, datasets.split_dataset(clean_dataset))
        if isinstance(e, GaitExperiment)
    )
    reference = half_width(experiment, 0.0)
    assert reference > 0.5
    for later in (0.25, 0.5):
        assert half_width(experiment, later) == pytest.approx(reference, rel=0.1)


def test_gait_intervals_include_preparation_errors(clean_dataset: datasets.Dataset) -> None:
    trials = [
        e
        for e in prepare_experiments(clean_dataset, datasets.split_dataset(clean_dataset))
        if isinstance(e, GaitExperiment) and e.use == "fit"
    ]
    simulator = Simulator(1)
    data, fit, pseudoinverse = build_fit(trials, simulator)
    time_step_error, smoothing_error = estimate_preparation_errors(data, fit, pseudoinverse)
    assert (time_step_error > 0.0).all()
    # The change of a second fit to the smoother motion.
    smoother_data = data.with_experiments([e.preparation_variants[0] for e in trials])
    nominal, variant = (fit_hypothesis(change, fit.hypothesis, fine=True).x for change in (data, smoother_data))
    assert smoothing_error == pytest.approx(np.abs(variant - nominal), rel=0.1)
    unsmoothed_data = data.with_experiments([replace(e, smoothed_inputs=e.inputs) for e in trials])
    assert estimate_preparation_errors(unsmoothed_data, fit, pseudoinverse)[1] == pytest.approx(np.zeros(1), abs=1e-12)
    misfit_error = estimate_misfit_error(collect_shared_misfits(data, fit, pseudoinverse))
    ((low, high),) = confidence_intervals.compute_confidence_intervals(data, fit)
    parameter = fit.hypothesis.parameters[0]
    systematic_error = np.sqrt(time_step_error**2 + smoothing_error**2 + misfit_error**2)[0]
    assert low < parameter.denormalize(-systematic_error)
    assert high > parameter.denormalize(systematic_error)
    simulator.close()
