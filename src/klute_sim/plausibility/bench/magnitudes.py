"""Missing-value codes, and units of the channels by the range of their samples."""

from collections.abc import Sequence

import numpy as np

from klute_sim.plausibility.bench.trial import SI_UNITS, RecordedTrial
from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.samples import find_missing_value_code
from klute_sim.plausibility.spikes import check_position, describe_spikes
from klute_sim.plausibility.units import UNIT_ADVICE, UNITS, Range, guess_units
from klute_sim.types import Array, Mask

MAX_RATIO = 3.0
"""Largest ratio of a length to the device's resting length, of that length to it, or of a pressure to the supply
pressure (assumed: a muscle shortens by a third, and common units differ by more)."""
MUSCLE_LENGTH_RATIOS = 0.4, 1.3
"""Smallest and largest ratio of a muscle's length to its resting length in a guessed unit (assumed)."""
MAX_SPIKE_PERCENT = 5.0
"""Percentage of pressure samples that may exceed the limit, as a loose contact causes (assumed)."""
MIN_COMMAND_FRACTION = 0.02
"""Fraction of the supply pressure below which all commands are implausible (assumed; bar for kPa is a hundredth)."""
MAX_COMMAND_RATIO = 1.2
"""Largest ratio of a command to the supply pressure in a guessed unit (assumed)."""
MAX_REGULATOR_ERROR = 0.1
"""Largest relative difference of the highest pressure from the highest command that confirms a unit (assumed)."""
VACUUM = 110_000.0
"""Atmospheric pressure [Pa] that no weather exceeds; gauge pressures are above its negative."""
MAX_FORCE_RATIO = 30.0
"""Ratio of the force to what the device can pull beyond which no calibration explains it (assumed)."""
MAX_DISPLACEMENT_RATIO = 0.5
"""Largest ratio of a displacement, as of a crosshead that was zeroed, to the resting length (assumed)."""
MAX_REST_RANGE_RATIO = 1e-3
"""Largest range of the length of a unit at rest, over its resting length (assumed)."""
LENGTH_UNIT, LENGTH_ZERO = "length-unit", "length-zero"
"""Findings of a length in another unit, and from another zero."""
LENGTH_GEOMETRY = "length-geometry"
"""Finding of a length that the declared geometry does not allow."""
MAX_STRETCH = 1.03
"""Largest ratio of a muscle's length to that of the threads of its braid (assumed: both are measured to some per
cent)."""


def check_missing_value_codes(trial: RecordedTrial) -> tuple[list[Finding], RecordedTrial]:
    """Return a finding for each channel with codes, and the trial without the coded samples."""
    findings: list[Finding] = []
    values: dict[str, Array] = {}
    for name, channel in trial.channels.items():
        missing_value = find_missing_value_code(channel.samples)
        if missing_value is None:
            continue
        is_code = np.isclose(channel.samples.value / channel.samples.factor, missing_value.code, rtol=1e-9, atol=0.0)
        others = channel.samples._replace(value=np.where(is_code, np.nan, channel.samples.value))
        values[name] = others.value
        rest = trial.with_values(**{name: others.value}).format_channel(name)
        statement = (
            f"{others.channel} is {missing_value.code:g} {others.unit} in {missing_value.n_samples} samples and "
            f"{rest} in the others: it looks like a code for missing values; leave the cells of missing samples empty"
        )
        findings.append(Finding(f"{others.channel}-missing", trial.place, statement))
    return findings, trial.with_values(**values)


def check_spikes(trial: RecordedTrial) -> tuple[list[Finding], RecordedTrial]:
    """Return a finding for each length or command with single wrong samples, and the trial without these samples."""
    findings: list[Finding] = []
    values: dict[str, Array] = {}
    for name, channel in trial.channels.items():
        if name == "pressure_command":
            channel_findings, is_wrong = _find_impossible_commands(trial)
        elif name in ("length", "muscle_length"):
            possible = trial.limits.possible_length if name == "length" else None
            channel_findings, is_wrong = check_position(channel.samples, channel.time, "m", trial.place, possible)
        else:
            continue
        findings += channel_findings
        values[name] = np.where(is_wrong, np.nan, channel.samples.value)
    return findings, trial.with_values(**values)


def _find_impossible_commands(trial: RecordedTrial) -> tuple[list[Finding], Mask]:
    """Return a finding for few commands far beyond the supply or below the vacuum, and which samples these are."""
    time, samples = trial.channels["pressure_command"]
    is_wrong = (samples.value > MAX_RATIO * trial.limits.supply_pressure) | (samples.value < -VACUUM)
    if not 0.0 < np.mean(is_wrong) < 0.01 * MAX_SPIKE_PERCENT:
        return [], np.zeros_like(is_wrong)
    supply_pressure = trial.format_limit("pressure_command", trial.limits.supply_pressure)
    cause = f"the supply pressure of this device is {supply_pressure}"
    return [describe_spikes(samples, time, is_wrong, trial.place, cause)], is_wrong


def check_magnitudes(trial: RecordedTrial) -> list[Finding]:
    """Return the findings about units and zeros that follow from the range of the samples alone."""
    return [*_check_length(trial), *check_device_channels(trial)]


