"""Report where a rollout has no finite state: the same sentence under both backends.

Plain Python raises at a root of a negative number, a division by zero or an overflow, where compiled code goes on with
NaN or infinity. Both end here in one SimulationError that names the first quantity without a finite value and its time.
"""

import math
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from klute_sim.device.delay import interpolate_samples
from klute_sim.device.dynamics import (
    DeviceParameters,
    DeviceState,
    advance_state,
    compute_tension,
    get_dead_time,
    step_pressure,
)
from klute_sim.errors import SimulationError
from klute_sim.types import Array

MATH_ERRORS = (ArithmeticError, ValueError)
"""Errors of Python's arithmetic where compiled code gives NaN or infinity."""
MAX_REPEATED_STEPS = 20_000
"""Largest number of time steps that are repeated to name a quantity; later failures do not name it."""


def integrate_in_python(integrate: Callable[..., None], out: Array, *arguments: Any) -> None:
    """Call ``integrate(*arguments, out)``; at an error of Python's arithmetic the remaining rows of ``out`` are NaN."""
    out.fill(math.nan)
    with suppress(*MATH_ERRORS):
        integrate(*arguments, out)


def check_finite(
    out: Array,
    subject: str,
    parameters: DeviceParameters,
    state: DeviceState,
    unit_length: Array,
    command: Array,
    dt: float,
) -> None:
    """Raise SimulationError that begins with ``subject`` if a row of ``out``, one per time step, is not finite.

    The rollout began in ``state`` and followed ``unit_length`` [m] and ``command`` in steps ``dt`` [s].
    """
    if np.isfinite(out).all():
        return
    step = int(np.argwhere(~np.isfinite(out))[0][0])
    quantity = "pressure, muscle length or tension"
    if step <= MAX_REPEATED_STEPS:
        quantity = _name_quantity(parameters, state, unit_length, command, dt, step)
    raise make_nonfinite_error(subject, quantity, step * dt)


def make_nonfinite_error(subject: str, quantity: str, time: float) -> SimulationError:
    """Return the error of ``subject``, whose ``quantity`` has no finite value at ``time`` [s]."""
    return SimulationError(
        f"{subject} has no finite state at t = {time:.4f} s: no finite {quantity} results there; check the numbers of "
        "the device and its inputs"
    )


def _name_quantity(
    parameters: DeviceParameters,
    state: DeviceState,
    unit_length: Array,
    command: Array,
    dt: float,
    step: int,
) -> str:
    """Return the first quantity of time step ``step`` that has no finite value, after repeating all steps before."""
    delay_steps = get_dead_time(parameters) / dt
    quantity = "pressure"
    with suppress(*MATH_ERRORS):
        for k in range(step):
            state = advance_state(
                parameters, state, float(unit_length[k]), float(interpolate_samples(command, k - delay_steps)), dt
            )
        target = float(interpolate_samples(command, step - delay_steps))
        if not math.isfinite(step_pressure(parameters, state, target, dt).pressure):
            return quantity
        quantity = "muscle length"
        after = advance_state(parameters, state, float(unit_length[step]), target, dt)
        if not math.isfinite(after.length):
            return quantity
        if not math.isfinite(after.pressure):
            return "pressure"
        quantity = "tension"
        compute_tension(parameters, after, float(unit_length[step]), (after.length - state.length) / dt)
    return quantity
