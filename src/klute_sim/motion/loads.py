"""Ground reactions of each foot: from columns that name it, or from force plates that do not.

A plate's load goes to the leg whose knee is straighter in the middle of the contact, while the other one swings: that
needs no lengths, no positions of plates and no sign but the knee's, which the knee tells itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from klute_sim.dataset import events
from klute_sim.errors import InputError
from klute_sim.motion import columns, names
from klute_sim.motion.findings import Findings
from klute_sim.motion.markers import Frame
from klute_sim.motion.names import SIDES, Side
from klute_sim.motion.options import ImportOptions
from klute_sim.motion.sources import Source
from klute_sim.recording.recording import Samples

LONGEST_CONTACT = 1.6
"""A longer contact [s] of a walking foot is two feet on one plate, or standing."""
MIDDLE = (0.2, 0.8)
"""Shares of a contact in which the other leg swings."""
USUAL_CONTACT = 0.7
"""What a contact that is cut by the record's ends is taken to last [s] (assumed)."""
LEAST_BEND = 5.0
"""Difference of the knees' mean flexion [deg] below which nothing is told; in walking it is near 30."""
NOTED_OFFSET = 3.0
"""Load of an empty plate [N] from which it is told."""
SAME_POINT = 1e-9
SHARED = 0.2
"""Share of samples with one centre of pressure for both feet from which it is told; for a third both are down."""


@dataclass(frozen=True, eq=False)
class Loads:
    """Ground reaction on one foot, or on one plate [N], on the body; up positive, forward as the axis is."""

    time: Samples
    vertical: Samples
    forward: Samples
    point: Samples | None = None
    """(n, 2): forward and up [m] in the frame of walking; None: not told."""


def of_sides(trial: Sequence[Source], options: ImportOptions, findings: Findings) -> dict[Side, Loads]:
    """Loads from columns that name their foot."""
    found: dict[Side, Loads] = {}
    for side in SIDES:
        vertical = columns.find(trial, names.VERTICAL, side, options)
        forward = columns.find(trial, names.FORWARD, side, options)
        if vertical is None or forward is None:
            three = [columns.find(trial, axis, side, options) for axis in names.AXES]
            present = [c for c in three if c is not None]
            if len(present) < 2 or len({c.source.where for c in present}) > 1:
                continue
            up, ahead = _axes(np.stack([c.values for c in present], axis=1))
            vertical, forward = vertical or present[up], forward or present[ahead]
        sign = 1.0 if np.nanmean(vertical.values) > 0.0 else -1.0
        for channel, column, why in (
            (names.VERTICAL, vertical, "the axis with the largest mean load"),
            (names.FORWARD, forward, "of the others, the one with the larger range"),
        ):
            stated = column.channel == channel
            findings.map(
                **{"channel": channel, "side": side, "file": column.file, "column": column.label},
                **{"unit": column.unit, "sign": int(sign) if channel == names.VERTICAL else 1, "zero": 0.0},
                why=f"unit {column.why_unit}; axis {'by its name' if stated else why}",
            )
        along = np.interp(vertical.time, forward.time, forward.values)  # they may be of two files
        found[side] = Loads(vertical.time, sign * vertical.values, along)
    _same_points(trial, findings)
    return found


def _axes(force: Samples) -> tuple[int, int]:
    """Which columns of ``force`` (n, axes) are vertical and fore-aft."""
    size = np.abs(np.nanmean(force, axis=0))
    up = int(size.argmax())
    swing = np.nanmax(force, axis=0) - np.nanmin(force, axis=0)
    swing[up] = -1.0
    return up, int(swing.argmax())


