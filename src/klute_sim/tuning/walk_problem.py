"""Tuning of a state machine, and of the device with it, in predicted walks of several persons."""

import itertools
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from typing import Any

import numpy as np

from klute_sim.errors import InputError
from klute_sim.parameter_sweep.evaluate import CaseResult
from klute_sim.parameter_sweep.fingerprint import fingerprint_walk_software
from klute_sim.parameter_sweep.walk_plan import NO_PUSH, WalkCase
from klute_sim.parameters import Parameter
from klute_sim.tuning.design_variables import compute_violation
from klute_sim.tuning.machine_variables import MachineSpace
from klute_sim.tuning.point_evaluation import INVALID_COST, PointEvaluation
from klute_sim.tuning.search import INITIAL_SIGMA
from klute_sim.tuning.walk_objective import (
    WalkTuningMetrics,
    WalkWeights,
    compute_walk_cost,
    summarize_walks,
)
from klute_sim.types import Array
from klute_sim.walker.reflexes.walker_file import Walker

FINE_DURATION_FACTOR = 2.0
"""Duration of the walks of a reevaluation over that of the search: selected points may profit from a short walk."""


WalkEvaluation = PointEvaluation[WalkTuningMetrics]
"""Evaluated point; its metrics are means over the walks."""


@dataclass(frozen=True, kw_only=True)
class WalkTuningProblem:
    """Design space, persons and objective of a tuning."""

    space: MachineSpace
    """Device, state machine and design variables."""
    walkers: tuple[Walker, ...]
    """Persons who walk."""
    weights: WalkWeights = field(default_factory=WalkWeights)
    """Weights of the terms of the objective."""
    speed: float = 1.25
    """Target speed [m/s]."""
    seconds: float = 10.0
    """Duration of a walk of the search [s]."""
    unevenness_mm: float = 0.0
    """Largest height of the blocks on the ground [mm]."""
    pushes: tuple[tuple[float, float], ...] = (NO_PUSH,)
    """Impulse [N.s] and phase [%] of the pushes, each in walks of its own."""
    seed: int = 0
    """Random seed of the search and of the ground."""

    def __post_init__(self) -> None:
        """Raise InputError when a value is out of range or a walker does not fit."""
        if not self.walkers:
            raise InputError("there are no walkers; name at least one")
        if not 0.4 <= self.speed <= 2.5:
            raise InputError(f"speed is {self.speed:g}; allowed: 0.4 to 2.5 m/s")
        if not self.seconds >= 5.0:
            raise InputError(f"duration is {self.seconds:g}; allowed: 5 s or more, because the first 3 s do not count")
        for case in self.build_cases(np.zeros(len(self.variables)), is_fine=True):
            case.walker.check_legs(is_intact=False)
            case.build_options()

    @property
    def variables(self) -> tuple[Parameter, ...]:
        """Design variables."""
        return self.space.variables

    def build_cases(self, x: Array, *, is_fine: bool) -> Sequence[WalkCase]:
        """Return the walk of every person under every push at the normalized point ``x``; fine ones last longer."""
        device, machine = self.space.decode(x)
        return [
            WalkCase(
                device_name=device.name,
                device=device,
                controller_name="machine",
                controller=machine,
                walker=walker,
                unevenness_mm=self.unevenness_mm,
                push=push,
                seconds=self.seconds * (FINE_DURATION_FACTOR if is_fine else 1.0),
                seed=self.seed,
            )
            for walker, push in itertools.product(self.walkers, self.pushes)
        ]

    def make_evaluation(self, x: Array, results: Sequence[CaseResult] | None, generation: int) -> WalkEvaluation:
        """Return the evaluation of ``x`` from the ``results`` of its walks; None: its numbers are not valid."""
        violation = compute_violation(self.variables, x)
        if results is None:
            return WalkEvaluation(x, INVALID_COST + violation, None, "the numbers are not valid", generation)
        failures = [result.failure for result in results if result.failure is not None]
        if failures:
            return WalkEvaluation(x, INVALID_COST + violation, None, failures[0], generation)
        walks = [result.metrics for result in results]
        costs = [compute_walk_cost(metrics, self.weights, self.speed, self.seconds) for metrics in walks]
        return WalkEvaluation(x, sum(costs) / len(costs) + violation, summarize_walks(walks), generation=generation)

    def describe(self) -> dict[str, Any]:
        """Return the problem in JSON types; the budget is left out, because it may grow."""
        return {
            "rig": "walk",
            "device": self.space.device.content.decode("utf-8-sig"),
            "machine": self.space.machine.describe(),
            "design_variables": [asdict(variable) for variable in self.variables],
            "walkers": [{"name": walker.name, "sha256": walker.digest} for walker in self.walkers],
            "weights": asdict(self.weights),
            "speed_m_per_s": self.speed,
            "seconds": self.seconds,
            "unevenness_mm": self.unevenness_mm,
            "pushes": [list(push) for push in self.pushes],
            "seed": self.seed,
            "initial_sigma": INITIAL_SIGMA,
            "software": {**fingerprint_walk_software(), "cma": version("cma")},
        }
