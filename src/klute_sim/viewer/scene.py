"""3-D scene of a recording: bodies of the rig, muscle and tendon coloured by their state, and ground reaction.

Body poses are computed from the recorded joint angles by the kinematics of the model.
"""

from collections.abc import Collection, Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from klute_sim.gait.body import KEEL_JOINT, PROSTHESIS_PREFIX
from klute_sim.plant.models import N_VISIBLE_GROUPS, REST_GROUP
from klute_sim.recording.recording import Recording
from klute_sim.types import Array

FRAME_RATE_HZ = 100.0
"""Number of poses per second; channels keep all samples."""
WORLD_ENTITY = "world"
"""Default root entity of the scene."""
TENDON_ENTITY, MUSCLE_ENTITY, GROUND_REACTION_ENTITY = "achilles", "muscle", "ground_reaction"
"""Entities under the root."""
ARROW_SCALE_N_PER_M = 1500.0
"""Scale of the arrow of the ground reaction [N/m]."""
UNIT_SITES = tuple(PROSTHESIS_PREFIX + name for name in ("achilles_origin", "achilles_insertion"))
"""Sites of the ends of the muscle-tendon unit."""
SLACK_COLOUR, TAUT_COLOUR = np.array([150.0, 150.0, 150.0]), np.array([220.0, 30.0, 30.0])
"""Tendon colours at no force and at the recording's peak force, RGB."""
EMPTY_COLOUR, FULL_COLOUR = np.array([70.0, 90.0, 70.0]), np.array([60.0, 230.0, 90.0])
"""Muscle colours without pressure and at the recording's peak pressure, RGB."""


def format_body_entity(model: mujoco.MjModel, body: int, root: str = WORLD_ENTITY) -> str:
    """Return the entity path of a body."""
    return f"{root}/{model.body(body).name}"


def build_view(
    name: str, root: str = WORLD_ENTITY, *, origin: str = "carriage", height: float = -0.45, distance: float = 2.1
) -> Any:
    """Build the side view of what :func:`log_scene` logged, from a ``distance`` [m].

    The camera moves with the body ``origin`` and looks at the point ``height`` [m] above it.
    """
    import rerun.blueprint as rrb

    eye = rrb.EyeControls3D(
        position=[0.17 * distance, -distance, height + 0.1 * distance],
        look_target=[0.0, 0.0, height],
        eye_up=[0.0, 0.0, 1.0],
    )
    return rrb.Spatial3DView(origin=f"{root}/{origin}", contents=f"{root}/**", name=name, eye_controls=eye)


def select_frames(recording: Recording) -> NDArray[np.int64]:
    """Return the samples with a pose on a timeline of durations."""
    duration = float(np.ptp(recording["time"]))
    interval = round((len(recording) - 1) / (FRAME_RATE_HZ * duration)) if duration > 0 else 1
    return np.arange(0, len(recording), max(1, interval))


def compute_postures(recording: Recording, model: mujoco.MjModel, frames: NDArray[np.int64]) -> Array:
    """Return the joint positions (n, nq) at the samples ``frames``."""
    alignment = recording.provenance.get("options", {}).get("alignment_deg", 0.0)
    joints = {
        "carriage_x": recording["carriage_x"],
        "carriage_z": recording["carriage_z"],
        "thigh": np.radians(recording["thigh_angle"]),
        "knee": np.radians(recording["knee_angle"]),
        PROSTHESIS_PREFIX + "ankle": np.radians(alignment - recording["ankle_angle"]),  # the hinge: plantarflexion
        PROSTHESIS_PREFIX + "heel": recording["heel_compression"],
    }
    if "liner_displacement" in recording:
        joints["liner"] = recording["liner_displacement"]
    keel_joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, KEEL_JOINT)
    if keel_joint >= 0 and "ankle_moment" in recording:  # its spring without damping: accurate enough for a picture
        joints[KEEL_JOINT] = -recording["ankle_moment"] / model.jnt_stiffness[keel_joint]
        joints[PROSTHESIS_PREFIX + "ankle"] = joints[PROSTHESIS_PREFIX + "ankle"] - joints[KEEL_JOINT]
    positions = np.zeros((len(frames), model.nq))
    for name, values in joints.items():
        positions[:, model.joint(name).qposadr[0]] = values[frames]
    return positions


