"""Simulate a mechanism under prescribed pressures, motion and loads.

MuJoCo advances the model with its own compiled loop (:mod:`mujoco.batch`), in which the devices run as compiled
callbacks; the Python backend takes the same steps one by one. Both give the same bits. Sample k belongs to the start of
step k: positions are those before the step, forces those that MuJoCo evaluated there, and the devices are as the step
balanced them, which is how the bench records them.
"""

import threading
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any, NamedTuple

import mujoco
import numpy as np

from klute_sim.device.dynamics import (
    N_INTERNAL_STATES,
    DeviceParameters,
    get_dead_time,
)
from klute_sim.device.rollout import MAX_TIME_STEP
from klute_sim.effects import catalogue
from klute_sim.errors import InputError, SimulationError, suggest
from klute_sim.laws import pneumatic_step, pneumatics
from klute_sim.laws.pneumatics import SupplyParameters
from klute_sim.mechanism import drives
from klute_sim.mechanism.assembly import Binding, Mechanism
from klute_sim.mechanism.rest import move_to_rest
from klute_sim.plant import callbacks
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.plant.batch import create_batch, step_batch
from klute_sim.plant.coupling import N_BASE_STATES
from klute_sim.plant.mjcf.model_effects import ModelEffect, list_resistance_actuators
from klute_sim.plant.mujoco_warnings import silence_warnings
from klute_sim.types import Array
from klute_sim.units import BAR

RECORDED_FIELDS = (
    *("qpos", "act", "actuator_length", "actuator_velocity", "actuator_force", "qfrc_actuator"),
    *("sensordata", "site_xpos"),
)
"""Fields of MjData that are recorded after every step."""
MAX_STEPS = 2_000_000
"""Largest number of steps of one simulation: 1000 s at 0.5 ms."""
MAX_RECORDED_VALUES = 200_000_000
"""Largest number of recorded values (1.6 GB)."""
UNLIMITED_PRESSURE, UNLIMITED_PRESSURE_RATE = 1e9, 1e15
"""Pressure [Pa] and rate [Pa/s] that a device with a prescribed pressure never reaches."""
SUPPLY_HOOKS = frozenset({"supply", "pressure_target", "pressure_reached", "next_state"})
"""Hooks of effects that act between the command and the pressure in the muscle; a dead time has no hook."""
DIVERGENCE_HINT = "use a shorter time step, and check the numbers, stops and contacts of the model"
"""How to fix a model that diverges."""
_python_lock = threading.Lock()
"""Held by the only simulation that runs on the Python backend."""


class DeviceTrace:
    """States of one device in a rollout, one value per step; SI."""

    def __init__(self, rollout: "MechanismRollout", name: str) -> None:
        """Read the device ``name`` from ``rollout``."""
        actuator = DeviceActuator(rollout.model, rollout.mechanism.find_actuator(rollout.model, name))
        act, start = rollout.fields["act"], actuator.act_address
        resting_length = actuator.parameters.muscle.resting_length
        self.parameters = actuator.parameters
        """Parameters."""
        self.pressure: Array = act[:, start] * BAR
        """Gauge pressure in the muscle [Pa]."""
        self.length: Array = act[:, start + 1] + resting_length
        """Muscle length [m]."""
        initial_length = rollout.initial_act[start + 1] + resting_length
        self.velocity: Array = np.diff(self.length, prepend=initial_length) / rollout.dt
        """Muscle velocity in the step [m/s]."""
        self.internal_states = np.zeros((len(act), N_INTERNAL_STATES))
        """Internal states (steps, N_INTERNAL_STATES)."""
        if actuator.n_states > N_BASE_STATES:
            self.internal_states[:] = act[:, start + N_BASE_STATES : start + actuator.n_states]
        self.unit_length: Array = np.ascontiguousarray(rollout.fields["actuator_length"][:, actuator.out_address])
        """Length of the muscle-tendon unit [m]."""
        unit_velocity = rollout.fields["actuator_velocity"][:, actuator.out_address]
        self.tension: Array = (
            actuator.damping * unit_velocity * np.abs(unit_velocity)
            - rollout.fields["actuator_force"][:, actuator.out_address]
        )
        """Tension of the muscle-tendon unit [N]."""


