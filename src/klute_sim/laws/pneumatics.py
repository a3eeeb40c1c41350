"""The gas: a pressure regulator that is ideal but for its rate, what else a supply can be, and the air that is held."""

from typing import NamedTuple

ATMOSPHERIC_PRESSURE = 101_325.0
"""Standard atmosphere [Pa], to turn gauge into absolute pressure."""
AIR_GAS_CONSTANT = 287.05
"""Specific gas constant of dry air [J/(kg K)]."""
ZERO_CELSIUS = 273.15
"""0 degrees Celsius in kelvin."""


class Supply(NamedTuple):
    """What the supply can deliver: by its defaults an ideal regulator (:mod:`klute_sim.laws.pneumatic_step` has the rest)."""

    max_pressure: float
    """Highest gauge pressure [Pa]; commands are clipped to 0 ... this."""
    max_pressure_rate: float
    """Fastest change of pressure, up or down [Pa/s]; of a regulator, not of a valve that is given a gain."""
    temperature: float
    """Gas temperature [K]."""
    fill_conductance: float = 0.0
    """Sonic conductance from the supply into the muscle [m3/(s Pa)]; 0: an ideal regulator, without limit."""
    fill_critical_ratio: float = 0.0
    """Its critical pressure ratio [1]."""
    exhaust_conductance: float = 0.0
    """Sonic conductance from the muscle into the room [m3/(s Pa)]."""
    exhaust_critical_ratio: float = 0.0
    """Its critical pressure ratio [1]."""
    valve_gain: float = 0.0
    """Opening [1] of the valve per pressure that is missing [1/Pa]; 0: as far open as it takes, a perfect pilot."""
    command_is_opening: float = 0.0
    """1: commands are openings from -1 (exhaust) to 1 (fill); 0: commands are pressures."""
    pwm_period: float = 0.0
    """Of the pulses of an on/off valve [s]; 0: a valve that opens in proportion."""
    min_pulse: float = 0.0
    """Pulse or pause [s] that the on/off valve can still make."""
    polytropic_exponent: float = 1.0
    """Polytropic, of the air in the muscle [1]: 1 if the walls keep its temperature, 1.4 if they give no heat."""
    thermal_time_constant: float = 0.0
    """Time [s] in which that air takes the walls' temperature all the same; 0: never. Only where exponent is not 1."""
    dead_volume: float = 0.0
    """Of fittings and line [m3]."""
    leak_conductance: float = 0.0
    """Sonic conductance of a leak into the room [m3/(s Pa)]."""
    tank_volume: float = 0.0
    """Volume of the tank that the supply lives on [m3]; 0: endless."""
    tank_pressure: float = 0.0
    """Gauge pressure in the full tank [Pa]."""
    regulator_time_constant: float = 0.0
    """Time [s] in which a regulator makes up for what a change of the muscle's volume does; 0: at once."""


def replace_supply_fields(
    supply: Supply,
    fill_conductance: float,
    fill_critical_ratio: float,
    exhaust_conductance: float,
    exhaust_critical_ratio: float,
    polytropic_exponent: float,
    leak_conductance: float,
    tank_volume: float,
    tank_pressure: float,
    regulator_time_constant: float,
) -> Supply:
    """``supply`` with these instead of its own."""
    # What _replace would do, if a compiler knew it.
    return Supply(
        supply.max_pressure,
        supply.max_pressure_rate,
        supply.temperature,
        fill_conductance,
        fill_critical_ratio,
        exhaust_conductance,
        exhaust_critical_ratio,
        supply.valve_gain,
        supply.command_is_opening,
        supply.pwm_period,
        supply.min_pulse,
        polytropic_exponent,
        supply.thermal_time_constant,
        supply.dead_volume,
        leak_conductance,
        tank_volume,
        tank_pressure,
        regulator_time_constant,
    )


def regulate(supply: Supply, pressure: float, command: float, dt: float) -> float:
    """Gauge pressure [Pa] one ``step`` [s] later: ``command`` [Pa] clipped to the supply, then rate-limited."""
    target = min(max(command, 0.0), supply.max_pressure)
    most = supply.max_pressure_rate * dt
    if target > pressure + most:
        return pressure + most
    if target < pressure - most:
        return pressure - most
    return target


def air_mass(pressure: float, volume: float, temperature: float) -> float:
    """Mass of air [kg] in ``volume`` [m3] at gauge ``pressure`` [Pa]: ideal gas at ``temperature`` [K]."""
    return (pressure + ATMOSPHERIC_PRESSURE) * volume / (AIR_GAS_CONSTANT * temperature)
