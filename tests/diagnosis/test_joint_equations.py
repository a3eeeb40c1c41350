"""Which equation of a joint has the misfit, and the data-driven term of its equation of motion."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from klute_sim.api.diagnosis import load_dataset
from klute_sim.datasets.dataset import split_dataset
from klute_sim.datasets.trial import TimeSeries
from klute_sim.device.device import Device, load_device, parse_device
from klute_sim.diagnosis.discrepancy.data_driven_rival import find_data_driven_rival
from klute_sim.diagnosis.discrepancy.sparse_regression import add_data_driven_term, format_formula
from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.experiments.mechanism import MechanismExperiment
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.localization.equation_residuals import compute_equation_residuals, select_significant_equations
from klute_sim.diagnosis.noise.repeats import estimate_noise_from_repeats
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.mechanism.assembly import Mechanism
from klute_sim.plant.mjcf.model_effects import ModelEffect
from tests.diagnosis import synthetic_joint_dataset as joint

PAIR = load_device("klute-3-4-pair")
PRESSURES = ("angle_joint", "pressure_flexor", "pressure_extensor")
ALL = (*PRESSURES, "force_flexor", "force_extensor")
DEVICES = {"supply of 'flexor'", "supply of 'extensor'"}
FORCES = {"muscle, damper or tendon of 'flexor'", "muscle, damper or tendon of 'extensor'"}
COEFFICIENTS = {"constant_n_m": 0.15, "speed_squared_n_m": 0.05}
UNKNOWN = ModelEffect("unknown_joint_moment", "sparse", tuple(COEFFICIENTS.items()), "joint")
"""A constant moment and drag that rises with the square of the speed; no effect of the catalogue is either."""


@pytest.fixture
def simulator() -> Iterator[Simulator]:
    simulator = Simulator(2)
    yield simulator
    simulator.close()


def weight(folder: Path, simulator: Simulator, **options: Any) -> tuple[WeightedData, Fit]:
    """Return data of two groups with two repeats, weighted by the noise between repeats, and the nominal fit."""
    options = {"groups": ("fit_1", "fit_2"), "seconds": 2.5, "measured": ALL, **options}
    dataset = load_dataset(joint.write_dataset(folder, **options))
    experiments = prepare_experiments(dataset, split_dataset(dataset))
    nominal = Hypothesis(dataset.device, (), (), (), (), tuple(dataset.nominal_numbers.items()))
    (residuals,) = WeightedData(simulator, experiments, {}).compute_residuals(nominal, [np.zeros(0)])
    data = WeightedData(simulator, experiments, estimate_noise_from_repeats(experiments, residuals))
    return data, fit_hypothesis(data, nominal)


def add_effect(section: str) -> Device:
    return parse_device(f"{PAIR.content.decode()}\n[effects.{section}\n".encode(), PAIR.name)


DEVICE_EFFECTS = {
    "supply of 'flexor'": 'pressure_lag]\nform = "first_order"\ntime_constant_s = 0.05',
    "muscle, damper or tendon of 'flexor'": 'braid_hysteresis]\nform = "coulomb"\nslope_n_per_bar = 6.0',
}


def test_clean_joint_has_no_significant_equation(tmp_path: Path, simulator: Simulator) -> None:
    residuals = compute_equation_residuals(*weight(tmp_path, simulator))
    assert {residual.name for residual in residuals} == {"hinge joint 'joint'", *DEVICES, *FORCES}
    assert select_significant_equations(residuals) == []


@pytest.mark.slow
@pytest.mark.parametrize("equation", DEVICE_EFFECTS)
def test_effect_of_a_device_is_missing_in_its_equation_only(
    equation: str, tmp_path: Path, simulator: Simulator
) -> None:
    """The joint moves otherwise, but its own equation and that of the other device hold."""
    truth = {"flexor": add_effect(DEVICE_EFFECTS[equation])}
    residuals = compute_equation_residuals(*weight(tmp_path, simulator, truth=truth))
    assert [residual.name for residual in select_significant_equations(residuals)] == [equation]
    assert residuals[0].part == "flexor"


@pytest.mark.slow
def test_constant_moment_is_missing_in_the_equation_of_the_joint_only(tmp_path: Path, simulator: Simulator) -> None:
    constant = UNKNOWN._replace(parameters=(("constant_n_m", 0.3),))
    residuals = compute_equation_residuals(*weight(tmp_path, simulator, effects=[constant]))
    (missing,) = select_significant_equations(residuals)
    assert (missing.name, missing.kind, missing.part) == ("hinge joint 'joint'", "hinge joint", "joint")
    assert missing.rms == pytest.approx(0.3, rel=0.05)


def test_without_forces_a_joint_is_checked_with_its_devices(tmp_path: Path, simulator: Simulator) -> None:
    truth = {"flexor": add_effect(DEVICE_EFFECTS["muscle, damper or tendon of 'flexor'"])}
    residuals = compute_equation_residuals(*weight(tmp_path, simulator, truth=truth, measured=PRESSURES))
    assert {residual.name for residual in residuals} == {"hinge joint 'joint' or its devices", *DEVICES}
    assert [residual.kind for residual in select_significant_equations(residuals)] == ["hinge joint or its devices"]


def test_joint_without_a_measured_position_has_no_equations(tmp_path: Path, simulator: Simulator) -> None:
    data, fit = weight(tmp_path, simulator, measured=("force_flexor", "pressure_flexor"))
    assert compute_equation_residuals(data, fit) == []


@pytest.mark.slow
@pytest.mark.parametrize("truth", ['braid_hysteresis]\nform = "coulomb"\nslope_n_per_bar = 6.0', ""])
def test_force_of_a_driven_joint_is_checked(truth: str, tmp_path: Path, simulator: Simulator) -> None:
    """On a dynamometer the position is prescribed, so it is known although nobody measures it."""
    data, _ = weight(tmp_path, simulator)
    true_device = add_effect(truth) if truth else PAIR
    trials = [drive_joint(e, true_device, seed) for seed, e in enumerate(data.experiments)]
    hypothesis = Hypothesis(PAIR, (), ())
    (residuals,) = WeightedData(simulator, trials, {}).compute_residuals(hypothesis, [np.zeros(0)])
    driven = WeightedData(simulator, trials, estimate_noise_from_repeats(trials, residuals))
    equations = compute_equation_residuals(driven, fit_hypothesis(driven, hypothesis))
    assert {residual.name for residual in equations} == {*DEVICES, *FORCES}
    expected = {"muscle, damper or tendon of 'flexor'"} if truth else set()
    assert {residual.name for residual in select_significant_equations(equations)} == expected


def drive_joint(experiment: Experiment, true_flexor: Device, seed: int) -> Experiment:
    """Return ``experiment`` with a prescribed angle instead of a measured one, simulated with ``true_flexor``."""
    assert isinstance(experiment, MechanismExperiment)
    rng, mechanism = np.random.default_rng(seed), experiment.mechanism
    angle = 0.6 + 0.3 * np.sin(np.linspace(0.0, 9.0, len(experiment.command)))
    driven = replace(
        experiment,
        mechanism=Mechanism(mechanism.file, mechanism.device_names, (*mechanism.prescribed, "angle_joint")),
        inputs={**experiment.inputs, "angle_joint": angle},
        outputs={name: binding for name, binding in experiment.outputs.items() if name != "angle_joint"},
        initial_positions={},
    )
    (setup,) = Hypothesis(PAIR, (), ()).build_setups(np.zeros(0), [driven])
    devices = {"flexor": true_flexor.parameters, "extensor": PAIR.parameters}
    response = driven.simulate(setup._replace(devices=tuple(devices[name] for name in driven.devices)))
    measured = {}
    for name in driven.outputs:
        time = experiment.measured[name].time
        noise = joint.NOISE[name] * (1e5 if name.startswith("pressure") else 1.0) * rng.normal(size=len(time))
        measured[name] = TimeSeries(time, np.interp(time, response.time, response.read_channel(name)) + noise)
    return replace(driven, measured=measured)


@pytest.mark.slow
def test_unknown_moment_becomes_a_formula_and_its_imitation_is_refused(tmp_path: Path, simulator: Simulator) -> None:
    data, base = weight(tmp_path, simulator, effects=[UNKNOWN], measured=PRESSURES, seconds=4.0)
    search = ForwardSelection(data, [], [], has_repeats=True)
    assert search.has_misfit(base)
    result = add_data_driven_term(search, base, base, compute_equation_residuals(data, base))
    assert result.equation == "hinge joint 'joint' or its devices"
    assert result.fit is not None, result.reason
    assert not search.has_misfit(result.fit)
    (term,) = result.fit.hypothesis.terms
    assert (term.effect, term.part) == ("unknown_joint_moment", "joint")
    found = dict(zip(term.parameter_keys, result.fit.values, strict=True))
    assert found == pytest.approx(COEFFICIENTS, rel=0.1)
    assert format_formula(result.fit).startswith("M -= 0.1")
    imitation = EffectTerm("joint_friction", "viscous", part="joint")
    named = fit_hypothesis(data, base.hypothesis.with_term(imitation))
    data_driven_model = find_data_driven_rival(search, base, named)
    assert data_driven_model is not None
    assert data_driven_model.difference < -search.bic_threshold
    assert find_data_driven_rival(search, base, named, ("unknown_joint_moment",)) is None


@pytest.mark.slow
def test_true_friction_stands_against_the_data_driven_term(tmp_path: Path, simulator: Simulator) -> None:
    friction = ModelEffect("joint_friction", "coulomb", (("moment_n_m", 0.15),), "joint")
    data, base = weight(tmp_path, simulator, effects=[friction], measured=PRESSURES, seconds=4.0)
    search = ForwardSelection(data, [], [], has_repeats=True)
    named = fit_hypothesis(data, base.hypothesis.with_term(EffectTerm("joint_friction", "coulomb", part="joint")))
    assert not search.has_misfit(named)
    assert find_data_driven_rival(search, base, named) is None
