"""Data-driven terms of joints: functions that the equation of motion of a joint lacks.

As those of devices (:mod:`klute_sim.effects.families.discrepancy_terms`) they are not physics. Their polynomials are
bounded by the stops of the joint only.
"""

import math
from typing import Any

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.effects.families.discrepancy_terms import make_coefficient
from klute_sim.laws.joint import BristleFriction, Joint, Resistance

POSITION_SCALE = 0.1
"""Position that normalizes positions of a slide joint [m]; angles are in radians."""
YIELD_DISPLACEMENTS = (1.0, 4.0)
"""Displacements over which frictions of a joint yield [deg or mm] (assumed: those of seals, grease and bushings)."""


def add_sparse_moment(p: Any, joint: Joint) -> Joint:
    """Return the hinge joint with a combination of functions of angle, speed, acceleration and their past."""
    armature = joint.armature + p.acceleration
    return _add_sparse_resistance(p, joint._replace(armature=armature), 1.0, math.pi / 180.0)


def add_sparse_guide_force(p: Any, joint: Joint) -> Joint:
    """Return the slide joint with a combination of functions of position, speed and their past."""
    return _add_sparse_resistance(p, joint, POSITION_SCALE, 1e-3)


def _add_sparse_resistance(p: Any, joint: Joint, position_scale: float, yield_unit: float) -> Joint:
    before = joint.resistance
    constant, linear, squared, cubed, speed, speed_squared, friction, *yielding = p[:9]
    terms = zip(before.stiffness, (linear, squared, cubed), (1, 2, 3), strict=True)
    stiffness = [k + coefficient / position_scale**power for k, coefficient, power in terms]
    bristles = [
        bristle if moment == 0.0 else BristleFriction(bristle.sliding_moment + moment, 0.0, 1.0, yield_unit * distance)
        for bristle, moment, distance in zip(before.bristles, yielding, YIELD_DISPLACEMENTS, strict=True)
    ]
    resistance = Resistance(
        before.constant + constant,
        (stiffness[0], stiffness[1], stiffness[2]),
        before.quadratic_damping + speed_squared,
        (bristles[0], bristles[1]),
    )
    return joint._replace(
        damping=joint.damping + speed, friction_moment=joint.friction_moment + friction, resistance=resistance
    )


def _make_resistance_parameters(position: str, unit: str, upper: float, typical: float) -> tuple[EffectParameter, ...]:
    """Return the coefficients of the functions that a joint of any type has."""
    signed = {"constant": True, position: True, f"{position}_squared": True, f"{position}_cubed": True}
    # Negative linear damping or dry friction would drive the joint from rest.
    signed |= {"speed": False, "speed_squared": True}
    signed |= {"friction": False, "yielding_friction": False, "soft_friction": False}
    return tuple(make_coefficient(f"{name}_{unit}", upper, typical, signed=sign) for name, sign in signed.items())


_RESISTANCE_EQUATION = "M -= sum_k a_k f_k, f_k: 1, q, q^2, q^3, w, w |w|, sign(w), y, z"

UNKNOWN_JOINT_MOMENT = Effect(
    name="unknown_joint_moment",
    description=(
        "No known effect explains the motion of a hinge joint: a combination of functions in its equation of motion, "
        "fitted to data."
    ),
    kind="mechanism",
    part="hinge joint",
    data_driven=True,
    forms=(
        EffectForm(
            name="sparse",
            equation=f"{_RESISTANCE_EQUATION}, dw/dt; q in rad from the rest angle of the spring, "
            "w = dq/dt in rad/s, y and z yield over 1 deg and 4 deg as friction does",
            parameters=(
                *_make_resistance_parameters("angle", "n_m", 20.0, 0.1),
                make_coefficient("acceleration_kg_cm2", 1e4, 50.0, signed=False),
            ),
            laws={"joint": add_sparse_moment},
        ),
    ),
)

UNKNOWN_GUIDE_FORCE = Effect(
    name="unknown_guide_force",
    description=(
        "No known effect explains the motion of a slide joint: a combination of functions in its equation of motion, "
        "fitted to data."
    ),
    kind="mechanism",
    part="slide joint",
    data_driven=True,
    forms=(
        EffectForm(
            name="sparse",
            equation=f"{_RESISTANCE_EQUATION}; q in 100 mm from the rest position of the spring, "
            "w = velocity in m/s, y and z yield over 1 mm and 4 mm as friction does",
            parameters=_make_resistance_parameters("position", "n", 1000.0, 5.0),
            laws={"joint": add_sparse_guide_force},
        ),
    ),
)
