"""Where the curves of a series come from: strides, repeats in time, or the human reference; made when asked for."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from klute_sim.compare import channels, curve, resample
from klute_sim.compare.curve import Curve
from klute_sim.compare.remarks import Remarks
from klute_sim.errors import InputError
from klute_sim.recording.recording import Recording, Samples

HUMAN = "human"
"""Label of the reference."""

Members = Sequence[tuple[str, Recording]]
"""Recordings of one label, each with how errors name it."""


@dataclass(frozen=True, eq=False)
class Source:
    """What a series is made of."""

    label: str
    units: Mapping[str, str]
    """Of every channel that there is a curve of, the reference's columns among them."""
    repeats: int
    """Strides over phase, recordings over time; 0 of the human reference: not known."""
    curve: Callable[[str], Curve]
    """Of one of these channels."""

    @property
    def reference(self) -> bool:
        """Whether it is the human reference."""
        return self.repeats == 0


def over_time(label: str, members: Members, axis: Samples) -> Source:
    """Every recording is a repeat, at the times ``axis`` [s]."""

    def of(name: str) -> Curve:
        return curve.of(np.array([resample.over_time(recording, name, axis) for _, recording in members]))

    return Source(label, _units(label, members), len(members), of)


def over_phase(label: str, members: Members, skip: int | None, remarks: Remarks) -> Source:
    """Every stride of every recording is a repeat, but the first ``skip`` of each and those that are not whole.

    ``skip`` None: one of a simulated walk of several strides, because it starts from the reference's posture; none of
    others.
    """
    repeats, cut = [], []
    for where, recording in members:
        found = resample.strides(recording, where)
        simulated = recording.provenance.get("rig") == "gait"
        begin = skip if skip is not None else int(simulated and len(found) > 1)
        if begin >= len(found):
            raise InputError(f"{where} has {len(found)} strides and --skip {begin} leaves none; allowed: fewer")
        repeats += [(recording, stride) for stride in found[begin:] if stride.whole]
        cut += [stride for stride in found[begin:] if not stride.whole]
    if not repeats:
        raise InputError(
            f"{members[0][0]} has no whole stride: stride {cut[0].number} goes from {cut[0].low:.3g} to "
            f"{cut[0].high:.3g} %; allowed are strides that reach to {resample.EDGE:g} % of both ends"
        )
    if cut:
        first = f"the first is stride {cut[0].number}, {cut[0].low:.3g} to {cut[0].high:.3g} %"
        remarks.add(f"Strides of '{label}' that are not whole are left out: {len(cut)} ({first}).")
    if len(members) > 1:
        remarks.add(
            f"The {len(repeats)} strides of '{label}' from {len(members)} recordings count as independent repeats: its "
            "band is one of strides, not of people or sessions."
        )

    def of(name: str) -> Curve:
        return curve.of(np.array([_stride(recording, stride, name) for recording, stride in repeats]))

    units = _units(label, members)
    for name in list(units):
        base = channels.FROM_STRIDE_START.get(name, name)
        if base not in units:
            del units[name]
            remarks.add(f"'{name}' of '{label}' is left out: to count it from heel strike takes '{base}', too.")
    return Source(label, units, len(repeats), of)


def human(source: Source, members: Members, remarks: Remarks) -> Source:
    """The human reference beside the walks of ``source``, which are those of ``members``."""
    where, recording = members[0]
    curves, units = {}, {}
    for name in channels.of_reference(source.units):
        column = channels.REFERENCE + name
        deviation = column + channels.DEVIATION
        sd = source.curve(deviation).mean if deviation in source.units else None
        curves[name] = curve.of_reference(source.curve(column).mean, sd)
        units[name] = source.units[column]
    if not curves:
        raise InputError(
            f"{where} has no human reference; allowed are recordings with columns such as 'reference_ankle_angle [deg]'"
        )
    if (recording.provenance.get("options") or {}).get("slope_deg"):
        remarks.add(
            f"'{source.label}' walks on a slope, where nobody's gait was measured: its reference is no comparison."
        )
    return Source(HUMAN, units, 0, curves.__getitem__)


def _stride(recording: Recording, stride: resample.Stride, name: str) -> Samples:
    values, base = resample.over_phase(recording, stride, name), channels.FROM_STRIDE_START.get(name)
    return values if base is None else values - resample.over_phase(recording, stride, base)[0]


def _units(label: str, members: Members) -> dict[str, str]:
    """Of the channels that all ``members`` have; raises InputError if these are not the same in all."""
    where, first = members[0]
    units = {}
    for name, unit in first.units.items():
        for other, recording in members[1:]:
            if name in recording and recording.units[name] != unit:
                raise InputError(
                    f"channel '{name}' of '{label}' is in '{unit}' in {where} and in '{recording.units[name]}' in "
                    f"{other}; repeats need units of one kind"
                )
        if name not in channels.AXES and all(name in recording for _, recording in members):
            units[name] = unit
    return units
