"""The hydraulic damper in parallel with the muscle (dissertation chapter 4).

Oil is pushed through one fixed orifice per direction (flow-control valves), so the force is quadratic in
speed: it cannot follow Hill's steep rise near rest, and chapter 4 shows that residual.
"""

import math
from typing import NamedTuple


class DamperParameters(NamedTuple):
    """Quadratic coefficients of an orifice damper, one per direction; 0 means no damping in that direction."""

    concentric_coefficient: float
    """Force over speed squared while shortening [N s2/m2]."""
    eccentric_coefficient: float
    """Force over speed squared while lengthening [N s2/m2]."""


def force(damper: DamperParameters, velocity: float) -> float:
    """Tension [N] at ``velocity`` = dL/dt [m/s]: negative while shortening, positive while lengthening."""
    if velocity > 0.0:
        return damper.eccentric_coefficient * velocity * velocity
    return -damper.concentric_coefficient * velocity * velocity


def orifice_coefficient(bore: float, orifice: float, density: float, discharge_coefficient: float) -> float:
    """Force over speed squared [N s2/m2] of an ``orifice`` [m] in a cylinder of ``bore`` [m].

    This is the inverse of eq. (4.6): ``Fd = (pi bore^2 / 4) (rho / 2) v^2 [(bore/orifice)^4 / Cd^2 - 1]`` with oil
    ``density`` [kg/m3] and ``discharge_coefficient`` Cd [1]. Valid for 0 < orifice <= bore.
    """
    ratio = bore / orifice
    pressure = 0.5 * density * (ratio * ratio * ratio * ratio / (discharge_coefficient * discharge_coefficient) - 1.0)
    return 0.25 * math.pi * bore * bore * pressure


def desired_force(muscle_force: float, target_force: float) -> float:
    """Damping [N] that makes the actuator behave like the target muscle, eq. (4.1): ``F_McK - F_muscle``."""
    return muscle_force - target_force


def required_bore(damping: float, cylinder_pressure: float) -> float:
    """Cylinder bore [m] that carries ``damping`` [N] at ``cylinder_pressure`` [Pa], eq. (4.2)."""
    return math.sqrt(4.0 * damping / (math.pi * cylinder_pressure))


def required_orifice(damping: float, speed: float, bore: float, density: float, discharge_coefficient: float) -> float:
    """Orifice diameter [m] that gives ``damping`` [N] at ``speed`` [m/s], eq. (4.6).

    ``[pi rho v^2 bore^6 / (8 Fd Cd^2 + pi rho Cd^2 v^2 bore^2)]^(1/4)``, with oil ``density`` [kg/m3] and
    ``discharge_coefficient`` Cd [1].
    """
    b2 = bore * bore
    flow = math.pi * density * speed * speed
    cd2 = discharge_coefficient * discharge_coefficient
    return math.sqrt(math.sqrt(flow * b2 * b2 * b2 / (8.0 * damping * cd2 + flow * cd2 * b2)))
