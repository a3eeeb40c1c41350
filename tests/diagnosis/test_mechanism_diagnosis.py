"""Diagnosis of joints with two devices: known numbers and effects are found from generated data of a joint."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from klute_sim.api.diagnosis import load_dataset
from klute_sim.datasets.dataset import split_dataset
from klute_sim.datasets.mechanism_channels import parse_channel
from klute_sim.datasets.write import write_trial
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments import mechanism as mechanism_experiments
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS, Experiment, SimulationSetup
from klute_sim.diagnosis.experiments.mechanism import MechanismExperiment
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator, observe, simulate_extrapolated
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import fit_hypothesis
from klute_sim.diagnosis.fitting.number_error import list_model_error_candidates
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.held_out import evaluate_held_out
from klute_sim.diagnosis.noise.heteroscedastic import add_noise_scales
from klute_sim.diagnosis.noise.repeats import estimate_noise_from_residuals
from klute_sim.diagnosis.planning import joint_proposals
from klute_sim.diagnosis.planning.joint_proposals import propose_joint_experiment
from klute_sim.diagnosis.result import Diagnosis
from klute_sim.diagnosis.selection.candidates import list_candidate_terms
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.screening import screen_candidates
from klute_sim.diagnosis.workflow import fit_base_device
from klute_sim.errors import InputError, SimulationError
from klute_sim.mechanism.assembly import Mechanism
from klute_sim.mechanism.simulate import simulate_mechanism
from klute_sim.plant.mjcf.model_effects import ModelEffect
from klute_sim.plant.mjcf.model_file import load_model_file
from klute_sim.report.diagnosis.text import format_term
from tests.diagnosis import synthetic_joint_dataset as joint

PAIR = load_device("klute-3-4-pair")
TRUE_NUMBERS = {"model.geom.load.mass": 1.15, "model.joint.joint.damping": 0.08}
UNCERTAIN = {"model.geom.load.mass": "10 %", "model.joint.joint.damping": "50 %", "muscle.friction_offset_n": "30 %"}
SHORT: dict[str, Any] = {"groups": ("fit_1",), "repeats": 1, "seconds": 1.5}


def prepare(folder: Path, **options: Any) -> tuple[list[Experiment], Hypothesis]:
    dataset = load_dataset(joint.write_dataset(folder, **options))
    numbers = tuple(dataset.nominal_numbers.items())
    hypothesis = Hypothesis(dataset.device, tuple(dataset.uncertainties.items()), (), (), (), numbers)
    return prepare_experiments(dataset, split_dataset(dataset)), hypothesis


def test_true_parameters_leave_only_noise(tmp_path: Path) -> None:
    experiments, hypothesis = prepare(tmp_path, true_numbers=TRUE_NUMBERS, uncertain=UNCERTAIN, **SHORT)
    x = [1.5, 1.2, 0.0]  # standard deviations from the declared numbers to the true ones
    (setup,) = hypothesis.build_setups(np.array(x), experiments)
    response = simulate_extrapolated(setup, experiments[0])
    residual = experiments[0].measured["angle_joint"].value - observe(setup, experiments[0], response)["angle_joint"]
    assert np.degrees(np.sqrt(np.mean(residual**2))) == pytest.approx(joint.NOISE["angle_joint"], rel=0.15)


def test_trial_that_begins_in_motion_starts_with_the_measured_velocity(tmp_path: Path) -> None:
    options = {**SHORT, "seconds": 2.5, "measured": ("angle_joint", "pressure_flexor")}
    (whole,), hypothesis = prepare(tmp_path, **options)
    assert isinstance(whole, MechanismExperiment)
    assert whole.initial_velocities == {}
    (setup,) = hypothesis.build_setups(np.zeros(0), [whole])
    response = simulate_extrapolated(setup, whole)
    angle = response.read_channel("angle_joint")
    start = response.time[np.argmax(np.abs(np.gradient(angle)))]
    (file,) = tmp_path.glob("*.csv")
    heading, *rows = file.read_text().splitlines()
    file.write_text("\n".join([heading, *(row for row in rows if float(row.split(",")[0]) >= start)]))
    dataset = load_dataset(tmp_path)
    (cut,) = prepare_experiments(dataset, split_dataset(dataset))
    assert isinstance(cut, MechanismExperiment)
    true_velocity = np.interp(cut.start_time, response.time, np.gradient(angle, response.time))
    assert cut.initial_velocities["joint"] == pytest.approx(true_velocity, rel=0.05)
    assert cut.initial_pressures["flexor"] > 1e5
    assert cut.measured["angle_joint"].time[0] > cut.start_time + 0.29 * cut.duration
    residual = cut.measured["angle_joint"].value - observe(setup, cut, simulate_extrapolated(setup, cut))["angle_joint"]
    resting = replace(cut, initial_velocities={}, initial_pressures={})
    worse = cut.measured["angle_joint"].value - observe(setup, cut, resting.simulate(setup))["angle_joint"]
    assert np.std(residual) < 0.5 * np.std(worse)
    with (tmp_path / "dataset.toml").open("a") as stated_file:
        stated_file.write(f'[trial.initial]\nvelocity_joint = "{true_velocity} rad/s"\npressure_flexor = "170 kPa"\n')
    dataset = load_dataset(tmp_path)
    (stated,) = prepare_experiments(dataset, split_dataset(dataset))
    assert isinstance(stated, MechanismExperiment)
    assert stated.initial_velocities == pytest.approx({"joint": true_velocity})
    assert stated.initial_pressures == pytest.approx({"flexor": 1.7e5})
    assert stated.measured["angle_joint"].time[0] < stated.start_time + 0.2 * stated.duration  # the usual warm-up


def test_joint_that_is_held_and_released_starts_where_it_is_stated(tmp_path: Path) -> None:
    initial = '[trial.initial]\nangle_joint = "40 deg"\n'
    (resting,), hypothesis = prepare(tmp_path / "resting", **SHORT)
    (setup,) = hypothesis.build_setups(np.zeros(0), [resting])
    joint.write_dataset(tmp_path / "held", **SHORT)
    angles = {}
    for velocity in ("", 'velocity_joint = "0 deg/s"\n'):
        text = (tmp_path / "resting" / "dataset.toml").read_text()
        (tmp_path / "held" / "dataset.toml").write_text(text + initial + velocity)
        dataset = load_dataset(tmp_path / "held")
        (held,) = prepare_experiments(dataset, split_dataset(dataset))
        angles[bool(velocity)] = np.degrees(held.simulate(setup).read_channel("angle_joint"))
    rest_angle = np.degrees(resting.simulate(setup).read_channel("angle_joint")[0])
    assert angles[False][0] == pytest.approx(rest_angle, abs=1e-3)  # the equilibrium is sought from there
    assert angles[True][0] == pytest.approx(40.0)
    assert angles[True][1] == pytest.approx(40.0, abs=0.05)
    assert abs(rest_angle - 40.0) > 5.0
    assert np.abs(angles[True] - 40.0).max() > 5.0


def change_command(experiment: MechanismExperiment, dt: float) -> MechanismExperiment:
    """Return ``experiment`` with steps of the flexor's command between samples, and with the time step ``dt`` [s]."""
    time = dt * np.arange(1, round(experiment.duration / dt) + 1)
    samples = joint.INTERVAL * np.arange(200)
    command = np.interp(time, samples, np.where(np.sin(9.0 * samples - 4.0) > 0.0, 3e5, 1.5e5))
    inputs = {"pressure_command_flexor": command, "pressure_command_extensor": np.full(len(time), 2e5)}
    return replace(experiment, dt=dt, inputs=inputs, command=command, other_inputs=(), unit_length=None)