def log_scene(
    stream: Any,
    recording: Recording,
    model: mujoco.MjModel,
    timeline: str,
    *,
    root: str = WORLD_ENTITY,
    hidden: Collection[str] = (),
) -> None:
    """Log the geometry of ``model``, and its motion (:func:`log_motion`) over ``timeline`` [s], under ``root``.

    Bodies in ``hidden`` are omitted.
    """
    import rerun as rr

    log_geometry(stream, model, root, hidden=hidden, omits_muscle_at_rest=has_muscle(recording))
    frames = select_frames(recording)
    log_motion(stream, recording, model, frames, rr.TimeColumn(timeline, duration=recording["time"][frames]), root)


def log_motion(
    stream: Any,
    recording: Recording,
    model: mujoco.MjModel,
    frames: NDArray[np.int64],
    axis: Any,
    root: str = WORLD_ENTITY,
) -> None:
    """Log body poses, muscle, tendon and ground reaction at the samples ``frames``, the rows of ``axis``.

    Everything whose channel (force, pressure, muscle length, centre of pressure) is missing is omitted.
    """
    ends = log_poses(stream, model, compute_postures(recording, model, frames), axis, root, sites=UNIT_SITES)
    log_unit(stream, recording, frames, axis, ends, root)
    if "cop_x" in recording:
        _log_ground_reaction(stream, recording, frames, axis, root)


def has_muscle(recording: Recording) -> bool:
    """Return whether ``recording`` has the state of the muscle."""
    return "muscle_length" in recording and "pressure" in recording


