"""A damper whose chambers yield: air in the oil is a spring in series with the orifice (a Maxwell element).

Each chamber refills from a reservoir at atmospheric pressure through a check valve and empties through its orifice, so
only the chamber that the piston compresses carries a pressure p above that of the reservoir (assumed circuit). The
piston's motion x compresses that chamber and drives oil through its orifice::

    x = e(F) + z,    F = D(dz/dt),    F = p A,

with the compression e, the orifice law D (:func:`klute_sim.laws.damper.force`) and the area A of the compressed side,
which the rod reduces on its side. The compressed volume is that of the air, isothermal (air of volume Va at
atmospheric pressure pa), and that of the oil::

    A e(F) = Va p / (pa + p) + A h p / B.

Its slope gives the bulk modulus of aerated oil, ``1/Be = alpha/p + (1 - alpha)/B`` (M. G. Rabie, Fluid Power
Engineering, 2009, eq. 2.57 with n = 1). Bubbles are isothermal, because those of less than a millimetre have the oil's
temperature after some milliseconds. Air that dissolves under pressure is neglected (assumed).

*Cavitation.* A charge pressure p0 (absolute) on the side without the rod turns the circuit into that of a monotube
damper, whose orifices join both sides. While lengthening, the side of the rod is compressed from p0. While shortening,
its pressure falls to p0 - p, and not below the vapour pressure of mineral oil, which is practically 0 (assumed). The
tension therefore stays above ``-p0 A`` (gas charge against cavitation: Lee, Numerical Modelling for the Hydraulic
Performance Prediction of Automotive Monotube Dampers, Vehicle System Dynamics 28:25, 1997; only the abstract was read,
author and volume are quoted from memory). Where the piston needs more oil than the orifice supplies at this pressure, a
void opens. The void counts as compression: after a reversal the piston and the orifice close it first, a dead stroke.
Air then expands instead, ``A e(F) = Va pa/p0 p/(p0 - p)``.
Without air the oil is rigid. The push of the charge on the rod is constant and left out.

``e`` increases with F, so the stored energy ``int F de`` is convex and a backward-Euler step never creates energy.
"""

import math
from typing import NamedTuple

from klute_sim.laws.damper import DamperParameters, compute_area_ratio
from klute_sim.laws.pneumatics import ATMOSPHERIC_PRESSURE

OIL_BULK_MODULUS = 1.5e9
"""Bulk modulus B of oil without air [Pa], at 50 degrees Celsius (HAWE Hydraulik, fluid lexicon, "Bulk modulus")."""
OIL_COLUMN_LENGTH = 0.04
"""Length h of the oil column in front of the piston [m] (assumed: half a stroke)."""
RELATIVE_TOLERANCE = 4e-15
"""Residual at which a step counts as solved, relative to the compression and flow that it distributes."""
MAX_ITERATIONS = 100
"""Maximum number of iterations of one step."""


class DamperState(NamedTuple):
    """State of the chambers between two time steps."""

    force: float
    """Tension of the damper [N]: positive while the lengthening side is compressed."""
    void: float
    """Length of the void in the side of the rod [m]."""
    length: float
    """Length of the muscle beyond its resting length [m]."""


def has_elastic_chambers(damper: DamperParameters) -> bool:
    """Return whether the chambers yield; otherwise the damper's force depends on the velocity alone."""
    return (damper.air_volume > 0.0 or damper.inverse_charge > 0.0) and damper.piston_area > 0.0


def compute_compression(damper: DamperParameters, area: float, force: float, suction: bool) -> float:
    """Return e(F) [m] at the magnitude ``force`` >= 0 [N] on the ``area`` > 0 [m2] of a chamber.

    With ``suction`` the chamber expands under a pressure below that of the charge; at an absolute pressure of 0 its air
    has no bound, and the result is infinite.
    """
    if damper.air_volume == 0.0:
        return 0.0
    pressure, charge = force / area, _get_charge(damper)
    absolute_pressure = charge - pressure if suction else charge + pressure
    if absolute_pressure <= 0.0:
        return math.inf
    air = damper.air_volume * (ATMOSPHERIC_PRESSURE / charge) / area * (pressure / absolute_pressure)
    return air + OIL_COLUMN_LENGTH / OIL_BULK_MODULUS * pressure