@pytest.mark.parametrize("delay_ms", [0.0, 2.3, 13.7])
def test_command_of_a_joint_acts_from_its_sample_and_its_delay_on(delay_ms: float, tmp_path: Path) -> None:
    (experiment,), hypothesis = prepare(tmp_path, measured=("angle_joint", "pressure_flexor"), **SHORT)
    assert isinstance(experiment, MechanismExperiment)
    delayed = hypothesis.with_term(EffectTerm("pressure_delay", "dead_time", tendon="flexor"))
    (setup,) = delayed.build_setups(np.array([delayed.parameters[0].normalize(delay_ms * 1e-3)]), [experiment])
    assert experiment.select_variant(setup) is experiment.coarse_variant
    response = simulate_extrapolated(setup, change_command(experiment, experiment.dt))
    reference = change_command(experiment, 2.5e-5).simulate(setup)
    for name, noise in (("angle_joint", np.radians(joint.NOISE["angle_joint"])), ("pressure_flexor", 1000.0)):
        exact = np.interp(response.time, reference.time, reference.read_channel(name))
        error = (response.read_channel(name) - exact)[:-10]
        assert np.sqrt(np.mean(error**2)) < 0.5 * noise, name


def test_metered_flow_of_a_joint_has_shorter_steps(tmp_path: Path) -> None:
    (experiment,), hypothesis = prepare(tmp_path, **SHORT)
    valve = hypothesis.with_term(EffectTerm("choked_valve", "symmetric", tendon="extensor"))
    (setup,) = valve.build_setups(np.ones(len(valve.parameters)), [experiment])
    assert experiment.select_variant(setup) is experiment


