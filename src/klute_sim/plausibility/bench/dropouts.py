"""Lost samples: a measured channel jumps to one value, stays there exactly, and jumps back."""

from itertools import pairwise

import numpy as np

from klute_sim.plausibility.bench.agreement import compute_span, simulate_trial
from klute_sim.plausibility.bench.trial import MEASURED, Channel, RecordedTrial
from klute_sim.plausibility.finding import Finding
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


def check_dropouts(trial: RecordedTrial) -> list[Finding]:
    """Return a finding for each measured channel with lost samples, which a simulation of the device does not have."""
    findings = []
    for name in MEASURED:
        channel = trial.channels.get(name)
        run = None if channel is None else _find_dropout(channel, trial.limits.get_span(name))
        if channel is None or run is None or not _contradicts_simulation(trial, name, run):
            continue
        samples = channel.samples
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


def _contradicts_simulation(trial: RecordedTrial, name: str, run: tuple[int, int]) -> bool:
    """Return whether the simulated channel stays away from the value of the ``run``."""
    response, channel = simulate_trial(trial), trial.channels[name]
    if response is None:
        return False
    simulated = {"force": response.force, "pressure": response.pressure, "muscle_length": response.muscle_length}[name]
    time = channel.time[np.isfinite(channel.samples.value)][run[0] - 1 : run[1]]
    expected, values = np.interp(time, response.time, simulated), channel.samples.finite
    jump = float(values[run[0]] - values[run[0] - 1])
    change = float(np.median(expected[1:])) - float(expected[0])
    return change / jump < MAX_CHANGE
