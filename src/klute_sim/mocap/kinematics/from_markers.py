"""Landmarks of a leg in the sagittal plane from markers: joint centres, inclinations of thigh, shank and foot."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from klute_sim.mocap.formats.trc import Markers
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics import filters, joints
from klute_sim.mocap.parsing.channel_names import SIDES, Side
from klute_sim.mocap.parsing.markers import MarkerRoles, WalkingFrame, compute_mean_position
from klute_sim.types import Array

LANDMARKS = ("hip", "knee", "ankle", "heel", "toe")
"""Names of the landmarks of a leg."""
MIN_CLUSTER_FRAMES = 20
"""Smallest number of frames with both clusters visible that determine a joint centre."""


@dataclass(frozen=True, eq=False)
class LegLandmarks:
    """Landmarks (n, 3) of a leg in the components forward, up, right [m]; NaN where one is unknown."""

    time: Array
    """Uniform sample times (n,) [s]."""
    hip: Array
    """Hip joint centre."""
    knee: Array
    """Knee joint centre."""
    ankle: Array
    """Ankle joint centre."""
    heel: Array
    """Heel marker."""
    toe: Array
    """Toe marker."""

    @property
    def thigh_angle(self) -> Array:
        """Inclination of the thigh [deg], upper end forward positive."""
        return _compute_inclination(self.hip - self.knee)

    @property
    def shank_angle(self) -> Array:
        """Inclination of the shank [deg], upper end forward positive."""
        return _compute_inclination(self.knee - self.ankle)

    @property
    def knee_angle(self) -> Array:
        """Knee angle [deg], flexion positive."""
        return self.shank_angle - self.thigh_angle

    @property
    def foot_pitch(self) -> Array:
        """Pitch of the line from heel to toe [deg], toe down positive."""
        foot_vector = self.toe - self.heel
        return np.degrees(np.arctan2(-foot_vector[:, 1], foot_vector[:, 0]))


def _compute_inclination(vector: Array) -> Array:
    return np.asarray(np.degrees(np.arctan2(vector[:, 0], vector[:, 1])), dtype=np.float64)


def preprocess_markers(markers: Markers, frame: WalkingFrame, cutoff: float, file_name: str) -> Markers:
    """Return ``markers`` in the walking frame at uniform times, with gaps filled, filtered at ``cutoff`` [Hz]."""
    all_times, _ = filters.insert_missing_samples(markers.time, markers.time)
    time = filters.make_uniform_time(all_times, file_name)
    rate = (len(time) - 1) / (time[-1] - time[0])
    filtered = {}
    for name, position in markers.positions.items():
        _, complete = filters.insert_missing_samples(markers.time, position)
        uniform = filters.resample_uniform(time, all_times, filters.fill_gaps(complete, all_times))
        filtered[name] = filters.low_pass(frame.rotate(uniform), rate, cutoff)
    return Markers(time, filtered)


def locate_landmarks(
    markers: Markers,
    roles: MarkerRoles,
    side: Side,
    file_name: str,
    log: ImportLog,
    required: Collection[str] = LANDMARKS,
) -> LegLandmarks | None:
    """Return the landmarks of the leg of ``side`` from ``markers`` in the walking frame.

    Landmarks without markers are NaN. Returns None and logs the reason if a ``required`` one has no markers.
    """
    heel, toe = (compute_mean_position(markers, roles.select(side, role)) for role in ("heel", "toe"))
    knee = _locate_joint(markers, roles, side, "knee", ("thigh",), ("shank",), file_name, log)
    ankle = _locate_ankle(markers, roles, side, file_name, log)
    hip = _locate_hip(markers, roles, side, file_name, log)
    points = dict(zip(LANDMARKS, (hip, knee, ankle, heel, toe), strict=True))
    missing = [name for name in required if points[name] is None]
    if missing:
        log.add_missing(
            f"{file_name}: the {side} leg has no markers for {' and '.join(missing)}; name them in a file for --map, "
            f"under [markers.{side}]"
        )
        return None
    unknown = np.full((len(markers.time), 3), np.nan)
    return LegLandmarks(markers.time, *(unknown if point is None else point for point in points.values()))


def _locate_hip(markers: Markers, roles: MarkerRoles, side: Side, file_name: str, log: ImportLog) -> Array | None:
    hip_markers = roles.select(side, "hip")
    if hip_markers:
        method = "marker (of the greater trochanter, or of the centre)"
        _log_joint_centre(log, file_name, side, "hip", hip_markers, method)
        return compute_mean_position(markers, hip_markers)
    right_asis, left_asis = (compute_mean_position(markers, roles.select(s, "asis")) for s in SIDES)
    posterior = roles.sacrum or (*roles.select("right", "psis"), *roles.select("left", "psis"))
    mid_psis = compute_mean_position(markers, posterior)
    if right_asis is None or left_asis is None or mid_psis is None:
        return None
    asis_markers = (*roles.select("right", "asis"), *roles.select("left", "asis"))
    pelvis_markers = (*asis_markers, *(roles.sacrum or roles.select(side, "psis")))
    _log_joint_centre(log, file_name, side, "hip", pelvis_markers, "pelvis regression of Harrington et al. 2007")
    return joints.estimate_hip_centre(right_asis, left_asis, mid_psis, side)


def _locate_ankle(markers: Markers, roles: MarkerRoles, side: Side, file_name: str, log: ImportLog) -> Array | None:
    rigid_roles = ("heel", "midfoot")  # without the toes, which flex against the rest of the foot
    is_sufficient = sum(len(roles.select(side, role)) for role in rigid_roles) >= joints.MIN_CLUSTER_MARKERS
    foot_roles = rigid_roles if is_sufficient else (*rigid_roles, "toe")
    return _locate_joint(markers, roles, side, "ankle", ("shank",), foot_roles, file_name, log)


def _locate_joint(
    markers: Markers,
    roles: MarkerRoles,
    side: Side,
    joint: str,
    proximal_roles: tuple[str, ...],
    distal_roles: tuple[str, ...],
    file_name: str,
    log: ImportLog,
) -> Array | None:
    """Return the centre (n, 3) [m] of ``joint`` by its own markers, or by the clusters of the adjacent segments."""
    joint_markers = roles.select(side, joint)
    if joint_markers:
        _log_joint_centre(log, file_name, side, joint, joint_markers, "mean of the joint's markers")
        return compute_mean_position(markers, joint_markers)
    clusters = [
        tuple(n for role in segment_roles for n in roles.select(side, role))
        for segment_roles in (proximal_roles, distal_roles)
    ]
    if any(len(cluster) < joints.MIN_CLUSTER_MARKERS for cluster in clusters):
        return None
    proximal, distal = (np.stack([markers.positions[n] for n in cluster], axis=1) for cluster in clusters)
    visible = np.isfinite(proximal).all(axis=(1, 2)) & np.isfinite(distal).all(axis=(1, 2))
    if visible.sum() < MIN_CLUSTER_FRAMES:
        log.add_missing(f"{file_name}: the clusters above and below the {side} {joint} are never visible together")
        return None
    centre, residual = joints.fit_joint_centre(proximal, distal, hinge=joint == "knee")
    method = f"centre of rotation of two clusters (Ehrig et al. 2006), {1e3 * residual:.1f} mm rms"
    _log_joint_centre(log, file_name, side, joint, clusters[0] + clusters[1], method)
    if residual > joints.MAX_JOINT_RESIDUAL:
        log.add_warning(
            f"{file_name}: the centre of the {side} {joint} moves in both segments ({1e3 * residual:.0f} mm rms); "
            "check the names of the clusters"
        )
    return centre


def _log_joint_centre(
    log: ImportLog, file_name: str, side: Side, joint: str, marker_names: tuple[str, ...], method: str
) -> None:
    log.add_channel(
        **{"channel": f"{joint} centre", "side": side, "file": file_name, "column": ", ".join(marker_names)},
        **{"unit": "m", "sign": 1, "zero": 0.0, "reason": method},
    )
