"""Mechanisms under prescribed inputs: the devices are those of the bench, do not disturb each other, and balance."""

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import mujoco
import numpy as np
import pytest

from klute_sim.bench.device_only import simulate_device_only
from klute_sim.datasets.mechanism_channels import parse_channel
from klute_sim.device.device import Device, load_device
from klute_sim.device.energy.ledger import POWER_TERMS
from klute_sim.device.equilibrium import compute_equilibrium_state
from klute_sim.errors import InputError, SimulationError
from klute_sim.mechanism import assembly
from klute_sim.mechanism.assembly import Mechanism
from klute_sim.mechanism.record import compute_device_energy, record_mechanism
from klute_sim.mechanism.simulate import MechanismRollout, simulate_mechanism
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.plant.mjcf.model_file import load_model_file
from klute_sim.types import Array

PAIR = load_device("klute-3-4-pair")
VALVE = load_device("klute-1-1-4-pair-valve")
DT = 5e-4
TIME = DT * np.arange(1200)
NUMBERS = {"model.site.flexor_origin.pos_z": 0.29, "model.site.extensor_origin.pos_z": 0.29}
DEVICES = {"flexor": PAIR, "extensor": PAIR}
COMMANDS = {
    "pressure_command_flexor": np.where(TIME < 0.1, 2e5, 3.5e5),
    "pressure_command_extensor": np.where(TIME < 0.1, 2e5, 1e5),
}


def simulate(
    devices: Mapping[str, Device],
    inputs: Mapping[str, Array],
    *,
    numbers: Mapping[str, float] = NUMBERS,
    backend: str = "auto",
    model: str = "antagonist_joint",
) -> MechanismRollout:
    mechanism = Mechanism(load_model_file(model), tuple(devices), tuple(inputs))
    parameters = {name: device.parameters for name, device in devices.items()}
    return simulate_mechanism(mechanism, parameters, inputs, DT, numbers=numbers, backend=backend)


def read(rollout: MechanismRollout, channel: str) -> Array:
    return rollout.read_channel(rollout.mechanism.bind(parse_channel(channel)))


@cache
def step_response() -> MechanismRollout:
    return simulate(DEVICES, COMMANDS)


@pytest.mark.parametrize("name", ["flexor", "extensor"])
@pytest.mark.parametrize(
    "effects", [{}, {"braid_hysteresis": {"slope_n_per_bar": 8.0, "stiffness_n_per_mm": 40.0}}], ids=["plain", "effect"]
)
def test_device_on_joint_is_that_of_the_bench(name: str, effects: dict[str, dict[str, float]]) -> None:
    device = PAIR
    for effect, parameters in effects.items():
        device = device.with_effect(effect, **parameters)
    rollout = simulate({"flexor": device, "extensor": device}, COMMANDS)
    trace = rollout.trace_device(name)
    data = mujoco.MjData(rollout.model)
    data.act[:] = rollout.initial_act
    initial_state = DeviceActuator(rollout.model, name).get_state(data)
    command = COMMANDS[f"pressure_command_{name}"]
    bench = simulate_device_only(device, trace.unit_length, command, DT, initial_state=initial_state)
    assert np.ptp(trace.tension) > 40.0
    assert trace.tension == pytest.approx(bench["force"], rel=1e-9, abs=1e-9)
    assert trace.pressure == pytest.approx(1e5 * bench["pressure"], rel=1e-9)


def test_compiled_and_python_backends_agree_bit_for_bit() -> None:
    short = {name: values[:150] for name, values in COMMANDS.items()}
    compiled, python = (simulate(DEVICES, short, backend=backend) for backend in ("compiled", "python"))
    assert (compiled.backend, python.backend) == ("compiled", "python")
    for field, values in compiled.fields.items():
        assert np.array_equal(values, python.fields[field]), field


@pytest.mark.parametrize("backend", ["compiled", "python"])
def test_simulations_in_threads_equal_one_after_the_other(backend: str) -> None:
    short = {name: values[:60] for name, values in COMMANDS.items()}
    numbers = [{**NUMBERS, "model.geom.load.mass": mass} for mass in (0.5, 1.0, 1.5, 2.0)]

    def run(changes: dict[str, float]) -> Array:
        return simulate(DEVICES, short, numbers=changes, backend=backend).fields["qpos"]

    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(run, numbers))
    assert all(np.array_equal(first, run(changes)) for first, changes in zip(together, numbers, strict=True))


