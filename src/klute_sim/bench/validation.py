"""Validation of the inputs of a bench simulation."""

import numpy as np
from numpy.typing import ArrayLike

from klute_sim.device.device import Device, check_is_testable
from klute_sim.device.rollout import MAX_TIME_STEP
from klute_sim.errors import InputError
from klute_sim.laws import mckibben
from klute_sim.types import Array


def validate_inputs(device: Device, length: ArrayLike, command: ArrayLike, dt: float) -> tuple[Array, Array]:
    """Return unit ``length`` [m] and pressure ``command`` [Pa] as arrays with one sample per time step ``dt`` [s].

    Raises InputError when the series differ in length, are not finite, need a unit shorter than the lock length of the
    muscle or, with a rigid tie, longer than its resting length, or when ``dt`` is out of range.
    """
    parameters = device.parameters
    length, command = np.asarray(length, dtype=np.float64), np.asarray(command, dtype=np.float64)
    if length.ndim != 1 or length.shape != command.shape or len(length) < 2:
        raise InputError(f"length and command need equally many samples, got {length.shape} and {command.shape}")
    if not (np.isfinite(length).all() and np.isfinite(command).all()):
        raise InputError("length and command must be finite everywhere")
    if not 0.0 < dt <= MAX_TIME_STEP:
        raise InputError(f"the time step is {dt:g} s; allowed: above 0, up to {MAX_TIME_STEP:g} s")
    lock = mckibben.lock_length(parameters.muscle)
    slack, resting = parameters.tendon.slack_length, parameters.muscle.resting_length
    check_is_testable(device)
    max_length = resting if parameters.tendon.is_rigid else float("inf")
    if length.min() < lock or length.max() - slack > max_length + 1e-12:
        raise InputError(
            f"unit length runs from {1e3 * length.min():.1f} to {1e3 * length.max():.1f} mm; allowed for "
            f"'{device.name}': {1e3 * lock:.1f} to {1e3 * (max_length + slack):.1f} mm"
        )
    return length, command
