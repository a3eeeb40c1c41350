"""The gas: a pressure regulator that is ideal but for its rate, and the air that a muscle holds."""

from typing import NamedTuple

ATMOSPHERE = 101_325.0
"""Standard atmosphere [Pa], to turn gauge into absolute pressure."""
AIR_CONSTANT = 287.05
"""Specific gas constant of dry air [J/(kg K)]."""
ZERO_CELSIUS = 273.15
"""0 degrees Celsius in kelvin."""


class Supply(NamedTuple):
    """What the regulator can deliver."""

    pressure: float
    """Highest gauge pressure [Pa]; commands are clipped to 0 ... this."""
    rate: float
    """Fastest change of pressure, up or down [Pa/s]."""
    temperature: float
    """Gas temperature [K]."""


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
