"""Whether lengths and pressures can be those of the device: a heading with another unit than the samples' is usual."""

import math
from collections.abc import Iterable, Mapping

import numpy as np

from klute_sim.datasets import quantity
from klute_sim.datasets.trial import Trial
from klute_sim.errors import InputError
from klute_sim.recording.recording import Array

MAX_PLAUSIBLE_RATIO = 3.0
"""Times longer or shorter than the device at rest, or above what its supply gives, no trial is (assumed: a muscle
shortens by a third, and usual units differ by more)."""
MUSCLE_LENGTH_RATIOS = 0.4, 1.3
"""Shortest and longest that a muscle may be, over its length at rest, in the unit that is guessed (assumed)."""
MIN_PRESSURE_FRACTION = 0.02
"""Share of what the supply gives below which all commands are doubted (assumed: bar for kPa is a hundredth)."""
MAX_SPIKE_PERCENT = 5.0
"""Per cent of the samples of a pressure that may be above, as a loose contact makes them (assumed)."""

MAX_COMMAND_RATIO = 1.2
"""Times what its supply gives that a device may have been commanded, where a unit is guessed (assumed)."""
CANDIDATE_UNITS = {"m": ("mm", "cm", "m", "in"), "Pa": ("bar", "kPa", "MPa", "psi", "Pa")}
"""SI unit -> units that samples may be in instead."""


def check_plausibility(trial: Trial, units: Mapping[str, str]) -> None:
    """Raise InputError where no sample of a length, or too many of a pressure, can be of the device of ``trial``.

    ``units``: channel -> unit in its heading. Channels that always show the same are for others to judge. A muscle's
    sensor may count from anywhere, which a diagnosis can name: it is refused where another unit explains all samples.
    """
    parameters = trial.device.parameters
    muscle, supply = parameters.muscle.resting_length, parameters.supply.max_pressure
    whole = muscle + parameters.tendon.slack_length
    for channel, rest, what in (
        ("length", whole, "this device, muscle and tendon together, is {} long at rest"),
        ("muscle_length", muscle, "this device's muscle is {} long at rest"),
    ):
        values = _select_finite_samples(trial, channel)
        least, most = rest / MAX_PLAUSIBLE_RATIO, rest * MAX_PLAUSIBLE_RATIO
        if values.size and (values.min() > most or values.max() < least):
            guess = _guess_unit(float(np.median(values)), rest, (least, most), units[channel], "m")
            if channel == "muscle_length":
                times = (
                    (quantity.get_conversion_factor(guess, units[channel]) or math.nan) / rest if guess else math.nan
                )
                if not MUSCLE_LENGTH_RATIOS[0] < times * values.min() <= times * values.max() < MUSCLE_LENGTH_RATIOS[1]:
                    continue
            raise InputError(_format_message(trial, channel, values, units[channel], "m", what, rest, guess))
    for channel in ("pressure_command", "pressure"):
        values = _select_finite_samples(trial, channel)
        peak = float(np.percentile(values, 100.0 - MAX_SPIKE_PERCENT)) if values.size else 0.0
        if peak > MAX_PLAUSIBLE_RATIO * supply:
            guess = _guess_unit(peak, supply, _get_pressure_limits(supply), units[channel], "Pa")
            what = "this device's supply gives no more than {}"
            raise InputError(_format_message(trial, channel, values, units[channel], "Pa", what, supply, guess))


def describe_implausible_commands(trials: Iterable[Trial], units: Mapping[str, str]) -> str:
    """What is odd about the commands of all ``trials`` together, in one sentence without its end; '' if nothing is."""
    peaks = [
        (float(t.prescribed["pressure_command"].value.max()), t.device.parameters.supply.max_pressure) for t in trials
    ]
    highest, most = max(peaks)
    if highest <= 0.0 or any(peak >= MIN_PRESSURE_FRACTION * own for peak, own in peaks):
        return ""
    unit = units["pressure_command"]
    guess = _guess_unit(highest, most, _get_pressure_limits(most), unit, "Pa")
    mend = f"perhaps it is in {guess}" if guess else "perhaps the unit in its heading is wrong"
    return (
        f"pressure_command is never above {_format_value(highest, unit, 'Pa')}, and this device's supply gives "
        f"{_format_value(most, unit, 'Pa')}; {mend}"
    )


def _select_finite_samples(trial: Trial, channel: str) -> Array:
    """Samples that are there [SI]; none of a measured channel that always shows the same."""
    series = trial.prescribed.get(channel) or trial.measured.get(channel)
    values = series.value[np.isfinite(series.value)] if series else np.empty(0)
    return values[:0] if values.size and channel in trial.measured and np.ptp(values) == 0.0 else values


def _get_pressure_limits(supply: float) -> tuple[float, float]:
    return MIN_PRESSURE_FRACTION * supply, MAX_COMMAND_RATIO * supply


def _guess_unit(value: float, reference: float, limits: tuple[float, float], unit_as_written: str, si_unit: str) -> str:
    """The unit in which what was read as ``value`` in the ``written`` one is nearest to ``usual``; '' if none can be.

    All in SI but the unit; it can be if the value is then ``between`` these.
    """
    found = {
        unit: value * (quantity.get_conversion_factor(unit, unit_as_written) or math.nan)
        for unit in CANDIDATE_UNITS[si_unit]
    }
    near = {unit: one for unit, one in found.items() if limits[0] <= one <= limits[1]}
    return min(near, key=lambda unit: abs(math.log(near[unit] / reference)), default="")


def _format_value(value: float, unit: str, si_unit: str) -> str:
    return f"{float(f'{value / (quantity.get_si_factor(unit, si_unit) or 1.0):.3g}'):g} {unit}"


def _format_message(
    trial: Trial,
    channel: str,
    values: Array,
    unit: str,
    si_unit: str,
    description: str,
    limit: float,
    guessed_unit: str,
) -> str:
    low, high = (
        _format_value(values.min(), unit, si_unit).removesuffix(f" {unit}"),
        _format_value(values.max(), unit, si_unit),
    )
    mend = f"is it in {guessed_unit}?" if guessed_unit else "its unit or its zero is another one"
    return f"trial '{trial.name}': {channel} is {low} to {high}, and {description.format(_format_value(limit, unit, si_unit))}: {mend}"
