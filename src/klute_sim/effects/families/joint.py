"""Effects of the mechanism that carries the devices: its joints, pulleys, its stand, and the sensors of its joints.

They appear in datasets of a mechanism only. A law at ``joint`` changes a :class:`klute_sim.laws.joint.Joint`, a law at
``pulley`` the radius of a pulley, and a law at ``gravity`` the direction of gravity; all are numbers of the MJCF except
the friction of a bristle, which acts beside the devices (:mod:`klute_sim.plant.joint_friction`).
"""

import math
from typing import Any

import numpy as np

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.laws.joint import BristleFriction, Joint
from klute_sim.types import Array

STRIBECK_PRESLIDING = 0.1
"""Presliding displacement of the form with a falling level [deg or mm] (assumed: too short to show in a usual log)."""


def add_dry_friction(p: Any, joint: Joint) -> Joint:
    """Return the joint with ``p.moment`` [N m] more Coulomb friction."""
    return joint._replace(friction_moment=joint.friction_moment + p[0])


def add_damping(p: Any, joint: Joint) -> Joint:
    """Return the joint with ``p.damping`` [N m s/rad] more viscous damping."""
    return joint._replace(damping=joint.damping + p[0])


def add_falling_friction(p: Any, joint: Joint) -> Joint:
    """Return the joint with friction that falls from ``1 + p.static_excess`` times ``p.moment`` with the speed."""
    moment, excess, velocity = p
    presliding = STRIBECK_PRESLIDING * math.pi / 180.0
    return joint._replace(bristle=BristleFriction(moment, excess, velocity, presliding))


def add_falling_guide_friction(p: Any, joint: Joint) -> Joint:
    """Return the slide joint with friction that falls with the speed."""
    force, excess, velocity = p
    return joint._replace(bristle=BristleFriction(force, excess, velocity, 1e-3 * STRIBECK_PRESLIDING))


def add_presliding_friction(p: Any, joint: Joint) -> Joint:
    """Return the joint with friction of ``p.moment`` [N m] that yields over ``p.presliding`` [rad] before it slides."""
    return joint._replace(bristle=BristleFriction(p[0], 0.0, 1.0, p[1]))


def add_inertia(p: Any, joint: Joint) -> Joint:
    """Return the joint with ``p.inertia`` [kg m2] more inertia."""
    return joint._replace(armature=joint.armature + p.inertia)


def scale_radius(p: Any, radius: float) -> float:
    """Return the radius of a pulley [m], ``p.gain`` times the nominal one."""
    return float(p.gain * radius)


