"""Trajectory of a joint: its sign, its unit and its zero, by where the declared model rests.

The model at rest under the commands of each moment follows a slow motion. An oscillation that it lacks is averaged out
over the natural period of the joint. Numbers of a model that are 20 % off hardly change the trajectory.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from klute_sim.plausibility.bench.trial import RecordedTrial
from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.samples import Samples, compute_correlation
from klute_sim.plausibility.units import UNIT_ADVICE, UNITS, format_range, format_value
from klute_sim.types import Array

MIN_MOTION = 0.05
"""Smallest standard deviation of the expected motion, over the range in which the devices can move the joint, that
shows a trajectory (assumed)."""
MIN_SLOW_SHARE = 0.5
"""Smallest share of that deviation which an average over the natural period must leave (assumed)."""
MIN_PERIODS = 3.0
"""Smallest duration of a trial in natural periods (assumed)."""
MIN_CORRELATION, MIN_TYPICAL_CORRELATION = 0.7, 0.85
"""Smallest correlation with the expected trajectory in any trial, and in their median (assumed; delays reduce it)."""
MAX_SCALE = 3.0
"""Largest ratio of the measured to the expected motion, or of the expected to the measured one (assumed)."""
UNIT_TOLERANCE = 1.5
"""Largest ratio of a scale to that of a wrong unit (assumed)."""
MIN_UNIT_RATIO = 20.0
"""Smallest ratio of two units that are told apart (assumed: a joint that rubs, or a stiff spring, moves several times
less than expected)."""
MAX_ZERO_ERROR = 0.5
"""Largest distance of the measured from the expected angle, over the distance between the stops (assumed: a model
whose lengths are some per cent off rests elsewhere)."""
EXCHANGE_RATIO = 3.0
"""Smallest ratio of the difference of each pressure from its own command to that from the other command (assumed)."""


class JointTrajectory(NamedTuple):
    """Measured position of a joint in one trial, and where the model rests under the commands."""

    samples: Samples
    """Measured samples."""
    time: Array
    """Time of each sample [s]."""
    expected: Array
    """Expected position at each sample [rad or m]."""
    natural_period: float
    """Typical period of a free oscillation [s]."""
    stop_range: float
    """Distance between the stops [rad or m]."""
    reach: float
    """Range in which the devices can move the joint [rad or m]."""
    place: str
    """Name of the trial in messages."""


class _Comparison(NamedTuple):
    """How a measured position compares with the expected one."""

    trajectory: JointTrajectory
    correlation: float
    scale: float
    """Ratio of the measured to the expected motion."""
    offset: float
    """Median difference [rad or m]."""


def check_joint_trajectories(trajectories: Sequence[JointTrajectory]) -> list[Finding]:
    """Return findings for all ``trajectories`` of a joint if these have the wrong sign, unit or zero."""
    compared = [comparison for comparison in map(_compare, trajectories) if comparison is not None]
    if not compared:
        return []
    correlations = np.array([comparison.correlation for comparison in compared])
    sign = float(np.sign(np.median(correlations)))
    if (sign * correlations).min() < MIN_CORRELATION or abs(np.median(correlations)) < MIN_TYPICAL_CORRELATION:
        return []
    scale = float(np.median([comparison.scale for comparison in compared]))
    if sign < 0.0:
        return [_describe_sign(comparison) for comparison in compared] if 1.0 / MAX_SCALE < scale < MAX_SCALE else []
    unit = _guess_unit(compared[0].trajectory.samples, scale)
    if unit:
        return [_describe_unit(comparison, unit) for comparison in compared]
    offset = float(np.median([comparison.offset for comparison in compared]))
    if 1.0 / MAX_SCALE < scale < MAX_SCALE and abs(offset) > MAX_ZERO_ERROR * trajectories[0].stop_range:
        return [_describe_zero(comparison, offset) for comparison in compared]
    return []


def _compare(trajectory: JointTrajectory) -> _Comparison | None:
    """Return how the slow parts of measured and expected positions compare; None where the joint hardly moves."""
    is_finite = np.isfinite(trajectory.samples.value)
    measured, expected, time = (
        trajectory.samples.value[is_finite],
        trajectory.expected[is_finite],
        trajectory.time[is_finite],
    )
    if len(time) < 3 or time[-1] - time[0] < MIN_PERIODS * trajectory.natural_period:
        return None
    uniform = np.linspace(time[0], time[-1], len(time))
    width = max(1, round(trajectory.natural_period / (uniform[1] - uniform[0])))
    measured, slow = (_average(np.interp(uniform, time, values), width) for values in (measured, expected))
    motion = float(np.std(slow))
    if motion <= 0.0 or motion < MIN_MOTION * trajectory.reach or motion < MIN_SLOW_SHARE * float(np.std(expected)):
        return None
    correlation = compute_correlation(measured, slow)
    return _Comparison(trajectory, correlation, float(np.std(measured)) / motion, float(np.median(measured - slow)))


def _guess_unit(samples: Samples, scale: float) -> str:
    """Return the unit in which ``samples`` move by ``scale`` times the expected motion; '' if there is none."""
    for unit, factor in UNITS["rad" if samples.channel.startswith("angle_") else "m"].items():
        ratio = samples.factor / factor
        is_far = max(ratio, 1.0 / ratio) > MIN_UNIT_RATIO
        if is_far and 1.0 / UNIT_TOLERANCE < scale / ratio < UNIT_TOLERANCE:
            return unit
    return ""


def _average(values: Array, width: int) -> Array:
    return np.convolve(values, np.full(width, 1.0 / width), "valid")


def _state(comparison: _Comparison) -> str:
    """Return measured and expected positions in words."""
    samples = comparison.trajectory.samples
    expected = format_range(comparison.trajectory.expected, samples.unit, samples.factor)
    measured = format_range(samples.finite, samples.unit, samples.factor)
    return f"`{samples.channel}` is {measured}, but the model rests at {expected} under these commands"


def _describe_sign(comparison: _Comparison) -> Finding:
    trajectory = comparison.trajectory
    statement = (
        f"{_state(comparison)}, and moves in the opposite direction (correlation {comparison.correlation:.2f}): its "
        "sign is reversed, or two antagonists are exchanged in the headings, in [devices] or in the model"
    )
    return Finding(f"{trajectory.samples.channel}-sign", trajectory.place, statement)


def _describe_unit(comparison: _Comparison, unit: str) -> Finding:
    trajectory = comparison.trajectory
    statement = f"{_state(comparison)}, with the same waveform: is its unit {unit}? {UNIT_ADVICE}"
    return Finding(f"{trajectory.samples.channel}-unit", trajectory.place, statement)


def _describe_zero(comparison: _Comparison, offset: float) -> Finding:
    samples = comparison.trajectory.samples
    distance = format_value(-offset, samples.unit, samples.factor)
    statement = (
        f"{_state(comparison)}, with the same waveform: its zero differs from that of the model (add about "
        f"{distance} in [columns]), or a length of the model or of a device is wrong"
    )
    return Finding(f"{samples.channel}-zero", comparison.trajectory.place, statement)


def check_exchanged_pressures(
    trials: Mapping[str, Sequence[RecordedTrial]], channels: Mapping[str, str], *, moves_back: bool
) -> list[Finding]:
    """Return a finding for two tendons each of whose pressures follows the command of the other.

    ``trials`` holds those of each tendon's device in the same order, ``channels`` the end of the names of its
    channels. ``moves_back`` states whether the joint moves against the commands: these are exchanged then.
    """
    findings = []
    for first, second in combinations(trials, 2):
        pairs = [*zip(trials[first], trials[second], strict=False)]
        has_all = all("pressure" in trial.channels for pair in pairs for trial in pair)
        if not pairs or not has_all or len(trials[first]) != len(trials[second]):
            continue
        straight_differences, crossed_differences = (
            [_compute_difference(pairs, index, command) for index, command in ((0, shift), (1, 1 - shift))]
            for shift in (0, 1)
        )
        if any(
            EXCHANGE_RATIO * crossed >= straight
            for crossed, straight in zip(crossed_differences, straight_differences, strict=True)
        ):
            continue
        quantity, name = ("pressure_command", "commands") if moves_back else ("pressure", "pressures")
        names = sorted(f"{quantity}_{channels[tendon]}" for tendon in (first, second))
        statement = (
            f"the pressure of each of '{first}' and '{second}' follows the command of the other: the columns of their "
            f"{name} are exchanged; correct the headings"
        )
        findings.append(Finding(f"{'-'.join(names)}-exchanged", pairs[0][0].place, statement))
    return findings


def _compute_difference(pairs: Sequence[tuple[RecordedTrial, RecordedTrial]], index: int, command: int) -> float:
    """Return the root mean square difference [Pa] of a pressure and a command, both by their index in the pairs."""
    differences = []
    for pair in pairs:
        pressure, commanded = pair[index].channels["pressure"], pair[command].channels["pressure_command"]
        difference = pressure.samples.value - np.interp(pressure.time, commanded.time, commanded.samples.value)
        differences.append(difference[np.isfinite(difference)])
    return float(np.sqrt(np.mean(np.concatenate(differences) ** 2)))
