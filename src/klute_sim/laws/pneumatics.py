"""The gas: a pressure regulator that is ideal but for its rate, what else a supply can be, and the air that is held."""

from typing import NamedTuple

ATMOSPHERE = 101_325.0
"""Standard atmosphere [Pa], to turn gauge into absolute pressure."""
AIR_CONSTANT = 287.05
"""Specific gas constant of dry air [J/(kg K)]."""
ZERO_CELSIUS = 273.15
"""0 degrees Celsius in kelvin."""


class Supply(NamedTuple):
    """What the supply can deliver: by its defaults an ideal regulator (:mod:`klute_sim.laws.charging` has the rest)."""

    pressure: float
    """Highest gauge pressure [Pa]; commands are clipped to 0 ... this."""
    rate: float
    """Fastest change of pressure, up or down [Pa/s]; of a regulator, not of a valve that is given a gain."""
    temperature: float
    """Gas temperature [K]."""
    fill: float = 0.0
    """Sonic conductance from the supply into the muscle [m3/(s Pa)]; 0: an ideal regulator, without limit."""
    fill_ratio: float = 0.0
    """Its critical pressure ratio [1]."""
    exhaust: float = 0.0
    """Sonic conductance from the muscle into the room [m3/(s Pa)]."""
    exhaust_ratio: float = 0.0
    """Its critical pressure ratio [1]."""
    gain: float = 0.0
    """Opening [1] of the valve per pressure that is missing [1/Pa]; 0: as far open as it takes, a perfect pilot."""
    opens: float = 0.0
    """1: commands are openings from -1 (exhaust) to 1 (fill); 0: commands are pressures."""
    period: float = 0.0
    """Of the pulses of an on/off valve [s]; 0: a valve that opens in proportion."""
    shortest: float = 0.0
    """Pulse or pause [s] that the on/off valve can still make."""
    exponent: float = 1.0
    """Polytropic, of the air in the muscle [1]: 1 if the walls keep its temperature, 1.4 if they give no heat."""
    warming: float = 0.0
    """Time [s] in which that air takes the walls' temperature all the same; 0: never. Only where exponent is not 1."""
    dead_volume: float = 0.0
    """Of fittings and line [m3]."""
    leak: float = 0.0
    """Sonic conductance of a leak into the room [m3/(s Pa)]."""
    tank: float = 0.0
    """Volume of the tank that the supply lives on [m3]; 0: endless."""
    tank_pressure: float = 0.0
    """Gauge pressure in the full tank [Pa]."""
    recovery: float = 0.0
    """Time [s] in which a regulator makes up for what a change of the muscle's volume does; 0: at once."""


def changed(
    supply: Supply,
    fill: float,
    fill_ratio: float,
    exhaust: float,
    exhaust_ratio: float,
    exponent: float,
    leak: float,
    tank: float,
    tank_pressure: float,
    recovery: float,
) -> Supply:
    """``supply`` with these instead of its own."""
    # What _replace would do, if a compiler knew it.
    return Supply(
        supply.pressure,
        supply.rate,
        supply.temperature,
        fill,
        fill_ratio,
        exhaust,
        exhaust_ratio,
        supply.gain,
        supply.opens,
        supply.period,
        supply.shortest,
        exponent,
        supply.warming,
        supply.dead_volume,
        leak,
        tank,
        tank_pressure,
        recovery,
    )


def regulate(supply: Supply, pressure: float, command: float, step: float) -> float:
    """Gauge pressure [Pa] one ``step`` [s] later: ``command`` [Pa] clipped to the supply, then rate-limited."""
    target = min(max(command, 0.0), supply.pressure)
    most = supply.rate * step
    if target > pressure + most:
        return pressure + most
    if target < pressure - most:
        return pressure - most
    return target


def air_mass(pressure: float, volume: float, temperature: float) -> float:
    """Mass of air [kg] in ``volume`` [m3] at gauge ``pressure`` [Pa]: ideal gas at ``temperature`` [K]."""
    return (pressure + ATMOSPHERE) * volume / (AIR_CONSTANT * temperature)
