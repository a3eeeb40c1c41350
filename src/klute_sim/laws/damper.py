"""The hydraulic damper in parallel with the muscle (dissertation chapter 4).

Oil is pushed through one fixed orifice per direction (flow-control valves), so the force is quadratic in
speed: it cannot follow Hill's steep rise near rest, and chapter 4 shows that residual.

The first three parameters are those of the device file. The others are neutral at 0, and effects set them.
:mod:`klute_sim.laws.damper_chamber` has the law of a damper whose chambers yield.
"""

import math
from typing import NamedTuple


class DamperParameters(NamedTuple):
    """Orifice damper with one orifice per direction; a coefficient of 0 means no damping in that direction."""

    concentric_coefficient: float
    """Force over speed squared while shortening [N s2/m2]."""
    eccentric_coefficient: float
    """Force over speed squared while lengthening [N s2/m2]."""
    piston_area: float = 0.0
    """Area of the bore [m2]; only chambers that yield depend on it."""
    transition_speed: float = 0.0
    """Speed of the piston below which the oil flow is laminar [m/s]."""
    air_volume: float = 0.0
    """Volume at atmospheric pressure of the air in the oil of each chamber [m3]."""
    rod_area: float = 0.0
    """Cross-section of the piston rod, which is on the side that is compressed while lengthening [m2]."""
    inverse_charge: float = 0.0
    """Inverse of the absolute charge pressure on the side that is compressed while shortening [1/Pa]; 0: no limit."""


def replace_damper_fields(
    damper: DamperParameters,
    concentric_coefficient: float,
    eccentric_coefficient: float,
    transition_speed: float,
    air_volume: float,
    rod_area: float,
    inverse_charge: float,
) -> DamperParameters:
    """Return ``damper`` with these fields replaced."""
    # numba does not compile NamedTuple._replace.
    return DamperParameters(
        concentric_coefficient,
        eccentric_coefficient,
        damper.piston_area,
        transition_speed,
        air_volume,
        rod_area,
        inverse_charge,
    )


def compute_area_ratio(damper: DamperParameters, velocity: float) -> float:
    """Return the area of the side that meters the oil at ``velocity`` [m/s] over that of the bore.

    It is ``r = 1 - (d/D)^2`` on the side of a rod of diameter d in a bore D, and 0 without room beside the rod. Without
    charge, the compressed side meters. With charge, the side of the rod meters in both directions.
    """
    is_full_side = velocity <= 0.0 and damper.inverse_charge == 0.0
    if is_full_side or damper.rod_area == 0.0 or damper.piston_area == 0.0:
        return 1.0
    return max(0.0, 1.0 - damper.rod_area / damper.piston_area)


def force(damper: DamperParameters, velocity: float) -> float:
    """Tension [N] of the orifices at ``velocity`` = dL/dt [m/s]: negative while shortening, positive while lengthening.

    The force is ``c v |v|``, or ``c v sqrt(v^2 + vc^2)`` with a transition speed vc. A side of area ratio r drives only
    the flow of the velocity r v through its orifice, and the pressure acts on the fraction r of the area: ``r F(r v)``.
    """
    coefficient = damper.eccentric_coefficient if velocity > 0.0 else -damper.concentric_coefficient
    if damper.transition_speed == 0.0 and damper.rod_area == 0.0:
        return coefficient * velocity * velocity
    ratio = compute_area_ratio(damper, velocity)
    w, vc2 = ratio * velocity, damper.transition_speed * damper.transition_speed
    return ratio * coefficient * abs(w) * math.sqrt(w * w + vc2)


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
