"""Tests of the adaptation: the order of costs, the bounds, and an exact resume."""

from dataclasses import replace

import numpy as np
import pytest

from klute_sim.errors import InputError
from klute_sim.plant import callbacks
from klute_sim.walker.adaptation.objective import AdaptationProblem, evaluate
from klute_sim.walker.adaptation.search import SearchProgress, evaluate_in_threads, search
from klute_sim.walker.person.body import load_body
from klute_sim.walker.reflexes.gain_table import GAINS, INITIAL_STATE
from klute_sim.walker.reflexes.walker_file import load_walker
from klute_sim.walker.simulation.simulator import WalkSimulator

START = load_walker("intact-1").reflexes
PROBLEM = AdaptationProblem(body=load_body(), horizon=5.0)


def test_walking_costs_less_than_falling_and_falling_late_less_than_falling_early() -> None:
    simulator = WalkSimulator(PROBLEM.build_model(), PROBLEM.body)
    point = PROBLEM.encode(START)
    late, early = point.copy(), point.copy()
    late[[gain.name for gain in GAINS].index("trunk_angle")] = 0.2
    early[: len(GAINS)] = 0.0
    with callbacks.device_callbacks():
        walks, falls_late, falls_early = (evaluate(PROBLEM, simulator, x) for x in (point, late, early))
    assert walks.duration == pytest.approx(5.0, abs=0.01)
    assert walks.cost < 100.0
    assert walks.cost == pytest.approx(
        sum(getattr(PROBLEM.weights, name) * value for name, value in walks.terms.items())
    )
    assert falls_early.duration < falls_late.duration < 5.0
    assert falls_late.terms == falls_early.terms == {}
    assert 100.0 < falls_late.cost < falls_early.cost


def test_other_speed_costs_more() -> None:
    simulator = WalkSimulator(PROBLEM.build_model(), PROBLEM.body)
    point = PROBLEM.encode(START)
    with callbacks.device_callbacks():
        costs = [evaluate(replace(PROBLEM, speed=speed), simulator, point).cost for speed in (1.25, 1.6)]
    assert costs[1] > costs[0] + 5.0


def test_points_beyond_the_bounds_are_limited_and_penalized() -> None:
    point = PROBLEM.encode(START)
    outside = point.copy()
    outside[0] = GAINS[0].high + 10.0 * GAINS[0].width
    assert PROBLEM.decode(outside).left[0] == GAINS[0].high
    decoded = PROBLEM.decode(point)
    np.testing.assert_array_equal(decoded.left, START.left)
    np.testing.assert_array_equal(decoded.left, decoded.right)
    assert len(point) == len(GAINS) + len(INITIAL_STATE)


def test_search_resumes_exactly_from_stored_costs() -> None:
    problem = replace(PROBLEM, horizon=4.0)
    stored: list[float] = []

    def store(state: SearchProgress, costs: list[float]) -> None:
        stored.extend(costs)

    with evaluate_in_threads(problem) as evaluate_points:
        whole = search(problem, START, 8, evaluate_points, sigma=0.05, population=4, on_generation=store)
    assert len(stored) == whole.n_evaluations == 8
    resumed: list[float] = []
    with evaluate_in_threads(problem, 2) as evaluate_points:
        again = search(
            problem,
            START,
            8,
            evaluate_points,
            sigma=0.05,
            population=4,
            stored_costs=stored[:7],
            on_generation=lambda state, costs: resumed.extend(costs),
        )
    assert resumed == stored[4:]
    np.testing.assert_array_equal(again.best_point, whole.best_point)
    assert again.best.cost == whole.best.cost


def test_refusals_name_the_range() -> None:
    with pytest.raises(InputError, match="the search has 0 evaluations"):
        search(PROBLEM, START, 0, lambda points: [])
    with pytest.raises(InputError, match="target speed is 3; allowed"):
        replace(PROBLEM, speed=3.0)
    with pytest.raises(InputError, match="horizon is 3; allowed: 4 to 120 s"):
        replace(PROBLEM, horizon=3.0)