def log_geometry(
    stream: Any,
    model: mujoco.MjModel,
    root: str,
    *,
    hidden: Collection[str] = (),
    omits_muscle_at_rest: bool = False,
) -> None:
    """Log the geometry of ``model``, without bodies in ``hidden`` and geoms that MuJoCo's viewer hides."""
    import rerun as rr

    stream.log(root, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for geom in range(model.ngeom):
        is_shown = model.geom_group[geom] < N_VISIBLE_GROUPS
        is_shown &= not (omits_muscle_at_rest and model.geom_group[geom] == REST_GROUP)
        if is_shown and model.body(int(model.geom_bodyid[geom])).name not in hidden:
            _log_geom(stream, model, geom, root)


def log_poses(
    stream: Any, model: mujoco.MjModel, positions: Array, axis: Any, root: str, *, sites: Sequence[str] = ()
) -> Array:
    """Log the body poses of ``model`` at joint ``positions`` (n, nq), the rows of ``axis`` (a rerun TimeColumn).

    Returns the positions (n, len(sites), 3) of ``sites``.
    """
    import rerun as rr

    data = mujoco.MjData(model)
    translation = np.empty((len(positions), model.nbody, 3))
    rotation = np.empty((len(positions), model.nbody, 4))
    site_positions = np.empty((len(positions), len(sites), 3))
    site_ids = [model.site(name).id for name in sites]
    for k, position in enumerate(positions):
        data.qpos[:] = position
        mujoco.mj_kinematics(model, data)
        translation[k] = data.xpos
        rotation[k] = data.xquat[:, [1, 2, 3, 0]]  # MuJoCo has w first, rerun last
        site_positions[k] = data.site_xpos[site_ids]
    for body in range(1, model.nbody):
        columns = rr.Transform3D.columns(translation=translation[:, body], quaternion=rotation[:, body])
        stream.send_columns(format_body_entity(model, body, root), indexes=[axis], columns=columns)
    return site_positions


def log_unit(stream: Any, recording: Recording, frames: NDArray[np.int64], axis: Any, ends: Array, root: str) -> None:
    """Log muscle and tendon between the ``ends`` (frames, 2, 3) of the unit; the tendon only without muscle length."""
    import rerun as rr

    begin = ends[:, 0]
    if has_muscle(recording):
        unit_length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        fraction = np.clip(recording["muscle_length"][frames] / unit_length, 0.0, 1.0)[:, None]
        begin = ends[:, 0] + fraction * (ends[:, 1] - ends[:, 0])
        stream.log(f"{root}/{MUSCLE_ENTITY}", rr.LineStrips3D.from_fields(radii=0.012), static=True)
        strips = rr.LineStrips3D.columns(
            strips=list(np.stack([ends[:, 0], begin], axis=1)),
            colors=interpolate_colours(recording["pressure"], EMPTY_COLOUR, FULL_COLOUR)[frames],
        )
        stream.send_columns(f"{root}/{MUSCLE_ENTITY}", indexes=[axis], columns=strips)
    stream.log(f"{root}/{TENDON_ENTITY}", rr.LineStrips3D.from_fields(radii=0.005), static=True)
    force = recording["force"] if "force" in recording else np.zeros(len(recording))
    strips = rr.LineStrips3D.columns(
        strips=list(np.stack([begin, ends[:, 1]], axis=1)),
        colors=interpolate_colours(force, SLACK_COLOUR, TAUT_COLOUR)[frames],
    )
    stream.send_columns(f"{root}/{TENDON_ENTITY}", indexes=[axis], columns=strips)


def interpolate_colours(values: Array, zero_colour: Array, peak_colour: Array) -> NDArray[np.uint8]:
    """Return colours (n, 3) RGB, interpolated from ``zero_colour`` at 0 to ``peak_colour`` at the maximum."""
    fraction = np.clip(np.nan_to_num(values) / max(float(np.nanmax(values)), 1e-9), 0.0, 1.0)[:, None]
    return np.asarray(np.round(zero_colour + fraction * (peak_colour - zero_colour)), dtype=np.uint8)


def _log_ground_reaction(stream: Any, recording: Recording, frames: NDArray[np.int64], axis: Any, root: str) -> None:
    import rerun as rr

    is_loaded = np.isfinite(recording["cop_x"][frames])
    cop_x = np.where(is_loaded, recording["cop_x"][frames], 0.0)
    zero = np.zeros(len(frames))
    force = np.column_stack([recording["grf_forward"][frames], zero, recording["grf_vertical"][frames]])
    columns = rr.Arrows3D.columns(
        origins=np.column_stack([cop_x, zero, zero]),
        vectors=np.where(is_loaded[:, None], force, 0.0) / ARROW_SCALE_N_PER_M,
    )
    stream.log(
        f"{root}/{GROUND_REACTION_ENTITY}", rr.Arrows3D.from_fields(colors=[40, 110, 220], radii=0.008), static=True
    )
    stream.send_columns(f"{root}/{GROUND_REACTION_ENTITY}", indexes=[axis], columns=columns)


def _log_geom(stream: Any, model: mujoco.MjModel, geom: int, root: str) -> None:
    import rerun as rr

    kind, size, colour = model.geom_type[geom], model.geom_size[geom], model.geom_rgba[geom]
    kinds = mujoco.mjtGeom
    pose = rr.Transform3D(translation=model.geom_pos[geom], quaternion=model.geom_quat[geom][[1, 2, 3, 0]])
    shape: Any
    if kind == kinds.mjGEOM_PLANE:
        half = [size[0], size[1], 1e-3]
        shape = rr.Boxes3D(half_sizes=[half], centers=[[0.5 * size[0], 0, -1e-3]], colors=[colour], fill_mode="solid")
    elif kind == kinds.mjGEOM_SPHERE:
        shape = rr.Ellipsoids3D(half_sizes=[[size[0]] * 3], colors=[colour], fill_mode="solid")
    elif kind == kinds.mjGEOM_ELLIPSOID:
        shape = rr.Ellipsoids3D(half_sizes=[size], colors=[colour], fill_mode="solid")
    elif kind == kinds.mjGEOM_CAPSULE:
        # A capsule of rerun starts at its origin, one of MuJoCo is centred.
        length = 2.0 * size[1]
        shape = rr.Capsules3D(
            lengths=[length], radii=[size[0]], translations=[[0, 0, -size[1]]], colors=[colour], fill_mode="solid"
        )
    elif kind == kinds.mjGEOM_CYLINDER:
        shape = rr.Cylinders3D(lengths=[2.0 * size[1]], radii=[size[0]], colors=[colour], fill_mode="solid")
    elif kind == kinds.mjGEOM_BOX:
        shape = rr.Boxes3D(half_sizes=[size], colors=[colour], fill_mode="solid")
    else:
        return  # the rigs have no other shapes
    name = model.geom(geom).name or f"geom_{geom}"
    body = int(model.geom_bodyid[geom])
    path = f"{root}/{name}" if body == 0 else f"{format_body_entity(model, body, root)}/{name}"
    stream.log(path, pose, shape, static=True)
