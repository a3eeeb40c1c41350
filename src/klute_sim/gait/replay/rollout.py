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
from klute_sim.device.rollout import find_numba_incompatibility, interpolate_samples
from klute_sim.errors import InputError, SimulationError
from klute_sim.laws import foot as _foot
from klute_sim.laws.foot import Foot, FootInputs

MAX_TIME_STEP = 2e-3
"""[s]; beyond it the ankle's own oscillation, some 40 Hz on a stiff tendon, is no longer followed."""
SETTLING_TIME = 0.5
"""Time [s] for which the first inputs are held before a replay begins, from rest."""

Array = NDArray[np.float64]


class ReplayInputs(NamedTuple):
    """What is prescribed, (samples,) each, one per step."""

    shank_angle: Array
    """Lean of the shank, forward positive [rad]."""
    shank_angular_acceleration: Array
    """Its second derivative [rad/s2]."""
    ankle_acceleration_x: Array
    ankle_acceleration_z: Array
    """Acceleration of the ankle [m/s2]."""
    ground_moment: Array
    """Moment of the ground reaction about the ankle [N.m], plantarflexing positive."""
    axial_force: Array
    shear_force: Array
    """The ground reaction along the pylon, up it positive, and across it, backward positive [N]."""
    pressure_command: Array
    """Pressure [Pa]."""


class ReplayResult(NamedTuple):
    """What the prosthesis did, (samples,) each, at the beginning of each step."""

    tension: Array
    """[N]"""
    pressure: Array
    """Gauge [Pa]."""
    length: Array
    """Of the muscle [m]."""
    ankle_angle: Array
    """Of the foot against the pylon, dorsiflexion positive [rad]: the hinge, and what the foot bends."""
    ankle_moment: Array
    """Of tendon, spring, damping, friction and stops about the ankle [N.m], plantarflexor positive."""


def integrate(
    row: Sequence[float],
    foot: Foot,
    pressure: float,
    length: float,
    internal_state: tuple[float, ...],
    inputs: Sequence[Sequence[float]],
    command: Sequence[float],
    n_settling_steps: int,
    dt: float,
    out: Array,
) -> None:
    """Fill ``out`` (samples, 5) in the order of :class:`Replay`; SI.

    ``row`` is the device's parameters, ``inputs`` (samples, 7) those of :class:`Inputs` but the command. The first
    of them are held for ``settling`` steps before that, with nothing accelerating.
    """
    parameters = unpack_parameters(row)
    late = parameters.effects[DEAD_TIME_INDEX] / dt
    before, angle, rate, bent = DeviceState(pressure, length, internal_state), 0.0, 0.0, 0.0
    for n in range(-n_settling_steps, len(inputs)):
        k = max(n, 0)
        now = inputs[k]
        base = (
            FootInputs(now[0], now[1], now[2], now[3], now[4]) if n >= 0 else FootInputs(now[0], 0.0, 0.0, 0.0, now[4])
        )
        ground = base.ground_moment + _foot.socket_displacement(foot, base, now[5]) * now[6]
        base = FootInputs(
            base.shank_angle,
            base.shank_angular_acceleration,
            base.ankle_acceleration_x,
            base.ankle_acceleration_z,
            ground,
        )
        whole = _foot.unit_length(foot, angle)
        after = advance_state(parameters, before, whole, interpolate_samples(command, n - late), dt)
        pull = compute_tension(parameters, after, whole, (after.length - before.length) / dt)
        then = _foot.step_ankle(foot, angle, rate, pull, base, dt)
        bent = _foot.step_keel_angle(foot, bent, then.moment, dt)
        out[k, 0], out[k, 1], out[k, 2] = pull, after.pressure, after.length
        out[k, 3], out[k, 4] = bent - angle, then.moment
        before, angle, rate = after, then.angle, then.rate


@cache
def _compile_integrate() -> Callable[..., None]:
    import numba

    from klute_sim.device.backend import compiled

    here = sys.modules[__name__]
    # The lock of Python's is free while it runs, so threads run at once.
    wrap = partial(numba.njit, nogil=True)
    late = compiled.compile_module(sys.modules[interpolate_samples.__module__]).interpolate_samples
    copy = compiled.compile_module(here, interpolate_samples=late, **compiled.compile_device_functions())
    number = numba.float64
    memory, series = numba.types.UniTuple(number, N_INTERNAL_STATES), number[::1]
    foot = numba.types.NamedUniTuple(number, len(Foot._fields), Foot)
    table = number[:, ::1]
    signature = numba.void(series, foot, number, number, memory, table, series, numba.int64, number, table)
    ready: Callable[..., None] = compiled.compile_cached(wrap, copy.integrate, signature, inspect.getsource(here))
    return ready


def simulate_replay(
    parameters: DeviceParameters, foot: Foot, inputs: ReplayInputs, dt: float, *, backend: str = "auto"
) -> ReplayResult:
    """``parameters`` on ``foot``, following ``inputs``, one of each per ``step`` [s].

    It begins at rest under the first inputs, which are held for :data:`SETTLING` before.

    Raises InputError for inputs that do not fit together or are not finite, a device without a tendon of its own, or a
    step beyond :data:`LONGEST_STEP`; SimulationError if a result is not finite.
    """
    if not 0.0 < dt <= MAX_TIME_STEP:
        raise InputError(f"step is {dt:g}; allowed: above 0, up to {MAX_TIME_STEP:g} s")
    if parameters.tendon.is_rigid:
        raise InputError("a device without a tendon cannot be replayed on an ankle; give it a [tendon] section")
    shapes = {np.shape(series) for series in inputs}
    if len(shapes) != 1 or len(next(iter(shapes))) != 1 or 0 in next(iter(shapes)):
        raise InputError(f"inputs of shapes {sorted(shapes)} do not fit together; allowed: (samples,), alike")
    table = np.column_stack([np.asarray(series, dtype=np.float64) for series in inputs])
    if not np.isfinite(table).all():
        raise InputError("what is prescribed must be finite everywhere")
    motion, command = np.ascontiguousarray(table[:, :-1]), np.ascontiguousarray(table[:, -1])
    out = np.empty((len(table), len(ReplayResult._fields)))
    start = compute_taut_state(parameters, _foot.unit_length(foot, 0.0), float(command[0]))
    settling = round(SETTLING_TIME / dt)
    begin = (float(start.pressure), float(start.length), start.internal_state)
    if select_backend(backend, find_numba_incompatibility) == "compiled":
        _compile_integrate()(
            np.array(pack_parameters(parameters)), foot, *begin, motion, command, settling, float(dt), out
        )
    else:
        row: Any = pack_parameters(parameters)
        integrate(row, foot, *begin, motion.tolist(), command.tolist(), settling, float(dt), out)
    if not np.isfinite(out).all():
        k = int(np.argwhere(~np.isfinite(out))[0][0])
        raise SimulationError(f"the replay has no finite state at t = {k * dt:.4f} s")
    return ReplayResult(*(np.ascontiguousarray(out[:, k]) for k in range(out.shape[1])))