def tilt_about_x(p: Any, gravity: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return ``gravity`` [m/s2] as a rig sees it that is turned by ``p.tilt`` [rad] about the x axis."""
    x, y, z = gravity
    cosine, sine = math.cos(p.tilt), math.sin(p.tilt)
    return x, cosine * y + sine * z, cosine * z - sine * y


def tilt_about_y(p: Any, gravity: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return ``gravity`` [m/s2] as a rig sees it that is turned by ``p.tilt`` [rad] about the y axis."""
    x, y, z = gravity
    cosine, sine = math.cos(p.tilt), math.sin(p.tilt)
    return cosine * x - sine * z, y, cosine * z + sine * x


def apply_backlash(p: Any, time: Array, value: Array) -> Array:
    """Return the reading of a sensor that is driven with play: it follows once half of ``p.play`` is taken up.

    The play operator (Visintin, Differential Models of Hysteresis, 1994). It begins in the middle of the play.
    """
    half = 0.5 * p.play
    if half <= 0.0:
        return value
    reading = np.empty(len(value))
    position = float(value[0])
    for k, y in enumerate(value.tolist()):
        position = min(max(position, y - half), y + half)
        reading[k] = position
    return reading


def _make_joint_form(
    name: str, equation: str, law: Any, *parameters: EffectParameter, replaces_number: str = ""
) -> EffectForm:
    return EffectForm(
        name=name, equation=equation, parameters=parameters, laws={"joint": law}, replaces_number=replaces_number
    )


def _make_friction(
    name: str, description: str, part: Any, units: tuple[str, str, str, str], sizes: tuple[float, ...], falling: Any
) -> Effect:
    """Return dry and viscous friction of a joint.

    ``units`` are those of moment, damping, speed and position at the ends of keys, with the word that begins each key;
    ``sizes`` are typical values of the first three, of the presliding, and the upper bounds of moment and damping.
    """
    moment_key, damping_key, speed_key, presliding_key = units
    moment_size, damping_size, speed_size, presliding_size, max_moment, max_damping = sizes
    source = "assumed: bearings of a laboratory joint; a few per cent of the moment of its muscles"
    moment = EffectParameter(
        key=moment_key, neutral=0.0, lower=0.0, upper=max_moment, typical=moment_size, source=source
    )
    return Effect(
        name=name,
        description=description,
        kind="mechanism",
        part=part,
        forms=(
            _make_joint_form(
                "coulomb", "M = -M_c sign(dq/dt)", add_dry_friction, moment, replaces_number="frictionloss"
            ),
            _make_joint_form(
                "viscous",
                "M = -b dq/dt",
                add_damping,
                EffectParameter(
                    key=damping_key, neutral=0.0, lower=0.0, upper=max_damping, typical=damping_size, source=source
                ),
                replaces_number="damping",
            ),
            _make_joint_form(
                "stribeck",
                "M = -M_c (1 + e exp(-(w/w_s)^2)) sign(w), w = dq/dt, static within 0.1 deg or mm",
                falling,
                moment,
                EffectParameter(
                    key="static_excess",
                    neutral=None,
                    lower=0.05,
                    upper=3.0,
                    typical=0.5,
                    source="assumed: 1.5 times as much at rest (Canudas de Wit et al. 1995 simulate 1.5)",
                ),
                EffectParameter(
                    key=speed_key,
                    neutral=None,
                    lower=0.05 * speed_size,
                    upper=20.0 * speed_size,
                    typical=speed_size,
                    source=source,
                ),
            ),
            _make_joint_form(
                "presliding",
                "M = -(M_c/d) z, dz/dt = w (1 - z sign(w)/d)",
                add_presliding_friction,
                moment,
                EffectParameter(
                    key=presliding_key,
                    neutral=None,
                    lower=0.05 * presliding_size,
                    upper=20.0 * presliding_size,
                    typical=presliding_size,
                    source="assumed: seals and grease yield over a degree or a millimetre",
                ),
            ),
        ),
    )


JOINT_FRICTION = _make_friction(
    "joint_friction",
    "A hinge joint has dry friction, with or without a presliding displacement, or viscous friction.",
    "hinge joint",
    ("moment_n_m", "damping_n_m_s", "stribeck_velocity_deg_per_s", "presliding_deg"),
    (0.1, 0.1, 10.0, 1.0, 20.0, 20.0),
    add_falling_friction,
)
GUIDE_FRICTION = _make_friction(
    "guide_friction",
    "A slide joint has dry friction, with or without a presliding displacement, or viscous friction.",
    "slide joint",
    ("force_n", "damping_n_s_per_m", "stribeck_velocity_mm_per_s", "presliding_mm"),
    (5.0, 20.0, 10.0, 1.0, 1000.0, 5000.0),
    add_falling_guide_friction,
)
JOINT_INERTIA = Effect(
    name="joint_inertia",
    description="A hinge joint carries inertia that the model lacks and that has no weight, such as a wheel.",
    kind="mechanism",
    part="hinge joint",
    forms=(
        _make_joint_form(
            "armature",
            "I = I_0 + inertia",
            add_inertia,
            EffectParameter(
                key="inertia_kg_cm2",
                neutral=0.0,
                lower=0.0,
                upper=1e5,
                typical=50.0,
                source="assumed: a tenth of a forearm of 0.05 kg m2",
            ),
        ),
    ),
)
PULLEY_ERROR = Effect(
    name="pulley_error",
    description=(
        "A pulley has another radius than the model, and cables end on its rim: moment arms and lengths of the cables "
        "differ."
    ),
    kind="mechanism",
    part="pulley",
    forms=(
        EffectForm(
            name="radius",
            equation="r = gain r_0",
            laws={"pulley": scale_radius},
            parameters=(
                EffectParameter(
                    key="gain",
                    neutral=1.0,
                    lower=0.7,
                    upper=1.4,
                    typical=1.05,
                    source="assumed: half the thickness of a cable on a small pulley",
                ),
            ),
        ),
    ),
)
_TILT = EffectParameter(
    key="tilt_deg", neutral=0.0, lower=-45.0, upper=45.0, typical=2.0, source="assumed: a stand on a bench, by eye"
)
GRAVITY_TILT = Effect(
    name="gravity_tilt",
    description="The rig does not stand upright: gravity has another direction than in the model.",
    kind="mechanism",
    part="rig",
    forms=(
        EffectForm(name="about_y", equation="g = R_y(-tilt) g_0", laws={"gravity": tilt_about_y}, parameters=(_TILT,)),
        EffectForm(name="about_x", equation="g = R_x(-tilt) g_0", laws={"gravity": tilt_about_x}, parameters=(_TILT,)),
    ),
)
SENSOR_BACKLASH = Effect(
    name="sensor_backlash",
    description="The sensor of a joint is driven with play, by gears or a coupling: it lags behind by half the play.",
    kind="mechanism",
    part="position channel",
    forms=(
        EffectForm(
            name="play",
            equation="z follows y when |y - z| reaches play/2",
            laws={"reading": apply_backlash},
            parameters=(
                EffectParameter(
                    key="play",
                    neutral=0.0,
                    lower=0.0,
                    upper=np.inf,
                    typical=4.0,
                    source="assumed: magnitude of an inexpensive gear",
                ),
            ),
        ),
    ),
)
