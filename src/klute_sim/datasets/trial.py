"""One trial: its prescribed and measured channels, each with the time axis of its own file."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Literal, NamedTuple

import numpy as np

from klute_sim.datasets import channels, unit_conversion
from klute_sim.datasets.channels import TIME_COLUMN, ChannelSource, get_measured_units, get_prescribed_units
from klute_sim.datasets.column_mapping import NO_MAPPING, ColumnMapping
from klute_sim.datasets.foot_load import (
    MAX_UNREPORTED_OFFSET,
    estimate_plate_offset,
    find_loaded_samples,
    interpolate_load_mask,
)
from klute_sim.datasets.trial_files import table
from klute_sim.datasets.trial_files.column_assignment import format_columns, states_unit
from klute_sim.datasets.trial_files.table import Table
from klute_sim.device.device import Device
from klute_sim.errors import InputError
from klute_sim.plausibility.bench.time_axis import list_usual_units
from klute_sim.types import Array

Use = Literal["fit", "validation", "test"]
"""Use of a trial: fit parameters, select effects, or evaluate the final model."""

COMMAND_CHANNEL = "pressure_command"
"""Prescribed channel that a device without a supply does not need."""
PRESSURE_CHANNEL = "pressure"
"""Measured channel that can stand for the command."""
PLATE_FORCES = (channels.VERTICAL_FORCE, "grf_forward")
"""Prescribed channels of a force plate that may have an offset."""
MIN_SAMPLES = 10
"""Minimum number of samples of a channel, not counting missing ones."""
MIN_OVERLAP_INTERVALS, MIN_OVERLAP_TIME = 2.0, 5e-3
"""Shortest time that all channels share: in sampling intervals of the slower of the two that end first and start last,
and in seconds (assumed: ten time steps of a simulation)."""

DAYS_OF_DATES = 36526.0, 73051.0
"""Numbers of the first days of 2000 and 2100 in spreadsheets."""


class TimeSeries(NamedTuple):
    """Samples of one channel in SI units."""

    time: Array
    """Time [s], finite and strictly increasing; shared by the channels of one file with the same delay."""
    value: Array
    """Value [SI] at each time; NaN where a measured channel has no sample."""

    @property
    def sampling_interval(self) -> float:
        """Median time between samples [s]; infinite for fewer than two samples."""
        return float(np.median(np.diff(self.time))) if len(self.time) > 1 else float("inf")


class SensorLimits(NamedTuple):
    """Readings at which a sensor saturates."""

    low: float
    """Smallest reading [SI]; -inf without one."""
    high: float
    """Largest reading [SI]; inf without one."""


class InitialState(NamedTuple):
    """Stated positions, velocities and pressures of a mechanism at the start of a trial."""

    positions: Mapping[str, float] = {}
    """Joint -> position [rad or m]."""
    velocities: Mapping[str, float] = {}
    """Joint -> velocity [rad/s or m/s] with which it starts at its position; other joints start in equilibrium."""
    pressures: Mapping[str, float] = {}
    """Tendon -> gauge pressure in the muscle of its device [Pa]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Trial:
    """One recording with one device."""

    name: str
    """Names of its files without their endings, joined by ``+``."""
    group: str
    """Group of repeats that the trial belongs to."""
    use: Use | None
    """Use that the dataset specifies; None if :func:`klute_sim.datasets.dataset.split_dataset` decides."""
    device: Device
    """The dataset's device with the changes of this trial."""
    files: tuple[Path, ...]
    """Trial files."""
    prescribed: Mapping[str, TimeSeries] = field(repr=False)
    """All of the rig's :data:`klute_sim.datasets.channels.PRESCRIBED_CHANNELS`."""
    measured: Mapping[str, TimeSeries] = field(repr=False)
    """At least one of the rig's :data:`klute_sim.datasets.channels.MEASURED_CHANNELS`."""
    trusted: frozenset[str] = frozenset()
    """Measured channels whose instrument is known to be correct."""
    specimen: str = ""
    """Specimen that was tested; '' in all trials of a dataset with one specimen."""
    input_noise: Mapping[str, float] = field(default_factory=dict)
    """Prescribed channel that was measured -> standard deviation of its noise [SI]; others are known exactly."""
    limits: Mapping[str, SensorLimits] = field(default_factory=dict)
    """Measured channel -> limits of its sensor; a sample at a limit or beyond says only that the value is no nearer."""
    delays: Mapping[str, float] = field(default_factory=dict)
    """Channel -> stated delay [s], which its times do not contain any more."""
    devices: Mapping[str, Device] = field(default_factory=dict)
    """Tendon -> its device with the changes of this trial; empty without a mechanism."""
    model_numbers: Mapping[str, float] = field(default_factory=dict)
    """Numbers of the model that differ from its file; empty without a mechanism."""
    initial_state: InitialState = field(default_factory=InitialState)
    """Stated initial state; empty without a mechanism."""


