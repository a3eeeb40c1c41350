"""The tuning objective of predicted walks: effort, speed, symmetry and falls of several persons.

The objective is the mean over the walks of

* the metabolic cost [J/kg/m], the mean of the laws of Minetti and Alexander and of Bhargava et al.,
* 10 per m/s by which the speed differs by more than 0.02 m/s from the target,
* 10 times the squared step asymmetry,

or, of a walk that ends in a fall, of 100 plus up to 100 the earlier it falls. All weights are assumed.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

from klute_sim.errors import InputError
from klute_sim.parameter_sweep.evaluate import MetricValue
from klute_sim.parameter_sweep.walk_metrics import FELL_COLUMN

SPEED_TOLERANCE = 0.02
"""Deviation from the target speed that costs nothing [m/s]."""
WALK_FALL_COST = 100.0
"""Cost of a walk that falls at its end; one that falls at once costs twice as much."""


@dataclass(frozen=True, kw_only=True)
class WalkWeights:
    """Weights of the terms of the objective; validated when made, and all assumed."""

    effort: float = 1.0
    """Weight of the metabolic cost [kg*m/J]."""
    speed: float = 10.0
    """Weight of the deviation from the target speed [s/m]."""
    symmetry: float = 10.0
    """Weight of the squared step asymmetry [1]."""

    def __post_init__(self) -> None:
        """Raise InputError when a weight is out of range or all are zero."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        for name, value in values.items():
            if not 0.0 <= value <= 1e3:  # also refuses NaN
                raise InputError(f"weight of {name} is {value:g}; allowed: 0 to 1000")
        if not any(values.values()):
            raise InputError("all weights are 0; allowed: at least one above 0")


def make_walk_weights(values: Mapping[str, float]) -> WalkWeights:
    """Return the default weights with ``values`` in place of some; raises InputError when a name is unknown."""
    names = [field.name for field in fields(WalkWeights)]
    for name in values:
        if name not in names:
            raise InputError(f"there is no weight '{name}'; allowed: {', '.join(names)}")
    return WalkWeights(**values)


@dataclass(frozen=True, kw_only=True)
class WalkTuningMetrics:
    """Means over the walks that did not fall, and how many they are."""

    n_walks: int
    """Number of walks."""
    n_falls: int
    """Number of walks that end in a fall."""
    cost_minetti: float | None
    """Metabolic cost after Minetti and Alexander [J/kg/m]."""
    cost_bhargava: float | None
    """Metabolic cost after Bhargava et al. [J/kg/m]."""
    speed: float | None
    """Speed [m/s]."""
    asymmetry: float | None
    """Size of the step asymmetry [1]."""
    peak_load_left: float | None
    """Peak load of the intact leg [body weights]."""
    device_work: float | None
    """Net work of the device per stride [J]."""


def compute_walk_cost(metrics: Mapping[str, MetricValue], weights: WalkWeights, speed: float, seconds: float) -> float:
    """Return the objective of one walk of ``seconds`` with the target ``speed`` [m/s]."""
    needed = (metrics["cost_minetti [J/kg/m]"], metrics["cost_bhargava [J/kg/m]"], metrics["step_asymmetry [1]"])
    if metrics[FELL_COLUMN] or any(value is None for value in needed):
        return WALK_FALL_COST * (2.0 - min(float(metrics["duration [s]"] or 0.0) / seconds, 1.0))
    minetti, bhargava, asymmetry = (float(value or 0.0) for value in needed)
    deviation = max(0.0, abs(float(metrics["speed [m/s]"] or 0.0) - speed) - SPEED_TOLERANCE)
    return weights.effort * 0.5 * (minetti + bhargava) + weights.speed * deviation + weights.symmetry * asymmetry**2


def summarize_walks(walks: Sequence[Mapping[str, MetricValue]]) -> WalkTuningMetrics:
    """Return the means over the ``walks`` that did not fall."""
    walked = [metrics for metrics in walks if not metrics[FELL_COLUMN]]

    def compute_mean(column: str) -> float | None:
        values = [abs(value) if "asymmetry" in column else value for value in _collect(walked, column)]
        return math.fsum(values) / len(values) if values else None

    return WalkTuningMetrics(
        n_walks=len(walks),
        n_falls=len(walks) - len(walked),
        cost_minetti=compute_mean("cost_minetti [J/kg/m]"),
        cost_bhargava=compute_mean("cost_bhargava [J/kg/m]"),
        speed=compute_mean("speed [m/s]"),
        asymmetry=compute_mean("step_asymmetry [1]"),
        peak_load_left=compute_mean("load_peak_left [1]"),
        device_work=compute_mean("device_work_net [J]"),
    )


def _collect(walks: Sequence[Mapping[str, MetricValue]], column: str) -> list[float]:
    return [float(value) for metrics in walks if (value := metrics[column]) is not None]
