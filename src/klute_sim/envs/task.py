"""The task of ``klute_sim/AnkleGait``: what a prosthesis senses, and how well it did, for many simulations at once.

Everything is an array with one entry per simulation, so that one environment and a batch of them are the same code.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from klute_sim.control.pressure import tuned
from klute_sim.device.files import Device
from klute_sim.device.step import Parameters
from klute_sim.envs import reward
from klute_sim.envs.actions import Actions, kind_for
from klute_sim.envs.books import Books, DeviceStates
from klute_sim.envs.instruments import MEASURED, Instruments
from klute_sim.envs.options import TaskOptions
from klute_sim.envs.randomise import Casting, Episode, Randomise
from klute_sim.errors import InputError
from klute_sim.rigs.gait.assembly import OFF_PATH, Assembly, GaitOptions
from klute_sim.rigs.gait.body import ANKLE
from klute_sim.units import BAR

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Randoms = Sequence[np.random.Generator]

INTERVAL = 0.01
"""Between two actions [s]."""


@dataclass
class Readings:
    """What was read off ``n`` simulations after an interval."""

    qpos: Array
    qvel: Array
    act: Array
    sensordata: Array
    qfrc_actuator: Array
    qfrc_passive: Array
    actuator_length: Array
    act_dot: Array


class Walks:
    """What the task needs of every rig that is walked on, side by side; their strides may last differently long."""

    def __init__(self) -> None:
        """Of no rig yet."""
        self._tables: list[tuple[Array, ...]] = []
        self._numbers: list[tuple[float, ...]] = []

    def learn(self, rigs: Sequence[Assembly]) -> None:
        """Take up what is new among ``rigs``, which have been added at their end."""
        if len(rigs) == len(self._tables):
            return
        for rig in rigs[len(self._tables) :]:
            ankle = human(rig)
            self._tables.append((rig.phase, rig.height, rig.slopes, ankle))
            push = float(np.maximum(ankle[:, 2], 0.0).mean())
            self._numbers.append((rig.per_stride, rig.options.mass, push))
        longest = max(rig.per_stride for rig in rigs)
        self.phase, self.height, self.slopes, self.human = (
            np.stack([np.resize(table, (longest, *table.shape[1:])) for table in tables])
            for tables in zip(*self._tables, strict=True)
        )
        count, self.mass, self.push = np.array(self._numbers).T
        self.per_stride = count.astype(np.int64)

    def off_path(self, carriage_height: Array, rig: NDArray[np.int64], command: NDArray[np.int64]) -> Mask:
        """Whether carriages at these heights [m] after these commands of a rig have left their path, or are nowhere."""
        planned = self.height[rig, command % self.per_stride[rig]]
        return np.asarray(~(np.abs(carriage_height - planned) < OFF_PATH))


def human(rig: Assembly) -> Array:
    """(n, 3) net moment [N*m/kg], angle [rad] and power [W/kg] of the human ankle at each command of ``rig``."""
    reference, phase = rig.reference, rig.phase
    # The reference's moment over its angle at another stride time: its power is that much slower or faster.
    slower = reference.stride_time / rig.plan.stride_time
    return np.column_stack(
        [
            reference("ankle_plantarflexor_moment_nm_per_kg", phase),
            np.radians(reference("ankle_dorsiflexion_deg", phase)),
            slower * reference("ankle_power_w_per_kg", phase),
        ]
    )


class Task:
    """Senses and judges ``count`` simulations."""

    def __init__(self, device: Device, walker: GaitOptions, options: TaskOptions, count: int, law: str) -> None:
        """For ``count`` simulations under ``law``, ``compiled`` or ``python``; raises InputError for what cannot be."""
        each = round(INTERVAL / walker.step)
        if abs(each * walker.step - INTERVAL) > 1e-12:
            raise InputError(f"step is {1e3 * walker.step:g} ms; allowed: what divides {1e3 * INTERVAL:g} ms evenly")
        self.casting = Casting(device, walker, Randomise.of(options.randomise), INTERVAL)
        rig = self.casting.rigs[0]
        parameters, model, joint = rig.actuator.parameters, rig.model, rig.model.joint(ANKLE + "ankle")
        self._actuator, self._strides = rig.actuator, walker.strides
        self._angle, self._dof = int(joint.qposadr[0]), int(joint.dofadr[0])
        self._middle = float(joint.range.mean())
        self._stop = int(model.sensor(ANKLE + "ankle_stop").adr[0])
        # The drives' states and the device's are in one vector.
        self._pressure, self._offset = rig.actuator.act, rig.actuator.act + 1
        self._weights, self._opens = reward.weights(options.reward), parameters.supply.opens != 0.0
        self._walks, self._number = Walks(), np.zeros(count, dtype=np.int64)
        self._walks.learn(self.casting.rigs)
        self._rest = np.full(count, parameters.muscle.resting_length)
        self._books = Books(parameters, count, law)
        self._instruments = Instruments(rig, count, INTERVAL, options.sensor_noise, options.sensor_delay)
        self._senses = self._instruments.senses
        kind = kind_for(options.action, self._opens, device.name)
        base = options.profile or tuned()
        self._actions = Actions(kind, parameters, base, options.residual_bar, count, each, walker.step)
        self.steps = np.zeros(count, dtype=np.int64)
        """Intervals since the reset."""
        self._action = np.zeros(count)

    @property
    def observed(self) -> NDArray[np.float32]:
        """(n, 8) what the prostheses sense: :data:`klute_sim.envs.instruments.OBSERVATIONS`."""
        return self._instruments.observed

    def command(self, action: Array) -> Array:
        """Gauge pressure [bar] that ``action`` in [-1, 1] asks for, or the opening [1]; what is beyond is clipped."""
        return self._actions.asked(np.clip(action, -1.0, 1.0), self._senses.phase())

    def due(self, command: Array, which: Mask) -> list[tuple[int, Array]]:
        """See :meth:`klute_sim.envs.actions.Actions.due`."""
        return self._actions.due(command, which)

    def slopes(self) -> Array:
        """(n, 6) what the drives are told for the next interval."""
        return np.asarray(self._walks.slopes[self._number, self.steps % self._per_stride()])

    def cast(self, place: int, episode: Episode) -> None:
        """Simulation ``place`` walks ``episode`` from its next beginning on."""
        self._walks.learn(self.casting.rigs)
        self._number[place] = episode.number
        self._senses.wear(place, self.casting.rigs[episode.number])
        parameters: Parameters = episode.parameters
        if parameters is not self.casting.device.parameters:
            self._rest[place] = parameters.muscle.resting_length
            self._books.give(place, parameters)
            self._actions.give(place, parameters)

    def begin(self, which: Mask, now: Readings, randoms: Randoms) -> None:
        """Forget what was estimated of the simulations that start anew."""
        self.steps[which] = 0
        self._instruments.begin(which, self._measured(now), randoms)
        self._books.begin(which, self._devices(now))
        still = self._actions.begin(which, now.act[:, self._pressure])
        self._action[which] = still[which]

    def judge(
        self, action: Array, command: Array, now: Readings, which: Mask, randoms: Randoms
    ) -> tuple[Array, Mask, Mask, dict[str, Array]]:
        """Reward, terminated, truncated and the terms behind them, after an interval under ``action`` [-1, 1].

        ``command`` is what it asked for. Only the simulations in ``which`` move on.
        """
        self.steps += which
        walks, number = self._walks, self._number
        j = self.steps % self._per_stride()
        self._instruments.turn(which, self._measured(now), randoms)
        moment = self._net_moment(now) / walks.mass[number]
        power = moment * now.qvel[:, self._dof]
        ankle = np.column_stack([moment, -now.qpos[:, self._angle], power])
        books = self._books.turn(which, self._devices(now))
        action = np.clip(action, -1.0, 1.0)
        air, change = books["air_g"] * (0.1 / INTERVAL), action - self._action
        terms = self._weights * reward.terms(ankle, walks.human[number, j], walks.push[number], air, change)
        finite = np.isfinite(now.qpos.sum(axis=1) + now.act.sum(axis=1))
        terminated: Mask = (walks.off_path(now.qpos[:, 1], number, j) | ~finite) & which
        terms[terminated | ~which] = 0.0
        truncated: Mask = (self.steps >= self._strides * self._per_stride()) & which & ~terminated

        self._action = np.where(which, action, self._action)
        told = {
            "gait_pct": 100.0 * walks.phase[number, j],
            "ankle_moment_nm_per_kg": moment,
            "ankle_power_w_per_kg": power,
            **books,
            "valve_command" if self._opens else "pressure_command_bar": command,
        }
        return terms.sum(axis=1), terminated, truncated, dict(zip(reward.TERMS, terms.T, strict=True)) | told

    def _per_stride(self) -> NDArray[np.int64]:
        return np.asarray(self._walks.per_stride[self._number])

    def _measured(self, now: Readings) -> Array:
        """(n, 6) what perfect sensors read."""
        return np.column_stack(self._senses.read(now.qpos, now.qvel, now.act, now.sensordata)[:MEASURED])

    def _net_moment(self, now: Readings) -> Array:
        """Net ankle moment [N.m], plantarflexor positive: device, passive parts and end stop."""
        stop = np.where(now.qpos[:, self._angle] < self._middle, 1.0, -1.0) * now.sensordata[:, self._stop]
        return np.asarray(now.qfrc_actuator[:, self._dof] + now.qfrc_passive[:, self._dof] + stop)

    def _devices(self, now: Readings) -> DeviceStates:
        first = self._pressure
        return DeviceStates(
            pressure=now.act[:, first] * BAR,
            length=self._rest + now.act[:, self._offset],
            rate=now.act_dot[:, self._offset],
            unit_length=now.actuator_length[:, self._actuator.out],
            remembered=now.act[:, first + 2 : first + self._actuator.states],
        )