def test_a_device_does_not_change_with_its_neighbour() -> None:
    """With the joint driven, the flexor feels nothing of the extensor's device and command."""
    angle = np.radians(35.0 + 20.0 * np.sin(2.0 * np.pi * 2.0 * TIME))
    inputs = {**COMMANDS, "angle_joint": angle}
    first = simulate(DEVICES, inputs).trace_device("flexor")
    changed = {**inputs, "pressure_command_extensor": np.full(len(TIME), 4e5)}
    other = PAIR.with_changes({"muscle.friction_offset_n": 60.0, "tendon.slack_length_mm": 90.0})
    second = simulate({"flexor": PAIR, "extensor": other}, changed).trace_device("flexor")
    assert np.ptp(first.tension) > 100.0
    assert second.tension == pytest.approx(first.tension, rel=1e-7)


def test_exchanged_commands_mirror_a_symmetric_joint() -> None:
    """Without gravity and about its middle angle, flexor and extensor are mirror images."""
    numbers = {**NUMBERS, "model.option.gravity_z": 0.0}
    exchanged = {
        "pressure_command_flexor": COMMANDS["pressure_command_extensor"],
        "pressure_command_extensor": COMMANDS["pressure_command_flexor"],
    }
    angles = [np.degrees(read(simulate(DEVICES, c, numbers=numbers), "angle_joint")) for c in (COMMANDS, exchanged)]
    assert angles[0][-1] > 45.0
    assert angles[0] - 35.0 == pytest.approx(35.0 - angles[1], abs=0.01)


@pytest.mark.parametrize("device", [PAIR, VALVE.with_changes({"tendon.slack_length_mm": 60.0})], ids=["pair", "valve"])
def test_energy_and_air_balance_for_each_device(device: Device) -> None:
    length = device.parameters.tendon.slack_length + 0.88 * device.parameters.muscle.resting_length
    numbers = dict.fromkeys(NUMBERS, 0.4 + length - 0.4372)
    rollout = simulate({"flexor": device, "extensor": device}, COMMANDS, numbers=numbers)
    for name in ("flexor", "extensor"):
        balance, trace = compute_device_energy(rollout, name), rollout.trace_device(name)
        assert np.abs(balance.force_residual).max() < 1e-6
        unit_work = -np.trapezoid(trace.tension, trace.unit_length)
        terms = sum(getattr(balance, term)[1:].sum() * DT for term in POWER_TERMS)
        exchanged = sum(np.abs(getattr(balance, term)[1:]).sum() * DT for term in POWER_TERMS)
        assert unit_work == pytest.approx(terms, abs=0.01 * exchanged + 1e-6)
        gained = balance.air_mass[-1] - balance.air_mass[0]
        if name == "flexor":
            assert balance.air_drawn[-1] == pytest.approx(gained, rel=0.02) if device is PAIR else gained > 0.0