def check_device_channels(trial: RecordedTrial) -> list[Finding]:
    """Return the findings about the channels that the device has on any rig."""
    checks = (_check_muscle_length, _check_command, _check_pressure, _check_force)
    return [finding for check in checks for finding in check(trial)]


def _check_length(trial: RecordedTrial) -> list[Finding]:
    """Examine the length of the unit, which must be that of muscle and tendon together."""
    values, limits = trial.get_samples("length").finite, trial.limits
    plausible, resting_length = limits.get_range("length"), limits.unit_length
    low, high, middle = float(values.min()), float(values.max()), float(np.median(values))
    expected = (
        f"length is {trial.format_channel('length')}, but the resting length of this device, muscle and tendon "
        f"together, is {trial.format_limit('length', resting_length)}"
    )
    if plausible.low <= middle <= plausible.high:
        return _check_stretch(trial)
    if high < 0.0 and plausible.contains(-middle):
        return [Finding("length-sign", trial.place, f"{expected}: its sign seems reversed; write positive lengths")]
    guess = _guess_length_unit(trial, "length", middle, plausible)
    if guess:
        return [Finding(LENGTH_UNIT, trial.place, f"{expected}: is its unit {guess}? {UNIT_ADVICE}")]
    if limits.tendon_length and limits.get_range("muscle_length").contains(middle):
        statement = f"{expected}: it looks like the length of the muscle alone; add the length of the tendon"
        return [Finding(LENGTH_ZERO, trial.place, statement)]
    is_displacement = abs(middle) < resting_length / MAX_RATIO and high - low < MAX_DISPLACEMENT_RATIO * resting_length
    if is_displacement and not is_at_rest(trial):
        statement = (
            f"{expected}: it looks like a displacement from a zero of the tester; add the length of the unit at that "
            "zero"
        )
        return [Finding(LENGTH_ZERO, trial.place, statement)]
    if low > MAX_RATIO * resting_length or high < resting_length / MAX_RATIO:
        return [Finding(LENGTH_UNIT, trial.place, f"{expected}: its unit or its zero is wrong")]
    return _check_stretch(trial)


def is_at_rest(trial: RecordedTrial) -> bool:
    """Return whether the length hardly changes, so that its range does not tell a displacement from another unit."""
    return bool(np.ptp(trial.get_samples("length").finite) <= MAX_REST_RANGE_RATIO * trial.limits.unit_length)


def _check_stretch(trial: RecordedTrial) -> list[Finding]:
    """Return a finding for a muscle that is longer than the threads of its braid; a tendon may be stretched."""
    limits = trial.limits
    longest = float(np.percentile(trial.get_samples("length").finite, 100.0 - MAX_SPIKE_PERCENT))
    if not limits.pulls or limits.tendon_length or longest <= MAX_STRETCH * limits.braid_length:
        return []
    thread, rest = (trial.format_limit("length", value) for value in (limits.braid_length, limits.muscle_length))
    statement = (
        f"length is {trial.format_channel('length')}, but the resting length of this muscle is {rest}, and no force "
        f"stretches it beyond the threads of its braid, {thread}: check the sign of the change of length, "
        "muscle.resting_length_mm, and which specimen was recorded"
    )
    return [Finding(LENGTH_GEOMETRY, trial.place, statement)]


def _check_muscle_length(trial: RecordedTrial) -> list[Finding]:
    """Examine the muscle length, whose sensor may have any zero: another unit must explain all samples."""
    if "muscle_length" not in trial.channels:
        return []
    values, resting_length = trial.get_samples("muscle_length").finite, trial.limits.muscle_length
    if np.ptp(values) == 0.0:
        return []
    low, high, middle = float(values.min()), float(values.max()), float(np.median(values))
    if low <= MAX_RATIO * resting_length and high >= resting_length / MAX_RATIO:
        return []
    plausible = Range(
        MUSCLE_LENGTH_RATIOS[0] * resting_length, MUSCLE_LENGTH_RATIOS[1] * resting_length, resting_length
    )
    guess = _guess_length_unit(trial, "muscle_length", middle, plausible)
    if not guess:
        return []
    name = trial.get_name("muscle_length")
    statement = (
        f"{name} is {trial.format_channel('muscle_length')}, but the resting length of this device's muscle is "
        f"{trial.format_limit('muscle_length', resting_length)}: is its unit {guess}? {UNIT_ADVICE}"
    )
    return [Finding(f"{name}-unit", trial.place, statement)]


def _guess_length_unit(trial: RecordedTrial, channel: str, middle: float, plausible: Range) -> str:
    """Return the units that make the median and the spread of a length plausible, or ''."""
    samples = trial.get_samples(channel)
    units = guess_units(middle, samples.factor, "m", plausible)
    spread = float(np.ptp(np.percentile(samples.finite, [1.0, 99.0])))
    is_spread_plausible = spread < MAX_DISPLACEMENT_RATIO * middle
    return " or ".join(units) if is_spread_plausible else ""


