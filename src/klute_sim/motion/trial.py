"""One trial's files to its legs, by joint angles where there are some, by markers otherwise."""

from collections.abc import Sequence

import numpy as np

from klute_sim.motion import angled, columns, dynamics, loads, markers, names, sagittal
from klute_sim.motion.findings import Findings
from klute_sim.motion.finish import Landed, landed, power, zeroed
from klute_sim.motion.limb import Limb
from klute_sim.motion.names import SIDES
from klute_sim.motion.options import ImportOptions
from klute_sim.motion.sources import Source
from klute_sim.rigs.gait.reference import GRAVITY

NEEDED = ("knee_angle", "ankle_angle")


def legs(trial: Sequence[Source], options: ImportOptions, findings: Findings) -> list[Limb]:
    """The legs of one trial that have all that a stride needs; what the others lack is noted."""
    where = trial[0].name
    captured = next((source for source in trial if source.markers is not None), None)
    found = {side: {n: columns.find(trial, n, side, options) for n in NEEDED} for side in SIDES}
    angles = any(all(of.values()) for of in found.values())
    moments = any(columns.find(trial, names.MOMENT, side, options) is not None for side in SIDES)
    if angles and (moments or captured is None):
        return angled.legs(trial, where, options, findings)
    if captured is not None and captured.markers is not None:
        if angles:
            files = sorted({column.file for of in found.values() for column in of.values() if column is not None})
            findings.derive(
                f"{captured.name}: joint angles and the ankle's moment are from its markers; the angles in "
                f"{', '.join(files)} come without a moment and were left out"
            )
        return _by_markers(trial, captured, where, options, findings)
    findings.miss(f"{where}: neither knee and ankle angles of one leg nor markers were recognised")
    return []


def _by_markers(
    trial: Sequence[Source], source: Source, where: str, options: ImportOptions, findings: Findings
) -> list[Limb]:
    assert source.markers is not None
    roles = markers.named(source.markers, options.chosen, where)
    frame = markers.frame(source.markers, roles, options.chosen, where, findings)
    smooth = sagittal.prepared(source.markers, frame, options.cutoff, where)
    both = {side: sagittal.leg(smooth, roles, side, where, findings) for side in SIDES}
    known = {side: leg for side, leg in both.items() if leg is not None}
    on = loads.of_sides(trial, options, findings)
    plates = loads.of_plates(trial, frame, findings)
    if plates and not on:
        right, left = both["right"], both["left"]
        bend = right.knee_angle - left.knee_angle if right and left else np.full(len(smooth.time), np.nan)
        on = loads.assigned(plates, list(known), smooth.time, bend, where, options, findings)
    result = []
    for side, leg in known.items():
        if side not in on:
            findings.miss(f"{where}: no ground reaction of the {side} foot; without it there is no heel strike")
            continue
        foot = landed(on[side], leg.time, side, where, options, findings)
        angles = {
            "hip_angle": -leg.thigh_angle,
            "knee_angle": leg.knee_angle,
            "ankle_angle": leg.shank_angle - leg.foot_pitch,
            "shank_angle": leg.shank_angle,
        }
        findings.derive("Joint angles: inclinations of the lines between joint centres, in the plane of walking")
        findings.derive("Hip flexion: of the thigh against the vertical, not against the pelvis")
        zeroed(leg.time, angles, False, foot.contacts, side, where, options, findings)
        channels = angles | {names.VERTICAL: foot.vertical, names.FORWARD: foot.forward}
        if foot.point is None:
            findings.miss(f"{where}: no centre of pressure, so no ankle moment of the {side} leg")
        else:
            mass = options.mass or _carried(foot)
            moment = dynamics.ankle_moment(leg, foot.forward, foot.vertical, foot.point, mass)
            channels[names.MOMENT] = moment
            channels[names.POWER] = power(leg.time, moment, angles["ankle_angle"])
            findings.derive(
                "Ankle moment: inverse dynamics of the foot in the sagittal plane, a rigid body of Winter's mass and "
                "inertia, under the ground reaction"
            )
            findings.derive("Ankle power: moment times plantarflexion rate")
        speed = _speed(leg, foot)
        result.append(Limb(side, where, leg.time, channels, foot.contacts, speed, impulses=foot.impulses))
    return result


def _carried(foot: Landed) -> float:
    """Body mass [kg] good enough for the foot's own: both feet together carry it, each for half of the time."""
    return 2.0 * float(np.nanmean(foot.vertical)) / GRAVITY


def _speed(leg: sagittal.Leg, foot: Landed) -> float | None:
    """How fast the hip passes over the ground [m/s]: its way, plus what a treadmill carries the standing foot back.

    None without a whole stance.
    """
    carried = []
    for c in foot.contacts:
        if c.begun and c.ended:
            span = c.lift - c.strike
            start, end = (np.searchsorted(leg.time, c.strike + share * span) for share in (0.25, 0.5))
            if 0 < start < end < len(leg.time):
                carried.append((leg.heel[end, 0] - leg.heel[start, 0]) / (leg.time[end] - leg.time[start]))
    known = np.isfinite(leg.hip[:, 0])
    if not carried or not np.isfinite(carried).all() or known.sum() < 2:
        return None
    travelled = float(np.polyfit(leg.time[known], leg.hip[known, 0], 1)[0])
    return travelled - float(np.mean(carried))