def test_channels_of_a_mechanism_have_units() -> None:
    assert CHANNEL_UNITS["angle_joint"] == ("deg", pytest.approx(np.pi / 180.0))
    assert CHANNEL_UNITS["pressure_flexor"] == ("bar", 1e5)
    assert "ankle_angle" in CHANNEL_UNITS
    assert "nonsense" not in CHANNEL_UNITS


def test_experiment_offers_what_every_rig_offers(tmp_path: Path) -> None:
    (experiment,), hypothesis = prepare(tmp_path, measured=("angle_joint", "force_flexor"), **SHORT)
    assert isinstance(experiment, MechanismExperiment)
    assert experiment.informative_channels == ("angle_joint", "force_flexor")
    assert experiment.length_range is not None
    assert experiment.length_range > 1e-3
    still = {**experiment.inputs, "pressure_command_flexor": np.full_like(experiment.command, 2e5)}
    extensor_only = replace(experiment, inputs=still, command=still["pressure_command_flexor"], unit_length=None)
    assert extensor_only.pressure_range == np.ptp(experiment.inputs["pressure_command_extensor"]) > 0.0
    assert extensor_only.length_range is None
    assert experiment.coarse_variant.dt == 2.0 * experiment.dt
    assert set(experiment.compute_covariates()) == {"pressure", "pressure change", "time", "length", "speed"}
    assert "pressure command extensor" in experiment.prescribed_input.label
    assert experiment.input_variants
    more, _, late = experiment.perturb_inputs(lambda values: np.concatenate([values[:4], values[:-4]]))
    assert isinstance(more, MechanismExperiment)
    assert isinstance(late, MechanismExperiment)
    assert more.inputs["pressure_command_flexor"] == pytest.approx(experiment.inputs["pressure_command_flexor"] + 2e3)
    nominal, built = SimulationSetup(PAIR.parameters), hypothesis.build_setups(np.zeros(0), [experiment])[0]
    first, second = experiment.simulate(nominal), experiment.simulate(built)
    assert np.array_equal(first.read_channel("angle_joint"), second.read_channel("angle_joint"))


