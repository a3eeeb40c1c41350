"""Paths of the tendons of a model: how long they are between the stops of the joints, and which joints change them."""

from collections.abc import Sequence

import mujoco
import numpy as np

from klute_sim.datasets.mechanism_channels import normalize_name
from klute_sim.types import Array

N_PATH_POSITIONS = 9
"""Number of positions between the stops at which the paths of tendons are measured."""
MAX_FREE_POSITION = 1.0
"""Position [rad or m] up to which a joint without stops is moved, in both directions (assumed)."""
MIN_PATH_CHANGE = 1e-6
"""Smallest change [m] of the path of a tendon that a joint moves (assumed)."""


def list_stops(model: mujoco.MjModel) -> dict[str, tuple[float, float]]:
    """Return channel -> stops [rad or m] of each joint with stops."""
    return {
        channel: (float(model.jnt_range[index, 0]), float(model.jnt_range[index, 1]))
        for index in _list_scalar_joints(model)
        for channel in _list_channels(model, index)
        if model.jnt_limited[index]
    }


def measure_paths(model: mujoco.MjModel, tendons: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Return tendon -> its shortest and its longest path [m] while all joints go from one stop to the other."""
    lengths = measure_lengths(model, list_poses(model))
    paths = {tendon: lengths[:, model.tendon(tendon).id] for tendon in tendons}
    return {tendon: (float(path.min()), float(path.max())) for tendon, path in paths.items()}


def list_poses(model: mujoco.MjModel) -> Array:
    """Return positions of all joints, one pose per row, while all joints go from one stop to the other."""
    return _build_poses(model, [index for index in _list_scalar_joints(model) if model.jnt_limited[index]])


def measure_lengths(model: mujoco.MjModel, poses: Array) -> Array:
    """Return the length [m] of every tendon in each of the ``poses``; NaN where a position is."""
    data = mujoco.MjData(model)
    lengths = np.full((len(poses), model.ntendon), np.nan)
    for index in np.flatnonzero(np.isfinite(poses).all(axis=1)):
        data.qpos[:] = poses[index]
        mujoco.mj_fwdPosition(model, data)
        lengths[index] = data.ten_length
    return lengths


def find_moved_tendons(model: mujoco.MjModel) -> dict[str, frozenset[str]]:
    """Return channel of each joint -> tendons whose paths change while this joint moves alone."""
    moved: dict[str, frozenset[str]] = {}
    for index in _list_scalar_joints(model):
        changes = np.ptp(measure_lengths(model, _build_poses(model, [index])), axis=0)
        names = frozenset(model.tendon(int(tendon_id)).name for tendon_id in np.flatnonzero(changes > MIN_PATH_CHANGE))
        moved |= dict.fromkeys(_list_channels(model, index), names)
    return moved


def _list_scalar_joints(model: mujoco.MjModel) -> list[int]:
    """Return the indices of the hinges and slides."""
    scalar = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
    return [index for index in range(model.njnt) if int(model.jnt_type[index]) in scalar]


def _list_channels(model: mujoco.MjModel, index: int) -> list[str]:
    return [f"{quantity}_{normalize_name(model.joint(index).name)}" for quantity in ("angle", "position")]


def _list_positions(model: mujoco.MjModel, index: int) -> Array:
    low, high = model.jnt_range[index] if model.jnt_limited[index] else (-MAX_FREE_POSITION, MAX_FREE_POSITION)
    return np.linspace(float(low), float(high), N_PATH_POSITIONS)


def _build_poses(model: mujoco.MjModel, joints: Sequence[int]) -> Array:
    """Return poses in which ``joints`` move and all others stay."""
    poses = np.tile(model.qpos0, (N_PATH_POSITIONS, 1))
    for index in joints:
        poses[:, model.jnt_qposadr[index]] = _list_positions(model, index)
    return poses
