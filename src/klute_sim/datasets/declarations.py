"""Quantities with units that ``dataset.toml`` declares for channels: noise, limits, delays, tolerances."""

import math
import re
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from klute_sim.datasets import unit_conversion
from klute_sim.datasets.channels import ChannelSource, get_measured_units, get_prescribed_units
from klute_sim.datasets.split import SplitEntry
from klute_sim.datasets.trial import SensorLimits, Trial
from klute_sim.errors import InputError, suggest
from klute_sim.types import Array

MAX_QUANTITY_LENGTH = 60
"""Longest text of a number with a unit [letters]."""
MIN_FREE_FRACTION = 0.1
"""Smallest fraction of the samples of a channel that lie within the limits of its sensor (assumed)."""
MIN_REFERENCE_FRACTION = 0.1
"""Fraction of the largest magnitude of a channel that a noise or a tolerance may reach where the channel has a smaller
range (assumed: a clamped length has hardly any, and may be wrong by more)."""
MAX_DELAY = 3600.0
"""Longest delay between the clocks of two instruments [s] (assumed)."""
_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([^\W\d].*?|[°%].*?)\s*")
_PERCENT = "%"


def parse_quantity(text: str, si_unit: str, place: str) -> float:
    """Return the number with a unit in ``text``, such as ``0.2 mm``, in ``si_unit``.

    Raises InputError, which begins with ``place``, when there is no finite number or no unit of the same kind.
    """
    number, unit = _split_quantity(text, si_unit, place)
    factor = unit_conversion.get_si_factor(unit, si_unit)
    if factor is None:
        raise InputError(f"{place} = '{text}' has {unit_conversion.describe_wrong_unit(unit, si_unit)}")
    return number * factor


def _split_quantity(text: str, si_unit: str, place: str) -> tuple[float, str]:
    match = _QUANTITY.fullmatch(text) if len(text) <= MAX_QUANTITY_LENGTH else None
    number = float(match[1]) if match else math.inf
    if match is None or not math.isfinite(number):
        example = unit_conversion.EXAMPLE_UNITS[si_unit].split(",")[0]
        raise InputError(f"{place} = '{text}' is not a finite number with a unit; write for example '0.5 {example}'")
    return number, match[2]


def parse_input_noise(noise: Mapping[str, str], rig: ChannelSource, place: str) -> dict[str, float]:
    """Return the standard deviation [SI] of each prescribed channel in ``noise``; ``place`` names the table.

    Raises InputError for a channel that ``rig`` does not prescribe, and unless a deviation is a positive number with a
    unit of the channel's kind.
    """
    units = get_prescribed_units(rig)
    deviations = {}
    for channel, text in noise.items():
        if channel in get_measured_units(rig):
            raise InputError(
                f"{place} names '{channel}', whose noise is estimated from repeats and residuals; allowed: the "
                f"prescribed channels {', '.join(units)}"
            )
        if channel not in units:
            hint = f"allowed: the prescribed channels {', '.join(units)}"
            raise InputError(f"{place} names the unknown channel '{channel}'; {suggest(channel, units, hint)}")
        deviations[channel] = _require_positive(
            parse_quantity(text, units[channel], f"{place} {channel}"), text, f"{place} {channel}"
        )
    return deviations


def parse_limits(limits: Mapping[str, str], rig: ChannelSource, place: str) -> dict[str, SensorLimits]:
    """Return the limits [SI] of the sensor of each measured channel in ``limits``; ``place`` names the table.

    Both numbers may be given (``-9 N to 445 N``) or one of them (``to 445 N``). Raises InputError for a channel that
    ``rig`` does not measure, for a number without a unit of the channel's kind, and unless the second is larger.
    """
    units = get_measured_units(rig)
    parsed = {}
    for channel, text in limits.items():
        _check_measured(channel, units, place)
        key = f"{place} {channel}"
        parts = [part.strip() for part in f" {text} ".split(" to ")]
        if len(parts) != 2 or not any(parts):
            raise InputError(f"{key} = '{text}' is refused; write for example '-9 N to 445 N', '-9 N to' or 'to 445 N'")
        low = parse_quantity(parts[0], units[channel], key) if parts[0] else -math.inf
        high = parse_quantity(parts[1], units[channel], key) if parts[1] else math.inf
        if low >= high:
            raise InputError(f"{key} = '{text}' is refused; the second number must be larger than the first")
        parsed[channel] = SensorLimits(low, high)
    return parsed


