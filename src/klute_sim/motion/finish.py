"""The steps that all ways to a leg share: loads onto its clock, signs, the ankle's zero, what can be derived."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from klute_sim.dataset import events
from klute_sim.dataset.events import Contact
from klute_sim.motion import filters, names, signs
from klute_sim.motion.columns import AGAINST, Column
from klute_sim.motion.findings import Findings
from klute_sim.motion.loads import Loads, without_offset
from klute_sim.motion.names import Side
from klute_sim.motion.options import ImportOptions
from klute_sim.recording.recording import Samples

NOTED_PITCH = 5.0
"""Pitch of the flat foot [deg] from which it is told: the model that gave the angles has another neutral ankle."""


@dataclass(frozen=True, eq=False)
class Landed:
    """A foot's loads on the clock of its leg."""

    contacts: list[Contact]
    vertical: Samples
    """[N], filtered, zero where the foot is not on the ground, NaN where nothing was measured."""
    forward: Samples
    point: Samples | None
    impulses: tuple[float, ...]


def landed(loads: Loads, time: Samples, side: Side, where: str, options: ImportOptions, findings: Findings) -> Landed:
    """``loads`` of the foot of ``side`` at ``time``, with its contacts; their signs are decided here."""
    loads = without_offset(loads, f"the {side} foot's vertical load", where, findings)
    contacts = events.contacts(loads.time, loads.vertical, options.threshold)
    rate = (len(loads.time) - 1) / (loads.time[-1] - loads.time[0])
    sign = signs.detected(names.FORWARD, loads.time, loads.forward, contacts)
    if sign is None and any(c.begun and c.ended for c in contacts):
        findings.suspect(f"{where}: the {side} foot's fore-aft load does not tell its sign; taken as forward positive")
    forward = (sign or 1) * loads.forward
    if sign is not None:
        findings.map(
            **{"channel": names.FORWARD, "side": side, "file": where, "column": "as above", "unit": "N", "sign": sign},
            **{"zero": 0.0, "why": signs.RULES[names.FORWARD]},
        )
    impulses = []
    for c in contacts:
        if c.begun and c.ended:
            inside = (loads.time >= c.strike) & (loads.time <= c.lift)
            impulses.append(float(np.trapezoid(loads.vertical[inside], loads.time[inside])))
    on_ground = np.zeros(len(time), dtype=bool)
    for c in contacts:
        on_ground |= (time >= c.strike) & (time <= c.lift)
    measured = (time >= loads.time[0]) & (time <= loads.time[-1])

    def resampled(samples: Samples, free: float = 0.0) -> Samples:
        smooth = filters.low_pass(filters.bridged(samples, loads.time), rate, options.load_cutoff)
        here = np.interp(time, loads.time, smooth)
        return np.where(measured, np.where(on_ground, here, free), np.nan)

    vertical, along = resampled(loads.vertical), resampled(forward)
    point = None
    if loads.point is not None:
        # The moment is smooth where the point is not, so that is what is filtered.
        known = np.isfinite(loads.point[:, 0]) & (loads.vertical > options.threshold)
        ahead = np.where(known, loads.vertical * np.nan_to_num(loads.point[:, 0]), 0.0)
        level = float(np.median(loads.point[known, 1])) if known.any() else 0.0
        place = np.divide(resampled(ahead), vertical, out=np.zeros(len(time)), where=vertical > options.threshold)
        point = np.stack([place, np.full(len(time), level)], axis=1)
    return Landed(contacts, vertical, along, point, tuple(impulses))


def signed(column: Column, contacts: Sequence[Contact], side: Side, findings: Findings) -> Samples:
    """The column's values with the sign that is right here, which is reported with its reason."""
    choice = column.choice
    by_data = signs.detected(column.channel, column.time, column.values, contacts)
    zero = 0.0
    if choice and choice.sign is not None:
        sign, why = choice.sign, "as given"
    elif by_data is not None:
        sign, why = by_data, signs.RULES[column.channel]
        if choice is None and sign != column.named_sign:
            why += "; its name would say the opposite"
    else:
        sign, why = column.named_sign, "by its name"
    values = sign * column.values
    if choice and choice.zero is not None:
        zero = choice.zero
        why += "; zero as given"
    elif column.channel == "ankle_angle" and abs(np.nanmedian(values)) > 45.0:
        zero = signs.right_angle(values)
        findings.suspect(
            f"{column.file}: '{column.label}' is {sign * zero * np.pi / 180.0:.4f} rad ({sign * zero:.0f} degrees) in "
            "standing; this was taken off"
        )
        why += "; zero is the nearest right angle"
    if AGAINST in column.why_unit:
        findings.suspect(f"{column.file}: inDegrees is wrong: by how far the knee moves, angles are in {column.unit}")
    if column.channel != names.TILT:
        findings.map(
            **{"channel": column.channel, "side": side, "file": column.file, "column": column.label},
            **{"unit": column.unit, "sign": sign, "zero": zero, "why": f"unit {column.why_unit}; sign: {why}"},
        )
    if column.channel in ("hip_angle", "ankle_angle"):
        stuck = signs.clipped(values)
        if stuck is not None:
            findings.suspect(
                f"{column.file}: '{column.label}' stands at {stuck[0]:.1f} degrees for {100 * stuck[1]:.0f} % of the "
                "time: it looks clipped by a model's bound"
            )
    return np.asarray(values - zero, dtype=np.float64)


def zeroed(
    time: Samples,
    angles: dict[str, Samples],
    shank_is_free: bool,
    contacts: Sequence[Contact],
    side: Side,
    where: str,
    options: ImportOptions,
    findings: Findings,
) -> None:
    """Make the foot flat where it is flat, in place: by the shank's zero if that is free, else by the ankle's."""
    pitch = angles["shank_angle"] - angles["ankle_angle"]
    off = signs.flat_foot(time, pitch, contacts)
    given = options.chosen.channels.get((side, "ankle_angle"))
    if off is None:
        findings.suspect(f"{where}: no whole stance of the {side} foot, so nothing says where it is flat")
        return
    if shank_is_free:
        angles["shank_angle"] = angles["shank_angle"] - off
        findings.derive(
            "Shank inclination: knee minus hip, plus a constant that makes the foot flat between a quarter and a half "
            "of stance; pelvis and trunk are taken not to tilt"
        )
        return
    if options.ankle_zero == "file" or (given is not None and given.zero is not None):
        if abs(off) > NOTED_PITCH:
            findings.suspect(f"{where}: the {side} foot is pitched by {off:.1f} degrees where it should be flat")
        return
    angles["ankle_angle"] = angles["ankle_angle"] + off
    findings.derive("Zero of the ankle: where the foot is flat between a quarter and a half of stance (--ankle-zero)")
    if abs(off) > NOTED_PITCH:
        findings.suspect(
            f"{where}: with its own zero the {side} foot is pitched by {off:.1f} degrees where it is flat; the ankle's "
            "zero was moved by as much"
        )


def power(time: Samples, moment: Samples, ankle: Samples) -> Samples:
    """Net ankle power [W]: moment times plantarflexion rate; generation positive."""
    return np.asarray(-moment * np.gradient(np.radians(ankle), time), dtype=np.float64)
