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

from klute_sim.device.installation import choose
from klute_sim.device.step import DEAD_TIME, MEMORY, Parameters, State, advance, taut, tension
from klute_sim.device.vector import pack, unpack
from klute_sim.errors import InputError, SimulationError

LONGEST_STEP = 0.01
"""[s]"""

Array = NDArray[np.float64]


class Trace(NamedTuple):
    """What the device did: one entry per sample, or (rollouts, samples)."""

    tension: Array
    """[N]"""
    pressure: Array
    """Gauge pressure [Pa]."""
    length: Array
    """Muscle length [m]."""


def run(
    row: Sequence[float],
    pressure: float,
    length: float,
    memory: tuple[float, ...],
    unit_length: Sequence[float],
    command: Sequence[float],
    step: float,
    out: Array,
) -> None:
    """Fill ``out`` (samples, 3) with tension, pressure and muscle length after each ``step``; SI.

    ``row`` is the device's parameters; ``pressure``, ``length`` and ``memory`` are where it begins.
    """
    parameters = unpack(row)
    late = parameters.effects[DEAD_TIME] / step
    before = State(pressure, length, memory)
    for k in range(len(unit_length)):
        after = advance(parameters, before, unit_length[k], earlier(command, k - late), step)
        rate = (after.length - before.length) / step
        out[k, 0] = tension(parameters, after, unit_length[k], rate)
        out[k, 1], out[k, 2] = after.pressure, after.length
        before = after


def earlier(series: Sequence[float], place: float) -> float:
    """``series`` between its samples at ``place``, counted in samples; its first value before it begins."""
    if place <= 0.0:
        return series[0]
    k = int(place)
    share = place - k
    if share == 0.0:
        return series[k]
    return series[k] + share * (series[k + 1] - series[k])


@cache
def obstacle() -> str:
    """Why there is no compiled law here, or ''."""
    try:
        import numba  # noqa: F401
    except ImportError as error:
        return f"numba cannot be imported ({error})"
    return ""


@cache
def _compiled() -> Callable[..., None]:
    import numba

    from klute_sim.device import compiled, rollout

    copy = compiled.copy_of(rollout, **compiled.device_law())
    # The lock of Python's is free while it runs, so threads run at once.
    wrap = partial(numba.njit, nogil=True)
    number = numba.float64
    memory, series = numba.types.UniTuple(number, MEMORY), number[::1]
    signature = numba.void(series, number, number, memory, series, series, number, number[:, ::1])
    ready: Callable[..., None] = compiled.ready(wrap, copy.run, signature)
    return ready


def rollout(
    parameters: Parameters | Sequence[Parameters],
    unit_length: ArrayLike,
    command: ArrayLike,
    step: float,
    *,
    start: State | Sequence[State] | None = None,
    threads: int = 0,
    law: str = "auto",
) -> Trace:
    """Let devices follow prescribed lengths [m] and pressure commands [Pa], one sample per ``step`` [s].

    ``parameters`` is one device or one per rollout; lengths and commands are (samples,) for all or (rollouts,
    samples). Each begins at ``start``, by default with the tendon just taut at its first length and command. Uses
    ``threads`` threads (0: all cores).

    Raises InputError for shapes that do not fit, what is not finite, or a step beyond :data:`LONGEST_STEP`;
    SimulationError if a result is not finite.
    """
    if threads < 0:
        raise InputError(f"threads is {threads}; allowed: 0 (all cores) or more")
    single = isinstance(parameters, Parameters)
    devices: list[Parameters] = [parameters] if isinstance(parameters, Parameters) else list(parameters)
    lengths, commands = np.asarray(unit_length, dtype=np.float64), np.asarray(command, dtype=np.float64)
    if not 0.0 < step <= LONGEST_STEP:
        raise InputError(f"step is {step:g}; allowed: above 0, up to {LONGEST_STEP:g} s")
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
    starts = [taut(d, float(x[0]), float(c[0])) for d, x, c in zip(devices, lengths, commands, strict=True)]
    if start is not None:
        starts = [start] * count if isinstance(start, State) else list(start)
    if len(starts) != count:
        raise InputError(f"{len(starts)} states to start from for {count} rollouts")

    out = np.empty((*shape, 3))
    compiled = choose(law, obstacle) == "compiled"
    function: Callable[..., None] = _compiled() if compiled else run

    def one(i: int) -> None:
        row: Any = np.array(pack(devices[i])) if compiled else pack(devices[i])
        x, c = (lengths[i], commands[i]) if compiled else (lengths[i].tolist(), commands[i].tolist())
        function(row, float(starts[i].pressure), float(starts[i].length), starts[i].memory, x, c, float(step), out[i])

    workers = min(threads or os.cpu_count() or 1, count)
    if workers == 1 or not compiled:
        for i in range(count):
            one(i)
    else:
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(one, range(count)))
    if not np.isfinite(out).all():
        i, k = (int(index) for index in np.argwhere(~np.isfinite(out))[0][:2])
        raise SimulationError(f"rollout {i} has no finite state at t = {k * step:.4f} s")
    found = out[0] if single else out
    return Trace(*(np.ascontiguousarray(found[..., k]) for k in range(3)))