def compute_compliance(damper: DamperParameters, area: float, force: float, suction: bool) -> float:
    """Return the derivative of :func:`compute_compression` with ``force`` >= 0 [m/N]."""
    if damper.air_volume == 0.0:
        return 0.0
    pressure, charge = force / area, _get_charge(damper)
    absolute_pressure = charge - pressure if suction else charge + pressure
    if absolute_pressure <= 0.0:
        return math.inf
    air = damper.air_volume / area * (ATMOSPHERIC_PRESSURE / (absolute_pressure * absolute_pressure))
    return (air + OIL_COLUMN_LENGTH / OIL_BULK_MODULUS) / area


def _get_charge(damper: DamperParameters) -> float:
    """Return the absolute pressure of the reservoir [Pa]."""
    return 1.0 / damper.inverse_charge if damper.inverse_charge > 0.0 else ATMOSPHERIC_PRESSURE


def step_chambers(damper: DamperParameters, state: DamperState, length: float, dt: float) -> DamperState:
    """Return the state after a time step ``dt`` [s] that ends at ``length`` [m] beyond resting length.

    Backward Euler: ``e(F) + void + w dt = e(F0) + void0 + x - x0`` with ``F = D(w)``, solved for the orifice flow over
    the area, w.
    """
    ratio = compute_area_ratio(damper, state.force)
    compression = state.void
    if ratio > 0.0:
        suction = state.force < 0.0 and damper.inverse_charge > 0.0
        compression += compute_compression(damper, ratio * damper.piston_area, abs(state.force), suction)
    # The side that is compressed is that of the force.
    target = (compression if state.force > 0.0 else -compression) + (length - state.length)
    force, void = _solve_orifice_force(damper, target, dt)
    return DamperState(force if target > 0.0 else -force, void, length)


def _solve_orifice_force(damper: DamperParameters, signed_target: float, dt: float) -> tuple[float, float]:
    """Return magnitude of the force F = D(w) [N] and void [m] with ``e(F) + void + w dt = abs(signed_target)`` [m].

    Newton's method within a bracket that it halves where a step would leave it; the sum increases with w.
    """
    ratio, target = compute_area_ratio(damper, signed_target), abs(signed_target)
    area, vc2 = ratio * damper.piston_area, damper.transition_speed * damper.transition_speed
    coefficient = damper.eccentric_coefficient if signed_target > 0.0 else damper.concentric_coefficient
    if area == 0.0 or coefficient == 0.0:
        return 0.0, 0.0
    suction = signed_target < 0.0 and damper.inverse_charge > 0.0
    low, high = 0.0, target / dt
    if suction:
        max_force = area * _get_charge(damper)
        load = max_force / (ratio * coefficient)
        max_w = load * math.sqrt(2.0 / (vc2 + math.sqrt(vc2 * vc2 + 4.0 * load * load))) / ratio
        if damper.air_volume == 0.0 and max_w < high:
            return max_force, target - max_w * dt
        high = min(high, max_w)
    w, force = high, 0.0
    for _ in range(MAX_ITERATIONS):
        flow = ratio * w
        root = math.sqrt(flow * flow + vc2)
        force = ratio * coefficient * flow * root
        excess = compute_compression(damper, area, force, suction) + w * dt - target
        if abs(excess) <= RELATIVE_TOLERANCE * target:
            break
        if excess > 0.0:
            high = w
        else:
            low = w
        slope = dt
        if root > 0.0:
            compliance = compute_compliance(damper, area, force, suction)
            slope += compliance * ratio * ratio * coefficient * (root + flow * flow / root)
        w -= excess / slope
        if not low < w < high:
            w = 0.5 * (low + high)
    return force, 0.0
