"""Motion of the joint in the trials of a mechanism, compared with the declared model and with the other trials."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from klute_sim.datasets.checks import collect_samples
from klute_sim.datasets.mechanism import DatasetMechanism
from klute_sim.datasets.mechanism_channels import normalize_name, parse_channel
from klute_sim.datasets.mechanism_statics import Statics, compute_statics
from klute_sim.datasets.trial import TimeSeries, Trial
from klute_sim.plausibility.bench.trial import RecordedTrial
from klute_sim.plausibility.finding import Finding, are_accepted
from klute_sim.plausibility.joint_trajectory import JointTrajectory, check_exchanged_pressures, check_joint_trajectories
from klute_sim.types import Array

MAX_SAMPLES = 400
"""Largest number of samples of a trial that are compared."""
START_TIME = 0.1
"""Time [s] in which a joint that begins at rest does not move (assumed)."""
MIN_START_DISTANCE = 0.05
"""Smallest distance of a start from others under the same inputs, over the range of the channel (assumed)."""
MIN_SCATTER_RATIO = 5.0
"""Smallest ratio of this distance to the median deviation of the others (assumed; dry friction holds a joint)."""
MIN_STARTS = 3
"""Smallest number of other trials that begin under the same inputs."""


def check_motion(
    mechanism: DatasetMechanism,
    trials: Sequence[tuple[Trial, Mapping[str, str]]],
    devices: Mapping[str, Sequence[RecordedTrial]],
    accepted: Collection[str],
) -> list[Finding]:
    """Return what is implausible in the trajectory of the only joint, and in exchanged pressures.

    Each trial comes with the units in its headings. ``devices`` holds the channels of the device on each tendon, and
    ``accepted`` names of findings that the user accepts. Exchanged pressures explain what the trajectory shows.
    """
    findings = check_joint_trajectories(_list_trajectories(mechanism, trials))
    channels = {tendon: normalize_name(tendon) for tendon in devices}
    moves_back = any(finding.name.endswith("-sign") for finding in findings)
    exchanged = check_exchanged_pressures(devices, channels, moves_back=moves_back)
    return [*exchanged, *findings] if are_accepted(exchanged, accepted) else exchanged


def _list_trajectories(
    mechanism: DatasetMechanism, trials: Sequence[tuple[Trial, Mapping[str, str]]]
) -> list[JointTrajectory]:
    """Return the trajectories of the only joint; none unless the devices alone move it, under pressures."""
    prescribed = [parse_channel(name) for name in mechanism.channels.prescribed]
    names = [name for name in mechanism.channels.measured if parse_channel(name).quantity in ("angle", "position")]
    if len(names) != 1 or any(channel.quantity not in ("pressure", "pressure_command") for channel in prescribed):
        return []
    cache: dict[tuple[object, ...], Statics | None] = {}
    trajectories = []
    for trial, units in trials:
        key = (*trial.model_numbers.items(), *(device.digest for device in trial.devices.values()))
        if key not in cache:
            cache[key] = compute_statics(mechanism, trial.devices, trial.model_numbers)
        statics = cache[key]
        if statics is None or names[0] not in trial.measured:
            continue
        samples = collect_samples(trial, units, mechanism.channels)[names[0]]
        step = -(-len(samples.value) // MAX_SAMPLES)
        time = trial.measured[names[0]].time[::step]
        pressures = {
            tendon: _interpolate(trial.prescribed[channel.name], time)
            for tendon in trial.devices
            for channel in prescribed
            if channel.object_name == normalize_name(tendon)
        }
        trajectories.append(
            JointTrajectory(
                samples._replace(value=samples.value[::step]),
                time,
                statics.find_rest(pressures),
                statics.compute_natural_period(pressures),
                float(np.ptp(statics.positions)),
                statics.compute_reach(),
                f"trial '{trial.name}'",
            )
        )
    return trajectories


def _interpolate(series: TimeSeries, time: Array) -> Array:
    return np.interp(time, series.time, series.value)


def describe_starts(mechanism: DatasetMechanism, trials: Sequence[Trial]) -> list[str]:
    """Return a remark for each trial whose joint begins elsewhere than in the others under the same inputs."""
    return [
        remark
        for name in mechanism.channels.measured
        if parse_channel(name).quantity in ("angle", "position")
        for remark in _describe_starts_of_channel(name, [trial for trial in trials if name in trial.measured])
    ]


def _describe_starts_of_channel(name: str, trials: Sequence[Trial]) -> list[str]:
    values = np.concatenate([trial.measured[name].value for trial in trials])
    motion = float(np.nanmax(values) - np.nanmin(values))
    starts: dict[tuple[object, ...], list[tuple[Trial, float]]] = {}
    for trial in trials:
        series = trial.measured[name]
        early = series.value[(series.time <= series.time[0] + START_TIME) & np.isfinite(series.value)]
        if early.size == 0 or np.ptp(early) > 0.5 * MIN_START_DISTANCE * motion or trial.initial_state.velocities:
            continue
        inputs = tuple(float(f"{series.value[0]:.2g}") for series in trial.prescribed.values())
        key = (*inputs, *trial.model_numbers.items(), *(device.digest for device in trial.devices.values()))
        starts.setdefault(key, []).append((trial, float(np.median(early))))
    scale, unit = (180.0 / np.pi, "deg") if parse_channel(name).quantity == "angle" else (1000.0, "mm")
    remarks = []
    for group in starts.values():
        for trial, start in group:
            others = np.array([other_start for other, other_start in group if other is not trial])
            if len(others) < MIN_STARTS:
                continue
            middle = float(np.median(others))
            distance, scatter = abs(start - middle), float(np.median(np.abs(others - middle)))
            if distance > max(MIN_START_DISTANCE * motion, MIN_SCATTER_RATIO * scatter):
                remarks.append(
                    f"trial '{trial.name}' begins at {name} = {start * scale:.3g} {unit}, but the {len(others)} others "
                    f"under the same first inputs begin at {middle * scale:.3g} {unit} (median): its zero may differ "
                    f"by {distance * scale:.3g} {unit}"
                )
    return remarks
