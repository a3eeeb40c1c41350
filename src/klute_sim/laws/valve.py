"""Air flow through valves (ISO 6358), and the times to fill and to empty a volume.

Pressures here are absolute. A restriction has a sonic conductance C and a critical pressure ratio b. Mass flow is
positive in the direction of falling pressure.
"""

import math
from typing import NamedTuple

from klute_sim.laws.pneumatics import AIR_GAS_CONSTANT

REFERENCE_DENSITY = 1.185
"""Density of air at the reference atmosphere of ISO 8778 [kg/m3]: 100 kPa, 20 degrees Celsius, 65 % humidity."""
REFERENCE_TEMPERATURE = 293.15
"""Temperature of the same atmosphere [K]."""
LAMINAR_PRESSURE_RATIO = 0.999
"""Ratio of pressures above which flow is proportional to their difference (ISO 6358: the square root has no slope)."""


class Restriction(NamedTuple):
    """A valve's opening, or a leak."""

    conductance: float
    """C, sonic conductance [m3/(s Pa)]; 1 dm3/(s bar) is 1e-8."""
    critical_ratio: float
    """b, ratio of pressures below which the flow is sonic [1]; 0 to below 1, about 0.3 to 0.5 for valves."""


def sonic_mass_flow(restriction: Restriction, upstream_pressure: float, temperature: float) -> float:
    """Mass flow [kg/s] at the speed of sound from ``upstream`` [Pa] at ``temperature`` [K]: ``C rho0 p sqrt(T0/T)``."""
    return (
        restriction.conductance * REFERENCE_DENSITY * upstream_pressure * math.sqrt(REFERENCE_TEMPERATURE / temperature)
    )


def flow_function(ratio: float, critical_ratio: float) -> float:
    """Flow over sonic flow at ``ratio`` = p2/p1 [1], ISO 6358: ``sqrt(1 - ((r - b)/(1 - b))^2)`` above b, 1 below.

    Linear from :data:`LAMINAR_PRESSURE_RATIO` to 0 at equal pressures, so that the slope stays finite.
    """
    if ratio <= critical_ratio:
        return 1.0
    if ratio >= 1.0:
        return 0.0
    edge = max(LAMINAR_PRESSURE_RATIO, critical_ratio)
    beyond = (min(ratio, edge) - critical_ratio) / (1.0 - critical_ratio)
    fraction = math.sqrt(1.0 - beyond * beyond)
    if ratio > edge:
        fraction *= (1.0 - ratio) / (1.0 - edge)
    return fraction


def mass_flow(restriction: Restriction, pressure_1: float, pressure_2: float, temperature: float) -> float:
    """Mass flow [kg/s] from ``first`` to ``second`` [Pa absolute]; negative if the second is higher. Valid above 0."""
    if pressure_1 >= pressure_2:
        return sonic_mass_flow(restriction, pressure_1, temperature) * flow_function(
            pressure_2 / pressure_1, restriction.critical_ratio
        )
    return -sonic_mass_flow(restriction, pressure_2, temperature) * flow_function(
        pressure_1 / pressure_2, restriction.critical_ratio
    )


def filling_time(
    restriction: Restriction,
    exponent: float,
    temperature: float,
    volume: float,
    source_pressure: float,
    start_pressure: float,
    end_pressure: float,
) -> float:
    """Time [s] to fill ``volume`` [m3] from ``low`` to ``high`` [Pa absolute] with sonic flow out of ``source`` [Pa].

    ``V (high - low)/(n R T m')``, m' the sonic flow at the source's ``temperature`` T [K], n the polytropic
    ``exponent``. Valid while ``high`` is at most b times the source.
    """
    rate = sonic_mass_flow(restriction, source_pressure, temperature)
    return volume * (end_pressure - start_pressure) / (exponent * AIR_GAS_CONSTANT * temperature * rate)


def venting_time(
    restriction: Restriction,
    exponent: float,
    temperature: float,
    volume: float,
    start_pressure: float,
    end_pressure: float,
) -> float:
    """Time [s] to empty ``volume`` [m3] from ``high`` to ``low`` [Pa absolute] with sonic flow.

    It begins at ``temperature`` [K] and cools as ``p ~ m^n``: ``tau 2/(n - 1) ((high/low)^((n - 1)/2n) - 1)`` with
    tau = V/(R T C rho0 sqrt(T0/T)), and ``tau ln(high/low)`` for n = 1. Valid while the outside is at most b times
    ``low``.
    """
    tau = volume / (AIR_GAS_CONSTANT * temperature * sonic_mass_flow(restriction, 1.0, temperature))
    if exponent == 1.0:
        return tau * math.log(start_pressure / end_pressure)
    power = (exponent - 1.0) / (2.0 * exponent)
    return tau * 2.0 / (exponent - 1.0) * (math.pow(start_pressure / end_pressure, power) - 1.0)


def tube_restriction(length: float, diameter: float) -> Restriction:
    """A tube of ``length`` and inner ``diameter`` [m]: ``C = 0.029 d^2/sqrt(L/d^1.25 + 510)``, ``b = 474 C/d^2``.

    d and L in metres. An empirical fit for the tubes of pneumatic drives (P. Beater, Pneumatic Drives, Springer 2007;
    recalled, not checked against the book).
    """
    square = diameter * diameter
    conductance = 0.029 * square / math.sqrt(length / diameter**1.25 + 510.0)
    return Restriction(conductance, 474.0 * conductance / square)


def combine_in_series(first: Restriction, second: Restriction) -> Restriction:
    """Return one restriction for two in series: ``1/C^3 = sum 1/C_i^3``, ``b = 1 - C^2 sum (1 - b_i)/C_i^2``.

    The approximation of ISO 6358:1989 for components in series; it is exact if one of them is wide open.
    """
    total = (first.conductance**-3.0 + second.conductance**-3.0) ** (-1.0 / 3.0)
    reduction = sum((1.0 - part.critical_ratio) * (total / part.conductance) ** 2 for part in (first, second))
    return Restriction(total, min(max(1.0 - reduction, 0.0), 0.999))
