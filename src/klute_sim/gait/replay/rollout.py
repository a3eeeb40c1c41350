"""Simulate the prosthesis on a shank with prescribed motion.

With a prescribed base, the ankle is the only free coordinate. A time step is therefore the implicit step of the device
and one equation (:mod:`klute_sim.laws.foot`). Compiled, a step takes 0.9 us and releases Python's lock, so trials are
simulated on all cores. MuJoCo takes 5 us and holds the lock, because Python moves its base. The model neglects the heel
spring. Compared with a gait run of the rig at the same time step, this changes the ankle angle by 0.005 degrees and the
tension by 0.2 N (rms, tested).
"""

import inspect
import sys
from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np

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
from klute_sim.device.nonfinite import integrate_in_python
from klute_sim.errors import InputError, SimulationError
from klute_sim.laws import foot as _foot
from klute_sim.laws.foot import Foot, FootInputs
from klute_sim.types import Array

MAX_TIME_STEP = 2e-3
"""Longest allowed time step [s]; beyond it the oscillation of the ankle, 40 Hz on a stiff tendon, is not resolved."""
SETTLING_TIME = 0.5
"""Time [s] for which the first inputs are held before a replay starts from rest."""


class ReplayInputs(NamedTuple):
    """Prescribed inputs, (samples,) each, one per time step."""

    shank_angle: Array
    """Inclination of the shank, forward positive [rad]."""
    shank_angular_acceleration: Array
    """Second time derivative of the inclination [rad/s2]."""
    ankle_acceleration_x: Array
    """Forward acceleration of the ankle [m/s2]."""
    ankle_acceleration_z: Array
    """Upward acceleration of the ankle [m/s2]."""
    ground_moment: Array
    """Moment of the ground reaction about the ankle, plantarflexion positive [N.m]."""
    axial_force: Array
    """Ground reaction along the pylon, up positive [N]."""
    shear_force: Array
    """Ground reaction across the pylon, backward positive [N]."""
    pressure_command: Array
    """Commanded gauge pressure [Pa]."""


class ReplayResult(NamedTuple):
    """Response of the prosthesis, (samples,) each, at the start of each time step."""

    tension: Array
    """Tension of the muscle-tendon unit [N]."""
    pressure: Array
    """Gauge pressure in the muscle [Pa]."""
    length: Array
    """Muscle length [m]."""
    ankle_angle: Array
    """Angle of the foot relative to the pylon, dorsiflexion positive [rad]: hinge and keel together."""
    ankle_moment: Array
    """Moment of tendon, spring, damping, friction and stops about the ankle, plantarflexor positive [N.m]; with a
    data-driven moment, if the foot has one."""


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
    """Fill ``out`` (samples, 5) in the order of :class:`ReplayResult`; SI.

    ``row`` holds the packed parameters. ``inputs`` (samples, 7) are the fields of :class:`ReplayInputs` without the
    command. Before the replay, the first inputs are held for ``n_settling_steps`` steps without accelerations.
    """
    parameters = unpack_parameters(row)
    delay_steps = get_dead_time(parameters) / dt
    before, angle, velocity, keel_angle = DeviceState(pressure, length, internal_state), 0.0, 0.0, 0.0
    displacement, tilt = 0.0, 0.0
    for n in range(-n_settling_steps, len(inputs)):
        k = max(n, 0)
        sample = inputs[k]
        foot_inputs = (
            FootInputs(sample[0], sample[1], sample[2], sample[3], sample[4])
            if n >= 0
            else FootInputs(sample[0], 0.0, 0.0, 0.0, sample[4])
        )
        displacement = _foot.step_socket_displacement(foot, displacement, foot_inputs, sample[5], dt)
        tilt = _foot.step_socket_tilt(foot, tilt, foot_inputs, sample[6], dt)
        # Both move the ankle: along the pylon, and backward across it.
        ground_moment = foot_inputs.ground_moment + displacement * sample[6] - foot.tilt_height * tilt * sample[5]
        unknown = _foot.unknown_moment(foot, angle, ground_moment, sample[5], before.pressure)
        foot_inputs = FootInputs(
            foot_inputs.shank_angle + tilt,
            foot_inputs.shank_angular_acceleration,
            foot_inputs.ankle_acceleration_x,
            foot_inputs.ankle_acceleration_z,
            ground_moment + unknown,
        )
        unit_length = _foot.unit_length(foot, angle)
        after = advance_state(parameters, before, unit_length, interpolate_samples(command, n - delay_steps), dt)
        tension = compute_tension(parameters, after, unit_length, (after.length - before.length) / dt)
        ankle = _foot.step_ankle(foot, angle, velocity, tension, foot_inputs, dt)
        moment = ankle.moment + unknown
        keel_angle = _foot.step_keel_angle(foot, keel_angle, moment, dt)
        out[k, 0], out[k, 1], out[k, 2] = tension, after.pressure, after.length
        out[k, 3], out[k, 4] = keel_angle - angle, moment
        before, angle, velocity = after, ankle.angle, ankle.velocity


