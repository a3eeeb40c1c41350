"""One trial: what was prescribed and what was measured, each channel on the clock of its own file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from klute_sim.datasets import channels, table
from klute_sim.datasets.channels import TIME_COLUMN, Rig
from klute_sim.datasets.table import Table
from klute_sim.device.device import Device
from klute_sim.errors import InputError
from klute_sim.recording.recording import Array

Use = Literal["fit", "select", "show"]

MIN_SAMPLES = 10
"""Fewest samples of a channel, missing ones not counted."""


class Series(NamedTuple):
    """Samples of one channel, SI."""

    time: Array
    """[s], finite, strictly increasing; shared by the channels of one file."""
    value: Array
    """One per time; NaN where a measured channel has no sample."""

    @property
    def sampling_interval(self) -> float:
        """Usual time between samples [s]; infinite if there is none."""
        return float(np.median(np.diff(self.time))) if len(self.time) > 1 else float("inf")


@dataclass(frozen=True, eq=False, kw_only=True)
class Trial:
    """One experiment with one device."""

    name: str
    """Its files without their endings."""
    group: str
    """Trials with the same group are repeats."""
    use: Use | None
    """As the dataset says; None leaves it to :func:`klute_sim.datasets.dataset.split`."""
    device: Device
    """The dataset's, with this trial's changes."""
    files: tuple[Path, ...]
    prescribed: Mapping[str, Series]
    """Every channel of :data:`klute_sim.datasets.channels.PRESCRIBED` of the rig."""
    measured: Mapping[str, Series]
    """One or more of :data:`klute_sim.datasets.channels.MEASURED` of the rig."""
    trusted: frozenset[str] = frozenset()
    """Measured channels whose instrument is known to be right."""


class TrialChannels(NamedTuple):
    """What the files of one trial hold."""

    prescribed: dict[str, Series]
    measured: dict[str, Series]
    digests: tuple[str, ...]
    """SHA-256 of each file."""
    remarks: tuple[str, ...]
    """What the user should know, one sentence each."""
    units: Mapping[str, str]
    """Channel -> unit as its heading has it."""


def read_trial(files: Sequence[Path], rig: Rig) -> TrialChannels:
    """Read and check the ``files`` of one trial; raises InputError with one sentence."""
    found: dict[str, _Column] = {}
    remarks: list[str] = []
    digests: list[str] = []
    for path in files:
        file = table.read_trial_file(path, channels.get_column_units(rig))
        clock = _extract_time(file)
        for name, samples in file.columns.items():
            if name == TIME_COLUMN:
                continue
            channel = channels.resolve_channel(rig, name)
            column = _Column(file, name, Series(clock, samples))
            if channel in found:
                raise InputError(_describe_duplicate(channel, found[channel], column))
            _check_sample_count(column)
            found[channel] = column
        if file.ignored:
            remarks.append(f"trial file {file.where}: ignored columns {', '.join(map(repr, file.ignored))}")
        digests.append(file.digest)
    prescribed, measured = _assign_roles(rig, found, [str(path) for path in files])
    _check_overlap(found)
    units = {channel: column.file.units[column.name] for channel, column in found.items()}
    return TrialChannels(prescribed, measured, tuple(digests), tuple(remarks), units)


class _Column(NamedTuple):
    """A channel and where it was found."""

    file: Table
    name: str
    series: Series

    @property
    def location(self) -> str:
        return f"trial file {self.file.where}: column '{self.file.headings[self.name]}'"


def _extract_time(file: Table) -> Array:
    if TIME_COLUMN not in file.columns:
        there = ", ".join(map(repr, [*file.headings.values(), *file.ignored]))
        raise InputError(f"trial file {file.where} has no column 'time [s]'; it has {there}")
    time = file.columns[TIME_COLUMN]
    _check_no_gap(_Column(file, TIME_COLUMN, Series(time, time)), "every sample needs a time")
    if len(time) < MIN_SAMPLES:
        raise InputError(f"trial file {file.where} has {len(time)} rows; at least {MIN_SAMPLES} are needed")
    step = np.diff(time)
    if (step <= 0.0).any():
        row = int((step <= 0.0).argmax()) + 1
        does = "repeats" if step[row - 1] == 0.0 else "runs backwards"
        raise InputError(
            f"trial file {file.where}: the clock {does} at {file.locate_row(row)} ({time[row]:.9g} s after "
            f"{time[row - 1]:.9g} s); time must increase from row to row"
        )
    return time


def _check_no_gap(column: _Column, reason: str) -> None:
    gap = np.isnan(column.series.value)
    if gap.any():
        row = column.file.locate_row(int(gap.argmax()))
        raise InputError(f"{column.location}, {row}: the cell is empty; {reason}")


def _check_sample_count(column: _Column) -> None:
    count = int(np.isfinite(column.series.value).sum())
    if count < MIN_SAMPLES:
        raise InputError(
            f"{column.location} has {count} samples; at least {MIN_SAMPLES} are needed (leave the column out if it was "
            "not measured)"
        )


def _describe_duplicate(channel: str, first: _Column, second: _Column) -> str:
    if first.file is second.file:
        headings = " and ".join(repr(c.file.headings[c.name]) for c in (first, second))
        return f"trial file {first.file.where}: columns {headings} are the same channel; leave one out"
    return f"trial files {first.file.where} and {second.file.where} both hold '{channel}'; leave it out of one of them"


def _assign_roles(
    rig: Rig, columns: dict[str, _Column], files: Sequence[str]
) -> tuple[dict[str, Series], dict[str, Series]]:
    needed, free, where = channels.PRESCRIBED_CHANNELS[rig], channels.MEASURED_CHANNELS[rig], " + ".join(files)
    for channel in needed:
        if channel not in columns:
            raise InputError(
                f"trial {where}: the prescribed channel '{channel}' is missing; a {rig} trial needs {', '.join(needed)}"
            )
        if channel != channels.GAP_TOLERANT_CHANNEL:
            _check_no_gap(columns[channel], f"'{channel}' is prescribed and needs every sample")
    if channels.GAP_TOLERANT_CHANNEL in needed:
        _check_known_under_load(columns[channels.GAP_TOLERANT_CHANNEL], columns[channels.VERTICAL_FORCE].series)
    measured = {channel: columns[channel].series for channel in free if channel in columns}
    if not measured:
        raise InputError(f"trial {where}: nothing was measured; a {rig} trial needs at least one of {', '.join(free)}")
    return {channel: columns[channel].series for channel in needed}, measured


def _check_known_under_load(column: _Column, load: Series) -> None:
    pressing = np.interp(column.series.time, load.time, load.value)
    gap = np.isnan(column.series.value) & (pressing > channels.CONTACT_FORCE_THRESHOLD)
    if gap.any():
        row = int(gap.argmax())
        raise InputError(
            f"{column.location}, {column.file.locate_row(row)}: the cell is empty under a load of {pressing[row]:.0f} N; "
            f"allowed: up to {channels.CONTACT_FORCE_THRESHOLD:g} N"
        )


def _check_overlap(columns: dict[str, _Column]) -> None:
    late = max(columns, key=lambda channel: columns[channel].series.time[0])
    early = min(columns, key=lambda channel: columns[channel].series.time[-1])
    begin, end = columns[late].series.time[0], columns[early].series.time[-1]
    if begin >= end:
        raise InputError(
            f"trial files {columns[early].file.where} and {columns[late].file.where} share no time: '{early}' ends at "
            f"{end:.6g} s, '{late}' begins at {begin:.6g} s"
        )
