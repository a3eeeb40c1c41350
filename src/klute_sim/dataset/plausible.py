"""Whether lengths and pressures can be those of the device: a heading with another unit than the samples' is usual."""

import math
from collections.abc import Iterable, Mapping

import numpy as np

from klute_sim.dataset import quantity
from klute_sim.dataset.trial import Trial
from klute_sim.errors import InputError
from klute_sim.recording.recording import Samples

IMPOSSIBLE = 3.0
"""Times longer or shorter than the device at rest, or above what its supply gives, no trial is (assumed: a muscle
shortens by a third, and usual units differ by more)."""
MUSCLE = 0.4, 1.3
"""Shortest and longest that a muscle may be, over its length at rest, in the unit that is guessed (assumed)."""
UNLIKELY = 0.02
"""Share of what the supply gives below which all commands are doubted (assumed: bar for kPa is a hundredth)."""
SPIKES = 5.0
"""Per cent of the samples of a pressure that may be above, as a loose contact makes them (assumed)."""

LITTLE_MORE = 1.2
"""Times what its supply gives that a device may have been commanded, where a unit is guessed (assumed)."""
USUAL = {"m": ("mm", "cm", "m", "in"), "Pa": ("bar", "kPa", "MPa", "psi", "Pa")}
"""SI unit -> units that samples may be in instead."""


def refuse(trial: Trial, units: Mapping[str, str]) -> None:
    """Raise InputError where no sample of a length, or too many of a pressure, can be of the device of ``trial``.

    ``units``: channel -> unit in its heading. Channels that always show the same are for others to judge. A muscle's
    sensor may count from anywhere, which a diagnosis can name: it is refused where another unit explains all samples.
    """
    parameters = trial.device.parameters
    muscle, supply = parameters.muscle.resting_length, parameters.supply.pressure
    whole = muscle + parameters.tendon.slack_length
    for channel, rest, what in (
        ("length", whole, "this device, muscle and tendon together, is {} long at rest"),
        ("muscle_length", muscle, "this device's muscle is {} long at rest"),
    ):
        values = _values(trial, channel)
        least, most = rest / IMPOSSIBLE, rest * IMPOSSIBLE
        if values.size and (values.min() > most or values.max() < least):
            guess = _unit(float(np.median(values)), rest, (least, most), units[channel], "m")
            if channel == "muscle_length":
                times = (quantity.between(guess, units[channel]) or math.nan) / rest if guess else math.nan
                if not MUSCLE[0] < times * values.min() <= times * values.max() < MUSCLE[1]:
                    continue
            raise InputError(_sentence(trial, channel, values, units[channel], "m", what, rest, guess))
    for channel in ("pressure_command", "pressure"):
        values = _values(trial, channel)
        peak = float(np.percentile(values, 100.0 - SPIKES)) if values.size else 0.0
        if peak > IMPOSSIBLE * supply:
            guess = _unit(peak, supply, _pressures(supply), units[channel], "Pa")
            what = "this device's supply gives no more than {}"
            raise InputError(_sentence(trial, channel, values, units[channel], "Pa", what, supply, guess))


def doubt(trials: Iterable[Trial], units: Mapping[str, str]) -> str:
    """What is odd about the commands of all ``trials`` together, in one sentence without its end; '' if nothing is."""
    peaks = [(float(t.prescribed["pressure_command"].value.max()), t.device.parameters.supply.pressure) for t in trials]
    highest, most = max(peaks)
    if highest <= 0.0 or any(peak >= UNLIKELY * own for peak, own in peaks):
        return ""
    unit = units["pressure_command"]
    guess = _unit(highest, most, _pressures(most), unit, "Pa")
    mend = f"perhaps it is in {guess}" if guess else "perhaps the unit in its heading is wrong"
    return (
        f"pressure_command is never above {_shown(highest, unit, 'Pa')}, and this device's supply gives "
        f"{_shown(most, unit, 'Pa')}; {mend}"
    )


def _values(trial: Trial, channel: str) -> Samples:
    """Samples that are there [SI]; none of a measured channel that always shows the same."""
    series = trial.prescribed.get(channel) or trial.measured.get(channel)
    values = series.value[np.isfinite(series.value)] if series else np.empty(0)
    return values[:0] if values.size and channel in trial.measured and np.ptp(values) == 0.0 else values


def _pressures(supply: float) -> tuple[float, float]:
    return UNLIKELY * supply, LITTLE_MORE * supply


def _unit(value: float, usual: float, between: tuple[float, float], written: str, si: str) -> str:
    """The unit in which what was read as ``value`` in the ``written`` one is nearest to ``usual``; '' if none can be.

    All in SI but the unit; it can be if the value is then ``between`` these.
    """
    found = {unit: value * (quantity.between(unit, written) or math.nan) for unit in USUAL[si]}
    near = {unit: one for unit, one in found.items() if between[0] <= one <= between[1]}
    return min(near, key=lambda unit: abs(math.log(near[unit] / usual)), default="")


def _shown(value: float, unit: str, si: str) -> str:
    return f"{float(f'{value / (quantity.factor(unit, si) or 1.0):.3g}'):g} {unit}"


def _sentence(
    trial: Trial, channel: str, values: Samples, unit: str, si: str, what: str, allowed: float, guess: str
) -> str:
    low, high = _shown(values.min(), unit, si).removesuffix(f" {unit}"), _shown(values.max(), unit, si)
    mend = f"is it in {guess}?" if guess else "its unit or its zero is another one"
    return f"trial '{trial.name}': {channel} is {low} to {high}, and {what.format(_shown(allowed, unit, si))}: {mend}"
