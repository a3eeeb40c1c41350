"""Effects of the body, applied to the MJCF differently from the package.

The package attaches a compliant foot to the lever of the ankle; here the lever is attached to the foot. The package
lets the pylon tilt on the socket; here the socket tilts on the limb. The other effects are single MuJoCo attributes.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import mujoco
import numpy as np

EffectParameters = Mapping[str, float]
SpecEdit = Callable[[mujoco.MjSpec, EffectParameters], None]
FRICTION_SOLVER_PARAMETERS = (5e-4, 1.0), (0.99, 0.9995, 0.001, 0.5, 2.0)
"""MuJoCo's solref and solimp of friction."""
FOOT_TIME_CONSTANT = 5e-4
"""Time constant of a compliant foot [s]."""
ROCKER_MASS_FRACTION = 0.25
"""Fraction of the mass of the foot that is the rocker's."""


def _ankle_joint(spec: mujoco.MjSpec) -> mujoco.MjsJoint:
    return spec.joint("prosthesis_ankle")


def _add_friction(spec: mujoco.MjSpec, parameters: EffectParameters) -> None:
    joint = _ankle_joint(spec)
    joint.frictionloss = parameters["moment_n_m"]
    joint.solref_friction, joint.solimp_friction = FRICTION_SOLVER_PARAMETERS


def _add_damping(spec: mujoco.MjSpec, parameters: EffectParameters) -> None:
    _ankle_joint(spec).damping = np.array([_ankle_joint(spec).damping[0] + parameters["damping_n_m_s"], 0.0, 0.0])


def _scale_return_spring(spec: mujoco.MjSpec, parameters: EffectParameters) -> None:
    _ankle_joint(spec).stiffness = np.array([_ankle_joint(spec).stiffness[0] * parameters["gain"], 0.0, 0.0])


def _shift_return_spring(spec: mujoco.MjSpec, parameters: EffectParameters) -> None:
    _ankle_joint(spec).springref = _ankle_joint(spec).springref - np.radians(parameters["shift_deg"])


def _add_bumper(spec: mujoco.MjSpec, parameters: EffectParameters) -> None:
    tendon = spec.add_tendon(name="rubber")
    tendon.wrap_joint("prosthesis_ankle", -1.0)
    tendon.stiffness = np.array([np.degrees(parameters["stiffness_n_m_per_deg"]), 0.0, 0.0])
    tendon.springlength = np.array([-1e3, np.radians(parameters["begin_deg"])])


def _scale_moment_arm(spec: mujoco.MjSpec, parameters: EffectParameters) -> None:
    site = spec.site("prosthesis_achilles_insertion")
    site.pos = parameters["gain"] * np.asarray(site.pos)


def _scale_foot_inertia(spec: mujoco.MjSpec, parameters: EffectParameters) -> None:
    for name in ("prosthesis_foot", "prosthesis_heel"):
        body = spec.body(name)
        body.mass, body.inertia = parameters["gain"] * body.mass, parameters["gain"] * np.asarray(body.inertia)


def _add_foot_compliance(spec: mujoco.MjSpec, parameters: EffectParameters) -> None:
    """Attach the foot to the ankle, and a rocker, which the tendon pulls, to the foot by a torsion spring.

    Return spring and stops become a fixed tendon between rocker and pylon.
    """
    foot, ankle = spec.body("prosthesis_foot"), _ankle_joint(spec)
    mass, inertia = np.array(foot.mass), np.array(foot.inertia)
    rocker = foot.add_body(
        name="rocker",
        ipos=foot.ipos,
        mass=ROCKER_MASS_FRACTION * mass,
        inertia=ROCKER_MASS_FRACTION * inertia,
        explicitinertial=True,
    )
    foot.mass, foot.inertia = (1.0 - ROCKER_MASS_FRACTION) * mass, (1.0 - ROCKER_MASS_FRACTION) * inertia
    stiffness = 1.0 / np.radians(parameters["compliance_deg_per_n_m"])
    leaf = rocker.add_joint(name="leaf", type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 1, 0))
    leaf.stiffness = np.array([stiffness, 0.0, 0.0])
    leaf.damping = np.array([stiffness * parameters.get("time_constant_s", FOOT_TIME_CONSTANT), 0.0, 0.0])
    leaf.frictionloss = parameters.get("moment_n_m", 0.0)
    leaf.solref_friction, leaf.solimp_friction = FRICTION_SOLVER_PARAMETERS
    hinge = spec.add_tendon(name="hinge", springlength=(ankle.springref, ankle.springref))
    for name in ("prosthesis_ankle", "leaf"):
        hinge.wrap_joint(name, 1.0)
    for key in ("stiffness", "damping", "range", "solref_limit"):
        setattr(hinge, key, np.array(getattr(ankle, key)))
    ankle.stiffness, ankle.damping, ankle.range = np.zeros(3), np.zeros(3), (-1.0, 1.0)
    insertion = spec.site("prosthesis_achilles_insertion")
    insertion.name = "unused"
    rocker.add_site(name="prosthesis_achilles_insertion", pos=np.array(insertion.pos))