def test_numbers_of_one_device_and_effects_of_one_tendon_change_that_device_only(tmp_path: Path) -> None:
    uncertain = {"flexor/tendon.slack_length_mm": 1.0, "muscle.friction_offset_n": 5.0}
    experiments, hypothesis = prepare(tmp_path, uncertain=uncertain, **SHORT)
    hypothesis = hypothesis.with_term(EffectTerm("leak", "orifice", tendon="extensor"))
    setup = hypothesis.build_setups(np.array([1.5, 1.0, 0.5]), experiments)[0]
    flexor, extensor = setup.devices
    nominal = PAIR.parameters
    assert flexor.tendon.slack_length == pytest.approx(nominal.tendon.slack_length + 1.5e-3)
    assert extensor.tendon.slack_length == nominal.tendon.slack_length
    assert flexor.muscle.friction_offset == extensor.muscle.friction_offset != nominal.muscle.friction_offset
    assert flexor.effects[0] == 0.0
    assert extensor.effects[0] == 1.0
    assert str(hypothesis.terms[0]) == "leak of extensor"


def test_numbers_of_a_trial_keep_the_relative_error(tmp_path: Path) -> None:
    folder = joint.write_dataset(tmp_path, uncertain={"model.geom.load.mass": "10 %"}, **SHORT)
    text = (folder / "dataset.toml").read_text() + '[trial.numbers]\n"model.geom.load.mass" = 2.0\n'
    (folder / "dataset.toml").write_text(text)
    dataset = load_dataset(folder)
    experiments = prepare_experiments(dataset, split_dataset(dataset))
    numbers = tuple(dataset.nominal_numbers.items())
    hypothesis = Hypothesis(dataset.device, tuple(dataset.uncertainties.items()), (), (), (), numbers)
    setup = hypothesis.build_setups(np.array([1.0]), experiments)[0]
    assert dict(setup.model_numbers) == pytest.approx({"model.geom.load.mass": 2.2})


def test_channel_bound_to_nothing_is_one_sentence(tmp_path: Path) -> None:
    folder = joint.write_dataset(tmp_path, **SHORT)
    for path in folder.iterdir():
        path.write_text(path.read_text().replace("angle_joint", "angle_elbow"))
    with pytest.raises(InputError, match="'angle_elbow' belongs to no hinge joint; there are: joint"):
        load_dataset(folder)


def test_device_without_pressure_is_one_sentence(tmp_path: Path) -> None:
    folder = joint.write_dataset(tmp_path, **SHORT)
    path = folder / "dataset.toml"
    path.write_text(path.read_text().replace(", 'pressure_command_extensor'", ""))
    with pytest.raises(InputError, match="device 'extensor' has no pressure; prescribe pressure_command_extensor"):
        load_dataset(folder)


def test_numbers_of_model_and_devices_are_recovered(tmp_path: Path) -> None:
    options = {**SHORT, "repeats": 2, "seconds": 3.0}
    truth = PAIR.with_changes({"muscle.friction_offset_n": -28.0})
    experiments, _ = prepare(
        tmp_path, truth={"flexor": truth, "extensor": truth}, true_numbers=TRUE_NUMBERS, uncertain=UNCERTAIN, **options
    )
    simulator = Simulator(2)
    fit, _ = fit_base_device(load_dataset(tmp_path), experiments, simulator)
    simulator.close()
    mass, damping, offset = fit.values
    assert mass == pytest.approx(1.15, rel=0.03)
    assert damping == pytest.approx(0.08, rel=0.15)
    assert offset == pytest.approx(-28.0, abs=6.0)


def refuse_damping(monkeypatch: pytest.MonkeyPatch, limit: float) -> None:
    """Let every simulation with more damping than ``limit`` diverge."""

    def simulate(*args: Any, **options: Any) -> Any:
        if options["numbers"].get("model.joint.joint.damping", 0.05) > limit:
            raise SimulationError("the model diverges")
        return simulate_mechanism(*args, **options)

    monkeypatch.setattr(mechanism_experiments, "simulate_mechanism", simulate)


