"""Effects of the body, put into the MJCF in other ways than the package's.

Where the package hangs a foot that bends on the ankle's lever, here the lever hangs on the foot. For the rest there is
one word of MuJoCo's each.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import mujoco
import numpy as np

Own = Mapping[str, float]
Edit = Callable[[mujoco.MjSpec, Own], None]
HARD = (5e-4, 1.0), (0.99, 0.9995, 0.001, 0.5, 2.0)
"""solref and solimp of friction."""
RING = 5e-4
"""Time constant that a foot which bends has by itself [s]."""
ROCKER = 0.25
"""Share of the foot's mass that is the rocker's."""


def _joint(spec: mujoco.MjSpec) -> mujoco.MjsJoint:
    return spec.joint("prosthesis_ankle")


def _rub(spec: mujoco.MjSpec, own: Own) -> None:
    joint = _joint(spec)
    joint.frictionloss = own["moment_n_m"]
    joint.solref_friction, joint.solimp_friction = HARD


def _damp(spec: mujoco.MjSpec, own: Own) -> None:
    _joint(spec).damping = np.array([_joint(spec).damping[0] + own["damping_n_m_s"], 0.0, 0.0])


def _stiffen(spec: mujoco.MjSpec, own: Own) -> None:
    _joint(spec).stiffness = np.array([_joint(spec).stiffness[0] * own["gain"], 0.0, 0.0])


def _shift(spec: mujoco.MjSpec, own: Own) -> None:
    _joint(spec).springref = _joint(spec).springref - np.radians(own["shift_deg"])


def _bump(spec: mujoco.MjSpec, own: Own) -> None:
    tendon = spec.add_tendon(name="rubber")
    tendon.wrap_joint("prosthesis_ankle", -1.0)
    tendon.stiffness = np.array([np.degrees(own["stiffness_n_m_per_deg"]), 0.0, 0.0])
    tendon.springlength = np.array([-1e3, np.radians(own["begin_deg"])])


def _lever(spec: mujoco.MjSpec, own: Own) -> None:
    site = spec.site("prosthesis_achilles_insertion")
    site.pos = own["gain"] * np.asarray(site.pos)


def _load(spec: mujoco.MjSpec, own: Own) -> None:
    for name in ("prosthesis_foot", "prosthesis_heel"):
        body = spec.body(name)
        body.mass, body.inertia = own["gain"] * body.mass, own["gain"] * np.asarray(body.inertia)


def _bend(spec: mujoco.MjSpec, own: Own) -> None:
    """The foot hangs on the ankle; a rocker, which the tendon pulls, hangs on the foot by a torsion spring.

    Return spring and stops are a fixed tendon's, between rocker and pylon.
    """
    foot, ankle = spec.body("prosthesis_foot"), _joint(spec)
    mass, inertia = np.array(foot.mass), np.array(foot.inertia)
    rocker = foot.add_body(
        name="rocker", ipos=foot.ipos, mass=ROCKER * mass, inertia=ROCKER * inertia, explicitinertial=True
    )
    foot.mass, foot.inertia = (1.0 - ROCKER) * mass, (1.0 - ROCKER) * inertia
    stiffness = 1.0 / np.radians(own["compliance_deg_per_n_m"])
    leaf = rocker.add_joint(name="leaf", type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 1, 0))
    leaf.stiffness = np.array([stiffness, 0.0, 0.0])
    leaf.damping = np.array([stiffness * own.get("time_constant_s", RING), 0.0, 0.0])
    leaf.frictionloss = own.get("moment_n_m", 0.0)
    leaf.solref_friction, leaf.solimp_friction = HARD
    hinge = spec.add_tendon(name="hinge", springlength=(ankle.springref, ankle.springref))
    for name in ("prosthesis_ankle", "leaf"):
        hinge.wrap_joint(name, 1.0)
    for key in ("stiffness", "damping", "range", "solref_limit"):
        setattr(hinge, key, np.array(getattr(ankle, key)))
    ankle.stiffness, ankle.damping, ankle.range = np.zeros(3), np.zeros(3), (-1.0, 1.0)
    was = spec.site("prosthesis_achilles_insertion")
    was.name = "unused"
    rocker.add_site(name="prosthesis_achilles_insertion", pos=np.array(was.pos))


def _sink(spec: mujoco.MjSpec, own: Own) -> None:
    """Between limb and pylon, with a tenth of critical damping for 2 kg."""
    stump = spec.body("prosthesis_pylon").add_joint(name="stump", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0, 0, 1))
    stiffness = 1e6 / own["compliance_mm_per_kn"]
    stump.stiffness, stump.damping = np.array([stiffness, 0, 0]), np.array([0.2 * np.sqrt(2.0 * stiffness), 0, 0])


EDITS: Mapping[tuple[str, str], Edit] = {
    ("ankle_friction", "coulomb"): _rub,
    ("ankle_friction", "viscous"): _damp,
    ("return_spring_error", "stiffness"): _stiffen,
    ("return_spring_error", "rest"): _shift,
    ("end_stop", "bumper"): _bump,
    ("moment_arm_error", "insertion"): _lever,
    ("inertia_error", "mass"): _load,
    ("foot_stiffness", "linear"): _bend,
    ("foot_hysteresis", "viscous"): _bend,
    ("foot_hysteresis", "coulomb"): _bend,
    ("socket_pistoning", "axial"): _sink,
}


def edit(effects: Sequence[Mapping[str, Any]]) -> Callable[[mujoco.MjSpec], None]:
    """What puts all of ``effects`` that are of the body into a model."""
    own = [partial(EDITS[key], own=e["parameters"]) for e in effects if (key := (e["name"], e["form"])) in EDITS]

    def every(spec: mujoco.MjSpec) -> None:
        for each in own:
            each(spec)

    return every
