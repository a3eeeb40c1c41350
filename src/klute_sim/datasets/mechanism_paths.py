"""Paths of the tendons of a model: how long they are between the stops of the joints, and which joints change them."""

from collections.abc import Mapping, Sequence

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
    limited = [index for index in _list_scalar_joints(model) if model.jnt_limited[index]]
    lengths = _measure_lengths(model, {index: _list_positions(model, index) for index in limited})
    paths = {tendon: lengths[:, model.tendon(tendon).id] for tendon in tendons}
    return {tendon: (float(path.min()), float(path.max())) for tendon, path in paths.items()}


def find_moved_tendons(model: mujoco.MjModel) -> dict[str, frozenset[str]]:
    """Return channel of each joint -> tendons whose paths change while this joint moves alone."""
    moved: dict[str, frozenset[str]] = {}
    for index in _list_scalar_joints(model):
        changes = np.ptp(_measure_lengths(model, {index: _list_positions(model, index)}), axis=0)
        names = frozenset(model.tendon(int(each)).name for each in np.flatnonzero(changes > MIN_PATH_CHANGE))
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


def _measure_lengths(model: mujoco.MjModel, positions: Mapping[int, Array]) -> Array:
    """Return the length [m] of every tendon at each of the ``positions`` (index of a joint -> its positions)."""
    data = mujoco.MjData(model)
    lengths = []
    for number in range(N_PATH_POSITIONS):
        for index, values in positions.items():
            data.qpos[model.jnt_qposadr[index]] = values[number]
        mujoco.mj_fwdPosition(model, data)
        lengths.append(data.ten_length.copy())
    return np.array(lengths)
