"""Finding a channel's column in a trial's files, and bringing it to the units used here."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from klute_sim.datasets import quantity
from klute_sim.errors import InputError
from klute_sim.gait.reference import GRAVITY
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import channel_names, conventions
from klute_sim.mocap.parsing.channel_names import Side
from klute_sim.mocap.parsing.mapping import BODY_SECTION, PROSTHESIS_SECTION, ColumnSpec
from klute_sim.mocap.parsing.sources import OPENSIM_STORAGE, SourceFile
from klute_sim.recording.recording import Array

PER_KG_UNITS = {"N*m/kg": "N*m", "N/kg": "N", "W/kg": "W", "N m/kg": "N*m"}
BODY_WEIGHT_UNITS = ("BW", "body weight", "body_weight")
HEADER_CONTRADICTION = "by how far the knee moves, though the header says"
"""Why a unit is not the stated one."""
_CHANNEL_UNITS = {
    **dict.fromkeys(channel_names.ANGLE_CHANNELS, "deg"),
    channel_names.ANKLE_MOMENT: "N*m",
    channel_names.ANKLE_POWER: "W",
    channel_names.BELT_SPEED: "m/s",
    channel_names.PELVIS_X: "m",
    **dict.fromkeys(channel_names.POSITION_CHANNELS, "m"),
    channel_names.PRESSURE_COMMAND: "bar",
    channel_names.MUSCLE_PRESSURE: "bar",
    channel_names.MUSCLE_LENGTH: "mm",
}


@dataclass(frozen=True, eq=False)
class Column:
    """A channel as it was found."""

    channel: str
    source: SourceFile
    label: str
    time: Array
    values: Array
    """In degrees, N, N.m, W, m/s or m, pressures in bar and a muscle's length in mm; the sign is the file's."""
    unit: str
    """Of the file."""
    unit_reason: str
    label_sign: int
    spec: ColumnSpec | None
    """What the user said."""

    @property
    def file_name(self) -> str:
        """Its name."""
        return self.source.name


def find_column(trial: Sequence[SourceFile], channel: str, side: Side | None, options: ImportOptions) -> Column | None:
    """The column of ``channel`` of ``side`` (None: of the whole body); None where there is none.

    A column whose label names no side is taken for the side asked for (``--side``, or the right one).
    """
    owner = PROSTHESIS_SECTION if channel in channel_names.PROSTHESIS_CHANNELS else side or BODY_SECTION
    choice = options.mapping.channels.get((owner, channel))
    if choice is not None:
        for source in trial:
            if choice.column in source.labels:
                if not np.isfinite(source.get_column(choice.column)).any():
                    raise InputError(f"{source.path}: column '{choice.column}' holds no number")
                return _make_column(source, choice.column, channel, 1, choice, options)
        raise InputError(f"{trial[0].path}: there is no column '{choice.column}', which is to be {channel}")
    for source in trial:
        for label in source.labels:
            meant = channel_names.parse_channel_label(label.split("[")[0].strip())
            if meant is None or meant.channel != channel:
                continue
            unsided = meant.side is None and side == (options.side or "right")
            if (meant.side == side or unsided) and np.isfinite(source.get_column(label)).any():
                return _make_column(source, label, channel, meant.sign, None, options)
    return None


def _make_column(
    source: SourceFile, label: str, channel: str, sign: int, spec: ColumnSpec | None, options: ImportOptions
) -> Column:
    values = source.get_column(label)
    unit, why = _detect_unit(source, label, channel, values, spec)
    return Column(
        channel,
        source,
        label,
        read_time(source),
        _convert_units(values, channel, unit, label, options),
        unit,
        why,
        sign,
        spec,
    )


def _detect_unit(
    source: SourceFile, label: str, channel: str, values: Array, spec: ColumnSpec | None
) -> tuple[str, str]:
    """The unit of a column, and how it is known."""
    if spec and spec.unit:
        return spec.unit, "as given"
    stated = source.units.get(label)
    if channel in channel_names.ANGLE_CHANNELS and source.file_type == OPENSIM_STORAGE:
        knee = next(
            (
                other
                for other in source.labels
                if (channel_names.parse_channel_label(other) or (None,))[0] == "knee_angle"
            ),
            label,
        )
        by_size = conventions.detect_angle_unit(source.get_column(knee))
        if stated and by_size != stated:
            return by_size, f"{HEADER_CONTRADICTION} {stated}"
    if stated:
        return stated, "stated"
    if channel in channel_names.PROSTHESIS_CHANNELS:
        raise InputError(
            f"{source.path}: column '{label}' has no unit; head it '{channel} [{_CHANNEL_UNITS.get(channel, 'N')}]', or give "
            "the unit in a file for --map, under [prosthesis]"
        )
    by_size = _guess_unit(channel, _select_unit_evidence(source, channel, values))
    return by_size, "assumed" if channel in (
        channel_names.BELT_SPEED,
        channel_names.PELVIS_X,
        *channel_names.POSITION_CHANNELS,
    ) else "by its size"


def read_time(source: SourceFile) -> Array:
    """The clock of ``source`` [s], rising strictly; raises InputError where it has none."""
    label = source.time_label
    if label is None:
        raise InputError(f"{source.path}: there is no column 'time'")
    clock = source.get_column(label)
    if len(clock) < 20:
        raise InputError(f"{source.path} has {len(clock)} rows; a stride needs 20 or more")
    if not np.isfinite(clock).all() or not np.all(np.diff(clock) > 0.0):
        row = int(np.argmax(~(np.diff(clock) > 0.0))) + 2
        raise InputError(f"{source.path}: column '{label}' must rise strictly; it does not at row {row}")
    unit = source.units.get(label, "s") or "s"
    factor = quantity.get_si_factor(unit, "s")
    if factor is None:
        raise InputError(f"{source.path}: column '{label}' is in '{unit}'; allowed: {quantity.EXAMPLE_UNITS['s']}")
    return np.asarray(clock * factor + source.time_offset, dtype=np.float64)


def _select_unit_evidence(source: SourceFile, channel: str, values: Array) -> Array:
    """What tells the unit of ``values``: of a ground reaction all axes together, for the lateral one is small."""
    if not channel.startswith("grf"):
        return values
    meant = {label: channel_names.parse_channel_label(label.split("[")[0].strip()) for label in source.labels}
    axes = [source.get_column(label) for label, of in meant.items() if of is not None and of.channel.startswith("grf")]
    return np.concatenate([values, *axes])


def _guess_unit(channel: str, values: Array) -> str:
    """A unit that was not stated, from the size of what walking makes of it."""
    if channel in channel_names.ANGLE_CHANNELS:
        return conventions.detect_angle_unit(values)
    largest = float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else 0.0
    if channel == channel_names.ANKLE_MOMENT:
        return "N*m/kg" if largest < 5.0 else "N*m"
    if channel == channel_names.ANKLE_POWER:
        return "W/kg" if largest < 15.0 else "W"
    if channel.startswith("grf"):
        return "BW" if largest < 4.0 else "N/kg" if largest < 40.0 else "N"
    return _CHANNEL_UNITS[channel]


def _convert_units(values: Array, channel: str, unit: str, label: str, options: ImportOptions) -> Array:
    wanted = _CHANNEL_UNITS.get(channel, "N")
    per_body = PER_KG_UNITS.get(unit) == wanted or (unit in BODY_WEIGHT_UNITS and wanted == "N")
    if per_body:
        if options.mass is None:
            raise InputError(f"column '{label}' is in {unit}: --mass is needed to make it {wanted}")
        return np.asarray(values * options.mass * (GRAVITY if unit in BODY_WEIGHT_UNITS else 1.0), dtype=np.float64)
    if wanted == "deg" and unit.lower() in ("deg", "degree", "degrees"):
        return values
    base = "rad" if wanted == "deg" else wanted
    factor = quantity.get_conversion_factor(unit, base)
    if factor is None:
        raise InputError(
            f"column '{label}' is in '{unit}', which is no unit of {channel}; write for example '{wanted}'"
        )
    scaled = np.asarray(values * factor, dtype=np.float64)
    return np.degrees(scaled) if wanted == "deg" else scaled


def apply_given_sign(column: Column, side: str, log: ImportLog) -> Array:
    """The values of a ``column`` whose sign nothing tells, as they are or as the user said; reported."""
    choice = column.spec
    sign, zero = (choice and choice.sign) or 1, (choice and choice.zero) or 0.0
    log.add_channel(
        **{
            "channel": column.channel,
            "side": side,
            "file": column.file_name,
            "column": column.label,
            "unit": column.unit,
        },
        **{"sign": sign, "zero": zero, "why": f"unit {column.unit_reason}"},
    )
    return np.asarray(sign * column.values - zero, dtype=np.float64)
