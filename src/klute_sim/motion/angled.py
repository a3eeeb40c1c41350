"""Legs from joint angles that somebody else computed: OpenSim's inverse kinematics, a treadmill's software."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from klute_sim.motion import columns, filters, loads, markers, names
from klute_sim.motion.columns import Column
from klute_sim.motion.findings import Findings
from klute_sim.motion.finish import landed, power, signed, zeroed
from klute_sim.motion.limb import Limb
from klute_sim.motion.loads import Loads
from klute_sim.motion.markers import Frame
from klute_sim.motion.names import SIDES, Side
from klute_sim.motion.options import ImportOptions
from klute_sim.motion.sources import Source
from klute_sim.recording.recording import Samples

LEAST_TRAVEL = 0.5
"""Way of the pelvis [m] below which it walked on a treadmill."""
OF_LEG = (*(name for name in names.ANGLES if name != names.TILT), names.MOMENT)


@dataclass(frozen=True, eq=False)
class _Clock:
    """The clock of a leg's angles, and other columns brought to it."""

    time: Samples

    def bring(self, column: Column, values: Samples, cutoff: float) -> Samples:
        """``values`` of ``column`` filtered at ``cutoff`` [Hz], at this clock; NaN outside of the column's own time."""
        own = filters.even(column.time, column.source.where)
        whole = filters.onto(own, column.time, filters.bridged(values, column.time))
        smooth = filters.low_pass(whole, (len(own) - 1) / (own[-1] - own[0]), cutoff)
        return np.asarray(np.interp(self.time, own, smooth, left=np.nan, right=np.nan), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class _Body:
    """What is not of one leg."""

    tilt: Column | None
    belt: Column | None
    speed: float | None


def legs(trial: Sequence[Source], where: str, options: ImportOptions, findings: Findings) -> list[Limb]:
    """The legs of ``trial`` by its joint angles."""
    found: dict[Side, dict[str, Column]] = {}
    for side in SIDES:
        every = {name: columns.find(trial, name, side, options) for name in OF_LEG}
        found[side] = {name: column for name, column in every.items() if column is not None}
    travel = columns.find(trial, names.TRAVEL, None, options)
    belts = [columns.find(trial, names.BELT, side, options) for side in (None, *SIDES)]
    belt = next((column for column in belts if column is not None), None)
    tilt = columns.find(trial, names.TILT, None, options)
    if tilt is not None and tilt.choice is not None and tilt.choice.sign == -1:
        tilt = replace(tilt, values=-tilt.values)
    body = _Body(tilt, belt, _travelled(travel))
    for column, why in (
        (belt, ""),
        (travel, ""),
        (tilt, "; sign: backward positive, as OpenSim's, for nothing in walking tells it"),
    ):
        if column is not None:
            findings.map(
                **{"channel": column.channel, "side": "body", "file": column.file, "column": column.label},
                **{"unit": column.unit, "sign": (column.choice and column.choice.sign) or 1, "zero": 0.0},
                why=f"unit {column.why_unit}{why}" if column.choice is None else "as given",
            )
    on = loads.of_sides(trial, options, findings)
    plates = loads.of_plates(trial, _frame(trial, options, findings), findings) if not on else {}
    if plates:
        present = [side for side, of in found.items() if "knee_angle" in of]
        clock, apart = bend(found)
        on = loads.assigned(plates, present, clock, apart, where, options, findings)
    result = []
    for side, of in found.items():
        if "knee_angle" not in of or "ankle_angle" not in of:
            continue
        if side not in on:
            findings.miss(f"{where}: no ground reaction of the {side} foot; without it there is no heel strike")
            continue
        limb = _leg(side, of, body, on[side], where, options, findings)
        result += [limb] if limb else []
    return result


def _frame(trial: Sequence[Source], options: ImportOptions, findings: Findings) -> Frame | None:
    """The axes of force plates in a C3D, by its markers; None where no file has both."""
    for source in trial:
        if source.plates and source.markers is not None:
            roles = markers.named(source.markers, options.chosen, source.name)
            return markers.frame(source.markers, roles, options.chosen, source.name, findings)
    return None


def _travelled(travel: Column | None) -> float | None:
    """Speed [m/s] of a pelvis that moves through the laboratory."""
    if travel is None or abs(travel.values[-1] - travel.values[0]) < LEAST_TRAVEL:
        return None
    return abs(float(np.polyfit(travel.time, travel.values, 1)[0]))


def bend(found: Mapping[Side, Mapping[str, Column]]) -> tuple[Samples, Samples]:
    """(time, how much more the right knee is flexed than the left one [deg]); nothing where there is one knee only."""
    knees = [found[side].get("knee_angle") for side in SIDES]
    if knees[0] is None or knees[1] is None:
        return np.zeros(0), np.zeros(0)
    right, left = (signed(knee, (), side, Findings()) for knee, side in zip(knees, SIDES, strict=True) if knee)
    return knees[0].time, np.asarray(right - np.interp(knees[0].time, knees[1].time, left), dtype=np.float64)


def _leg(
    side: Side,
    of: Mapping[str, Column],
    body: _Body,
    load: Loads,
    where: str,
    options: ImportOptions,
    findings: Findings,
) -> Limb | None:
    knee = of["knee_angle"]
    clock = _Clock(filters.even(knee.time, knee.source.where))
    foot = landed(load, clock.time, side, where, options, findings)
    angles = {
        name: clock.bring(column, signed(column, foot.contacts, side, findings), options.cutoff)
        for name, column in of.items()
        if name in names.ANGLES
    }
    free = _shank(angles, body.tilt, clock, findings, options.cutoff)
    if free is None:
        findings.miss(
            f"{where}: no hip angle and no inclination of the {side} thigh or shank, so nothing says how the leg leans"
        )
        return None
    zeroed(clock.time, angles, free, foot.contacts, side, where, options, findings)
    channels = {name: angles[name] for name in ("hip_angle", "knee_angle", "ankle_angle", "shank_angle")}
    channels |= {names.VERTICAL: foot.vertical, names.FORWARD: foot.forward}
    if names.MOMENT in of:
        column = of[names.MOMENT]
        values = signed(column, foot.contacts, side, findings)
        channels[names.MOMENT] = clock.bring(column, values, options.load_cutoff)
        channels[names.POWER] = power(clock.time, channels[names.MOMENT], angles["ankle_angle"])
        findings.derive("Ankle power: moment times plantarflexion rate")
    else:
        findings.miss(
            f"{where}: no ankle moment of the {side} leg, and none can be derived without the ankle's position: add "
            "the inverse dynamics (.sto) or the markers (.trc, .c3d)"
        )
    belt = None if body.belt is None else np.interp(clock.time, body.belt.time, body.belt.values)
    return Limb(side, where, clock.time, channels, foot.contacts, body.speed, belt, foot.impulses)


def _shank(
    angles: dict[str, Samples], tilt: Column | None, clock: _Clock, findings: Findings, cutoff: float
) -> bool | None:
    """Fill in ``shank_angle`` and ``hip_angle``; whether the shank's zero is free, None where it cannot be had."""
    knee = angles["knee_angle"]
    if "shank_angle" not in angles and "thigh_angle" in angles:
        angles["shank_angle"] = angles["thigh_angle"] + knee
        findings.derive("Shank inclination: thigh inclination plus knee flexion")
    if "shank_angle" in angles:
        if "hip_angle" not in angles:
            angles["hip_angle"] = knee - angles["shank_angle"]
            findings.derive("Hip flexion: of the thigh against the vertical, not against the pelvis")
        return False
    if "hip_angle" not in angles:
        return None
    if tilt is None:
        angles["shank_angle"] = knee - angles["hip_angle"]
        return True
    angles["shank_angle"] = knee - angles["hip_angle"] - clock.bring(tilt, tilt.values, cutoff)
    findings.derive("Shank inclination: knee flexion minus hip flexion minus pelvis tilt (backward positive)")
    return False
