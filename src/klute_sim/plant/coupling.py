"""The device in MuJoCo's terms, the same for the compiled and the Python backend.

States (``data.act``) are the gauge pressure [bar], the muscle length minus its resting length [m] and, if the device
has any, its internal states. The pressure is in bar so that both states have a magnitude that suits finite differences
and solvers. The length is an offset so that MuJoCo's reset, which zeroes the states, gives a device at rest. The
command (``data.ctrl``) is the gauge pressure [bar], or the valve opening [1] if the supply takes openings.

The length is solved implicitly where MuJoCo asks for the rates. It is passed on as the *effective rate* ``(l+ - l)/h``,
so that MuJoCo's single-step integrators arrive at l+. MuJoCo evaluates all rates before any force, so the force is that
of l+, which balances muscle and damper exactly.

A ``row`` (``actuator_user``) holds the device's parameters (:mod:`klute_sim.device.backend.packing`) and one more
number: the exposed damping [N s2/m2], which the model's tendon has for MuJoCo's implicit integrators and which the
device's force compensates.
"""

import math
from collections.abc import Sequence

from klute_sim.device.backend.packing import ROW_SIZE, unpack_parameters
from klute_sim.device.dynamics import (
    N_INTERNAL_STATES,
    DeviceParameters,
    DeviceState,
    advance_state,
    compute_tension,
    step_internal_state,
)
from klute_sim.units import BAR

DAMPING_INDEX = ROW_SIZE
"""Index of the exposed damping in a row."""
USER_ROW_SIZE = ROW_SIZE + 1
"""Number of values in a row."""
N_BASE_STATES = 2
"""Number of states of a device without internal states."""
N_ALL_STATES = N_BASE_STATES + N_INTERNAL_STATES
"""Number of states of a device with internal states."""


def to_device_state(
    parameters: DeviceParameters, pressure: float, offset: float, internal_state: tuple[float, ...]
) -> DeviceState:
    """Return the device's state [Pa, m] for MuJoCo's states ``pressure`` [bar] and ``offset`` [m]."""
    return DeviceState(pressure * BAR, parameters.muscle.resting_length + offset, internal_state)


def compute_state_after_step(
    parameters: DeviceParameters,
    previous: DeviceState,
    pressure_rate: float,
    length_rate: float,
    unit_length: float,
    dt: float,
) -> DeviceState:
    """Return the state [Pa, m] after a step ``dt`` [s] with these rates [bar/s, m/s] that ends at ``unit_length`` [m].

    The gas state keeps its value, because no force depends on it.
    """
    pressure, length = previous.pressure + dt * pressure_rate * BAR, previous.length + dt * length_rate
    internal_state = step_internal_state(parameters, previous.internal_state, pressure, 0.0, length, unit_length, dt)
    return DeviceState(pressure, length, internal_state)


def compute_rates(
    row: Sequence[float],
    pressure: float,
    offset: float,
    internal_state: tuple[float, ...],
    command: float,
    unit_length: float,
    dt: float,
) -> tuple[float, float, tuple[float, ...]]:
    """Return the rates [bar/s, m/s] that lead to the end of the implicit step, and the internal state there.

    ``pressure`` [bar] and ``offset`` [m] are the states, ``command`` [bar] or [1], ``unit_length`` [m], ``dt`` [s].
    Returns NaN, 0 and the unchanged internal state unless command, pressure and length are finite.
    """
    parameters = unpack_parameters(row)
    before = to_device_state(parameters, pressure, offset, internal_state)
    si_command = command if parameters.supply.command_is_opening != 0.0 else command * BAR
    after = advance_state(parameters, before, unit_length, si_command, dt)
    pressure_rate = (after.pressure - before.pressure) / (BAR * dt)
    length_rate = (after.length - before.length) / dt
    if math.isfinite(command) and math.isfinite(pressure_rate) and math.isfinite(length_rate):
        return pressure_rate, length_rate, after.internal_state
    # MuJoCo multiplies the gain, which is 0, with the last state; that state must stay finite.
    return math.nan, 0.0, internal_state


def compute_force(
    row: Sequence[float],
    pressure: float,
    offset: float,
    internal_state: tuple[float, ...],
    pressure_rate: float,
    length_rate: float,
    unit_length: float,
    velocity: float,
    dt: float,
) -> float:
    """Return the actuator force [N] at the end of the step: minus the tension, plus the force of the exposed damping.

    ``pressure_rate`` [bar/s] and ``length_rate`` [m/s] are the rates of the step. ``velocity`` = d(unit_length)/dt
    [m/s] is also the velocity of a muscle on a rigid tendon. A state that is not finite gives no force.
    """
    if not math.isfinite(pressure_rate):
        return 0.0
    parameters = unpack_parameters(row)
    before = to_device_state(parameters, pressure, offset, internal_state)
    after = compute_state_after_step(parameters, before, pressure_rate, length_rate, unit_length, dt)
    muscle_velocity = velocity if parameters.tendon.is_rigid else length_rate
    return compute_damping_compensation(row, velocity) - compute_tension(
        parameters, after, unit_length, muscle_velocity
    )


def compute_damping_compensation(row: Sequence[float], velocity: float) -> float:
    """Return the force [N] of the exposed damping at ``velocity`` [m/s]."""
    return row[DAMPING_INDEX] * velocity * abs(velocity)
