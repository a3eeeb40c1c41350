"""Read the foot and the ankle of an MJCF model as numbers, and write changed numbers into the model."""

import math

import mujoco
import numpy as np

from klute_sim.errors import InputError
from klute_sim.laws.foot import Foot

PROSTHESIS_PREFIX = "prosthesis_"
"""Prefix of all names from ankle.xml."""
FRICTION_SOLREF_SOLIMP = (0.002, 1.0), (0.99, 0.999, 0.001, 0.5, 2.0)
"""solref and solimp of friction in MuJoCo: as stiff as a time step of 1 ms allows, because the soft default creeps."""

BUMPER_TENDON = "bumper"
"""Name of the tendon of a bumper."""
UNREACHABLE_ANGLE = 1e3
"""Ankle angle that is never reached [rad]."""
KEEL_JOINT = PROSTHESIS_PREFIX + "keel"
"""Joint of an elastic keel; a model with a rigid keel does not have it."""
SOCKET_JOINT = PROSTHESIS_PREFIX + "socket"
"""Joint of a socket that is elastic along the pylon; a model with a rigid socket does not have it."""
TILT_JOINT = PROSTHESIS_PREFIX + "tilt"
"""Joint of a socket that is elastic in rotation; a model with a rigid socket does not have it."""
UNKNOWN_FIELDS = tuple(name for name in Foot._fields if name.startswith("unknown_"))
"""Coefficients of the data-driven moment, which no MJCF model has."""
COPY_SUFFIX = "_bent"
"""Suffix of copied elements until their originals are deleted."""
HINGE_MASS_FRACTION = 0.3
"""Fraction of the mass of an elastic foot that stays with the hinge (assumed): MuJoCo needs a body with mass."""


def read_foot(model: mujoco.MjModel) -> Foot:
    """Return the foot of a ``model`` that contains ``ankle.xml`` under :data:`PROSTHESIS_PREFIX`.

    The heel spring is assumed rigid: it yields 3 mm under 1 kN, and a measured centre of pressure already contains the
    shift.
    """
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    joint, foot = model.joint(PROSTHESIS_PREFIX + "ankle"), model.body(PROSTHESIS_PREFIX + "foot").id
    dof, joint_id = int(joint.dofadr[0]), int(joint.id)
    mass_matrix = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass_matrix)
    ankle = data.xanchor[joint_id]
    com = data.subtree_com[foot] - ankle
    origin, insertion = (
        data.site(PROSTHESIS_PREFIX + name).xpos - ankle for name in ("achilles_origin", "achilles_insertion")
    )
    time, _ = model.jnt_solref[joint_id]
    min_impedance, max_impedance, width = model.jnt_solimp[joint_id][:3]
    min_angle, max_angle = model.jnt_range[joint_id]
    bumper = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TENDON, BUMPER_TENDON)
    keel, socket, tilt = (
        mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in (KEEL_JOINT, SOCKET_JOINT, TILT_JOINT)
    )
    keel_dof, pylon = int(model.jnt_dofadr[keel]), model.body(PROSTHESIS_PREFIX + "pylon").id
    keel_stiffness = math.inf if keel < 0 else float(model.jnt_stiffness[keel])
    return Foot(
        inertia=float(mass_matrix[dof, dof]),
        mass=float(model.body_subtreemass[foot]),
        com_x=float(com[0]),
        com_z=float(com[2]),
        origin_x=float(origin[0]),
        origin_z=float(origin[2]),
        insertion_x=float(insertion[0]),
        insertion_z=float(insertion[2]),
        spring_stiffness=float(model.jnt_stiffness[joint_id]),
        spring_rest_angle=float(model.qpos_spring[int(joint.qposadr[0])]),
        ankle_damping=float(model.dof_damping[dof]),
        ankle_friction=float(model.dof_frictionloss[dof]),
        min_angle=float(min_angle),
        max_angle=float(max_angle),
        bumper_stiffness=0.0 if bumper < 0 else float(model.tendon_stiffness[bumper]),
        bumper_onset_angle=0.0 if bumper < 0 else float(model.tendon_lengthspring[bumper, 1]),
        stop_time_constant=float(time),
        stop_min_impedance=float(min_impedance),
        stop_max_impedance=float(max_impedance),
        stop_width=float(width),
        keel_compliance=1.0 / keel_stiffness,
        keel_time_constant=0.0 if keel < 0 else float(model.dof_damping[keel_dof]) / keel_stiffness,
        keel_friction_angle=0.0 if keel < 0 else float(model.dof_frictionloss[keel_dof]) / keel_stiffness,
        socket_compliance=_read_compliance(model, socket),
        socket_time_constant=_read_time_constant(model, socket),
        tilt_compliance=_read_compliance(model, tilt),
        tilt_time_constant=_read_time_constant(model, tilt),
        tilt_height=0.0 if tilt < 0 else float(model.jnt_pos[tilt, 2]),
        distal_mass=float(model.body_subtreemass[pylon]),
        distal_com_z=float((data.subtree_com[pylon] - ankle)[2]),
        **dict.fromkeys(UNKNOWN_FIELDS, 0.0),
    )


def _read_compliance(model: mujoco.MjModel, joint: int) -> float:
    """Return the compliance [SI] of the spring of ``joint``; 0 for -1, a joint that the model does not have."""
    return 0.0 if joint < 0 else 1.0 / float(model.jnt_stiffness[joint])


