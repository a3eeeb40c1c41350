"""Plausibility checks of lengths and pressures, which often have another unit than the heading of their column."""

import math
from collections.abc import Iterable, Mapping

import numpy as np

from klute_sim.datasets import unit_conversion
from klute_sim.datasets.trial import Trial
from klute_sim.errors import InputError
from klute_sim.types import Array

MAX_PLAUSIBLE_RATIO = 3.0
"""Largest ratio of a length to the device's resting length, of that length to it, or of a pressure to the supply
pressure (assumed: a muscle shortens by a third, and common units differ by more)."""
MUSCLE_LENGTH_RATIOS = 0.4, 1.3
"""Smallest and largest ratio of a muscle's length to its resting length in a guessed unit (assumed)."""
MIN_PRESSURE_FRACTION = 0.02
"""Fraction of the supply pressure below which all commands are implausible (assumed; bar for kPa is a hundredth)."""
MAX_SPIKE_PERCENT = 5.0
"""Percentage of pressure samples that may exceed the limit, as a loose contact causes (assumed)."""
MAX_COMMAND_RATIO = 1.2
"""Largest ratio of a command to the supply pressure in a guessed unit (assumed)."""
CANDIDATE_UNITS = {"m": ("mm", "cm", "m", "in"), "Pa": ("bar", "kPa", "MPa", "psi", "Pa")}
"""SI unit -> units that samples may have instead of that in the heading."""


def check_plausibility(trial: Trial, units: Mapping[str, str]) -> None:
    """Raise InputError when all samples of a length, or too many of a pressure, are impossible for the trial's device.

    ``units`` maps channels to the units in their headings. Constant measured channels are not examined. A muscle length
    sensor may have any zero, which a diagnosis identifies: its
    samples are rejected only if another unit explains all of them.
    """
    parameters = trial.device.parameters
    muscle_length, supply_pressure = parameters.muscle.resting_length, parameters.supply.max_pressure
    unit_length = muscle_length + parameters.tendon.slack_length
    for channel, resting_length, description in (
        ("length", unit_length, "the resting length of this device, muscle and tendon together, is {}"),
        ("muscle_length", muscle_length, "the resting length of this device's muscle is {}"),
    ):
        values = _select_finite_samples(trial, channel)
        limits = resting_length / MAX_PLAUSIBLE_RATIO, resting_length * MAX_PLAUSIBLE_RATIO
        if values.size and (values.min() > limits[1] or values.max() < limits[0]):
            guess = _guess_unit(float(np.median(values)), resting_length, limits, units[channel], "m")
            if channel == "muscle_length":
                factor = unit_conversion.get_conversion_factor(guess, units[channel]) if guess else None
                scale = (factor or math.nan) / resting_length
                if not (
                    MUSCLE_LENGTH_RATIOS[0] < scale * values.min() <= scale * values.max() < MUSCLE_LENGTH_RATIOS[1]
                ):
                    continue
            raise InputError(
                _format_message(trial, channel, values, units[channel], "m", description, resting_length, guess)
            )
    for channel in ("pressure_command", "pressure"):
        values = _select_finite_samples(trial, channel)
        peak = float(np.percentile(values, 100.0 - MAX_SPIKE_PERCENT)) if values.size else 0.0
        if peak > MAX_PLAUSIBLE_RATIO * supply_pressure:
            limits = _get_pressure_limits(supply_pressure)
            guess = _guess_unit(peak, supply_pressure, limits, units[channel], "Pa")
            description = "the supply pressure of this device is {}"
            raise InputError(
                _format_message(trial, channel, values, units[channel], "Pa", description, supply_pressure, guess)
            )


def describe_implausible_commands(trials: Iterable[Trial], units: Mapping[str, str]) -> str:
    """Return a sentence, without full stop, if the commands of all ``trials`` are implausibly small; '' otherwise."""
    peaks = [
        (float(t.prescribed["pressure_command"].value.max()), t.device.parameters.supply.max_pressure) for t in trials
    ]
    highest, supply_pressure = max(peaks)
    if highest <= 0.0 or any(peak >= MIN_PRESSURE_FRACTION * pressure for peak, pressure in peaks):
        return ""
    unit = units["pressure_command"]
    guess = _guess_unit(highest, supply_pressure, _get_pressure_limits(supply_pressure), unit, "Pa")
    fix = f"perhaps its unit is {guess}" if guess else "perhaps the unit in its heading is wrong"
    return (
        f"pressure_command is never above {_format_value(highest, unit, 'Pa')}, but the supply pressure of this device "
        f"is {_format_value(supply_pressure, unit, 'Pa')}; {fix}"
    )


def _select_finite_samples(trial: Trial, channel: str) -> Array:
    """Return the finite samples of ``channel`` in SI units; no samples for a constant measured channel."""
    series = trial.prescribed.get(channel) or trial.measured.get(channel)
    values = series.value[np.isfinite(series.value)] if series else np.empty(0)
    return values[:0] if values.size and channel in trial.measured and np.ptp(values) == 0.0 else values


def _get_pressure_limits(supply_pressure: float) -> tuple[float, float]:
    return MIN_PRESSURE_FRACTION * supply_pressure, MAX_COMMAND_RATIO * supply_pressure


def _guess_unit(value: float, reference: float, limits: tuple[float, float], unit_as_written: str, si_unit: str) -> str:
    """Return the unit in which a sample is closest to ``reference``, or '' if none brings it within ``limits``.

    ``value`` is the sample in SI as read in ``unit_as_written``; ``reference`` and ``limits`` are in SI.
    """
    candidates = {
        unit: value * (unit_conversion.get_conversion_factor(unit, unit_as_written) or math.nan)
        for unit in CANDIDATE_UNITS[si_unit]
    }
    possible = {unit: candidate for unit, candidate in candidates.items() if limits[0] <= candidate <= limits[1]}
    return min(possible, key=lambda unit: abs(math.log(possible[unit] / reference)), default="")


def _format_value(value: float, unit: str, si_unit: str) -> str:
    return f"{float(f'{value / (unit_conversion.get_si_factor(unit, si_unit) or 1.0):.3g}'):g} {unit}"


def _format_message(
    trial: Trial,
    channel: str,
    values: Array,
    unit: str,
    si_unit: str,
    description: str,
    expected_value: float,
    guessed_unit: str,
) -> str:
    low = _format_value(values.min(), unit, si_unit).removesuffix(f" {unit}")
    high = _format_value(values.max(), unit, si_unit)
    expected = description.format(_format_value(expected_value, unit, si_unit))
    fix = f"is its unit {guessed_unit}?" if guessed_unit else "its unit or its zero is wrong"
    return f"trial '{trial.name}': {channel} is {low} to {high}, but {expected}: {fix}"
