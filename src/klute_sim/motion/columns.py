"""Finding a channel's column in a trial's files, and bringing it to the units used here."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from klute_sim.dataset import quantity
from klute_sim.errors import InputError
from klute_sim.motion import names, signs
from klute_sim.motion.findings import Findings
from klute_sim.motion.mapping import BODY, PROSTHESIS, Choice
from klute_sim.motion.names import Side
from klute_sim.motion.options import ImportOptions
from klute_sim.motion.sources import STORAGE, Source
from klute_sim.recording.recording import Samples
from klute_sim.rigs.gait.reference import GRAVITY

PER_KG = {"N*m/kg": "N*m", "N/kg": "N", "W/kg": "W", "N m/kg": "N*m"}
WEIGHTS = ("BW", "body weight", "body_weight")
AGAINST = "by how far the knee moves, though the header says"
"""Why a unit is not the stated one."""
_UNIT = {
    **dict.fromkeys(names.ANGLES, "deg"),
    names.MOMENT: "N*m",
    names.POWER: "W",
    names.BELT: "m/s",
    names.TRAVEL: "m",
    **dict.fromkeys(names.PLACES, "m"),
    names.COMMAND: "bar",
    names.PRESSURE: "bar",
    names.LENGTH: "mm",
}


@dataclass(frozen=True, eq=False)
class Column:
    """A channel as it was found."""

    channel: str
    source: Source
    label: str
    time: Samples
    values: Samples
    """In degrees, N, N.m, W, m/s or m, pressures in bar and a muscle's length in mm; the sign is the file's."""
    unit: str
    """Of the file."""
    why_unit: str
    named_sign: int
    choice: Choice | None
    """What the user said."""

    @property
    def file(self) -> str:
        """Its name."""
        return self.source.name


def find(trial: Sequence[Source], channel: str, side: Side | None, options: ImportOptions) -> Column | None:
    """The column of ``channel`` of ``side`` (None: of the whole body); None where there is none.

    A column whose label names no side is taken for the side asked for (``--side``, or the right one).
    """
    owner = PROSTHESIS if channel in names.PROSTHESIS else side or BODY
    choice = options.chosen.channels.get((owner, channel))
    if choice is not None:
        for source in trial:
            if choice.column in source.labels:
                if not np.isfinite(source.column(choice.column)).any():
                    raise InputError(f"{source.where}: column '{choice.column}' holds no number")
                return _column(source, choice.column, channel, 1, choice, options)
        raise InputError(f"{trial[0].where}: there is no column '{choice.column}', which is to be {channel}")
    for source in trial:
        for label in source.labels:
            meant = names.named(label.split("[")[0].strip())
            if meant is None or meant.channel != channel:
                continue
            unsided = meant.side is None and side == (options.side or "right")
            if (meant.side == side or unsided) and np.isfinite(source.column(label)).any():
                return _column(source, label, channel, meant.sign, None, options)
    return None


def _column(
    source: Source, label: str, channel: str, sign: int, choice: Choice | None, options: ImportOptions
) -> Column:
    values = source.column(label)
    unit, why = _unit(source, label, channel, values, choice)
    return Column(
        channel, source, label, time(source), _converted(values, channel, unit, label, options), unit, why, sign, choice
    )


def _unit(source: Source, label: str, channel: str, values: Samples, choice: Choice | None) -> tuple[str, str]:
    """The unit of a column, and how it is known."""
    if choice and choice.unit:
        return choice.unit, "as given"
    stated = source.units.get(label)
    if channel in names.ANGLES and source.kind == STORAGE:
        knee = next((other for other in source.labels if (names.named(other) or (None,))[0] == "knee_angle"), label)
        by_size = signs.angle_unit(source.column(knee))
        if stated and by_size != stated:
            return by_size, f"{AGAINST} {stated}"
    if stated:
        return stated, "stated"
    if channel in names.PROSTHESIS:
        raise InputError(
            f"{source.where}: column '{label}' has no unit; head it '{channel} [{_UNIT.get(channel, 'N')}]', or give "
            "the unit in a file for --map, under [prosthesis]"
        )
    by_size = _unit_of(channel, _sized(source, channel, values))
    return by_size, "assumed" if channel in (names.BELT, names.TRAVEL, *names.PLACES) else "by its size"


def time(source: Source) -> Samples:
    """The clock of ``source`` [s], rising strictly; raises InputError where it has none."""
    label = source.time_label
    if label is None:
        raise InputError(f"{source.where}: there is no column 'time'")
    clock = source.column(label)
    if len(clock) < 20:
        raise InputError(f"{source.where} has {len(clock)} rows; a stride needs 20 or more")
    if not np.isfinite(clock).all() or not np.all(np.diff(clock) > 0.0):
        row = int(np.argmax(~(np.diff(clock) > 0.0))) + 2
        raise InputError(f"{source.where}: column '{label}' must rise strictly; it does not at row {row}")
    unit = source.units.get(label, "s") or "s"
    factor = quantity.factor(unit, "s")
    if factor is None:
        raise InputError(f"{source.where}: column '{label}' is in '{unit}'; allowed: {quantity.EXAMPLES['s']}")
    return np.asarray(clock * factor + source.shift, dtype=np.float64)


def _sized(source: Source, channel: str, values: Samples) -> Samples:
    """What tells the unit of ``values``: of a ground reaction all axes together, for the lateral one is small."""
    if not channel.startswith("grf"):
        return values
    meant = {label: names.named(label.split("[")[0].strip()) for label in source.labels}
    axes = [source.column(label) for label, of in meant.items() if of is not None and of.channel.startswith("grf")]
    return np.concatenate([values, *axes])


def _unit_of(channel: str, values: Samples) -> str:
    """A unit that was not stated, from the size of what walking makes of it."""
    if channel in names.ANGLES:
        return signs.angle_unit(values)
    largest = float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else 0.0
    if channel == names.MOMENT:
        return "N*m/kg" if largest < 5.0 else "N*m"
    if channel == names.POWER:
        return "W/kg" if largest < 15.0 else "W"
    if channel.startswith("grf"):
        return "BW" if largest < 4.0 else "N/kg" if largest < 40.0 else "N"
    return _UNIT[channel]


def _converted(values: Samples, channel: str, unit: str, label: str, options: ImportOptions) -> Samples:
    wanted = _UNIT.get(channel, "N")
    per_body = PER_KG.get(unit) == wanted or (unit in WEIGHTS and wanted == "N")
    if per_body:
        if options.mass is None:
            raise InputError(f"column '{label}' is in {unit}: --mass is needed to make it {wanted}")
        return np.asarray(values * options.mass * (GRAVITY if unit in WEIGHTS else 1.0), dtype=np.float64)
    if wanted == "deg" and unit.lower() in ("deg", "degree", "degrees"):
        return values
    base = "rad" if wanted == "deg" else wanted
    factor = quantity.between(unit, base)
    if factor is None:
        raise InputError(
            f"column '{label}' is in '{unit}', which is no unit of {channel}; write for example '{wanted}'"
        )
    scaled = np.asarray(values * factor, dtype=np.float64)
    return np.degrees(scaled) if wanted == "deg" else scaled


def told(column: Column, side: str, findings: Findings) -> Samples:
    """The values of a ``column`` whose sign nothing tells, as they are or as the user said; reported."""
    choice = column.choice
    sign, zero = (choice and choice.sign) or 1, (choice and choice.zero) or 0.0
    findings.map(
        **{"channel": column.channel, "side": side, "file": column.file, "column": column.label, "unit": column.unit},
        **{"sign": sign, "zero": zero, "why": f"unit {column.why_unit}"},
    )
    return np.asarray(sign * column.values - zero, dtype=np.float64)
