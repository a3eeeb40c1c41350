"""Plausibility of the landmarks of both legs and of the ground reaction under the feet."""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from klute_sim.gait.contacts import Contact
from klute_sim.mocap.kinematics.from_markers import LANDMARKS, LegLandmarks
from klute_sim.mocap.kinematics.loads import GroundReaction
from klute_sim.mocap.parsing.channel_names import Side
from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.gait import markers, positions
from klute_sim.plausibility.gait.positions import ScaledSeries
from klute_sim.plausibility.gait.steps import Series, find_steps
from klute_sim.types import Array

MIN_EXCHANGED_FLEXION = 8.0
"""Flexion of the knee under load beyond that in swing [deg] that no gait has (assumed)."""
UP = 1
"""Index of the vertical component of a landmark."""


def find_landmark_findings(
    landmarks: Mapping[Side, LegLandmarks], stature: float | None, file_name: str
) -> list[Finding]:
    """Return what is implausible in the ``landmarks`` of the legs in the walking frame."""
    place = f"file {file_name}"
    legs: dict[str, Mapping[str, Array]] = {side: _select_known(leg) for side, leg in landmarks.items()}
    findings = markers.find_length_unit(list(legs.values()), place)
    if findings or not legs:
        return findings
    for side, leg in legs.items():
        findings += markers.find_exchanged_markers(leg, side, UP, place)
    if findings:
        return findings
    time = next(iter(landmarks.values())).time
    rate = (len(time) - 1) / float(time[-1] - time[0])
    findings += markers.find_walking_direction(legs, rate, place)
    if stature is not None and not findings:
        findings += markers.find_stature(next(iter(legs.values())), stature, place)
    return findings


def _select_known(leg: LegLandmarks) -> dict[str, Array]:
    positions = {name: getattr(leg, name) for name in LANDMARKS}
    return {name: position for name, position in positions.items() if np.isfinite(position).any()}


def find_side_findings(knee: Series, contacts: Sequence[Contact], side: Side, file_name: str) -> list[Finding]:
    """Return whether the ``knee`` [deg, flexion positive] is more flexed under load than in swing."""
    differences = []
    for first, second in pairwise(contacts):
        stance, swing = first.toe_off - first.foot_strike, second.foot_strike - first.toe_off
        is_known = first.has_foot_strike and first.has_toe_off and second.has_foot_strike
        if not is_known or not 0.2 < swing / stance < 2.2:
            continue
        under_load = _average(knee, first.foot_strike + 0.2 * stance, first.foot_strike + 0.7 * stance)
        unloaded = _average(knee, first.toe_off + 0.1 * swing, first.toe_off + 0.7 * swing)
        differences.append(under_load - unloaded)
    if not differences or not float(np.median(differences)) > MIN_EXCHANGED_FLEXION:
        return []
    statement = (
        f"the {side} knee is {float(np.median(differences)):.0f} degrees more flexed under load than in swing: angles "
        "and load are of different feet (right and left exchanged); exchange the sides of one of them"
    )
    return [Finding("side-exchanged", f"file {file_name}", statement)]


def _average(series: Series, start: float, end: float) -> float:
    inside = (series.time >= start) & (series.time <= end) & np.isfinite(series.value)
    return float(series.value[inside].mean()) if inside.any() else float("nan")


def find_cop_findings(
    landmarks: Mapping[Side, LegLandmarks], foot_loads: Mapping[Side, GroundReaction]
) -> list[Finding]:
    """Return whether the centre of pressure of a loaded foot is far from its ankle."""
    findings: list[Finding] = []
    for side, leg in landmarks.items():
        load = foot_loads.get(side)
        if load is None or load.cop is None:
            continue
        vertical = Series(load.time, load.vertical)
        known = np.isfinite(leg.ankle[:, 0])
        steps = find_steps(vertical)
        if not steps or known.sum() < 2:
            continue
        is_seen = (load.time >= leg.time[known][0]) & (load.time <= leg.time[known][-1])
        cop = ScaledSeries("cop", Series(load.time, np.where(is_seen, load.cop[:, 0], np.nan)), "m", 1.0)
        ankle = Series(leg.time[known], leg.ankle[known, 0])
        place = f"file {load.file_name}, {side} foot"
        cop_findings, progression = positions.check_cop(cop, ankle, vertical, steps, place)
        findings += cop_findings + positions.check_progression(progression, "cop", place)
    return findings
