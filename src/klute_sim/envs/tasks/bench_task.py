"""Task of ``klute_sim/AnkleBench``: observations, reward and termination of many simulations at once.

Every quantity is an array with one entry per simulation, so a single environment and a batch share this code.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from klute_sim.bench.build import build_tester, compute_servo_commands, place_crosshead
from klute_sim.controllers.pressure import load_default_profile
from klute_sim.device.device import Device
from klute_sim.device.dynamics import compute_tension
from klute_sim.device.equilibrium import compute_taut_state
from klute_sim.envs.base.task import CONTROL_INTERVAL, BatchStep
from klute_sim.envs.tasks.actions import ActionDecoder, select_action_kind
from klute_sim.envs.tasks.bench_trajectory import TrajectoryGenerator
from klute_sim.envs.tasks.energy_accounting import DeviceStates, EnergyAccounting
from klute_sim.errors import InputError
from klute_sim.plant import callbacks
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.types import Array, Mask
from klute_sim.units import BAR

MAX_DURATION = 600.0
"""Longest episode [s]."""
MAX_STORED_LENGTHS = 100_000_000
"""Maximum number of prescribed lengths of all simulations together; they take 0.8 GB."""

BENCH_TASKS: Mapping[str, str] = MappingProxyType(
    {
        "force": "pull with a force that changes smoothly at random while the crosshead moves likewise",
        "work": "do as much work per gram of air as possible over a cycle of the crosshead",
    }
)
"""Tasks with their meaning."""

OBSERVATIONS = (
    # name, unit, lowest, highest
    ("length of the unit beyond the middle of its travel", "cm", -20.0, 20.0),
    ("velocity of the unit, lengthening positive", "m/s", -5.0, 5.0),
    ("force on the load cell, pulling positive", "kN", -20.0, 20.0),
    ("gauge pressure", "bar", 0.0, 20.0),
    ("target force; 0 in the task work", "kN", 0.0, 20.0),
)
"""Name, unit, lowest and highest value of each observation; values outside are clipped."""

FORCE_ERROR_SCALE = 0.05
"""Force error at which the reward falls to exp(-1/2), over the maximum force."""
AIR_MASS_OFFSET_G = 0.1
"""Air mass added to that of a cycle [g], which keeps the reward of work without air finite."""
WORK_REWARD_WEIGHT = 0.1
"""Reward of a cycle per J/g."""
SMOOTHNESS_WEIGHT = -0.05
"""Reward per squared change of the action."""


@dataclass(frozen=True, kw_only=True)
class BenchOptions:
    """Options of the task, validated at construction."""

    task: str = "force"
    """One of :data:`BENCH_TASKS`."""
    duration: float = 5.0
    """Duration of an episode [s]."""
    cycle_duration: float = 1.0
    """Duration of a cycle of the task *work* [s]."""
    time_step: float = 5e-4
    """Time step [s]."""

    def __post_init__(self) -> None:
        """Raise InputError when an option is invalid."""
        if self.task not in BENCH_TASKS:
            raise InputError(f"task is '{self.task}'; allowed: {', '.join(BENCH_TASKS)}")
        _ = self.steps_per_action, self.actions_per_cycle
        if not self.cycle_duration <= self.duration <= MAX_DURATION:
            raise InputError(
                f"duration is {self.duration:g} s; allowed: a cycle ({self.cycle_duration:g} s) to {MAX_DURATION:g} s"
            )

    @property
    def steps_per_action(self) -> int:
        """Return the number of time steps of an interval."""
        return _count_intervals("time_step", CONTROL_INTERVAL, self.time_step, "divisors of 10 ms")

    @property
    def actions_per_cycle(self) -> int:
        """Return the number of intervals of a cycle."""
        return _count_intervals(
            "cycle_duration", self.cycle_duration, CONTROL_INTERVAL, "multiples of 10 ms from 100 ms", min_count=10
        )

    @property
    def actions_per_episode(self) -> int:
        """Return the number of intervals of an episode."""
        return round(self.duration / CONTROL_INTERVAL)


@dataclass
class TesterStates:
    """Arrays of ``n`` simulations at the end of an interval, named as in MuJoCo."""

    qpos: Array
    act: Array
    act_dot: Array
    sensordata: Array
    actuator_length: Array
    actuator_velocity: Array


class BenchTask:
    """Trajectory, observation and evaluation of ``n_simulations`` testers with one device."""

    states_type: type = TesterStates
    varying_fields: Sequence[str] = ()
    observation_rows: Sequence[tuple[Any, ...]] = OBSERVATIONS
    n_actions = 1

    def __init__(self, device: Device, options: BenchOptions, n_simulations: int, backend: str) -> None:
        """Set up the task with a ``backend``, ``compiled`` or ``python``."""
        self._options, self._backend, self._indices = options, backend, np.arange(n_simulations)
        self._steps_per_action = options.steps_per_action
        self.model = build_tester(device, options.time_step)
        """MuJoCo model of the tester including the device."""
        self.actuator = DeviceActuator(self.model, "muscle_tendon")
        """Device in the model."""
        self.failure_address, self.max_episode_steps = self.actuator.act_address, options.actions_per_episode
        parameters = self.actuator.parameters
        self.servo_ctrl_address = int(self.model.actuator_ctrladr[self.model.actuator("servo").id])
        """Index of the servo's command in ``data.ctrl``."""
        self._load_cell_index = int(self.model.sensor("load_cell").adr[0])
        self.trajectory_generator = TrajectoryGenerator(
            device,
            options.task,
            options.actions_per_episode,
            CONTROL_INTERVAL,
            options.time_step,
            options.cycle_duration,
        )
        """Random generator of the prescribed lengths and target forces."""
        self._command_is_opening = parameters.supply.command_is_opening != 0.0
        self._action_decoder = ActionDecoder(
            select_action_kind(None, self._command_is_opening, device.name),
            parameters,
            load_default_profile(),
            1.0,
            n_simulations,
            options.steps_per_action,
            options.time_step,
        )
        self._energy = EnergyAccounting(parameters, n_simulations, backend)
        self._lower, self._upper = (np.array([row[k] for row in OBSERVATIONS]) for k in (2, 3))
        n_actions, n_lengths = options.actions_per_episode, 1 + options.actions_per_episode * options.steps_per_action
        if n_simulations * n_lengths > MAX_STORED_LENGTHS:
            raise InputError(
                f"{n_simulations} simulations of {options.duration:g} s have {n_simulations * n_lengths:.3g} steps; "
                f"allowed: {MAX_STORED_LENGTHS:.3g}"
            )
        self._servo_commands = np.zeros((n_simulations, n_lengths))
        self._target_force = np.zeros((n_simulations, 1 + n_actions))
        self.elapsed_intervals = np.zeros(n_simulations, dtype=np.int64)
        """Number of intervals since the reset."""
        self._previous_action, self._phase = np.zeros(n_simulations), np.zeros(n_simulations)
        self._command = np.zeros(n_simulations)
        self._cycle_work, self._cycle_air = np.zeros(n_simulations), np.zeros(n_simulations)
        self._observations = np.zeros((n_simulations, len(OBSERVATIONS)), dtype=np.float32)

    @property
    def observations(self) -> NDArray[np.float32]:
        """Return a copy of the observations, shape (n, 5); see :data:`OBSERVATIONS`."""
        return self._observations.copy()

    def start_episode(
        self, index: int, model: mujoco.MjModel, data: mujoco.MjData, rng: np.random.Generator
    ) -> Mapping[str, float]:
        """Sample the trajectory of simulation ``index`` and set ``data`` to its beginning, a just taut tendon."""
        trajectory = self.trajectory_generator.sample(rng)
        length, dt = trajectory.unit_length, self._options.time_step
        self._servo_commands[index], self._target_force[index] = (
            compute_servo_commands(length, dt),
            trajectory.target_force,
        )
        parameters = self.actuator.parameters
        pressure = rng.uniform(0.0, 0.25 * parameters.supply.max_pressure)
        initial_state = compute_taut_state(parameters, float(length[0]), pressure)
        mujoco.mj_resetData(model, data)
        self.actuator.set_state(data, initial_state)
        load = compute_tension(parameters, initial_state, float(length[0]), 0.0)
        place_crosshead(data, float(length[0]), float(length[1] - length[0]) / dt, load)
        data.ctrl[self.servo_ctrl_address] = self._servo_commands[index, 0]
        self.actuator.set_command(data, 0.0 if self._command_is_opening else initial_state.pressure)
        with callbacks.device_callbacks(self._backend, is_isolated=True):
            mujoco.mj_forward(model, data)
        return {}

    def reset(self, mask: Mask, states: TesterStates) -> None:
        """Reset observation and accounting of the simulations in ``mask``."""
        self.elapsed_intervals[mask] = 0
        self._cycle_work[mask] = self._cycle_air[mask] = 0.0
        hold_action = self._action_decoder.reset(mask, states.act[:, self.actuator.act_address])
        self._previous_action[mask] = hold_action[mask]
        self._energy.reset(mask, self._device_states(states))
        self._observe(mask, states)

    @property
    def step_recorder(self) -> Callable[[Mask, Array], None] | None:
        """Return what sums the air that an ideal regulator draws in each step; None: a part of the device meters it."""
        return self._add_steps if self._energy.samples_air else None

    def _add_steps(self, mask: Mask, act: Array) -> None:
        first, resting_length = self.actuator.act_address, self.actuator.parameters.muscle.resting_length
        self._energy.add_steps(mask, act[:, :, first] * BAR, resting_length + act[:, :, first + 1])

    def schedule_controls(self, actions: Array, mask: Mask) -> Array:
        """Return the controls of the simulations in ``mask`` at each step of the interval, shape (n, steps, 2)."""
        self._command = self._action_decoder.decode(np.clip(actions[:, 0], -1.0, 1.0), self._phase)
        indices = np.flatnonzero(mask)[:, None]
        steps = self.elapsed_intervals[indices] * self._steps_per_action + np.arange(self._steps_per_action)
        controls = np.empty((*steps.shape, self.model.nu))
        controls[:, :, self.servo_ctrl_address] = self._servo_commands[indices, steps]
        start = 0
        for count, scheduled_command in self._action_decoder.schedule_commands(self._command, mask):
            controls[:, start : start + count, self.actuator.ctrl_address] = scheduled_command[mask, None]
            start += count
        return controls

    def evaluate(self, actions: Array, states: TesterStates, mask: Mask) -> BatchStep:
        """Return the result of the interval that ends now; only the simulations in ``mask`` advance."""
        self.elapsed_intervals += mask
        self._observe(mask, states)
        energy = self._energy.update(mask, self._device_states(states))
        action = np.clip(actions[:, 0], -1.0, 1.0)
        action_change = action - self._previous_action
        self._previous_action = np.where(mask, action, self._previous_action)
        force = self._measure_force(states)
        terms = {"reward_smoothness": SMOOTHNESS_WEIGHT * action_change * action_change}
        info, info_masks = {"force_n": force}, {}
        if self._options.task == "force":
            target = self._target_force[self._indices, self.elapsed_intervals]
            error = (force - target) / (FORCE_ERROR_SCALE * self.trajectory_generator.max_force)
            terms["reward_force"] = np.exp(-0.5 * error * error)
        else:
            self._cycle_work += np.where(mask, energy["work_delivered_j"], 0.0)
            self._cycle_air += np.where(mask, energy["air_g"], 0.0)
            ends_cycle = mask & (self.elapsed_intervals % self._options.actions_per_cycle == 0)
            cycle_reward = WORK_REWARD_WEIGHT * self._cycle_work / (self._cycle_air + AIR_MASS_OFFSET_G)
            terms["reward_work"] = np.where(ends_cycle, cycle_reward, 0.0)
            for name, total in (("cycle_work_j", self._cycle_work), ("cycle_air_g", self._cycle_air)):
                info[name], info_masks[name] = total.copy(), ends_cycle
                total[ends_cycle] = 0.0
        is_finite: Mask = np.isfinite(states.qpos.sum(axis=1) + states.act.sum(axis=1))
        if not (is_finite & mask).all():
            terms = {name: np.where(is_finite & mask, term, 0.0) for name, term in terms.items()}
        truncated = mask & is_finite & (self.elapsed_intervals >= self._options.actions_per_episode)
        reward = np.asarray(sum(terms.values()))
        info["valve_command" if self._command_is_opening else "pressure_command_bar"] = self._command
        return BatchStep(reward, mask & ~is_finite, truncated, {**terms, **info, **energy}, info_masks)

    def _measure_force(self, states: TesterStates) -> Array:
        # The sensor measures the force of the unit on the load cell along x.
        return np.asarray(-states.sensordata[:, self._load_cell_index])

    def _observe(self, mask: Mask, states: TesterStates) -> None:
        """Update the observations of the simulations in ``mask``."""
        observations = np.array(
            [
                100.0 * (states.actuator_length[:, self.actuator.out_address] - self.trajectory_generator.mean_length),
                states.actuator_velocity[:, self.actuator.out_address],
                1e-3 * self._measure_force(states),
                states.act[:, self.actuator.act_address],
                1e-3 * self._target_force[self._indices, self.elapsed_intervals],
            ]
        ).T
        if not np.isfinite(observations.sum()):  # the last observation of an episode that failed
            observations = np.nan_to_num(observations)
        clipped = np.minimum(np.maximum(observations, self._lower), self._upper)
        self._observations[mask] = clipped[mask]

    def _device_states(self, states: TesterStates) -> DeviceStates:
        first = self.actuator.act_address
        return DeviceStates(
            pressure=states.act[:, first] * BAR,
            muscle_length=self.actuator.parameters.muscle.resting_length + states.act[:, first + 1],
            muscle_velocity=states.act_dot[:, first + 1],
            unit_length=states.actuator_length[:, self.actuator.out_address],
            internal_state=states.act[:, first + 2 : first + self.actuator.n_states],
        )


def _count_intervals(name: str, total: float, interval: float, allowed: str, min_count: int = 1) -> int:
    """Return the number of ``interval`` in ``total`` [s]; raises InputError when it is not an integer."""
    count = round(total / interval) if interval > 0.0 and np.isfinite(total / interval) else 0
    if count < min_count or abs(count * interval - total) > 1e-9:
        raise InputError(f"{name} is {1e3 * (interval if name == 'time_step' else total):g} ms; allowed: {allowed}")
    return count
