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
"""Temperature of the reference atmosphere [K]."""
LAMINAR_PRESSURE_RATIO = 0.999
"""Ratio of pressures above which flow is proportional to their difference (ISO 6358: the square root has no slope)."""
HOSE_FRICTION_FACTOR = 0.02
"""Darcy friction factor of a smooth hose in turbulent flow [1] (assumed: Blasius, 0.316 Re^-0.25, at Re = 60 000)."""


class Restriction(NamedTuple):
    """A valve's opening, or a leak."""

    conductance: float
    """C, sonic conductance [m3/(s Pa)]; 1 dm3/(s bar) is 1e-8."""
    critical_ratio: float
    """b, ratio of pressures below which the flow is sonic [1]; 0 to below 1, about 0.3 to 0.5 for valves."""


def sonic_mass_flow(restriction: Restriction, upstream_pressure: float, temperature: float) -> float:
    """Mass flow [kg/s] of sonic flow: ``C rho0 p sqrt(T0/T)``.

    p is the absolute ``upstream_pressure`` [Pa] and T the ``temperature`` [K]."""
    return (
        restriction.conductance * REFERENCE_DENSITY * upstream_pressure * math.sqrt(REFERENCE_TEMPERATURE / temperature)
    )


def flow_function(ratio: float, critical_ratio: float) -> float:
    """Flow over sonic flow at ``ratio`` = p2/p1 [1], ISO 6358: ``sqrt(1 - ((r - b)/(1 - b))^2)`` above b, 1 below.

    It is linear from :data:`LAMINAR_PRESSURE_RATIO` to 0 at equal pressures, so that the slope stays finite.
    """
    if ratio <= critical_ratio:
        return 1.0
    if ratio >= 1.0:
        return 0.0
    laminar_ratio = max(LAMINAR_PRESSURE_RATIO, critical_ratio)
    normalized_ratio = (min(ratio, laminar_ratio) - critical_ratio) / (1.0 - critical_ratio)
    fraction = math.sqrt(1.0 - normalized_ratio * normalized_ratio)
    if ratio > laminar_ratio:
        fraction *= (1.0 - ratio) / (1.0 - laminar_ratio)
    return fraction


def mass_flow(restriction: Restriction, pressure_1: float, pressure_2: float, temperature: float) -> float:
    """Mass flow [kg/s] from ``pressure_1`` to ``pressure_2``, both absolute and above 0 [Pa]; negative if p2 > p1."""
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
    """Time [s] to fill ``volume`` V [m3] with sonic flow: ``V (p_end - p_start)/(n R T m')``.

    m' is the sonic flow from ``source_pressure`` at ``temperature`` T [K], and n the polytropic ``exponent``. Pressures
    are absolute [Pa]. Valid while ``end_pressure`` is at most b times ``source_pressure``.
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
    """Time [s] to empty ``volume`` V [m3] from ``start_pressure`` to ``end_pressure`` [Pa absolute] with sonic flow.

    The air starts at ``temperature`` T [K] and cools as ``p ~ m^n``, with the polytropic ``exponent`` n:
    ``tau 2/(n - 1) ((p_start/p_end)^((n - 1)/2n) - 1)`` with tau = V/(R T C rho0 sqrt(T0/T)), and
    ``tau ln(p_start/p_end)`` for n = 1. Valid while the ambient pressure is at most b times ``end_pressure``.
    """
    tau = volume / (AIR_GAS_CONSTANT * temperature * sonic_mass_flow(restriction, 1.0, temperature))
    if exponent == 1.0:
        return tau * math.log(start_pressure / end_pressure)
    power = (exponent - 1.0) / (2.0 * exponent)
    return tau * 2.0 / (exponent - 1.0) * (math.pow(start_pressure / end_pressure, power) - 1.0)


def tube_restriction(length: float, diameter: float) -> Restriction:
    """Return the restriction of a tube: ``C = 0.029 d^2/sqrt(L/d^1.25 + 510)``, ``b = 474 C/d^2``.

    L is the ``length`` and d the inner ``diameter`` [m]. This is an empirical fit for the tubes of pneumatic
    drives (P. Beater, Pneumatic Drives, Springer 2007; not checked against the book).
    """
    square = diameter * diameter
    conductance = 0.029 * square / math.sqrt(length / diameter**1.25 + 510.0)
    return Restriction(conductance, 474.0 * conductance / square)


def hose_restriction(length: float, diameter: float) -> Restriction:
    """Return the restriction of a hose by wall friction: ``C = A/(rho0 sqrt(R T0)) sqrt(d/(f L))``, b = 0.

    L is the ``length``, d the inner ``diameter`` [m], A the bore and f :data:`HOSE_FRICTION_FACTOR`. With b = 0 the
    flow of ISO 6358 is that of the isothermal gas in a long pipe, ``m' = A sqrt((p1^2 - p2^2) d/(f L R T))`` (F. M.
    White, Fluid Mechanics, chapter 9; quoted from memory). The entrance is that of the fitting before it.
    """
    bore = 0.25 * math.pi * diameter * diameter
    scale = REFERENCE_DENSITY * math.sqrt(AIR_GAS_CONSTANT * REFERENCE_TEMPERATURE)
    return Restriction(bore / scale * math.sqrt(diameter / (HOSE_FRICTION_FACTOR * length)), 0.0)


def combine_in_series(first: Restriction, second: Restriction) -> Restriction:
    """Return one restriction for two in series: ``1/C^3 = sum 1/C_i^3``, ``b = 1 - C^2 sum (1 - b_i)/C_i^2``.

    This is the approximation of ISO 6358:1989; it is exact if one of them is wide open.
    """
    total = (first.conductance**-3.0 + second.conductance**-3.0) ** (-1.0 / 3.0)
    share_1, share_2 = total / first.conductance, total / second.conductance
    reduction = (1.0 - first.critical_ratio) * share_1**2 + (1.0 - second.critical_ratio) * share_2**2
    return Restriction(total, min(max(1.0 - reduction, 0.0), 0.999))