@cache
def _compile_integrate() -> Callable[..., None]:
    import numba

    from klute_sim.device.backend import compiled

    this_module = sys.modules[__name__]
    # The function releases Python's lock, so threads run in parallel.
    decorator = partial(numba.njit, nogil=True)
    module = compiled.compile_module(this_module, **compiled.compile_device_functions())
    number = numba.float64
    internal_state, series = numba.types.UniTuple(number, N_INTERNAL_STATES), number[::1]
    foot = numba.types.NamedUniTuple(number, len(Foot._fields), Foot)
    table = number[:, ::1]
    signature = numba.void(series, foot, number, number, internal_state, table, series, numba.int64, number, table)
    function: Callable[..., None] = compiled.compile_cached(
        decorator, module.integrate, signature, inspect.getsource(this_module)
    )
    return function


def simulate_replay(
    parameters: DeviceParameters, foot: Foot, inputs: ReplayInputs, dt: float, *, backend: str = "auto"
) -> ReplayResult:
    """Simulate a device on ``foot`` that follows ``inputs``, one sample per time step ``dt`` [s].

    The replay starts from rest under the first inputs, which are held for :data:`SETTLING_TIME` before. ``backend`` is
    one of :data:`klute_sim.device.backend.select.BACKENDS`.

    Raises InputError when inputs do not match or are not finite, the device has no tendon, or ``dt`` is beyond
    :data:`MAX_TIME_STEP`. Raises SimulationError when a result is not finite.
    """
    if not 0.0 < dt <= MAX_TIME_STEP:
        raise InputError(f"dt is {dt:g}; allowed: above 0, up to {MAX_TIME_STEP:g} s")
    if parameters.tendon.is_rigid:
        raise InputError("a device without a tendon cannot be replayed on an ankle; give it a [tendon] section")
    shapes = {np.shape(series) for series in inputs}
    if len(shapes) != 1 or len(next(iter(shapes))) != 1 or 0 in next(iter(shapes)):
        raise InputError(f"inputs of shapes {sorted(shapes)} do not fit together; allowed: (samples,) for all")
    table = np.column_stack([np.asarray(series, dtype=np.float64) for series in inputs])
    if not np.isfinite(table).all():
        raise InputError("prescribed inputs must be finite everywhere")
    motion, command = np.ascontiguousarray(table[:, :-1]), np.ascontiguousarray(table[:, -1])
    out = np.empty((len(table), len(ReplayResult._fields)))
    state = compute_taut_state(parameters, _foot.unit_length(foot, 0.0), float(command[0]))
    initial_state = (float(state.pressure), float(state.length), state.internal_state)
    n_settling_steps = round(SETTLING_TIME / dt)
    if select_backend(backend, explain_missing_compiler) == "compiled":
        packed = np.array(pack_parameters(parameters))
        _compile_integrate()(packed, foot, *initial_state, motion, command, n_settling_steps, float(dt), out)
    else:
        row: Any = pack_parameters(parameters)
        arguments = motion.tolist(), command.tolist(), n_settling_steps, float(dt)
        integrate_in_python(integrate, out, row, foot, *initial_state, *arguments)
    if not np.isfinite(out).all():
        k = int(np.argwhere(~np.isfinite(out))[0][0])
        raise SimulationError(f"the replay has no finite state at t = {k * dt:.4f} s")
    return ReplayResult(*(np.ascontiguousarray(out[:, k]) for k in range(out.shape[1])))
