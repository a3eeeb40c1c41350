"""Adapt the reflexes of a walker: a CMA-ES search whose costs can be stored.

The search of Hansen (2016, arXiv:1604.00772) is deterministic for a seed and the costs that it is told, so a stored
list of costs resumes it exactly. Evaluations of one generation are independent; they run in threads or on a Ray
cluster, with equal results.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from klute_sim.errors import InputError, MissingExtraError
from klute_sim.plant import callbacks
from klute_sim.types import Array
from klute_sim.walker.adaptation.objective import AdaptationProblem, WalkEvaluation, evaluate
from klute_sim.walker.reflexes.gain_table import Reflexes
from klute_sim.walker.simulation.simulator import WalkSimulator

POPULATION = 16
"""Number of evaluations in a generation."""

EvaluatePoints = Callable[[Sequence[Array]], list[WalkEvaluation]]
"""Evaluates the points of a generation."""


@dataclass
class SearchProgress:
    """State of a search after a generation."""

    n_evaluations: int
    """Number of finished evaluations."""
    best_point: Array
    """Point of least cost."""
    best: WalkEvaluation
    """Its evaluation."""


class PointEvaluator:
    """Evaluates points of a problem one after the other with one simulator."""

    def __init__(self, problem: AdaptationProblem) -> None:
        """Build the model of ``problem``."""
        self._problem = problem
        with callbacks.device_callbacks() as backend:
            self._simulator = WalkSimulator(problem.build_model(), problem.body, backend=backend)

    def evaluate(self, point: Array) -> WalkEvaluation:
        """Return the evaluation of ``point``."""
        with callbacks.device_callbacks():
            return evaluate(self._problem, self._simulator, point)


@contextmanager
def evaluate_in_threads(problem: AdaptationProblem, n_threads: int = 1) -> Iterator[EvaluatePoints]:
    """Yield a function that evaluates points in ``n_threads`` threads."""
    free = [PointEvaluator(problem) for _ in range(n_threads)]

    def run(point: Array) -> WalkEvaluation:
        evaluator = free.pop()
        try:
            return evaluator.evaluate(point)
        finally:
            free.append(evaluator)

    # The outer context keeps the callbacks in place between the walks.
    with ThreadPoolExecutor(n_threads) as pool, callbacks.device_callbacks():
        yield lambda points: list(pool.map(run, points))


def evaluate_on_cluster(problem: AdaptationProblem, ray: Any) -> EvaluatePoints:
    """Return a function that evaluates points on the cluster that ``ray`` is connected to.

    Each core of the cluster has one evaluator, but there are no more than points in a generation. Ray restarts those
    whose process or machine is lost.
    """
    from ray.util.actor_pool import ActorPool

    n = max(1, min(POPULATION, int(ray.cluster_resources().get("CPU", 1))))
    remote = ray.remote(num_cpus=1, max_restarts=-1, max_task_retries=-1)(PointEvaluator)
    pool = ActorPool([remote.remote(problem) for _ in range(n)])
    return lambda points: list(pool.map(lambda evaluator, point: evaluator.evaluate.remote(point), points))


def search(
    problem: AdaptationProblem,
    start: Reflexes,
    budget: int,
    evaluate_points: EvaluatePoints,
    *,
    sigma: float = 0.5,
    population: int = POPULATION,
    stored_costs: Sequence[float] = (),
    on_generation: Callable[[SearchProgress, list[float]], None] = lambda progress, costs: None,
) -> SearchProgress:
    """Search for ``budget`` evaluations from ``start``, rounded up to generations; return the best point.

    ``evaluate_points`` is that of :func:`evaluate_in_threads` or :func:`evaluate_on_cluster`. ``sigma`` is the initial
    standard deviation in the widths of the numbers, and ``population`` the size of a generation. ``stored_costs`` are
    the costs of the first evaluations of an earlier search with the same arguments; they are not computed again.
    ``on_generation`` receives the state of the search and the costs of each new generation.

    Raises MissingExtraError without the package cma.
    """
    if budget < 1 or not 0.0 < sigma <= 5.0:
        raise InputError(f"the search has {budget} evaluations and sigma {sigma:g}; allowed: 1 or more, above 0 to 5")
    x0, widths = problem.encode(start), np.array([number.width for number in problem.numbers])
    strategy = _make_strategy(len(x0), sigma, problem.seed, population)
    best_point, best_cost, best, n = x0, math.inf, None, 0
    while n < budget:
        offsets = [np.asarray(z, dtype=np.float64) for z in strategy.ask()]
        points = [x0 + widths * z for z in offsets]
        stored = [float(cost) for cost in stored_costs[n : n + len(points)]]
        if len(stored) == len(points):
            costs, evaluations = stored, None
        else:
            evaluations = evaluate_points(points)
            costs = [evaluation.cost for evaluation in evaluations]
        strategy.tell(offsets, costs)
        n += len(points)
        k = int(np.argmin(costs))
        if costs[k] < best_cost:
            best_cost, best_point = costs[k], points[k]
            best = None if evaluations is None else evaluations[k]
        if evaluations is not None:
            best = best or evaluate_points([best_point])[0]
            on_generation(SearchProgress(n, best_point, best), costs)
    return SearchProgress(n, best_point, best or evaluate_points([best_point])[0])


def import_cma() -> Any:
    """Return the package cma; raises MissingExtraError when it is not installed."""
    try:
        import cma as package
    except ImportError:
        raise MissingExtraError("walk adapt", "tune") from None
    return package


def _make_strategy(n: int, sigma: float, seed: int, population: int) -> Any:
    rng = np.random.default_rng(seed)
    # The strategy gets its own generator: the package would seed that of NumPy for the whole process.
    options = {
        "randn": lambda *shape: rng.standard_normal(shape),
        "seed": np.nan,
        "verbose": -10,
        "popsize": population,
    }
    return import_cma().CMAEvolutionStrategy(np.zeros(n), sigma, options)
