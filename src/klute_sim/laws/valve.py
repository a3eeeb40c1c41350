"""Air through valves and in chambers (ISO 6358, and the first law for an ideal gas).

Pressures here are absolute. A restriction has a sonic conductance C and a critical pressure ratio b. Mass flow is
positive in the direction of falling pressure.
"""

import math
from typing import NamedTuple

from klute_sim.laws.pneumatics import AIR_CONSTANT

REFERENCE_DENSITY = 1.185
"""Of air at the reference atmosphere of ISO 8778 [kg/m3]: 100 kPa, 20 degrees Celsius, 65 % humidity."""
REFERENCE_TEMPERATURE = 293.15
"""Of the same [K]."""
LAMINAR = 0.999
"""Ratio of pressures above which flow is proportional to their difference (ISO 6358: the square root has no slope)."""


class Restriction(NamedTuple):
    """A valve's opening, or a leak."""

    conductance: float
    """C, sonic conductance [m3/(s Pa)]; 1 dm3/(s bar) is 1e-8."""
    critical_ratio: float
    """b, ratio of pressures below which the flow is sonic [1]; 0 to below 1, about 0.3 to 0.5 for valves."""


class Chamber(NamedTuple):
    """A volume of air that may change."""

    exponent: float
    """n, polytropic exponent [1]: 1 if the walls keep the temperature, 1.4 if they give no heat."""
    temperature: float
    """Of the air that comes and goes [K]."""


def sonic_flow(restriction: Restriction, upstream: float, temperature: float) -> float:
    """Mass flow [kg/s] at the speed of sound from ``upstream`` [Pa] at ``temperature`` [K]: ``C rho0 p sqrt(T0/T)``."""
    return restriction.conductance * REFERENCE_DENSITY * upstream * math.sqrt(REFERENCE_TEMPERATURE / temperature)


def flow_share(ratio: float, critical_ratio: float) -> float:
    """Flow over sonic flow at ``ratio`` = p2/p1 [1], ISO 6358: ``sqrt(1 - ((r - b)/(1 - b))^2)`` above b, 1 below.

    From :data:`LAMINAR` on a line to 0 at equal pressures, which it has to have a finite slope.
    """
    if ratio <= critical_ratio:
        return 1.0
    if ratio >= 1.0:
        return 0.0
    edge = max(LAMINAR, critical_ratio)
    beyond = (min(ratio, edge) - critical_ratio) / (1.0 - critical_ratio)
    share = math.sqrt(1.0 - beyond * beyond)
    if ratio > edge:
        share *= (1.0 - ratio) / (1.0 - edge)
    return share


def flow(restriction: Restriction, first: float, second: float, temperature: float) -> float:
    """Mass flow [kg/s] from ``first`` to ``second`` [Pa absolute]; negative if the second is higher. Valid above 0."""
    if first >= second:
        return sonic_flow(restriction, first, temperature) * flow_share(second / first, restriction.critical_ratio)
    return -sonic_flow(restriction, second, temperature) * flow_share(first / second, restriction.critical_ratio)


def pressure_rate(chamber: Chamber, pressure: float, volume: float, inflow: float, expansion: float) -> float:
    """dp/dt [Pa/s]: ``n/V (R T m' - p V')`` at ``pressure`` [Pa absolute] in ``volume`` [m3].

    ``inflow`` m' [kg/s] comes in and the volume grows by ``expansion`` V' [m3/s].
    """
    gained = AIR_CONSTANT * chamber.temperature * inflow
    return chamber.exponent / volume * (gained - pressure * expansion)


def compressed(chamber: Chamber, pressure: float, before: float, after: float) -> float:
    """Pressure [Pa absolute] of closed air that was at ``pressure`` in volume ``before`` [m3], now in ``after``.

    ``p V^n`` stays: what :func:`pressure_rate` comes to without flow.
    """
    return pressure * math.pow(before / after, chamber.exponent)


def filling_time(
    restriction: Restriction, chamber: Chamber, volume: float, source: float, low: float, high: float
) -> float:
    """Time [s] to fill ``volume`` [m3] from ``low`` to ``high`` [Pa absolute] out of a ``source`` [Pa] with sonic flow.

    ``V (high - low) / (n R T m')``, m' the sonic flow. Valid while ``high`` is at most b times the source.
    """
    rate = sonic_flow(restriction, source, chamber.temperature)
    return volume * (high - low) / (chamber.exponent * AIR_CONSTANT * chamber.temperature * rate)


def venting_time(restriction: Restriction, chamber: Chamber, volume: float, high: float, low: float) -> float:
    """Time [s] to empty ``volume`` [m3] from ``high`` to ``low`` [Pa absolute] with sonic flow: an exponential.

    ``V / (n R T C rho0 sqrt(T0/T)) ln(high/low)``. Valid while the outside is at most b times ``low``.
    """
    per_pressure = sonic_flow(restriction, 1.0, chamber.temperature)
    constant = volume / (chamber.exponent * AIR_CONSTANT * chamber.temperature * per_pressure)
    return constant * math.log(high / low)


def tube(length: float, diameter: float) -> Restriction:
    """A tube of ``length`` and inner ``diameter`` [m]: ``C = 0.029 d^2/sqrt(L/d^1.25 + 510)``, ``b = 474 C/d^2``.

    d and L in metres. An empirical fit for the tubes of pneumatic drives (P. Beater, Pneumatic Drives, Springer 2007;
    recalled, not checked against the book).
    """
    square = diameter * diameter
    conductance = 0.029 * square / math.sqrt(length / diameter**1.25 + 510.0)
    return Restriction(conductance, 474.0 * conductance / square)


def in_series(first: Restriction, second: Restriction) -> Restriction:
    """One restriction for two behind each other: ``1/C^3 = sum 1/C_i^3``, ``b = 1 - C^2 sum (1 - b_i)/C_i^2``.

    The approximation of ISO 6358:1989 for components in series; it is exact if one of them is wide open.
    """
    total = (first.conductance**-3.0 + second.conductance**-3.0) ** (-1.0 / 3.0)
    lost = sum((1.0 - each.critical_ratio) * (total / each.conductance) ** 2 for each in (first, second))
    return Restriction(total, min(max(1.0 - lost, 0.0), 0.999))