@dataclass(frozen=True, eq=False)
class MechanismRollout:
    """A simulated mechanism."""

    mechanism: Mechanism
    """The mechanism."""
    model: mujoco.MjModel
    """The compiled model."""
    dt: float
    """Time step [s]."""
    inputs: Mapping[str, Array]
    """Prescribed channel -> value at the start of each step [SI]."""
    fields: Mapping[str, Array]
    """Field of MjData -> values (steps, ...) after each step."""
    initial_qpos: Array
    """Positions at the start."""
    initial_act: Array
    """States of the actuators at the start."""
    backend: str
    """Backend that ran."""

    @property
    def time(self) -> Array:
        """Time of each sample [s], from 0."""
        return self.dt * np.arange(len(self.fields["qpos"]), dtype=np.float64)

    def trace_device(self, name: str) -> DeviceTrace:
        """Return the states of device ``name``."""
        return DeviceTrace(self, name)

    def read_channel(self, binding: Binding) -> Array:
        """Return the channel of ``binding`` [SI], one value per step."""
        quantity, name = binding.channel.quantity, binding.name
        if quantity in ("pressure_command", "external_moment", "external_force"):
            return self.inputs[binding.channel.name]
        if quantity in ("angle", "position"):
            address = int(self.model.joint(name).qposadr[0])
            values = self.fields["qpos"][:, address]
            return np.concatenate([[self.initial_qpos[address]], values[:-1]])
        if quantity == "moment":
            return self._compute_moment(name)
        if quantity.startswith("site_"):
            return np.ascontiguousarray(
                self.fields["site_xpos"][:, self.model.site(name).id, "xyz".index(quantity[-1])]
            )
        if quantity.startswith("sensor_"):
            sensor = int(self.model.sensor(name).adr[0])
            return np.ascontiguousarray(self.fields["sensordata"][:, sensor + binding.component])
        trace = self.trace_device(name)
        series = {
            **{"pressure": trace.pressure, "force": trace.tension},
            **{"muscle_length": trace.length, "unit_length": trace.unit_length},
        }
        return series[quantity]

    def _compute_moment(self, joint: str) -> Array:
        """Return the moment [N m] of all actuators about ``joint``, without its drive, its load and its friction."""
        moment: Array = self.fields["qfrc_actuator"][:, int(self.model.joint(joint).dofadr[0])].copy()
        names = {self.model.actuator(index).name: index for index in range(self.model.nactuator)}
        for name in (drives.name_drive(joint), drives.name_load(joint), *list_resistance_actuators(joint)):
            if name in names:
                moment -= self.fields["actuator_force"][:, int(self.model.actuator_outadr[names[name]])]
        return moment


def simulate_mechanism(
    mechanism: Mechanism,
    devices: Mapping[str, DeviceParameters],
    inputs: Mapping[str, Array],
    dt: float,
    *,
    numbers: Mapping[str, float] | None = None,
    initial_positions: Mapping[str, float] | None = None,
    initial_velocities: Mapping[str, float] | None = None,
    initial_pressures: Mapping[str, float] | None = None,
    effects: Sequence[ModelEffect] = (),
    backend: str = "auto",
) -> MechanismRollout:
    """Simulate ``mechanism`` with ``devices`` (name -> parameters) under ``inputs``, one sample per step ``dt`` [s].

    ``inputs`` holds every prescribed channel [SI]. The simulation starts at rest in equilibrium under the first
    samples; it is sought from ``initial_positions`` (joint -> m or rad) or from the model's own position. A joint of
    ``initial_positions`` with dry friction begins there if its friction can hold it (:func:`move_to_rest`). A joint of
    ``initial_velocities`` (joint -> m/s or rad/s) starts at its initial position with this velocity instead, and the
    devices start as if the joints had rested there under ``initial_pressures`` (device -> Pa; default: the first
    inputs). Raises InputError for such a joint without an initial position, or one that is driven. ``numbers``
    changes numbers of the model, and ``effects`` are those of joints, pulleys and gravity. ``backend`` is ``"auto"``,
    ``"compiled"`` or ``"python"``.

    Raises InputError when an input is missing, not finite or of another length, or ``dt`` is out of range, and
    SimulationError when the model diverges.
    """
    n_steps = _check_inputs(mechanism, inputs, dt)
    parameters = {
        name: make_pressure_prescribed(device) if _has_prescribed_pressure(mechanism, name) else device
        for name, device in devices.items()
    }
    # Python callbacks of one thread would keep other threads from compiling their models.
    with _python_lock if callbacks.choose_backend(backend) == "python" else nullcontext():
        model = mechanism.compile(parameters, numbers or {}, dt, effects, with_textures=False)
        data = mujoco.MjData(model)
        if n_steps * sum(getattr(data, field).size for field in RECORDED_FIELDS) > MAX_RECORDED_VALUES:
            raise InputError(
                f"{mechanism.file.path}: {n_steps} steps of {1e3 * dt:g} ms, {model.nq} positions and {model.nsite} "
                "sites are too many to record; use a longer time step, shorter trials or a smaller model"
            )
        actuators = {name: DeviceActuator(model, mechanism.find_actuator(model, name)) for name in devices}
        _place_joints(model, data, initial_positions or {})
        moving = _check_moving_joints(mechanism, initial_positions or {}, initial_velocities or {})
        schedule = _schedule_controls(mechanism, model, actuators, inputs, n_steps)
        schedule.initial_pressures.update(initial_pressures or {})
        for name, position in schedule.initial_positions.items():
            data.joint(name).qpos[0] = position
        try:
            with silence_warnings(), callbacks.device_callbacks(backend) as used_backend:
                held = *mechanism.driven_joints, *moving
                known = (initial_positions or {}).keys()
                move_to_rest(model, data, actuators, schedule.initial_pressures, schedule.resting_controls, held, known)
                for name, speed in {**schedule.initial_speeds, **moving}.items():
                    data.joint(name).qvel[0] = speed
                initial_qpos, initial_act = data.qpos.copy(), data.act.copy()
                run = _run_compiled if used_backend == "compiled" else _run_in_python
                fields, has_failed = run(model, data, schedule.controls)
        except SimulationError as error:  # a device notices first that its length is not finite
            raise SimulationError(f"the model {mechanism.file.path} diverges: {error}; {DIVERGENCE_HINT}") from None
    if has_failed or not all(np.isfinite(values).all() for values in fields.values()):
        raise SimulationError(f"the model {mechanism.file.path} diverges: {_describe_failure(fields, dt)}")
    return MechanismRollout(
        mechanism,
        model,
        dt,
        {name: np.asarray(values) for name, values in inputs.items()},
        fields,
        initial_qpos,
        initial_act,
        used_backend,
    )