def _read_time_constant(model: mujoco.MjModel, joint: int) -> float:
    """Return the time constant [s] of spring and dashpot of ``joint``; 0 for -1."""
    return 0.0 if joint < 0 else float(model.dof_damping[model.jnt_dofadr[joint]]) / float(model.jnt_stiffness[joint])


def apply_foot(spec: mujoco.MjSpec, original: Foot, foot: Foot) -> None:
    """Change the foot of ``spec`` from ``original`` to ``foot``; equal numbers stay untouched.

    A bumper is a fixed tendon whose spring is slack up to its onset angle. An elastic foot consists of two bodies with
    a second hinge between them on the axis of the ankle. Centre of mass, origin and stops do not change.

    Raises InputError for a foot with a data-driven moment: it depends on the measured load of a walk.
    """
    if any(getattr(foot, name) != getattr(original, name) for name in UNKNOWN_FIELDS):
        raise InputError(
            "[effects.unknown_ankle_moment] represents the data of recorded walks and cannot be simulated in a gait "
            "run; remove this section from the device file"
        )
    joint = spec.joint(PROSTHESIS_PREFIX + "ankle")
    if foot.spring_stiffness != original.spring_stiffness:
        joint.stiffness = np.array([foot.spring_stiffness, 0.0, 0.0])  # coefficients of a polynomial
    if foot.spring_rest_angle != original.spring_rest_angle:
        joint.springref = foot.spring_rest_angle
    if foot.ankle_damping != original.ankle_damping:
        joint.damping = np.array([foot.ankle_damping, 0.0, 0.0])
    if foot.ankle_friction != original.ankle_friction:
        joint.frictionloss = foot.ankle_friction
        joint.solref_friction, joint.solimp_friction = FRICTION_SOLREF_SOLIMP
    insertion = spec.site(PROSTHESIS_PREFIX + "achilles_insertion")
    if (foot.insertion_x, foot.insertion_z) != (original.insertion_x, original.insertion_z):
        insertion.pos = np.array([foot.insertion_x, insertion.pos[1], foot.insertion_z])
    if foot.mass != original.mass:
        for name in ("foot", "heel"):
            body = spec.body(PROSTHESIS_PREFIX + name)
            body.mass *= foot.mass / original.mass
            body.inertia = np.asarray(body.inertia) * (foot.mass / original.mass)
    if foot.bumper_stiffness != original.bumper_stiffness:
        tendon = spec.add_tendon(name=BUMPER_TENDON)
        tendon.wrap_joint(PROSTHESIS_PREFIX + "ankle", -1.0)
        tendon.stiffness = np.array([foot.bumper_stiffness, 0.0, 0.0])
        tendon.springlength = np.array([-UNREACHABLE_ANGLE, foot.bumper_onset_angle])
    if foot.keel_compliance != original.keel_compliance:
        _add_keel_joint(spec, foot)
    pylon = spec.body(PROSTHESIS_PREFIX + "pylon")
    if foot.tilt_compliance != original.tilt_compliance:
        tilt = pylon.add_joint(
            name=TILT_JOINT, type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 1, 0), pos=(0, 0, foot.tilt_height)
        )
        _set_spring(tilt, 1.0 / foot.tilt_compliance, foot.tilt_time_constant)
    if foot.socket_compliance != original.socket_compliance:
        socket = pylon.add_joint(name=SOCKET_JOINT, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0, 0, 1))
        _set_spring(socket, 1.0 / foot.socket_compliance, foot.socket_time_constant)


def _set_spring(joint: mujoco.MjsJoint, stiffness: float, time_constant: float) -> None:
    """Give ``joint`` a spring of ``stiffness`` [SI] and the dashpot with which it has ``time_constant`` [s]."""
    joint.stiffness = np.array([stiffness, 0.0, 0.0])
    joint.damping = np.array([time_constant * stiffness, 0.0, 0.0])


def _add_keel_joint(spec: mujoco.MjSpec, foot: Foot) -> None:
    """Split the foot of ``spec`` into a hinge body and a keel body, which turns about the ankle against a spring."""
    hinge, stiffness = spec.body(PROSTHESIS_PREFIX + "foot"), 1.0 / foot.keel_compliance
    keel = hinge.add_body(name=KEEL_JOINT, ipos=hinge.ipos, iquat=hinge.iquat, explicitinertial=True)
    spec.copy_during_attach = True
    keel.attach_frame(spec.frame(KEEL_JOINT), "", COPY_SUFFIX)
    for original in (
        spec.body(PROSTHESIS_PREFIX + "heel"),
        *(geom for geom in hinge.geoms if geom.frame == spec.frame(KEEL_JOINT)),
    ):
        spec.delete(original)
    for body in (keel, *keel.bodies):
        for element in (*keel.bodies, *body.joints, *body.geoms):
            element.name = element.name.removesuffix(COPY_SUFFIX)
    for body, fraction in ((keel, 1.0 - HINGE_MASS_FRACTION), (hinge, HINGE_MASS_FRACTION)):
        body.mass, body.inertia = fraction * hinge.mass, fraction * np.asarray(hinge.inertia)
    joint = keel.add_joint(name=KEEL_JOINT, type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 1, 0))
    _set_spring(joint, stiffness, foot.keel_time_constant)
    joint.frictionloss = foot.keel_friction_angle * stiffness
    joint.solref_friction, joint.solimp_friction = FRICTION_SOLREF_SOLIMP
