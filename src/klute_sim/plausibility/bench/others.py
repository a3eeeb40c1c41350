"""Whether the other trials of a dataset agree that one of them has a mistake.

A heading or an expression that many files share is right or wrong in all of them. One file may have a mistake of its
own: then its numbers clearly differ from those of its repeats, or from what all others have.
"""

import math
from collections.abc import Sequence

import numpy as np

from klute_sim.plausibility.bench.agreement import MAX_SCALE, MIN_LENGTH_RANGE, MIN_PRESSURE_SCALE, compute_span
from klute_sim.plausibility.bench.assessment import EXCHANGED_PRESSURES, MAX_CHANNEL_MISFIT, MIN_IMPROVEMENT, Assessment
from klute_sim.plausibility.bench.mistakes import Mistake
from klute_sim.plausibility.bench.trial import MEASURED, MIN_FORCE, RecordedTrial
from klute_sim.types import Array

TIE = 0.02
"""Difference of misfits below which two explanations are equally good."""
MIN_SCALE_CHANGE = 0.01
"""Smallest difference of the errors of scale that tells which of two equal waveforms is nearer."""
MIN_AGREEING_SHARE = 2.0 / 3.0
"""Smallest share of the trials that agree better without the mistake among those that tell (assumed)."""
MAX_CONTRADICTION_SHARE = 0.1
"""Largest number of trials that contradict a mistake, relative to those that show it (assumed: files may be broken)."""
PERCENTILES = 5.0, 25.0, 50.0, 75.0, 95.0
"""Percentiles of the samples of repeats that are compared."""
MIN_DISTANCE = 0.1
"""Smallest distance of percentiles, relative to those of the repeat, that repeats do not have (assumed)."""


def confirm_mistake(mistake: Mistake, assessment: Assessment, others: Sequence[Assessment]) -> bool:
    """Return whether ``others`` agree that the trial of ``assessment`` has ``mistake``, which explains it alone."""
    trial = assessment.trial
    if mistake.name == "time-unit":  # sampling interval and duration are evidence of their own
        return True
    changed = [name for name in trial.channels if mistake.trial.channels[name] is not trial.channels[name]]
    sharing = [other for other in others if other is not assessment and trial.shares_sources(other.trial, changed)]
    if _explains_all(mistake, [assessment, *sharing]):
        return True
    without = [other for other in sharing if not _shows(other, mistake)]
    repeats = [other for other in without if other.trial.group == trial.group]
    if repeats:
        return any(_resembles_after(mistake, trial, repeat.trial, changed) for repeat in repeats)
    has_scale = mistake.name.endswith(("-unit", "-sign"))
    return has_scale and bool(without) and all(_differ_in_scale(assessment, other) for other in without)


def confirm_calibration(assessment: Assessment, others: Sequence[Assessment]) -> bool:
    """Return whether ``others`` agree that the force of ``assessment`` was never calibrated, which its trial shows."""
    sharing = [
        other
        for other in others
        if "force" in other.agreements and assessment.trial.shares_sources(other.trial, ["force"])
    ]
    without = [other for other in sharing if other.calibration is None]
    return 2 * len(without) <= len(sharing) or all(_differ_in_scale(assessment, other) for other in without)


def _shows(assessment: Assessment, mistake: Mistake) -> bool:
    outcome = assessment.find_outcome(mistake.key)
    return outcome is not None and outcome.is_convincing


def _explains_all(mistake: Mistake, assessments: Sequence[Assessment]) -> bool:
    """Return whether ``mistake`` may be one of the columns that all ``assessments`` share."""
    n_showing = n_contradictions = 0
    is_better: list[bool] = []
    for assessment in assessments:
        outcome = assessment.find_outcome(mistake.key)
        if outcome is None:
            if mistake.name.endswith("-exchanged") and mistake.name != EXCHANGED_PRESSURES:
                return False
            n_contradictions += assessment.is_credible
            continue
        n_showing += outcome.is_convincing
        n_contradictions += assessment.is_credible and outcome.worst > MAX_CHANNEL_MISFIT
        decrease, scale_decrease = outcome.before - outcome.after, assessment.scale_error - outcome.scale_error
        if outcome.is_convincing:
            is_better.append(True)
        elif abs(decrease) > TIE:
            is_better.append(decrease > 0.0)
        elif abs(scale_decrease) > MIN_SCALE_CHANGE:
            is_better.append(scale_decrease > 0.0)
    is_shared = sum(is_better) >= MIN_AGREEING_SHARE * len(is_better)
    return is_shared and n_contradictions <= MAX_CONTRADICTION_SHARE * n_showing


def _resembles_after(mistake: Mistake, trial: RecordedTrial, repeat: RecordedTrial, channels: Sequence[str]) -> bool:
    """Return whether the samples of ``channels`` are those of ``repeat`` without ``mistake`` only."""
    before, after = (
        math.hypot(*(_measure_distance(compared_trial, repeat, channel) for channel in channels))
        for compared_trial in (trial, mistake.trial)
    )
    return before > max(MIN_DISTANCE, MIN_IMPROVEMENT * after)


def _measure_distance(trial: RecordedTrial, repeat: RecordedTrial, channel: str) -> float:
    """Return the distance between the percentiles of a channel, relative to those of ``repeat``."""
    first, second = (
        np.percentile(compared_trial.get_samples(channel).finite, PERCENTILES) for compared_trial in (trial, repeat)
    )
    scale = float(np.sqrt(np.mean(second**2)))
    return float(np.sqrt(np.mean((first - second) ** 2))) / scale if scale > 0.0 else 0.0


def _differ_in_scale(first: Assessment, second: Assessment) -> bool:
    """Return whether some channel has another sign, or a scale that the law of the device cannot explain."""
    scales = [_measure_scales(assessment) for assessment in (first, second)]
    return any(
        scales[0][name] * scales[1][name] < 0.0
        or abs(math.log(scales[0][name] / scales[1][name])) > math.log(MAX_SCALE)
        for name in scales[0].keys() & scales[1].keys()
    )


def _measure_scales(assessment: Assessment) -> dict[str, float]:
    """Return measured channel -> ratio of its size to the simulated one, with the sign of the samples."""
    trial, response = assessment.trial, assessment.response
    if response is None:
        return {}
    limits = trial.limits
    floors = {
        "force": max(MIN_FORCE, 0.02 * limits.max_force),
        "pressure": MIN_PRESSURE_SCALE * limits.supply_pressure,
        "muscle_length": MIN_LENGTH_RANGE,
    }
    simulated = {"force": response.force, "pressure": response.pressure, "muscle_length": response.muscle_length}
    scales = {}
    for name in MEASURED:
        if name in trial.channels:
            measured = trial.get_samples(name).finite
            sizes = [max(_measure_size(name, values), floors[name]) for values in (measured, simulated[name])]
            is_negative = name != "muscle_length" and float(np.median(measured)) < -floors[name]
            scales[name] = (-1.0 if is_negative else 1.0) * sizes[0] / sizes[1]
    return scales


def _measure_size(name: str, values: Array) -> float:
    """Return the size of a channel; the zero of a muscle length is arbitrary."""
    return compute_span(values) if name == "muscle_length" else float(np.percentile(np.abs(values), 95.0))
