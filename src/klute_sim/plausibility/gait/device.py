"""Channels of the device in a gait trial, and the tension of the tendon compared with the load on the foot.

The ground reaction turns the foot about the ankle, and the tendon holds it: tension times moment arm is the moment of
the ground reaction, but for springs, stops and the inertia of the foot. This holds whatever the muscle does, so it
tells the unit and the sign of the tension without a simulation.
"""

import numpy as np

from klute_sim.plausibility.bench.absolute_pressures import HIGHEST_ATMOSPHERE, LOWEST_ATMOSPHERE, REST_PERCENTILE
from klute_sim.plausibility.bench.magnitudes import (
    MAX_COMMAND_RATIO,
    MAX_RATIO,
    MAX_SPIKE_PERCENT,
    VACUUM,
    check_device_channels,
    check_missing_value_codes,
)
from klute_sim.plausibility.bench.mistakes import ATMOSPHERE
from klute_sim.plausibility.bench.trial import SI_UNITS, RecordedTrial
from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.gait.consistency import compute_ground_moment
from klute_sim.plausibility.gait.steps import (
    LOADED_STANCE_PCT,
    MIN_KNOWN_PHASES,
    Series,
    average_cycle,
    find_steps,
)
from klute_sim.plausibility.gait.trial import GaitChannels
from klute_sim.plausibility.samples import compute_correlation
from klute_sim.plausibility.units import Range, guess_units, round_digits
from klute_sim.types import Array

MOMENT_ARM = 0.048
"""Moment arm of the tendon about the ankle of the prosthesis at a neutral ankle [m]."""
TENSION_RATIO_RANGE = (0.25, 3.0)
"""Plausible ratio of the tension to the one that balances the ground reaction (assumed; walks with the prosthesis have
0.54 without pressure, where the dorsiflexion stop carries a part, to 0.9)."""
USUAL_TENSION_RATIO = Range(0.4, 1.5, 0.8)
"""That ratio in a guessed unit."""
MIN_CORRELATION = 0.8
"""Smallest correlation of the two over the stance with which their ratio is one of scales (assumed; walks have 0.96
or more)."""
EXCHANGED_FORCE_RANGE = (0.02, 2.0)
"""Peak of a force that stood under pressure, relative to what the device can pull (assumed)."""

MAX_EXCESS_RANGE = 0.8 * ATMOSPHERE
"""Largest range of a constant excess of the pressure over its command [Pa], from lag and noise (assumed)."""


def check_walk_device(recorded: RecordedTrial, walk: GaitChannels | None) -> list[Finding]:
    """Return what is implausible in the channels of the device of a gait trial.

    ``walk`` holds motion and load of the trial; None where they have findings and tell nothing about the tension.
    """
    codes, trial = check_missing_value_codes(recorded)
    exchanged = _find_exchanged_columns(trial)
    if exchanged:
        return [*codes, *exchanged]
    findings = [*codes, *check_device_channels(trial)]
    if not any(finding.name.startswith("pressure") for finding in findings):
        findings += _find_absolute_pressure(trial)
    has_force_fault = any(finding.name.startswith("force") for finding in findings)
    if walk is not None and "force" in trial.channels and not has_force_fault:
        findings += _check_tension(trial, walk)
    return findings


def _find_exchanged_columns(trial: RecordedTrial) -> list[Finding]:
    """Return whether force and pressure are possible only under each other's heading."""
    limits = trial.limits
    if not {"force", "pressure"} <= trial.channels.keys() or not limits.pulls:
        return []
    force, pressure = trial.channels["force"], trial.channels["pressure"]
    other_force = pressure.samples.value / pressure.samples.factor * force.samples.factor
    other_pressure = force.samples.value / force.samples.factor * pressure.samples.factor
    low, high = EXCHANGED_FORCE_RANGE
    is_possible = low <= _measure_peak(other_force) / limits.max_force <= high
    is_possible &= _measure_peak(other_pressure) <= MAX_COMMAND_RATIO * limits.supply_pressure
    is_possible &= float(np.nanpercentile(other_pressure, MAX_SPIKE_PERCENT)) > -VACUUM
    if not is_possible or _measure_peak(pressure.samples.value) <= MAX_RATIO * limits.supply_pressure:
        return []
    as_is = _correlate_with_command(trial, Series(pressure.time, pressure.samples.value))
    if _correlate_with_command(trial, Series(force.time, other_pressure)) < as_is:
        return []
    statement = (
        f"the columns of force and pressure seem exchanged (force {trial.format_channel('force')}, pressure "
        f"{trial.format_channel('pressure')}): this device pulls up to {trial.format_limit('force', limits.max_force)} "
        f"and has a supply of {trial.format_limit('pressure', limits.supply_pressure)}, so each fits the other "
        "heading; exchange the headings"
    )
    return [Finding("force-pressure-exchanged", trial.place, statement)]


