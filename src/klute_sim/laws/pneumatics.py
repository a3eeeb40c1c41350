"""The gas: parameters of the supply, a pressure regulator with limited rate, and the mass of enclosed air."""

import math
from typing import NamedTuple

ATMOSPHERIC_PRESSURE = 101_325.0
"""Standard atmosphere, the difference of absolute and gauge pressure [Pa]."""
AIR_GAS_CONSTANT = 287.05
"""Specific gas constant of dry air [J/(kg K)]."""
HEAT_CAPACITY_RATIO = 1.4
"""Ratio of the specific heats of air [1]."""
ZERO_CELSIUS = 273.15
"""Temperature of 0 degrees Celsius [K]."""


class SupplyParameters(NamedTuple):
    """Parameters of the supply; the defaults are an ideal regulator, see :mod:`klute_sim.laws.pneumatic_step`."""

    max_pressure: float
    """Maximum gauge pressure [Pa]; commands are clipped to 0 ... this pressure."""
    max_pressure_rate: float
    """Maximum rate of pressure change in both directions [Pa/s]; applies to a regulator, at its outlet where it is
    upstream of a restriction, and to an ideal pilot stage, but not to a valve with a gain."""
    temperature: float
    """Gas temperature [K]."""
    fill_conductance: float = 0.0
    """Sonic conductance from the supply into the muscle [m3/(s Pa)]; 0: an ideal regulator with unlimited flow."""
    fill_critical_ratio: float = 0.0
    """Critical pressure ratio of the fill path [1]."""
    exhaust_conductance: float = 0.0
    """Sonic conductance from the muscle into the room [m3/(s Pa)]."""
    exhaust_critical_ratio: float = 0.0
    """Critical pressure ratio of the exhaust path [1]."""
    valve_gain: float = 0.0
    """Valve opening per pressure error [1/Pa]; 0: an ideal pilot stage, which opens the valve as far as needed."""
    command_is_opening: float = 0.0
    """1: commands are openings from -1 (exhaust) to 1 (fill); 0: commands are pressures."""
    pwm_period: float = 0.0
    """Period of an on/off valve's pulses [s]; 0: a proportional valve."""
    min_pulse: float = 0.0
    """Shortest pulse or pause of an on/off valve [s]."""
    polytropic_exponent: float = 1.0
    """Polytropic exponent of the air in the muscle [1]: 1 isothermal, 1.4 adiabatic."""
    thermal_time_constant: float = 0.0
    """Time constant of heat exchange with the walls [s]; 0: no exchange. Used only if the exponent is not 1."""
    dead_volume: float = 0.0
    """Volume of air in fittings and line, which the muscle does not displace [m3]."""
    leak_conductance: float = 0.0
    """Sonic conductance of a leak into the room [m3/(s Pa)]."""
    tank_volume: float = 0.0
    """Volume of the tank that feeds the supply [m3]; 0: an unlimited source."""
    tank_pressure: float = 0.0
    """Gauge pressure in the full tank [Pa]."""
    regulator_time_constant: float = 0.0
    """Time constant with which a regulator compensates volume changes of the muscle [s]; 0: instantly."""
    regulator_is_upstream: float = 0.0
    """1: the conductances are those of a fixed restriction, at whose other end a regulator holds the commanded pressure
    and relieves a higher one; 0: of a valve that opens to the supply or to the room. Ignored if commands are openings.
    """


def replace_supply_fields(
    supply: SupplyParameters,
    fill_conductance: float,
    fill_critical_ratio: float,
    exhaust_conductance: float,
    exhaust_critical_ratio: float,
    polytropic_exponent: float,
    leak_conductance: float,
    tank_volume: float,
    tank_pressure: float,
    regulator_time_constant: float,
    dead_volume: float,
    regulator_is_upstream: float,
) -> SupplyParameters:
    """Return ``supply`` with these fields replaced."""
    # numba does not compile NamedTuple._replace.
    return SupplyParameters(
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
        dead_volume,
        leak_conductance,
        tank_volume,
        tank_pressure,
        regulator_time_constant,
        regulator_is_upstream,
    )


def assume_steady_supply(supply: SupplyParameters) -> SupplyParameters:
    """Return ``supply`` as it acts in equilibrium: a tank stays full, and a controlled on/off valve does not pulse.

    A leak has not emptied the tank. Pulses whose width follows the error of the pressure hold, on average, the pressure
    that a continuous opening does.
    """
    # numba does not compile NamedTuple._replace.
    return SupplyParameters(
        supply.max_pressure,
        supply.max_pressure_rate,
        supply.temperature,
        supply.fill_conductance,
        supply.fill_critical_ratio,
        supply.exhaust_conductance,
        supply.exhaust_critical_ratio,
        supply.valve_gain,
        supply.command_is_opening,
        supply.pwm_period if supply.command_is_opening != 0.0 else 0.0,
        supply.min_pulse,
        supply.polytropic_exponent,
        supply.thermal_time_constant,
        supply.dead_volume,
        supply.leak_conductance,
        math.inf if supply.tank_volume > 0.0 else 0.0,
        supply.tank_pressure,
        supply.regulator_time_constant,
        supply.regulator_is_upstream,
    )


def has_metered_flow(supply: SupplyParameters) -> bool:
    """Return whether a valve or a tank meters the flow of air into the muscle."""
    return supply.fill_conductance > 0.0 or supply.tank_volume > 0.0


def has_regulator_upstream(supply: SupplyParameters) -> bool:
    """Return whether a regulator feeds the muscle through a fixed restriction."""
    return supply.fill_conductance > 0.0 and supply.regulator_is_upstream != 0.0 and supply.command_is_opening == 0.0


def regulate(supply: SupplyParameters, pressure: float, command: float, dt: float) -> float:
    """Return the pressure [Pa] after ``dt`` [s]: ``command`` [Pa] clipped to the supply's range, then rate-limited."""
    target = min(max(command, 0.0), supply.max_pressure)
    max_change = supply.max_pressure_rate * dt
    if target > pressure + max_change:
        return pressure + max_change
    if target < pressure - max_change:
        return pressure - max_change
    return target


def speed_of_sound(temperature: float) -> float:
    """Return the speed of sound [m/s] in air at ``temperature`` T [K]: ``sqrt(1.4 R T)``."""
    return math.sqrt(HEAT_CAPACITY_RATIO * AIR_GAS_CONSTANT * temperature)


def air_mass(pressure: float, volume: float, temperature: float) -> float:
    """Return the mass of air [kg] in ``volume`` [m3] at gauge ``pressure`` [Pa]: ideal gas at ``temperature`` [K]."""
    return (pressure + ATMOSPHERIC_PRESSURE) * volume / (AIR_GAS_CONSTANT * temperature)
