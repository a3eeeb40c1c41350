"""All checks of the trials of a bench in order: what is wrong with the inputs makes a simulation meaningless."""

import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from klute_sim.plausibility.bench import time_axis
from klute_sim.plausibility.bench.absolute_pressures import check_absolute_pressures
from klute_sim.plausibility.bench.agreement import Agreement
from klute_sim.plausibility.bench.assessment import MAX_CHANNEL_MISFIT, MIN_MISFIT, Assessment
from klute_sim.plausibility.bench.dropouts import check_dropouts
from klute_sim.plausibility.bench.geometry import check_force_geometry
from klute_sim.plausibility.bench.magnitudes import (
    LENGTH_GEOMETRY,
    LENGTH_UNIT,
    LENGTH_ZERO,
    check_all_commands,
    check_magnitudes,
    check_missing_value_codes,
    check_spikes,
    is_at_rest,
)
from klute_sim.plausibility.bench.mistakes import Mistake, list_mistakes, list_time_units
from klute_sim.plausibility.bench.others import TIE, confirm_calibration, confirm_mistake
from klute_sim.plausibility.bench.trial import RecordedTrial
from klute_sim.plausibility.finding import Finding, TrialFindings, are_accepted
from klute_sim.plausibility.units import format_range


def check_bench_trials(trials: Sequence[RecordedTrial], accepted: Collection[str] = ()) -> TrialFindings:
    """Return what is implausible in ``trials``; ``accepted`` holds names of findings that the user accepts."""
    findings: list[Finding] = []
    assessments = []
    for recorded in trials:
        codes, trial = check_missing_value_codes(recorded)
        spikes, trial = check_spikes(trial)
        findings += [*codes, *spikes]
        if any(channel.samples.finite.size < 5 for channel in trial.channels.values()):
            continue
        gaps = time_axis.check_gaps(trial)
        findings += gaps
        if not gaps:
            assessments.append(Assessment(trial, check_magnitudes(trial)))
    absolute_pressures = check_absolute_pressures(
        [trial_assessment for trial_assessment in assessments if not trial_assessment.magnitudes]
    )
    absolute_places = {finding.place for finding in absolute_pressures}
    findings += absolute_pressures
    _mark_wrong_lengths(assessments)
    _mark_resting_displacements(assessments)
    for assessment in assessments:
        if assessment.trial.place not in absolute_places:
            mistake = _find_mistake(assessment, assessments)
            findings += mistake or assessment.magnitudes or check_dropouts(assessment.trial)
    # A wrong unit of time makes every simulation of a trial meaningless, so what else one seems to show is not told.
    if "time-unit" not in accepted:
        findings = [finding for finding in findings if finding.name == "time-unit"] or findings
    questioned_places = frozenset(finding.place for finding in findings)
    if are_accepted(findings, accepted):
        trusted = [
            trial_assessment
            for trial_assessment in assessments
            if trial_assessment.trial.place not in questioned_places
        ]
        findings += _check_together(trusted, accepted)
    return TrialFindings(findings, questioned_places)


def _check_together(assessments: Sequence[Assessment], accepted: Collection[str]) -> list[Finding]:
    """Return what is implausible in trials that have no findings of their own."""
    findings = check_force_geometry(assessments)
    if not are_accepted(findings, accepted):
        return findings
    places = {finding.place for finding in findings}
    others = [
        assessment
        for assessment in assessments
        if assessment.trial.place not in places and not _explains_force(assessment)
    ]
    return [*findings, *check_all_commands([assessment.trial for assessment in others])]


def _mark_wrong_lengths(assessments: Sequence[Assessment]) -> None:
    """Mark the trials whose lengths are read from the same columns as lengths that no muscle has."""
    stretched = [
        trial_assessment.trial
        for trial_assessment in assessments
        if any(f.name == LENGTH_GEOMETRY for f in trial_assessment.magnitudes)
    ]
    for assessment in assessments:
        assessment.has_wrong_range |= any(assessment.trial.shares_sources(trial, ["length"]) for trial in stretched)


def _mark_resting_displacements(assessments: Sequence[Assessment]) -> None:
    """Give trials at rest the finding of those with the same columns that show a displacement in place of a length.

    A displacement that does not change may as well be a length in another unit.
    """
    displaced = [a.trial for a in assessments if any(finding.name == LENGTH_ZERO for finding in a.magnitudes)]
    for assessment in assessments:
        trial = assessment.trial
        has_unit_finding = any(finding.name == LENGTH_UNIT for finding in assessment.magnitudes)
        if not (has_unit_finding and is_at_rest(trial)):
            continue
        if any(trial.shares_sources(other, ["length"]) for other in displaced):
            statement = (
                f"length is {trial.format_channel('length')}, and in other trials of this column it looks like a "
                "displacement from a zero of the tester; add the length of the unit at that zero"
            )
            assessment.magnitudes = [
                Finding(LENGTH_ZERO, trial.place, statement) if finding.name == LENGTH_UNIT else finding
                for finding in assessment.magnitudes
            ]


def _find_mistake(assessment: Assessment, assessments: Sequence[Assessment]) -> list[Finding]:
    """Return the findings of the mistake whose correction makes the trial agree with a simulation of its device.

    The other trials that share its columns must agree.
    """
    trial = assessment.trial
    best: Mistake | None = None
    best_misfit, best_scale_error = 1.0, math.inf
    for mistake in list_mistakes(trial) if assessment.is_suspicious else ():
        outcome = assessment.judge(mistake)
        if outcome is None or not outcome.is_convincing:
            continue
        is_same_mistake = best is not None and mistake.name == best.name
        is_nearer = is_same_mistake and outcome.misfit < best_misfit + TIE and outcome.scale_error < best_scale_error
        is_better = best is None or outcome.misfit < best_misfit - TIE or is_nearer
        if is_better and confirm_mistake(mistake, assessment, assessments):
            best, best_misfit, best_scale_error = mistake, outcome.misfit, outcome.scale_error
    if best is not None:
        return [_complete(finding, trial, assessment.agreements) for finding in best.findings]
    if assessment.has_wrong_range:
        return []
    if time_axis.is_impossible(*time_axis.measure_time_axis(trial)) and assessment.misfit > MIN_MISFIT:
        candidates = list(list_time_units(trial))
        return list(candidates[0].findings) if candidates else [time_axis.describe_time_unit(trial, "")]
    return _check_calibration(assessment, assessments)


def _check_calibration(assessment: Assessment, assessments: Sequence[Assessment]) -> list[Finding]:
    """Return a finding for a force that has the simulated waveform and a scale that no unit explains."""
    trial = assessment.trial
    factor = assessment.calibration
    if factor is None or not confirm_calibration(assessment, assessments):
        return []
    statement = (
        f"force is {trial.format_channel('force')}, but {{simulated_force}}, with the same waveform and {factor:.3g} "
        "times the size: is it a voltage or a raw reading? State its calibration in [columns]"
    )
    return [_complete(Finding("force-unit", trial.place, statement), trial, assessment.agreements)]


def _complete(finding: Finding, trial: RecordedTrial, agreements: Mapping[str, Agreement]) -> Finding:
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


def _explains_force(assessment: Assessment) -> bool:
    """Return whether the measured force agrees with a simulation under the commands as they are."""
    force = assessment.agreements.get("force")
    return force is not None and force.misfit < MAX_CHANNEL_MISFIT
