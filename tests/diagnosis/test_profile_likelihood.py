"""Limits of profile likelihood: closed forms, bounds, jumps, coverage, and MINOS of iminuit."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import pytest
from scipy.optimize import brentq, least_squares
from scipy.stats import norm

from klute_sim.diagnosis.fitting.profile_likelihood import MAX_EVALUATIONS, ResidualFunction, find_profile_limits
from klute_sim.diagnosis.fitting.secant import Point

QUANTILE = float(norm.ppf(0.975))
Model = Callable[[np.ndarray], np.ndarray]


def measure_error(weights: np.ndarray) -> float:
    """Return the half width of the 95 % interval of a weighted sum of independent noise of standard deviation 1."""
    return QUANTILE * float(np.linalg.norm(weights))


def make_function(
    model: Model, lower: Sequence[float], upper: Sequence[float], counts: list[int] | None = None
) -> ResidualFunction:
    """Return ``model`` with a Jacobian from finite differences; ``counts`` receives the number of points evaluated."""

    def evaluate(points: Sequence[np.ndarray]) -> list[np.ndarray]:
        if counts is not None:
            counts.append(len(points))
        return [model(x) for x in points]

    def differentiate(x: np.ndarray) -> np.ndarray:
        return np.stack([(model(x + 1e-6 * e) - model(x - 1e-6 * e)) / 2e-6 for e in np.eye(len(x))], axis=1)

    return ResidualFunction(evaluate, differentiate, np.array(lower), np.array(upper))


def fit_model(function: ResidualFunction, start: Sequence[float]) -> Point:
    def compute(x: np.ndarray) -> np.ndarray:
        return function.evaluate([x])[0]

    x = least_squares(compute, np.array(start), bounds=(function.lower, function.upper), xtol=1e-12, ftol=1e-12).x
    return Point(x, compute(x), function.differentiate(x))


def draw_linear_problem(rng: np.random.Generator) -> Model:
    matrix, offset = rng.normal(size=(40, 4)), rng.normal(size=40)
    matrix[:, 1] = matrix[:, 0] + 0.05 * matrix[:, 1]  # strongly correlated
    return lambda x: matrix @ x + offset


def bend_valley(x: np.ndarray) -> np.ndarray:
    """Return residuals with their minimum along a parabola, after Rosenbrock."""
    return np.array([(x[0] - 1.0) / 0.3, (x[1] - x[0] ** 2) / 0.01])


def make_decay(amplitude: float = 1.0, rate: float = 1.0, noise: float = 0.3, seed: int | None = 0) -> Model:
    """Return the residuals of a noisy exponential decay, whose amplitude and rate compensate each other."""
    time = np.linspace(0.1, 3.0, 60)
    error = np.zeros(60) if seed is None else np.random.default_rng(seed).normal(size=60)
    values = amplitude * np.exp(-rate * time) / noise + error
    return lambda x: x[0] * np.exp(-x[1] * time) / noise - values


def test_linear_limits_are_exactly_those_of_the_jacobian() -> None:
    """Whatever the noise: here it has another variance in every residual and acts on pairs of them."""
    rng = np.random.default_rng(1)
    factor = rng.normal(size=(40, 20)) * np.exp(rng.normal(size=(40, 1)))
    counts: list[int] = []
    function = make_function(draw_linear_problem(rng), [-np.inf] * 4, [np.inf] * 4, counts)
    best = fit_model(function, np.zeros(4))
    counts.clear()

    def measure(weights: np.ndarray) -> float:
        return 2.2 * float(np.linalg.norm(weights @ factor))

    limits = find_profile_limits(function, best, measure, range(4))
    widths = [measure(row) for row in np.linalg.pinv(best.jacobian)]
    assert limits == [(width, width) for width in widths]
    assert counts == [8]  # one point on each side


def test_limits_of_samples_without_error_are_narrow() -> None:
    function = make_function(lambda x: np.array([x[0] + x[1], x[0] - x[1], x[0]]), [-9.0, -9.0], [9.0, 9.0])
    best = fit_model(function, [1.0, 1.0])
    limits = find_profile_limits(function, best, lambda weights: 0.0, [0, 1])
    assert np.array(limits) == pytest.approx(np.zeros((2, 2)), abs=1e-3)


def test_limits_follow_a_curved_valley() -> None:
    function = make_function(bend_valley, [-9.0, -9.0], [9.0, 99.0])
    best = fit_model(function, [0.9, 0.9])
    (first, second) = find_profile_limits(function, best, measure_error, [0, 1])
    reach = QUANTILE * 0.3
    assert first == pytest.approx((reach, reach), rel=0.01)
    assert second == pytest.approx((1.0 - (1.0 - reach) ** 2, (1.0 + reach) ** 2 - 1.0), rel=0.02)
    linear = measure_error(np.linalg.pinv(best.jacobian)[1])
    assert second[0] < 0.75 * linear
    assert second[1] > 1.25 * linear


def test_limits_agree_with_refits_at_each_value() -> None:
    model = make_decay()
    function = make_function(model, [0.0, 0.0], [20.0, 20.0])
    best = fit_model(function, [1.0, 1.0])

    def rise(index: int, value: float) -> float:
        def compute(other: np.ndarray) -> np.ndarray:
            return model(np.insert(other, index, value))

        return 2.0 * least_squares(compute, best.x[1 - index], bounds=(0.0, 20.0)).cost - best.chi2 - QUANTILE**2

    limits = find_profile_limits(function, best, measure_error, [0, 1])
    for index, (below, above) in enumerate(limits):
        rise_along = partial(rise, index)
        assert best.x[index] - below == pytest.approx(brentq(rise_along, 0.05, best.x[index]), rel=0.03)
        assert best.x[index] + above == pytest.approx(brentq(rise_along, best.x[index], 15.0), rel=0.03)


def test_limit_beyond_a_bound_is_at_the_bound_or_farther() -> None:
    """The other parameter stays within its bounds, too, and then holds the first one back."""
    function = make_function(lambda x: np.array([x[0] - 0.5, 3.0 * (x[1] - x[0])]), [0.0, -9.0], [9.0, 1.0])
    best = fit_model(function, [0.4, 0.4])
    (below, above), _ = find_profile_limits(function, best, measure_error, [0, 1])
    assert below >= best.x[0]
    value = brentq(lambda v: (v - 0.5) ** 2 + 9.0 * max(0.0, v - 1.0) ** 2 - QUANTILE**2, 0.5, 3.0)
    assert best.x[0] + above == pytest.approx(value, rel=0.03)
    assert above < 0.8 * QUANTILE


def test_limit_that_the_search_does_not_reach_is_at_the_bound() -> None:
    """The valley winds too much to be followed to its limit, 2.6, with few simulations; an end before it is false."""

    def wind(x: np.ndarray) -> np.ndarray:
        return np.array([0.6 * np.arcsinh(5.0 * x[0]), 100.0 * (x[1] - np.sin(10.0 * x[0]))])

    counts: list[int] = []
    function = make_function(wind, [-9.0, -9.0], [3.0, 9.0], counts)
    best = Point(np.zeros(2), np.zeros(2), function.differentiate(np.zeros(2)))
    counts.clear()
    ((below, above),) = find_profile_limits(function, best, measure_error, [0])
    assert (below, above) == (9.0, 3.0)
    assert sum(counts) < 3 * MAX_EVALUATIONS
    unbounded = function._replace(lower=np.array([-np.inf, -9.0]))
    ((below, above),) = find_profile_limits(unbounded, best, measure_error, [0])
    assert np.isfinite(below)
    assert above == 3.0


def test_limit_of_a_saturating_parameter_is_at_the_bound() -> None:
    """Residuals rise by 1.5 at most, below the threshold: no large value is excluded."""
    function = make_function(lambda x: np.array([1.5 * np.tanh(x[0] - 1.0)]), [0.0], [50.0])
    best = fit_model(function, [1.1])
    ((below, above),) = find_profile_limits(function, best, measure_error, [0])
    assert below >= best.x[0]
    assert best.x[0] + above >= 50.0


@pytest.mark.parametrize("height", [40.0, np.inf])
def test_limit_is_at_a_jump(height: float) -> None:
    """A simulation may also diverge beyond some value; its residuals are infinite."""

    def jump(x: np.ndarray) -> np.ndarray:
        return np.array([x[0], x[1] - x[0], height if x[0] > 1.2 else 0.0])

    function = make_function(jump, [-9.0, -9.0], [9.0, 9.0])
    best = Point(np.zeros(2), np.zeros(3), function.differentiate(np.zeros(2)))
    ((below, above),) = find_profile_limits(function, best, measure_error, [0])
    assert below == pytest.approx(QUANTILE)
    assert 1.2 <= above <= 1.2 * 1.06


@pytest.mark.slow
def test_profile_covers_where_the_jacobian_does_not() -> None:
    covered = np.zeros(2)
    for seed in range(300):
        function = make_function(make_decay(1.0, 5.0, 0.3, seed), [0.0, 0.0], [50.0, 50.0])
        best = fit_model(function, [1.0, 5.0])
        width = measure_error(np.linalg.pinv(best.jacobian)[0])
        ((below, above),) = find_profile_limits(function, best, measure_error, [0])
        covered += abs(best.x[0] - 1.0) <= width, best.x[0] - below <= 1.0 <= best.x[0] + above
    assert covered[0] / 300 < 0.90
    assert 0.93 <= covered[1] / 300 <= 0.97


MINOS_PROBLEMS: dict[str, tuple[Model, list[float], list[float], list[float]]] = {
    "linear": (draw_linear_problem(np.random.default_rng(1)), [-99.0] * 4, [99.0] * 4, [0.0] * 4),
    "valley": (bend_valley, [-9.0, -9.0], [9.0, 99.0], [0.9, 0.9]),
    "decay": (make_decay(), [0.0, 0.0], [20.0, 20.0], [1.0, 1.0]),
    "bound": (make_decay(0.1, 1.0, 0.1), [0.0, 0.5], [20.0, 2.0], [0.1, 1.0]),
}


@pytest.mark.extras
@pytest.mark.parametrize("name", MINOS_PROBLEMS)
def test_limits_are_those_of_minos(name: str) -> None:
    iminuit = pytest.importorskip("iminuit")
    model, lower, upper, start = MINOS_PROBLEMS[name]
    function = make_function(model, lower, upper)
    best = fit_model(function, start)
    limits = find_profile_limits(function, best, measure_error, range(len(start)))
    minuit = iminuit.Minuit(lambda x: float(model(x) @ model(x)), best.x)
    minuit.errordef, minuit.limits = iminuit.Minuit.LEAST_SQUARES, list(zip(lower, upper, strict=True))
    minuit.migrad()
    minuit.minos(cl=0.95)
    for index, (below, above) in enumerate(limits):
        error = minuit.merrors[index]
        for distance, reference, is_at_limit, bound in (
            (below, -error.lower, error.at_lower_limit, best.x[index] - lower[index]),
            (above, error.upper, error.at_upper_limit, upper[index] - best.x[index]),
        ):
            expected = bound if is_at_limit else reference
            assert min(distance, bound) == pytest.approx(expected, rel=0.03, abs=1e-3), (index, error)
