"""Task of ``klute_sim/AntagonistJoint``: a joint between two muscles follows a target angle."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from klute_sim.controllers.pressure import load_default_profile
from klute_sim.device.device import Device
from klute_sim.device.equilibrium import compute_taut_state
from klute_sim.envs.base.task import CONTROL_INTERVAL, BatchStep
from klute_sim.envs.tasks.actions import ActionDecoder, select_action_kind
from klute_sim.envs.tasks.bench_trajectory import random_wave
from klute_sim.envs.tasks.device_ranges import PARAMETER_FIELD
from klute_sim.envs.tasks.joint_randomization import JointRandomizer, JointRanges
from klute_sim.errors import InputError
from klute_sim.mechanism.assembly import Mechanism
from klute_sim.mechanism.mounting import mount_devices
from klute_sim.plant import callbacks
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.plant.mjcf.model_file import load_model_file
from klute_sim.types import Array, Mask

MAX_DURATION = 600.0
"""Longest episode [s]."""
TENDONS = ("flexor", "extensor")
"""Tendons of the model, in the order of the actions."""
JOINT = "joint"
"""Name of the joint."""
LOAD_NUMBER = "model.geom.load.mass"
"""Number of the model that the option ``load`` changes."""
MIN_LOAD, MAX_LOAD = 0.01, 100.0
"""Limits of the load [kg]."""
MAX_FREQUENCY = 1.0
"""Highest frequency of the target angle [Hz]."""
RANGE_FRACTION = 0.6
"""Range of the target angle over that of the joint."""
BLEND_TIME = 0.5
"""Time in which the target moves from the initial angle to its random trajectory [s]."""
INITIAL_PRESSURE_FRACTIONS = 0.3, 0.6
"""Range of the initial pressures over the pressure of the supply."""
ANGLE_ERROR_SCALE = np.radians(5.0)
"""Error of the angle at which the reward falls to exp(-1/2) [rad]."""
SMOOTHNESS_WEIGHT = -0.05
"""Reward per squared change of the actions, summed over both."""
REWARD_TERMS = ("reward_angle", "reward_smoothness")
"""Terms of the reward, as ``info`` names them."""
MAX_STORED_TARGETS = 10_000_000
"""Largest number of target angles of all simulations together."""

OBSERVATIONS = (
    # name, unit, lowest, highest
    ("angle", "rad", -4.0, 4.0),
    ("angular velocity", "rad/s", -50.0, 50.0),
    ("target angle", "rad", -4.0, 4.0),
    ("rate of the target angle", "rad/s", -50.0, 50.0),
    ("gauge pressure of the flexor", "bar", 0.0, 20.0),
    ("gauge pressure of the extensor", "bar", 0.0, 20.0),
)
"""Name, unit, lowest and highest value of each observation; values outside are clipped."""


@dataclass(frozen=True, kw_only=True)
class JointOptions:
    """Options of the task, validated at construction."""

    duration: float = 5.0
    """Duration of an episode [s]."""
    time_step: float = 5e-4
    """Time step [s]."""
    load: float | None = None
    """Mass at the end of the lever [kg]; None: that of the model."""
    ranges: JointRanges = field(default_factory=JointRanges)
    """Ranges from which each episode draws."""

    def __post_init__(self) -> None:
        """Raise InputError when an option is invalid."""
        if not CONTROL_INTERVAL <= self.duration <= MAX_DURATION:
            raise InputError(f"duration is {self.duration:g} s; allowed: {CONTROL_INTERVAL:g} to {MAX_DURATION:g} s")
        steps = CONTROL_INTERVAL / self.time_step if self.time_step > 0.0 else 0.0
        if not (np.isfinite(steps) and round(steps) >= 1 and abs(round(steps) * self.time_step - 0.01) < 1e-9):
            raise InputError(f"time_step is {1e3 * self.time_step:g} ms; allowed: divisors of 10 ms")
        loads = {"load": (() if self.load is None else (self.load,)), "load_kg": self.ranges.load_kg or ()}
        for name, masses in loads.items():
            for mass in masses:
                if not MIN_LOAD <= mass <= MAX_LOAD:
                    raise InputError(f"{name} is {mass:g} kg; allowed: {MIN_LOAD:g} to {MAX_LOAD:g} kg")

    @property
    def steps_per_action(self) -> int:
        """Return the number of steps in an interval."""
        return round(CONTROL_INTERVAL / self.time_step)

    @property
    def actions_per_episode(self) -> int:
        """Return the number of intervals of an episode."""
        return round(self.duration / CONTROL_INTERVAL)


@dataclass
class JointStates:
    """Arrays of ``n`` simulations at the end of an interval, named as in MuJoCo."""

    qpos: Array
    qvel: Array
    act: Array
    actuator_force: Array


class JointTask:
    """Target angle, observation and reward of ``n_simulations`` joints with a device on each tendon."""

    states_type: type = JointStates
    observation_rows: Sequence[tuple[Any, ...]] = OBSERVATIONS
    n_actions = len(TENDONS)
    step_recorder = None

    def __init__(self, devices: Mapping[str, Device], options: JointOptions, n_simulations: int, backend: str) -> None:
        """Set up the task with ``devices`` (tendon -> device) and a ``backend``, ``compiled`` or ``python``."""
        self._options, self._backend, self._indices = options, backend, np.arange(n_simulations)
        n_targets = n_simulations * (2 + options.actions_per_episode)
        if n_targets > MAX_STORED_TARGETS:
            raise InputError(
                f"{n_simulations} simulations of {options.duration:g} s have {n_targets:.3g} targets; allowed: "
                f"{MAX_STORED_TARGETS:.3g}"
            )
        file = load_model_file("antagonist_joint")
        mechanism = Mechanism(file, TENDONS, tuple(f"pressure_command_{name}" for name in TENDONS))

        def compile_model(mounted: Mapping[str, Device], load: float | None) -> mujoco.MjModel:
            parameters = {name: device.parameters for name, device in mounted.items()}
            numbers = mount_devices(file, mounted) | ({} if load is None else {LOAD_NUMBER: load})
            return mechanism.compile(parameters, numbers, options.time_step)

        self._randomizer = JointRandomizer(devices, options.ranges, options.load, compile_model)
        self.varying_fields: Sequence[str] = self._randomizer.varying_fields
        self.model = self._randomizer.model
        """MuJoCo model of the joint with both devices."""
        self._actuator_names = {name: mechanism.find_actuator(self.model, name) for name in TENDONS}
        self.actuators = tuple(DeviceActuator(self.model, name) for name in self._actuator_names.values())
        """Devices in the model."""
        self.failure_address, self.max_episode_steps = self.actuators[0].act_address, options.actions_per_episode
        self._decoders = tuple(
            ActionDecoder(
                select_action_kind(None, actuator.parameters.supply.command_is_opening != 0.0, devices[name].name),
                actuator.parameters,
                load_default_profile(),
                1.0,
                n_simulations,
                options.steps_per_action,
                options.time_step,
            )
            for name, actuator in zip(TENDONS, self.actuators, strict=True)
        )
        low, high = self.model.joint(JOINT).range
        self._middle, self._amplitude = 0.5 * (low + high), 0.5 * RANGE_FRACTION * (high - low)
        self._lower, self._upper = (np.array([row[k] for row in OBSERVATIONS]) for k in (2, 3))
        # One more than there are observations: the rate of the last one needs it.
        self._target = np.zeros((n_simulations, 2 + options.actions_per_episode))
        self.elapsed_intervals = np.zeros(n_simulations, dtype=np.int64)
        """Number of intervals since the reset."""
        self._previous_actions = np.zeros((n_simulations, len(TENDONS)))
        self._observations = np.zeros((n_simulations, len(OBSERVATIONS)), dtype=np.float32)

    @property
    def observations(self) -> NDArray[np.float32]:
        """Return a copy of the observations, shape (n, 6); see :data:`OBSERVATIONS`."""
        return self._observations.copy()

    def start_episode(
        self, index: int, model: mujoco.MjModel, data: mujoco.MjData, rng: np.random.Generator
    ) -> Mapping[str, float]:
        """Sample the target of simulation ``index`` and set ``data`` to a joint at rest with random pressures."""
        actuator_ids = {name: actuator.id for name, actuator in zip(TENDONS, self.actuators, strict=True)}
        sampled = self._randomizer.draw(model, actuator_ids, rng)
        angle = self._middle + self._amplitude * rng.uniform(-0.5, 0.5)
        time: Array = CONTROL_INTERVAL * np.arange(self._target.shape[1], dtype=np.float64)
        wave = self._middle + self._amplitude * random_wave(time, MAX_FREQUENCY, rng)
        self._target[index] = angle + (wave - angle) * np.minimum(time / BLEND_TIME, 1.0)
        mujoco.mj_resetData(model, data)
        data.joint(JOINT).qpos[0] = angle
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_tendon(model, data)
        for name, nominal in zip(TENDONS, self.actuators, strict=True):
            varies = PARAMETER_FIELD in self.varying_fields
            actuator = DeviceActuator(model, self._actuator_names[name]) if varies else nominal
            supply = actuator.parameters.supply
            pressure = rng.uniform(*INITIAL_PRESSURE_FRACTIONS) * supply.max_pressure
            state = compute_taut_state(actuator.parameters, float(data.tendon(name).length[0]), pressure)
            actuator.set_state(data, state)
            actuator.set_command(data, 0.0 if supply.command_is_opening != 0.0 else state.pressure)
        with callbacks.device_callbacks(self._backend, is_isolated=True):
            mujoco.mj_forward(model, data)
        return sampled

    def reset(self, mask: Mask, states: JointStates) -> None:
        """Reset the observations of the simulations in ``mask``."""
        self.elapsed_intervals[mask] = 0
        for k, (decoder, actuator) in enumerate(zip(self._decoders, self.actuators, strict=True)):
            holding_action = decoder.reset(mask, states.act[:, actuator.act_address])
            self._previous_actions[mask, k] = holding_action[mask]
        self._observe(mask, states)

    def schedule_controls(self, actions: Array, mask: Mask) -> Array:
        """Return the controls (n, steps, nu) of the simulations in ``mask`` for ``actions`` (all simulations, 2)."""
        controls = np.zeros((int(mask.sum()), self._options.steps_per_action, self.model.nu))
        for k, (decoder, actuator) in enumerate(zip(self._decoders, self.actuators, strict=True)):
            command = decoder.decode(np.clip(actions[:, k], -1.0, 1.0), np.zeros(len(actions)))
            start = 0
            for count, scheduled_command in decoder.schedule_commands(command, mask):
                controls[:, start : start + count, actuator.ctrl_address] = scheduled_command[mask, None]
                start += count
        return controls

    def evaluate(self, actions: Array, states: JointStates, mask: Mask) -> BatchStep:
        """Return the result of the interval that ends now; only the simulations in ``mask`` advance."""
        self.elapsed_intervals += mask
        self._observe(mask, states)
        actions = np.clip(actions, -1.0, 1.0)
        change = actions - self._previous_actions
        self._previous_actions[mask] = actions[mask]
        error = states.qpos[:, 0] - self._target[self._indices, self.elapsed_intervals]
        is_finite: Mask = np.isfinite(states.qpos.sum(axis=1) + states.act.sum(axis=1))
        is_valid = is_finite & mask
        angle_reward = np.where(is_valid, np.exp(-0.5 * (error / ANGLE_ERROR_SCALE) ** 2), 0.0)
        smoothness_reward = np.where(is_valid, SMOOTHNESS_WEIGHT * (change[:, 0] ** 2 + change[:, 1] ** 2), 0.0)
        terms = dict(zip(REWARD_TERMS, (angle_reward, smoothness_reward), strict=True))
        info = {
            "angle_error_deg": np.degrees(error),
            **{
                f"force_{name}_n": -states.actuator_force[:, actuator.out_address]
                for name, actuator in zip(TENDONS, self.actuators, strict=True)
            },
        }
        truncated = mask & is_finite & (self.elapsed_intervals >= self._options.actions_per_episode)
        return BatchStep(angle_reward + smoothness_reward, mask & ~is_finite, truncated, {**terms, **info})

    def _observe(self, mask: Mask, states: JointStates) -> None:
        now = self.elapsed_intervals
        target = self._target[self._indices, now]
        observations = np.column_stack(
            [
                states.qpos[:, 0],
                states.qvel[:, 0],
                target,
                (self._target[self._indices, now + 1] - target) / CONTROL_INTERVAL,
                *(states.act[:, actuator.act_address] for actuator in self.actuators),
            ]
        )
        if not np.isfinite(observations.sum()):  # the last observation of an episode that failed
            observations = np.nan_to_num(observations)
        self._observations[mask] = np.clip(observations, self._lower, self._upper)[mask]
