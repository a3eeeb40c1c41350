"""The task of ``klute_sim/AnkleGait``: what a prosthesis senses, and how well it did, for many simulations at once.

Everything is an array with one entry per simulation, so that one environment and a batch of them are the same code.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from klute_sim.device.step import dead_time
from klute_sim.envs.books import Books, DeviceStates
from klute_sim.rigs.gait.assembly import Assembly
from klute_sim.rigs.gait.build import ANKLE
from klute_sim.rigs.gait.senses import Senses
from klute_sim.units import BAR

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

INTERVAL = 0.01
"""Between two actions [s]."""

OBSERVATIONS = (
    # name, unit, lowest, highest
    ("ankle angle, dorsiflexion positive", "rad", -1.0, 1.0),
    ("ankle velocity, dorsiflexion positive", "rad/s", -50.0, 50.0),
    ("shank inclination, forward positive", "rad", -3.2, 3.2),
    ("shank angular velocity, forward positive", "rad/s", -50.0, 50.0),
    ("axial load in the pylon, compression positive", "body weights", -5.0, 5.0),
    ("gauge pressure", "bar", 0.0, 20.0),
    ("sine of the estimated gait phase", "1", -1.0, 1.0),
    ("cosine of the estimated gait phase", "1", -1.0, 1.0),
)
"""Name, unit, lowest and highest value; what is beyond is clipped."""

SCALES = np.array([0.2, np.radians(5.0), 0.5])
"""Distances from the reference in moment [N*m/kg], angle [rad] and power [W/kg] that count as one."""
WEIGHTS = {"moment": 0.4, "angle": 0.3, "power": 0.3, "air": -0.1, "smoothness": -0.05}
"""Of the reward's terms: closeness 0-1 each; air drawn [g per 0.1 s]; change of action [1]."""

TERMS = tuple(f"reward_{name}" for name in WEIGHTS)


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


