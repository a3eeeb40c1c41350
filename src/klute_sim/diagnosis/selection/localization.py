"""Where the simulation is off: in which channel, and under which circumstances."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS, Array, Experiment
from klute_sim.diagnosis.experiments.data_quality import has_repeats
from klute_sim.diagnosis.fitting.least_squares import Fit, WeightedData
from klute_sim.diagnosis.noise.repeats import align_repeats
from klute_sim.units import BAR

Mask = NDArray[np.bool_]

MIN_CONTRAST = 0.2
"""Share of the misfit less share of the samples, from which a region is worth naming."""
MAX_STEADY_PRESSURE_RATE = 0.05e5
"""Change of the pressure command that is none [Pa/s]."""
SPLIT_QUANTILES = (0.25, 0.5, 0.75)
"""Quantiles at which a circumstance may be cut in two."""
PHASE_WINDOW_WIDTHS = (0.08, 0.12, 0.2, 0.3, 0.4)
"""Shares of a stride that a part of it may be, beginning at any multiple of :data:`GRAIN`."""
PHASE_WINDOW_SPACING = 0.02


class MisfitRegion(NamedTuple):
    """A share of the gap."""

    channel: str
    fraction: float
    """Of all channels' squared misfit in units of their noise, what is in the region."""
    region: str
    """Where in the channel most of it is; '' if everywhere alike."""
    concentration: float
    """Mean square inside of the region over the mean square everywhere."""


def locate_misfit(data: WeightedData, base_fit: Fit) -> list[MisfitRegion]:
    """Channels by their share of what all repeats show, largest first."""
    found, sizes = [], {}
    least = 2 if has_repeats(data.experiments) else 1
    by_group = {e.group: e for e in data.experiments}
    for channel, noise in data.noise.items():
        squares, circumstances = [], []
        for group, clock, stack in align_repeats(data.experiments, base_fit.residuals, channel, min_repeats=least):
            # Repeats' mean, less what noise leaves in it.
            mean, count = stack.mean(axis=0), len(stack)
            squares.append(mean * mean - (noise.std**2 / count if count > 1 else 0.0))
            circumstances.append(_sample_conditions(by_group[group], clock))
        if not squares:
            continue
        square = np.concatenate(squares)
        joined = {name: np.concatenate([c[name] for c in circumstances]) for name in circumstances[0]}
        sizes[channel] = max(0.0, float(square.mean())) / noise.std**2
        region, inside, concentration = _find_region(square, joined)
        found.append(MisfitRegion(channel, inside, region, concentration))
    whole = sum(sizes.values()) or 1.0
    return sorted(
        (p._replace(fraction=p.fraction * sizes[p.channel] / whole) for p in found), key=lambda p: -p.fraction
    )


def _sample_conditions(experiment: Experiment, time: Array) -> dict[str, Array]:
    """What may matter, at times of the ``clock`` that repeats share."""
    grid = np.linspace(0.0, experiment.duration, len(experiment.command))
    then = experiment.align_time(grid)
    return {name: np.interp(time, then, values) for name, values in experiment.compute_covariates().items()}


def _find_region(squared_misfit: Array, conditions: dict[str, Array]) -> tuple[str, float, float]:
    """The one or two cuts that hold the most of ``square`` in the least of the samples.

    With the share of ``square`` that they hold, and its mean there over its mean everywhere.
    """
    chosen: list[str] = []
    inside: Mask = np.ones(len(squared_misfit), dtype=np.bool_)
    for _ in range(2):
        best = max(_list_splits(squared_misfit, inside, conditions), default=None, key=lambda cut: cut[0])
        if best is None or best[0] < MIN_CONTRAST:
            break
        chosen.append(best[1])
        inside = best[2]
        if "stride" in best[1]:
            conditions = {name: values for name, values in conditions.items() if name != "phase"}
    whole = float(squared_misfit.sum())
    if not whole > 0.0:
        return "", 1.0, 1.0
    share = float(squared_misfit[inside].sum()) / whole
    return ", ".join(chosen), min(1.0, share), share / float(inside.mean())


def _list_splits(squared_misfit: Array, selected: Mask, conditions: dict[str, Array]) -> list[tuple[float, str, Mask]]:
    whole, count = float(squared_misfit[selected].sum()), int(selected.sum())
    found: list[tuple[float, str, Mask]] = []
    if not whole > 0.0:
        return found
    for name, values in conditions.items():
        if name == "phase":
            found += _list_phase_windows(squared_misfit, selected, values)
            continue
        edges = [0.0] if name == "speed" else [float(np.quantile(values[selected], q)) for q in SPLIT_QUANTILES]
        for edge in edges:
            for part, word in ((values > edge, "above"), (values <= edge, "below")):
                both = selected & part
                if both.sum() < 0.1 * len(squared_misfit):
                    continue
                # More of the misfit than of the samples is in there.
                contrast = float(squared_misfit[both].sum()) / whole - both.sum() / count
                found.append((contrast, _describe_split(name, word, edge), both))
    return found


def _list_phase_windows(squared_misfit: Array, selected: Mask, phase: Array) -> list[tuple[float, str, Mask]]:
    """Parts of the stride, which may go on beyond the next foot strike."""
    whole, count, found = float(squared_misfit[selected].sum()), int(selected.sum()), []
    for begin in np.arange(0.0, 1.0, PHASE_WINDOW_SPACING):
        for width in PHASE_WINDOW_WIDTHS:
            both = selected & ((phase - begin) % 1.0 < width)
            if both.sum() < 0.05 * len(squared_misfit):
                continue
            contrast = float(squared_misfit[both].sum()) / whole - both.sum() / count
            words = f"at {100.0 * begin:.0f}-{100.0 * ((begin + width) % 1.0) or 100.0:.0f} % of the stride"
            found.append((contrast, words, both))
    return found


def _describe_split(name: str, side: str, threshold: float) -> str:
    if name == "speed":
        return "lengthening" if side == "above" else "shortening"
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
