"""Many devices at one instant, compiled: what a batch of simulations needs for its energy and its air."""

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from klute_sim.device.backend.packing import pack_parameters, unpack_parameters
from klute_sim.device.dynamics import N_INTERNAL_STATES, DeviceParameters, DeviceState
from klute_sim.device.energy.outputs import DeviceOutputs, accumulate_effects, compute_effect_forces, compute_outputs
from klute_sim.device.rollout import find_numba_incompatibility

Array = NDArray[np.float64]

N_OUTPUTS = len(DeviceOutputs._fields)


def fill_outputs(rows: Any, state: DeviceState, unit_length: float, velocity: float, out: Array) -> None:
    """Fill ``out`` with an :class:`Instant` and what each effect adds to muscle side and tendon side [N].

    ``rows`` are :func:`klute_sim.device.energy.outputs.stages`; the muscle moves at ``rate`` [m/s], the unit is at
    ``unit_length`` [m].
    """
    told = compute_outputs(unpack_parameters(rows[-1]), state, unit_length, velocity)
    # Spelled out, because a compiler has to follow it.
    out[0], out[1], out[2], out[3], out[4] = (
        told.tension,
        told.gas_force,
        told.friction_force,
        told.bladder_force,
        told.damper_force,
    )
    out[5], out[6], out[7] = told.tendon_force, told.bladder_energy, told.tendon_energy
    out[8], out[9], out[10], out[11] = told.air_mass, told.air_drawn, told.air_leaked, told.supply_pressure
    for j in range(1, len(rows)):
        own = compute_effect_forces(
            unpack_parameters(rows[j]), unpack_parameters(rows[j - 1]), state, unit_length, velocity
        )
        out[10 + 2 * j], out[11 + 2 * j] = own


def evaluate_batch(rows: Any, states: Array, internal_states: Array, out: Array) -> None:
    """Fill ``out`` (n, :data:`FIELDS` + 2 for each effect), a row as in :func:`tell` for each device.

    ``rows`` are those of each device, or of one that all are like; ``states`` (n, 4) are gauge pressure [Pa], muscle
    length [m], its rate [m/s] and the unit's length [m]; ``memory`` (n, MEMORY).
    """
    for k in range(len(states)):
        state = DeviceState(states[k, 0], states[k, 1], to_tuple(internal_states[k], N_INTERNAL_STATES))
        fill_outputs(rows[min(k, len(rows) - 1)], state, states[k, 3], states[k, 2], out[k])


def to_tuple(numbers: Any, count: int) -> tuple[float, ...]:
    """The first ``count`` of some ``numbers``."""
    return tuple(float(number) for number in numbers[:count])


@cache
def compile_functions() -> Any:
    """This module with its functions compiled."""
    from numba.np.unsafe.ndarray import to_fixed_tuple

    from klute_sim.device import batch_outputs
    from klute_sim.device.backend import compiled
    from klute_sim.device.energy import outputs as module

    law = compiled.compile_device_functions()
    told = compiled.compile_module(module, **law, gas_of=law["get_gas_state"])
    return compiled.compile_module(
        batch_outputs,
        **law,
        compute_outputs=told.compute_outputs,
        compute_effect_forces=told.compute_effect_forces,
        to_tuple=to_fixed_tuple,
    )


@cache
def _compile_evaluate_batch() -> Callable[..., None]:
    import numba

    from klute_sim.device.backend import compiled

    table = numba.float64[:, ::1]
    signature = numba.void(numba.float64[:, :, ::1], table, table, table)
    ready: Callable[..., None] = compiled.compile_cached(
        partial(numba.njit, nogil=True), compile_functions().evaluate_batch, signature
    )
    return ready


class BatchOutputs:
    """Takes snapshots of simulations of one device, or of devices with the same effects."""

    def __init__(self, parameters: DeviceParameters, backend: str) -> None:
        """``law`` is the one in force, ``compiled`` or ``python``."""
        self.effect_names = accumulate_effects(parameters)[0]
        """Names of the device's effects."""
        self.n_columns = N_OUTPUTS + 2 * len(self.effect_names)
        """Numbers of a snapshot: an :class:`Instant`, then what each effect adds to muscle side and tendon side [N]."""
        self._rows = np.array([_pack_cumulative_parameters(parameters)])
        self._evaluate_batch: Callable[..., None] = (
            _compile_evaluate_batch() if backend == "compiled" and not find_numba_incompatibility() else evaluate_batch
        )

    def set_parameters(self, index: int, parameters: DeviceParameters, n_simulations: int) -> None:
        """From now on simulation ``place`` of ``count`` has this device, which has the same effects as the others."""
        if len(self._rows) != n_simulations:
            self._rows = np.repeat(self._rows, n_simulations, axis=0)
        self._rows[index] = _pack_cumulative_parameters(parameters)

    def evaluate(self, states: Array, internal_states: Array) -> Array:
        """(n, ``width``) of ``states`` and ``memory`` as in :func:`run`."""
        out = np.empty((len(states), self.n_columns))
        rows: Any = self._rows if self._evaluate_batch is not evaluate_batch else self._rows.tolist()
        self._evaluate_batch(rows, np.ascontiguousarray(states), np.ascontiguousarray(internal_states), out)
        return out


def _pack_cumulative_parameters(parameters: DeviceParameters) -> Array:
    return np.array([pack_parameters(device) for device in accumulate_effects(parameters)[1]])
