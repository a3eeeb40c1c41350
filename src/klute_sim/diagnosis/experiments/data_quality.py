"""Whether the data can answer at all, and what to record if they cannot."""

from collections.abc import Container, Iterable, Sequence
from dataclasses import replace

import numpy as np

from klute_sim.datasets.trial import MIN_SAMPLES
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS, Array, Experiment
from klute_sim.diagnosis.noise import repeats as noises

MIN_TOTAL_TIME = 2.0
"""Of all fitted trials together [s]."""
MIN_PRESSURE_RANGE = 0.5e5
MIN_LENGTH_RANGE = 1e-3
"""Ranges of the inputs [Pa, m] below which nothing moves."""
MIN_RELATIVE_RANGE = 1e-9
"""Relative range of a channel that shows nothing."""
SATURATION_COUNT_RATIO, MIN_SATURATED_SAMPLES = 5, 10
"""How many times more samples than at any other value, and how many at least, stand at the highest or lowest value of a
channel that is saturated. What is coarsely digitised or vented stands still elsewhere, too."""


def find_blocking_problems(experiments: Sequence[Experiment]) -> list[str]:
    """Why ``experiments`` (to be fitted) cannot answer, one sentence each with the mend; none: they can."""
    found = []
    telling = experiments[0].informative_channels
    if not set(telling) & set(noises.list_channels(experiments)):
        names = [channel.replace("_", " ") for channel in telling]
        found.append(
            f"Neither {', '.join(names[:-1])} nor {names[-1]} was recorded usefully: of muscle, damper and tendon "
            "nothing shows. Record the force."
        )
    time = sum(e.duration for e in experiments)
    if time < MIN_TOTAL_TIME:
        found.append(
            f"The trials to fit last {time:.1f} s together. Record at least {MIN_TOTAL_TIME:g} s, better 20 s, with "
            "changing pressure and length."
        )
    pressure = max(float(np.ptp(e.command)) for e in experiments)
    length = max(e.length_range for e in experiments)
    if pressure < MIN_PRESSURE_RANGE and length < MIN_LENGTH_RANGE:
        found.append(
            f"Nothing moves: pressure changes by {pressure / 1e5:.2f} bar and length by {1e3 * length:.2f} mm within a "
            "trial. Step the pressure and move the crosshead, both ways and at several speeds."
        )
    return found


def has_repeats(experiments: Sequence[Experiment]) -> bool:
    """Whether any channel was recorded more than once under the same input."""
    return bool(_find_repeated_channels(experiments))


def find_unrepeated_channels(experiments: Sequence[Experiment]) -> dict[str, str]:
    """Channels whose noise cannot be known, though that of others can, each with the reason."""
    known = _find_repeated_channels(experiments)
    return {
        channel: f"'{channel}' was never recorded twice under the same input, so its noise is not known"
        for channel in noises.list_channels(experiments)
        if known and channel not in known
    }


def _find_repeated_channels(experiments: Sequence[Experiment]) -> set[str]:
    groups = noises.group_repeats(experiments).values()
    every = [[channel for k in members for channel in experiments[k].measured] for members in groups]
    return {channel for having in every for channel in having if having.count(channel) > 1}


def find_contradicted_channels(
    experiments: Sequence[Experiment], residuals: noises.Residuals
) -> tuple[dict[tuple[str, str], str], list[str]]:
    """(trial, channel) that repeats contradict, each with the reason; and what forbids to go on."""
    found, against = {}, []
    for (group, channel), (own, others) in noises.find_inconsistent_repeats(experiments, residuals).items():
        unit, si = CHANNEL_UNITS[channel]
        having = [e for e in experiments if e.group == group and channel in e.measured]
        still = [e for e in having if np.ptp(e.measured[channel].value) == 0.0]
        sentence = (
            f"Repeats of '{group}' differ in {channel} by {own / si:.3g} {unit}, those of other groups by "
            f"{others / si:.3g} {unit}"
        )
        if still and len(still) < len(having):
            names = ", ".join(e.name for e in still)
            sentence += f": it always shows {still[0].measured[channel].value[0] / si:g} {unit} in {names}"
        else:
            still = having
            sentence += " (a unit, a cable, another trial's file?)"
        found.update({(e.name, channel): f"{sentence}; it is not used there." for e in still})
    for channel, noise in noises.estimate_noise_from_repeats(experiments, residuals).items():
        if noise.std == 0.0:
            against.append(
                f"Repeats of '{channel}' agree to the last digit: they are copies, or the digits are too few to show "
                "any noise. Record every input anew, with more digits."
            )
    return found, against


