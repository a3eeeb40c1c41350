"""Whether the data can answer at all, and what to record if they cannot."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from klute_sim.diagnose import noise as noises
from klute_sim.diagnose.experiment import UNITS, Experiment

LEAST_TIME = 2.0
"""Of all fitted trials together [s]."""
LEAST_PRESSURE = 0.5e5
LEAST_LENGTH = 1e-3
"""Ranges of the inputs [Pa, m] below which nothing moves."""
DEAD = 1e-9
"""Relative range of a channel that shows nothing."""
CLIPPED = 0.05
"""Share of a channel's samples at its highest or lowest value that means saturation."""


def obstacles(experiments: Sequence[Experiment]) -> list[str]:
    """Why ``experiments`` (to be fitted) cannot answer, one sentence each with the mend; none: they can."""
    found = []
    if not {"force", "muscle_length"} & set(noises.channels(experiments)):
        found.append(
            "Neither force nor muscle length was recorded usefully: of muscle, damper and tendon nothing shows. Record "
            "the force."
        )
    time = sum(e.duration for e in experiments)
    if time < LEAST_TIME:
        found.append(
            f"The trials to fit last {time:.1f} s together. Record at least {LEAST_TIME:g} s, better 20 s, with "
            "changing pressure and length."
        )
    pressure = max(float(np.ptp(e.command)) for e in experiments)
    length = max(float(np.ptp(e.unit_length)) for e in experiments)
    if pressure < LEAST_PRESSURE and length < LEAST_LENGTH:
        found.append(
            f"Nothing moves: pressure changes by {pressure / 1e5:.2f} bar and length by {1e3 * length:.2f} mm within a "
            "trial. Step the pressure and move the crosshead, both ways and at several speeds."
        )
    return found


def repeated(experiments: Sequence[Experiment]) -> bool:
    """Whether any input was recorded more than once."""
    return any(len(members) > 1 for members in noises.groups(experiments).values())


def blind(experiments: Sequence[Experiment]) -> list[str]:
    """What ``experiments`` cannot show, though they may answer otherwise."""
    pressure = max(float(np.ptp(e.command)) for e in experiments)
    length = max(float(np.ptp(e.unit_length)) for e in experiments)
    found = []
    if length < LEAST_LENGTH:
        found.append(
            f"The length changes by no more than {1e3 * length:.2f} mm within a trial: what depends on speed cannot "
            "show."
        )
    if pressure < LEAST_PRESSURE:
        found.append(
            f"The pressure changes by no more than {pressure / 1e5:.2f} bar within a trial: what happens in the supply "
            "cannot show."
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
        for end in (float(every.max()), float(every.min())):
            share = float(np.mean(every == end))
            if share > CLIPPED and end != 0.0:
                shown = end / UNITS[channel][1]
                remarks.append(
                    f"'{channel}' shows exactly {shown:g} {UNITS[channel][0]} in {100 * share:.0f} % of its samples: "
                    "it may be saturated there"
                )
    return unusable, remarks


def without(experiments: Sequence[Experiment], channels: Sequence[str]) -> list[Experiment]:
    """``experiments`` less some of their measured ``channels``."""
    return [
        replace(e, measured={c: series for c, series in e.measured.items() if c not in channels}) for e in experiments
    ]


def unsaturated(experiments: Sequence[Experiment]) -> list[Experiment]:
    """``experiments`` without the samples of a channel that stand at its saturated end."""
    ends: dict[str, list[float]] = {}
    for channel in noises.channels(experiments):
        every = np.concatenate([e.measured[channel].value for e in experiments if channel in e.measured])
        limits = (float(every.max()), float(every.min()))
        ends[channel] = [end for end in limits if end != 0.0 and np.mean(every == end) > CLIPPED]
    result = []
    for e in experiments:
        measured = {}
        for channel, series in e.measured.items():
            good = ~np.isin(series.value, ends[channel])
            measured[channel] = type(series)(series.time[good], series.value[good])
        result.append(replace(e, measured=measured))
    return result
