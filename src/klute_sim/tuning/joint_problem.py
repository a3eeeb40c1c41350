"""Tuning of the PID controller of a joint, and of the devices with it, over episodes with random targets.

The objective is the root mean square error of the angle [deg], plus 10 times the root mean square change of the actions
in 10 ms. Both weights are assumed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from importlib.metadata import version
from typing import Any

import numpy as np

from klute_sim.errors import InputError
from klute_sim.parameter_sweep.evaluate import CaseResult, MetricValue
from klute_sim.parameter_sweep.fingerprint import fingerprint_joint_software
from klute_sim.parameter_sweep.joint_metrics import CHANGE_COLUMN, ERROR_COLUMN
from klute_sim.parameter_sweep.joint_plan import JointCase
from klute_sim.parameters import Parameter
from klute_sim.tuning.design_variables import compute_violation
from klute_sim.tuning.gain_variables import GainSpace
from klute_sim.tuning.point_evaluation import INVALID_COST, PointEvaluation
from klute_sim.tuning.search import INITIAL_SIGMA
from klute_sim.types import Array

FINE_EPISODE_FACTOR = 2
"""Episodes of a reevaluation over those of the search: selected points may profit from their targets."""
JointMetrics = Mapping[str, MetricValue]
"""Metrics of a case by column."""


@dataclass(frozen=True, kw_only=True)
class JointWeights:
    """Weights of the terms of the objective; validated when made, and all assumed."""

    angle: float = 1.0
    """Weight of the error of the angle [1/deg]."""
    smoothness: float = 10.0
    """Weight of the change of the actions [1]."""

    def __post_init__(self) -> None:
        """Raise InputError when a weight is out of range or all are zero."""
        for name, value in asdict(self).items():
            if not 0.0 <= value <= 1e3:  # also refuses NaN
                raise InputError(f"weight of {name} is {value:g}; allowed: 0 to 1000")
        if not any(asdict(self).values()):
            raise InputError("all weights are 0; allowed: at least one above 0")


def make_joint_weights(values: Mapping[str, float]) -> JointWeights:
    """Return the default weights with ``values`` in place of some; raises InputError when a name is unknown."""
    names = [field.name for field in fields(JointWeights)]
    for name in values:
        if name not in names:
            raise InputError(f"there is no weight '{name}'; allowed: {', '.join(names)}")
    return JointWeights(**values)


@dataclass(frozen=True, kw_only=True)
class JointTuningProblem:
    """Design space, episodes and objective of a tuning."""

    space: GainSpace
    """Device, gains and design variables."""
    weights: JointWeights = field(default_factory=JointWeights)
    """Weights of the terms of the objective."""
    load_kg: float | None = None
    """Mass at the end of the lever [kg]; None: that of the model."""
    episodes: int = 8
    """Number of episodes of an evaluation, each with another target."""
    seconds: float = 5.0
    """Duration of an episode [s]."""
    seed: int = 0
    """Random seed of the search and of the first target."""

    def __post_init__(self) -> None:
        """Raise InputError when a value is out of range."""
        for case in self.build_cases(np.zeros(len(self.variables)), is_fine=True):
            case.build_options()

    @property
    def variables(self) -> tuple[Parameter, ...]:
        """Design variables."""
        return self.space.variables

    def build_cases(self, x: Array, *, is_fine: bool) -> Sequence[JointCase]:
        """Return the case at the normalized point ``x``; a fine one has more episodes."""
        device, gains = self.space.decode(x)
        return [
            JointCase(
                device_name=device.name,
                device=device,
                gains=gains,
                load_kg=self.load_kg,
                episodes=self.episodes * (FINE_EPISODE_FACTOR if is_fine else 1),
                seconds=self.seconds,
                seed=self.seed,
            )
        ]

    def make_evaluation(
        self, x: Array, results: Sequence[CaseResult] | None, generation: int
    ) -> PointEvaluation[JointMetrics]:
        """Return the evaluation of ``x`` from the result of its case; None: its numbers are not valid."""
        violation = compute_violation(self.variables, x)
        failure = "the numbers are not valid" if results is None else results[0].failure
        if results is None or failure is not None:
            return PointEvaluation(x, INVALID_COST + violation, None, failure, generation)
        metrics = results[0].metrics
        error, change = (float(metrics[column] or 0.0) for column in (ERROR_COLUMN, CHANGE_COLUMN))
        cost = self.weights.angle * error + self.weights.smoothness * change
        return PointEvaluation(x, cost + violation, metrics, generation=generation)

    def describe(self) -> dict[str, Any]:
        """Return the problem in JSON types; the budget is left out, because it may grow."""
        return {
            "rig": "joint",
            "device": self.space.device.content.decode("utf-8-sig"),
            "gains": dict(self.space.gains),
            "design_variables": [asdict(variable) for variable in self.variables],
            "weights": asdict(self.weights),
            "load_kg": self.load_kg,
            "episodes": self.episodes,
            "seconds": self.seconds,
            "seed": self.seed,
            "initial_sigma": INITIAL_SIGMA,
            "software": {**fingerprint_joint_software(), "cma": version("cma")},
        }
