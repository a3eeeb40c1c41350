"""Simulate one device under a prescribed length without MuJoCo, and record its outputs and its energy balance.

:mod:`klute_sim.device.rollout` is for many rollouts that need force, pressure and length only. The time steps are the
same. The compiled and the Python backend agree to the last bit.
"""

from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from klute_sim.device.backend.packing import pack_parameters, unpack_parameters
from klute_sim.device.backend.select import explain_missing_compiler, select_backend
from klute_sim.device.batch_outputs import N_OUTPUTS, fill_outputs
from klute_sim.device.delay import interpolate_samples
from klute_sim.device.dynamics import (
    N_INTERNAL_STATES,
    DeviceParameters,
    DeviceState,
    advance_state,
    apply_supply_effects,
    get_dead_time,
)
from klute_sim.device.energy.ledger import EnergyBalance, compute_energy_balance
from klute_sim.device.energy.outputs import accumulate_effects
from klute_sim.device.equilibrium import compute_taut_state
from klute_sim.device.nonfinite import MATH_ERRORS, check_finite, integrate_in_python, make_nonfinite_error
from klute_sim.laws import pneumatic_step
from klute_sim.types import Array

N_STATE_COLUMNS = 3
"""Number of columns before the outputs: gauge pressure [Pa], muscle length [m] and muscle velocity [m/s]."""


class RolloutRecord(NamedTuple):
    """Response of the device with one entry per sample; SI."""

    tension: Array
    """Tension of the muscle-tendon unit [N]."""
    pressure: Array
    """Gauge pressure in the muscle [Pa]."""
    length: Array
    """Muscle length [m]."""
    velocity: Array
    """Muscle velocity dl/dt during the time step [m/s]."""
    energy_balance: EnergyBalance
    """Energy balance between consecutive samples."""


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
    """Fill ``out`` (samples, :data:`N_STATE_COLUMNS` + ``N_OUTPUTS`` + 2 for each effect) after each step ``dt``; SI.

    ``rows`` holds the packed parameters of :func:`klute_sim.device.energy.outputs.accumulate_effects`; ``pressure``,
    ``length`` and ``internal_state`` are the initial state.
    """
    parameters = unpack_parameters(rows[-1])
    delay_steps = get_dead_time(parameters) / dt
    before = DeviceState(pressure, length, internal_state)
    for k in range(len(unit_length)):
        after = advance_state(parameters, before, unit_length[k], interpolate_samples(command, k - delay_steps), dt)
        velocity = (after.length - before.length) / dt
        out[k, 0], out[k, 1], out[k, 2] = after.pressure, after.length, velocity
        fill_outputs(rows, after, unit_length[k], velocity, out[k, N_STATE_COLUMNS:])
        before = after


@cache
def _compile_integrate() -> Callable[..., None]:
    import numba

    from klute_sim.device import batch_outputs, recorded_rollout
    from klute_sim.device.backend import compiled

    module = compiled.compile_module(
        recorded_rollout,
        **compiled.compile_device_functions(),
        fill_outputs=batch_outputs.compile_functions().fill_outputs,
    )
    number = numba.float64
    internal_state, series = numba.types.UniTuple(number, N_INTERNAL_STATES), number[::1]
    table = number[:, ::1]
    signature = numba.void(table, number, number, internal_state, series, series, number, table)
    function: Callable[..., None] = compiled.compile_cached(
        partial(numba.njit, nogil=True), module.integrate, signature
    )
    return function


def record_rollout(
    parameters: DeviceParameters,
    unit_length: ArrayLike,
    command: ArrayLike,
    dt: float,
    *,
    initial_state: DeviceState | None = None,
    backend: str = "auto",
) -> RolloutRecord:
    """Simulate a device that follows unit lengths [m] and pressure commands [Pa], one sample per ``dt`` [s] each.

    The rollout starts in ``initial_state``; by default the tendon is just taut at the first length and command.

    Raises SimulationError when a result is not finite.
    """
    lengths, commands = (np.array(x, dtype=np.float64, order="C") for x in (unit_length, command))
    if initial_state is None:
        try:
            initial_state = compute_taut_state(parameters, float(lengths[0]), float(commands[0]))
        except MATH_ERRORS:
            raise make_nonfinite_error("the device", "initial state", 0.0) from None
    effect_names, devices = accumulate_effects(parameters)
    out = np.empty((len(lengths), N_STATE_COLUMNS + N_OUTPUTS + 2 * len(effect_names)))
    rows = [pack_parameters(device) for device in devices]
    state = float(initial_state.pressure), float(initial_state.length), initial_state.internal_state
    if select_backend(backend, explain_missing_compiler) == "compiled":
        _compile_integrate()(np.array(rows), *state, lengths, commands, float(dt), out)
    else:
        integrate_in_python(integrate, out, rows, *state, lengths.tolist(), commands.tolist(), float(dt))
    check_finite(out, "the device", parameters, initial_state, lengths, commands, dt)
    pressure, length, velocity = (np.ascontiguousarray(column) for column in out[:, :N_STATE_COLUMNS].T)
    first_force = N_STATE_COLUMNS + N_OUTPUTS
    outputs = out[:, N_STATE_COLUMNS:first_force]
    effect_forces = out[:, first_force:].reshape(len(out), len(effect_names), 2)
    supply = apply_supply_effects(parameters, initial_state.internal_state)
    energy_balance = compute_energy_balance(
        outputs,
        effect_forces,
        effect_names,
        length,
        lengths,
        dt,
        supply_meters_air=not pneumatic_step.is_ideal(supply),
    )
    return RolloutRecord(np.ascontiguousarray(outputs[:, 0]), pressure, length, velocity, energy_balance)
