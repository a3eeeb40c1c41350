"""What was measured of a prosthesis: its own log, its encoder, and a moment that somebody derived."""

from collections.abc import Mapping, Sequence

import numpy as np

from klute_sim.dataset.events import Contact
from klute_sim.motion import clocks, columns, filters, names
from klute_sim.motion.clocks import Series
from klute_sim.motion.columns import Column
from klute_sim.motion.findings import Findings
from klute_sim.motion.finish import signed, zeroed
from klute_sim.motion.moving import Moving
from klute_sim.motion.names import Side
from klute_sim.motion.options import ImportOptions
from klute_sim.motion.sources import Source

ATMOSPHERE = (0.85, 1.1)
"""Pressure [bar] above what was commanded that looks like an absolute one (assumed)."""
ANKLE = "ankle_angle"


def sensed(
    trial: Sequence[Source],
    found: Moving,
    contacts: Sequence[Contact],
    side: Side,
    options: ImportOptions,
    findings: Findings,
) -> dict[str, Series]:
    """What the files of ``trial`` measured, and the pressure commanded; angle [deg], pressures [bar], length [mm]."""
    where, own = trial[0].name, {}
    for name in names.PROSTHESIS:
        column = columns.find(trial, name, None, options)
        if column is not None:
            own[name] = Series(column.time, columns.told(column, "prosthesis", findings))
    if names.COMMAND in own:
        asked = own[names.COMMAND]
        own[names.COMMAND] = Series(asked.time, filters.bridged(asked.value, asked.time))
    angle = _angle(trial, found, contacts, side, options, findings)
    if angle is not None:
        own[ANKLE] = angle
        if options.ankle_zero == "foot-flat":
            shank = found.channels["shank_angle"]
            angles = {ANKLE: angle.value, "shank_angle": np.interp(angle.time, *shank)}
            zeroed(angle.time, angles, False, contacts, side, where, options, findings)
            own[ANKLE] = Series(angle.time, angles[ANKLE])
    moment = columns.find(trial, names.MOMENT, side, options)
    if moment is not None:
        own[names.MOMENT] = Series(moment.time, signed(moment, contacts, side, findings))
    _doubt(own, where, findings)
    return own


def _angle(
    trial: Sequence[Source],
    found: Moving,
    contacts: Sequence[Contact],
    side: Side,
    options: ImportOptions,
    findings: Findings,
) -> Series | None:
    """The ankle's angle: of the prosthesis' encoder, else of a column, else of the markers; held against the next."""
    known: list[tuple[str, Series]] = []
    for column in _columns(trial, side, options):
        known.append((column.file, Series(column.time, signed(column, contacts, side, findings))))
    if found.ankle is not None:
        known.append((trial[0].name if len(known) == 0 else "the markers", found.ankle))
    if not known:
        return None
    if known[0][1] is found.ankle:
        findings.derive(
            "Ankle angle: of the line from heel to toe against the shank, by markers, for no encoder was logged"
        )
    if len(known) > 1:
        clocks.compare("the ankle's angle", known[0], known[1], findings)
    return known[0][1]


def _columns(trial: Sequence[Source], side: Side, options: ImportOptions) -> list[Column]:
    """Columns of the ankle's angle: the one that the user names, else the log's before the others'."""
    if (side, ANKLE) in options.chosen.channels:
        groups = [list(trial)]
    else:
        logs = [source for source in trial if "log" in source.roles(options.chosen)]
        groups = [logs, [source for source in trial if source not in logs]]
    found = [columns.find(files, ANKLE, side, options) for files in groups if files]
    return [column for column in found if column is not None]


def _doubt(own: Mapping[str, Series], where: str, findings: Findings) -> None:
    """Doubt what may be read otherwise than the instrument meant it."""
    if {names.COMMAND, names.PRESSURE} <= set(own):
        asked, had = own[names.COMMAND], own[names.PRESSURE]
        more = float(np.nanmedian(had.value - np.interp(had.time, *asked)))
        if ATMOSPHERE[0] <= more <= ATMOSPHERE[1]:
            findings.suspect(f"{where}: the pressure is {more:.2f} bar above what was commanded: is it absolute?")
    if names.FORCE in own and np.nanmean(own[names.FORCE].value) < 0.0:
        findings.suspect(f"{where}: the force is mostly negative; tension is positive (sign = -1 in a file for --map)")
