"""Find steps beside the plates: stance that a replay would run without load."""

from collections.abc import Sequence

import numpy as np

from klute_sim.datasets.channels import VERTICAL_FORCE
from klute_sim.datasets.foot_load import find_loaded_samples
from klute_sim.datasets.trial import Trial
from klute_sim.gait.contacts import MAX_SWING_TIME
from klute_sim.mask_runs import find_runs
from klute_sim.plausibility.finding import Finding

MAX_SWING_RATIO = 1.25
"""Largest ratio of the time without load at the start or the end of a trial to its longest swing (assumed)."""


def find_unloaded_steps(trials: Sequence[Trial]) -> list[Finding]:
    """Return findings on gait ``trials`` in which the foot is without load for longer than a swing."""
    return [finding for trial in trials for finding in _check_trial(trial)]


def _check_trial(trial: Trial) -> list[Finding]:
    start = max(series.time[0] for series in trial.prescribed.values())
    end = min(series.time[-1] for series in trial.prescribed.values())
    load = trial.prescribed[VERTICAL_FORCE]
    inside = (load.time >= start) & (load.time <= end)
    time, is_loaded = load.time[inside], find_loaded_samples(load.value)[inside]
    if not is_loaded.any():  # the preparation of the trial reports it
        return []
    runs = [(int(a), int(b) - 1) for a, b in find_runs(~is_loaded)]
    durations = np.array([time[last] - time[first] for first, last in runs])
    is_swing = np.array([first > 0 and last < len(time) - 1 for first, last in runs], dtype=np.bool_)
    swings = durations[is_swing & (durations <= MAX_SWING_TIME)]
    max_end_time = MAX_SWING_RATIO * float(swings.max()) if len(swings) else MAX_SWING_TIME
    too_long = durations > np.where(is_swing, MAX_SWING_TIME, min(max_end_time, MAX_SWING_TIME))
    if not too_long.any():
        return []
    first, last = runs[int(np.argmax(durations * too_long))]
    statement = (
        f"`{VERTICAL_FORCE}` shows no load from {time[first]:.6g} to {time[last]:.6g} s, longer than a swing: the foot "
        "stands beside the plates, which a replay would run without load; cut the trial to the steps on plates"
    )
    return [Finding("plate-gap", f"trial '{trial.name}'", statement)]