def _same_points(trial: Sequence[Source], findings: Findings) -> None:
    """Both feet with one centre of pressure, always or while both are down: plates that do not know which foot."""
    for source in trial:
        for label in source.labels:
            other = label.replace("Left", "Right").replace("left", "right")
            if "cop" not in label.lower() or other == label or other not in source.labels:
                continue
            one, two = source.column(label), source.column(other)
            share = float(np.mean(np.abs(one - two) < SAME_POINT))
            if share > SHARED and np.nanmax(one) > np.nanmin(one):
                findings.suspect(
                    f"{source.name}: '{label}' and '{other}' are the same for {100 * share:.0f} % of the time: one "
                    "centre of pressure for both feet; it was not used"
                )
                break


def of_plates(trial: Sequence[Source], frame: Frame | None, findings: Findings) -> dict[str, Loads]:
    """Plate -> its loads, in the frame of walking; a plate that OpenSim's labels give to a foot is named so."""
    found: dict[str, Loads] = {}
    for source in trial:
        name = source.name
        for number, plate in enumerate(source.plates, 1):
            if frame is None:
                raise InputError(f"{source.where} has force plates, but no markers that say which way the walk went")
            key = f"plate {number}"
            force, point = frame.turn(plate.force), frame.turn(plate.pressure_centre)
            force, sign = _upwards(force, 1, key, name, findings)
            found[key] = Loads(plate.time, force[:, 1], force[:, 0], point[:, :2])
            findings.map(
                **{"channel": "ground reaction", "side": key, "file": name, "column": f"force platform {number}"},
                **{"unit": "N", "sign": sign, "zero": 0.0, "why": frame.words},
            )
        found |= _stored_plates(source, name, frame, findings)
    return found


def _stored_plates(source: Source, name: str, frame: Frame | None, findings: Findings) -> dict[str, Loads]:
    parts: dict[str, dict[tuple[str, int], str]] = {}
    for label in source.labels:
        meant = names.plate_column(label)
        if meant is not None:
            parts.setdefault(meant.plate, {})[meant.kind, meant.axis] = label
    found = {}
    for which, labels in parts.items():
        if not all(("force", axis) in labels for axis in range(3)):
            raise InputError(f"{source.where}: the ground reaction '{which}' has not all three components")
        force = np.stack([source.column(labels["force", axis]) for axis in range(3)], axis=1)
        empty = next((labels["force", axis] for axis in range(3) if not np.isfinite(force[:, axis]).any()), None)
        if empty is not None:
            raise InputError(f"{source.where}: column '{empty}' holds no number")
        whole = all(("point", axis) in labels for axis in range(3))
        point = np.stack([source.column(labels["point", axis]) for axis in range(3)], axis=1) if whole else None
        up, ahead, why = 1, 0, "OpenSim's axes: x forward, y up, z right"
        if frame is not None:  # markers in the same laboratory
            force, point = frame.turn(force), None if point is None else frame.turn(point)
            why = frame.words
        elif np.abs(np.nanmean(force, axis=0)).argmax() != 1:
            up, ahead = _axes(force)
            why = f"up is {'xyz'[up]}, not OpenSim's y: the axis with the largest mean load"
            findings.suspect(
                f"{name}: the vertical ground reaction is along {'xyz'[up]}, not along y as OpenSim has it"
            )
        force, sign = _upwards(force, up, f"the ground reaction '{which}'", name, findings)
        key = which if which in SIDES else f"plate {which}"
        place = None if point is None else point[:, [ahead, up]]
        found[key] = Loads(columns.time(source), force[:, up], force[:, ahead], place)
        findings.map(
            **{"channel": "ground reaction", "side": key, "file": name, "column": labels["force", up] + ", ..."},
            **{"unit": "N", "sign": sign, "zero": 0.0, "why": why},
        )
    return found


def _upwards(force: Samples, up: int, which: str, name: str, findings: Findings) -> tuple[Samples, int]:
    """``force`` (n, 3) on the body, and its sign; some record the force on the plate."""
    if not np.nanmean(force[:, up]) < 0.0:
        return force, 1
    findings.suspect(f"{name}: {which} points down; it was turned to act on the body")
    return -force, -1