class TrialChannels(NamedTuple):
    """Content of the files of one trial."""

    prescribed: dict[str, TimeSeries]
    """Prescribed channels."""
    measured: dict[str, TimeSeries]
    """Measured channels."""
    digests: tuple[str, ...]
    """SHA-256 of each file."""
    remarks: tuple[str, ...]
    """Remarks for the user, one sentence each."""
    units: Mapping[str, str]
    """Channel or time -> unit in its heading; the unit of time is that of the first file."""
    sources: Mapping[str, str]
    """Channel -> columns that it is read from, and its unit; numbers in an expression do not count."""
    unmapped: Mapping[str, str]
    """Channel of the dataset's ``[columns]`` whose expression the trial does not have the columns for -> reason."""
    locate: Mapping[str, Callable[[int], str]]
    """Channel -> function that returns file and place of a row, such as ``trial file a.csv, line 17``."""


def read_trial(
    files: Sequence[Path],
    rig: ChannelSource,
    mapping: ColumnMapping = NO_MAPPING,
    delays: Mapping[str, float] = MappingProxyType({}),
    *,
    has_supply: bool = True,
) -> TrialChannels:
    """Read and check the ``files`` of one trial on ``rig``, with the expressions of ``mapping``.

    The delay [s] of a channel in ``delays`` is subtracted from its times. Without a supply of the device, a trial
    without a command has the command 0.

    Raises InputError for anything that is wrong with them.
    """
    columns: dict[str, _Column] = {}
    remarks: list[str] = []
    tables: list[Table] = []
    for path in files:
        expressions = mapping.select(is_first=not tables)
        file = table.read_trial_file(path, channels.get_column_units(rig), expressions, mapping.heading_row)
        tables.append(file)
        time = _extract_time(file, mapping, has_other_clocks=len(files) > 1)
        for name, samples in file.columns.items():
            if name == TIME_COLUMN:
                continue
            channel = channels.resolve_channel(rig, name)
            column = _Column(file, name, TimeSeries(time - delays.get(channel, 0.0), samples))
            if channel in columns:
                raise InputError(_describe_duplicate(channel, columns[channel], column))
            if channel != channels.GAP_TOLERANT_CHANNEL:
                _check_sample_count(column, is_required=channel in get_prescribed_units(rig))
            columns[channel] = column
        if file.ignored:
            remarks.append(f"trial file {file.source}: ignored columns {format_columns(file.ignored)}")
        remarks += file.remarks
    unmapped = mapping.check_expressions({*columns, TIME_COLUMN}, tables, rig)
    if unmapped and not any(channel in columns for channel in get_measured_units(rig)):
        raise InputError(next(iter(unmapped.values())))
    units = {channel: column.file.units[column.name] for channel, column in columns.items()}
    sources = {channel: mapping.describe_source(column.name, units[channel]) for channel, column in columns.items()}
    if not has_supply and COMMAND_CHANNEL not in columns and columns:
        columns[COMMAND_CHANNEL] = _make_zero_column(next(iter(columns.values())))
        remarks += _describe_pressures_without_supply(tables)
        units[COMMAND_CHANNEL] = get_prescribed_units(rig)[COMMAND_CHANNEL]
    prescribed, measured = _assign_roles(rig, columns, [str(path) for path in files])
    _check_overlap(columns, delays)
    if channels.VERTICAL_FORCE in prescribed:
        remarks += _subtract_plate_offset(prescribed, columns[channels.VERTICAL_FORCE].file.source)
    units[TIME_COLUMN] = next(iter(columns.values())).file.units[TIME_COLUMN]
    digests = tuple(file.digest for file in tables)
    locate = {channel: column.locate_row for channel, column in columns.items()}
    return TrialChannels(prescribed, measured, digests, tuple(remarks), units, sources, unmapped, locate)


