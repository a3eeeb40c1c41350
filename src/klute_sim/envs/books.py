"""Energy and air of many simulations, from one control interval to the next.

Forces are known where an interval ends, so work is their mean at both ends times the way: coarser than the ledger of a
recording, which has every step. What that leaves open is told as ``work_unresolved_j``; what length stops take is in
there, too.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from klute_sim.device.instant import Instant
from klute_sim.device.snapshot import FIELDS, Snapshots
from klute_sim.device.step import MEMORY, NO_MEMORY, Parameters, remembers, supplied
from klute_sim.laws import charging

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class DeviceStates:
    """Of ``n`` devices, SI."""

    pressure: Array
    """Gauge [Pa]."""
    length: Array
    """Of the muscle [m]."""
    rate: Array
    """Of the muscle's length [m/s]."""
    unit_length: Array
    """[m]"""
    remembered: Array
    """(n, MEMORY), or (n, 0) of devices that remember nothing."""


class Books:
    """Of ``count`` simulations of one device, whose numbers may differ."""

    def __init__(self, parameters: Parameters, count: int, law: str) -> None:
        """``law`` is the one in force, ``compiled`` or ``python``."""
        self._snapshots = Snapshots(parameters, law)
        self._counts = not charging.plain(supplied(parameters, NO_MEMORY))
        self._remembers = remembers(parameters)
        self._told, self._way = np.zeros((count, self._snapshots.width)), np.zeros((count, 2))

    def give(self, place: int, parameters: Parameters) -> None:
        """Simulation ``place`` has this device from its next beginning on, with the effects that all have."""
        self._snapshots.give(place, parameters, len(self._told))

    def begin(self, which: Mask, now: DeviceStates) -> None:
        """Start the books of ``which`` anew."""
        told, way = self._look(now)
        self._told[which], self._way[which] = told[which], way[which]

    def turn(self, which: Mask, now: DeviceStates) -> dict[str, Array]:
        """What the interval that ends ``now`` came to in ``which``: work given by each part [J], air drawn [g]."""
        told, way = self._look(now)
        mean, muscle_way, unit_way = 0.5 * (told + self._told), *(way - self._way).T
        at, after, before = (Instant(*each.T[:FIELDS]) for each in (mean, told, self._told))
        work = {
            "work_gas_j": -at.gas * muscle_way,
            "work_friction_j": -at.friction * muscle_way,
            "work_damper_j": -at.damper * muscle_way,
            "work_bladder_j": before.bladder_energy - after.bladder_energy,
            "work_tendon_j": before.tendon_energy - after.tendon_energy,
        }
        for k, name in enumerate(self._snapshots.effects):
            side, other = mean[:, FIELDS + 2 * k], mean[:, FIELDS + 2 * k + 1]
            work[f"work_effect_{name}_j"] = -side * muscle_way - other * (unit_way - muscle_way)
        delivered = -at.tension * unit_way
        # One after the other: NumPy's own sum takes another order for one simulation than for many.
        work["work_unresolved_j"] = delivered - sum(work.values())
        drawn = after.air_drawn - before.air_drawn if self._counts else after.air_mass - before.air_mass
        found = {
            **work,
            "work_delivered_j": delivered,
            "air_g": 1e3 * np.fmax(drawn, 0.0),
            "air_leaked_g": 1e3 * (after.air_leaked - before.air_leaked),
            "air_held_g": 1e3 * after.air_mass,
        }
        self._told[which], self._way[which] = told[which], way[which]
        return {name: np.asarray(value) for name, value in found.items()}

    def _look(self, now: DeviceStates) -> tuple[Array, Array]:
        states = np.column_stack([now.pressure, now.length, now.rate, now.unit_length])
        memory = now.remembered if self._remembers else np.zeros((len(states), MEMORY))
        return self._snapshots.take(states, memory), states[:, [1, 3]]
