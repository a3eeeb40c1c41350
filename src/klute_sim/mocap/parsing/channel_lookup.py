"""Lookup of the column of a channel in the files of a trial, and its conversion to standard units."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from klute_sim.constants import GRAVITY
from klute_sim.datasets import unit_conversion
from klute_sim.errors import InputError
from klute_sim.files.lines import check_time_stamps
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import channel_names, conventions
from klute_sim.mocap.parsing.channel_names import Side, parse_channel_label
from klute_sim.mocap.parsing.mapping import BODY_SECTION, PROSTHESIS_SECTION, ColumnSpec
from klute_sim.mocap.parsing.sources import OPENSIM_STORAGE, SourceFile
from klute_sim.types import Array

PER_KG_UNITS = {
    **dict.fromkeys(("N*m/kg", "N m/kg", "N.m/kg", "Nm/kg"), "N*m"),
    **{"N/kg": "N", "W/kg": "W"},
}
"""Unit per body mass -> unit."""
BODY_WEIGHT_UNITS = {"BW": 1.0, "body weight": 1.0, "body_weight": 1.0, "%BW": 0.01, "% BW": 0.01}
"""Name of the body weight as a unit of force -> body weights."""
HEADER_CONTRADICTION = "by the range of the knee angle, although the header states"
"""Reason for a unit other than the stated one."""
MIN_ROWS = 20
"""Smallest number of rows of a file with a time column."""
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
    """Column of a channel in standard units, with the sign of the file."""

    channel: str
    """Standard channel name."""
    source: SourceFile
    """File of the column."""
    label: str
    """Label in the file."""
    time: Array
    """Sample times (n,) [s]."""
    values: Array
    """Samples (n,) in degrees, N, N.m, W, m/s, m, bar (pressures) or mm (muscle length)."""
    unit: str
    """Unit in the file."""
    unit_reason: str
    """Explanation of how the unit was determined."""
    label_sign: int
    """Sign by the label."""
    spec: ColumnSpec | None
    """User's specification."""
    zero: float | None
    """Its zero, in the unit of the values; None if it states none."""

    @property
    def file_name(self) -> str:
        """Name of the file."""
        return self.source.name


def find_column(trial: Sequence[SourceFile], channel: str, side: Side | None, options: ImportOptions) -> Column | None:
    """Return the column of ``channel`` of the leg of ``side`` (None: of the body); None if there is none.

    A column whose label names no side belongs to the requested side (``--side``, right by default).
    """
    section = PROSTHESIS_SECTION if channel in channel_names.PROSTHESIS_CHANNELS else side or BODY_SECTION
    spec = options.mapping.channels.get((section, channel))
    if spec is not None:
        for source in trial:
            if spec.column in source.labels:
                if not np.isfinite(source.get_column(spec.column)).any():
                    raise InputError(f"{source.path}: column '{spec.column}' contains no numbers")
                return _make_column(source, spec.column, channel, 1, spec, options)
        raise InputError(f"{trial[0].path}: column '{spec.column}' of the channel {channel} is missing")
    for source in trial:
        for label in source.labels:
            parsed = parse_channel_label(label)
            if parsed is None or parsed.channel != channel:
                continue
            side_assumed = parsed.side is None and side == (options.side or "right")
            if (parsed.side == side or side_assumed) and np.isfinite(source.get_column(label)).any():
                return _make_column(source, label, channel, parsed.sign, None, options)
    return None


def _make_column(
    source: SourceFile, label: str, channel: str, sign: int, spec: ColumnSpec | None, options: ImportOptions
) -> Column:
    values = source.get_column(label)
    unit, reason = _detect_unit(source, label, channel, values, spec, options)
    time = read_time(source)
    converted = _convert_units(values, channel, unit, label, options)
    zero = None
    if spec is not None and spec.zero is not None:
        zero = float(_convert_units(np.array(spec.zero), channel, unit, label, options))
    return Column(channel, source, label, time, converted, unit, reason, sign, spec, zero)


def _detect_unit(
    source: SourceFile, label: str, channel: str, values: Array, spec: ColumnSpec | None, options: ImportOptions
) -> tuple[str, str]:
    """Return the unit of a column and how it was determined."""
    if spec and spec.unit:
        return spec.unit, "as specified"
    stated_unit = source.units.get(label)
    if channel in channel_names.ANGLE_CHANNELS and source.file_type == OPENSIM_STORAGE:
        knees = _collect_columns(source, ("knee_angle",), options)
        detected_unit = conventions.detect_angle_unit(knees) if knees else stated_unit
        if stated_unit and detected_unit and detected_unit != stated_unit:
            return detected_unit, f"{HEADER_CONTRADICTION} {stated_unit}"
    if stated_unit:
        return stated_unit, "stated"
    if channel in channel_names.PROSTHESIS_CHANNELS:
        raise InputError(
            f"{source.path}: column '{label}' has no unit; write the heading '{channel} "
            f"[{_CHANNEL_UNITS.get(channel, 'N')}]', or give the unit in a file for --map, under [prosthesis]"
        )
    if channel in channel_names.ANGLE_CHANNELS:
        return _guess_angle_unit(source, label, options), "by the magnitude"
    unit = _guess_unit(channel, _select_unit_evidence(source, channel, values))
    unambiguous = (channel_names.BELT_SPEED, channel_names.PELVIS_X, *channel_names.POSITION_CHANNELS)
    return unit, "assumed" if channel in unambiguous else "by the magnitude"


