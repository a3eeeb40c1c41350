"""Many devices at one instant, compiled: what a batch of simulations needs for its energy and its air."""

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from klute_sim.device.instant import Instant, added, instant, stages
from klute_sim.device.rollout import obstacle
from klute_sim.device.step import MEMORY, Parameters, State
from klute_sim.device.vector import pack, unpack

Array = NDArray[np.float64]

FIELDS = len(Instant._fields)


def tell(rows: Any, state: State, unit_length: float, rate: float, out: Array) -> None:
    """Fill ``out`` with an :class:`Instant` and what each effect adds to muscle side and tendon side [N].

    ``rows`` are :func:`klute_sim.device.instant.stages`; the muscle moves at ``rate`` [m/s], the unit is at
    ``unit_length`` [m].
    """
    told = instant(unpack(rows[-1]), state, unit_length, rate)
    # Spelled out, because a compiler has to follow it.
    out[0], out[1], out[2], out[3], out[4] = told.tension, told.gas, told.friction, told.bladder, told.damper
    out[5], out[6], out[7] = told.tendon, told.bladder_energy, told.tendon_energy
    out[8], out[9], out[10], out[11] = told.air_mass, told.air_drawn, told.air_leaked, told.supply_pressure
    for j in range(1, len(rows)):
        own = added(unpack(rows[j]), unpack(rows[j - 1]), state, unit_length, rate)
        out[10 + 2 * j], out[11 + 2 * j] = own


def run(rows: Any, states: Array, memory: Array, out: Array) -> None:
    """Fill ``out`` (n, :data:`FIELDS` + 2 for each effect), a row as in :func:`tell` for each device.

    ``rows`` are those of each device, or of one that all are like; ``states`` (n, 4) are gauge pressure [Pa], muscle
    length [m], its rate [m/s] and the unit's length [m]; ``memory`` (n, MEMORY).
    """
    for k in range(len(states)):
        state = State(states[k, 0], states[k, 1], to_tuple(memory[k], MEMORY))
        tell(rows[min(k, len(rows) - 1)], state, states[k, 3], states[k, 2], out[k])


def to_tuple(numbers: Any, count: int) -> tuple[float, ...]:
    """The first ``count`` of some ``numbers``."""
    return tuple(float(number) for number in numbers[:count])


@cache
def compiled_functions() -> Any:
    """This module with its functions compiled."""
    from numba.np.unsafe.ndarray import to_fixed_tuple

    from klute_sim.device import compiled, snapshot
    from klute_sim.device import instant as module

    law = compiled.device_law()
    told = compiled.copy_of(module, **law, gas_of=law["gas"])
    return compiled.copy_of(snapshot, **law, instant=told.instant, added=told.added, to_tuple=to_fixed_tuple)


@cache
def _compiled() -> Callable[..., None]:
    import numba

    from klute_sim.device import compiled

    table = numba.float64[:, ::1]
    signature = numba.void(numba.float64[:, :, ::1], table, table, table)
    ready: Callable[..., None] = compiled.ready(partial(numba.njit, nogil=True), compiled_functions().run, signature)
    return ready


class Snapshots:
    """Takes snapshots of simulations of one device, or of devices with the same effects."""

    def __init__(self, parameters: Parameters, law: str) -> None:
        """``law`` is the one in force, ``compiled`` or ``python``."""
        self.effects = stages(parameters)[0]
        """Names of the device's effects."""
        self.width = FIELDS + 2 * len(self.effects)
        """Numbers of a snapshot: an :class:`Instant`, then what each effect adds to muscle side and tendon side [N]."""
        self._rows = np.array([_rows(parameters)])
        self._run: Callable[..., None] = _compiled() if law == "compiled" and not obstacle() else run

    def give(self, place: int, parameters: Parameters, count: int) -> None:
        """From now on simulation ``place`` of ``count`` has this device, which has the same effects as the others."""
        if len(self._rows) != count:
            self._rows = np.repeat(self._rows, count, axis=0)
        self._rows[place] = _rows(parameters)

    def take(self, states: Array, memory: Array) -> Array:
        """(n, ``width``) of ``states`` and ``memory`` as in :func:`run`."""
        out = np.empty((len(states), self.width))
        rows: Any = self._rows if self._run is not run else self._rows.tolist()
        self._run(rows, np.ascontiguousarray(states), np.ascontiguousarray(memory), out)
        return out


def _rows(parameters: Parameters) -> Array:
    return np.array([pack(device) for device in stages(parameters)[1]])
