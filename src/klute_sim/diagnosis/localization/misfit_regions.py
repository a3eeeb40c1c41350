"""Localization of misfit: in which channels and under which conditions the simulation deviates."""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from klute_sim.diagnosis.data_quality import has_repeats
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS, Experiment
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.repeats import align_repeats
from klute_sim.types import Array, Mask
from klute_sim.units import BAR

MIN_CONTRAST = 0.2
"""Minimum fraction of the misfit minus fraction of the samples of a region."""
MAX_STEADY_PRESSURE_RATE = 0.05e5
"""Rate of the pressure command [Pa/s] below which the pressure counts as steady."""
MAX_HELD_SPEED_FRACTION = 0.02
"""Speed below which a length counts as held, as a fraction of the largest speed of all trials."""
SPLIT_QUANTILES = (0.25, 0.5, 0.75)
"""Quantiles of a condition at which the samples may be split."""
PHASE_WINDOW_WIDTHS = (0.08, 0.12, 0.2, 0.3, 0.4)
"""Widths of the phase windows of a stride [strides]."""
PHASE_WINDOW_SPACING = 0.02
"""Distance between the starts of phase windows [strides]."""
MIN_REGION_FRACTION, MIN_WINDOW_FRACTION = 0.1, 0.05
"""Minimum fraction of the samples in a region, and in a phase window."""


class MisfitRegion(NamedTuple):
    """Region of one channel that holds a part of the misfit."""

    channel: str
    """Channel."""
    fraction: float
    """Fraction of the squared misfit of all channels, in units of their noise, that is in the region."""
    region: str
    """Description of the region; '' for the whole channel."""
    concentration: float
    """Mean square in the region over the mean square of the channel."""


class _Split(NamedTuple):
    """One side of a split of the samples."""

    contrast: float
    """Fraction of the squared misfit minus fraction of the samples."""
    condition: str
    """Covariate and side, without the threshold; of successive splits with the same one, the last says all."""
    description: str
    samples: Mask


def locate_misfit(data: WeightedData, base_fit: Fit) -> list[MisfitRegion]:
    """Return the region of each channel with the misfit that all repeats share, largest fraction first."""
    regions, mean_squares = [], {}
    min_repeats = 2 if has_repeats(data.experiments) else 1
    by_group = {e.group: e for e in data.experiments}
    held_speed = compute_held_speed(by_group.values())
    for channel, noise in data.noise.items():
        squares, conditions = [], []
        aligned = align_repeats(
            data.experiments, base_fit.residuals, channel, min_repeats=min_repeats, with_input_error=True
        )
        for repeats in aligned:
            squares.append(_estimate_squared_misfit(repeats.residuals))
            conditions.append(sample_conditions(by_group[repeats.group], repeats.time))
        if not squares:
            continue
        squared_misfit = np.concatenate(squares)
        joined = _join_conditions(conditions)
        if "speed" in joined:
            joined["speed"] = np.where(np.abs(joined["speed"]) <= held_speed, 0.0, joined["speed"])
        mean_squares[channel] = max(0.0, float(squared_misfit.mean())) / noise.std**2
        region, fraction, concentration = _find_region(squared_misfit, joined)
        regions.append(MisfitRegion(channel, fraction, region, concentration))
    total = sum(mean_squares.values()) or 1.0
    scaled = (r._replace(fraction=r.fraction * mean_squares[r.channel] / total) for r in regions)
    return sorted(scaled, key=lambda r: -r.fraction)


def compute_held_speed(experiments: Iterable[Experiment]) -> float:
    """Return the largest speed [m/s] at which the length of ``experiments`` counts as held."""
    speeds = [np.abs(e.compute_covariates().get("speed", np.zeros(1))).max() for e in experiments]
    return MAX_HELD_SPEED_FRACTION * float(max(speeds, default=0.0))


def sample_conditions(experiment: Experiment, time: Array) -> dict[str, Array]:
    """Return the covariates of ``experiment`` at the common ``time`` [s] of its repeats."""
    grid = np.linspace(0.0, experiment.duration, len(experiment.command))
    aligned = experiment.align_time(grid)
    return {name: np.interp(time, aligned, values) for name, values in experiment.compute_covariates().items()}


def _estimate_squared_misfit(residuals: Array) -> Array:
    """Return the mean product of different repeats' ``residuals`` (repeats, samples), or the square of a single one.

    Noise is independent between repeats, so it cancels in the products, also where it is scaled down with a sample that
    counts less.
    """
    n_repeats, sum_of_squares = len(residuals), np.square(residuals).sum(axis=0)
    if n_repeats == 1:
        return np.asarray(sum_of_squares)
    return np.asarray((np.square(residuals.sum(axis=0)) - sum_of_squares) / (n_repeats * (n_repeats - 1.0)))


