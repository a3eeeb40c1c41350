"""What a prosthesis on the rig senses, of many simulations at once.

Everything is an array with one entry per simulation, so that one walk and a batch of them are the same code.
"""

import numpy as np
from numpy.typing import NDArray

from klute_sim.control.feedback import Sensed
from klute_sim.rigs.gait.assembly import Assembly
from klute_sim.rigs.gait.body import ANKLE
from klute_sim.rigs.gait.reference import GRAVITY
from klute_sim.units import BAR

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

STRIKE, SWING = 0.10, 0.05
"""Load [body weights] above which the foot has struck, and below which it has left."""
SHORTEST, LONGEST, EARLY = 0.6, 1.6, 0.1
"""Of the usual stride time: the least and the most a stride is taken for; until when a strike is the first one's."""


class Senses:
    """Of ``count`` simulations, read every ``interval`` [s]."""

    def __init__(self, rig: Assembly, count: int, interval: float) -> None:
        """All of one rig, whose stride time is the wearer's usual one."""
        model, joint = rig.model, rig.model.joint(ANKLE + "ankle")
        self._angle, self._dof = int(joint.qposadr[0]), int(joint.dofadr[0])
        self._load = int(model.sensor(ANKLE + "load_cell").adr[0]) + 2
        self._pressure, self._interval = rig.actuator.act, interval
        self._weight, self._usual, self._slope = np.empty(count), np.empty(count), np.empty(count)
        self.wear(slice(None), rig)
        self._standing: Mask = np.zeros(count, dtype=np.bool_)
        self._since = np.zeros(count)
        self._period = self._usual.copy()

    def wear(self, place: int | slice, rig: Assembly) -> None:
        """Simulations at ``place`` are of this rig from their next beginning on; it differs in walker and ground."""
        self._weight[place], self._usual[place] = rig.options.mass * GRAVITY, rig.plan.stride_time
        self._slope[place] = rig.options.slope

    def begin(self, which: Mask) -> None:
        """Forget what was estimated of simulations that start anew, at heel strike."""
        self._standing[which], self._since[which], self._period[which] = False, 0.0, self._usual[which]

    def load(self, sensordata: Array) -> Array:
        """(n,) compression of the pylon [body weights]."""
        return np.asarray(-sensordata[:, self._load] / self._weight)

    def phase(self) -> Array:
        """(n,) estimated phase (0-1)."""
        return np.asarray(np.minimum(self._since / self._period, 1.0))

    def move_on(self, load: Array, which: Mask) -> None:
        """An interval later: time since the last foot strike over the time between the last two."""
        self._since += self._interval * which
        strikes = which & ~self._standing & (load > STRIKE)
        if strikes.any():
            # A bounce within the stride is no stride. The wearer's cadence is known well enough to tell.
            counts = strikes & (self._since > SHORTEST * self._usual)
            self._period = np.where(counts, np.minimum(self._since, LONGEST * self._usual), self._period)
            self._since = np.where(counts | (strikes & (self._since < EARLY * self._usual)), 0.0, self._since)
        self._standing = np.where(which, load > np.where(self._standing, SWING, STRIKE), self._standing)

    def read(self, qpos: Array, qvel: Array, act: Array, sensordata: Array) -> tuple[Array, ...]:
        """Columns of (n,) in the order of :class:`~klute_sim.control.feedback.Sensed`, pressure in bar.

        Inclination is to gravity, as an inertial sensor has it; the model's is to the ground's normal.
        """
        return (
            -qpos[:, self._angle],
            -qvel[:, self._dof],
            qpos[:, 2] + qpos[:, 3] - self._slope,
            qvel[:, 2] + qvel[:, 3],
            self.load(sensordata),
            act[:, self._pressure],
            self.phase(),
        )


def sensed(columns: tuple[Array, ...]) -> Sensed:
    """Of one simulation, from :meth:`Senses.read`."""
    angle, rate, shank, shank_rate, load, bar, phase = (float(column[0]) for column in columns)
    return Sensed(angle, rate, shank, shank_rate, load, bar * BAR, phase)
