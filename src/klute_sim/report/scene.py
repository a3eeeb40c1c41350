"""The 3-D part of a rerun recording: the rig's bodies, the tendon coloured by its force, the ground reaction.

Poses are not recorded; they follow from the recorded joint angles by the model's own kinematics.
"""

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from klute_sim.recording.recording import Recording
from klute_sim.rigs.gait.body import ANKLE, KEEL

FRAME_RATE = 100.0
"""Poses per second; channels keep every sample."""
TENDON = "world/achilles"
REACTION = "world/ground_reaction"
NEWTONS_PER_METRE = 1500.0
"""Length of the ground reaction's arrow."""
SLACK, TAUT = np.array([150.0, 150.0, 150.0]), np.array([220.0, 30.0, 30.0])
"""Tendon colours at no force and at the recording's peak force, RGB."""

Array = NDArray[np.float64]


def entity(model: mujoco.MjModel, body: int) -> str:
    """Entity path of a body."""
    return f"world/{model.body(body).name}"


def postures(recording: Recording, model: mujoco.MjModel) -> tuple[NDArray[np.int64], Array]:
    """Samples that get a pose, and the joint positions (n, nq) at them."""
    duration = float(np.ptp(recording["time"]))
    every = round((len(recording) - 1) / (FRAME_RATE * duration)) if duration > 0 else 1
    frames = np.arange(0, len(recording), max(1, every))
    joints = {
        "carriage_x": recording["carriage_x"],
        "carriage_z": recording["carriage_z"],
        "thigh": np.radians(recording["thigh_angle"]),
        "knee": np.radians(recording["knee_angle"]),
        ANKLE + "ankle": -np.radians(recording["ankle_angle"]),  # the hinge is plantarflexion positive
        ANKLE + "heel": recording["heel_compression"],
    }
    bends = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, KEEL)
    if bends >= 0:  # as its spring does, without loss: near enough for a picture
        joints[KEEL] = -recording["ankle_moment"] / model.jnt_stiffness[bends]
        joints[ANKLE + "ankle"] = joints[ANKLE + "ankle"] - joints[KEEL]
    positions = np.zeros((len(frames), model.nq))
    for name, values in joints.items():
        positions[:, model.joint(name).qposadr[0]] = values[frames]
    return frames, positions


def log_scene(stream: Any, recording: Recording, model: mujoco.MjModel, timeline: str) -> None:
    """Log geometry once, and body poses, tendon and ground reaction over ``timeline``."""
    import rerun as rr

    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for geom in range(model.ngeom):
        _log_geom(stream, model, geom)

    frames, positions = postures(recording, model)
    data = mujoco.MjData(model)
    translation = np.empty((len(frames), model.nbody, 3))
    rotation = np.empty((len(frames), model.nbody, 4))
    strips = np.empty((len(frames), 2, 3))
    ends = [model.site(ANKLE + name).id for name in ("achilles_origin", "achilles_insertion")]
    for k, position in enumerate(positions):
        data.qpos[:] = position
        mujoco.mj_kinematics(model, data)
        translation[k] = data.xpos
        rotation[k] = data.xquat[:, [1, 2, 3, 0]]  # MuJoCo has w first, rerun last
        strips[k] = data.site_xpos[ends]

    times = [rr.TimeColumn(timeline, duration=recording["time"][frames])]
    for body in range(1, model.nbody):
        columns = rr.Transform3D.columns(translation=translation[:, body], quaternion=rotation[:, body])
        stream.send_columns(entity(model, body), indexes=times, columns=columns)
    stream.log(TENDON, rr.LineStrips3D.from_fields(radii=0.005), static=True)
    columns = rr.LineStrips3D.columns(strips=list(strips), colors=tendon_colours(recording["force"])[frames])
    stream.send_columns(TENDON, indexes=times, columns=columns)
    if "cop_x" in recording:
        _log_reaction(stream, recording, frames, times)


def tendon_colours(force: Array) -> NDArray[np.uint8]:
    """(n, 3) RGB: grey without force, red at the peak."""
    share = np.clip(force / max(float(force.max()), 1.0), 0.0, 1.0)[:, None]
    return np.asarray(np.round(SLACK + share * (TAUT - SLACK)), dtype=np.uint8)


def _log_reaction(stream: Any, recording: Recording, frames: NDArray[np.int64], times: list[Any]) -> None:
    import rerun as rr

    loaded = np.isfinite(recording["cop_x"][frames])
    foot = np.where(loaded, recording["cop_x"][frames], 0.0)
    zero = np.zeros(len(frames))
    force = np.column_stack([recording["grf_forward"][frames], zero, recording["grf_vertical"][frames]])
    columns = rr.Arrows3D.columns(
        origins=np.column_stack([foot, zero, zero]),
        vectors=np.where(loaded[:, None], force, 0.0) / NEWTONS_PER_METRE,
    )
    stream.log(REACTION, rr.Arrows3D.from_fields(colors=[40, 110, 220], radii=0.008), static=True)
    stream.send_columns(REACTION, indexes=times, columns=columns)


def _log_geom(stream: Any, model: mujoco.MjModel, geom: int) -> None:
    import rerun as rr

    kind, size, colour = model.geom_type[geom], model.geom_size[geom], model.geom_rgba[geom]
    kinds = mujoco.mjtGeom
    place = rr.Transform3D(translation=model.geom_pos[geom], quaternion=model.geom_quat[geom][[1, 2, 3, 0]])
    shape: Any
    if kind == kinds.mjGEOM_PLANE:
        half = [size[0], size[1], 1e-3]
        shape = rr.Boxes3D(half_sizes=[half], centers=[[0.5 * size[0], 0, -1e-3]], colors=[colour], fill_mode="solid")
    elif kind == kinds.mjGEOM_SPHERE:
        shape = rr.Ellipsoids3D(half_sizes=[[size[0]] * 3], colors=[colour], fill_mode="solid")
    elif kind == kinds.mjGEOM_CAPSULE:
        # rerun's capsule starts at its origin, MuJoCo's is centred
        length = 2.0 * size[1]
        shape = rr.Capsules3D(
            lengths=[length], radii=[size[0]], translations=[[0, 0, -size[1]]], colors=[colour], fill_mode="solid"
        )
    elif kind == kinds.mjGEOM_BOX:
        shape = rr.Boxes3D(half_sizes=[size], colors=[colour], fill_mode="solid")
    else:
        return  # the rigs have no other shapes
    name = model.geom(geom).name or str(geom)
    body = int(model.geom_bodyid[geom])
    path = f"world/{name}" if body == 0 else f"{entity(model, body)}/{name}"
    stream.log(path, place, shape, static=True)
