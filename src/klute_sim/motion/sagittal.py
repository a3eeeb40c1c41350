"""A leg in the sagittal plane, from markers: joint centres, inclinations of thigh, shank and foot."""

from dataclasses import dataclass

import numpy as np

from klute_sim.formats.trc import Markers
from klute_sim.motion import filters, joints
from klute_sim.motion.findings import Findings
from klute_sim.motion.markers import Frame, Named, centre
from klute_sim.motion.names import SIDES, Side
from klute_sim.recording.recording import Samples


@dataclass(frozen=True, eq=False)
class Leg:
    """Points (n, 3) as forward, up, right [m], and inclinations [deg] in the plane of walking."""

    time: Samples
    hip: Samples
    knee: Samples
    ankle: Samples
    heel: Samples
    toe: Samples

    @property
    def thigh_angle(self) -> Samples:
        """Upper end forward positive."""
        return _lean(self.hip - self.knee)

    @property
    def shank_angle(self) -> Samples:
        """Upper end forward positive."""
        return _lean(self.knee - self.ankle)

    @property
    def knee_angle(self) -> Samples:
        """Flexion positive."""
        return self.shank_angle - self.thigh_angle

    @property
    def foot_pitch(self) -> Samples:
        """Of the line from heel to toe, toe down positive."""
        along = self.toe - self.heel
        return np.degrees(np.arctan2(-along[:, 1], along[:, 0]))


def _lean(upwards: Samples) -> Samples:
    return np.asarray(np.degrees(np.arctan2(upwards[:, 0], upwards[:, 1])), dtype=np.float64)


def prepared(markers: Markers, frame: Frame, cutoff: float, where: str) -> Markers:
    """``markers`` in the frame of walking on an even clock, gaps bridged, filtered at ``cutoff`` [Hz]."""
    clock = filters.even(markers.time, where)
    rate = (len(clock) - 1) / (clock[-1] - clock[0])
    smooth = {}
    for name, place in markers.positions.items():
        whole = filters.onto(clock, markers.time, filters.bridged(place, markers.time))
        smooth[name] = filters.low_pass(frame.turn(whole), rate, cutoff)
    return Markers(clock, smooth)


def leg(markers: Markers, roles: Named, side: Side, where: str, findings: Findings) -> Leg | None:
    """The leg of ``side`` from ``markers`` in the frame of walking; None where markers are missing, which is noted."""
    heel, toe = (centre(markers, roles.of(side, role)) for role in ("heel", "toe"))
    knee = _knee(markers, roles, side, where, findings)
    ankle = _ankle(markers, roles, side, where, findings)
    hip = _hip(markers, roles, side, where, findings)
    points = {"hip": hip, "knee": knee, "ankle": ankle, "heel": heel, "toe": toe}
    lacking = [name for name, point in points.items() if point is None]
    if lacking or hip is None or knee is None or ankle is None or heel is None or toe is None:
        findings.miss(
            f"{where}: the {side} leg has no markers for {' and '.join(lacking)}; name them in a file for --map, under "
            f"[markers.{side}]"
        )
        return None
    return Leg(markers.time, hip, knee, ankle, heel, toe)


def _hip(markers: Markers, roles: Named, side: Side, where: str, findings: Findings) -> Samples | None:
    if roles.of(side, "hip"):
        _tell(
            findings, where, side, "hip", roles.of(side, "hip"), "marker (of the greater trochanter, or of the centre)"
        )
        return centre(markers, roles.of(side, "hip"))
    fronts = [centre(markers, roles.of(s, "asis")) for s in SIDES]
    back = centre(markers, roles.sacrum or (*roles.of("right", "psis"), *roles.of("left", "psis")))
    if fronts[0] is None or fronts[1] is None or back is None:
        return None
    used = (*roles.of("right", "asis"), *roles.of("left", "asis"), *(roles.sacrum or roles.of(side, "psis")))
    _tell(findings, where, side, "hip", used, "regression of Harrington et al. 2007 on the pelvis")
    return joints.hip_from_pelvis(fronts[0], fronts[1], back, side)


def _knee(markers: Markers, roles: Named, side: Side, where: str, findings: Findings) -> Samples | None:
    return _joint(markers, roles, side, "knee", ("thigh",), ("shank",), where, findings)


def _ankle(markers: Markers, roles: Named, side: Side, where: str, findings: Findings) -> Samples | None:
    rigid = ("heel", "midfoot")  # the toes bend against them
    enough = sum(len(roles.of(side, role)) for role in rigid) >= joints.LEAST_MARKERS
    foot = rigid if enough else (*rigid, "toe")
    return _joint(markers, roles, side, "ankle", ("shank",), foot, where, findings)


def _joint(
    markers: Markers,
    roles: Named,
    side: Side,
    joint: str,
    above: tuple[str, ...],
    below: tuple[str, ...],
    where: str,
    findings: Findings,
) -> Samples | None:
    direct = roles.of(side, joint)
    if direct:
        _tell(findings, where, side, joint, direct, "mean of the markers on it")
        return centre(markers, direct)
    clusters = [tuple(n for role in part for n in roles.of(side, role)) for part in (above, below)]
    if any(len(cluster) < joints.LEAST_MARKERS for cluster in clusters):
        return None
    upper, lower = (np.stack([markers.positions[n] for n in cluster], axis=1) for cluster in clusters)
    both = np.isfinite(upper).all(axis=(1, 2)) & np.isfinite(lower).all(axis=(1, 2))
    if both.sum() < 20:
        findings.miss(f"{where}: the clusters above and below the {side} {joint} are never seen whole together")
        return None
    found, residual = joints.functional(upper, lower, hinge=joint == "knee")
    how = f"centre of rotation of two clusters (Ehrig et al. 2006), {1e3 * residual:.1f} mm rms"
    _tell(findings, where, side, joint, clusters[0] + clusters[1], how)
    if residual > joints.MOST_RESIDUAL:
        findings.suspect(
            f"{where}: the {side} {joint}'s centre does not rest in both segments ({1e3 * residual:.0f} mm rms); are "
            "the clusters named rightly?"
        )
    return found


def _tell(findings: Findings, where: str, side: Side, joint: str, used: tuple[str, ...], how: str) -> None:
    findings.map(
        **{"channel": f"{joint} centre", "side": side, "file": where, "column": ", ".join(used), "unit": "m"},
        **{"sign": 1, "zero": 0.0, "why": how},
    )
