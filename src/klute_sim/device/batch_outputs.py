"""Outputs of many devices at one instant: the energies and the air of a batch of simulations."""

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np

from klute_sim.device.backend.packing import pack_parameters, unpack_parameters
from klute_sim.device.backend.select import explain_missing_compiler
from klute_sim.device.dynamics import N_INTERNAL_STATES, DeviceParameters, DeviceState
from klute_sim.device.energy.outputs import DeviceOutputs, accumulate_effects, compute_effect_forces, compute_outputs
from klute_sim.types import Array

N_OUTPUTS = len(DeviceOutputs._fields)
"""Number of outputs of a device without effects."""


def fill_outputs(rows: Any, state: DeviceState, unit_length: float, velocity: float, out: Array) -> None:
    """Fill ``out`` with the :class:`DeviceOutputs` and the forces [N] that each effect adds to muscle and tendon.

    ``rows`` holds the packed parameters of :func:`klute_sim.device.energy.outputs.accumulate_effects`; ``unit_length``
    is in m and the muscle ``velocity`` in m/s.
    """
    outputs = compute_outputs(unpack_parameters(rows[-1]), state, unit_length, velocity)
    # The fields are spelled out because numba cannot iterate over a named tuple.
    out[0], out[1], out[2] = outputs.tension, outputs.gas_force, outputs.friction_force
    out[3], out[4], out[5] = outputs.bladder_force, outputs.damper_force, outputs.tendon_force
    out[6], out[7], out[8] = outputs.bladder_energy, outputs.tendon_energy, outputs.air_mass
    out[9], out[10], out[11] = outputs.air_drawn, outputs.air_leaked, outputs.supply_pressure
    out[12], out[13], out[14] = outputs.stop_force, outputs.contact_pressure, outputs.braid_volume
    for j in range(1, len(rows)):
        parameters, reduced_parameters = unpack_parameters(rows[j]), unpack_parameters(rows[j - 1])
        forces = compute_effect_forces(parameters, reduced_parameters, state, unit_length, velocity)
        out[N_OUTPUTS + 2 * j - 2], out[N_OUTPUTS + 2 * j - 1] = forces


def evaluate_batch(rows: Any, states: Array, internal_states: Array, out: Array) -> None:
    """Fill ``out`` (n, :data:`N_OUTPUTS` + 2 for each effect) with one row of :func:`fill_outputs` per device.

    ``rows`` holds the packed parameters of each device, or of one device for all. ``states`` (n, 4) are gauge pressure
    [Pa], muscle length [m], muscle velocity [m/s] and unit length [m]; ``internal_states`` is (n, N_INTERNAL_STATES).
    """
    for k in range(len(states)):
        state = DeviceState(states[k, 0], states[k, 1], to_tuple(internal_states[k], N_INTERNAL_STATES))
        fill_outputs(rows[min(k, len(rows) - 1)], state, states[k, 3], states[k, 2], out[k])


def to_tuple(numbers: Any, count: int) -> tuple[float, ...]:
    """Return the first ``count`` of ``numbers``; numba replaces this function with its own."""
    return tuple(float(number) for number in numbers[:count])


@cache
def compile_functions() -> Any:
    """Return a copy of this module with compiled functions."""
    from numba.np.unsafe.ndarray import to_fixed_tuple

    from klute_sim.device import batch_outputs
    from klute_sim.device.backend import compiled
    from klute_sim.device.energy import outputs

    device_functions = compiled.compile_device_functions()
    compiled_outputs = compiled.compile_module(outputs, **device_functions)
    return compiled.compile_module(
        batch_outputs,
        **device_functions,
        compute_outputs=compiled_outputs.compute_outputs,
        compute_effect_forces=compiled_outputs.compute_effect_forces,
        to_tuple=to_fixed_tuple,
    )


@cache
def _compile_evaluate_batch() -> Callable[..., None]:
    import numba

    from klute_sim.device.backend import compiled

    table = numba.float64[:, ::1]
    signature = numba.void(numba.float64[:, :, ::1], table, table, table)
    function: Callable[..., None] = compiled.compile_cached(
        partial(numba.njit, nogil=True), compile_functions().evaluate_batch, signature
    )
    return function


class BatchOutputs:
    """Compute the outputs of many simulations of one device, or of devices with the same effects."""

    def __init__(self, parameters: DeviceParameters, backend: str) -> None:
        """Prepare for the device ``parameters``; ``backend`` is ``"compiled"`` or ``"python"``."""
        self.effect_names = accumulate_effects(parameters)[0]
        """Names of the device's effects."""
        self.n_columns = N_OUTPUTS + 2 * len(self.effect_names)
        """Number of columns: the :class:`DeviceOutputs`, then two forces [N] for each effect."""
        self._rows = np.array([_pack_cumulative_parameters(parameters)])
        self._is_compiled = backend == "compiled" and not explain_missing_compiler()
        if self._is_compiled:
            _compile_evaluate_batch()

    def set_parameters(self, index: int, parameters: DeviceParameters, n_simulations: int) -> None:
        """Set the device of simulation ``index`` of ``n_simulations``; it has the same effects as the others."""
        if len(self._rows) != n_simulations:
            self._rows = np.repeat(self._rows, n_simulations, axis=0)
        self._rows[index] = _pack_cumulative_parameters(parameters)

    def evaluate(self, states: Array, internal_states: Array) -> Array:
        """Return the outputs (n, ``n_columns``) for ``states`` and ``internal_states`` as in :func:`evaluate_batch`."""
        out = np.empty((len(states), self.n_columns))
        rows: Any = self._rows if self._is_compiled else self._rows.tolist()
        # Looked up at each call, because a pickle must not contain compiled code.
        evaluate = _compile_evaluate_batch() if self._is_compiled else evaluate_batch
        evaluate(rows, np.ascontiguousarray(states), np.ascontiguousarray(internal_states), out)
        return out


def _pack_cumulative_parameters(parameters: DeviceParameters) -> Array:
    return np.array([pack_parameters(device) for device in accumulate_effects(parameters)[1]])
