"""The search: CMA-ES over the knobs, every walk kept, so that an interrupted one goes on where it was.

The strategy is the covariance matrix adaptation of Hansen (2016, arXiv:1604.00772), from the package ``cma``. It is
deterministic for a seed: going on means asking the same questions again, most of which are answered already.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from klute_sim.errors import InputError, KluteSimError, MissingExtraError
from klute_sim.gait.rig.setup import build_gait_rig
from klute_sim.parameter_sweep.evaluate import UNEXPECTED_ERROR_PREFIX, CaseResult
from klute_sim.parameter_sweep.plan import GaitCase
from klute_sim.parameter_sweep.runner import Runner
from klute_sim.parameter_sweep.store import ResultStore
from klute_sim.tuning.design_variables import DesignSpace, DesignVector
from klute_sim.tuning.objective import FALL_COST, Goals, TuningMetrics, Weights, compute_cost, compute_tracking_error

INITIAL_SIGMA = 0.75
"""First standard deviation of the search, in the knobs' own spreads."""
SEARCH_STRIDES, SEARCH_DT = 2, 1e-3
"""Of a walk that is tried; the second stride counts."""
FINE_DT = 5e-4
"""Of those that are walked again: long steps flatter what was chosen because of them."""
REEVALUATED_FRACTION, MAX_REEVALUATIONS = 0.1, 200
"""Share of what was tried, the best of it, that is walked again, and how many at most."""


@dataclass(frozen=True, kw_only=True)
class TuningProblem:
    """What is tuned, for whom, and what is wanted."""

    space: DesignSpace
    mass: float
    """Of the body [kg]."""
    weights: Weights = field(default_factory=Weights)
    goals: Goals = field(default_factory=Goals)
    seed: int = 0

    def __post_init__(self) -> None:
        """Raise InputError for a body or a device that the rig has no place for."""
        combination = self.build_case(np.zeros(len(self.space.variables)))
        build_gait_rig(combination.device, combination.build_options(), SEARCH_DT)

    def build_case(self, x: DesignVector, strides: int = SEARCH_STRIDES, dt: float = SEARCH_DT) -> GaitCase:
        """The walk with the knobs at ``places``; raises InputError for a device that cannot be."""
        device, profile = self.space.decode(x)
        return GaitCase(
            device_name=device.name,
            device=device,
            controller_name=profile.name,
            controller=profile,
            speed=None,
            slope_deg=0.0,
            mass=self.mass,
            strides=strides,
            dt=dt,
        )


@dataclass(frozen=True)
class Evaluation:
    """One set of places of the knobs, and what it is worth."""

    x: DesignVector
    cost: float
    metrics: TuningMetrics | None
    """None: it did not walk."""
    failure: str | None = None
    """Why it did not."""
    generation: int = 0
    """Round of the search that asked for it; 0: where it began."""

    @property
    def tracking_error(self) -> float:
        """Squared distances without weights [sd^2]; infinite if it did not walk."""
        return math.inf if self.metrics is None else compute_tracking_error(self.metrics, Weights())


def select_metrics(metrics: Mapping[str, Any]) -> TuningMetrics:
    """What the objective reads of a walk's ``outcomes`` (:data:`klute_sim.parameter_sweep.evaluate.HEADINGS`).

    Raises InputError for a reference that has no standard deviations to be near to.
    """
    values = {name: metrics[heading] for name, heading in _METRIC_COLUMN_OF.items()}
    missing = [_METRIC_COLUMN_OF[name] for name, value in values.items() if value is None]
    if missing:
        raise InputError(f"there is no {missing[0]} to tune for: the reference needs standard deviations")
    return TuningMetrics(**values, trips=bool(metrics["trips"]))


_METRIC_COLUMN_OF = {
    "moment_sd": "moment_distance [sd]",
    "angle_sd": "angle_distance [sd]",
    "power_sd": "power_distance [sd]",
    "air_g": "air_per_stride [g]",
    "power_w_per_kg": "ankle_power_peak [W/kg]",
    "work_j_per_kg": "ankle_work_net [J/kg]",
    "plantarflexion_deg": "ankle_plantarflexion [deg]",
    "longest_ratio": "muscle_ratio_max [1]",
    "load_bw": "grf_vertical_tracking_rms [1]",
    "clearance_mm": "toe_clearance [mm]",
}


