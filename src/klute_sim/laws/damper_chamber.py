"""A damper whose chambers yield: air in the oil is a spring in series with the orifice (a Maxwell element).

Each chamber refills from a reservoir at atmospheric pressure through a check valve and empties through its orifice, so
only the chamber that the piston compresses carries a pressure p above that of the reservoir. The piston's motion
x compresses that chamber and drives oil through its orifice::

    x = e(F) + z,    F = D(dz/dt),    F = p A,

with the compression e, the orifice law D (:func:`klute_sim.laws.damper.force`) and the area A of the compressed side,
which the rod reduces on its side. The compressed volume is that of the air, isothermal (air of volume Va at
atmospheric pressure pa), and that of the oil::

    A e(F) = Va p / (pa + p) + A h p / B.

Its slope gives the bulk modulus of aerated oil, ``1/Be = alpha/p + (1 - alpha)/B`` (M. G. Rabie, Fluid Power
Engineering, 2009, eq. 2.57 with n = 1). Bubbles are isothermal, because those of less than a millimetre have the oil's
temperature after some milliseconds. Air that dissolves under pressure is neglected (assumed).

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
    length: float
    """Length of the muscle beyond its resting length [m]."""


def has_elastic_chambers(damper: DamperParameters) -> bool:
    """Return whether the chambers yield; otherwise the damper's force depends on the velocity alone."""
    return damper.air_volume > 0.0 and damper.piston_area > 0.0


def compute_compression(damper: DamperParameters, area: float, force: float) -> float:
    """Return how far [m] the magnitude ``force`` >= 0 [N] compresses a chamber of ``area`` > 0 [m2]: e(F)."""
    pressure = force / area
    air = damper.air_volume / area * (pressure / (ATMOSPHERIC_PRESSURE + pressure))
    return air + OIL_COLUMN_LENGTH / OIL_BULK_MODULUS * pressure


def compute_compliance(damper: DamperParameters, area: float, force: float) -> float:
    """Return the derivative of :func:`compute_compression` with ``force`` >= 0 [m/N]."""
    absolute_pressure = ATMOSPHERIC_PRESSURE + force / area
    air = damper.air_volume / area * (ATMOSPHERIC_PRESSURE / (absolute_pressure * absolute_pressure))
    return (air + OIL_COLUMN_LENGTH / OIL_BULK_MODULUS) / area


def step_chambers(damper: DamperParameters, state: DamperState, length: float, dt: float) -> DamperState:
    """Return the state after a time step ``dt`` [s] that ends at ``length`` [m] beyond resting length.

    Backward Euler: ``e(F) + w dt = e(F0) + x - x0`` with ``F = D(w)``, solved for the orifice flow over the area, w.
    """
    target = _compute_signed_compression(damper, state.force) + (length - state.length)
    magnitude = _solve_orifice_force(damper, target, dt)
    return DamperState(magnitude if target > 0.0 else -magnitude, length)


def _compute_signed_compression(damper: DamperParameters, force: float) -> float:
    """Return the compression [m] under ``force`` [N]: positive on the lengthening side."""
    area = compute_area_ratio(damper, force) * damper.piston_area
    if area == 0.0:
        return 0.0
    compression = compute_compression(damper, area, abs(force))
    return compression if force >= 0.0 else -compression


def _solve_orifice_force(damper: DamperParameters, signed_target: float, dt: float) -> float:
    """Return the magnitude of the force F = D(w) [N] at which ``e(F) + w dt`` is ``signed_target`` [m].

    Newton's method within a bracket that it halves where a step would leave it; the sum increases with w.
    """
    ratio, target = compute_area_ratio(damper, signed_target), abs(signed_target)
    area, vc2 = ratio * damper.piston_area, damper.transition_speed * damper.transition_speed
    coefficient = damper.eccentric_coefficient if signed_target > 0.0 else damper.concentric_coefficient
    if area == 0.0:
        return 0.0
    low, high = 0.0, target / dt
    w, force = high, 0.0
    for _ in range(MAX_ITERATIONS):
        flow = ratio * w
        root = math.sqrt(flow * flow + vc2)
        force = ratio * coefficient * flow * root
        excess = compute_compression(damper, area, force) + w * dt - target
        if abs(excess) <= RELATIVE_TOLERANCE * target:
            break
        if excess > 0.0:
            high = w
        else:
            low = w
        slope = dt
        if root > 0.0:
            slope += compute_compliance(damper, area, force) * ratio * ratio * coefficient * (root + flow * flow / root)
        w -= excess / slope
        if not low < w < high:
            w = 0.5 * (low + high)
    return force
