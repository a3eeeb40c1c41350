"""All checks of a bench trial in order: what is wrong with the inputs makes a simulation meaningless."""

import math
from collections.abc import Sequence

import numpy as np

from klute_sim.plausibility.bench import time_axis
from klute_sim.plausibility.bench.agreement import (
    Agreement,
    compare_trial,
    find_calibration,
    moves_under_load,
    simulate_trial,
)
from klute_sim.plausibility.bench.causality import leads
from klute_sim.plausibility.bench.dropouts import check_dropouts
from klute_sim.plausibility.bench.magnitudes import check_all_commands, check_magnitudes, check_missing_value_codes
from klute_sim.plausibility.bench.mistakes import Mistake, list_mistakes, list_time_units
from klute_sim.plausibility.bench.trial import MEASURED, PRESCRIBED, RecordedTrial, Response
from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.units import format_range

MIN_MISFIT = 0.03
"""Misfit of a trial below which a trial needs no explanation (assumed: sensors are about as good as a hundredth)."""
MAX_CHANNEL_MISFIT = 0.6
"""Largest misfit of any channel without the mistake."""
MIN_IMPROVEMENT = 3.0
"""Smallest ratio of the misfit with the mistake to that without it; below, the evidence is not overwhelming."""
MIN_DECREASE = 0.003
"""Smallest decrease of the misfit."""
PRESSURE_PAIR = ("pressure", "pressure_command")
"""Effect and cause."""
EVIDENCE = {"time-scale": (4.0, 0.12), "pressure-pressure_command-exchanged": (1.5, 0.6)}
"""Finding -> smallest ratio and largest misfit, where they differ. A slow regulator looks like a wrong sampling rate at
first sight; a pressure that changes before its command is evidence of its own."""
TIE = 0.02
"""Difference of misfits below which the simpler of two mistakes is chosen."""


def check_bench_trials(trials: Sequence[RecordedTrial]) -> list[Finding]:
    """Return what is implausible in ``trials``."""
    findings = [finding for trial in trials for finding in check_bench_trial(trial)]
    # A wrong unit of time makes every simulation of a trial meaningless, so what else one seems to show is not told.
    findings = [finding for finding in findings if finding.name == "time-unit"] or findings
    return findings or check_all_commands([trial for trial in trials if not _explains_force(trial)])


def check_bench_trial(trial: RecordedTrial) -> list[Finding]:
    """Return what is implausible in one trial."""
    codes, trial = check_missing_value_codes(trial)
    if any(channel.samples.finite.size < 5 for channel in trial.channels.values()):
        return codes
    gaps = time_axis.check_gaps(trial)
    if gaps:
        return [*codes, *gaps]
    magnitudes = check_magnitudes(trial)
    return [*codes, *(_search_mistake(trial, has_wrong_range=bool(magnitudes)) or magnitudes or check_dropouts(trial))]


def _search_mistake(trial: RecordedTrial, *, has_wrong_range: bool) -> list[Finding]:
    """Return the findings of the mistake whose correction makes the trial agree with a simulation of its device.

    Where the range of a channel is wrong already, only exchanged columns are searched for: they explain it better.
    """
    response = simulate_trial(trial)
    is_loaded = moves_under_load(trial)
    agreements = compare_trial(trial, response, has_constant_load=is_loaded)
    misfit = _combine_misfits(agreements)
    interval, duration = time_axis.measure_time_axis(trial)
    best: Mistake | None = None
    best_misfit, best_scale_error = 1.0, math.inf
    is_suspicious = not agreements or misfit > MIN_MISFIT or has_wrong_range or leads(trial, *PRESSURE_PAIR)
    for mistake in list_mistakes(trial) if is_suspicious else ():
        if has_wrong_range and not mistake.findings[0].name.endswith("-exchanged"):
            continue
        changed_response = _simulate_changed(trial, response, mistake.trial)
        corrected = compare_trial(mistake.trial, changed_response, has_constant_load=is_loaded)
        if not corrected or not agreements.keys() <= corrected.keys():
            continue
        corrected_misfit = _combine_misfits(corrected)
        min_ratio, max_misfit = EVIDENCE.get(mistake.findings[0].name, (MIN_IMPROVEMENT, MAX_CHANNEL_MISFIT))
        before, after = (_combine_misfits(each, mistake.evidence) for each in (agreements, corrected))
        is_convincing = max(agreement.misfit for agreement in corrected.values()) <= max_misfit and before >= max(
            min_ratio * after, MIN_DECREASE + after
        )
        # Units of one channel give equal courses: the right one gives the magnitude, too.
        scale_error = sum(agreement.scale_error for agreement in corrected.values())
        is_same_mistake = best is not None and mistake.findings[0].name == best.findings[0].name
        is_nearer = is_same_mistake and corrected_misfit < best_misfit + TIE and scale_error < best_scale_error
        if is_convincing and (best is None or corrected_misfit < best_misfit - TIE or is_nearer):
            best, best_misfit, best_scale_error = mistake, corrected_misfit, scale_error
    if best is not None:
        return [_complete(finding, trial, agreements) for finding in best.findings]
    if time_axis.is_impossible(interval, duration) and not has_wrong_range and misfit > MIN_MISFIT:
        candidates = list(list_time_units(trial))
        return list(candidates[0].findings) if candidates else [time_axis.describe_time_unit(trial, "")]
    return [] if has_wrong_range else _check_calibration(trial, agreements)


def _check_calibration(trial: RecordedTrial, agreements: dict[str, Agreement]) -> list[Finding]:
    """Return a finding for a force that has the simulated course and a scale that no unit explains."""
    factor = find_calibration(trial, agreements["force"]) if "force" in agreements else None
    if factor is None:
        return []
    statement = (
        f"force is {trial.format_channel('force')}, but {{simulated_force}}, with the same course and {factor:.3g} "
        "times the size: is it a voltage or a raw reading? State its calibration in [columns]"
    )
    return [_complete(Finding("force-unit", trial.place, statement), trial, agreements)]


def _simulate_changed(trial: RecordedTrial, response: Response | None, changed: RecordedTrial) -> Response | None:
    """Return the response of ``changed``, which is that of ``trial`` where only measured channels differ."""
    if all(changed.channels[name] is trial.channels[name] for name in PRESCRIBED):
        return response
    return simulate_trial(changed)


def _combine_misfits(agreements: dict[str, Agreement], channels: Sequence[str] = MEASURED) -> float:
    """Return the root mean square of the misfits of ``channels``; 1 where none of them can be compared."""
    misfits = [agreement.misfit for name, agreement in agreements.items() if name in channels]
    return float(np.sqrt(np.mean(np.square(misfits)))) if misfits else 1.0


def _complete(finding: Finding, trial: RecordedTrial, agreements: dict[str, Agreement]) -> Finding:
    """Return ``finding`` with the simulated range of each channel in its statement."""
    statement = finding.statement
    for name, channel in trial.channels.items():
        text = "a simulation of this device agrees only with other values"
        if name in agreements:
            simulated = np.percentile(agreements[name].simulated, [1.0, 99.0])
            text = "a simulation of this device under the lengths and commands of the trial gives " + format_range(
                simulated, channel.samples.unit, channel.samples.factor
            )
        statement = statement.replace(f"{{simulated_{name}}}", text)
    return finding._replace(statement=statement)


def _explains_force(trial: RecordedTrial) -> bool:
    """Return whether the measured force agrees with a simulation under the commands as they are."""
    agreement = compare_trial(trial, simulate_trial(trial)).get("force")
    return agreement is not None and agreement.misfit < MAX_CHANNEL_MISFIT
