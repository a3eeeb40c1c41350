"""Adapt the reflexes of a walker: a CMA-ES search whose costs can be stored.

The search of Hansen (2016, arXiv:1604.00772) is deterministic for a seed and the costs that it is told, so a stored
list of costs resumes it exactly. Evaluations of one generation are independent and run in threads.
"""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
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


@dataclass
class SearchProgress:
    """State of a search after a generation."""

    n_evaluations: int
    """Number of finished evaluations."""
    best_point: Array
    """Point of least cost."""
    best: WalkEvaluation
    """Its evaluation."""


def search(
    problem: AdaptationProblem,
    start: Reflexes,
    budget: int,
    *,
    sigma: float = 0.5,
    population: int = POPULATION,
    stored_costs: Sequence[float] = (),
    n_jobs: int = 1,
    on_generation: Callable[[SearchProgress, list[float]], None] = lambda progress, costs: None,
) -> SearchProgress:
    """Search for ``budget`` evaluations from ``start``, rounded up to generations; return the best point.

    ``sigma`` is the initial standard deviation in the widths of the numbers, and ``population`` the size of a
    generation. ``stored_costs`` are the costs of the first evaluations of an earlier search with the same arguments;
    they are not computed again. ``on_generation`` receives the state of the search and the costs of each new
    generation.

    Raises MissingExtraError without the package cma.
    """
    if budget < 1 or not 0.0 < sigma <= 5.0:
        raise InputError(f"the search has {budget} evaluations and sigma {sigma:g}; allowed: 1 or more, above 0 to 5")
    x0, widths = problem.encode(start), np.array([number.width for number in problem.numbers])
    strategy = _make_strategy(len(x0), sigma, problem.seed, population)
    model = problem.build_model()
    with callbacks.device_callbacks() as backend:
        free = [WalkSimulator(model, problem.body, backend=backend) for _ in range(n_jobs)]

    def run(point: Array) -> WalkEvaluation:
        simulator = free.pop()
        try:
            with callbacks.device_callbacks():
                return evaluate(problem, simulator, point)
        finally:
            free.append(simulator)

    best_point, best_cost, best, n = x0, math.inf, None, 0
    with ThreadPoolExecutor(n_jobs) as pool, callbacks.device_callbacks():
        while n < budget:
            offsets = [np.asarray(z, dtype=np.float64) for z in strategy.ask()]
            points = [x0 + widths * z for z in offsets]
            stored = [float(cost) for cost in stored_costs[n : n + len(points)]]
            if len(stored) == len(points):
                costs, evaluations = stored, None
            else:
                evaluations = list(pool.map(run, points))
                costs = [evaluation.cost for evaluation in evaluations]
            strategy.tell(offsets, costs)
            n += len(points)
            k = int(np.argmin(costs))
            if costs[k] < best_cost:
                best_cost, best_point = costs[k], points[k]
                best = None if evaluations is None else evaluations[k]
            if evaluations is not None:
                best = best or run(best_point)
                on_generation(SearchProgress(n, best_point, best), costs)
        return SearchProgress(n, best_point, best or run(best_point))


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