class _Column(NamedTuple):
    """A channel and its column in a file."""

    file: Table
    name: str
    series: TimeSeries

    @property
    def location(self) -> str:
        return f"trial file {self.file.source}: column '{self.file.headings[self.name]}'"

    def locate_row(self, row: int) -> str:
        return f"trial file {self.file.source}, {self.file.locate_row(row)}"


def _make_zero_column(column: _Column) -> _Column:
    """Return the command of a device without a supply, at the times of another ``column``."""
    return column._replace(series=column.series._replace(value=np.zeros(len(column.series.time))))


def _describe_pressures_without_supply(tables: Sequence[Table]) -> list[str]:
    """Return a remark about the first column in a unit of pressure, for a device that has no supply; else none."""
    pressure_unit = get_prescribed_units("bench")[COMMAND_CHANNEL]
    columns = [(file, heading) for file in tables for heading in file.available if states_unit(heading, pressure_unit)]
    return [
        f"trial file {file.source}: the pressure in column '{heading}' is not simulated, because the device has no "
        "[supply]; if it acts on a muscle or a seal, add [supply] to the device file and "
        f"{COMMAND_CHANNEL} to [columns]; without them, no effect that depends on pressure can be found"
        for file, heading in columns[:1]
    ]


def _extract_time(file: Table, mapping: ColumnMapping, *, has_other_clocks: bool) -> Array:
    if TIME_COLUMN not in file.columns:
        if TIME_COLUMN in file.missing:
            advice = mapping.suggest_time(file.available, has_other_clocks=has_other_clocks)
            raise InputError(f"trial file {file.source} has no time: {file.missing[TIME_COLUMN]}{advice}")
        raise InputError(
            f"trial file {file.source} has no column 'time [s]'; its columns are {format_columns(file.available)}; "
            "rename the column, or name it in [columns]"
        )
    time = file.columns[TIME_COLUMN]
    _check_no_gap(_Column(file, TIME_COLUMN, TimeSeries(time, time)), "every sample needs a time")
    if len(time) < MIN_SAMPLES:
        raise InputError(f"trial file {file.source} has {len(time)} rows; at least {MIN_SAMPLES} are needed")
    intervals = np.diff(time)
    if (intervals <= 0.0).any():
        row = int((intervals <= 0.0).argmax()) + 1
        fault = "repeats" if intervals[row - 1] == 0.0 else "decreases"
        raise InputError(
            f"trial file {file.source}: the time {fault} at {file.locate_row(row)} ({time[row]:.9g} s after "
            f"{time[row - 1]:.9g} s); time must increase from row to row"
            f"{'; if several tests follow each other, write each into a file of its own' * (fault == 'decreases')}"
            f"{_suggest_days(file, time) * (fault == 'repeats')}"
        )
    return time


def _suggest_days(file: Table, time: Array) -> str:
    """Return advice where ``time`` [s] was read from dates of a spreadsheet; else ''."""
    numbers = time / (unit_conversion.get_si_factor(file.units[TIME_COLUMN], "s") or 1.0)
    if not (DAYS_OF_DATES[0] < numbers[0] < DAYS_OF_DATES[1] and np.ptp(numbers) < 1.0):
        return ""
    return (
        "; the numbers look like the days since 1900 with which spreadsheets write dates: export all digits, and state "
        "the unit 'day'"
    )


