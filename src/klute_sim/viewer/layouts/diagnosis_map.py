"""Heatmaps of the residuals of a diagnosis: trial by trial, over the gait cycle or over time."""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.experiments.gait import GaitExperiment
from klute_sim.diagnosis.result import Diagnosis
from klute_sim.report.diagnosis import text as words
from klute_sim.report.diagnosis.traces import SimulatedTrial
from klute_sim.types import Array
from klute_sim.viewer.heatmap import Heatmap, compute_binned_rms, compute_common_max

N_COLUMNS = 32
"""Number of columns of a map."""
MAX_ROWS = 20
"""Maximum number of trials in a map; they are evenly spaced."""
MIN_SCALE_MAX_SD = 3.0
"""Smallest upper end of the colour scale, in standard deviations of the noise."""
MAX_NAME_LENGTH = 12
"""Maximum length [characters] of a trial's name beside a map."""
CASE_NAMES = {"before": "refitted", "after": "with effects added"}


class ResidualRow(NamedTuple):
    """A trial and the residuals of its simulations."""

    experiment: Experiment
    residuals: Mapping[str, Mapping[str, Array]]
    """Case -> channel -> residual [SI]."""


def build_rows(diagnosis: Diagnosis, simulated_trials: Sequence[SimulatedTrial]) -> list[ResidualRow]:
    """Return the fitted trials, followed by the test trials among ``simulated_trials``."""
    rows: list[ResidualRow] = []
    base, final = diagnosis.base_fit, diagnosis.final_fit
    if base is not None and final is not None:
        fitted = diagnosis.fitted_experiments
        for experiment, early, late in zip(fitted, base.residuals, final.residuals, strict=True):
            rows.append(ResidualRow(experiment, {"before": early, "after": late}))
    if diagnosis.evaluated_on == "test":
        for trial in simulated_trials:
            value = {channel: series.value for channel, series in trial.experiment.measured.items()}
            before = {channel: value[channel] - trial.before[channel] for channel in value}
            after = {channel: value[channel] - trial.after[channel] for channel in value}
            rows.append(ResidualRow(trial.experiment, {"before": before, "after": after}))
    positions = np.linspace(0, len(rows) - 1, min(len(rows), MAX_ROWS))
    return [rows[int(k)] for k in np.unique(np.rint(positions))]


def build_maps(
    diagnosis: Diagnosis, simulated_trials: Sequence[SimulatedTrial]
) -> Iterator[tuple[str, list[tuple[str, Heatmap]]]]:
    """Yield for each channel its title and its maps (name, map): before and, if effects were added, after."""
    all_rows = build_rows(diagnosis, simulated_trials)
    cases = list(CASE_NAMES) if diagnosis.added_terms else ["before"]
    is_gait = all(isinstance(row.experiment, GaitExperiment) for row in all_rows)
    max_duration = max((row.experiment.duration for row in all_rows), default=1.0)
    edges = np.linspace(0.0, 100.0 if is_gait else max_duration, N_COLUMNS + 1)
    for channel, noise in diagnosis.noise.items():
        rows = [row for row in all_rows if channel in row.experiment.measured]
        if not rows:
            continue
        case_values = {
            case: np.array([_bin_residuals(row, case, channel, noise.std, edges, is_gait=is_gait) for row in rows])
            for case in cases
        }
        scale_max = compute_common_max(list(case_values.values()), MIN_SCALE_MAX_SD)
        names = tuple(map(_format_name, rows))
        x_label = "gait cycle [%]" if is_gait else "time in the trial [s]"
        yield (
            words.humanize_identifier(channel),
            [
                (
                    CASE_NAMES[case] if diagnosis.added_terms else "simulated",
                    Heatmap(
                        f"gap/{channel}/{case}",
                        x_label,
                        edges,
                        names,
                        values,
                        scale_max,
                        "sd of the noise; rows: fit, test (*)",
                    ),
                )
                for case, values in case_values.items()
            ],
        )


def _format_name(row: ResidualRow) -> str:
    """Return the name of the trial, shortened in its middle: repeats often differ at the end; a star marks trials that
    were not fitted."""
    name, n_last = row.experiment.name, MAX_NAME_LENGTH // 2
    short = name if len(name) <= MAX_NAME_LENGTH else f"{name[: MAX_NAME_LENGTH - n_last - 1]}…{name[-n_last:]}"
    return short if row.experiment.use == "fit" else f"{short} *"


def _bin_residuals(row: ResidualRow, case: str, channel: str, noise_sd: float, edges: Array, *, is_gait: bool) -> Array:
    experiment = row.experiment
    time = experiment.measured[channel].time - experiment.start_time
    position = time
    if is_gait and isinstance(experiment, GaitExperiment):
        position = 100.0 * (experiment.compute_stride_phase(time) % 1.0)
    residual = row.residuals[case][channel] / (noise_sd * experiment.noise_scale.get(channel, np.ones(len(time))))
    return compute_binned_rms(position, residual, edges)