def _check_command(trial: RecordedTrial) -> list[Finding]:
    """Examine the highest commands; the regulator cannot follow more than the supply has."""
    supply_pressure = trial.limits.supply_pressure
    sign = _check_pressure_sign(trial, "pressure_command")
    if sign:
        return sign
    peak = float(np.percentile(trial.get_samples("pressure_command").finite, 100.0 - MAX_SPIKE_PERCENT))
    if peak <= MAX_RATIO * supply_pressure:
        return []
    return [_describe_pressure(trial, "pressure_command", peak)]


def _check_pressure(trial: RecordedTrial) -> list[Finding]:
    """Examine the highest pressures; a loose contact may exceed the limit in a few samples."""
    if "pressure" not in trial.channels:
        return []
    sign = _check_pressure_sign(trial, "pressure")
    if sign:
        return sign
    values = trial.get_samples("pressure").finite
    peak = float(np.percentile(values, 100.0 - MAX_SPIKE_PERCENT))
    if peak <= MAX_RATIO * trial.limits.supply_pressure or np.ptp(values) == 0.0:
        return []
    return [_describe_pressure(trial, "pressure", peak)]


def _check_pressure_sign(trial: RecordedTrial, channel: str) -> list[Finding]:
    """Return a finding for pressures far below the vacuum."""
    samples = trial.get_samples(channel)
    if float(np.percentile(samples.finite, MAX_SPIKE_PERCENT)) > -VACUUM or float(np.median(samples.finite)) > 0.0:
        return []
    name = trial.get_name(channel)
    statement = (
        f"{name} is {trial.format_channel(channel)}, but gauge pressures cannot be below "
        f"{trial.format_limit(channel, -VACUUM)}, the vacuum: its sign seems reversed; pressures above that of the "
        "room are positive"
    )
    return [Finding(f"{name}-sign", trial.place, statement)]


def _describe_pressure(trial: RecordedTrial, channel: str, peak: float) -> Finding:
    supply_pressure, samples = trial.limits.supply_pressure, trial.get_samples(channel)
    plausible = Range(MIN_COMMAND_FRACTION * supply_pressure, MAX_COMMAND_RATIO * supply_pressure, supply_pressure)
    units = guess_units(peak, samples.factor, "Pa", plausible)
    guess = " or ".join(units)
    fix = f"is its unit {guess}? {UNIT_ADVICE}" if guess else "its unit or its zero is wrong"
    if channel == "pressure_command" and peak > supply_pressure and _may_be_percent(trial, units):
        unit = f"{guess}, or per cent of a full scale" if guess else "per cent of a full scale"
        fix = f"is its unit {unit}? {UNIT_ADVICE}, or convert the values there"
    name = trial.get_name(channel)
    return Finding(
        f"{name}-unit",
        trial.place,
        f"{name} is {trial.format_channel(channel)}, but the supply pressure of this device is "
        f"{trial.format_limit(channel, supply_pressure)}: {fix}",
    )


def _may_be_percent(trial: RecordedTrial, units: Sequence[str]) -> bool:
    """Return whether commands lie in 0 to 100 and a measured pressure confirms none of ``units``."""
    samples = trial.get_samples("pressure_command")
    written = samples.finite / samples.factor
    if written.min() < 0.0 or written.max() > 100.0:
        return False
    if not units or "pressure" not in trial.channels:
        return True
    reached, commanded = float(trial.get_samples("pressure").finite.max()), float(written.max())
    return all(abs(reached / (commanded * UNITS["Pa"][unit]) - 1.0) > MAX_REGULATOR_ERROR for unit in units)


def _check_force(trial: RecordedTrial) -> list[Finding]:
    """Examine the largest forces; smaller deviations need a simulation."""
    limits = trial.limits
    if "force" not in trial.channels or not limits.pulls:
        return []
    samples = trial.get_samples("force")
    peak = float(np.percentile(np.abs(samples.finite), 100.0 - MAX_SPIKE_PERCENT))
    if peak <= MAX_FORCE_RATIO * limits.max_force:
        return []
    plausible = Range(0.05 * limits.max_force, 1.5 * limits.max_force, limits.max_force)
    guess = " or ".join(guess_units(peak, samples.factor, SI_UNITS["force"], plausible))
    fix = f"is its unit {guess}? {UNIT_ADVICE}" if guess else "its unit or its scale is wrong"
    name = trial.get_name("force")
    statement = (
        f"{name} is {trial.format_channel('force')}, but this device pulls at most "
        f"{trial.format_limit('force', limits.max_force)} under its supply pressure: {fix}"
    )
    return [Finding(f"{name}-unit", trial.place, statement)]


def check_all_commands(trials: list[RecordedTrial], channel: str = "pressure_command") -> list[Finding]:
    """Return a finding if the commands of all ``trials``, or those of another ``channel``, are implausibly small."""
    peaks = [float(trial.get_samples(channel).finite.max()) for trial in trials]
    highest = max(peaks, default=0.0)
    is_small = all(
        peak < MIN_COMMAND_FRACTION * trial.limits.supply_pressure for peak, trial in zip(peaks, trials, strict=True)
    )
    if highest <= 0.0 or not is_small:
        return []
    return [_describe_pressure(trials[peaks.index(highest)], channel, highest)]
