"""Where measured and simulated disagree: trial by trial, over the stride of a walk or over time on the bench."""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from klute_sim.diagnosis.experiments.base import Array, Experiment
from klute_sim.diagnosis.experiments.gait import GaitExperiment
from klute_sim.diagnosis.workflow import Diagnosis
from klute_sim.report.diagnosis import text as words
from klute_sim.report.diagnosis.traces import SimulatedTrial
from klute_sim.viewer.heatmap import Heatmap, compute_binned_rms, compute_common_max

N_COLUMNS = 32
"""Of a map."""
MAX_ROWS = 20
"""Trials in a map, evenly chosen."""
MIN_SCALE_MAX_SD = 3.0
"""Times the noise that the last colour stands for, at least: less is no disagreement."""
MAX_NAME_LENGTH = 12
"""Letters of a trial's name beside a map."""
CASE_NAMES = {"before": "refitted", "after": "with effects added"}


class ResidualRow(NamedTuple):
    """A trial and what is left between it and the simulation."""

    experiment: Experiment
    residuals: Mapping[str, Mapping[str, Array]]
    """Case -> channel -> residual [SI]."""


def build_rows(diagnosis: Diagnosis, simulated_trials: Sequence[SimulatedTrial]) -> list[ResidualRow]:
    """Fitted trials, then those ``shown`` that no fit saw."""
    base, final, found = diagnosis.base_fit, diagnosis.final_fit, []
    if base is not None and final is not None:
        fitted = [e for e in diagnosis.experiments if e.use == "fit" and e.measured]
        for experiment, early, late in zip(fitted, base.residuals, final.residuals, strict=True):
            found.append(ResidualRow(experiment, {"before": early, "after": late}))
    if diagnosis.evaluated_on == "show":
        for one in simulated_trials:
            value = {channel: series.value for channel, series in one.experiment.measured.items()}
            before = {channel: value[channel] - one.before[channel] for channel in value}
            after = {channel: value[channel] - one.after[channel] for channel in value}
            found.append(ResidualRow(one.experiment, {"before": before, "after": after}))
    places = np.linspace(0, len(found) - 1, min(len(found), MAX_ROWS))
    return [found[int(k)] for k in np.unique(np.rint(places))]


def build_maps(
    diagnosis: Diagnosis, simulated_trials: Sequence[SimulatedTrial]
) -> Iterator[tuple[str, list[tuple[str, Heatmap]]]]:
    """For each channel, its title and its maps (name, map): before, and after if something was found."""
    every = build_rows(diagnosis, simulated_trials)
    cases = list(CASE_NAMES) if diagnosis.added_terms else ["before"]
    walked = all(isinstance(row.experiment, GaitExperiment) for row in every)
    longest = max((row.experiment.duration for row in every), default=1.0)
    edges = np.linspace(0.0, 100.0 if walked else longest, N_COLUMNS + 1)
    for channel, noise in diagnosis.noise.items():
        own = [row for row in every if channel in row.experiment.measured]
        if not own:
            continue
        found = {
            case: np.array([_bin_residuals(row, case, channel, noise.std, edges, is_gait=walked) for row in own])
            for case in cases
        }
        top = compute_common_max(list(found.values()), MIN_SCALE_MAX_SD)
        names = tuple(map(_format_name, own))
        across = "gait cycle [%]" if walked else "time from the trial's start [s]"
        yield (
            words.humanize_identifier(channel),
            [
                (
                    CASE_NAMES[case] if diagnosis.added_terms else "simulated",
                    Heatmap(
                        f"gap/{channel}/{case}", across, edges, names, values, top, "sd of the noise; * no fit saw it"
                    ),
                )
                for case, values in found.items()
            ],
        )


def _format_name(row: ResidualRow) -> str:
    """Short enough to stand beside a map; a star says that it was not fitted."""
    name = row.experiment.name
    short = name if len(name) <= MAX_NAME_LENGTH else f"{name[: MAX_NAME_LENGTH - 1]}…"
    return short if row.experiment.use == "fit" else f"{short} *"


def _bin_residuals(row: ResidualRow, case: str, channel: str, noise_sd: float, edges: Array, *, is_gait: bool) -> Array:
    experiment = row.experiment
    since = experiment.measured[channel].time - experiment.start_time
    place = since
    if is_gait and isinstance(experiment, GaitExperiment):
        place = 100.0 * (experiment.compute_stride_phase(since) % 1.0)
    left = row.residuals[case][channel] / (noise_sd * experiment.noise_scale.get(channel, np.ones(len(since))))
    return compute_binned_rms(place, left, edges)
