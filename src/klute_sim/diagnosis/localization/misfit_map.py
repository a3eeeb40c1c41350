"""Map of the misfit: how far each channel is off in each of a few conditions that are the same for all data.

:mod:`klute_sim.diagnosis.localization.misfit_regions` searches the one region that holds most of a misfit; this map
tells for every condition whether the simulation is right there.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.localization.misfit_regions import (
    MAX_STEADY_PRESSURE_RATE,
    compute_held_speed,
    sample_conditions,
)
from klute_sim.diagnosis.noise.misfit import Misfit, estimate_misfit
from klute_sim.diagnosis.noise.repeats import AlignedRepeats
from klute_sim.types import Array, Mask

N_PHASE_WINDOWS = 10
"""Number of windows of a stride."""
Labels = NDArray[np.str_]
"""Name of the condition of each sample, (samples,)."""


class MapCell(NamedTuple):
    """Misfit of one channel in one condition."""

    channel: str
    """Channel."""
    region: str
    """Condition."""
    misfit: Misfit
    """Misfit that all repeats share there."""


def map_misfit(data: WeightedData, fit: Fit) -> list[MapCell]:
    """Return the misfit of ``fit`` in each channel and condition of trials with repeats; empty without repeats.

    On a bench and in a mechanism the conditions are shortening, lengthening and held length, each at steady and at
    changing pressure; in gait they are tenths of the stride.
    """
    by_group = {e.group: e for e in data.experiments}
    held_speed = compute_held_speed(by_group.values())

    def label(repeats: AlignedRepeats) -> Labels:
        return label_samples(sample_conditions(by_group[repeats.group], repeats.time), held_speed)

    grids = {group: np.linspace(0.0, e.duration, len(e.command)) for group, e in by_group.items()}
    labels = [label_samples(sample_conditions(e, grids[group]), held_speed) for group, e in by_group.items()]
    return [
        MapCell(channel, str(region), misfit)
        for region in np.unique(np.concatenate(labels))
        for channel, misfit in estimate_misfit(
            data.experiments, fit.residuals, data.noise, partial(_select_region, label, region)
        ).items()
    ]


def label_samples(conditions: Mapping[str, Array], held_speed: float) -> Labels:
    """Return the condition of each sample, from its covariates; a speed [m/s] up to ``held_speed`` is none."""
    if "phase" in conditions:
        window = np.minimum((conditions["phase"] * N_PHASE_WINDOWS).astype(int), N_PHASE_WINDOWS - 1)
        percent = 100 // N_PHASE_WINDOWS
        names = [f"{k * percent} to {(k + 1) * percent} % of the stride" for k in range(N_PHASE_WINDOWS)]
        return np.asarray(np.array(names)[window])
    rate = conditions["pressure change"]
    pressure = np.where(rate > MAX_STEADY_PRESSURE_RATE, "pressure changes", "steady pressure")
    speed = conditions.get("speed", np.zeros_like(rate))
    motion = np.where(speed > held_speed, "lengthening, ", np.where(speed < -held_speed, "shortening, ", "held, "))
    return np.asarray(np.char.add(motion, pressure) if "speed" in conditions else pressure)


def _select_region(label: Callable[[AlignedRepeats], Labels], region: str, repeats: AlignedRepeats) -> Mask:
    return np.asarray(label(repeats) == region)
