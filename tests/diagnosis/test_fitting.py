"""Fits of hypotheses: recovered values, Jacobian, undetermined parameters."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from klute_sim.datasets import dataset as datasets
from klute_sim.datasets.trial import SensorLimits, TimeSeries
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.confidence_intervals import compute_confidence_intervals
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import fit_hypothesis, linearize
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.screening import screen_candidates
from klute_sim.diagnosis.workflow import fit_base_device
from tests.diagnosis.synthetic_dataset import make_repeats, write_dataset


def test_trusted_channel_has_no_sensor_model() -> None:
    nominal = make_repeats([np.zeros(20)])[0]
    hypothesis = Hypothesis(nominal.device, (), (("force", 3.0),), (EffectTerm("sensor_gain", "linear", "force"),))
    imperfect, trusted = hypothesis.build_setups(
        np.array([1.0]), [nominal, replace(nominal, trusted=frozenset({"force"}))]
    )
    assert [reading.channel for reading in imperfect.sensors] == ["force"]
    assert trusted.sensors == ()


def test_fit_recovers_an_uncertain_value(fitted_data: tuple) -> None:
    data, weighted_data, simulator = fitted_data
    result, _ = fit_base_device(data, weighted_data.experiments, simulator)
    assert result.converged
    assert result.values[0] == pytest.approx(1.15 * 60.0, rel=0.01)
    assert result.values[1] == pytest.approx(28.0, rel=0.02)
    assert result.chi2 == pytest.approx(weighted_data.n_effective, rel=0.3)
    low, high = compute_confidence_intervals(weighted_data, result)[0]
    assert low < 1.15 * 60.0 < high
    assert 0.0005 < (high - low) / 69.0 < 0.02


def test_jacobian_is_the_derivative_of_the_residuals(fitted_data: tuple) -> None:
    _, weighted_data, _ = fitted_data
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), (("tendon.stiffness_1_n_per_mm", 6.0),), (("force", 3.0),))
    hypothesis = hypothesis.with_term(EffectTerm("muscle_damping", "viscous"))
    result = fit_hypothesis(weighted_data, hypothesis, np.array([1.0, 0.3]), max_nfev=1, fine=True)
    coarse = fit_hypothesis(weighted_data, hypothesis, result.x, max_nfev=1)
    for k in range(2):
        deviations = []
        for sign in (1.0, -1.0):
            row = result.x.copy()
            row[k] += sign * 1e-3
            vector = weighted_data.weight_residuals(weighted_data.compute_residuals(hypothesis, [row])[0])
            deviations.append(np.concatenate([vector, row[:1]]))
        difference = result.jacobian[:, k] - (deviations[0] - deviations[1]) / 2e-3
        assert np.linalg.norm(difference) < 0.02 * np.linalg.norm(result.jacobian[:, k])
        is_close = np.abs(difference) < 0.02 * np.abs(result.jacobian).max()
        assert np.count_nonzero(~is_close) <= 2  # one sample of both repeats
        error = np.linalg.norm(coarse.jacobian[:, k] - result.jacobian[:, k])
        assert 0.0 < error < 0.4 * np.linalg.norm(result.jacobian[:, k])


def test_final_fit_ends_at_the_minimum_of_normal_simulations(fitted_data: tuple) -> None:
    """Numbers that compensate each other make a flat valley."""
    _, weighted_data, _ = fitted_data
    uncertain = (("tendon.stiffness_1_n_per_mm", 20.0), ("tendon.slack_length_mm", 5.0), ("muscle.c10_kpa", 60.0))
    terms = (EffectTerm("tendon_slack", "dead_length"),)
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), uncertain, (("force", 3.0),), terms)

    def evaluate(x: np.ndarray) -> np.ndarray:
        (residuals,) = weighted_data.compute_residuals(hypothesis, [x])
        priors = weighted_data.compute_prior_residuals(hypothesis, x)
        return np.concatenate([weighted_data.weight_residuals(residuals), priors])

    refined = fit_hypothesis(weighted_data, hypothesis, fine=True)
    lowest = least_squares(evaluate, refined.x, "3-point", bounds=hypothesis.bounds(), diff_step=1e-3, ftol=1e-10)
    assert refined.chi2 == pytest.approx(2.0 * lowest.cost, abs=0.05)


def test_undetermined_parameter_has_an_interval() -> None:
    """Its error may be hundreds of normalized units, each a factor e for a logarithmic parameter."""
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), (), (), (EffectTerm("seal_friction", "stribeck"),))
    stick = hypothesis.parameters[1]
    assert stick.denormalize(-2000.0) == pytest.approx(stick.lower)
    assert stick.denormalize(2000.0) == pytest.approx(stick.upper)


def test_effect_without_influence_is_fitted(fitted_data: tuple) -> None:
    """A regulator offset that leaves no pressure has a gradient of 0."""
    data, weighted_data, _ = fitted_data
    unpressurized = [replace(e, command=0.0 * e.command) for e in weighted_data.experiments]
    flat_data = weighted_data.with_experiments(unpressurized)
    hypothesis = Hypothesis(data.device, (), (("force", 3.0),), (EffectTerm("regulator_error", "offset"),))
    result = fit_hypothesis(flat_data, hypothesis, np.array([-1.0]))
    assert np.isfinite(result.x).all()
    assert result.converged


def test_effect_with_a_threshold_is_fitted_from_where_it_is_visible(tmp_path: Path) -> None:
    """A small tank runs low late, one of typical size at once: linear extrapolation fails."""
    effect = {("supply_droop", "tank"): {"inverse_volume_per_l": 0.3}}
    data, simulator = datasets.load_dataset(write_dataset(tmp_path / "d", effect, seconds=4.0)), Simulator(2)
    fit_experiments = [e for e in prepare_experiments(data, datasets.split_dataset(data)) if e.use == "fit"]
    base, weighted_data = fit_base_device(data, fit_experiments, simulator)
    result = screen_candidates(weighted_data, base, [EffectTerm("supply_droop", "tank")])
    (refitted,) = ForwardSelection(weighted_data, [], []).refit_candidates(base, result)
    assert refitted.values[-1] == pytest.approx(0.3, rel=0.03)
    simulator.close()


def test_repeats_share_derivatives_that_each_of_them_would_give(fitted_data: tuple) -> None:
    data, weighted_data, simulator = fitted_data
    assert weighted_data.representatives == [2 * (k // 2) for k in range(len(weighted_data.experiments))]
    fit, _ = fit_base_device(data, weighted_data.experiments, simulator)
    hypothesis = fit.hypothesis.with_term(EffectTerm("seal_friction", "coulomb"))
    x = np.append(fit.x, 1.0)
    _, shared = linearize(weighted_data, hypothesis, x)
    single = [linearize(weighted_data.with_experiments([e]), hypothesis, x)[1] for e in weighted_data.experiments]
    n_priors = hypothesis.n_prior_parameters
    own = np.concatenate([*(rows[:-n_priors] for rows in single), single[0][-n_priors:]])
    assert own.shape == shared.shape
    assert np.linalg.norm(shared - own) < 0.05 * np.linalg.norm(own)  # repeats have noise in their inputs
    trial = weighted_data.experiments[0]
    shorter = replace(trial, measured={c: TimeSeries(s.time[1:], s.value[1:]) for c, s in trial.measured.items()})
    assert weighted_data.with_experiments([trial, shorter]).representatives == [0, 1]
    limited = replace(trial, limits={"force": SensorLimits(0.0, 1e3)})
    assert weighted_data.with_experiments([trial, limited]).representatives == [0, 1]


def test_the_same_effect_of_two_joints_has_two_names() -> None:
    elbow, wrist = (EffectTerm("joint_friction", "coulomb", part=joint) for joint in ("elbow", "wrist"))
    assert (elbow.qualified_name, wrist.qualified_name) == ("joint_friction@elbow", "joint_friction@wrist")
    number = EffectTerm("number_error", "value", number="muscle.bladder_radius_mm")
    assert number.qualified_name == "number_error@muscle.bladder_radius_mm"
