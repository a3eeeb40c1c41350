"""The device alone, under a prescribed length: many rollouts on all cores, without MuJoCo.

The steps are those the device takes inside MuJoCo. One rollout is one thread's work from its first step to its last,
so results do not depend on the number of threads.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from klute_sim.device.backend.packing import pack_parameters, unpack_parameters
from klute_sim.device.backend.select import select_backend
from klute_sim.device.dynamics import (
    DEAD_TIME_INDEX,
    N_INTERNAL_STATES,
    DeviceParameters,
    DeviceState,
    advance_state,
    compute_taut_state,
    compute_tension,
)
from klute_sim.errors import InputError, SimulationError

MAX_TIME_STEP = 0.01
"""[s]"""

Array = NDArray[np.float64]


class RolloutTrace(NamedTuple):
    """What the device did: one entry per sample, or (rollouts, samples)."""

    tension: Array
    """[N]"""
    pressure: Array
    """Gauge pressure [Pa]."""
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
    """Fill ``out`` (samples, 3) with tension, pressure and muscle length after each ``step``; SI.

    ``row`` is the device's parameters; ``pressure``, ``length`` and ``memory`` are where it begins.
    """
    parameters = unpack_parameters(row)
    late = parameters.effects[DEAD_TIME_INDEX] / dt
    before = DeviceState(pressure, length, internal_state)
    for k in range(len(unit_length)):
        after = advance_state(parameters, before, unit_length[k], interpolate_samples(command, k - late), dt)
        rate = (after.length - before.length) / dt
        out[k, 0] = compute_tension(parameters, after, unit_length[k], rate)
        out[k, 1], out[k, 2] = after.pressure, after.length
        before = after


def interpolate_samples(samples: Sequence[float], index: float) -> float:
    """``series`` between its samples at ``place``, counted in samples; its first value before it begins."""
    if index <= 0.0:
        return samples[0]
    k = int(index)
    share = index - k
    if share == 0.0:
        return samples[k]
    return samples[k] + share * (samples[k + 1] - samples[k])


@cache
def find_numba_incompatibility() -> str:
    """Why there is no compiled law here, or ''."""
    try:
        import numba  # noqa: F401
    except ImportError as error:
        return f"numba cannot be imported ({error})"
    return ""


@cache
def _compile_integrate() -> Callable[..., None]:
    import numba

    from klute_sim.device import rollout
    from klute_sim.device.backend import compiled

    copy = compiled.compile_module(rollout, **compiled.compile_device_functions())
    # The lock of Python's is free while it runs, so threads run at once.
    wrap = partial(numba.njit, nogil=True)
    number = numba.float64
    memory, series = numba.types.UniTuple(number, N_INTERNAL_STATES), number[::1]
    signature = numba.void(series, number, number, memory, series, series, number, number[:, ::1])
    ready: Callable[..., None] = compiled.compile_cached(wrap, copy.integrate, signature)
    return ready


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
    """Let devices follow prescribed lengths [m] and pressure commands [Pa], one sample per ``step`` [s].

    ``parameters`` is one device or one per rollout; lengths and commands are (samples,) for all or (rollouts,
    samples). Each begins at ``start``, by default with the tendon just taut at its first length and command. Uses
    ``threads`` threads (0: all cores).

    Raises InputError for shapes that do not fit, what is not finite, or a step beyond :data:`LONGEST_STEP`;
    SimulationError if a result is not finite.
    """
    if n_jobs < 0:
        raise InputError(f"threads is {n_jobs}; allowed: 0 (all cores) or more")
    single = isinstance(parameters, DeviceParameters)
    devices: list[DeviceParameters] = [parameters] if isinstance(parameters, DeviceParameters) else list(parameters)
    lengths, commands = np.asarray(unit_length, dtype=np.float64), np.asarray(command, dtype=np.float64)
    if not 0.0 < dt <= MAX_TIME_STEP:
        raise InputError(f"step is {dt:g}; allowed: above 0, up to {MAX_TIME_STEP:g} s")
    if not (np.isfinite(lengths).all() and np.isfinite(commands).all()):
        raise InputError("lengths and commands must be finite everywhere")
    try:
        shape = np.broadcast_shapes((len(devices), 1), lengths.shape, commands.shape)
    except ValueError:
        shape = ()
    if len(shape) != 2 or 0 in shape or 0 in (lengths.ndim, commands.ndim):
        raise InputError(
            f"{len(devices)} devices, lengths {lengths.shape} and commands {commands.shape} do not fit together; "
            "allowed: (samples,) or (rollouts, samples)"
        )
    single = single and shape[0] == 1 and max(lengths.ndim, commands.ndim) == 1
    count, _ = shape
    devices = devices * count if len(devices) == 1 else devices
    lengths, commands = (np.array(np.broadcast_to(x, shape), order="C") for x in (lengths, commands))
    starts = [
        compute_taut_state(d, float(x[0]), float(c[0])) for d, x, c in zip(devices, lengths, commands, strict=True)
    ]
    if initial_state is not None:
        starts = [initial_state] * count if isinstance(initial_state, DeviceState) else list(initial_state)
    if len(starts) != count:
        raise InputError(f"{len(starts)} states to start from for {count} rollouts")

    out = np.empty((*shape, 3))
    compiled = select_backend(backend, find_numba_incompatibility) == "compiled"
    function: Callable[..., None] = _compile_integrate() if compiled else integrate

    def one(i: int) -> None:
        row: Any = np.array(pack_parameters(devices[i])) if compiled else pack_parameters(devices[i])
        x, c = (lengths[i], commands[i]) if compiled else (lengths[i].tolist(), commands[i].tolist())
        function(
            row, float(starts[i].pressure), float(starts[i].length), starts[i].internal_state, x, c, float(dt), out[i]
        )

    workers = min(n_jobs or os.cpu_count() or 1, count)
    if workers == 1 or not compiled:
        for i in range(count):
            one(i)
    else:
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(one, range(count)))
    if not np.isfinite(out).all():
        i, k = (int(index) for index in np.argwhere(~np.isfinite(out))[0][:2])
        raise SimulationError(f"rollout {i} has no finite state at t = {k * dt:.4f} s")
    found = out[0] if single else out
    return RolloutTrace(*(np.ascontiguousarray(found[..., k]) for k in range(3)))
