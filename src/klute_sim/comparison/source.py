"""Curves of one series, computed on request from strides, from repeats in time, or from the human reference."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from klute_sim.comparison.alignment import channels, resample
from klute_sim.comparison.curve import MeanCurve, average_repeats, make_reference_curve
from klute_sim.comparison.remarks import Remarks
from klute_sim.errors import InputError
from klute_sim.gait.reference import DEFAULT_NAME
from klute_sim.recording.recording import Recording
from klute_sim.types import Array

REFERENCE_LABEL = "human"
"""Label of the default reference, which is of people; that of one subject has another (:func:`name_reference`)."""

NamedRecordings = Sequence[tuple[str, Recording]]
"""Recordings of one label, each with its name in error messages."""


@dataclass(frozen=True, eq=False)
class SeriesSource:
    """Source of the mean curves of one series."""

    label: str
    """Label of the series."""
    units: Mapping[str, str]
    """Channel -> unit, including the columns of the reference."""
    n_repeats: int
    """Number of strides over phase, or of recordings over time; 0 for the human reference (unknown)."""
    get_curve: Callable[[str], MeanCurve]
    """Function from a channel to its mean curve."""
    has_simulated_repeats: bool = False
    """Whether the repeats are strides of one simulation, which repeat almost exactly."""

    @property
    def is_reference(self) -> bool:
        """Whether the series is the human reference."""
        return self.n_repeats == 0


def make_time_source(label: str, recordings: NamedRecordings, time: Array) -> SeriesSource:
    """Return a source with one repeat per recording at ``time`` [s]."""

    def get_curve(channel: str) -> MeanCurve:
        return average_repeats(
            np.array([resample.resample_time(recording, channel, time) for _, recording in recordings])
        )

    return SeriesSource(label, _find_common_units(label, recordings), len(recordings), get_curve)


def make_phase_source(
    label: str, recordings: NamedRecordings, skip_strides: int | None, remarks: Remarks
) -> SeriesSource:
    """Return a source with one repeat per complete stride, except the first ``skip_strides`` of each recording.

    By default (None) the first of several strides of a simulated gait is skipped, as it starts from the reference
    posture; measured recordings are used completely.
    """
    repeats, incomplete = [], []
    for name, recording in recordings:
        strides = resample.find_strides(recording, name)
        is_simulated = recording.provenance.get("rig") == "gait"
        n_skipped = skip_strides if skip_strides is not None else int(is_simulated and len(strides) > 1)
        if n_skipped >= len(strides):
            raise InputError(f"{name} has {len(strides)} strides and --skip {n_skipped} leaves none; pass fewer")
        repeats += [(recording, stride) for stride in strides[n_skipped:] if stride.is_complete]
        incomplete += [stride for stride in strides[n_skipped:] if not stride.is_complete]
    if not repeats:
        first = incomplete[0]
        raise InputError(
            f"{recordings[0][0]} has no complete stride: stride {first.number} goes from {first.first_phase:.3g} to "
            f"{first.last_phase:.3g} %; allowed are strides within {resample.MAX_MISSING_PHASE:g} % of both ends"
        )
    if incomplete:
        first = incomplete[0]
        span = f"the first is stride {first.number}, {first.first_phase:.3g} to {first.last_phase:.3g} %"
        remarks.add(f"Incomplete strides of '{label}' are excluded: {len(incomplete)} ({span}).")
    if len(recordings) > 1:
        remarks.add(
            f"The {len(repeats)} strides of '{label}' from {len(recordings)} recordings count as independent repeats: "
            "the band shows the variation of strides, not of people or sessions."
        )

    def get_curve(channel: str) -> MeanCurve:
        return average_repeats(
            np.array([_resample_stride(recording, stride, channel) for recording, stride in repeats])
        )

    units = _find_common_units(label, recordings)
    for name in list(units):
        origin = channels.STRIDE_ORIGINS.get(name, name)
        if origin not in units:
            del units[name]
            remarks.add(f"'{name}' of '{label}' is excluded: its origin at heel strike, '{origin}', is missing.")
    has_simulated_repeats = len(recordings) == 1 and bool(recordings[0][1].provenance.get("rig"))
    return SeriesSource(label, units, len(repeats), get_curve, has_simulated_repeats)


def name_reference(recording: Recording) -> str:
    """Return the label of the reference in ``recording``: "human", or that of the subject whose strides it holds."""
    described = recording.provenance.get("reference")
    name = described.get("name", DEFAULT_NAME) if isinstance(described, Mapping) else DEFAULT_NAME
    return REFERENCE_LABEL if name == DEFAULT_NAME else f"subject {name}"


def make_reference_source(source: SeriesSource, recordings: NamedRecordings, remarks: Remarks) -> SeriesSource:
    """Return the human reference in ``recordings``, whose strides are in ``source``."""
    recording_name, recording = recordings[0]
    curves, units = {}, {}
    for name in channels.find_reference_channels(source.units):
        mean_column = channels.REFERENCE_PREFIX + name
        sd_column = mean_column + channels.SD_SUFFIX
        sd = source.get_curve(sd_column).mean if sd_column in source.units else None
        curves[name] = make_reference_curve(source.get_curve(mean_column).mean, sd)
        units[name] = source.units[mean_column]
    if not curves:
        raise InputError(
            f"{recording_name} has no human reference; allowed are recordings with columns such as "
            "'reference_ankle_angle [deg]'"
        )
    if (recording.provenance.get("options") or {}).get("slope_deg"):
        remarks.add(f"'{source.label}' is a gait on a slope, but the reference was measured on level ground.")
    return SeriesSource(name_reference(recording), units, 0, curves.__getitem__)


def _resample_stride(recording: Recording, stride: resample.StrideSamples, channel: str) -> Array:
    values, origin = resample.resample_phase(recording, stride, channel), channels.STRIDE_ORIGINS.get(channel)
    if origin is None:
        return values
    relative: Array = values - resample.resample_phase(recording, stride, origin)[0]
    if origin != channel:
        relative[-1] = np.nan  # at the next heel strike the foot has another place on the ground
    return relative


def _find_common_units(label: str, recordings: NamedRecordings) -> dict[str, str]:
    """Return the units of the channels of all ``recordings``; raise InputError if the units differ."""
    first_name, first = recordings[0]
    units = {}
    for channel, unit in first.units.items():
        for name, recording in recordings[1:]:
            if channel in recording and recording.units[channel] != unit:
                raise InputError(
                    f"channel '{channel}' of '{label}' is in '{unit}' in {first_name} and in "
                    f"'{recording.units[channel]}' in {name}; repeats need compatible units"
                )
        if channel not in channels.AXIS_CHANNELS and all(channel in recording for _, recording in recordings):
            units[channel] = unit
    return units
