"""Where measured and simulated disagree: trial by trial, over the stride of a walk or over time on the bench."""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from klute_sim.diagnose.diagnosis import Diagnosis
from klute_sim.diagnose.experiment import Array, Experiment
from klute_sim.diagnose.on_gait import OnGait
from klute_sim.report import diagnosis_words as words
from klute_sim.report.diagnosis_traces import Simulated
from klute_sim.report.workbench.heat import Heat, binned, common

COLUMNS = 32
"""Of a map."""
MOST_ROWS = 20
"""Trials in a map, evenly chosen."""
LEAST_TOP = 3.0
"""Times the noise that the last colour stands for, at least: less is no disagreement."""
LONGEST = 12
"""Letters of a trial's name beside a map."""
CASES = {"before": "refitted", "after": "with effects added"}


class Row(NamedTuple):
    """A trial and what is left between it and the simulation."""

    experiment: Experiment
    left: Mapping[str, Mapping[str, Array]]
    """Case -> channel -> residual [SI]."""


def rows(diagnosis: Diagnosis, shown: Sequence[Simulated]) -> list[Row]:
    """Fitted trials, then those ``shown`` that no fit saw."""
    base, final, found = diagnosis.base, diagnosis.final, []
    if base is not None and final is not None:
        fitted = [e for e in diagnosis.experiments if e.use == "fit" and e.measured]
        for experiment, early, late in zip(fitted, base.residuals, final.residuals, strict=True):
            found.append(Row(experiment, {"before": early, "after": late}))
    if diagnosis.shown_on == "show":
        for one in shown:
            value = {channel: series.value for channel, series in one.experiment.measured.items()}
            before = {channel: value[channel] - one.before[channel] for channel in value}
            after = {channel: value[channel] - one.after[channel] for channel in value}
            found.append(Row(one.experiment, {"before": before, "after": after}))
    places = np.linspace(0, len(found) - 1, min(len(found), MOST_ROWS))
    return [found[int(k)] for k in np.unique(np.rint(places))]


def maps(diagnosis: Diagnosis, shown: Sequence[Simulated]) -> Iterator[tuple[str, list[tuple[str, Heat]]]]:
    """For each channel, its title and its maps (name, map): before, and after if something was found."""
    every = rows(diagnosis, shown)
    cases = list(CASES) if diagnosis.found else ["before"]
    walked = all(isinstance(row.experiment, OnGait) for row in every)
    longest = max((row.experiment.duration for row in every), default=1.0)
    edges = np.linspace(0.0, 100.0 if walked else longest, COLUMNS + 1)
    for channel, noise in diagnosis.noise.items():
        own = [row for row in every if channel in row.experiment.measured]
        if not own:
            continue
        found = {
            case: np.array([_row(row, case, channel, noise.deviation, edges, walked=walked) for row in own])
            for case in cases
        }
        top = common(list(found.values()), LEAST_TOP)
        names = tuple(map(_name, own))
        across = "gait cycle [%]" if walked else "time from the trial's start [s]"
        yield (
            words.spoken(channel),
            [
                (
                    CASES[case] if diagnosis.found else "simulated",
                    Heat(
                        f"gap/{channel}/{case}", across, edges, names, values, top, "sd of the noise; * no fit saw it"
                    ),
                )
                for case, values in found.items()
            ],
        )


def _name(row: Row) -> str:
    """Short enough to stand beside a map; a star says that it was not fitted."""
    name = row.experiment.name
    short = name if len(name) <= LONGEST else f"{name[: LONGEST - 1]}…"
    return short if row.experiment.use == "fit" else f"{short} *"


def _row(row: Row, case: str, channel: str, deviation: float, edges: Array, *, walked: bool) -> Array:
    experiment = row.experiment
    since = experiment.measured[channel].time - experiment.begin
    place = since
    if walked and isinstance(experiment, OnGait):
        place = 100.0 * (experiment.stride(since) % 1.0)
    left = row.left[case][channel] / (deviation * experiment.loud.get(channel, np.ones(len(since))))
    return binned(place, left, edges)