def _join_conditions(conditions: Sequence[Mapping[str, Array]]) -> dict[str, Array]:
    """Return the covariates of all groups, one after the other; NaN in groups that lack a covariate."""
    names = dict.fromkeys(name for row in conditions for name in row)
    unknown = [np.full(len(row["time"]), np.nan) for row in conditions]
    return {
        name: np.concatenate([row.get(name, nan) for row, nan in zip(conditions, unknown, strict=True)])
        for name in names
    }


def _find_region(squared_misfit: Array, conditions: dict[str, Array]) -> tuple[str, float, float]:
    """Return the region of up to two splits with the most misfit in the fewest samples.

    The values are its description, its fraction of the misfit, and its mean square over the mean square of all.
    """
    descriptions: dict[str, str] = {}
    selected: Mask = np.ones(len(squared_misfit), dtype=np.bool_)
    for _ in range(2):
        best = max(_list_splits(squared_misfit, selected, conditions), default=None, key=lambda split: split.contrast)
        if best is None or best.contrast < MIN_CONTRAST:
            break
        descriptions[best.condition] = best.description
        selected = best.samples
        if best.condition == "phase":
            conditions = {name: values for name, values in conditions.items() if name != "phase"}
    total = float(squared_misfit.sum())
    if not total > 0.0:
        return "", 1.0, 1.0
    fraction = float(squared_misfit[selected].sum()) / total
    return ", ".join(descriptions.values()), min(1.0, fraction), fraction / float(selected.mean())


def _list_splits(squared_misfit: Array, selected: Mask, conditions: dict[str, Array]) -> list[_Split]:
    """Return the splits of the ``selected`` samples.

    Samples whose covariate is NaN, that is unknown, belong to neither side of a split by it.
    """
    total, count = float(squared_misfit[selected].sum()), int(selected.sum())
    splits: list[_Split] = []
    if not total > 0.0:
        return splits
    for name, values in conditions.items():
        if name == "phase":
            splits += _list_phase_windows(squared_misfit, selected, values)
            continue
        for part, condition, description in _list_parts(name, values, selected):
            samples = selected & part
            if samples.sum() < MIN_REGION_FRACTION * len(squared_misfit):
                continue
            contrast = float(squared_misfit[samples].sum()) / total - samples.sum() / count
            splits.append(_Split(contrast, condition, description, samples))
    return splits


def _list_parts(name: str, values: Array, selected: Mask) -> list[tuple[Mask, str, str]]:
    """Return the parts into which a covariate splits the samples, their conditions and their descriptions.

    A speed [m/s] of 0 is a held length; another covariate splits at the quantiles of its ``selected`` values.
    """
    if name == "speed":
        directions = (values < 0.0, "shortening"), (values == 0.0, "held"), (values > 0.0, "lengthening")
        return [(part, direction, direction) for part, direction in directions]
    known = values[selected & np.isfinite(values)]
    parts = []
    for threshold in np.quantile(known, SPLIT_QUANTILES).tolist() if len(known) else []:
        for part, side in ((values > threshold, "above"), (values <= threshold, "below")):
            parts.append((part, f"{name} {side}", _describe_split(name, side, threshold)))
    return parts


def _list_phase_windows(squared_misfit: Array, selected: Mask, phase: Array) -> list[_Split]:
    """Return the phase windows of the ``selected`` samples; a window may include the next foot strike."""
    total, count, splits = float(squared_misfit[selected].sum()), int(selected.sum()), []
    for start in np.arange(0.0, 1.0, PHASE_WINDOW_SPACING):
        for width in PHASE_WINDOW_WIDTHS:
            samples = selected & ((phase - start) % 1.0 < width)
            if samples.sum() < MIN_WINDOW_FRACTION * len(squared_misfit):
                continue
            contrast = float(squared_misfit[samples].sum()) / total - samples.sum() / count
            description = f"at {100.0 * start:.0f}-{100.0 * ((start + width) % 1.0) or 100.0:.0f} % of the stride"
            splits.append(_Split(contrast, "phase", description, samples))
    return splits


def _describe_split(name: str, side: str, threshold: float) -> str:
    if name == "pressure change":
        if threshold < MAX_STEADY_PRESSURE_RATE:
            return "while the pressure changes" if side == "above" else "at steady pressure"
        return (
            f"where the pressure changes {'faster' if side == 'above' else 'slower'} than {threshold / BAR:.1f} bar/s"
        )
    if name == "pressure":
        return f"{side} {threshold / BAR:.1f} bar"
    if name == "length":
        return f"{side} {threshold / CHANNEL_UNITS['muscle_length'][1]:.0f} mm"
    return f"{'after' if side == 'above' else 'before'} {threshold:.1f} s"