def parse_delays(delay: Mapping[str, str], rig: ChannelSource, place: str) -> dict[str, float]:
    """Return the delay [s] of each channel in ``delay``; ``place`` names the table.

    Raises InputError for a channel that ``rig`` does not have, for a number without a unit of time, and for a delay of
    more than :data:`MAX_DELAY`.
    """
    units = {**get_prescribed_units(rig), **get_measured_units(rig)}
    delays = {}
    for channel, text in delay.items():
        if channel not in units:
            hint = f"allowed: {', '.join(units)}"
            raise InputError(f"{place} names the unknown channel '{channel}'; {suggest(channel, units, hint)}")
        delays[channel] = parse_quantity(text, "s", f"{place} {channel}")
        if abs(delays[channel]) > MAX_DELAY:
            raise InputError(f"{place} {channel} = '{text}' is refused; allowed: up to {MAX_DELAY:g} s, late or early")
    return delays


def check_limits(fit_trials: Sequence[tuple[Trial, Mapping[str, str]]], place: str) -> None:
    """Raise InputError where the limits of a sensor leave too few samples of the ``fit_trials``.

    Each trial comes with its limits as written, for the sentence that begins with ``place``. Samples at a limit or
    beyond show no noise and hardly a misfit.
    """
    for channel in dict.fromkeys(channel for _, texts in fit_trials for channel in texts):
        measured = [(trial, texts) for trial, texts in fit_trials if channel in trial.measured]
        counts = [_count_free_samples(trial, channel) for trial, _ in measured]
        n_free, n_samples = (sum(numbers) for numbers in zip(*counts, strict=True)) if counts else (0, 0)
        if n_free < MIN_FREE_FRACTION * n_samples:
            text = next(texts[channel] for _, texts in measured if channel in texts)
            raise InputError(
                f"{place}: the limits of {channel}, '{text}', leave {n_free} of the {n_samples} samples in the trials "
                "for the fit, and the others are at a limit or beyond; is their unit right?"
            )


def _count_free_samples(trial: Trial, channel: str) -> tuple[int, int]:
    """Return how many samples of ``channel`` lie within the limits of its sensor, and how many there are."""
    limits = trial.limits.get(channel, SensorLimits(-math.inf, math.inf))
    values = trial.measured[channel].value[np.isfinite(trial.measured[channel].value)]
    return int(((values > limits.low) & (values < limits.high)).sum()), len(values)


def check_input_noise(trials: Sequence[tuple[Trial, Mapping[str, str]]], place: str) -> None:
    """Raise InputError where the stated noise of a prescribed channel is larger than its range in all ``trials``.

    Each trial comes with its noise as written, for the sentence that begins with ``place``.
    """
    for trial, texts in trials:
        for channel, text in texts.items():
            samples = [other.prescribed[channel].value for other, _ in trials]
            _check_not_larger(trial.input_noise[channel], samples, text, f"{place}: the noise of {channel}")


def _check_not_larger(value: float, samples: Sequence[Array], text: str, subject: str) -> None:
    """Raise InputError where ``value`` [SI], written as ``text``, is larger than the range of the ``samples``."""
    values = np.concatenate([array[np.isfinite(array)] for array in samples])
    if values.size == 0 or not values.any():  # nothing to compare with, as the command of a device without a supply
        return
    if value > max(float(np.ptp(values)), MIN_REFERENCE_FRACTION * float(np.abs(values).max())):
        raise InputError(f"{subject}, '{text}', is larger than the range of the channel; is its unit right?")