def optimize(
    problem: TuningProblem,
    budget: int,
    store: ResultStore,
    runner: Runner,
    progress: Callable[[int], None] = lambda done: None,
) -> list[Evaluation]:
    """Everything that was tried, the start first, in order; ``budget`` walks, or a few more to finish a round.

    A strategy that has nothing left to find is begun anew where tuning began, from another seed, so that a larger
    budget is never in vain. ``progress`` is told how many are done. Raises MissingExtraError without the package cma.
    """
    count = len(problem.space.variables)
    strategy = _make_strategy(count, problem.seed)
    tried = list(_evaluate_points(problem, [np.zeros(count)], store, runner, progress, 0))
    if tried[0].metrics is None:
        raise KluteSimError(f"where tuning begins does not walk: {tried[0].failure}")
    restarts = 0
    while len(tried) < budget:
        if strategy.stop():
            restarts += 1
            strategy = _make_strategy(count, problem.seed + 1_000_003 * restarts)
        asked = [np.asarray(each, dtype=np.float64) for each in strategy.ask()]
        found = list(_evaluate_points(problem, asked, store, runner, progress, len(tried)))
        strategy.tell(asked, [each.cost for each in found])
        tried += [replace(each, generation=tried[-1].generation + 1) for each in found]
    return tried


def reevaluate(
    problem: TuningProblem,
    evaluations: Sequence[Evaluation],
    store: ResultStore,
    runner: Runner,
    progress: Callable[[int], None] = lambda done: None,
) -> list[Evaluation]:
    """The start and some of the best of ``tried``, evenly by rank, walked at :data:`FINE_STEP`; the start first."""
    ranked = sorted((each for each in evaluations[1:] if each.metrics is not None), key=lambda each: each.cost)
    count = math.ceil(REEVALUATED_FRACTION * len(evaluations))
    ranks = np.unique(np.linspace(0, count - 1, min(count, MAX_REEVALUATIONS)).astype(int))
    chosen = [evaluations[0].x, *(ranked[k].places for k in ranks if k < len(ranked))]
    return list(_evaluate_points(problem, chosen, store, runner, progress, len(evaluations), FINE_DT))


def select_best(evaluations: Sequence[Evaluation]) -> Evaluation:
    """The cheapest of those that walked; where tuning begins, one does."""
    return min((each for each in evaluations if each.metrics is not None), key=lambda each: each.cost)


def select_pareto_front(evaluations: Sequence[Evaluation]) -> list[Evaluation]:
    """Those that nothing beats in both tracking and air, from the least air on; without any that catch or fall."""
    walked = [each for each in evaluations if each.metrics is not None and not each.metrics.trips]
    found: list[Evaluation] = []
    for each in sorted(walked, key=lambda one: (one.metrics.air_g if one.metrics else 0.0, one.tracking_error)):
        if not found or each.tracking_error < found[-1].tracking_error:
            found.append(each)
    return found


def import_cma() -> Any:
    """The package; raises MissingExtraError without it."""
    try:
        import cma as package
    except ImportError:
        raise MissingExtraError("tuning", "tune") from None
    return package


def _make_strategy(n_variables: int, seed: int) -> Any:
    random = np.random.default_rng(seed)
    # With its own source of randomness: the package would seed NumPy's for the whole process.
    # From -10 on it takes no orders from a file in the working folder, either.
    options = {"randn": lambda *shape: random.standard_normal(shape), "seed": np.nan, "verbose": -10}
    return import_cma().CMAEvolutionStrategy(np.zeros(n_variables), INITIAL_SIGMA, options)


def _evaluate_points(
    problem: TuningProblem,
    points: Sequence[DesignVector],
    store: ResultStore,
    runner: Runner,
    progress: Callable[[int], None],
    n_done: int,
    dt: float = SEARCH_DT,
) -> Iterator[Evaluation]:
    """``asked`` walked, by now or before."""
    combinations: list[GaitCase | None] = []
    for places in points:
        try:
            combinations.append(problem.build_case(places, dt=dt))
        except InputError:  # a tendon that is too long for the shank, say: it cannot be walked, and is worth as much
            combinations.append(None)
    known = {c.key: found for c in combinations if c is not None and (found := store.get(c.key)) is not None}
    missing = {c.key: c for c in combinations if c is not None and c.key not in known}

    def finished(combination: GaitCase, walked: CaseResult | None) -> None:
        if walked is None:
            raise KluteSimError("a walk's process was killed again and again: there may be too little memory")
        store.put(combination.key, walked)
        known[combination.key] = walked
        progress(n_done + len(known))

    if missing:
        runner(list(missing.values()), finished)
    progress(n_done + len(points))
    for places, combination in zip(points, combinations, strict=True):
        walked = None if combination is None else known[combination.key]
        yield _make_evaluation(problem, places, walked)


def _make_evaluation(problem: TuningProblem, x: DesignVector, result: CaseResult | None) -> Evaluation:
    beyond = problem.space.compute_violation(x)
    if result is None:
        return Evaluation(x, FALL_COST + beyond, None, "there is no such device")
    if result.failure is not None:
        if result.failure.startswith(UNEXPECTED_ERROR_PREFIX):
            raise KluteSimError(f"a walk met a mistake of ours ({result.failure}): please report it")
        return Evaluation(x, FALL_COST + beyond, None, result.failure)
    found = select_metrics(result.metrics)
    return Evaluation(x, compute_cost(found, problem.weights, problem.goals) + beyond, found)
