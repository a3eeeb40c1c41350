"""Whether the data can answer at all, and what to record if they cannot."""

from collections.abc import Container, Iterable, Sequence
from dataclasses import replace

import numpy as np

from klute_sim.dataset.trial import FEWEST_SAMPLES
from klute_sim.diagnose import noise as noises
from klute_sim.diagnose.experiment import UNITS, Array, Experiment

LEAST_TIME = 2.0
"""Of all fitted trials together [s]."""
LEAST_PRESSURE = 0.5e5
LEAST_LENGTH = 1e-3
"""Ranges of the inputs [Pa, m] below which nothing moves."""
DEAD = 1e-9
"""Relative range of a channel that shows nothing."""
CLIPPED, FEWEST_CLIPPED = 5, 10
"""How many times more samples than at any other value, and how many at least, stand at the highest or lowest value of a
channel that is saturated. What is coarsely digitised or vented stands still elsewhere, too."""


def obstacles(experiments: Sequence[Experiment]) -> list[str]:
    """Why ``experiments`` (to be fitted) cannot answer, one sentence each with the mend; none: they can."""
    found = []
    telling = experiments[0].telling
    if not set(telling) & set(noises.channels(experiments)):
        names = [channel.replace("_", " ") for channel in telling]
        found.append(
            f"Neither {', '.join(names[:-1])} nor {names[-1]} was recorded usefully: of muscle, damper and tendon "
            "nothing shows. Record the force."
        )
    time = sum(e.duration for e in experiments)
    if time < LEAST_TIME:
        found.append(
            f"The trials to fit last {time:.1f} s together. Record at least {LEAST_TIME:g} s, better 20 s, with "
            "changing pressure and length."
        )
    pressure = max(float(np.ptp(e.command)) for e in experiments)
    length = max(e.travel for e in experiments)
    if pressure < LEAST_PRESSURE and length < LEAST_LENGTH:
        found.append(
            f"Nothing moves: pressure changes by {pressure / 1e5:.2f} bar and length by {1e3 * length:.2f} mm within a "
            "trial. Step the pressure and move the crosshead, both ways and at several speeds."
        )
    return found


def repeated(experiments: Sequence[Experiment]) -> bool:
    """Whether any channel was recorded more than once under the same input."""
    return bool(_repeated(experiments))


def unrepeated(experiments: Sequence[Experiment]) -> dict[str, str]:
    """Channels whose noise cannot be known, though that of others can, each with the reason."""
    known = _repeated(experiments)
    return {
        channel: f"'{channel}' was never recorded twice under the same input, so its noise is not known"
        for channel in noises.channels(experiments)
        if known and channel not in known
    }


def _repeated(experiments: Sequence[Experiment]) -> set[str]:
    groups = noises.groups(experiments).values()
    every = [[channel for k in members for channel in experiments[k].measured] for members in groups]
    return {channel for having in every for channel in having if having.count(channel) > 1}


def disagreements(
    experiments: Sequence[Experiment], residuals: noises.Residuals
) -> tuple[dict[tuple[str, str], str], list[str]]:
    """(trial, channel) that repeats contradict, each with the reason; and what forbids to go on."""
    found, against = {}, []
    for (group, channel), (own, others) in noises.discordant(experiments, residuals).items():
        unit, si = UNITS[channel]
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
    for channel, noise in noises.measure(experiments, residuals).items():
        if noise.deviation == 0.0:
            against.append(
                f"Repeats of '{channel}' agree to the last digit: they are copies, or the digits are too few to show "
                "any noise. Record every input anew, with more digits."
            )
    return found, against


def blind(experiments: Sequence[Experiment]) -> list[str]:
    """What ``experiments`` cannot show, though they may answer otherwise."""
    pressure = max(float(np.ptp(e.command)) for e in experiments)
    length = max(e.travel for e in experiments)
    found = []
    if length < LEAST_LENGTH:
        found.append(
            f"The length changes by no more than {1e3 * length:.2f} mm within a trial: what depends on speed hardly "
            "shows."
        )
    if pressure < LEAST_PRESSURE:
        found.append(
            f"The pressure changes by no more than {pressure / 1e5:.2f} bar within a trial: what happens in the supply "
            "hardly shows."
        )
    if not repeated(experiments):
        found.append(
            "No trial is repeated, so noise and misfit cannot be told apart: only what stands out far can be named, "
            "and whether anything is left cannot be said. Record every input at least twice and give the repeats the "
            "same group."
        )
    return found


def faults(experiments: Sequence[Experiment]) -> tuple[dict[str, str], list[str]]:
    """Channels that cannot be used, each with its reason; and remarks on the others."""
    unusable, remarks = {}, []
    for channel in noises.channels(experiments):
        values = [e.measured[channel].value for e in experiments if channel in e.measured]
        every = np.concatenate(values)
        if np.ptp(every) <= DEAD * max(1.0, float(np.abs(every).max())):
            shown = every[0] / UNITS[channel][1]
            unusable[channel] = f"'{channel}' always shows {shown:g} {UNITS[channel][0]}: the channel is dead"
            continue
        for end in _saturated(every):
            shown, count = end / UNITS[channel][1], int((every == end).sum())
            remarks.append(
                f"'{channel}' shows exactly {shown:g} {UNITS[channel][0]} in {count} of {len(every)} samples: it may "
                "be saturated, and those samples are not compared"
            )
    return unusable, remarks


def _saturated(every: Array) -> list[float]:
    """Which of the highest and the lowest of ``every`` sample are the ends of what the channel can show."""
    values, counts = np.unique(every, return_counts=True)
    between = counts[1:-1][values[1:-1] != 0.0]
    least = max(FEWEST_CLIPPED, CLIPPED * int(between.max(initial=0)))
    return [float(values[k]) for k in (-1, 0) if values[k] != 0.0 and counts[k] >= least]


def without(experiments: Sequence[Experiment], unusable: Container[tuple[str, str]]) -> list[Experiment]:
    """``experiments`` less their ``unusable`` channels, each as (trial, channel)."""
    return [
        replace(e, measured={c: series for c, series in e.measured.items() if (e.name, c) not in unusable})
        for e in experiments
    ]


def everywhere(experiments: Sequence[Experiment], channels: Iterable[str]) -> set[tuple[str, str]]:
    """(trial, channel) for all of ``experiments``."""
    return {(e.name, channel) for e in experiments for channel in channels}


def unsaturated(experiments: Sequence[Experiment], fitted: Sequence[Experiment]) -> list[Experiment]:
    """``experiments`` without the samples of a channel that stand where it is saturated in ``fitted`` ones.

    A channel of which hardly any sample is left in a trial is left out of it.
    """
    ends: dict[str, list[float]] = {}
    for channel in noises.channels(fitted):
        every = np.concatenate([e.measured[channel].value for e in fitted if channel in e.measured])
        ends[channel] = _saturated(every)
    result = []
    for e in experiments:
        measured = {}
        for channel, series in e.measured.items():
            good = ~np.isin(series.value, ends.get(channel, []))
            if good.sum() >= FEWEST_SAMPLES:
                measured[channel] = type(series)(series.time[good], series.value[good])
        result.append(replace(e, measured=measured))
    return result
