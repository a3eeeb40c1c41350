"""Foot and ankle of the MJCF as numbers, and numbers put into the MJCF."""

import math

import mujoco
import numpy as np

from klute_sim.laws.foot import Foot

ANKLE = "prosthesis_"
"""Prefix of everything that comes from ankle.xml."""
STICKING = (0.002, 1.0), (0.99, 0.999, 0.001, 0.5, 2.0)
"""solref and solimp of friction in MuJoCo: as hard as a step of 1 ms allows, because the soft default creeps."""


BUMPER, FREE = "bumper", 1e3
"""Name of a bumper's tendon, and an ankle angle that is never reached [rad]."""
KEEL, SOCKET = ANKLE + "keel", ANKLE + "socket"
"""Joints of a foot that bends, and of a limb that sinks into its socket; models without have neither."""
COPY = "_bent"
"""At the end of names of what is copied, until its original is gone."""
HINGE_SHARE = 0.3
"""Of the mass of a foot that bends, what stays with the hinge (assumed): MuJoCo gives no moment to what has no mass."""
SUNK = 3e-3
"""Time constant of a socket [s] (assumed): a tenth of what it takes 2 kg to swing on 100 N/mm."""


def read(model: mujoco.MjModel) -> Foot:
    """Of a model with ``ankle.xml`` in it, under the prefix :data:`ANKLE`.

    The heel's spring is taken to be rigid: it gives 3 mm under 1 kN, and what that shifts is in a measured centre of
    pressure already. What makes a socket come to rest is left out, too.
    """
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    joint, foot = model.joint(ANKLE + "ankle"), model.body(ANKLE + "foot").id
    dof, number = int(joint.dofadr[0]), int(joint.id)
    whole = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, whole)
    ankle = data.xanchor[number]
    centre = data.subtree_com[foot] - ankle
    origin, insertion = (data.site(ANKLE + name).xpos - ankle for name in ("achilles_origin", "achilles_insertion"))
    time, _ = model.jnt_solref[number]
    least, most, width = model.jnt_solimp[number][:3]
    lowest, highest = model.jnt_range[number]
    bumper = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TENDON, BUMPER)
    keel, socket = (mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in (KEEL, SOCKET))
    bent = int(model.jnt_dofadr[keel])
    keel_stiffness = math.inf if keel < 0 else float(model.jnt_stiffness[keel])
    return Foot(
        inertia=float(whole[dof, dof]),
        mass=float(model.body_subtreemass[foot]),
        centre_x=float(centre[0]),
        centre_z=float(centre[2]),
        origin_x=float(origin[0]),
        origin_z=float(origin[2]),
        insertion_x=float(insertion[0]),
        insertion_z=float(insertion[2]),
        stiffness=float(model.jnt_stiffness[number]),
        rest=float(model.qpos_spring[int(joint.qposadr[0])]),
        damping=float(model.dof_damping[dof]),
        friction=float(model.dof_frictionloss[dof]),
        lowest=float(lowest),
        highest=float(highest),
        bumper=0.0 if bumper < 0 else float(model.tendon_stiffness[bumper]),
        bumper_at=0.0 if bumper < 0 else float(model.tendon_lengthspring[bumper, 1]),
        stop_time=float(time),
        stop_least=float(least),
        stop_most=float(most),
        stop_width=float(width),
        keel=1.0 / keel_stiffness,
        keel_time=0.0 if keel < 0 else float(model.dof_damping[bent]) / keel_stiffness,
        keel_held=0.0 if keel < 0 else float(model.dof_frictionloss[bent]) / keel_stiffness,
        socket=0.0 if socket < 0 else 1.0 / float(model.jnt_stiffness[socket]),
        carried=float(model.body_subtreemass[model.body(ANKLE + "pylon").id]),
    )


def into(spec: mujoco.MjSpec, was: Foot, foot: Foot) -> None:
    """Make the foot of ``spec``, which is what it ``was``, into ``foot``; what is equal is not touched.

    A bumper is a fixed tendon whose spring is slack up to where it begins. A foot that bends is two bodies, with a
    second hinge on the ankle's axis between them. Centre of mass, origin and stops stay.
    """
    joint = spec.joint(ANKLE + "ankle")
    if foot.stiffness != was.stiffness:
        joint.stiffness = np.array([foot.stiffness, 0.0, 0.0])  # a polynomial's terms
    if foot.rest != was.rest:
        joint.springref = foot.rest
    if foot.damping != was.damping:
        joint.damping = np.array([foot.damping, 0.0, 0.0])
    if foot.friction != was.friction:
        joint.frictionloss = foot.friction
        joint.solref_friction, joint.solimp_friction = STICKING
    insertion = spec.site(ANKLE + "achilles_insertion")
    if (foot.insertion_x, foot.insertion_z) != (was.insertion_x, was.insertion_z):
        insertion.pos = np.array([foot.insertion_x, insertion.pos[1], foot.insertion_z])
    if foot.mass != was.mass:
        for name in ("foot", "heel"):
            body = spec.body(ANKLE + name)
            body.mass *= foot.mass / was.mass
            body.inertia = np.asarray(body.inertia) * (foot.mass / was.mass)
    if foot.bumper != was.bumper:
        tendon = spec.add_tendon(name=BUMPER)
        tendon.wrap_joint(ANKLE + "ankle", -1.0)
        tendon.stiffness = np.array([foot.bumper, 0.0, 0.0])
        tendon.springlength = np.array([-FREE, foot.bumper_at])
    if foot.keel != was.keel:
        _bend(spec, foot)
    if foot.socket != was.socket:
        stiffness = 1.0 / foot.socket
        slide, along = mujoco.mjtJoint.mjJNT_SLIDE, (0, 0, 1)
        socket = spec.body(ANKLE + "pylon").add_joint(name=SOCKET, type=slide, axis=along)
        socket.stiffness, socket.damping = np.array([stiffness, 0.0, 0.0]), np.array([SUNK * stiffness, 0.0, 0.0])


def _bend(spec: mujoco.MjSpec, foot: Foot) -> None:
    """Let all of the foot but its lever turn about the ankle against a spring."""
    hinge, stiffness = spec.body(ANKLE + "foot"), 1.0 / foot.keel
    keel = hinge.add_body(name=KEEL, ipos=hinge.ipos, iquat=hinge.iquat, explicitinertial=True)
    spec.copy_during_attach = True
    keel.attach_frame(spec.frame(KEEL), "", COPY)
    for own in (spec.body(ANKLE + "heel"), *(geom for geom in hinge.geoms if geom.frame == spec.frame(KEEL))):
        spec.delete(own)
    for body in (keel, *keel.bodies):
        for own in (*keel.bodies, *body.joints, *body.geoms):
            own.name = own.name.removesuffix(COPY)
    for body, share in ((keel, 1.0 - HINGE_SHARE), (hinge, HINGE_SHARE)):
        body.mass, body.inertia = share * hinge.mass, share * np.asarray(hinge.inertia)
    joint = keel.add_joint(name=KEEL, type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 1, 0))
    joint.stiffness, joint.damping = np.array([stiffness, 0.0, 0.0]), np.array([foot.keel_time * stiffness, 0.0, 0.0])
    joint.frictionloss = foot.keel_held * stiffness
    joint.solref_friction, joint.solimp_friction = STICKING