def test_fit_rejects_steps_to_where_simulations_diverge(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    uncertain = {"model.joint.joint.damping": "50 %"}
    experiments, hypothesis = prepare(
        tmp_path, true_numbers={"model.joint.joint.damping": 0.09}, uncertain=uncertain, **SHORT
    )
    simulator = Simulator(2)
    (residuals,) = WeightedData(simulator, experiments, {}).compute_residuals(hypothesis, [np.zeros(1)])
    data = WeightedData(simulator, experiments, estimate_noise_from_residuals(experiments, residuals))
    refuse_damping(monkeypatch, 0.07)
    fit = fit_hypothesis(data, hypothesis)
    assert not fit.has_diverged
    assert 0.055 < fit.values[0] <= 0.07  # as far as it can be simulated
    beyond = fit_hypothesis(data, hypothesis, np.array([2.0]))
    assert beyond.has_diverged
    assert not beyond.converged
    simulator.close()


def test_candidate_that_diverges_is_rejected_with_its_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    experiments, hypothesis = prepare(tmp_path, **SHORT)
    hypothesis = replace(hypothesis, rig_numbers=(("model.joint.joint.damping", 0.05),))
    simulator = Simulator(2)
    (residuals,) = WeightedData(simulator, experiments, {}).compute_residuals(hypothesis, [np.zeros(0)])
    data = WeightedData(simulator, experiments, estimate_noise_from_residuals(experiments, residuals))
    term = EffectTerm("number_error", "value", number="model.joint.joint.damping")
    refuse_damping(monkeypatch, 0.05)
    search = ForwardSelection(data, [], [term], has_repeats=False)
    assert search.run(fit_hypothesis(data, hypothesis)).hypothesis.terms == ()
    assert search.history[0].rejections == {term: f"{term}: with it, a simulation diverges"}
    with pytest.raises(SimulationError, match="diverges"):  # outside of fits, a divergence is an error
        data.compute_residuals(hypothesis.with_term(term), [np.array([1.0])])
    simulator.close()


def test_test_trial_that_diverges_leaves_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    options: dict[str, Any] = {"groups": ("fit_1", "test_1"), "repeats": 2, "seconds": 0.8}
    dataset = load_dataset(joint.write_dataset(tmp_path, **options))
    experiments = prepare_experiments(dataset, split_dataset(dataset))
    test_command = next(float(e.command[0]) for e in experiments if e.use == "test")

    def simulate(mechanism: Mechanism, devices: Any, inputs: Any, *args: Any, **options: Any) -> Any:
        if abs(float(inputs[joint.INPUTS[0]][0]) - test_command) < 5e3:  # [Pa], as large as perturbations
            raise SimulationError("the model diverges")
        return simulate_mechanism(mechanism, devices, inputs, *args, **options)

    monkeypatch.setattr(mechanism_experiments, "simulate_mechanism", simulate)
    simulator = Simulator(2)
    fitted = [e for e in experiments if e.use == "fit"]
    scaled, _ = add_noise_scales(experiments, fitted, simulator)
    assert [e.name for e in scaled] == [e.name for e in experiments]
    assert [bool(e.noise_scale) for e in scaled] == [e.use == "fit" for e in experiments]
    fit, data = fit_base_device(dataset, [e for e in scaled if e.use == "fit"], simulator)
    diagnosis = Diagnosis(
        dataset=dataset,
        split=split_dataset(dataset),
        verdict="nothing-missing",
        reasons=[],
        base_fit=fit,
        final_fit=fit,
        experiments=scaled,
    )
    evaluate_held_out(diagnosis, data)
    simulator.close()
    assert diagnosis.verdict == "unexplained"
    assert "of 'test_1_0', 'test_1_1' with the declared numbers and with the refitted numbers" in diagnosis.reasons[0]
    assert diagnosis.evaluated_on == "fit"
    assert [e.name for e in diagnosis.evaluated_experiments] == ["fit_1_0", "fit_1_1"]
    assert np.isfinite(diagnosis.channel_rms["angle_joint"].with_effects)


def test_noise_of_a_free_joint_follows_its_sensitivity_to_the_pressure(tmp_path: Path) -> None:
    """Nothing but pressures is prescribed, so that no mechanical input perturbs the angle."""
    experiments, _ = prepare(tmp_path, groups=("fit_1",), seconds=3.0)
    simulator, rng = Simulator(2), np.random.default_rng(0)
    noisy, sensitivities = [], []
    for e in experiments:
        perturbed, _, _ = e.perturb_inputs(lambda command: command)
        setups = [SimulationSetup(e.device.parameters)] * 2
        nominal, changed = (row["angle_joint"] for row in simulator.simulate([setups], [e, perturbed])[0])
        sensitivities.append(np.abs(changed - nominal))
        value = nominal + sensitivities[-1] * rng.normal(size=len(nominal))
        noisy.append(replace(e, measured={"angle_joint": e.measured["angle_joint"]._replace(value=value)}))
    scaled, _ = add_noise_scales(noisy, noisy, simulator)
    simulator.close()
    for e, sensitivity in zip(scaled, sensitivities, strict=True):
        assert e.noise_scale["angle_joint"][sensitivity.argmin()] < 0.5  # the timing of commands adds to others


def test_numbers_of_the_model_are_candidates_for_errors(tmp_path: Path) -> None:
    dataset = load_dataset(joint.write_dataset(tmp_path, uncertain={"model.geom.load.mass": "10 %"}, **SHORT))
    names = list_model_error_candidates(dataset.model_values, frozenset(dataset.uncertainties))
    assert "model.joint.joint.damping" in names
    assert "model.site.flexor_origin.pos_z" in names
    assert "model.geom.load.mass" not in names
    assert "model.joint.joint.frictionloss" not in names  # 0: there is none
    values = tuple(dataset.model_values.items())
    hypothesis = Hypothesis(dataset.device, (), (), (), (), values)
    hypothesis = hypothesis.with_term(EffectTerm("number_error", "value", number="model.joint.joint.damping"))
    experiments = prepare_experiments(dataset, split_dataset(dataset))
    (setup,) = hypothesis.build_setups(np.array([1.0]), experiments)
    assert dict(setup.model_numbers) == pytest.approx({"model.joint.joint.damping": 0.075})
    assert setup.devices == SimulationSetup(PAIR.parameters, devices=(PAIR.parameters,) * 2).devices
    assert format_term(hypothesis.terms[0]) == "damping of the joint 'joint'"
    assert format_term(EffectTerm("leak", "orifice", tendon="flexor")) == "leak of flexor"


@pytest.mark.slow
def test_size_of_a_faint_friction_in_the_muscles_of_a_free_joint_is_predicted(tmp_path: Path) -> None:
    """At a third of its usual size, the friction would hold the joint, which says nothing of a faint one."""
    rubbing = PAIR.with_effect("braid_hysteresis", form="coulomb", slope_n_per_bar=0.6)
    truth = dict.fromkeys(joint.TENDONS, rubbing)
    options: dict[str, Any] = {"groups": ("fit_1", "fit_2"), "repeats": 2, "seconds": 4.0}
    uncertain = {"muscle.friction_slope_n_per_bar": "10 %", "muscle.c10_kpa": "15 %", **UNCERTAIN}
    dataset = load_dataset(joint.write_dataset(tmp_path, truth=truth, uncertain=uncertain, **options))
    experiments, simulator = prepare_experiments(dataset, split_dataset(dataset)), Simulator(2)
    fit, data = fit_base_device(dataset, experiments, simulator)
    term = EffectTerm("braid_hysteresis", "coulomb")
    (candidate,) = screen_candidates(data, fit, [term])
    simulator.close()
    slope = candidate.size * term.effect_definition.forms[1].parameters[0].typical
    assert slope == pytest.approx(0.6, rel=0.08)
    assert candidate.predicted_gain > 0.85 * fit.chi2


def test_effects_of_the_mechanism_are_candidates_on_its_parts(tmp_path: Path) -> None:
    dataset = load_dataset(joint.write_dataset(tmp_path, **SHORT))
    experiments = prepare_experiments(dataset, split_dataset(dataset))
    noise = estimate_noise_from_residuals(
        experiments, [{"angle_joint": e.measured["angle_joint"].value} for e in experiments]
    )
    terms = list_candidate_terms(WeightedData(Simulator(1), experiments, noise), dataset)
    names = [str(term) for term in terms if term.effect_definition.kind == "mechanism"]
    assert names == [
        "joint_friction (coulomb) of joint",
        "joint_friction (stribeck) of joint",  # no viscous form: the damping of the joint is a number of the model
        "joint_friction (presliding) of joint",
        "joint_inertia of joint",
        "pulley_error of pulley",
        "gravity_tilt (about_y)",
        "gravity_tilt (about_x)",
        "sensor_backlash of angle_joint",
    ]
    hypothesis = Hypothesis(dataset.device, (), (("angle_joint", 1e-3),))
    hypothesis = hypothesis.with_term(EffectTerm("joint_friction", "coulomb", part="joint"))
    hypothesis = hypothesis.with_term(EffectTerm("sensor_backlash", "play", "angle_joint"))
    (setup,) = hypothesis.build_setups(np.array([0.5, 1.0]), experiments)
    assert setup.model_effects == (ModelEffect("joint_friction", "coulomb", (("moment_n_m", 0.05),), "joint"),)
    assert setup.sensors[0].parameters == (pytest.approx(4e-3),)  # four times the noise
    assert format_term(hypothesis.terms[0]) == "joint friction (Coulomb) of joint"


def test_muscle_is_recovered_from_the_moment_of_a_driven_knee_under_measured_pressures(tmp_path: Path) -> None:
    """A jig turns the knee, pressures are those in the muscles, and a torque sensor measures the moment."""
    truth = load_device("klute-1-1-4-pair").with_changes({"muscle.friction_offset_n": 130.0})
    tendons, origin = ("extensor", "flexor"), -0.29
    prescribed = ("angle_knee", "pressure_extensor", "pressure_flexor")
    numbers = {f"model.site.{tendon}_origin.pos_x": origin for tendon in tendons}
    time, step = np.arange(0.0, 3.0, 0.01), 1e-4
    fine = np.arange(0.0, 2.99, step)
    motion = np.clip(time - 0.5, 0.0, None)
    inputs = {
        "angle_knee": np.radians(25.0 + 15.0 * np.sin(2.0 * np.pi * 0.8 * motion) * np.minimum(motion, 1.0)),
        "pressure_extensor": 2.5e5 + 1e5 * np.sin(2.0 * np.pi * 0.5 * motion),
        "pressure_flexor": 2.0e5 + 0.5e5 * np.sin(2.0 * np.pi * 0.9 * motion),
    }
    mechanism = Mechanism(load_model_file("knee_jig"), tendons, prescribed)
    fine_inputs = {name: CubicSpline(time, values)(fine) for name, values in inputs.items()}
    devices = dict.fromkeys(tendons, truth.parameters)
    rollout = simulate_mechanism(mechanism, devices, fine_inputs, step, numbers=numbers)
    moment = np.interp(time, fine, rollout.read_channel(mechanism.bind(parse_channel("moment_knee"))))
    noise = np.random.default_rng(0).normal(0.0, 0.05, (2, len(time)))
    lines = [
        *('format = "klute-sim-dataset/2"', 'rig = "mjcf"', 'model = "knee_jig"', 'device = "klute-1-1-4-pair"'),
        *(f"prescribed = {list(prescribed)}", 'measured = ["moment_knee"]', "[numbers]"),
        *(f'"{name}" = {value}' for name, value in numbers.items()),
        *("[uncertain]", '"muscle.friction_offset_n" = "15 %"'),
    ]
    for repeat in range(2):
        columns = {
            "time [s]": time,
            "angle_knee [deg]": np.degrees(inputs["angle_knee"]),
            **{f"pressure_{tendon} [bar]": inputs[f"pressure_{tendon}"] / 1e5 for tendon in tendons},
            "moment_knee [N*m]": moment + noise[repeat],
        }
        write_trial(tmp_path / f"swing_{repeat}.csv", columns)
        lines += ["[[trial]]", f'files = ["swing_{repeat}.csv"]', 'group = "swing"']
    (tmp_path / "dataset.toml").write_text("\n".join(lines))
    dataset = load_dataset(tmp_path)
    experiments = prepare_experiments(dataset, split_dataset(dataset))
    simulator = Simulator(2)
    fit, _ = fit_base_device(dataset, experiments, simulator)
    simulator.close()
    assert fit.values[0] == pytest.approx(130.0, rel=0.02)
    residual = fit.residuals[0]["moment_knee"]
    assert np.sqrt(np.mean(residual**2)) == pytest.approx(0.05, rel=0.2)


def test_proposed_experiment_separates_rivals_on_a_joint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A shifted angle sensor and a tilted stand."""
    monkeypatch.setattr(joint_proposals, "PROPOSED_TRIALS", ("sine_4Hz",))
    dataset = load_dataset(joint.write_dataset(tmp_path, **SHORT))
    experiments = prepare_experiments(dataset, split_dataset(dataset))
    simulator = Simulator(2)
    nominal = Hypothesis(dataset.device, (), (("angle_joint", np.radians(0.05)),))
    (residuals,) = WeightedData(simulator, experiments, {}).compute_residuals(nominal, [np.zeros(0)])
    data = WeightedData(simulator, experiments, estimate_noise_from_residuals(experiments, residuals))
    shifted = fit_hypothesis(data, nominal.with_term(EffectTerm("sensor_offset", "linear", "angle_joint")))
    tilted = fit_hypothesis(data, nominal.with_term(EffectTerm("gravity_tilt", "about_y")))
    moved = replace(shifted, x=np.array([10.0]))
    leaning = replace(tilted, x=np.array([0.6]))
    proposal = propose_joint_experiment(data, dataset, moved, leaning)
    simulator.close()
    assert proposal is not None
    told = proposal.to_dict()
    assert told["separation_chi2"] > 6.0
    assert told["protocol"] == "sine_4Hz"
    assert f"(mean {told['mean_bar']:.2f} bar, difference {told['difference_bar']:.2f} bar" in told["sentence"]
    assert f"channels: {', '.join(told['channels'])})" in told["sentence"]
    assert told["channels"][: len(data.noise)] == list(data.noise)
    assert 1.0 < told["mean_bar"] < 4.0  # the range of the commands
    assert 0.0 < told["difference_bar"] < 1.5
    assert told["rig_change"] is None or "second sensor of the position" in told["rig_change"]
    other = replace(dataset, mechanism=None)
    assert propose_joint_experiment(data, other, moved, leaning) is None


def test_simpler_form_of_an_effect_stays_on_its_joint(tmp_path: Path) -> None:
    dataset = load_dataset(joint.write_dataset(tmp_path, **SHORT))
    experiments = prepare_experiments(dataset, split_dataset(dataset))
    simulator = Simulator(2)
    nominal = Hypothesis(dataset.device, (), (("angle_joint", np.radians(0.05)),))
    (residuals,) = WeightedData(simulator, experiments, {}).compute_residuals(nominal, [np.zeros(0)])
    data = WeightedData(simulator, experiments, estimate_noise_from_residuals(experiments, residuals))
    rubbing = EffectTerm("joint_friction", "presliding", part="joint")
    terms = [rubbing._replace(form=form) for form in ("coulomb", "stribeck", "presliding")]
    search = ForwardSelection(data, [], terms, has_repeats=False)
    both = nominal.with_term(rubbing).with_term(EffectTerm("sensor_offset", "linear", "angle_joint"))
    simplified = search.simplify(fit_hypothesis(data, both, max_nfev=2), fit_hypothesis(data, nominal))
    assert simplified.hypothesis.terms[0] == rubbing._replace(form="coulomb")  # nothing rubs, so less is as good
    simulator.close()
