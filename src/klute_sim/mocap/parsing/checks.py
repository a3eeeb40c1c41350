"""Plausibility of the columns and markers of one file, before it is converted."""

from collections.abc import Mapping

import numpy as np

from klute_sim.mocap.parsing import channel_lookup, channel_names
from klute_sim.mocap.parsing.sources import OPENSIM_STORAGE, SourceFile
from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.gait import loads, markers
from klute_sim.plausibility.gait.steps import Series, find_steps
from klute_sim.plausibility.gait.trial import find_time_unit
from klute_sim.plausibility.samples import Samples, find_missing_value_code
from klute_sim.plausibility.units import round_digits
from klute_sim.types import Array


def find_source_findings(source: SourceFile) -> list[Finding]:
    """Return what is implausible in the numbers of ``source``."""
    place = f"file {source.name}"
    findings: list[Finding] = []
    if source.markers is not None:
        findings += markers.find_frame_rate(source.markers.time, place)
        for name, position in source.markers.positions.items():
            findings += markers.find_missing_frames(name, position, place)
    if source.time_label is None or source.read_column is None:
        return findings
    columns = _select_columns(source)
    findings += _find_missing(source, columns, place)
    if findings:
        return findings
    forces = _collect_forces(source, columns)
    findings += _find_load_units(source, columns, forces, place)
    return [*findings, *_find_time_unit(source, forces, place)]


def _select_columns(source: SourceFile) -> dict[str, str]:
    """Return label -> channel of the recognised columns; the channel of an OpenSim force plate is ``plate``."""
    channels = {}
    for label in source.labels:
        parsed = channel_names.parse_channel_label(label)
        plate = channel_names.parse_plate_label(label)
        if parsed is not None:
            channels[label] = parsed.channel
        elif plate is not None:
            channels[label] = "plate"
    return channels


def _find_missing(source: SourceFile, columns: Mapping[str, str], place: str) -> list[Finding]:
    findings = []
    for label in columns:
        values = source.get_column(label)
        code = find_missing_value_code(Samples(label, values, "", 1.0)) if np.isfinite(values).any() else None
        if code is not None:
            statement = (
                f"column `{label}` is {code.code:g} in {code.n_samples} rows: it looks like a code for missing "
                "samples; leave these cells empty or interpolate them"
            )
            findings.append(Finding(f"{label}-missing", place, statement))
    return findings


def _collect_forces(source: SourceFile, columns: Mapping[str, str]) -> dict[str, tuple[str, Array]]:
    """Return foot or plate -> label and samples of its largest force component, as written."""
    groups: dict[str, list[str]] = {}
    for label, channel in columns.items():
        plate = channel_names.parse_plate_label(label)
        if plate is not None and plate.quantity == "force":
            groups.setdefault(f"plate {plate.plate}", []).append(label)
        elif channel.startswith("grf"):
            parsed = channel_names.parse_channel_label(label)
            groups.setdefault(str(parsed and parsed.side), []).append(label)
    forces = {}
    for group, labels in groups.items():
        samples = {label: source.get_column(label) for label in labels}
        sizes = {label: float(np.nanmean(np.abs(v))) for label, v in samples.items() if np.isfinite(v).any()}
        if sizes:
            largest = max(sizes, key=lambda label: sizes[label])
            forces[group] = largest, samples[largest]
    return forces


def _find_load_units(
    source: SourceFile, columns: Mapping[str, str], forces: Mapping[str, tuple[str, Array]], place: str
) -> list[Finding]:
    """Return the findings on forces and moments that are in N and N.m by the file or by the format."""
    findings = []
    peaks = {label: loads.measure_peak(values) for label, values in forces.values()}
    if peaks:
        label = max(peaks, key=lambda name: peaks[name])
        unit, peak = source.units.get(label, ""), peaks[label]
        is_newton = unit == "N" or (not unit and (source.file_type == OPENSIM_STORAGE or peak > 40.0))
        guess = loads.guess_force_unit(peak) if is_newton else ""
        if guess and peak > 0.0:
            findings.append(_describe_unit(label, peak, "N", guess, place))
    moments = [label for label, channel in columns.items() if channel == channel_names.ANKLE_MOMENT]
    moment_peaks = {label: loads.measure_peak(source.get_column(label)) for label in moments}
    if moment_peaks:
        label = max(moment_peaks, key=lambda name: moment_peaks[name])
        unit, peak = source.units.get(label, ""), moment_peaks[label]
        is_newton_metre = unit in ("N*m", "Nm", "N.m", "N m") or (not unit and peak > 5.0)
        guess = loads.guess_moment_unit(peak) if is_newton_metre else ""
        if guess and peak > 0.0:
            findings.append(_describe_unit(label, peak, "N·m", guess, place))
    return findings


def _describe_unit(label: str, peak: float, unit: str, guess: str, place: str) -> Finding:
    statement = (
        f"column `{label}` peaks at {round_digits(peak):g} {unit}, which is not plausible: it looks like {guess}; give "
        "the unit in the heading or in a file for --map, or convert it"
    )
    return Finding(f"{label}-unit", place, statement)


def _find_time_unit(source: SourceFile, forces: Mapping[str, tuple[str, Array]], place: str) -> list[Finding]:
    time = channel_lookup.read_time(source)
    for _, values in forces.values():
        steps = find_steps(Series(time, values))
        if len(steps) > 1 or any(step.is_complete for step in steps):
            return find_time_unit(time, steps, place)[0]
    motion_channels = {*channel_names.ANGLE_CHANNELS, *channel_names.POSITION_CHANNELS}
    is_motion = not motion_channels.isdisjoint(_select_columns(source).values())
    interval = float(np.median(np.diff(time)))
    return markers.find_frame_rate(time, place) if is_motion or interval > 0.11 else []
