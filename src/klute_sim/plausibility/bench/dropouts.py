"""Lost and wrong samples: a measured channel jumps to one value, stays there exactly, and jumps back; or a spike."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from klute_sim.plausibility.bench.agreement import compute_span, simulate_trial
from klute_sim.plausibility.bench.trial import MEASURED, PRESCRIBED, Channel, RecordedTrial
from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.spikes import describe_spikes, find_spikes, mark_runs
from klute_sim.plausibility.units import format_value
from klute_sim.types import Array

MIN_RUN_SAMPLES = 5
"""Smallest number of equal samples in a row."""
MIN_JUMP = 0.3
"""Smallest jump into and out of the run, relative to the range of the channel (assumed; clipping has no jump)."""
MIN_JUMP_CHANGES = 6.0
"""Smallest such jump, relative to the median change between successive samples that differ (assumed). A quiet channel
often stays at one code of its converter for some samples, and returns from a neighbouring one."""
MAX_USUAL_CHANGE = 0.04
"""Largest usual change, relative to the range of the device (assumed: 8 bits over ten times that range); a median
above it is that of jumps between levels without noise."""
MAX_CHANGE = 0.5
"""Largest change over the run relative to its smaller jump; a step of the pressure stays where it jumps to."""
MAX_LAG = 0.2
"""Longest time [s] by which a device may answer later or earlier than its simulation (assumed: hoses, regulators)."""


def check_dropouts(trial: RecordedTrial) -> list[Finding]:
    """Return a finding for each measured channel with lost or wrong samples, which a simulation does not have."""
    findings = []
    for name in (name for name in MEASURED if name in trial.channels):
        channel = trial.channels[name]
        samples = channel.samples
        spikes = _find_spikes(trial, name)
        if spikes:
            is_wrong = mark_runs(samples.value, spikes)
            cause = "a simulation of this device does not jump there"
            findings.append(describe_spikes(samples, channel.time, is_wrong, trial.place, cause))
            continue
        run = _find_dropout(channel, trial.limits.get_span(name))
        if run is None or not _contradicts_simulation(trial, name, run):
            continue
        texts = [format_value(float(value), samples.unit, samples.factor) for value in samples.finite[run[0] - 1 :][:2]]
        statement = (
            f"{name} jumps from {texts[0]} to exactly {texts[1]}, stays there for {run[1] - run[0]} samples and "
            "jumps back: these samples seem to be missing; leave their cells empty"
        )
        findings.append(Finding(f"{name}-missing", trial.place, statement))
    return findings


def _find_dropout(channel: Channel, device_span: float) -> tuple[int, int] | None:
    """Return first and last index + 1 of the first dropout among the finite samples of ``channel``.

    ``device_span`` is the range of the channel on the device [SI], infinite where it is unknown.
    """
    values: Array = channel.samples.finite
    edges = np.flatnonzero(np.diff(values)) + 1
    if len(edges) == 0:
        return None
    usual_change = float(np.median(np.abs(values[edges] - values[edges - 1])))
    min_jump = max(
        MIN_JUMP * compute_span(values), MIN_JUMP_CHANGES * min(usual_change, MAX_USUAL_CHANGE * device_span)
    )
    for start, stop in pairwise(edges):
        if stop - start >= MIN_RUN_SAMPLES:
            before, after, value = values[start - 1], values[stop], values[start]
            jump = min(abs(before - value), abs(after - value))
            if jump > min_jump and abs(after - before) < MAX_CHANGE * jump:
                return int(start), int(stop)
    return None


def _find_spikes(trial: RecordedTrial, name: str) -> list[tuple[int, int]]:
    """Return first index and index + 1 of each spike among the finite samples that a simulation does not have."""
    channel, span = trial.channels[name], trial.limits.get_span(name)
    if not np.isfinite(span):
        return []
    time = channel.time[np.isfinite(channel.samples.value)]
    spikes = find_spikes(time, channel.samples.finite, MIN_JUMP * span)
    return [run for run in spikes if _contradicts_simulation(trial, name, run)]


def _contradicts_simulation(trial: RecordedTrial, name: str, run: tuple[int, int]) -> bool:
    """Return whether the simulated channel jumps to the value of the ``run`` at no time near it."""
    channel = trial.channels[name]
    time, values = channel.time[np.isfinite(channel.samples.value)], channel.samples.finite
    start, stop = float(time[run[0] - 1]), float(time[run[1] - 1])
    response = simulate_trial(trial)
    if response is not None and not response.time[0] <= stop <= response.time[-1]:  # a long trial is simulated in part
        response = simulate_trial(_cut_inputs(trial, start - MAX_LAG, stop + MAX_LAG))
    if response is None:
        return False
    simulated = {"force": response.force, "pressure": response.pressure, "muscle_length": response.muscle_length}[name]
    jump = float(values[run[0]] - values[run[0] - 1])
    level = np.sign(jump) * simulated
    before = level[(response.time >= start - MAX_LAG) & (response.time <= max(start, response.time[0]))]
    after = level[(response.time > start) & (response.time <= stop + MAX_LAG)]
    if before.size == 0 or after.size == 0:
        return False
    return float(after.max() - before.min()) < MAX_CHANGE * abs(jump)


def _cut_inputs(trial: RecordedTrial, start: float, stop: float) -> RecordedTrial:
    """Return ``trial`` with its length and its command at the times from ``start`` to ``stop`` [s] only."""
    channels = dict(trial.channels)
    for name in PRESCRIBED:
        time, samples = channels[name]
        is_finite = np.isfinite(samples.value)
        inside = np.unique(np.concatenate([[start, stop], time[(time > start) & (time < stop)]]))
        value = np.interp(inside, time[is_finite], samples.value[is_finite])
        channels[name] = Channel(inside, samples._replace(value=value))
    return replace(trial, channels=channels)