def _measure_peak(values: Array) -> float:
    """Return the largest of ``values`` without spikes."""
    return float(np.nanpercentile(values, 100.0 - MAX_SPIKE_PERCENT))


def _correlate_with_command(trial: RecordedTrial, pressure: Series) -> float:
    return compute_correlation(pressure.value, _interpolate_command(trial, pressure.time))


def _interpolate_command(trial: RecordedTrial, time: Array) -> Array:
    command = trial.channels["pressure_command"]
    is_known = np.isfinite(command.samples.value)
    return np.interp(time, command.time[is_known], command.samples.value[is_known])


def _find_absolute_pressure(trial: RecordedTrial) -> list[Finding]:
    """Return whether the measured pressure stays one atmosphere above its command, whatever that is.

    Where the command is absolute as well, a replay tells: the muscle is never at rest.
    """
    if "pressure" not in trial.channels:
        return []
    channel = trial.channels["pressure"]
    excess = channel.samples.value - _interpolate_command(trial, channel.time)
    low, middle, high = np.nanpercentile(excess, [10.0, 50.0, 90.0])
    lowest = float(np.nanpercentile(channel.samples.value, REST_PERCENTILE))
    is_atmosphere = LOWEST_ATMOSPHERE <= middle <= HIGHEST_ATMOSPHERE and lowest >= LOWEST_ATMOSPHERE
    if not is_atmosphere or high - low > MAX_EXCESS_RANGE:
        return []
    statement = (
        f"pressure is {trial.format_channel('pressure')} and always about {trial.format_limit('pressure', middle)} "
        "above the command: it looks like absolute pressure; subtract the pressure of the atmosphere"
    )
    return [Finding("pressure-absolute", trial.place, statement)]


def _check_tension(trial: RecordedTrial, walk: GaitChannels) -> list[Finding]:
    """Return the finding on sign or scale of the tension compared with the moment of the ground reaction."""
    steps = find_steps(walk.channels["grf_vertical"].series)
    if not steps:
        return []
    channel, samples = trial.channels["force"], trial.get_samples("force")
    tension = average_cycle(Series(channel.time, samples.value), steps)[LOADED_STANCE_PCT]
    needed = compute_ground_moment(walk.channels, steps) / MOMENT_ARM
    is_known = np.isfinite(tension) & np.isfinite(needed)
    tension, needed = tension[is_known], needed[is_known]
    if len(needed) < MIN_KNOWN_PHASES or not needed.any():
        return []
    correlation, ratio = compute_correlation(tension, needed), float(tension @ needed / (needed @ needed))
    largest = round_digits(float(needed.max()) / samples.factor)
    expected = (
        f"force is {trial.format_channel('force')}, but the load on the foot needs a tension of about {largest:g} "
        f"{samples.unit} to hold the ankle"
    )
    if correlation < -MIN_CORRELATION:
        statement = f"{expected}: its sign seems reversed; tension is positive"
        return [Finding("force-sign", trial.place, statement)]
    low, high = TENSION_RATIO_RANGE
    if correlation < MIN_CORRELATION or low <= ratio <= high:
        return []
    guess = " or ".join(guess_units(ratio, samples.factor, SI_UNITS["force"], USUAL_TENSION_RATIO))
    fix = f"is its unit {guess}? Correct the heading" if guess else "its unit or its scale is wrong"
    return [Finding("force-unit", trial.place, f"{expected}: {fix}")]