def without_offset(loads: Loads, which: str, where: str, findings: Findings) -> Loads:
    """``loads`` with what the empty plate reads taken off."""
    zero = events.offset(loads.vertical)
    if abs(zero) > NOTED_OFFSET:
        findings.suspect(f"{where}: {which} reads {zero:.1f} N with nobody on it; this was taken off")
    return replace(loads, vertical=loads.vertical - zero)


def assigned(
    plates: dict[str, Loads],
    legs: Sequence[Side],
    time: Samples,
    bend: Samples,
    where: str,
    options: ImportOptions,
    findings: Findings,
) -> dict[Side, Loads]:
    """Each foot's loads from ``plates``; ``bend`` is how much more the right knee is flexed than the left one [deg].

    Where the files have one of the ``legs`` only, everything is taken for its.
    """
    parts: dict[Side, list[tuple[Loads, float, float]]] = {side: [] for side in SIDES}
    for key, raw in plates.items():
        loads = without_offset(raw, key, where, findings)
        spans = events.contacts(loads.time, loads.vertical, options.threshold)
        feet = [_foot(span, time, bend) for span in spans]
        for foot, span in zip(feet, spans, strict=True):
            known = {f for f in feet if f is not None}
            side: Side | None = foot or (known.pop() if len(known) == 1 else None)
            if key in SIDES:
                side = "right" if key == "right" else "left"
            elif len(legs) == 1:
                side = legs[0]
            if span.lift - span.strike > LONGEST_CONTACT:
                findings.suspect(
                    f"{where}: {key} is loaded for {span.lift - span.strike:.2f} s on end, by both feet or standing; "
                    "this was left out"
                )
            elif side is None:
                findings.suspect(f"{where}: nothing tells whose foot is on {key} at {span.strike:.2f} s; left out")
            else:
                parts[side].append((loads, span.strike, span.lift))
                if key not in SIDES and len(legs) > 1:
                    findings.derive(f"Whose foot is on a plate: the leg with the straighter knee ({side}: {key})")
    return {side: _joined(found) for side, found in parts.items() if found}


def _foot(span: events.Contact, time: Samples, bend: Samples) -> Side | None:
    """Whose contact it is; None where it does not tell, as one that is cut by the record's ends often does not."""
    length = span.lift - span.strike if span.begun and span.ended else USUAL_CONTACT
    strike = span.strike if span.begun else span.lift - length
    low, high = (strike + share * length for share in MIDDLE)
    middle = bend[(time >= max(low, span.strike)) & (time <= min(high, span.lift)) & np.isfinite(bend)]
    if not len(middle) or not abs(float(middle.mean())) > LEAST_BEND:
        return None
    return "left" if middle.mean() > 0.0 else "right"


def _joined(parts: Sequence[tuple[Loads, float, float]]) -> Loads:
    """One foot's contacts with several plates, on the first one's clock; zero between."""
    time = parts[0][0].time
    vertical, forward, moment = np.zeros(len(time)), np.zeros(len(time)), np.zeros((len(time), 2))
    has_point = all(loads.point is not None and np.isfinite(loads.point).any(axis=0).all() for loads, *_ in parts)
    for loads, start, end in parts:
        inside = (time >= start - 0.02) & (time <= end + 0.02)  # what is below the threshold belongs to it
        here = [np.interp(time[inside], loads.time, c) for c in (loads.vertical, loads.forward)]
        vertical[inside] += here[0]
        forward[inside] += here[1]
        if has_point and loads.point is not None:
            for axis in range(2):
                known = np.isfinite(loads.point[:, axis])
                place = np.interp(time[inside], loads.time[known], loads.point[known, axis])
                moment[inside, axis] += here[0] * place
    loaded = np.abs(vertical) > 1e-6
    point = np.where(loaded[:, None], moment / np.where(loaded, vertical, 1.0)[:, None], 0.0)
    return Loads(time, vertical, forward, point if has_point else None)