class Task:
    """Senses and judges ``count`` simulations of one rig."""

    def __init__(self, rig: Assembly, count: int, law: str) -> None:
        """For ``count`` simulations of ``rig`` under ``law``, ``compiled`` or ``python``."""
        self.rig = rig
        model, reference, phase = rig.model, rig.reference, rig.phase
        joint = model.joint(ANKLE + "ankle")
        self._angle, self._dof = int(joint.qposadr[0]), int(joint.dofadr[0])
        self._middle = float(joint.range.mean())
        self._stop = int(model.sensor(ANKLE + "ankle_stop").adr[0])
        # The drives' states and the device's are in one vector.
        self._pressure, self._offset = rig.actuator.act, rig.actuator.act + 1
        self._mass = rig.options.mass
        self._lowest, self._highest = (np.array([row[k] for row in OBSERVATIONS]) for k in (2, 3))
        # The reference's moment over its angle at another stride time: its power is that much slower or faster.
        slower = reference.stride_time / rig.plan.stride_time
        self._human = np.column_stack(
            [
                reference("ankle_plantarflexor_moment_nm_per_kg", phase),
                np.radians(reference("ankle_dorsiflexion_deg", phase)),
                slower * reference("ankle_power_w_per_kg", phase),
            ]
        )
        self._weights = np.array(list(WEIGHTS.values()))
        supply = rig.actuator.parameters.supply
        self._opens, self._highest_bar = supply.opens != 0.0, supply.pressure / BAR
        self._books = Books(rig.actuator.parameters, count, law)
        self.steps = np.zeros(count, dtype=np.int64)
        """Intervals since the reset."""
        self._senses = Senses(rig, count, INTERVAL)
        self._action = np.zeros(count)
        # Commands reach the device late by whole intervals and a part of one.
        self._late = round(dead_time(rig.actuator.parameters) / rig.options.step)
        self._asked = np.zeros((count, 2 + self._late // round(INTERVAL / rig.options.step)))

    @property
    def length(self) -> int:
        """Intervals in an episode."""
        return self.rig.per_stride * self.rig.options.strides

    def command(self, action: Array) -> Array:
        """Gauge pressure [bar] that ``action`` in [-1, 1] asks for, or the opening [1]; what is beyond is clipped."""
        chosen = _within(action, -1.0, 1.0)
        return np.asarray(chosen if self._opens else 0.5 * (chosen + 1.0) * self._highest_bar)

    def due(self, command: Array, which: Mask) -> list[tuple[int, Array]]:
        """What reaches the device in the next interval, if ``which`` are now told ``command``: steps, (n,) commands.

        One piece, or two where a dead time ends within the interval.
        """
        each = round(INTERVAL / self.rig.options.step)
        self._asked[which] = np.column_stack([self._asked[which, 1:], command[which]])
        first = self._late % each
        pieces = [(first, self._asked[:, 0]), (each - first, self._asked[:, 1])]
        return [(steps, asked) for steps, asked in pieces if steps]

    def slopes(self) -> Array:
        """(n, 6) what the drives are told for the next interval."""
        return np.asarray(self.rig.slopes[self.steps % self.rig.per_stride])

    def begin(self, which: Mask, now: Readings) -> None:
        """Forget what was estimated of the simulations that start anew."""
        self.steps[which] = 0
        self._senses.begin(which)
        self._books.begin(which, self._devices(now))
        pressure = now.act[:, self._pressure]
        self._asked[which] = 0.0 if self._opens else pressure[which, None]
        self._action[which] = 0.0 if self._opens else (2.0 * pressure / self._highest_bar - 1.0)[which]

    def observe(self, now: Readings) -> NDArray[np.float32]:
        """(n, 8) what the prosthesis senses: :data:`OBSERVATIONS`."""
        *told, phase = self._senses.read(now.qpos, now.qvel, now.act, now.sensordata)
        sensed: Array = np.empty((len(phase), len(OBSERVATIONS)))
        columns = (*told, np.sin(2.0 * np.pi * phase), np.cos(2.0 * np.pi * phase))
        for number, column in enumerate(columns):
            sensed[:, number] = column
        if not np.isfinite(sensed.sum()):  # the last observation of an episode that failed
            sensed = np.nan_to_num(sensed)
        return _within(sensed, self._lowest, self._highest).astype(np.float32)

    def judge(self, action: Array, now: Readings, which: Mask) -> tuple[Array, Mask, Mask, dict[str, Array]]:
        """Reward, terminated, truncated and the terms behind them, after an interval under ``action`` [-1, 1].

        Only the simulations in ``which`` move on.
        """
        self.steps += which
        j = self.steps % self.rig.per_stride
        self._senses.move_on(self._senses.load(now.sensordata), which)
        moment = self._net_moment(now) / self._mass
        power = moment * now.qvel[:, self._dof]
        books = self._books.turn(which, self._devices(now))
        action = _within(action, -1.0, 1.0)
        change = action - self._action

        terms: Array = np.empty((len(j), len(WEIGHTS)))
        terms[:, 0], terms[:, 1], terms[:, 2] = moment, -now.qpos[:, self._angle], power
        apart = (terms[:, :3] - self._human[j]) / SCALES
        terms[:, :3] = np.exp(-0.5 * apart * apart)
        terms[:, 3], terms[:, 4] = books["air_g"] * (0.1 / INTERVAL), change * change
        terms *= self._weights
        finite = np.isfinite(now.qpos.sum(axis=1) + now.act.sum(axis=1))
        terminated: Mask = (self.rig.off_path(now.qpos[:, 1], j) | ~finite) & which
        terms[terminated | ~which] = 0.0
        truncated: Mask = (self.steps >= self.length) & which & ~terminated

        self._action = np.where(which, action, self._action)
        told = {
            "gait_pct": 100.0 * self.rig.phase[j],
            "ankle_moment_nm_per_kg": moment,
            "ankle_power_w_per_kg": power,
            **books,
            "valve_command" if self._opens else "pressure_command_bar": self.command(action),
        }
        return terms.sum(axis=1), terminated, truncated, dict(zip(TERMS, terms.T, strict=True)) | told

    def _net_moment(self, now: Readings) -> Array:
        """Net ankle moment [N.m], plantarflexor positive: device, passive parts and end stop."""
        stop = np.where(now.qpos[:, self._angle] < self._middle, 1.0, -1.0) * now.sensordata[:, self._stop]
        return np.asarray(now.qfrc_actuator[:, self._dof] + now.qfrc_passive[:, self._dof] + stop)

    def _devices(self, now: Readings) -> DeviceStates:
        actuator, first = self.rig.actuator, self._pressure
        return DeviceStates(
            pressure=now.act[:, first] * BAR,
            length=actuator.parameters.muscle.resting_length + now.act[:, self._offset],
            rate=now.act_dot[:, self._offset],
            unit_length=now.actuator_length[:, actuator.out],
            remembered=now.act[:, first + 2 : first + actuator.states],
        )


def _within(values: Array, low: Array | float, high: Array | float) -> Array:
    """``values`` clipped to ``low`` ... ``high``."""
    return np.asarray(np.maximum(np.minimum(values, high), low))