def _check_moving_joints(
    mechanism: Mechanism, positions: Mapping[str, float], velocities: Mapping[str, float]
) -> dict[str, float]:
    for name in velocities:
        if name not in positions or name in mechanism.driven_joints:
            allowed = [joint for joint in positions if joint not in mechanism.driven_joints]
            raise InputError(
                f"joint '{name}' cannot begin in motion; {suggest(name, allowed, 'allowed: ' + ', '.join(allowed))} "
                "(joints with an initial position that are not driven)"
            )
    return dict(velocities)


class _Schedule(NamedTuple):
    """Controls of a rollout, and the start that belongs to them."""

    controls: Array
    """Controls (steps, nu)."""
    resting_controls: Array
    """Controls (nu) under which the mechanism rests at the start."""
    initial_pressures: dict[str, float]
    """Device -> command or pressure at the start [Pa]."""
    initial_positions: dict[str, float]
    """Driven joint -> position at the start [m or rad]."""
    initial_speeds: dict[str, float]
    """Driven joint -> speed before the first step [m/s or rad/s]."""


def _schedule_controls(
    mechanism: Mechanism,
    model: mujoco.MjModel,
    actuators: Mapping[str, DeviceActuator],
    inputs: Mapping[str, Array],
    n_steps: int,
) -> _Schedule:
    """Return the controls that impose ``inputs`` on ``model``."""
    dt = model.opt.timestep
    schedule = _Schedule(np.zeros((n_steps, model.nu)), np.zeros(model.nu), {}, {}, {})
    for name, binding in mechanism.bindings.items():
        values, quantity = np.asarray(inputs[name], dtype=np.float64), binding.channel.quantity
        if quantity in ("pressure", "pressure_command"):
            actuator = actuators[binding.name]
            control, delayed = actuator.ctrl_address, _delay_command(values, actuator.parameters, dt)
            is_opening = actuator.parameters.supply.command_is_opening != 0.0
            schedule.controls[:, control] = delayed if is_opening else delayed / BAR
            schedule.resting_controls[control] = schedule.controls[0, control]
            schedule.initial_pressures[binding.name] = float(values[0])
            continue
        is_driven = quantity in ("angle", "position")
        name_actuator = drives.name_drive if is_driven else drives.name_load
        control = int(model.actuator_ctrladr[model.actuator(name_actuator(binding.name)).id])
        schedule.controls[:, control] = (
            drives.compute_drive_commands(values, dt, model.opt.integrator) if is_driven else values
        )
        schedule.resting_controls[control] = values[0]
        if is_driven:
            schedule.initial_positions[binding.name] = float(values[0])
            schedule.initial_speeds[binding.name] = drives.compute_initial_speed(values, dt)
    return schedule


def make_pressure_prescribed(parameters: DeviceParameters) -> DeviceParameters:
    """Return the device with a supply that imposes the commanded pressure in every step, without effects of a supply.

    What was measured in the muscle has passed the supply already.
    """
    supply = SupplyParameters(
        max_pressure=UNLIMITED_PRESSURE,
        max_pressure_rate=UNLIMITED_PRESSURE_RATE,
        temperature=parameters.supply.temperature,
        dead_volume=parameters.supply.dead_volume,
    )
    effects = catalogue.select_effects(parameters.effects, lambda slot: not set(slot.form.laws) <= SUPPLY_HOOKS)
    return parameters._replace(supply=supply, effects=effects)


