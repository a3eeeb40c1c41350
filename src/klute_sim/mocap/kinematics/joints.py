"""Joint centres: from markers on them, or from how two clusters of markers move against each other.

The second is the symmetrical centre of rotation (Ehrig et al. 2006, J. Biomech. 39: 2798-2809): the point that is at
rest in both segments, by least squares over all frames. Of a hinge, any point of its axis will do; taken is the one
nearest to the clusters.
"""

import numpy as np

from klute_sim.recording.recording import Array

MIN_CLUSTER_MARKERS = 3
"""For the pose of a cluster in space."""
MAX_JOINT_RESIDUAL = 0.03
"""Root-mean-square distance [m] of the two segments' centres above which there is no joint."""


def fit_cluster_pose(cluster: Array) -> tuple[Array, Array]:
    """Rotation (n, 3, 3) and centroid (n, 3) of a rigid ``cluster`` (n, markers, 3), against its own mean shape.

    By singular values (Soederkvist & Wedin 1993); frames with a missing marker are NaN.
    """
    centroid = cluster.mean(axis=1)
    offsets = cluster - centroid[:, None]
    whole = np.isfinite(offsets).all(axis=(1, 2))
    rotation = np.full((len(cluster), 3, 3), np.nan)
    first = offsets[whole][len(offsets[whole]) // 2]
    shape = first
    for _ in range(2):  # the second time against the mean shape, which has less noise than any frame
        rotation[whole] = _fit_rotations(shape, offsets[whole])
        shape = np.einsum("tji,tmj->mi", rotation[whole], offsets[whole]) / whole.sum()
    return rotation, centroid


def _fit_rotations(shape: Array, offsets: Array) -> Array:
    """(n, 3, 3): rotations that bring ``shape`` (markers, 3) closest to ``offsets`` (n, markers, 3)."""
    u, _, vt = np.linalg.svd(np.einsum("tmi,mj->tij", offsets, shape))
    mirror = np.ones((len(offsets), 3))
    mirror[:, 2] = np.linalg.det(u @ vt)
    return np.asarray(np.einsum("tij,tj,tjk->tik", u, mirror, vt))


def fit_joint_centre(proximal: Array, distal: Array, hinge: bool) -> tuple[Array, float]:
    """Joint centre (n, 3) between two clusters (n, markers, 3), and the root mean square distance of both views [m]."""
    (turn_a, at_a), (turn_b, at_b) = fit_cluster_pose(proximal), fit_cluster_pose(distal)
    known = np.isfinite(turn_a).all(axis=(1, 2)) & np.isfinite(turn_b).all(axis=(1, 2))
    system = np.concatenate([turn_a, -turn_b], axis=2)[known].reshape(-1, 6)
    apart = (at_b - at_a)[known].reshape(-1)
    u, sizes, vt = np.linalg.svd(system, full_matrices=False)
    if hinge:
        u, sizes, vt = u[:, :-1], sizes[:-1], vt[:-1]
    solution = vt.T @ ((u.T @ apart) / sizes)
    residual = float(np.sqrt(3.0 * np.mean((system @ solution - apart) ** 2)))
    one = np.einsum("tij,j->ti", turn_a, solution[:3]) + at_a
    other = np.einsum("tij,j->ti", turn_b, solution[3:]) + at_b
    return 0.5 * (one + other), residual


def estimate_hip_centre(right_asis: Array, left_asis: Array, mid_psis: Array, side: str) -> Array:
    """Hip joint centre (n, 3) [m] from both anterior iliac spines and the middle of the back of the pelvis.

    Regression of Harrington et al. 2007, J. Biomech. 40: 595-602, whose lengths are pelvic depth and width.
    """
    front = 0.5 * (right_asis + left_asis)
    across = right_asis - left_asis
    width = np.linalg.norm(across, axis=1, keepdims=True)
    across = across / width
    ahead = front - mid_psis
    depth = np.linalg.norm(ahead, axis=1, keepdims=True)
    ahead = ahead - np.sum(ahead * across, axis=1, keepdims=True) * across
    ahead = ahead / np.linalg.norm(ahead, axis=1, keepdims=True)
    up = np.cross(across, ahead)
    wide = np.nanmean(width)
    lateral = (0.33 * wide + 0.0073) * (1.0 if side == "right" else -1.0)
    return np.asarray(
        front - (0.24 * np.nanmean(depth) + 0.0099) * ahead - (0.30 * wide + 0.0109) * up + lateral * across
    )