def _check_measured(channel: str, units: Mapping[str, str], place: str) -> None:
    if channel not in units:
        hint = f"allowed: the measured channels {', '.join(units)}"
        raise InputError(f"{place} names the unknown channel '{channel}'; {suggest(channel, units, hint)}")


def compute_tolerances(
    tolerance: Mapping[str, str], rig: ChannelSource, fit_trials: Sequence[Trial], place: str
) -> dict[str, float]:
    """Return the tolerance [SI] of each measured channel in ``tolerance``; ``place`` names the table.

    A tolerance in per cent refers to the range (largest minus smallest sample) of the channel over all ``fit_trials``.
    Raises InputError for a channel that ``rig`` does not measure, unless a tolerance is a positive number with a unit
    of the channel's kind or with ``%``, for a percentage where the fit trials have no range, and for a tolerance
    larger than the range.
    """
    units = get_measured_units(rig)
    tolerances = {}
    for channel, text in tolerance.items():
        _check_measured(channel, units, place)
        key = f"{place} {channel}"
        if text.rstrip().endswith(_PERCENT):
            percentage = _split_quantity(text, units[channel], key)
            if percentage[1] != _PERCENT:
                raise InputError(f"{key} = '{text}' is refused; write a percentage such as '2 %'")
            if percentage[0] > 100.0:
                raise InputError(f"{key} = '{text}' is refused; allowed: up to 100 % of the range of the channel")
            value = percentage[0] / 100.0 * _compute_range(channel, fit_trials, text, key)
        else:
            value = parse_quantity(text, units[channel], key)
        tolerances[channel] = _require_positive(value, text, key)
        samples = [trial.measured[channel].value for trial in fit_trials if channel in trial.measured]
        if samples:
            _check_not_larger(value, samples, text, key)
    return tolerances


def _compute_range(channel: str, trials: Sequence[Trial], text: str, key: str) -> float:
    values = [trial.measured[channel].value for trial in trials if channel in trial.measured]
    span = float(np.nanmax(np.concatenate(values)) - np.nanmin(np.concatenate(values))) if values else 0.0
    if span == 0.0:
        reason = "is constant in the fit trials" if values else "is not measured in a fit trial"
        raise InputError(f"{key} = '{text}' has no range to refer to: the channel {reason}; give a number with a unit")
    return span


def _require_positive(value: float, text: str, key: str) -> float:
    if value <= 0.0:
        raise InputError(f"{key} = '{text}' is refused; allowed: a number above 0")
    return value


def check_trusted(names: Sequence[str], measured: Collection[str], source: str) -> frozenset[str]:
    """Return the trusted channels ``names``; raise InputError for one that is not ``measured``."""
    for channel in names:
        if channel not in measured:
            raise InputError(
                f"{source}: 'trusted' names '{channel}', which the trial does not measure; allowed: "
                f"{', '.join(measured)}"
            )
    return frozenset(names)


def check_specimens(trials: Sequence[tuple[SplitEntry, str]], place: str) -> None:
    """Raise InputError where only some ``trials`` name their specimen, or a group of repeats has several.

    Each trial comes with its specimen, '' without one. Repeats of several specimens would make their scatter the noise
    of a repeat.
    """
    named = [trial.name for trial, specimen in trials if specimen]
    unnamed = [trial.name for trial, specimen in trials if not specimen]
    if named and unnamed:
        raise InputError(
            f"{place}: trial '{named[0]}' has a specimen and trial '{unnamed[0]}' has none; name the specimen of every "
            "trial, or of none"
        )
    specimens: dict[str, str] = {}
    for trial, specimen in trials:
        other = specimens.setdefault(trial.group, specimen)
        if other != specimen:
            raise InputError(
                f"{place}: group '{trial.group}' has trials of the specimens '{other}' and '{specimen}'; repeats are "
                "of one specimen, so give each specimen its own group"
            )