def _add_socket_slide(spec: mujoco.MjSpec, parameters: EffectParameters) -> None:
    """Add a slide between limb and pylon; without a time constant it has a tenth of critical damping for 2 kg."""
    stump = spec.body("prosthesis_pylon").add_joint(name="stump", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0, 0, 1))
    stiffness = 1e6 / parameters["compliance_mm_per_kn"]
    light = 0.2 * np.sqrt(2.0 * stiffness)
    damping = parameters["time_constant_s"] * stiffness if "time_constant_s" in parameters else light
    stump.stiffness, stump.damping = np.array([stiffness, 0, 0]), np.array([damping, 0, 0])


def _add_socket_hinge(spec: mujoco.MjSpec, parameters: EffectParameters) -> None:
    """Let the socket, with its liner, turn on the limb; the package turns the pylon on the socket.

    Without a time constant it has a tenth of critical damping for 2 kg at the ankle.
    """
    height = 1e-3 * parameters["height_mm"]
    position = np.asarray(spec.frame("socket_end").pos) + np.array([0.0, 0.0, height])
    rocking = spec.body("socket").add_joint(
        name="rocking", type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 1, 0), pos=position
    )
    stiffness = 1.0 / np.radians(parameters["compliance_deg_per_n_m"])
    light = 0.2 * height * np.sqrt(2.0 * stiffness)
    damping = parameters["time_constant_s"] * stiffness if "time_constant_s" in parameters else light
    rocking.stiffness, rocking.damping = np.array([stiffness, 0, 0]), np.array([damping, 0, 0])


SPEC_EDITS: Mapping[tuple[str, str], SpecEdit] = {
    ("ankle_friction", "coulomb"): _add_friction,
    ("ankle_friction", "viscous"): _add_damping,
    ("return_spring_error", "stiffness"): _scale_return_spring,
    ("return_spring_error", "rest"): _shift_return_spring,
    ("end_stop", "bumper"): _add_bumper,
    ("moment_arm_error", "insertion"): _scale_moment_arm,
    ("inertia_error", "mass"): _scale_foot_inertia,
    ("foot_stiffness", "linear"): _add_foot_compliance,
    ("foot_hysteresis", "viscous"): _add_foot_compliance,
    ("foot_hysteresis", "coulomb"): _add_foot_compliance,
    ("socket_pistoning", "axial"): _add_socket_slide,
    ("socket_pistoning", "damped"): _add_socket_slide,
    ("socket_tilt", "elastic"): _add_socket_hinge,
    ("socket_tilt", "damped"): _add_socket_hinge,
}


def compose_spec_edits(effects: Sequence[Mapping[str, Any]]) -> Callable[[mujoco.MjSpec], None]:
    """Return the function that applies all ``effects`` of the body to a model."""
    edits = [
        partial(SPEC_EDITS[key], parameters=e["parameters"])
        for e in effects
        if (key := (e["name"], e["form"])) in SPEC_EDITS
    ]

    def apply_all(spec: mujoco.MjSpec) -> None:
        for apply_edit in edits:
            apply_edit(spec)

    return apply_all
