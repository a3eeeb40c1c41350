"""The foot and ankle of the MJCF as the numbers that a replay needs."""

import mujoco
import numpy as np

from klute_sim.device.files import Device
from klute_sim.laws.foot import Foot
from klute_sim.rigs.gait.build import ANKLE, MODEL_MASS, MODEL_STATURE, build

STEP = 5e-4
"""Of the model that the numbers are read from [s]; none depends on it."""


def foot_of(device: Device) -> Foot:
    """The foot that ``device`` is built onto; raises InputError for a device that does not fit.

    The tendon's origin is put where the gait rig puts it: with the muscle at its mounting length at a neutral ankle.
    """
    return read(build(device, mass=MODEL_MASS, stature=MODEL_STATURE, step=STEP))


def read(model: mujoco.MjModel) -> Foot:
    """Of a model with ``ankle.xml`` in it, under the gait rig's prefix.

    The heel's spring is taken to be rigid: it gives 3 mm under 1 kN, and what that shifts is in the measured centre of
    pressure already.
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
        stop_time=float(time),
        stop_least=float(least),
        stop_most=float(most),
        stop_width=float(width),
    )
