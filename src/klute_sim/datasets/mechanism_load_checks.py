"""Measured forces and moments of a mechanism, compared with the static loads of its devices."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import combinations

import numpy as np

from klute_sim.datasets.checks import collect_samples
from klute_sim.datasets.mechanism import DatasetMechanism
from klute_sim.datasets.mechanism_loads import StaticLoad, TrialStatics
from klute_sim.datasets.trial import Trial
from klute_sim.plausibility.exchanged_forces import ForcePair, check_exchanged_forces
from klute_sim.plausibility.finding import Finding, are_accepted
from klute_sim.plausibility.joint_direction import MirroredLoad, check_joint_direction
from klute_sim.plausibility.load_scale import LoadSeries, check_load_scale
from klute_sim.plausibility.samples import Samples

RecordedStatics = tuple[TrialStatics, Mapping[str, Samples]]
"""Static loads of a trial, and the samples of its channels."""


def check_loads(
    mechanism: DatasetMechanism, trials: Sequence[tuple[Trial, Mapping[str, str]]], accepted: Collection[str]
) -> list[Finding]:
    """Return what is implausible in measured forces and moments, and in the direction of driven joints.

    Each trial comes with the units in its headings. A finding explains what further checks would find, unless its name
    is among the ``accepted`` ones.
    """
    if not any(_is_load(name) for name in mechanism.channels.measured):
        return []
    recorded = [
        (TrialStatics(trial, model), collect_samples(trial, units, mechanism.channels))
        for trial, units in trials
        if (model := mechanism.compile_model(trial.model_numbers)) is not None
    ]
    driven = [name for name in mechanism.channels.prescribed if name.startswith(("angle_", "position_"))]
    findings = [finding for name in driven for finding in _check_direction(name, recorded)]
    if not are_accepted(findings, accepted):
        return findings
    names = [name for name in mechanism.channels.measured if _is_load(name)]
    forces = [name for name in names if name.startswith("force_")]
    findings += [finding for pair in combinations(forces, 2) for finding in _check_exchange(pair, recorded)]
    if are_accepted(findings, accepted):
        findings += [finding for name in names for finding in _check_scale(name, recorded)]
    return findings


def _is_load(name: str) -> bool:
    return name.startswith(("force_", "moment_"))


def _check_direction(joint: str, recorded: Iterable[RecordedStatics]) -> list[Finding]:
    """Return findings if the loads show that the sign of the channel ``joint`` is reversed."""
    positions, mirrored_loads = [], []
    for statics, samples in recorded:
        positions.append((f"trial '{statics.trial.name}'", samples[joint]))
        for name in filter(_is_load, statics.trial.measured):
            loads = [
                (samples[name], load)
                for mirrored in ("", joint)
                if (load := statics.compute_load(name, mirrored)) is not None
            ]
            if len(loads) == 2 and not np.array_equal(loads[0][1].value, loads[1][1].value, equal_nan=True):
                mirrored_loads.append(MirroredLoad(*_list_load_series(statics, loads)))
    return check_joint_direction(positions, mirrored_loads)


def _check_exchange(names: tuple[str, str], recorded: Iterable[RecordedStatics]) -> list[Finding]:
    """Return a finding if the forces with the channels ``names`` are exchanged."""
    pairs = []
    for statics, samples in recorded:
        loads = [
            (samples[name], load)
            for name in names
            if name in samples and (load := statics.compute_load(name)) is not None
        ]
        balance = statics.compute_balance(*names) if len(loads) == 2 else None
        if len(loads) == 2 and (balance is not None or not statics.has_free_joint()):
            first, second = _list_load_series(statics, loads)
            pairs.append(ForcePair(first, second, balance))
    return check_exchanged_forces(pairs)


def _check_scale(name: str, recorded: Iterable[RecordedStatics]) -> list[Finding]:
    """Return findings if the channel ``name`` has the opposite sign or another unit."""
    series = []
    for statics, samples in recorded:
        load = statics.compute_load(name) if name in samples else None
        if load is not None:
            series += _list_load_series(statics, [(samples[name], load)])
    return check_load_scale(series)


def _list_load_series(statics: TrialStatics, loads: Sequence[tuple[Samples, StaticLoad]]) -> list[LoadSeries]:
    """Return the time series of each of the measured samples with its static load; NaN where any of them is unknown."""
    measured = [statics.average(samples.channel) for samples, _ in loads]
    is_known = np.all([np.isfinite(values) for values in (*measured, *(load.value for _, load in loads))], axis=0)
    return [
        LoadSeries(
            samples,
            np.where(is_known, values, np.nan),
            np.where(is_known, load.value, np.nan),
            np.where(is_known, load.gross, np.nan),
            load.max_load,
            f"trial '{statics.trial.name}'",
        )
        for values, (samples, load) in zip(measured, loads, strict=True)
    ]
