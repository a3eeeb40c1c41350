"""Absolute pressures in all trials: each rests at the pressure of the atmosphere, where the muscle does not pull.

A pressure that is too high by a constant changes neither the waveform of the force nor the agreement of pressure and
command. A gauge that idles at a residual pressure differs in the force, which is that of the residual pressure.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from klute_sim.plausibility.bench.assessment import PRESSURE_PAIR, Assessment
from klute_sim.plausibility.bench.mistakes import ATMOSPHERE
from klute_sim.plausibility.bench.trial import MIN_FORCE, RecordedTrial
from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.samples import Samples
from klute_sim.plausibility.units import format_value
from klute_sim.types import Array

LOWEST_ATMOSPHERE, HIGHEST_ATMOSPHERE = 0.85 * ATMOSPHERE, 1.05 * ATMOSPHERE
"""Absolute pressures [Pa] at which a vented muscle rests, and by which an absolute pressure exceeds its gauge command
(assumed: laboratories up to 1300 m, gauges that are off)."""
REST_PERCENTILE = 2.0
"""Percentile of a pressure at rest."""
REST_TOLERANCE = 0.05 * ATMOSPHERE
"""Largest pressure [Pa] above that at rest which still counts as rest (assumed)."""
MIN_REST_SAMPLES = 5
"""Smallest number of samples at rest."""
MIN_PRESSURE_RATIO = 1.5
"""Smallest ratio of the largest pressure to that at rest (assumed)."""
MIN_PROPORTIONALITY = 0.5
"""Smallest ratio of the simulated share of the force at rest to that of the pressure (assumed): a stiff or short muscle
does not pull under a small gauge pressure either."""
MAX_REST_FORCE = 0.1
"""Largest force at rest relative to that under a gauge pressure (assumed: thresholds and load cells are not exact)."""


class RestForce(NamedTuple):
    """Force of a trial at its lowest pressure."""

    trial: RecordedTrial
    """The trial."""
    measured: float
    """Measured force [N]."""
    simulated: float
    """Force under a gauge pressure [N]."""
    expected: float
    """Simulated force, scaled by the largest measured force [N]."""


def check_absolute_pressures(assessments: Sequence[Assessment]) -> list[Finding]:
    """Return findings for the trials whose pressures are absolute; trials of one specimen and one gauge agree."""
    gauges: dict[tuple[str, ...], list[Assessment]] = {}
    for assessment in assessments:
        trial = assessment.trial
        gauge = (trial.sources.get(name, "") if name in trial.channels else "-" for name in PRESSURE_PAIR)
        gauges.setdefault((trial.specimen, *gauge), []).append(assessment)
    findings = []
    for group in gauges.values():
        if all(_rests_at_atmosphere(assessment.trial) for assessment in group):
            rests = [rest for rest in map(_measure_rest, group) if rest is not None]
            if rests and all(abs(rest.measured) < MAX_REST_FORCE * rest.expected for rest in rests):
                findings += [finding for member in group for finding in _describe(member.trial, rests[0])]
    return findings


def _list_pressures(trial: RecordedTrial) -> list[str]:
    return [name for name in PRESSURE_PAIR if name in trial.channels]


def _get_rest_pressure(samples: Samples) -> float:
    return float(np.percentile(samples.finite, REST_PERCENTILE))


def _rests_at_atmosphere(trial: RecordedTrial) -> bool:
    lowest = [_get_rest_pressure(trial.get_samples(name)) for name in _list_pressures(trial)]
    return all(LOWEST_ATMOSPHERE <= pressure <= HIGHEST_ATMOSPHERE for pressure in lowest)


def _measure_rest(assessment: Assessment) -> RestForce | None:
    """Return the force at rest, or None where it tells nothing."""
    trial, response = assessment.trial, assessment.response
    if "force" not in assessment.agreements or response is None or assessment.is_loaded:
        return None
    force = trial.channels["force"]
    is_inside = (force.time >= response.time[0]) & (force.time <= response.time[-1]) & np.isfinite(force.samples.value)
    time, measured = force.time[is_inside], force.samples.value[is_inside]
    simulated: Array = assessment.agreements["force"].simulated
    is_at_rest = np.ones(len(time), dtype=np.bool_)
    for name in _list_pressures(trial):
        channel, lowest = trial.channels[name], _get_rest_pressure(trial.get_samples(name))
        is_finite = np.isfinite(channel.samples.value)
        is_at_rest &= (
            np.interp(time, channel.time[is_finite], channel.samples.value[is_finite]) < lowest + REST_TOLERANCE
        )
    command = trial.get_samples("pressure_command").finite
    pressure_ratio = float(np.percentile(command, 95.0)) / _get_rest_pressure(trial.get_samples("pressure_command"))
    if is_at_rest.sum() < MIN_REST_SAMPLES or pressure_ratio < MIN_PRESSURE_RATIO:
        return None
    at_rest = float(np.median(simulated[is_at_rest]))
    largest = [float(np.percentile(values, 95.0)) for values in (measured, simulated)]
    is_small = at_rest < max(MIN_FORCE, 0.02 * trial.limits.max_force)
    if is_small or at_rest * pressure_ratio < MIN_PROPORTIONALITY * largest[1]:
        return None
    return RestForce(trial, float(np.median(measured[is_at_rest])), at_rest, at_rest / largest[1] * largest[0])


def _describe(trial: RecordedTrial, rest: RestForce) -> list[Finding]:
    samples = rest.trial.get_samples("force")
    forces = [format_value(value, samples.unit, samples.factor) for value in (rest.measured, rest.simulated)]
    place = "" if rest.trial is trial else f" in {rest.trial.place}"
    return [
        Finding(
            f"{name}-absolute",
            trial.place,
            f"{name} is {trial.format_channel(name)} and never below the pressure of the atmosphere, "
            f"{trial.format_limit(name, ATMOSPHERE)}, at which force is {forces[0]}{place}, where a simulation of this "
            f"device under gauge pressures gives {forces[1]}: it looks like absolute pressure; subtract the pressure "
            "of the atmosphere (or add the missing force, if the load cell was zeroed under pressure)",
        )
        for name in reversed(_list_pressures(trial))
    ]