def _check_no_gap(column: _Column, reason: str) -> None:
    is_missing = np.isnan(column.series.value)
    if is_missing.any():
        row = column.file.locate_row(int(is_missing.argmax()))
        raise InputError(f"{column.location}, {row}: the cell is empty or NaN; {reason}")


def _check_sample_count(column: _Column, *, is_required: bool) -> None:
    count = int(np.isfinite(column.series.value).sum())
    if count < MIN_SAMPLES:
        advice = "" if is_required else " (leave the column out if it was not measured)"
        raise InputError(f"{column.location} has {count} samples; at least {MIN_SAMPLES} are needed{advice}")


def _describe_duplicate(channel: str, first: _Column, second: _Column) -> str:
    if first.file is second.file:
        headings = " and ".join(repr(c.file.headings[c.name]) for c in (first, second))
        return f"trial file {first.file.source}: columns {headings} are the same channel; remove one of them"
    return f"trial files {first.file.source} and {second.file.source} both have '{channel}'; remove it from one of them"


def _assign_roles(
    rig: ChannelSource, columns: dict[str, _Column], files: Sequence[str]
) -> tuple[dict[str, TimeSeries], dict[str, TimeSeries]]:
    """Return the prescribed and the measured channels; raise InputError where one is missing or has gaps."""
    required, optional = get_prescribed_units(rig), get_measured_units(rig)
    source, rig_name = " + ".join(files), channels.get_rig_name(rig)
    for channel in required:
        if channel not in columns:
            raise InputError(
                f"trial {source}: the prescribed channel '{channel}' is missing; a {rig_name} trial needs "
                f"{', '.join(required)}{_suggest_measured_pressure(channel, columns)}"
            )
        if channel != channels.GAP_TOLERANT_CHANNEL:
            _check_no_gap(columns[channel], f"'{channel}' is prescribed and needs every sample")
    if channels.GAP_TOLERANT_CHANNEL in required:
        _check_foot_strike(columns[channels.GAP_TOLERANT_CHANNEL], columns[channels.VERTICAL_FORCE])
        _check_known_under_load(columns[channels.GAP_TOLERANT_CHANNEL], columns[channels.VERTICAL_FORCE].series)
        _check_sample_count(columns[channels.GAP_TOLERANT_CHANNEL], is_required=True)
    measured = {channel: columns[channel].series for channel in optional if channel in columns}
    if not measured:
        raise InputError(
            f"trial {source}: no channel is measured; a {rig_name} trial needs at least one of {', '.join(optional)}"
        )
    return {channel: columns[channel].series for channel in required}, measured


def _suggest_measured_pressure(channel: str, columns: Mapping[str, _Column]) -> str:
    """Return how the measured pressure can stand for a missing command; '' if that is not what is missing."""
    if channel != COMMAND_CHANNEL or PRESSURE_CHANNEL not in columns:
        return ""
    column = columns[PRESSURE_CHANNEL]
    label = column.file.headings[column.name]
    return (
        f'; if only the pressure was logged, let it stand for the command: {COMMAND_CHANNEL} = "`{label}`" under '
        f'[columns], and the standard deviation of its noise under [noise], such as {COMMAND_CHANNEL} = "20 mbar"'
    )


def _check_foot_strike(cop: _Column, vertical: _Column) -> None:
    """Raise InputError for a trial whose plate is never loaded: then its centre of pressure is empty or 0, too.

    A load in a larger unit has a centre of pressure; the plausibility of the trial tells that unit.
    """
    largest = float(np.abs(vertical.series.value).max())
    is_known = np.isfinite(cop.series.value) & (cop.series.value != 0.0)
    if largest <= channels.CONTACT_FORCE_THRESHOLD and is_known.sum() < MIN_SAMPLES:
        raise InputError(
            f"{vertical.location} is {largest:.3g} N at most and there is no centre of pressure: the foot never stands "
            f"on the ground; a gait trial needs foot strikes, with more than {channels.CONTACT_FORCE_THRESHOLD:g} N; "
            "leave the trial out, or check the force plate"
        )


