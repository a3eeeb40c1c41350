"""The prosthesis on a prescribed shank, step by step.

With the base prescribed, the ankle is the only coordinate that is free, so a step is the device's implicit step and one
equation (:mod:`klute_sim.laws.foot`). Taken from the MJCF and compiled, a step takes 0.9 us, where MuJoCo with its base
put into place from Python takes 5 us and Python's lock: here trials are simulated on all cores. What it leaves out is
the heel's spring; against a walk of the gait rig at the same step that is 0.005 degrees and 0.2 N (rms, a test).
"""

import inspect
import sys
from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from klute_sim.device.installation import choose
from klute_sim.device.rollout import earlier, obstacle
from klute_sim.device.step import DEAD_TIME, MEMORY, Parameters, State, advance, taut, tension
from klute_sim.device.vector import pack, unpack
from klute_sim.errors import InputError, SimulationError
from klute_sim.laws import foot as _foot
from klute_sim.laws.foot import Base, Foot

LONGEST_STEP = 2e-3
"""[s]; beyond it the ankle's own oscillation, some 40 Hz on a stiff tendon, is no longer followed."""
SETTLING = 0.5
"""Time [s] for which the first inputs are held before a replay begins, from rest."""

Array = NDArray[np.float64]


class Inputs(NamedTuple):
    """What is prescribed, (samples,) each, one per step."""

    angle: Array
    """Lean of the shank, forward positive [rad]."""
    turning: Array
    """Its second derivative [rad/s2]."""
    forward: Array
    upward: Array
    """Acceleration of the ankle [m/s2]."""
    ground: Array
    """Moment of the ground reaction about the ankle [N.m], plantarflexing positive."""
    along: Array
    across: Array
    """The ground reaction along the pylon, up it positive, and across it, backward positive [N]."""
    command: Array
    """Pressure [Pa]."""


class Replay(NamedTuple):
    """What the prosthesis did, (samples,) each, at the beginning of each step."""

    tension: Array
    """[N]"""
    pressure: Array
    """Gauge [Pa]."""
    length: Array
    """Of the muscle [m]."""
    angle: Array
    """Of the foot against the pylon, dorsiflexion positive [rad]: the hinge, and what the foot bends."""
    moment: Array
    """Of tendon, spring, damping, friction and stops about the ankle [N.m], plantarflexor positive."""


def run(
    row: Sequence[float],
    foot: Foot,
    pressure: float,
    length: float,
    memory: tuple[float, ...],
    inputs: Sequence[Sequence[float]],
    command: Sequence[float],
    settling: int,
    step: float,
    out: Array,
) -> None:
    """Fill ``out`` (samples, 5) in the order of :class:`Replay`; SI.

    ``row`` is the device's parameters, ``inputs`` (samples, 7) those of :class:`Inputs` but the command. The first
    of them are held for ``settling`` steps before that, with nothing accelerating.
    """
    parameters = unpack(row)
    late = parameters.effects[DEAD_TIME] / step
    before, angle, rate, bent = State(pressure, length, memory), 0.0, 0.0, 0.0
    for n in range(-settling, len(inputs)):
        k = max(n, 0)
        now = inputs[k]
        base = Base(now[0], now[1], now[2], now[3], now[4]) if n >= 0 else Base(now[0], 0.0, 0.0, 0.0, now[4])
        ground = base.ground + _foot.sinking(foot, base, now[5]) * now[6]
        base = Base(base.angle, base.turning, base.forward, base.upward, ground)
        whole = _foot.unit_length(foot, angle)
        after = advance(parameters, before, whole, earlier(command, n - late), step)
        pull = tension(parameters, after, whole, (after.length - before.length) / step)
        then = _foot.turn(foot, angle, rate, pull, base, step)
        bent = _foot.bend(foot, bent, then.moment, step)
        out[k, 0], out[k, 1], out[k, 2] = pull, after.pressure, after.length
        out[k, 3], out[k, 4] = bent - angle, then.moment
        before, angle, rate = after, then.angle, then.rate


@cache
def _compiled() -> Callable[..., None]:
    import numba

    from klute_sim.device import compiled

    here = sys.modules[__name__]
    # The lock of Python's is free while it runs, so threads run at once.
    wrap = partial(numba.njit, nogil=True)
    late = compiled.copy_of(sys.modules[earlier.__module__]).earlier
    copy = compiled.copy_of(here, earlier=late, **compiled.device_law())
    number = numba.float64
    memory, series = numba.types.UniTuple(number, MEMORY), number[::1]
    foot = numba.types.NamedUniTuple(number, len(Foot._fields), Foot)
    table = number[:, ::1]
    signature = numba.void(series, foot, number, number, memory, table, series, numba.int64, number, table)
    ready: Callable[..., None] = compiled.ready(wrap, copy.run, signature, inspect.getsource(here))
    return ready


def replay(parameters: Parameters, foot: Foot, inputs: Inputs, step: float, *, law: str = "auto") -> Replay:
    """``parameters`` on ``foot``, following ``inputs``, one of each per ``step`` [s].

    It begins at rest under the first inputs, which are held for :data:`SETTLING` before.

    Raises InputError for inputs that do not fit together or are not finite, a device without a tendon of its own, or a
    step beyond :data:`LONGEST_STEP`; SimulationError if a result is not finite.
    """
    if not 0.0 < step <= LONGEST_STEP:
        raise InputError(f"step is {step:g}; allowed: above 0, up to {LONGEST_STEP:g} s")
    if parameters.tendon.rigid:
        raise InputError("a device without a tendon cannot be replayed on an ankle; give it a [tendon] section")
    shapes = {np.shape(series) for series in inputs}
    if len(shapes) != 1 or len(next(iter(shapes))) != 1 or 0 in next(iter(shapes)):
        raise InputError(f"inputs of shapes {sorted(shapes)} do not fit together; allowed: (samples,), alike")
    table = np.column_stack([np.asarray(series, dtype=np.float64) for series in inputs])
    if not np.isfinite(table).all():
        raise InputError("what is prescribed must be finite everywhere")
    motion, command = np.ascontiguousarray(table[:, :-1]), np.ascontiguousarray(table[:, -1])
    out = np.empty((len(table), len(Replay._fields)))
    start = taut(parameters, _foot.unit_length(foot, 0.0), float(command[0]))
    settling = round(SETTLING / step)
    begin = (float(start.pressure), float(start.length), start.memory)
    if choose(law, obstacle) == "compiled":
        _compiled()(np.array(pack(parameters)), foot, *begin, motion, command, settling, float(step), out)
    else:
        row: Any = pack(parameters)
        run(row, foot, *begin, motion.tolist(), command.tolist(), settling, float(step), out)
    if not np.isfinite(out).all():
        k = int(np.argwhere(~np.isfinite(out))[0][0])
        raise SimulationError(f"the replay has no finite state at t = {k * step:.4f} s")
    return Replay(*(np.ascontiguousarray(out[:, k]) for k in range(out.shape[1])))
