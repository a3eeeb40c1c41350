"""A joint of a mechanism: its inertia, damping and friction, whose nominal values come from the MJCF.

Dry friction is MuJoCo's ``frictionloss``. Friction that yields before it slides, or falls with speed, is a bristle: a
spring that follows the joint and yields at a level that depends on the speed (Dahl 1968; with the level of Stribeck:
Canudas de Wit, Olsson, Astrom & Lischinsky, IEEE Trans. Automatic Control 40:419, 1995).
"""

import math
from typing import NamedTuple


class BristleFriction(NamedTuple):
    """Dry friction that yields elastically before it slides; SI units of a hinge (of a slide: N, m/s and m)."""

    sliding_moment: float
    """Friction of the sliding joint at high speed [N m]; 0 for none."""
    static_excess: float
    """Friction at vanishing speed over that at high speed, minus 1 [1]."""
    stribeck_velocity: float
    """Speed at which the excess has fallen to 1/e [rad/s]."""
    presliding: float
    """Displacement at which the bristle would yield if it did not yield gradually [rad]; positive."""


NO_BRISTLE = BristleFriction(0.0, 0.0, 1.0, 1.0)
"""No friction."""


class Resistance(NamedTuple):
    """Moment against the motion of a joint that a data-driven term adds; SI units of a hinge."""

    constant: float = 0.0
    """Part that does not change [N m]."""
    stiffness: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Coefficients of the position from that of its spring, of its square and of its cube [N m, rad]."""
    quadratic_damping: float = 0.0
    """Coefficient of the speed times its magnitude [N m s2/rad2]."""
    bristles: tuple[BristleFriction, BristleFriction] = (NO_BRISTLE, NO_BRISTLE)
    """Two frictions that yield over different displacements; a sum of such stop operators approximates any hysteresis
    that does not depend on the speed (Prandtl-Ishlinskii model; Visintin, Differential Models of Hysteresis, 1994)."""


NO_RESISTANCE = Resistance()
"""No data-driven term."""


class Joint(NamedTuple):
    """A hinge joint; SI units. Of a slide joint moments are forces and angles are positions."""

    damping: float
    """Viscous damping [N m s/rad]."""
    friction_moment: float
    """Coulomb friction [N m]."""
    armature: float
    """Inertia in addition to that of the bodies [kg m2]."""
    bristle: BristleFriction
    """Dry friction with a presliding displacement."""
    resistance: Resistance = NO_RESISTANCE
    """Data-driven term."""


def bristle_level(friction: BristleFriction, velocity: float) -> float:
    """Return the moment [N m] at which the bristle yields at ``velocity`` [rad/s].

    ``M_c (1 + e exp(-(w / w_s)^2))``: the curve of Stribeck in the form of Canudas de Wit et al. 1995.
    """
    ratio = velocity / friction.stribeck_velocity
    return friction.sliding_moment * (1.0 + friction.static_excess * math.exp(-min(ratio * ratio, 700.0)))


def bristle_stiffness(friction: BristleFriction) -> float:
    """Return the stiffness of the bristle [N m/rad]."""
    return friction.sliding_moment / friction.presliding
