"""The device in MuJoCo's terms: numbers in, numbers out, the same for both installations.

States (``data.act``): gauge pressure [bar], muscle length minus resting length [m], and where the device has effects
or a supply that remember, what they remember (in a device's row there is room for all of them). Pressure is kept in
bar so that both states are of a size that finite differences and solvers like; the length is an offset so that
MuJoCo's reset, which zeroes states, is the device at rest. The command (``data.ctrl``) is gauge pressure [bar], or the
opening of its valve [1] if that is what the supply takes.

The length is solved implicitly where MuJoCo asks for the rates, and handed over as the *effective rate*
``(l+ - l)/h``, so that its single-step integrators land on l+. MuJoCo evaluates every rate before any force, so the
force is that of l+: exactly the one that balances muscle and damper.

A ``row`` (``actuator_user``) is the device's parameters (:mod:`klute_sim.device.vector`) and one number more, the
damping [N s2/m2] that the model's tendon shows to MuJoCo's implicit integrators and that is given back here.
"""

import math
from collections.abc import Sequence

from klute_sim.device.step import MEMORY, Parameters, State, advance, remembered, tension
from klute_sim.device.vector import SIZE, unpack
from klute_sim.units import BAR

SHOWN_DAMPING = SIZE
"""Where the damping is in a row."""
ROW = SIZE + 1
"""Numbers in a row."""
STATES = 2
"""Of a device whose effects remember nothing."""
ALL_STATES = STATES + MEMORY
"""Of any device."""


def state(parameters: Parameters, pressure: float, offset: float, memory: tuple[float, ...]) -> State:
    """The device's state [Pa, m] from MuJoCo's: ``pressure`` [bar], ``offset`` [m]."""
    return State(pressure * BAR, parameters.muscle.resting_length + offset, memory)


def reached(
    parameters: Parameters, before: State, by_pressure: float, by_length: float, unit_length: float, step: float
) -> State:
    """State [Pa, m] that rates [bar/s, m/s] lead to in a ``step`` [s] that ends at ``unit_length`` [m].

    What the supply remembers stays as it was: no force depends on it.
    """
    pressure, length = before.pressure + step * by_pressure * BAR, before.length + step * by_length
    return State(pressure, length, remembered(parameters, before.memory, pressure, length, unit_length, step))


def rates(
    row: Sequence[float],
    pressure: float,
    offset: float,
    memory: tuple[float, ...],
    command: float,
    unit_length: float,
    step: float,
) -> tuple[float, float, tuple[float, ...]]:
    """Rates [bar/s, m/s] that carry the states to the implicit step's end, and the memory there.

    NaN, 0 and the memory as it was, unless command, pressure and length are finite.

    ``pressure`` [bar] and ``offset`` [m] are the states, ``command`` [bar], ``unit_length`` [m], ``step`` [s].
    """
    parameters = unpack(row)
    before = state(parameters, pressure, offset, memory)
    asked = command if parameters.supply.opens != 0.0 else command * BAR
    after = advance(parameters, before, unit_length, asked, step)
    by_pressure = (after.pressure - before.pressure) / (BAR * step)
    by_length = (after.length - before.length) / step
    if math.isfinite(command) and math.isfinite(by_pressure) and math.isfinite(by_length):
        return by_pressure, by_length, after.memory
    # MuJoCo multiplies the gain, which is 0, with the last state: that one must stay a number.
    return math.nan, 0.0, memory


def force(
    row: Sequence[float],
    pressure: float,
    offset: float,
    memory: tuple[float, ...],
    by_pressure: float,
    by_length: float,
    unit_length: float,
    velocity: float,
    step: float,
) -> float:
    """Actuator force [N] at the step's end: minus the tension, plus what the shown damping takes at ``velocity``.

    ``by_pressure`` [bar/s] and ``by_length`` [m/s] are the step's rates, ``velocity`` = d(unit_length)/dt [m/s], which
    is also how fast a muscle on a rigid tie moves. A state that is not finite gives no force.
    """
    if not math.isfinite(by_pressure):
        return 0.0
    parameters = unpack(row)
    before = state(parameters, pressure, offset, memory)
    after = reached(parameters, before, by_pressure, by_length, unit_length, step)
    rate = velocity if parameters.tendon.rigid else by_length
    return given_back(row, velocity) - tension(parameters, after, unit_length, rate)


def given_back(row: Sequence[float], velocity: float) -> float:
    """What the shown damping takes [N] at ``velocity`` [m/s]."""
    return row[SHOWN_DAMPING] * velocity * abs(velocity)
