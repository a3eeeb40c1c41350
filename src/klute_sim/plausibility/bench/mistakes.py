"""Mistakes that a simulation can confirm: each is the trial as it would be without the mistake, and a sentence."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import permutations
from typing import NamedTuple

import numpy as np

from klute_sim.plausibility.bench import time_axis
from klute_sim.plausibility.bench.trial import MEASURED, PRESCRIBED, SI_UNITS, RecordedTrial
from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.units import UNIT_ADVICE, UNITS, Range
from klute_sim.types import Array

ATMOSPHERE = 101_325.0
"""Atmospheric pressure [Pa]."""
MAX_PERMUTATIONS = 12
"""Maximum number of exchanges of columns that are simulated."""
SAMPLING_RATE_FACTORS = 0.1, 10.0, 0.01, 100.0
"""Factors of times that were computed with a wrong sampling rate."""
EXTREMES = 5.0, 50.0, 95.0
"""Percentiles of a length that must all be possible (assumed; the others may be spikes)."""


class Mistake(NamedTuple):
    """A possible mistake."""

    findings: tuple[Finding, ...]
    """What the user reads if the mistake is confirmed; one finding for each channel concerned."""
    trial: RecordedTrial
    """The trial without the mistake."""
    evidence: tuple[str, ...] = MEASURED
    """Measured channels that have to agree better without the mistake."""
    rival: RecordedTrial | None = None
    """The trial without the correction, with another device; if it agrees as well, the mistake is not confirmed."""
    label: str = ""
    """What distinguishes it from mistakes with findings of the same names, such as the unit."""

    @property
    def name(self) -> str:
        """Name of the finding about the first channel concerned."""
        return self.findings[0].name

    @property
    def key(self) -> str:
        """What two trials with the same mistake have in common."""
        return " ".join([*(finding.name for finding in self.findings), self.label])


def list_mistakes(trial: RecordedTrial) -> Iterator[Mistake]:
    """Yield the possible mistakes, simple ones first."""
    yield from _list_units(trial)
    yield from _list_signs(trial)
    yield from _list_zeros(trial)
    yield from _list_absolute_pressures(trial)
    yield from _list_exchanges(trial)
    yield from _list_reversals(trial)
    yield from list_time_units(trial)
    yield from _list_sampling_rates(trial)


def _list_sampling_rates(trial: RecordedTrial) -> Iterator[Mistake]:
    """Yield sampling rates that are wrong by a power of ten; every velocity and every lag shows them.

    The lag of the supply alone does not: a hose or a needle valve may be ten times as slow as the supply of the device
    file. The force of a muscle without a damper then has the waveform of a recording with wrong times.
    """
    if not trial.channels.keys() & {"force", "muscle_length"}:
        return
    interval, duration = time_axis.measure_time_axis(trial)
    # With few samples per second, the samples say little about what happens between them.
    for factor in SAMPLING_RATE_FACTORS if time_axis.is_usual(interval, duration) else ():
        if time_axis.is_usual(interval * factor, duration * factor):
            statement = (
                f"time has a sample every {interval:.3g} s, but a simulation of this device agrees only if all times "
                f"are multiplied by {factor:g}: the sampling rate that the times were computed with seems wrong"
            )
            finding = Finding("time-scale", trial.place, statement)
            rival = trial.with_supply_speed(factor)
            yield Mistake((finding,), trial.with_time_scale(factor), rival=rival, label=f"{factor:g}")


def list_time_units(trial: RecordedTrial) -> Iterator[Mistake]:
    """Yield units that make an unusual time axis usual."""
    for unit, factor in time_axis.list_candidate_units(trial).items():
        yield Mistake((time_axis.describe_time_unit(trial, unit),), trial.with_time_scale(factor), label=unit)


def _list_units(trial: RecordedTrial) -> Iterator[Mistake]:
    """Yield other units of one channel, and of both pressures."""
    for name in ("force", "pressure", "muscle_length", "pressure_command"):
        if name in trial.channels:
            for unit, factor in _list_other_units(trial, name):
                statement = f"{_describe(trial, name)}: is its unit {unit}? {UNIT_ADVICE}"
                corrected = trial.with_values(**{name: trial.get_samples(name).value * factor})
                yield Mistake((Finding(f"{name}-unit", trial.place, statement),), corrected, label=unit)
    if (
        "pressure" in trial.channels
        and trial.get_samples("pressure").unit == trial.get_samples("pressure_command").unit
    ):
        for unit, factor in _list_other_units(trial, "pressure_command"):
            names = ("pressure_command", "pressure")
            findings = tuple(
                Finding(
                    f"{name}-unit",
                    trial.place,
                    f"{name} is {trial.format_channel(name)}, but the measured forces need other pressures in a "
                    f"simulation of this device: is the unit of both pressures {unit}? {UNIT_ADVICE}",
                )
                for name in names
            )
            changed = {name: trial.get_samples(name).value * factor for name in names}
            # A pressure that follows its command does so in any unit: only the others know how large both are.
            yield Mistake(findings, trial.with_values(**changed), evidence=("force", "muscle_length"), label=unit)


def _list_other_units(trial: RecordedTrial, name: str) -> Iterator[tuple[str, float]]:
    """Yield other units of a channel and the factor by which its samples change, where the result is plausible."""
    samples, plausible = trial.get_samples(name), trial.limits.get_range(name)
    middle = float(np.percentile(np.abs(samples.finite), 90.0))
    for unit, factor in UNITS[SI_UNITS[name]].items():
        ratio = factor / samples.factor
        is_other = not 0.6 < ratio < 1.6
        if is_other and (plausible.low <= ratio * middle <= 1.5 * plausible.high or name == "muscle_length"):
            yield unit, ratio


def _list_signs(trial: RecordedTrial) -> Iterator[Mistake]:
    """Yield reversed signs of the channels."""
    for name in ("force", "pressure", "pressure_command"):
        if name in trial.channels and float(np.median(trial.get_samples(name).finite)) < 0.0:
            statement = f"{_describe(trial, name)}: its sign seems reversed; {_SIGN_RULES[name]}"
            corrected = trial.with_values(**{name: -trial.get_samples(name).value})
            yield Mistake((Finding(f"{name}-sign", trial.place, statement),), corrected)
    both = [name for name in ("pressure_command", "pressure") if name in trial.channels]
    if len(both) == 2 and all(float(np.median(trial.get_samples(name).finite)) < 0.0 for name in both):
        findings = tuple(
            Finding(
                f"{name}-sign",
                trial.place,
                f"{name} is {trial.format_channel(name)}: the signs of both pressures seem reversed; "
                + _SIGN_RULES[name],
            )
            for name in both
        )
        yield Mistake(findings, trial.with_values(**{name: -trial.get_samples(name).value for name in both}))
    for name in ("muscle_length", "length"):
        if name in trial.channels:
            values = trial.get_samples(name).value
            middle = float(np.nanmin(values) + np.nanmax(values))
            statement = (
                f"{name} is {trial.format_channel(name)} and changes opposite to what a simulation of this device "
                "needs: it seems to be a shortening, or its sign is reversed; write lengths, which grow as the unit "
                "is stretched"
            )
            yield Mistake(
                (Finding(f"{name}-sign", trial.place, statement),), trial.with_values(**{name: middle - values})
            )


def _list_zeros(trial: RecordedTrial) -> Iterator[Mistake]:
    """Yield the length of the muscle alone in place of that of the unit."""
    limits, values = trial.limits, trial.get_samples("length").value
    if limits.tendon_length > 0.0 and float(np.nanmax(values)) < 1.05 * limits.muscle_length:
        statement = (
            f"length is {trial.format_channel('length')}, but the resting length of this device, muscle and tendon "
            f"together, is {trial.format_limit('length', limits.unit_length)}: it looks like the length of the muscle "
            "alone; add the length of the tendon"
        )
        corrected = trial.with_values(length=values + limits.tendon_length)
        yield Mistake((Finding("length-zero", trial.place, statement),), corrected)


_SIGN_RULES = {
    "force": "tension is positive",
    "pressure": "pressures above that of the room are positive",
    "pressure_command": "pressures above that of the room are positive",
}


def _list_absolute_pressures(trial: RecordedTrial) -> Iterator[Mistake]:
    """Yield pressures that were recorded absolute instead of relative to the room."""
    present = [name for name in ("pressure", "pressure_command") if name in trial.channels]
    for names in ([name] for name in present) if len(present) == 1 else ([present[0]], [present[1]], present):
        if any(float(np.percentile(trial.get_samples(name).finite, 2.0)) < 0.9 * ATMOSPHERE for name in names):
            continue
        findings = tuple(
            Finding(
                f"{name}-absolute",
                trial.place,
                f"{name} is {trial.format_channel(name)} and never below the pressure of the atmosphere, "
                f"{trial.format_limit(name, ATMOSPHERE)}, which agrees with a simulation of this device only after "
                "that is subtracted: it looks like absolute pressure; subtract the pressure of the atmosphere",
            )
            for name in names
        )
        changed = {name: trial.get_samples(name).value - ATMOSPHERE for name in names}
        yield Mistake(findings, trial.with_values(**changed))


def _list_exchanges(trial: RecordedTrial) -> Iterator[Mistake]:
    """Yield exchanged columns: orders of the columns in which every channel that moves has a plausible magnitude."""
    names = tuple(trial.channels)
    written = {name: trial.get_samples(name).value / trial.get_samples(name).factor for name in names}
    by_number_moved: list[tuple[int, tuple[str, ...]]] = []
    for order in permutations(names):
        moved = [(name, source) for name, source in zip(names, order, strict=True) if name != source]
        if moved and all(_is_possible(trial, name, written[source]) for name, source in moved):
            by_number_moved.append((len(moved), order))
    for _, order in sorted(by_number_moved)[:MAX_PERMUTATIONS]:
        pairs = [(name, source) for name, source in zip(names, order, strict=True) if name != source]
        channels = {
            name: trial.channels[source]._replace(
                samples=trial.get_samples(name)._replace(value=written[source] * trial.get_samples(name).factor)
            )
            for name, source in pairs
        }
        corrected = replace(trial, channels={**trial.channels, **channels})
        listing = ", ".join(f"{name} {trial.format_channel(name)}" for name, _ in pairs)
        moves = ", ".join(f"{name} stands under {source}" for name, source in pairs)
        statement = (
            f"the columns of {' and '.join(name for name, _ in pairs)} seem exchanged ({listing}): in a simulation of "
            f"this device they agree if {moves}; correct the headings"
        )
        names_of_channels = sorted((name for name, _ in pairs), key=_ORDER.index)
        finding = Finding(f"{'-'.join(names_of_channels)}-exchanged", trial.place, statement)
        yield Mistake((finding,), corrected, label=moves)


_ORDER = ("force", "length", "muscle_length", "pressure", "pressure_command")


def _is_possible(trial: RecordedTrial, name: str, written: Array) -> bool:
    """Return whether ``written``, in the unit of the heading of ``name``, can be the samples of that channel."""
    low, high, typical = trial.limits.get_range(name)
    slack = 1.5 if name in ("length", "muscle_length") else 2.0
    low = 0.0 if name in ("force", "pressure", "pressure_command") else low
    possible = Range(low / slack, high * slack, typical)
    values = np.abs(written[np.isfinite(written)]) * trial.get_samples(name).factor
    # The unit has a possible length at every moment: a pressure that begins at zero is no length.
    percentiles = EXTREMES if name == "length" else (50.0,)
    return all(possible.contains(float(value)) for value in np.percentile(values, percentiles))


def _list_reversals(trial: RecordedTrial) -> Iterator[Mistake]:
    """Yield columns whose rows run backwards in time: one channel, and all."""
    groups = [(name,) for name in (*MEASURED, *PRESCRIBED) if name in trial.channels]
    for names in (*groups, tuple(trial.channels)):
        corrected = trial.with_values(**{name: trial.get_samples(name).value[::-1] for name in names})
        subject = names[0] if len(names) == 1 else "every channel"
        statement = (
            f"{subject} agrees with a simulation of this device only if its samples are read from the last to the "
            "first: its rows seem reversed in time; sort them by time"
        )
        name = f"{names[0]}-reversed" if len(names) == 1 else "time-reversed"
        yield Mistake((Finding(name, trial.place, statement),), corrected)


def _describe(trial: RecordedTrial, name: str) -> str:
    """Return what ``name`` is and what a simulation gives; ``{simulated}`` stands for the simulated range."""
    return f"{name} is {trial.format_channel(name)}, but {{simulated_{name}}}"
