"""What moves a prosthesis in one trial: where its shank leans and its ankle is, and whose load is whose."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from klute_sim.dataset.channels import LOADED
from klute_sim.motion import angled, columns, filters, loads, markers, names, sagittal
from klute_sim.motion.clocks import Series
from klute_sim.motion.columns import Column
from klute_sim.motion.findings import Findings
from klute_sim.motion.loads import Loads
from klute_sim.motion.names import SIDES, Side
from klute_sim.motion.options import ImportOptions
from klute_sim.motion.sources import Source

MOTION = ("shank_angle", "ankle_x", "ankle_z")


@dataclass(frozen=True, eq=False)
class Moving:
    """Motion and loads of one trial, not filtered."""

    channels: Mapping[str, Series]
    """Those of :data:`MOTION`; angle [deg], places [m] in the frame of the loads."""
    on: Mapping[Side, Loads]
    by_plates: bool
    """Whether the loads are force plates', in the frame of the motion."""
    ankle: Series | None = None
    """Angle between shank and the line from heel to toe [deg], of markers."""


def sides(trial: Sequence[Source], options: ImportOptions) -> set[Side]:
    """Legs that the files of ``trial`` tell of by name."""
    found: set[Side] = set()
    for source in trial:
        if source.markers is not None:
            roles = markers.named(source.markers, options.chosen, source.name)
            found |= {side for side in SIDES if roles.of(side, "ankle") or roles.of(side, "shank")}
        for label in source.labels:
            meant = names.named(label.split("[")[0].strip())
            if meant is not None and meant.side is not None and meant.channel in names.ANGLES:
                found.add(meant.side)
    return found | {side for side in SIDES if any(owner == side for owner, _ in options.chosen.channels)}


def moving(trial: Sequence[Source], side: Side, options: ImportOptions, findings: Findings) -> Moving | None:
    """Of the leg of ``side``, from markers or from columns; None where something is missing, which is noted."""
    where = trial[0].name
    captured = next((source for source in trial if source.markers is not None), None)
    if captured is not None:
        return _by_markers(trial, captured, side, where, options, findings)
    found = {name: columns.find(trial, name, side, options) for name in MOTION}
    lacking = [name for name, column in found.items() if column is None]
    if lacking:
        findings.miss(
            f"{where}: nothing says how the {side} shank leans and where its ankle is: add the markers (.trc, .c3d) or "
            f"name a column of {' and '.join(lacking)} in a file for --map, under [{side}]"
        )
        return None
    on = loads.of_sides(trial, options, findings)
    plates = loads.of_plates(trial, None, findings) if side not in on else {}
    if plates:
        knees: dict[Side, dict[str, Column]] = {}
        for one in SIDES:
            knee = columns.find(trial, "knee_angle", one, options)
            knees[one] = {} if knee is None else {"knee_angle": knee}
        clock, apart = angled.bend(knees)
        on = loads.assigned(plates, SIDES if len(clock) else [side], clock, apart, where, options, findings)
    channels = {}
    for name, column in found.items():
        if column is not None:
            channels[name] = Series(column.time, filters.bridged(columns.told(column, side, findings), column.time))
    return Moving(channels, on, bool(plates))


def _by_markers(
    trial: Sequence[Source], source: Source, side: Side, where: str, options: ImportOptions, findings: Findings
) -> Moving | None:
    assert source.markers is not None
    roles = markers.named(source.markers, options.chosen, where)
    frame = markers.frame(source.markers, roles, options.chosen, where, findings)
    raw = sagittal.prepared(source.markers, frame, 0.0, where)
    both = {one: sagittal.leg(raw, roles, one, where, findings if one == side else Findings()) for one in SIDES}
    leg, right, left = both[side], both["right"], both["left"]
    if leg is None:
        return None
    on = loads.of_sides(trial, options, findings)
    plates = loads.of_plates(trial, frame, findings) if side not in on else {}
    if plates:
        apart = right.knee_angle - left.knee_angle if right and left else np.full(len(raw.time), np.nan)
        known = [one for one in SIDES if both[one] is not None]
        on = loads.assigned(plates, known, raw.time, apart, where, options, findings)
    level = _level(on[side]) if plates and side in on else 0.0
    findings.derive("Inclination of the shank: of the line from ankle to knee, in the plane of walking")
    channels = {
        "shank_angle": Series(leg.time, leg.shank_angle),
        "ankle_x": Series(leg.time, leg.ankle[:, 0]),
        "ankle_z": Series(leg.time, leg.ankle[:, 1] - level),
    }
    return Moving(channels, on, bool(plates), Series(leg.time, leg.shank_angle - leg.foot_pitch))


def _level(load: Loads) -> float:
    """Height of the ground [m] in the laboratory: that of the centre of pressure."""
    if load.point is None:
        return 0.0
    known = load.point[np.isfinite(load.point[:, 1]) & (load.vertical > LOADED), 1]
    return float(np.median(known)) if len(known) else 0.0
