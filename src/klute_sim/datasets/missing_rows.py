"""Rows that are missing in a trial file: a simulation would bridge them by straight lines or splines.

Commands may be logged only when they change, and measured outputs may have gaps.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from klute_sim.datasets import channels
from klute_sim.datasets.foot_load import find_loaded_samples, interpolate_load_mask
from klute_sim.datasets.trial import TimeSeries, Trial, TrialChannels
from klute_sim.plausibility.finding import Finding, TrialFindings
from klute_sim.types import Array

MAX_INTERVAL = 0.05
"""Longest interval between samples [s] that is always bridged (assumed: a swing takes about 0.4 s)."""
MAX_INTERVAL_RATIO = 3.0
"""Largest ratio of an interval to the median one that is always bridged, for slow logs (assumed)."""
MAX_BEND_FRACTION = 0.02
"""Largest deviation from a straight line around a long interval that may be bridged, over the range of the channel
(assumed)."""
MAX_NOISE_RATIO = 4.0
"""Largest ratio of such a deviation to the noise of the channel (assumed)."""
COMMAND_PREFIX = "pressure_command"
"""First part of the names of commands."""
LOAD_CHANNELS = (channels.VERTICAL_FORCE, "grf_forward", channels.GAP_TOLERANT_CHANNEL)
"""Channels of gait that do not matter while the foot is not loaded."""


def add_gap_findings(
    trial_findings: TrialFindings, trials: Sequence[Trial], contents: Sequence[TrialChannels]
) -> TrialFindings:
    """Return ``trial_findings`` with findings on rows that are missing in files of ``trials``.

    ``contents`` is what was read. The motion and the loads of a gait trial need every sample; other channels may be
    bridged where they move uniformly.
    """
    findings: list[Finding] = []
    for trial, content in zip(trials, contents, strict=True):
        for name, series in content.prescribed.items():
            row = _find_longest_interval(name, content.prescribed)
            if row is not None:
                start, end = series.time[[row, row + 1]]
                statement = (
                    f"`{name}` has no samples between {start:.6g} and {end:.6g} s ({content.locate[name](row)}), but "
                    f"one every {series.sampling_interval:.3g} s elsewhere: rows are missing, which a simulation "
                    "would bridge by a line; export every row, or end the trial there and begin another one"
                )
                findings.append(Finding("time-gap", f"trial '{trial.name}'", statement))
    places = frozenset(finding.place for finding in findings)
    return TrialFindings([*trial_findings.findings, *findings], trial_findings.questioned_places | places)


def _find_longest_interval(name: str, prescribed: Mapping[str, TimeSeries]) -> int | None:
    """Return the row before the longest interval of channel ``name`` that must not be bridged; None without one."""
    if name.startswith(COMMAND_PREFIX):
        return None
    series = prescribed[name]
    intervals = np.diff(series.time)
    is_long = intervals > max(MAX_INTERVAL, MAX_INTERVAL_RATIO * series.sampling_interval)
    rows = [int(row) for row in np.flatnonzero(is_long) if not _may_bridge(name, int(row), prescribed)]
    return max(rows, key=lambda row: float(intervals[row]), default=None)


def _may_bridge(name: str, row: int, prescribed: Mapping[str, TimeSeries]) -> bool:
    """Return whether a straight line may replace the samples of channel ``name`` after ``row``."""
    series = prescribed[name]
    if name in channels.MOTION_CHANNELS:
        return False
    if name in LOAD_CHANNELS:
        return not _is_loaded(prescribed[channels.VERTICAL_FORCE], *series.time[[row, row + 1]])
    return _is_uniform(series, row)


def _is_loaded(vertical: TimeSeries, start: float, end: float) -> bool:
    """Return whether the foot is loaded at ``start``, at ``end`` or between [s]."""
    is_loaded = find_loaded_samples(vertical.value)
    inside = (vertical.time >= start) & (vertical.time <= end)
    at_ends = interpolate_load_mask(np.array([start, end]), vertical.time, is_loaded)
    return bool(is_loaded[inside].any() or at_ends.any())


def _is_uniform(series: TimeSeries, row: int) -> bool:
    """Return whether ``series`` moves on one straight line before and after the interval that follows ``row``."""
    start, end = series.time[[row, row + 1]]
    margin = max(0.5 * (end - start), MAX_INTERVAL_RATIO * series.sampling_interval)
    near = (series.time >= start - margin) & (series.time <= end + margin)
    time, value = series.time[near] - start, series.value[near]
    deviation = float(np.abs(value - np.polyval(np.polyfit(time, value, 1), time)).max())
    return deviation <= max(MAX_BEND_FRACTION * float(np.ptp(series.value)), MAX_NOISE_RATIO * _estimate_noise(series))


def _estimate_noise(series: TimeSeries) -> float:
    """Return the standard deviation of white noise with the second differences of ``series``."""
    second_differences: Array = np.diff(series.value, 2)
    return float(np.sqrt(np.mean(second_differences**2) / 6.0))