def find_limitations(experiments: Sequence[Experiment]) -> list[str]:
    """What ``experiments`` cannot show, though they may answer otherwise."""
    pressure = max(float(np.ptp(e.command)) for e in experiments)
    length = max(e.length_range for e in experiments)
    found = []
    if length < MIN_LENGTH_RANGE:
        found.append(
            f"The length changes by no more than {1e3 * length:.2f} mm within a trial: what depends on speed hardly "
            "shows."
        )
    if pressure < MIN_PRESSURE_RANGE:
        found.append(
            f"The pressure changes by no more than {pressure / 1e5:.2f} bar within a trial: what happens in the supply "
            "hardly shows."
        )
    if not has_repeats(experiments):
        found.append(
            "No trial is repeated, so noise and misfit cannot be told apart: only what stands out far can be named, "
            "and whether anything is left cannot be said. Record every input at least twice and give the repeats the "
            "same group."
        )
    return found


def find_faulty_channels(experiments: Sequence[Experiment]) -> tuple[dict[str, str], list[str]]:
    """Channels that cannot be used, each with its reason; and remarks on the others."""
    unusable, remarks = {}, []
    for channel in noises.list_channels(experiments):
        values = [e.measured[channel].value for e in experiments if channel in e.measured]
        every = np.concatenate(values)
        if np.ptp(every) <= MIN_RELATIVE_RANGE * max(1.0, float(np.abs(every).max())):
            shown = every[0] / CHANNEL_UNITS[channel][1]
            unusable[channel] = f"'{channel}' always shows {shown:g} {CHANNEL_UNITS[channel][0]}: the channel is dead"
            continue
        for end in _find_saturation_values(every):
            shown, count = end / CHANNEL_UNITS[channel][1], int((every == end).sum())
            remarks.append(
                f"'{channel}' shows exactly {shown:g} {CHANNEL_UNITS[channel][0]} in {count} of {len(every)} samples: it may "
                "be saturated, and those samples are not compared"
            )
    return unusable, remarks


def _find_saturation_values(samples: Array) -> list[float]:
    """Which of the highest and the lowest of ``every`` sample are the ends of what the channel can show."""
    values, counts = np.unique(samples, return_counts=True)
    between = counts[1:-1][values[1:-1] != 0.0]
    least = max(MIN_SATURATED_SAMPLES, SATURATION_COUNT_RATIO * int(between.max(initial=0)))
    return [float(values[k]) for k in (-1, 0) if values[k] != 0.0 and counts[k] >= least]


def remove_channels(experiments: Sequence[Experiment], excluded: Container[tuple[str, str]]) -> list[Experiment]:
    """``experiments`` less their ``unusable`` channels, each as (trial, channel)."""
    return [
        replace(e, measured={c: series for c, series in e.measured.items() if (e.name, c) not in excluded})
        for e in experiments
    ]


def pair_trials_with_channels(experiments: Sequence[Experiment], channels: Iterable[str]) -> set[tuple[str, str]]:
    """(trial, channel) for all of ``experiments``."""
    return {(e.name, channel) for e in experiments for channel in channels}


def remove_saturated_samples(
    experiments: Sequence[Experiment], fit_experiments: Sequence[Experiment]
) -> list[Experiment]:
    """``experiments`` without the samples of a channel that stand where it is saturated in ``fitted`` ones.

    A channel of which hardly any sample is left in a trial is left out of it.
    """
    ends: dict[str, list[float]] = {}
    for channel in noises.list_channels(fit_experiments):
        every = np.concatenate([e.measured[channel].value for e in fit_experiments if channel in e.measured])
        ends[channel] = _find_saturation_values(every)
    result = []
    for e in experiments:
        measured = {}
        for channel, series in e.measured.items():
            good = ~np.isin(series.value, ends.get(channel, []))
            if good.sum() >= MIN_SAMPLES:
                measured[channel] = type(series)(series.time[good], series.value[good])
        result.append(replace(e, measured=measured))
    return result
