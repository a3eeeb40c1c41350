"""A leg in the sagittal plane, from markers: joint centres, inclinations of thigh, shank and foot."""

from dataclasses import dataclass

import numpy as np

from klute_sim.mocap.formats.trc import Markers
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics import filters, joints
from klute_sim.mocap.parsing.channel_names import SIDES, Side
from klute_sim.mocap.parsing.markers import MarkerRoles, WalkingFrame, mean_position
from klute_sim.recording.recording import Array


@dataclass(frozen=True, eq=False)
class LegLandmarks:
    """Points (n, 3) as forward, up, right [m], and inclinations [deg] in the plane of walking."""

    time: Array
    hip: Array
    knee: Array
    ankle: Array
    heel: Array
    toe: Array

    @property
    def thigh_angle(self) -> Array:
        """Upper end forward positive."""
        return _compute_inclination(self.hip - self.knee)

    @property
    def shank_angle(self) -> Array:
        """Upper end forward positive."""
        return _compute_inclination(self.knee - self.ankle)

    @property
    def knee_angle(self) -> Array:
        """Flexion positive."""
        return self.shank_angle - self.thigh_angle

    @property
    def foot_pitch(self) -> Array:
        """Of the line from heel to toe, toe down positive."""
        along = self.toe - self.heel
        return np.degrees(np.arctan2(-along[:, 1], along[:, 0]))


def _compute_inclination(vector: Array) -> Array:
    return np.asarray(np.degrees(np.arctan2(vector[:, 0], vector[:, 1])), dtype=np.float64)


def preprocess_markers(markers: Markers, frame: WalkingFrame, cutoff: float, trial_name: str) -> Markers:
    """``markers`` in the frame of walking on an even clock, gaps bridged, filtered at ``cutoff`` [Hz]."""
    clock = filters.make_uniform_time(markers.time, trial_name)
    rate = (len(clock) - 1) / (clock[-1] - clock[0])
    smooth = {}
    for name, place in markers.positions.items():
        whole = filters.resample_uniform(clock, markers.time, filters.fill_gaps(place, markers.time))
        smooth[name] = filters.low_pass(frame.rotate(whole), rate, cutoff)
    return Markers(clock, smooth)


def locate_landmarks(
    markers: Markers, roles: MarkerRoles, side: Side, trial_name: str, log: ImportLog
) -> LegLandmarks | None:
    """The leg of ``side`` from ``markers`` in the frame of walking; None where markers are missing, which is noted."""
    heel, toe = (mean_position(markers, roles.select(side, role)) for role in ("heel", "toe"))
    knee = _locate_knee(markers, roles, side, trial_name, log)
    ankle = _locate_ankle(markers, roles, side, trial_name, log)
    hip = _locate_hip(markers, roles, side, trial_name, log)
    points = {"hip": hip, "knee": knee, "ankle": ankle, "heel": heel, "toe": toe}
    lacking = [name for name, point in points.items() if point is None]
    if lacking or hip is None or knee is None or ankle is None or heel is None or toe is None:
        log.add_missing(
            f"{trial_name}: the {side} leg has no markers for {' and '.join(lacking)}; name them in a file for --map, under "
            f"[markers.{side}]"
        )
        return None
    return LegLandmarks(markers.time, hip, knee, ankle, heel, toe)


def _locate_hip(markers: Markers, roles: MarkerRoles, side: Side, trial_name: str, log: ImportLog) -> Array | None:
    if roles.select(side, "hip"):
        _log_joint_centre(
            log,
            trial_name,
            side,
            "hip",
            roles.select(side, "hip"),
            "marker (of the greater trochanter, or of the centre)",
        )
        return mean_position(markers, roles.select(side, "hip"))
    fronts = [mean_position(markers, roles.select(s, "asis")) for s in SIDES]
    back = mean_position(markers, roles.sacrum or (*roles.select("right", "psis"), *roles.select("left", "psis")))
    if fronts[0] is None or fronts[1] is None or back is None:
        return None
    used = (
        *roles.select("right", "asis"),
        *roles.select("left", "asis"),
        *(roles.sacrum or roles.select(side, "psis")),
    )
    _log_joint_centre(log, trial_name, side, "hip", used, "regression of Harrington et al. 2007 on the pelvis")
    return joints.estimate_hip_centre(fronts[0], fronts[1], back, side)


def _locate_knee(markers: Markers, roles: MarkerRoles, side: Side, trial_name: str, log: ImportLog) -> Array | None:
    return _locate_joint(markers, roles, side, "knee", ("thigh",), ("shank",), trial_name, log)


def _locate_ankle(markers: Markers, roles: MarkerRoles, side: Side, trial_name: str, log: ImportLog) -> Array | None:
    rigid = ("heel", "midfoot")  # the toes bend against them
    enough = sum(len(roles.select(side, role)) for role in rigid) >= joints.MIN_CLUSTER_MARKERS
    foot = rigid if enough else (*rigid, "toe")
    return _locate_joint(markers, roles, side, "ankle", ("shank",), foot, trial_name, log)


def _locate_joint(
    markers: Markers,
    roles: MarkerRoles,
    side: Side,
    joint: str,
    proximal_roles: tuple[str, ...],
    distal_roles: tuple[str, ...],
    trial_name: str,
    log: ImportLog,
) -> Array | None:
    direct = roles.select(side, joint)
    if direct:
        _log_joint_centre(log, trial_name, side, joint, direct, "mean of the markers on it")
        return mean_position(markers, direct)
    clusters = [tuple(n for role in part for n in roles.select(side, role)) for part in (proximal_roles, distal_roles)]
    if any(len(cluster) < joints.MIN_CLUSTER_MARKERS for cluster in clusters):
        return None
    upper, lower = (np.stack([markers.positions[n] for n in cluster], axis=1) for cluster in clusters)
    both = np.isfinite(upper).all(axis=(1, 2)) & np.isfinite(lower).all(axis=(1, 2))
    if both.sum() < 20:
        log.add_missing(f"{trial_name}: the clusters above and below the {side} {joint} are never seen whole together")
        return None
    found, residual = joints.fit_joint_centre(upper, lower, hinge=joint == "knee")
    how = f"centre of rotation of two clusters (Ehrig et al. 2006), {1e3 * residual:.1f} mm rms"
    _log_joint_centre(log, trial_name, side, joint, clusters[0] + clusters[1], how)
    if residual > joints.MAX_JOINT_RESIDUAL:
        log.add_warning(
            f"{trial_name}: the {side} {joint}'s centre does not rest in both segments ({1e3 * residual:.0f} mm rms); are "
            "the clusters named rightly?"
        )
    return found


def _log_joint_centre(
    log: ImportLog, trial_name: str, side: Side, joint: str, marker_names: tuple[str, ...], method: str
) -> None:
    log.add_channel(
        **{
            "channel": f"{joint} centre",
            "side": side,
            "file": trial_name,
            "column": ", ".join(marker_names),
            "unit": "m",
        },
        **{"sign": 1, "zero": 0.0, "why": method},
    )
