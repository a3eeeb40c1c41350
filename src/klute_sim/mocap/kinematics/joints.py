"""Joint centres from the relative motion of two marker clusters, or from pelvis landmarks.

The first is the symmetrical centre of rotation estimation (Ehrig et al. 2006, J. Biomech. 39: 2798-2809): the point
that is at rest in both segments, by least squares over all frames. For a hinge, every point of its axis is a solution;
the one nearest to the clusters is returned.
"""

import numpy as np

from klute_sim.types import Array

MIN_CLUSTER_MARKERS = 3
"""Smallest number of markers that determine the pose of a segment."""
MAX_JOINT_RESIDUAL = 0.03
"""Largest accepted rms distance [m] between the joint centres of both segments."""


def fit_cluster_pose(cluster: Array) -> tuple[Array, Array]:
    """Return rotations (n, 3, 3) and centroids (n, 3) of a rigid ``cluster`` (n, markers, 3) against its mean shape.

    Uses singular value decomposition (Soederkvist & Wedin 1993); frames with a missing marker are NaN.
    """
    centroid = cluster.mean(axis=1)
    offsets = cluster - centroid[:, None]
    complete = np.isfinite(offsets).all(axis=(1, 2))
    rotation = np.full((len(cluster), 3, 3), np.nan)
    shape = offsets[complete][len(offsets[complete]) // 2]
    for _ in range(2):  # the second iteration fits the mean shape, which has less noise than a single frame
        rotation[complete] = _fit_rotations(shape, offsets[complete])
        shape = np.einsum("tji,tmj->mi", rotation[complete], offsets[complete]) / complete.sum()
    return rotation, centroid


def _fit_rotations(shape: Array, offsets: Array) -> Array:
    """Return the rotations (n, 3, 3) that best map ``shape`` (markers, 3) to ``offsets`` (n, markers, 3)."""
    u, _, vt = np.linalg.svd(np.einsum("tmi,mj->tij", offsets, shape))
    mirror = np.ones((len(offsets), 3))
    mirror[:, 2] = np.linalg.det(u @ vt)
    return np.asarray(np.einsum("tij,tj,tjk->tik", u, mirror, vt))


def fit_joint_centre(proximal: Array, distal: Array, hinge: bool) -> tuple[Array, float]:
    """Return the joint centre (n, 3) between two clusters (n, markers, 3), and the residual [m].

    The residual is the rms distance between the centres by the proximal and by the distal segment.
    """
    (proximal_rotation, proximal_centroid) = fit_cluster_pose(proximal)
    (distal_rotation, distal_centroid) = fit_cluster_pose(distal)
    known = np.isfinite(proximal_rotation).all(axis=(1, 2)) & np.isfinite(distal_rotation).all(axis=(1, 2))
    system = np.concatenate([proximal_rotation, -distal_rotation], axis=2)[known].reshape(-1, 6)
    distance = (distal_centroid - proximal_centroid)[known].reshape(-1)
    u, singular_values, vt = np.linalg.svd(system, full_matrices=False)
    if hinge:
        u, singular_values, vt = u[:, :-1], singular_values[:-1], vt[:-1]
    solution = vt.T @ ((u.T @ distance) / singular_values)
    residual = float(np.sqrt(3.0 * np.mean((system @ solution - distance) ** 2)))
    proximal_centre = np.einsum("tij,j->ti", proximal_rotation, solution[:3]) + proximal_centroid
    distal_centre = np.einsum("tij,j->ti", distal_rotation, solution[3:]) + distal_centroid
    return 0.5 * (proximal_centre + distal_centre), residual


def estimate_hip_centre(right_asis: Array, left_asis: Array, mid_psis: Array, side: str) -> Array:
    """Return the hip joint centre (n, 3) [m] from both anterior iliac spines and the posterior midpoint (n, 3) [m].

    Regression of Harrington et al. 2007, J. Biomech. 40: 595-602, on pelvic depth and width.
    """
    front = 0.5 * (right_asis + left_asis)
    lateral_axis = right_asis - left_asis
    width = np.linalg.norm(lateral_axis, axis=1, keepdims=True)
    lateral_axis = lateral_axis / width
    forward_axis = front - mid_psis
    depth = np.linalg.norm(forward_axis, axis=1, keepdims=True)
    forward_axis = forward_axis - np.sum(forward_axis * lateral_axis, axis=1, keepdims=True) * lateral_axis
    forward_axis = forward_axis / np.linalg.norm(forward_axis, axis=1, keepdims=True)
    up_axis = np.cross(lateral_axis, forward_axis)
    mean_width = np.nanmean(width)
    lateral = (0.33 * mean_width + 0.0073) * (1.0 if side == "right" else -1.0)
    return np.asarray(
        front
        - (0.24 * np.nanmean(depth) + 0.0099) * forward_axis
        - (0.30 * mean_width + 0.0109) * up_axis
        + lateral * lateral_axis
    )