def _check_known_under_load(column: _Column, vertical_force: TimeSeries) -> None:
    is_loaded = interpolate_load_mask(
        column.series.time, vertical_force.time, find_loaded_samples(vertical_force.value)
    )
    is_missing = np.isnan(column.series.value) & is_loaded
    if is_missing.any():
        row = int(is_missing.argmax())
        load = np.interp(column.series.time, vertical_force.time, vertical_force.value)
        raise InputError(
            f"{column.location}, {column.file.locate_row(row)}: the cell is empty or NaN under a load of "
            f"{load[row]:.0f} N; empty cells are allowed up to {channels.CONTACT_FORCE_THRESHOLD:g} N"
        )


def _subtract_plate_offset(prescribed: dict[str, TimeSeries], source: str) -> list[str]:
    """Subtract the offset of the unloaded plate from its forces, and return a remark about a large one."""
    vertical, forward = (prescribed[name] for name in PLATE_FORCES)
    offset = estimate_plate_offset(vertical.value, np.interp(vertical.time, forward.time, forward.value))
    for name, series, force in zip(PLATE_FORCES, (vertical, forward), offset, strict=True):
        prescribed[name] = series._replace(value=series.value - force)
    if max(map(abs, offset)) <= MAX_UNREPORTED_OFFSET:
        return []
    return [
        f"trial file {source}: without load the force plate reads {offset.vertical:.0f} N up and "
        f"{offset.forward:.0f} N forward; this offset was subtracted"
    ]


def _check_overlap(columns: Mapping[str, _Column], delays: Mapping[str, float]) -> None:
    """Raise InputError where two channels share too little time; a stated delay in a wrong unit is a cause."""
    latest = max(columns, key=lambda channel: columns[channel].series.time[0])
    earliest = min(columns, key=lambda channel: columns[channel].series.time[-1])
    start, end = columns[latest].series.time[0], columns[earliest].series.time[-1]
    interval = max(columns[channel].series.sampling_interval for channel in (earliest, latest))
    min_overlap = max(MIN_OVERLAP_INTERVALS * interval, MIN_OVERLAP_TIME)
    if end - start >= min_overlap:
        return
    _check_duration(columns, min_overlap)
    files = list(dict.fromkeys(str(columns[channel].file.source) for channel in (earliest, latest)))
    subject = f"trial files {' and '.join(files)}" if len(files) > 1 else f"the channels of trial file {files[0]}"
    statement = f"overlap by {end - start:.3g} s only" if end > start else "do not overlap in time"
    earlier, later = (
        f" after its [delay] of {delays[channel]:.6g} s" if channel in delays else "" for channel in (earliest, latest)
    )
    advice = "is the unit of the delay right?" if earlier or later else "correct the times, or leave the trial out"
    raise InputError(
        f"{subject} {statement}: '{earliest}' ends at {end:.6g} s{earlier}, '{latest}' starts at {start:.6g} s{later}; "
        f"at least {min_overlap:.3g} s in common are needed; {advice}"
    )


def _check_duration(columns: Mapping[str, _Column], min_duration: float) -> None:
    """Raise InputError where no channel is longer than ``min_duration`` [s], and another unit of time explains this."""
    durations = {channel: float(np.ptp(column.series.time)) for channel, column in columns.items()}
    longest = max(durations, key=lambda channel: durations[channel])
    file, series = columns[longest].file, columns[longest].series
    written = unit_conversion.get_si_factor(file.units[TIME_COLUMN], "s") or 1.0
    units = " or ".join(list_usual_units(series.sampling_interval, durations[longest], written))
    if durations[longest] < min_duration and units:
        raise InputError(
            f"trial file {file.source}: the time spans {durations[longest]:.3g} s with a sample every "
            f"{series.sampling_interval:.3g} s, but a trial takes seconds to minutes: is the unit of "
            f"'{file.headings[TIME_COLUMN]}' {units}? Correct the heading, or state it in [columns]"
        )