def _collect_columns(source: SourceFile, channels: Collection[str], options: ImportOptions) -> list[Array]:
    """Return the columns of ``source`` that hold one of ``channels``, of any side, without empty ones."""
    specified = {spec.column for (_, channel), spec in options.mapping.channels.items() if channel in channels}
    parsed_labels = {label: parse_channel_label(label) for label in source.labels}
    columns = [
        source.get_column(label)
        for label, parsed in parsed_labels.items()
        if label in specified or (parsed is not None and parsed.channel in channels)
    ]
    return [column for column in columns if np.isfinite(column).any()]


def _guess_angle_unit(source: SourceFile, label: str, options: ImportOptions) -> str:
    """Return the unit of the angles of ``source`` by its knee angles, or by its other joint angles without these.

    Raises InputError for a pelvis tilt alone, which may move by as many degrees as a joint by radians.
    """
    joints = [channel for channel in channel_names.ANGLE_CHANNELS if channel != channel_names.PELVIS_TILT]
    angles = _collect_columns(source, ("knee_angle",), options) or _collect_columns(source, joints, options)
    if not angles:
        raise InputError(
            f"{source.path}: column '{label}' has no unit, and the file has no joint angle that shows it; write the "
            f"heading '{label} [deg]', or give the unit in a file for --map, under [body]"
        )
    return conventions.detect_angle_unit(angles)


def read_time(source: SourceFile) -> Array:
    """Return the strictly increasing times of ``source`` [s]; raise InputError without a valid time column."""
    label = source.time_label
    if label is None:
        raise InputError(f"{source.path}: column 'time' is missing")
    time = source.get_column(label)
    if len(time) < MIN_ROWS:
        raise InputError(f"{source.path} has {len(time)} rows; a stride needs {MIN_ROWS} or more")
    if not np.isfinite(time).all() or not np.all(np.diff(time) > 0.0):
        row = int(np.argmax(~(np.diff(time) > 0.0))) + 2
        raise InputError(f"{source.path}: column '{label}' must increase strictly; it does not at row {row}")
    unit = source.units.get(label, "s") or "s"
    factor = unit_conversion.get_si_factor(unit, "s")
    if factor is None:
        raise InputError(
            f"{source.path}: column '{label}' is in '{unit}'; allowed: {unit_conversion.EXAMPLE_UNITS['s']}"
        )
    check_time_stamps(time * factor, source.path)
    return np.asarray(time * factor + source.time_offset, dtype=np.float64)


def _select_unit_evidence(source: SourceFile, channel: str, values: Array) -> Array:
    """Return the samples whose magnitude shows the unit: all axes of a ground reaction, as lateral loads are small."""
    if not channel.startswith("grf"):
        return values
    parsed_labels = {label: parse_channel_label(label) for label in source.labels}
    axes = [
        source.get_column(label)
        for label, parsed in parsed_labels.items()
        if parsed is not None and parsed.channel.startswith("grf")
    ]
    return np.concatenate([values, *axes])


def _guess_unit(channel: str, values: Array) -> str:
    """Return the most plausible unit of ``values`` for walking, of a channel that is no angle."""
    magnitude = float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else 0.0
    if channel == channel_names.ANKLE_MOMENT:
        return "N*m/kg" if magnitude < 5.0 else "N*m"
    if channel == channel_names.ANKLE_POWER:
        return "W/kg" if magnitude < 15.0 else "W"
    if channel.startswith("grf"):
        return "BW" if magnitude < 4.0 else "N/kg" if magnitude < 40.0 else "N"
    return _CHANNEL_UNITS[channel]


def _convert_units(values: Array, channel: str, unit: str, label: str, options: ImportOptions) -> Array:
    standard_unit = _CHANNEL_UNITS.get(channel, "N")
    is_normalized = PER_KG_UNITS.get(unit) == standard_unit or (unit in BODY_WEIGHT_UNITS and standard_unit == "N")
    if is_normalized:
        if options.mass is None:
            raise InputError(f"column '{label}' is in {unit}: pass --mass to convert it to {standard_unit}")
        per_mass = GRAVITY * BODY_WEIGHT_UNITS[unit] if unit in BODY_WEIGHT_UNITS else 1.0
        return np.asarray(values * options.mass * per_mass, dtype=np.float64)
    if standard_unit == "deg" and unit.lower() in ("deg", "degree", "degrees"):
        return values
    base_unit = "rad" if standard_unit == "deg" else standard_unit
    factor = unit_conversion.get_conversion_factor(unit, base_unit)
    if factor is None:
        examples = [standard_unit, *[per_kg for per_kg, base in PER_KG_UNITS.items() if base == standard_unit][:1]]
        examples += ["BW"] if standard_unit == "N" else []
        raise InputError(
            f"column '{label}' is in '{unit}', which is not a unit of {channel}; use for example "
            + " or ".join(f"'{example}'" for example in examples)
        )
    scaled = np.asarray(values * factor, dtype=np.float64)
    return np.degrees(scaled) if standard_unit == "deg" else scaled


def apply_given_sign(column: Column, side: str, log: ImportLog) -> Array:
    """Return the values of a ``column`` whose sign cannot be detected, with the user's sign and zero, and log them."""
    spec = column.spec
    sign, logged_zero = (spec and spec.sign) or 1, (spec and spec.zero) or 0.0
    log.add_channel(
        **{"channel": column.channel, "side": side, "file": column.file_name, "column": column.label},
        **{"unit": column.unit, "sign": sign, "zero": logged_zero, "reason": f"unit {column.unit_reason}"},
    )
    return np.asarray(sign * column.values - (column.zero or 0.0), dtype=np.float64)
