"""Task of ``klute_sim/AnkleGait``: observations, reward and termination of many simulations at once.

Every quantity is an array with one entry per simulation, so a single environment and a batch share this code.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from klute_sim.constants import GRAVITY
from klute_sim.controllers.pressure import load_default_profile
from klute_sim.device.device import Device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.envs.base.task import CONTROL_INTERVAL, BatchStep
from klute_sim.envs.tasks import reward
from klute_sim.envs.tasks.actions import ActionDecoder, select_action_kind
from klute_sim.envs.tasks.domain_randomization import DomainRandomizer, Episode, RandomizationRanges
from klute_sim.envs.tasks.energy_accounting import DeviceStates, EnergyAccounting
from klute_sim.envs.tasks.instruments import N_MEASURED, Instruments
from klute_sim.envs.tasks.options import TaskOptions
from klute_sim.errors import InputError
from klute_sim.gait.body import KEEL_JOINT, PROSTHESIS_PREFIX
from klute_sim.gait.rig.setup import MAX_PATH_DEVIATION, GaitOptions, GaitRig
from klute_sim.types import Array, Mask
from klute_sim.units import BAR

Rngs = Sequence[np.random.Generator]


@dataclass
class SimulationStates:
    """Arrays of ``n`` simulations at the end of an interval, named as in MuJoCo."""

    qpos: Array
    qvel: Array
    act: Array
    sensordata: Array
    qfrc_actuator: Array
    qfrc_passive: Array
    actuator_length: Array
    act_dot: Array


class StrideTables:
    """Tables over the stride of all rigs in use; their strides may have different durations."""

    def __init__(self) -> None:
        """Set up empty tables."""
        self._tables: list[tuple[Array, ...]] = []
        self._scalars: list[tuple[float, ...]] = []

    def add_rigs(self, gait_rigs: Sequence[GaitRig]) -> None:
        """Add the rigs at the end of ``gait_rigs`` that are new."""
        if len(gait_rigs) == len(self._tables):
            return
        for rig in gait_rigs[len(self._tables) :]:
            ankle = tabulate_reference_ankle(rig)
            load = rig.reference("grf_vertical_n_per_kg", rig.phase) / GRAVITY
            self._tables.append((rig.phase, rig.carriage_height, rig.command_rates, ankle, load))
            push_power = float(np.maximum(ankle[:, 2], 0.0).mean())
            self._scalars.append((rig.commands_per_stride, rig.options.mass, push_power))
        max_commands = max(rig.commands_per_stride for rig in gait_rigs)
        self.phase, self.carriage_height, self.command_rates, self.reference_ankle, self.reference_load = (
            np.stack([np.resize(table, (max_commands, *table.shape[1:])) for table in tables])
            for tables in zip(*self._tables, strict=True)
        )
        count, self.mass, self.mean_push_power = np.array(self._scalars).T
        self.commands_per_stride = count.astype(np.int64)

    def is_off_path(
        self, carriage_height: Array, rig_index: NDArray[np.int64], command_index: NDArray[np.int64]
    ) -> Mask:
        """Return whether carriages at these heights [m] after these commands have left their path or are not finite."""
        planned = self.carriage_height[rig_index, command_index % self.commands_per_stride[rig_index]]
        return np.asarray(~(np.abs(carriage_height - planned) < MAX_PATH_DEVIATION))


def tabulate_reference_ankle(gait_rig: GaitRig) -> Array:
    """Return net moment [N*m/kg], angle [rad] and power [W/kg] (n, 3) of the human ankle at each command of
    ``gait_rig``.
    """
    reference, phase = gait_rig.reference, gait_rig.phase
    # The rig follows moment and angle of the reference at another stride time, which scales the power.
    speed_ratio = reference.stride_time / gait_rig.trajectory.stride_time
    return np.column_stack(
        [
            reference("ankle_plantarflexor_moment_nm_per_kg", phase),
            np.radians(reference("ankle_dorsiflexion_deg", phase)),
            speed_ratio * reference("ankle_power_w_per_kg", phase),
        ]
    )


class GaitTask:
    """Observation and evaluation of ``n_simulations`` simulations."""

    def __init__(
        self, device: Device, gait_options: GaitOptions, options: TaskOptions, n_simulations: int, backend: str
    ) -> None:
        """Set up the task with a ``backend``, ``compiled`` or ``python``; raises InputError when the options are
        invalid.
        """
        steps_per_action = round(CONTROL_INTERVAL / gait_options.dt)
        if abs(steps_per_action * gait_options.dt - CONTROL_INTERVAL) > 1e-12:
            raise InputError(
                f"time_step is {1e3 * gait_options.dt:g} ms; allowed: divisors of {1e3 * CONTROL_INTERVAL:g} ms"
            )
        base = options.profile or load_default_profile()
        self.randomizer = DomainRandomizer(
            device, base, gait_options, RandomizationRanges.from_mapping(options.domain_randomization), CONTROL_INTERVAL
        )
        rig = self.randomizer.gait_rigs[0]
        parameters, model, joint = rig.actuator.parameters, rig.model, rig.model.joint(PROSTHESIS_PREFIX + "ankle")
        self._actuator, self._strides = rig.actuator, gait_options.strides
        self._angle_index, self._dof_index = int(joint.qposadr[0]), int(joint.dofadr[0])
        keel = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, KEEL_JOINT)
        keel_indices = [] if keel < 0 else [(int(model.jnt_qposadr[keel]), int(model.jnt_dofadr[keel]))]
        # Hinge and, in an elastic foot, keel: together they are the ankle that the reference describes.
        self._foot_angle_indices, self._foot_rate_indices = (
            list(indices) for indices in zip((self._angle_index, self._dof_index), *keel_indices, strict=True)
        )
        self._mid_angle, self._alignment = float(joint.range.mean()), float(rig.options.alignment or 0.0)
        self._ground_index = int(model.sensor("ground").adr[0])
        self._stop_sensor_index = int(model.sensor(PROSTHESIS_PREFIX + "ankle_stop").adr[0])
        # One vector holds the states of drives and device.
        self._pressure_index, self._length_index = rig.actuator.act_address, rig.actuator.act_address + 1
        self._weights = reward.resolve_weights(options.reward)
        self._command_is_opening = parameters.supply.command_is_opening != 0.0
        self._stride_tables, self._rig_index = StrideTables(), np.zeros(n_simulations, dtype=np.int64)
        self._stride_tables.add_rigs(self.randomizer.gait_rigs)
        self._resting_length = np.full(n_simulations, parameters.muscle.resting_length)
        self._energy = EnergyAccounting(parameters, n_simulations, backend)
        self._instruments = Instruments(
            rig, n_simulations, CONTROL_INTERVAL, options.sensor_noise, options.sensor_delay
        )
        self._sensors = self._instruments.sensors
        kind = select_action_kind(options.action, self._command_is_opening, device.name)
        self._action_decoder = ActionDecoder(
            kind, parameters, base, options.residual_bar, n_simulations, steps_per_action, gait_options.dt
        )
        self.max_episode_steps = gait_options.strides * self.randomizer.max_commands_per_stride
        """Number of intervals of the longest episode."""
        self.elapsed_intervals = np.zeros(n_simulations, dtype=np.int64)
        """Number of intervals since the reset."""
        self._previous_action = np.zeros(n_simulations)

    @property
    def observations(self) -> NDArray[np.float32]:
        """Return the observations of the prostheses, shape (n, 8); see
        :data:`klute_sim.envs.tasks.instruments.OBSERVATIONS`.
        """
        return self._instruments.observations

    def decode_action(self, action: Array) -> Array:
        """Return the gauge pressure [bar] or opening [1] of ``action``, which is clipped to [-1, 1]."""
        return self._action_decoder.decode(np.clip(action, -1.0, 1.0), self._sensors.estimate_phase())

    def schedule_commands(self, command: Array, mask: Mask) -> list[tuple[int, Array]]:
        """Return the commands of the next interval with their numbers of steps.

        See :meth:`klute_sim.envs.tasks.actions.ActionDecoder.schedule_commands`.
        """
        return self._action_decoder.schedule_commands(command, mask)

    def get_drive_command_rates(self) -> Array:
        """Return the command rates of the drives in the next interval, shape (n, 6)."""
        return np.asarray(
            self._stride_tables.command_rates[self._rig_index, self.elapsed_intervals % self._commands_per_stride()]
        )

    @property
    def samples_air(self) -> bool:
        """Return whether :meth:`add_steps` has to be called before :meth:`evaluate`."""
        return self._energy.samples_air

    def add_steps(self, mask: Mask, act: Array) -> None:
        """Add the air drawn in consecutive steps; ``act`` (simulations in ``mask``, steps, na) is that after each."""
        pressure, offset = act[:, :, self._pressure_index] * BAR, act[:, :, self._length_index]
        self._energy.add_steps(mask, pressure, self._resting_length[mask, None] + offset)

    def assign_episode(self, index: int, episode: Episode) -> None:
        """Assign ``episode`` to simulation ``index`` from its next reset on."""
        self._stride_tables.add_rigs(self.randomizer.gait_rigs)
        self._rig_index[index] = episode.rig_index
        self._sensors.assign_gait_rig(index, self.randomizer.gait_rigs[episode.rig_index])
        parameters: DeviceParameters = episode.parameters
        if parameters is not self.randomizer.device.parameters:
            self._resting_length[index] = parameters.muscle.resting_length
            self._energy.set_parameters(index, parameters)
            self._action_decoder.set_parameters(index, parameters)

    def reset(self, mask: Mask, states: SimulationStates, rngs: Rngs) -> None:
        """Reset observation and accounting of the simulations in ``mask``."""
        self.elapsed_intervals[mask] = 0
        self._instruments.reset(mask, self._measure(states), rngs)
        self._energy.reset(mask, self._device_states(states))
        hold_action = self._action_decoder.reset(mask, states.act[:, self._pressure_index])
        self._previous_action[mask] = hold_action[mask]

    def evaluate(self, action: Array, command: Array, states: SimulationStates, mask: Mask, rngs: Rngs) -> BatchStep:
        """Return the result of an interval with ``action`` in [-1, 1].

        ``command`` is the decoded action. Only the simulations in ``mask`` advance.
        """
        self.elapsed_intervals += mask
        tables, rig_index = self._stride_tables, self._rig_index
        command_index = self.elapsed_intervals % self._commands_per_stride()
        self._instruments.update(mask, self._measure(states), rngs)
        moment = self._net_moment(states) / tables.mass[rig_index]
        power = moment * states.qvel[:, self._foot_rate_indices].sum(axis=1)
        angle = self._alignment - states.qpos[:, self._foot_angle_indices].sum(axis=1)
        ankle = np.column_stack([moment, angle, power])
        energy = self._energy.update(mask, self._device_states(states))
        action = np.clip(action, -1.0, 1.0)
        air_rate, action_change = energy["air_g"] * (0.1 / CONTROL_INTERVAL), action - self._previous_action
        terms = self._weights * reward.compute_terms(
            ankle,
            tables.reference_ankle[rig_index, command_index],
            tables.mean_push_power[rig_index],
            air_rate,
            action_change,
            self._measure_ground_reaction(states, rig_index),
            tables.reference_load[rig_index, command_index],
        )
        finite = np.isfinite(states.qpos.sum(axis=1) + states.act.sum(axis=1))
        terminated: Mask = (tables.is_off_path(states.qpos[:, 1], rig_index, command_index) | ~finite) & mask
        terms[terminated | ~mask] = 0.0
        truncated: Mask = (self.elapsed_intervals >= self._strides * self._commands_per_stride()) & mask & ~terminated

        self._previous_action = np.where(mask, action, self._previous_action)
        info = {
            "gait_pct": 100.0 * tables.phase[rig_index, command_index],
            "ankle_moment_nm_per_kg": moment,
            "ankle_power_w_per_kg": power,
            **energy,
            "valve_command" if self._command_is_opening else "pressure_command_bar": command,
        }
        term_info = dict(zip(reward.REWARD_TERMS, terms.T, strict=True))
        return BatchStep(terms.sum(axis=1), terminated, truncated, term_info | info)

    def _commands_per_stride(self) -> NDArray[np.int64]:
        return np.asarray(self._stride_tables.commands_per_stride[self._rig_index])

    def _measure(self, states: SimulationStates) -> Array:
        """Return the ideal measurements, shape (n, 6)."""
        return np.column_stack(self._sensors.read(states.qpos, states.qvel, states.act, states.sensordata)[:N_MEASURED])

    def _measure_ground_reaction(self, states: SimulationStates, rig_index: NDArray[np.int64]) -> Array:
        """Return the fore-aft and the vertical ground reaction, shape (n, 2) [body weights]."""
        force = states.sensordata[:, self._ground_index : self._ground_index + 3 : 2]
        return np.asarray(force / (GRAVITY * self._stride_tables.mass[rig_index])[:, None])

    def _net_moment(self, states: SimulationStates) -> Array:
        """Return the net ankle moment [N*m], positive in plantarflexion: device, passive parts and end stop."""
        stop = (
            np.where(states.qpos[:, self._angle_index] < self._mid_angle, 1.0, -1.0)
            * states.sensordata[:, self._stop_sensor_index]
        )
        return np.asarray(states.qfrc_actuator[:, self._dof_index] + states.qfrc_passive[:, self._dof_index] + stop)

    def _device_states(self, states: SimulationStates) -> DeviceStates:
        first = self._pressure_index
        return DeviceStates(
            pressure=states.act[:, first] * BAR,
            muscle_length=self._resting_length + states.act[:, self._length_index],
            muscle_velocity=states.act_dot[:, self._length_index],
            unit_length=states.actuator_length[:, self._actuator.out_address],
            internal_state=states.act[:, first + 2 : first + self._actuator.n_states],
        )
