"""Plausibility of the landmarks of both legs and of the ground reaction under the feet."""

from collections.abc import Mapping

import numpy as np

from klute_sim.mocap.kinematics.from_markers import LegLandmarks
from klute_sim.mocap.kinematics.loads import GroundReaction
from klute_sim.mocap.parsing.channel_names import Side
from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.gait import markers, positions
from klute_sim.plausibility.gait.positions import ScaledSeries
from klute_sim.plausibility.gait.steps import Series, find_steps
from klute_sim.types import Array

UP = 1
"""Index of the vertical component of a landmark."""


def find_landmark_findings(
    landmarks: Mapping[Side, LegLandmarks], stature: float | None, trial_name: str
) -> list[Finding]:
    """Return what is implausible in the ``landmarks`` of the legs in the walking frame."""
    place = f"file {trial_name}"
    legs: dict[str, Mapping[str, Array]] = {
        side: {"hip": leg.hip, "knee": leg.knee, "ankle": leg.ankle, "heel": leg.heel, "toe": leg.toe}
        for side, leg in landmarks.items()
    }
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


def find_cop_findings(
    landmarks: Mapping[Side, LegLandmarks], foot_loads: Mapping[Side, GroundReaction], trial_name: str
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
        found, _ = positions.check_cop(cop, ankle, vertical, steps, f"file {trial_name}, {side} foot")
        findings += found
    return findings