def test_work_of_both_devices_becomes_energy_of_the_lever() -> None:
    rollout = simulate(DEVICES, COMMANDS, numbers={**NUMBERS, "model.joint.joint.damping": 0.0})
    angle = read(rollout, "angle_joint")
    moment = read(rollout, "moment_joint")
    model = rollout.model
    data = mujoco.MjData(model)
    speed = np.gradient(angle, DT)
    energies = []
    for k in (0, 400):
        data.qpos[0], data.qvel[0] = angle[k], speed[k]
        mujoco.mj_forward(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        energies.append(data.energy.sum())
    work = np.trapezoid(moment[:401], angle[:401])
    assert angle[400] > angle[0] + 0.2
    assert energies[1] - energies[0] == pytest.approx(work, rel=5e-3)


def test_equal_mechanisms_share_compiled_models_and_nobody_changes_the_model_of_another() -> None:
    prescribed = tuple(f"pressure_command_{tendon}" for tendon in ("flexor", "extensor"))
    first, second = (Mechanism(load_model_file("antagonist_joint"), ("flexor", "extensor"), prescribed) for _ in "ab")
    devices = dict.fromkeys(("flexor", "extensor"), load_device("klute-3-4-pair").parameters)
    assembly._compile.cache_clear()
    models = [mechanism.compile(devices, {}, 1e-3) for mechanism in (first, second)]
    assert (assembly._compile.cache_info().hits, assembly._compile.cache_info().misses) == (1, 1)
    models[0].opt.timestep, models[0].actuator_user[:] = 2e-3, 0.0
    assert models[1].opt.timestep == second.compile(devices, {}, 1e-3).opt.timestep == 1e-3
    assert models[1].actuator_user.any()
    first.compile(devices, {"model.geom.load.mass": 2.0}, 1e-3)
    first.compile(devices, {}, 5e-4)
    assert assembly._compile.cache_info().misses == 3


def list_fields(model: mujoco.MjModel) -> dict[str, Array]:
    values = {name: getattr(model, name) for name in dir(model) if not name.startswith("_")}
    return {name: value for name, value in values.items() if isinstance(value, np.ndarray)}


@pytest.mark.parametrize("name", ["klute-3-4-pair", "klute-1-1-4-pair-valve"])
def test_model_of_another_device_equals_one_that_is_compiled_for_it(name: str) -> None:
    mechanism = Mechanism(load_model_file("antagonist_joint"), ("flexor", "extensor"), tuple(COMMANDS))
    device = load_device(name).parameters
    other = device._replace(tendon=device.tendon._replace(slack_length=device.tendon.slack_length + 0.01))
    models = []
    for first in (device, other):
        assembly._compile.cache_clear()
        mechanism.compile({"flexor": first, "extensor": first}, NUMBERS, DT, with_textures=False)
        models.append(mechanism.compile({"flexor": other, "extensor": device}, NUMBERS, DT, with_textures=False))
    expected = list_fields(models[1])
    assert len(expected) > 300
    for field, value in list_fields(models[0]).items():
        np.testing.assert_array_equal(value, expected[field], err_msg=field)


def test_textures_move_nothing() -> None:
    mechanism = Mechanism(load_model_file("antagonist_joint"), ("flexor", "extensor"), tuple(COMMANDS))
    devices = dict.fromkeys(("flexor", "extensor"), PAIR.parameters)
    drawn, plain = (mechanism.compile(devices, NUMBERS, DT, with_textures=textures) for textures in (True, False))
    assert drawn.ntex
    assert not plain.ntex
    for field in ("body_mass", "body_inertia", "body_ipos", "dof_damping", "tendon_length0", "actuator_user"):
        np.testing.assert_array_equal(getattr(drawn, field), getattr(plain, field))


def test_mechanism_begins_at_rest_in_equilibrium() -> None:
    constant = {name: np.full(800, values[0]) for name, values in COMMANDS.items()}
    angle = read(simulate(DEVICES, constant), "angle_joint")
    assert np.ptp(angle) < 1e-7


def test_driven_joint_follows_its_motion_and_shows_the_moment() -> None:
    angle = np.radians(30.0 + 25.0 * np.sin(2.0 * np.pi * 3.0 * TIME))
    rollout = simulate(DEVICES, {**COMMANDS, "angle_joint": angle})
    assert read(rollout, "angle_joint") == pytest.approx(angle, abs=1e-7)
    flexor, extensor = rollout.trace_device("flexor"), rollout.trace_device("extensor")
    assert read(rollout, "moment_joint") == pytest.approx(0.025 * (flexor.tension - extensor.tension), abs=1e-5)


def test_prescribed_pressure_replaces_the_supply() -> None:
    inputs = {"pressure_flexor": COMMANDS["pressure_command_flexor"], **COMMANDS}
    del inputs["pressure_command_flexor"]
    slow = VALVE.with_changes({"tendon.slack_length_mm": 60.0}).with_effect("pressure_delay", delay_s=0.05)
    rollout = simulate({"flexor": slow, "extensor": PAIR}, inputs)
    assert rollout.trace_device("flexor").pressure == pytest.approx(inputs["pressure_flexor"], rel=1e-9)


@pytest.mark.parametrize("delay_steps", [7.0, 7.4])
def test_delay_of_a_limited_command_delays_the_pressure(delay_steps: float) -> None:
    """The command leaves the range of the supply, so it is limited in pressure and in rate."""
    command = np.where(TIME < 0.1, 2e5, np.where(TIME < 0.25, 20e5, np.where(TIME < 0.4, -3e5, 4e5)))
    inputs = {**COMMANDS, "pressure_command_flexor": command}
    late = PAIR.with_effect("pressure_delay", delay_s=delay_steps * DT)
    prompt, delayed = (
        read(simulate({"flexor": device, "extensor": PAIR}, inputs), "pressure_flexor") for device in (PAIR, late)
    )
    index = np.arange(len(TIME), dtype=np.float64)
    kink = PAIR.parameters.supply.max_pressure_rate * DT  # between steps, a corner is cut by less than this
    assert delayed == pytest.approx(
        np.interp(index - delay_steps, index, prompt), abs=1e-6 if delay_steps == 7.0 else 0.3 * kink
    )
    assert np.ptp(prompt) == pytest.approx(PAIR.parameters.supply.max_pressure)


def test_dead_time_delays_a_command() -> None:
    late = PAIR.with_effect("pressure_delay", delay_s=0.05)
    shifted = {name: values[np.maximum(np.arange(1200) - 100, 0)] for name, values in COMMANDS.items()}
    first, second = simulate({"flexor": late, "extensor": late}, COMMANDS), simulate(DEVICES, shifted)
    assert read(first, "angle_joint") == pytest.approx(read(second, "angle_joint"), abs=1e-12)


def test_hanging_mass_is_carried_by_the_muscle() -> None:
    device = load_device("klute-1-1-4-pair")
    command = np.where(TIME < 0.1, 1.5e5, 3e5)
    rollout = simulate({"muscle": device}, {"pressure_command_muscle": command}, numbers={}, model="hanging_mass")
    position, force = read(rollout, "position_guide"), read(rollout, "force_muscle")
    assert force[0] == pytest.approx(20.0 * 9.81, rel=1e-6)
    assert position[-1] > position[0] + 0.005
    state = compute_equilibrium_state(device.parameters, 0.4 - position[0], 1.5e5)
    assert rollout.trace_device("muscle").length[0] == pytest.approx(state.length, rel=1e-6)


def test_external_moment_moves_the_joint_down() -> None:
    load = np.where(TIME < 0.1, 0.0, -3.0)
    loaded = simulate(DEVICES, {**COMMANDS, "external_moment_joint": load})
    free = step_response()
    assert np.array_equal(read(loaded, "angle_joint")[:200], read(free, "angle_joint")[:200])
    assert read(loaded, "angle_joint")[-1] < read(free, "angle_joint")[-1] - 0.05


def test_bare_muscle_ends_at_its_resting_length() -> None:
    device = load_device("klute-3-4")
    command = np.full(400, 5e4)
    numbers = {"model.site.muscle_origin.pos_z": 0.18, "model.geom.mass.mass": 60.0}
    rollout = simulate({"muscle": device}, {"pressure_command_muscle": command}, numbers=numbers, model="hanging_mass")
    assert rollout.trace_device("muscle").unit_length.max() < 0.181 + 2e-3


def test_recording_has_channels_of_every_joint_and_device() -> None:
    recording = record_mechanism(step_response(), DEVICES, {})
    for name in ("angle_joint", "moment_joint", "force_flexor", "pressure_extensor", "gas_power_flexor"):
        assert name in recording
    assert recording.units["angle_joint"] == "deg"
    assert recording["pressure_command_flexor"][-1] == pytest.approx(3.5)
    assert recording.provenance["rig"] == "mjcf"


@pytest.mark.parametrize(
    ("devices", "channels", "message"),
    [
        (("biceps",), (), "the device 'biceps' has no tendon"),
        ((), (), "no tendon has a device"),
        (("flexor",), (), "prescribe pressure_command_flexor or pressure_flexor"),
        (("flexor",), ("pressure_command_flexor", "pressure_flexor"), "cannot both be prescribed"),
        (("flexor",), ("pressure_command_flexor", "angle_knee"), "'angle_knee' belongs to no hinge joint"),
        (("flexor",), ("pressure_command_flexor", "position_joint"), "belongs to no slide joint"),
        (("flexor",), ("pressure_command_flexor", "angle_joint", "external_moment_joint"), "cannot both"),
        (("flexor",), ("pressure_command_extensor",), "belongs to no device"),
    ],
)
def test_bindings_are_refused_in_one_sentence(
    devices: tuple[str, ...], channels: tuple[str, ...], message: str
) -> None:
    with pytest.raises(InputError) as error:
        Mechanism(load_model_file("antagonist_joint"), devices, channels)
    assert message in str(error.value)


def test_joint_begins_with_the_stated_velocity() -> None:
    mechanism = Mechanism(load_model_file("antagonist_joint"), tuple(DEVICES), tuple(COMMANDS))
    parameters = {name: device.parameters for name, device in DEVICES.items()}
    positions = {"joint": 0.3}
    rollout = simulate_mechanism(
        mechanism,
        parameters,
        COMMANDS,
        DT,
        numbers=NUMBERS,
        initial_positions=positions,
        initial_velocities={"joint": 2.0},
    )
    angle = read(rollout, "angle_joint")
    assert angle[0] == pytest.approx(0.3)
    assert (angle[1] - angle[0]) / DT == pytest.approx(2.0, rel=0.02)
    with pytest.raises(InputError, match="joint 'elbow' cannot begin in motion; allowed: joint"):
        simulate_mechanism(
            mechanism, parameters, COMMANDS, DT, initial_positions=positions, initial_velocities={"elbow": 1.0}
        )


def test_divergence_is_one_sentence() -> None:
    numbers = {**NUMBERS, "model.joint.joint.stiffness": -1e9}
    with pytest.raises(SimulationError, match="diverges"):
        simulate(DEVICES, COMMANDS, numbers=numbers)


def test_inputs_are_checked() -> None:
    with pytest.raises(InputError, match="must be finite"):
        simulate(DEVICES, {**COMMANDS, "pressure_command_flexor": np.full(1200, np.nan)})
    with pytest.raises(InputError, match="equally many"):
        simulate(DEVICES, {**COMMANDS, "pressure_command_flexor": np.zeros(10)})
