"""Whether the forces of a specimen agree with its declared geometry, where no unit explains why they do not."""

from collections.abc import Sequence

import numpy as np

from klute_sim.plausibility.bench.agreement import MAX_SCALE, MIN_CALIBRATION, Agreement, varies
from klute_sim.plausibility.bench.assessment import Assessment
from klute_sim.plausibility.bench.trial import DeviceLimits
from klute_sim.plausibility.finding import Finding

MAX_EXCESS = 2.5
"""Largest ratio of the forces of a specimen to the simulated ones (assumed: a real muscle loses force, so only errors
of its geometry make it stronger; a diameter that is wrong by a quarter gives 1.6, a second muscle 2)."""
MIN_CLEAR_CORRELATION = 0.999
"""Smallest correlation of a trial whose waveform the law explains (assumed: noise and hysteresis leave
some per cent)."""


def check_force_geometry(assessments: Sequence[Assessment]) -> list[Finding]:
    """Return a finding for each trial of the specimens whose forces disagree with the declared geometry.

    Single conditions may disagree, because the law is imperfect: the trials of a specimen are judged together, by those
    that the law explains but for the scale.
    """
    specimens: dict[tuple[str, DeviceLimits], list[Assessment]] = {}
    for assessment in assessments:
        specimens.setdefault((assessment.trial.specimen, assessment.trial.limits), []).append(assessment)
    findings = []
    for group in specimens.values():
        pulling = [
            member
            for member in group
            if "force" in member.agreements and varies(member.trial.get_samples("force").finite)
        ]
        if group[0].trial.limits.pulls and _disagree([e.agreements["force"] for e in pulling]):
            findings += _describe(pulling)
    return findings


def _disagree(forces: Sequence[Agreement]) -> bool:
    """Return whether sizes and ranges of the ``forces`` are both off, so that no wrong zero explains it.

    Only a waveform that the law explains tells the scale. No geometry explains a force that was never calibrated.
    """
    clear = [force for force in forces if force.correlation >= MIN_CLEAR_CORRELATION]
    if not clear:
        return False
    size_ratio = float(np.median([force.size_ratio for force in clear]))
    span_ratio = float(np.median([force.span_ratio for force in clear]))
    low, high = sorted((size_ratio, span_ratio))
    return MAX_EXCESS < low <= high < MIN_CALIBRATION or 1.0 / MIN_CALIBRATION < low <= high < 1.0 / MAX_SCALE


def _describe(group: Sequence[Assessment]) -> list[Finding]:
    ratios = [assessment.agreements["force"].size_ratio for assessment in group]
    specimen = f"specimen '{group[0].trial.specimen}'" if group[0].trial.specimen else "this muscle"
    scope = ""
    if len(group) > 1:
        scope = f" ({min(ratios):.2g} to {max(ratios):.2g} times in the {len(group)} trials of {specimen})"
    return [
        Finding(
            "force-geometry",
            assessment.trial.place,
            f"force is {assessment.trial.format_channel('force')}, {ratio:.2g} times that of a simulation of this "
            f"device{scope}, and no unit explains it: force and declared geometry disagree; check the diameter "
            "([diameter], muscle.bladder_radius_mm), muscle.resting_length_mm, muscle.count, and which specimen was "
            "recorded",
        )
        for assessment, ratio in zip(group, ratios, strict=True)
    ]
