"""One rollout of the device alone with everything about it written down, its ledger included; without MuJoCo.

:mod:`klute_sim.device.rollout` is for many rollouts of which only force, pressure and length matter. The steps are
the same. Compiled and plain Python give the same bits.
"""

from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from klute_sim.device.backend.packing import pack_parameters, unpack_parameters
from klute_sim.device.backend.select import select_backend
from klute_sim.device.batch_outputs import N_OUTPUTS, fill_outputs
from klute_sim.device.dynamics import (
    DEAD_TIME_INDEX,
    N_INTERNAL_STATES,
    DeviceParameters,
    DeviceState,
    advance_state,
    apply_supply_effects,
    compute_taut_state,
)
from klute_sim.device.energy.ledger import EnergyBalance, compute_energy_balance
from klute_sim.device.energy.outputs import accumulate_effects
from klute_sim.device.rollout import find_numba_incompatibility, interpolate_samples
from klute_sim.errors import SimulationError
from klute_sim.laws import pneumatic_step

Array = NDArray[np.float64]

N_STATE_COLUMNS = 3
"""Columns before those of a snapshot: gauge pressure [Pa], muscle length [m], its rate [m/s]."""


class RolloutRecord(NamedTuple):
    """One entry per sample; SI."""

    tension: Array
    """[N]"""
    pressure: Array
    """Gauge pressure [Pa]."""
    length: Array
    """Muscle length [m]."""
    velocity: Array
    """Of the muscle's length in this step [m/s]."""
    energy_balance: EnergyBalance


def integrate(
    rows: Sequence[Sequence[float]],
    pressure: float,
    length: float,
    internal_state: tuple[float, ...],
    unit_length: Sequence[float],
    command: Sequence[float],
    dt: float,
    out: Array,
) -> None:
    """Fill ``out`` (samples, :data:`STATES` + :data:`FIELDS` + 2 for each effect) after each ``step``; SI.

    ``rows`` are the parameters of :func:`klute_sim.device.energy.outputs.stages`; ``pressure``, ``length`` and ``memory`` are
    where the device begins.
    """
    parameters = unpack_parameters(rows[-1])
    late = parameters.effects[DEAD_TIME_INDEX] / dt
    before = DeviceState(pressure, length, internal_state)
    for k in range(len(unit_length)):
        after = advance_state(parameters, before, unit_length[k], interpolate_samples(command, k - late), dt)
        rate = (after.length - before.length) / dt
        out[k, 0], out[k, 1], out[k, 2] = after.pressure, after.length, rate
        fill_outputs(rows, after, unit_length[k], rate, out[k, N_STATE_COLUMNS:])
        before = after


@cache
def _compile_integrate() -> Callable[..., None]:
    import numba

    from klute_sim.device import batch_outputs, recorded_rollout, rollout
    from klute_sim.device.backend import compiled

    law = compiled.compile_device_functions()
    early = compiled.compile_module(rollout, **law).interpolate_samples
    copy = compiled.compile_module(
        recorded_rollout, **law, fill_outputs=batch_outputs.compile_functions().fill_outputs, interpolate_samples=early
    )
    number = numba.float64
    memory, series = numba.types.UniTuple(number, N_INTERNAL_STATES), number[::1]
    signature = numba.void(number[:, ::1], number, number, memory, series, series, number, number[:, ::1])
    ready: Callable[..., None] = compiled.compile_cached(partial(numba.njit, nogil=True), copy.integrate, signature)
    return ready


def record_rollout(
    parameters: DeviceParameters,
    unit_length: ArrayLike,
    command: ArrayLike,
    dt: float,
    *,
    initial_state: DeviceState | None = None,
    backend: str = "auto",
) -> RolloutRecord:
    """Let the device follow lengths [m] and pressure commands [Pa], one sample per ``step`` [s] each.

    ``start`` is where it begins (left out: the tendon just taut at the first length and command).

    Raises SimulationError if a result is not finite.
    """
    lengths, commands = (np.array(x, dtype=np.float64, order="C") for x in (unit_length, command))
    begin = (
        compute_taut_state(parameters, float(lengths[0]), float(commands[0]))
        if initial_state is None
        else initial_state
    )
    names, devices = accumulate_effects(parameters)
    out = np.empty((len(lengths), N_STATE_COLUMNS + N_OUTPUTS + 2 * len(names)))
    rows: Any = np.array([pack_parameters(device) for device in devices])
    series: Any = (lengths, commands)
    compiled = select_backend(backend, find_numba_incompatibility) == "compiled"
    if not compiled:
        series, rows = (x.tolist() for x in series), rows.tolist()
    function: Callable[..., None] = _compile_integrate() if compiled else integrate
    function(rows, float(begin.pressure), float(begin.length), begin.internal_state, *series, float(dt), out)
    if not np.isfinite(out).all():
        first = int(np.argwhere(~np.isfinite(out))[0][0])
        raise SimulationError(f"the device has no finite state at t = {first * dt:.4f} s")
    pressure, length, rate = (np.ascontiguousarray(column) for column in out[:, :N_STATE_COLUMNS].T)
    instants, own = (
        out[:, N_STATE_COLUMNS : N_STATE_COLUMNS + N_OUTPUTS],
        out[:, N_STATE_COLUMNS + N_OUTPUTS :].reshape(len(out), len(names), 2),
    )
    counts = not pneumatic_step.is_ideal(apply_supply_effects(parameters, begin.internal_state))
    told = compute_energy_balance(instants, own, names, length, lengths, dt, supply_meters_air=counts)
    return RolloutRecord(np.ascontiguousarray(instants[:, 0]), pressure, length, rate, told)