def _has_prescribed_pressure(mechanism: Mechanism, device: str) -> bool:
    return any(
        binding.name == device and binding.channel.quantity == "pressure" for binding in mechanism.bindings.values()
    )


def _check_inputs(mechanism: Mechanism, inputs: Mapping[str, Array], dt: float) -> int:
    """Return the number of steps; raise InputError for inputs that cannot be simulated."""
    if not 0.0 < dt <= MAX_TIME_STEP:
        raise InputError(f"the time step is {1e3 * dt:g} ms; allowed: above 0, up to {1e3 * MAX_TIME_STEP:g} ms")
    for name in mechanism.prescribed:
        if name not in inputs:
            raise InputError(f"the prescribed channel '{name}' has no samples; prescribed: {', '.join(inputs)}")
        if not np.isfinite(inputs[name]).all():
            raise InputError(f"the prescribed channel '{name}' must be finite everywhere")
    lengths = {len(inputs[name]) for name in mechanism.prescribed}
    if len(lengths) != 1 or not 2 <= max(lengths) <= MAX_STEPS:
        raise InputError(
            f"the prescribed channels have {', '.join(map(str, sorted(lengths)))} samples; allowed: equally many, 2 to "
            f"{MAX_STEPS}"
        )
    return int(lengths.pop())


def _place_joints(model: mujoco.MjModel, data: mujoco.MjData, positions: Mapping[str, float]) -> None:
    for name, value in positions.items():
        joint = model.joint(name)
        low, high = model.jnt_range[joint.id] if model.jnt_limited[joint.id] else (-np.inf, np.inf)
        data.qpos[joint.qposadr[0]] = np.clip(value, low, high)


def _delay_command(values: Array, parameters: DeviceParameters, dt: float) -> Array:
    """Return the command ``values`` later by the dead time, as :class:`klute_sim.device.delay.DelayLine` does.

    A supply that only limits pressure and rate limits the command before its delay, which gives the same pressure
    (:func:`klute_sim.laws.pneumatics.regulate`): a command changes at the start of a step, a delayed one does not, and
    its limited pressure would change too early.
    """
    delay_steps, supply = get_dead_time(parameters) / dt, parameters.supply
    if delay_steps == 0.0:
        return values
    supply_effects = catalogue.select_effects(
        parameters.effects, lambda slot: not SUPPLY_HOOKS.isdisjoint(slot.form.laws)
    )
    if pneumatic_step.is_ideal(supply) and not any(supply_effects):
        values = _regulate(values, supply, dt)
    index = np.arange(len(values), dtype=np.float64)
    return np.interp(index - delay_steps, index, values)


def _regulate(values: Array, supply: SupplyParameters, dt: float) -> Array:
    """Return the pressure [Pa] of an ideal regulator that starts at the first of the commands ``values`` [Pa]."""
    pressures, pressure = np.empty(len(values)), min(max(float(values[0]), 0.0), supply.max_pressure)
    for index, command in enumerate(values.tolist()):
        pressures[index] = pressure = pneumatics.regulate(supply, pressure, command, dt)
    return pressures


def _run_compiled(model: mujoco.MjModel, data: mujoco.MjData, controls: Array) -> tuple[dict[str, Array], bool]:
    batch = create_batch(model, 1, 1)
    for name in ("qpos", "qvel", "act", "ctrl"):
        batch.bind(name)[0] = getattr(data, name)
    fields = {name: np.zeros((1, len(controls), *getattr(data, name).shape)) for name in RECORDED_FIELDS}
    step_batch(batch, None, len(controls), controls[None], record=fields)
    return {name: values[0] for name, values in fields.items()}, bool(np.any(batch.warning[0]))


def _run_in_python(model: mujoco.MjModel, data: mujoco.MjData, controls: Array) -> tuple[dict[str, Array], bool]:
    fields: dict[str, Any] = {name: np.zeros((len(controls), *getattr(data, name).shape)) for name in RECORDED_FIELDS}
    for step, control in enumerate(controls):
        data.ctrl[:] = control
        callbacks.step_model(model, data)
        for name, values in fields.items():
            values[step] = getattr(data, name)
        if any(warning.number for warning in data.warning):
            return fields, True
    return fields, False


def _describe_failure(fields: Mapping[str, Array], dt: float) -> str:
    """Return when a failed simulation stopped moving or became infinite, and what to do."""
    qpos = fields["qpos"]
    moved = np.flatnonzero(np.any(np.diff(qpos, axis=0) != 0.0, axis=1) & np.isfinite(qpos[1:]).all(axis=1))
    last = int(moved[-1]) + 1 if len(moved) else 0
    return f"its motion is not finite after t = {dt * last:.4g} s; {DIVERGENCE_HINT}"
