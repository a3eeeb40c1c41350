"""Channels of a mechanism that contradict each other: small commands, absolute pressures, sensors that do not move."""

from collections.abc import Mapping, Sequence

import numpy as np

from klute_sim.plausibility.bench.absolute_pressures import HIGHEST_ATMOSPHERE, LOWEST_ATMOSPHERE
from klute_sim.plausibility.bench.magnitudes import check_all_commands
from klute_sim.plausibility.bench.trial import RecordedTrial
from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.samples import Samples
from klute_sim.plausibility.units import format_value
from klute_sim.types import Array

MAX_GAIN_ERROR = 0.1
"""Largest deviation from 1 of the slope of pressure over command beside a constant difference (assumed)."""
MIN_COMMAND_RANGE = 0.1
"""Smallest change of a command, over the supply pressure, that must move a joint and a pressure (assumed)."""
MIN_SAMPLES = 20
"""Smallest number of samples of a channel that is judged to be constant."""
MAX_STOP_DISTANCE = 0.1
"""Largest distance from a stop, over the distance between the stops, at which a joint may rest on it (assumed)."""


def check_tendon_pressures(trials: Mapping[str, Sequence[RecordedTrial]]) -> list[Finding]:
    """Return what is implausible in commands and pressures; ``trials`` holds those of each tendon's device."""
    findings = []
    for tendon, tendon_trials in trials.items():
        others = [trial for other, other_trials in trials.items() if other != tendon for trial in other_trials]
        with_pressure = [trial for trial in tendon_trials if "pressure" in trial.channels]
        small = [*check_all_commands(list(tendon_trials)), *check_all_commands(with_pressure, "pressure")]
        is_idle = all(_compute_range(trial.get_samples("pressure_command")) == 0.0 for trial in tendon_trials)
        if is_idle and others and not check_all_commands(others):  # one muscle of several, under a small command
            continue
        findings += small or _check_absolute(with_pressure)
        findings += [finding for trial in with_pressure for finding in _check_stuck_pressure(trial)]
    return findings


def _compute_range(samples: Samples) -> float:
    return float(np.ptp(samples.finite))


def _check_absolute(trials: Sequence[RecordedTrial]) -> list[Finding]:
    """Return findings for measured pressures that lie an atmosphere above gauge commands in all ``trials``."""
    pairs = [_pair_pressures(trial) for trial in trials]
    if not pairs:
        return []
    command, pressure = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    if len(command) < MIN_SAMPLES or np.ptp(command) == 0.0:
        return []
    gain, offset = np.polyfit(command, pressure, 1)
    if abs(gain - 1.0) > MAX_GAIN_ERROR or not LOWEST_ATMOSPHERE < offset < HIGHEST_ATMOSPHERE:
        return []
    return [
        Finding(
            f"{trial.get_name('pressure')}-absolute",
            trial.place,
            f"{trial.get_name('pressure')} is {trial.format_channel('pressure')} and "
            f"{trial.get_name('pressure_command')} {trial.format_channel('pressure_command')}; over all trials the "
            f"pressure is {trial.format_limit('pressure', float(offset))} above its command: it looks like absolute "
            "pressure; subtract the pressure of the atmosphere",
        )
        for trial in trials
    ]


def _pair_pressures(trial: RecordedTrial) -> tuple[Array, Array]:
    """Return the command and the pressure [Pa] at the samples where both are finite."""
    command, pressure = trial.channels["pressure_command"], trial.channels["pressure"]
    commanded = np.interp(pressure.time, command.time, command.samples.value)
    is_finite = np.isfinite(pressure.samples.value) & np.isfinite(commanded)
    return commanded[is_finite], pressure.samples.value[is_finite]


def _check_stuck_pressure(trial: RecordedTrial) -> list[Finding]:
    if _compute_range(trial.get_samples("pressure_command")) < MIN_COMMAND_RANGE * trial.limits.supply_pressure:
        return []
    cause = f"its command goes over {trial.format_channel('pressure_command')}"
    return _check_constant(trial.get_samples("pressure"), trial.place, cause)


def check_stuck_joint(
    samples: Samples, commands: Sequence[RecordedTrial], stops: tuple[float, float] | None, place: str
) -> list[Finding]:
    """Return a finding for a position of a joint that is constant although ``commands`` of the devices vary.

    A joint may rest at one of its ``stops`` [rad or m], and antagonists whose commands change alike may hold it.
    Devices without a supply move nothing.
    """
    driving = [trial for trial in commands if trial.limits.supply_pressure > 0.0]
    if samples.finite.size < MIN_SAMPLES or not driving:
        return []
    value = float(samples.finite[0])
    if stops is not None and min(abs(value - stop) for stop in stops) < MAX_STOP_DISTANCE * (stops[1] - stops[0]):
        return []
    times = driving[0].channels["pressure_command"].time
    pressures = [
        np.interp(times, trial.channels["pressure_command"].time, trial.get_samples("pressure_command").value)
        / trial.limits.supply_pressure
        for trial in driving
    ]
    differences = [first - second for i, first in enumerate(pressures) for second in pressures[:i]] or pressures
    if max(float(np.ptp(difference)) for difference in differences) < MIN_COMMAND_RANGE:
        return []
    trial = max(driving, key=lambda driving_trial: _compute_range(driving_trial.get_samples("pressure_command")))
    cause = f"{trial.get_name('pressure_command')} goes over {trial.format_channel('pressure_command')}"
    return _check_constant(samples, place, cause)


def _check_constant(samples: Samples, place: str, cause: str) -> list[Finding]:
    """Return a finding if all ``samples`` are the same, although ``cause``."""
    if samples.finite.size < MIN_SAMPLES or _compute_range(samples) > 0.0:
        return []
    value = format_value(float(samples.finite[0]), samples.unit, samples.factor)
    statement = (
        f"`{samples.channel}` is {value} in all {samples.finite.size} samples, although {cause}: the sensor is stuck, "
        "or was not recorded; remove its column from this trial"
    )
    return [Finding(f"{samples.channel}-constant", place, statement)]
