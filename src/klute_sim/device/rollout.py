"""Simulate devices under prescribed lengths without MuJoCo: many rollouts on all cores.

The time steps are those that the device takes inside MuJoCo. One thread computes one rollout from its first to its last
step, so results do not depend on the number of threads.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from klute_sim.device.backend.packing import pack_parameters, unpack_parameters
from klute_sim.device.backend.select import explain_missing_compiler, select_backend
from klute_sim.device.delay import interpolate_samples
from klute_sim.device.dynamics import (
    N_INTERNAL_STATES,
    DeviceParameters,
    DeviceState,
    advance_state,
    compute_tension,
    get_dead_time,
)
from klute_sim.device.equilibrium import compute_taut_state
from klute_sim.device.nonfinite import MATH_ERRORS, check_finite, integrate_in_python, make_nonfinite_error
from klute_sim.errors import InputError
from klute_sim.types import Array

MAX_TIME_STEP = 0.01
"""Longest allowed time step [s]."""


class RolloutTrace(NamedTuple):
    """Response of the device: (samples,), or (rollouts, samples)."""

    tension: Array
    """Tension of the muscle-tendon unit [N]."""
    pressure: Array
    """Gauge pressure in the muscle [Pa]."""
    length: Array
    """Muscle length [m]."""


def integrate(
    row: Sequence[float],
    pressure: float,
    length: float,
    internal_state: tuple[float, ...],
    unit_length: Sequence[float],
    command: Sequence[float],
    dt: float,
    out: Array,
) -> None:
    """Fill ``out`` (samples, 3) with tension, pressure and muscle length after each time step ``dt``; SI.

    ``row`` holds the packed parameters; ``pressure``, ``length`` and ``internal_state`` are the initial state.
    """
    parameters = unpack_parameters(row)
    delay_steps = get_dead_time(parameters) / dt
    before = DeviceState(pressure, length, internal_state)
    for k in range(len(unit_length)):
        after = advance_state(parameters, before, unit_length[k], interpolate_samples(command, k - delay_steps), dt)
        velocity = (after.length - before.length) / dt
        out[k, 0] = compute_tension(parameters, after, unit_length[k], velocity)
        out[k, 1], out[k, 2] = after.pressure, after.length
        before = after


@cache
def _compile_integrate() -> Callable[..., None]:
    import numba

    from klute_sim.device import rollout
    from klute_sim.device.backend import compiled

    module = compiled.compile_module(rollout, **compiled.compile_device_functions())
    # The function releases Python's lock, so threads run in parallel.
    decorator = partial(numba.njit, nogil=True)
    number = numba.float64
    internal_state, series = numba.types.UniTuple(number, N_INTERNAL_STATES), number[::1]
    signature = numba.void(series, number, number, internal_state, series, series, number, number[:, ::1])
    function: Callable[..., None] = compiled.compile_cached(decorator, module.integrate, signature)
    return function


def simulate_rollouts(
    parameters: DeviceParameters | Sequence[DeviceParameters],
    unit_length: ArrayLike,
    command: ArrayLike,
    dt: float,
    *,
    initial_state: DeviceState | Sequence[DeviceState] | None = None,
    n_jobs: int = 0,
    backend: str = "auto",
) -> RolloutTrace:
    """Simulate devices that follow prescribed unit lengths [m] and pressure commands [Pa], one sample per ``dt`` [s].

    ``parameters`` is one device for all rollouts, or one per rollout. ``unit_length`` and ``command`` have the shape
    (samples,) for all rollouts, or (rollouts, samples). Each rollout starts in ``initial_state``; by default the
    tendon is just taut at the first length and command. ``n_jobs`` is the number of threads (0: all cores) and
    ``backend`` one of :data:`klute_sim.device.backend.select.BACKENDS`.

    Raises InputError when shapes do not match, inputs are not finite, or ``dt`` is beyond :data:`MAX_TIME_STEP`.
    Raises SimulationError when a result is not finite.
    """
    if n_jobs < 0:
        raise InputError(f"n_jobs is {n_jobs}; allowed: 0 (all cores) or more")
    is_single = isinstance(parameters, DeviceParameters)
    devices: list[DeviceParameters] = [parameters] if isinstance(parameters, DeviceParameters) else list(parameters)
    lengths, commands = np.asarray(unit_length, dtype=np.float64), np.asarray(command, dtype=np.float64)
    shape = _check_inputs(len(devices), lengths, commands, dt)
    is_single = is_single and shape[0] == 1 and max(lengths.ndim, commands.ndim) == 1
    n_rollouts, _ = shape
    devices = devices * n_rollouts if len(devices) == 1 else devices
    lengths, commands = (np.array(np.broadcast_to(x, shape), order="C") for x in (lengths, commands))
    if initial_state is None:
        states = [
            _compute_initial_state(i, device, float(x[0]), float(c[0]))
            for i, (device, x, c) in enumerate(zip(devices, lengths, commands, strict=True))
        ]
    else:
        states = [initial_state] * n_rollouts if isinstance(initial_state, DeviceState) else list(initial_state)
    if len(states) != n_rollouts:
        raise InputError(f"{len(states)} initial states for {n_rollouts} rollouts; allowed: one, or one per rollout")

    out = np.empty((*shape, 3))
    is_compiled = select_backend(backend, explain_missing_compiler) == "compiled"
    function: Callable[..., None] = _compile_integrate() if is_compiled else integrate

    def simulate_one(i: int) -> None:
        row: Any = pack_parameters(devices[i])
        state = float(states[i].pressure), float(states[i].length), states[i].internal_state
        if is_compiled:
            function(np.array(row), *state, lengths[i], commands[i], float(dt), out[i])
        else:
            integrate_in_python(function, out[i], row, *state, lengths[i].tolist(), commands[i].tolist(), float(dt))

    n_threads = min(n_jobs or os.cpu_count() or 1, n_rollouts)
    if n_threads == 1 or not is_compiled:
        for i in range(n_rollouts):
            simulate_one(i)
    else:
        with ThreadPoolExecutor(n_threads) as pool:
            list(pool.map(simulate_one, range(n_rollouts)))
    for i in np.flatnonzero(~np.isfinite(out).all(axis=(1, 2))).tolist():
        check_finite(out[i], f"rollout {i}", devices[i], states[i], lengths[i], commands[i], dt)
    result = out[0] if is_single else out
    return RolloutTrace(*(np.ascontiguousarray(result[..., k]) for k in range(3)))


def _compute_initial_state(index: int, device: DeviceParameters, unit_length: float, command: float) -> DeviceState:
    try:
        return compute_taut_state(device, unit_length, command)
    except MATH_ERRORS:
        raise make_nonfinite_error(f"rollout {index}", "initial state", 0.0) from None


def _check_inputs(n_devices: int, lengths: Array, commands: Array, dt: float) -> tuple[int, ...]:
    """Return the common shape (rollouts, samples) of the inputs; raises InputError when they do not match."""
    if not 0.0 < dt <= MAX_TIME_STEP:
        raise InputError(f"dt is {dt:g}; allowed: above 0, up to {MAX_TIME_STEP:g} s")
    if not (np.isfinite(lengths).all() and np.isfinite(commands).all()):
        raise InputError("lengths and commands must be finite everywhere")
    try:
        shape = np.broadcast_shapes((n_devices, 1), lengths.shape, commands.shape)
    except ValueError:
        shape = ()
    if len(shape) != 2 or 0 in shape or 0 in (lengths.ndim, commands.ndim):
        raise InputError(
            f"{n_devices} devices, lengths {lengths.shape} and commands {commands.shape} do not fit together; "
            "allowed: (samples,) or (rollouts, samples)"
        )
    return shape
