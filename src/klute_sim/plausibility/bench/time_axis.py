"""The time axis of a trial: its unit, from sampling interval and duration, and its gaps."""

import numpy as np

from klute_sim.plausibility.bench.trial import RecordedTrial
from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.units import UNIT_ADVICE, UNITS, format_value

USUAL_INTERVALS = 1e-4, 0.1
"""Sampling intervals [s] of usual measurements: 10 kHz to 10 Hz."""
USUAL_DURATIONS = 0.4, 3600.0
"""Durations [s] of usual trials."""
POSSIBLE_INTERVALS = 2e-6, 60.0
"""Sampling intervals [s] beyond which no measurement of a muscle is: 500 kHz, once a minute."""
MAX_GAP_RATIO = 30.0
"""Largest ratio of the longest interval to the duration of all others (assumed)."""


def measure_time_axis(trial: RecordedTrial) -> tuple[float, float]:
    """Return the shortest median sampling interval and the longest duration of the channels [s]."""
    axes = [channel.time for channel in trial.channels.values()]
    return (
        min(float(np.median(np.diff(time))) for time in axes),
        max(float(time[-1] - time[0]) for time in axes),
    )


def is_usual(interval: float, duration: float) -> bool:
    """Return whether a trial of this ``duration`` and sampling ``interval`` [s] needs no further evidence."""
    return USUAL_INTERVALS[0] <= interval <= USUAL_INTERVALS[1] and USUAL_DURATIONS[0] <= duration


def is_impossible(interval: float, duration: float) -> bool:
    """Return whether no measurement has this ``interval`` and ``duration`` [s], unless other evidence confirms it."""
    return not POSSIBLE_INTERVALS[0] <= interval <= POSSIBLE_INTERVALS[1] or duration < 0.1 * USUAL_DURATIONS[0]


def list_candidate_units(trial: RecordedTrial) -> dict[str, float]:
    """Return unit -> factor by which all times change, for units that make an unusual time axis usual."""
    return list_usual_units(*measure_time_axis(trial), trial.time_unit[1])


def list_usual_units(interval: float, duration: float, written: float) -> dict[str, float]:
    """Return unit -> factor of all times, for units that make an unusual ``interval`` and ``duration`` [s] usual.

    ``written`` is the factor of the unit in the heading to SI.
    """
    if is_usual(interval, duration):
        return {}
    candidates = {unit: factor / written for unit, factor in UNITS["s"].items()}
    return {
        unit: factor
        for unit, factor in candidates.items()
        if is_usual(interval * factor, duration * factor) and duration * factor <= USUAL_DURATIONS[1]
    }


def describe_time_unit(trial: RecordedTrial, unit: str) -> Finding:
    """Return the finding that the time has another ``unit``."""
    interval, duration = measure_time_axis(trial)
    written, factor = trial.time_unit
    fix = f"is its unit {unit}? {UNIT_ADVICE}" if unit else "its unit or its sampling rate is wrong"
    statement = (
        f"time spans {format_value(duration, written, factor)} with a sample every "
        f"{format_value(interval, written, factor)}, but a bench trial lasts seconds to minutes with 10 to 10,000 "
        f"samples per second, as long as valve and muscle take: {fix}"
    )
    return Finding("time-unit", trial.place, statement)


def check_gaps(trial: RecordedTrial) -> list[Finding]:
    """Return a finding if one interval is far longer than all others together, as after a wrong time stamp."""
    written, factor = trial.time_unit
    for channel in trial.channels.values():
        intervals = np.diff(channel.time)
        longest = int(intervals.argmax())
        others = float(intervals.sum() - intervals[longest])
        if intervals[longest] > MAX_GAP_RATIO * others:
            statement = (
                f"time jumps from {format_value(channel.time[longest], written, factor)} to "
                f"{format_value(channel.time[longest + 1], written, factor)}, but all other samples span "
                f"{format_value(others, written, factor)}: a time stamp seems wrong; correct it or remove its row"
            )
            return [Finding("time-gap", trial.place, statement)]
    return []
