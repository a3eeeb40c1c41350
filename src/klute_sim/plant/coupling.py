"""The device in MuJoCo's terms: numbers in, numbers out, the same for both installations.

States (``data.act``): gauge pressure [bar], muscle length minus resting length [m], and where the device has effects
or a supply that remember, what they remember (in a device's row there is room for all of them). Pressure is kept in
bar so that both states are of a size that finite differences and solvers like; the length is an offset so that
MuJoCo's reset, which zeroes states, is the device at rest. The command (``data.ctrl``) is gauge pressure [bar], or the
opening of its valve [1] if that is what the supply takes.

The length is solved implicitly where MuJoCo asks for the rates, and handed over as the *effective rate*
``(l+ - l)/h``, so that its single-step integrators land on l+. MuJoCo evaluates every rate before any force, so the
force is that of l+: exactly the one that balances muscle and damper.

A ``row`` (``actuator_user``) is the device's parameters (:mod:`klute_sim.device.backend.packing`) and one number more, the
damping [N s2/m2] that the model's tendon shows to MuJoCo's implicit integrators and that is given back here.
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
"""Where the damping is in a row."""
USER_ROW_SIZE = ROW_SIZE + 1
"""Numbers in a row."""
N_BASE_STATES = 2
"""Of a device whose effects remember nothing."""
N_ALL_STATES = N_BASE_STATES + N_INTERNAL_STATES
"""Of any device."""


def to_device_state(
    parameters: DeviceParameters, pressure: float, offset: float, internal_state: tuple[float, ...]
) -> DeviceState:
    """The device's state [Pa, m] from MuJoCo's: ``pressure`` [bar], ``offset`` [m]."""
    return DeviceState(pressure * BAR, parameters.muscle.resting_length + offset, internal_state)


def state_after_step(
    parameters: DeviceParameters,
    previous: DeviceState,
    pressure_rate: float,
    length_rate: float,
    unit_length: float,
    dt: float,
) -> DeviceState:
    """State [Pa, m] that rates [bar/s, m/s] lead to in a ``step`` [s] that ends at ``unit_length`` [m].

    What the supply remembers stays as it was: no force depends on it.
    """
    pressure, length = previous.pressure + dt * pressure_rate * BAR, previous.length + dt * length_rate
    return DeviceState(
        pressure, length, step_internal_state(parameters, previous.internal_state, pressure, length, unit_length, dt)
    )


def compute_rates(
    row: Sequence[float],
    pressure: float,
    offset: float,
    internal_state: tuple[float, ...],
    command: float,
    unit_length: float,
    dt: float,
) -> tuple[float, float, tuple[float, ...]]:
    """Rates [bar/s, m/s] that carry the states to the implicit step's end, and the memory there.

    NaN, 0 and the memory as it was, unless command, pressure and length are finite.

    ``pressure`` [bar] and ``offset`` [m] are the states, ``command`` [bar], ``unit_length`` [m], ``step`` [s].
    """
    parameters = unpack_parameters(row)
    before = to_device_state(parameters, pressure, offset, internal_state)
    asked = command if parameters.supply.command_is_opening != 0.0 else command * BAR
    after = advance_state(parameters, before, unit_length, asked, dt)
    by_pressure = (after.pressure - before.pressure) / (BAR * dt)
    by_length = (after.length - before.length) / dt
    if math.isfinite(command) and math.isfinite(by_pressure) and math.isfinite(by_length):
        return by_pressure, by_length, after.internal_state
    # MuJoCo multiplies the gain, which is 0, with the last state: that one must stay a number.
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
    """Actuator force [N] at the step's end: minus the tension, plus what the shown damping takes at ``velocity``.

    ``by_pressure`` [bar/s] and ``by_length`` [m/s] are the step's rates, ``velocity`` = d(unit_length)/dt [m/s], which
    is also how fast a muscle on a rigid tie moves. A state that is not finite gives no force.
    """
    if not math.isfinite(pressure_rate):
        return 0.0
    parameters = unpack_parameters(row)
    before = to_device_state(parameters, pressure, offset, internal_state)
    after = state_after_step(parameters, before, pressure_rate, length_rate, unit_length, dt)
    rate = velocity if parameters.tendon.is_rigid else length_rate
    return damping_compensation(row, velocity) - compute_tension(parameters, after, unit_length, rate)


def damping_compensation(row: Sequence[float], velocity: float) -> float:
    """What the shown damping takes [N] at ``velocity`` [m/s]."""
    return row[DAMPING_INDEX] * velocity * abs(velocity)
