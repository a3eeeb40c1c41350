"""Where the curves of a series come from: strides, repeats in time, or the human reference; made when asked for."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from klute_sim.comparison import curve
from klute_sim.comparison.alignment import channels, resample
from klute_sim.comparison.curve import MeanCurve
from klute_sim.comparison.remarks import Remarks
from klute_sim.errors import InputError
from klute_sim.recording.recording import Array, Recording

REFERENCE_LABEL = "human"
"""Label of the reference."""

NamedRecordings = Sequence[tuple[str, Recording]]
"""Recordings of one label, each with how errors name it."""


@dataclass(frozen=True, eq=False)
class SeriesSource:
    """What a series is made of."""

    label: str
    units: Mapping[str, str]
    """Of every channel that there is a curve of, the reference's columns among them."""
    n_repeats: int
    """Strides over phase, recordings over time; 0 of the human reference: not known."""
    get_curve: Callable[[str], MeanCurve]
    """Of one of these channels."""

    @property
    def is_reference(self) -> bool:
        """Whether it is the human reference."""
        return self.n_repeats == 0


def make_time_source(label: str, recordings: NamedRecordings, time: Array) -> SeriesSource:
    """Every recording is a repeat, at the times ``axis`` [s]."""

    def of(name: str) -> MeanCurve:
        return curve.average_repeats(
            np.array([resample.resample_time(recording, name, time) for _, recording in recordings])
        )

    return SeriesSource(label, _find_common_units(label, recordings), len(recordings), of)


def make_phase_source(
    label: str, recordings: NamedRecordings, skip_strides: int | None, remarks: Remarks
) -> SeriesSource:
    """Every stride of every recording is a repeat, but the first ``skip`` of each and those that are not whole.

    ``skip`` None: one of a simulated walk of several strides, because it starts from the reference's posture; none of
    others.
    """
    repeats, cut = [], []
    for where, recording in recordings:
        found = resample.find_strides(recording, where)
        simulated = recording.provenance.get("rig") == "gait"
        begin = skip_strides if skip_strides is not None else int(simulated and len(found) > 1)
        if begin >= len(found):
            raise InputError(f"{where} has {len(found)} strides and --skip {begin} leaves none; allowed: fewer")
        repeats += [(recording, stride) for stride in found[begin:] if stride.is_complete]
        cut += [stride for stride in found[begin:] if not stride.is_complete]
    if not repeats:
        raise InputError(
            f"{recordings[0][0]} has no whole stride: stride {cut[0].number} goes from {cut[0].first_phase:.3g} to "
            f"{cut[0].last_phase:.3g} %; allowed are strides that reach to {resample.MAX_MISSING_PHASE:g} % of both ends"
        )
    if cut:
        first = f"the first is stride {cut[0].number}, {cut[0].first_phase:.3g} to {cut[0].last_phase:.3g} %"
        remarks.add(f"Strides of '{label}' that are not whole are left out: {len(cut)} ({first}).")
    if len(recordings) > 1:
        remarks.add(
            f"The {len(repeats)} strides of '{label}' from {len(recordings)} recordings count as independent repeats: its "
            "band is one of strides, not of people or sessions."
        )

    def of(name: str) -> MeanCurve:
        return curve.average_repeats(
            np.array([_resample_stride(recording, stride, name) for recording, stride in repeats])
        )

    units = _find_common_units(label, recordings)
    for name in list(units):
        base = channels.STRIDE_ORIGINS.get(name, name)
        if base not in units:
            del units[name]
            remarks.add(f"'{name}' of '{label}' is left out: to count it from heel strike takes '{base}', too.")
    return SeriesSource(label, units, len(repeats), of)


def make_reference_source(source: SeriesSource, recordings: NamedRecordings, remarks: Remarks) -> SeriesSource:
    """The human reference beside the walks of ``source``, which are those of ``members``."""
    where, recording = recordings[0]
    curves, units = {}, {}
    for name in channels.find_reference_channels(source.units):
        column = channels.REFERENCE_PREFIX + name
        deviation = column + channels.SD_SUFFIX
        sd = source.get_curve(deviation).mean if deviation in source.units else None
        curves[name] = curve.make_reference_curve(source.get_curve(column).mean, sd)
        units[name] = source.units[column]
    if not curves:
        raise InputError(
            f"{where} has no human reference; allowed are recordings with columns such as 'reference_ankle_angle [deg]'"
        )
    if (recording.provenance.get("options") or {}).get("slope_deg"):
        remarks.add(
            f"'{source.label}' walks on a slope, where nobody's gait was measured: its reference is no comparison."
        )
    return SeriesSource(REFERENCE_LABEL, units, 0, curves.__getitem__)


def _resample_stride(recording: Recording, stride: resample.StrideSamples, channel: str) -> Array:
    values, base = resample.resample_phase(recording, stride, channel), channels.STRIDE_ORIGINS.get(channel)
    return values if base is None else values - resample.resample_phase(recording, stride, base)[0]


def _find_common_units(label: str, recordings: NamedRecordings) -> dict[str, str]:
    """Of the channels that all ``members`` have; raises InputError if these are not the same in all."""
    where, first = recordings[0]
    units = {}
    for name, unit in first.units.items():
        for other, recording in recordings[1:]:
            if name in recording and recording.units[name] != unit:
                raise InputError(
                    f"channel '{name}' of '{label}' is in '{unit}' in {where} and in '{recording.units[name]}' in "
                    f"{other}; repeats need units of one kind"
                )
        if name not in channels.AXIS_CHANNELS and all(name in recording for _, recording in recordings):
            units[name] = unit
    return units
