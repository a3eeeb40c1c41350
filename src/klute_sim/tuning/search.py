"""Search the design space by CMA-ES; every evaluation is stored, so that an interrupted search can be resumed.

The algorithm is the covariance matrix adaptation evolution strategy of Hansen (2016, arXiv:1604.00772) from the
package ``cma``. It is deterministic for a given seed: a resumed search asks for the same points again, and the store
answers most of them.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol, TypeVar

import numpy as np

from klute_sim.errors import InputError, KluteSimError, MissingExtraError
from klute_sim.gait.rig.setup import build_gait_rig
from klute_sim.gait.subject import Subject
from klute_sim.parameter_sweep.evaluate import TRIPS_COLUMN, UNEXPECTED_ERROR_PREFIX, Case, CaseResult
from klute_sim.parameter_sweep.plan import GaitCase
from klute_sim.parameter_sweep.runner import Runner
from klute_sim.parameter_sweep.store import ResultStore
from klute_sim.parameters import Parameter
from klute_sim.tuning.design_variables import DesignSpace, compute_violation
from klute_sim.tuning.objective import (
    FALL_COST,
    Goals,
    TuningMetrics,
    Weights,
    compute_cost,
    compute_penalties,
    compute_tracking_error,
)
from klute_sim.tuning.subject import prepare_subject
from klute_sim.types import Array

INITIAL_SIGMA = 0.75
"""Initial standard deviation of the search, in the scales of the design variables."""
SEARCH_STRIDES, SEARCH_DT = 2, 1e-3
"""Strides and time step [s] of an evaluation; the metrics are those of the second stride."""
FINE_DT = 5e-4
"""Time step of a reevaluation [s]: selected points may profit from errors of a long time step."""
REEVALUATED_FRACTION, MAX_REEVALUATIONS = 0.1, 200
"""Best fraction of the evaluations from which points are reevaluated, and maximum number of reevaluations."""


class Evaluated(Protocol):
    """An evaluated point of a search."""

    @property
    def x(self) -> Array:
        """Normalized point, one coordinate per design variable."""

    @property
    def cost(self) -> float:
        """Value of the objective, with the violation of the bounds."""

    @property
    def metrics(self) -> Any:
        """Metrics of the simulations; None: one failed."""

    @property
    def failure(self) -> str | None:
        """Reason of the failure; None: the simulations succeeded."""

    @property
    def generation(self) -> int:
        """Generation of the search that proposed the point; 0: the initial point."""


E = TypeVar("E", bound=Evaluated)
E_co = TypeVar("E_co", bound=Evaluated, covariant=True)


class SearchProblem(Protocol[E_co]):
    """What a search optimizes; on the gait rig and in predicted walks."""

    @property
    def seed(self) -> int:
        """Random seed of the search."""

    @property
    def space(self) -> Any:
        """Device, controller and design variables."""

    @property
    def variables(self) -> tuple[Parameter, ...]:
        """Design variables."""

    def build_cases(self, x: Array, *, is_fine: bool) -> Sequence[Case]:
        """Return the simulations at the normalized point ``x``; ``is_fine`` asks for more exact ones.

        Raises InputError when the numbers at ``x`` do not make a valid device or controller.
        """

    def make_evaluation(self, x: Array, results: Sequence[CaseResult] | None, generation: int) -> E_co:
        """Return the evaluation of ``x`` from the ``results`` of its cases; None: there are no valid cases."""


@dataclass(frozen=True, kw_only=True)
class TuningProblem:
    """Design space, subject and objective of a tuning."""

    space: DesignSpace
    """Device, profile and design variables."""
    subject: Subject = field(default_factory=Subject)
    """Person who walks; standard deviations that the reference lacks are assumed."""
    weights: Weights = field(default_factory=Weights)
    """Weights of the terms of the objective."""
    goals: Goals = field(default_factory=Goals)
    """Metrics to reach in addition."""
    seed: int = 0
    """Random seed of the search."""

    def __post_init__(self) -> None:
        """Raise InputError when the gait rig does not take the subject or the device."""
        case = self.build_case(np.zeros(len(self.space.variables)))
        build_gait_rig(case.device, case.build_options(), SEARCH_DT)

    @property
    def variables(self) -> tuple[Parameter, ...]:
        """Design variables."""
        return self.space.variables

    @cached_property
    def _evaluated_subject(self) -> Subject:
        return prepare_subject(self.subject)

    @cached_property
    def human_moment_peak(self) -> float:
        """Peak ankle moment of the reference [N*m/kg]."""
        phase = np.arange(1000) / 1000.0
        return float(self.subject.reference("ankle_plantarflexor_moment_nm_per_kg", phase).max())

    def build_case(self, x: Array, strides: int = SEARCH_STRIDES, dt: float = SEARCH_DT) -> GaitCase:
        """Return the case at the normalized point ``x``; ``dt`` is the time step [s].

        Raises InputError when the numbers at ``x`` do not make a valid device.
        """
        device, profile = self.space.decode(x)
        return GaitCase(
            device_name=device.name,
            device=device,
            controller_name=profile.name,
            controller=profile,
            subject=self._evaluated_subject,
            strides=strides,
            dt=dt,
        )

    def build_cases(self, x: Array, *, is_fine: bool) -> Sequence[GaitCase]:
        """Return the case at the normalized point ``x``; ``is_fine`` asks for the time step FINE_DT."""
        return [self.build_case(x, dt=FINE_DT if is_fine else SEARCH_DT)]

    def make_evaluation(self, x: Array, results: Sequence[CaseResult] | None, generation: int) -> "Evaluation":
        """Return the evaluation of ``x`` from the result of its case; None: its numbers do not make a valid device."""
        violation = compute_violation(self.variables, x)
        if results is None:
            return Evaluation(x, FALL_COST + violation, None, "the numbers do not make a valid device", generation)
        (result,) = results
        if result.failure is not None:
            return Evaluation(x, FALL_COST + violation, None, result.failure, generation)
        metrics = select_metrics(result.metrics, self.human_moment_peak)
        cost = compute_cost(metrics, self.weights, self.goals) + violation
        return Evaluation(x, cost, metrics, generation=generation)


@dataclass(frozen=True)
class Evaluation:
    """One evaluated point of the design space."""

    x: Array
    """Normalized point, one coordinate per design variable."""
    cost: float
    """Value of the objective, with the violation of the bounds."""
    metrics: TuningMetrics | None
    """Metrics of the simulation; None: it failed."""
    failure: str | None = None
    """Reason of the failure; None: the simulation succeeded."""
    generation: int = 0
    """Generation of the search that proposed the point; 0: the initial point."""

    @property
    def tracking_error(self) -> float:
        """Squared distance to the reference with unit weights [sd2]; infinite after a failure."""
        return math.inf if self.metrics is None else compute_tracking_error(self.metrics, Weights())

    @property
    def has_penalty(self) -> bool:
        """Whether the simulation failed or the objective contains a penalty."""
        return self.metrics is None or any(term.cost > 0.0 for term in compute_penalties(self.metrics))


_COLUMN_OF_METRIC = {
    "moment_sd": "moment_distance [sd]",
    "angle_sd": "angle_distance [sd]",
    "power_sd": "power_distance [sd]",
    "air_g": "air_per_stride [g]",
    "moment_peak_ratio": "ankle_moment_peak [N*m/kg]",
    "power_w_per_kg": "ankle_power_peak [W/kg]",
    "work_j_per_kg": "ankle_work_net [J/kg]",
    "plantarflexion_deg": "ankle_plantarflexion [deg]",
    "muscle_ratio_max": "muscle_ratio_max [1]",
    "load_tracking_rms_bw": "grf_vertical_tracking_rms [1]",
    "loading_rate_bw_per_s": "loading_rate_max [1/s]",
    "braking_bw": "grf_forward_min [1]",
    "toe_clearance_mm": "toe_clearance [mm]",
}


def select_metrics(metrics: Mapping[str, Any], human_moment_peak: float) -> TuningMetrics:
    """Return the metrics of the objective among the ``metrics`` of a case, which are named by column.

    ``human_moment_peak`` is the peak moment of the reference [N*m/kg].

    Raises InputError when the simulation has none of them, as that of a passive foot.
    """
    values = {name: metrics[column] for name, column in _COLUMN_OF_METRIC.items()}
    missing = [_COLUMN_OF_METRIC[name] for name, value in values.items() if value is None]
    if missing:
        raise InputError(f"the objective needs {missing[0]}, which the simulation does not have")
    values["moment_peak_ratio"] /= human_moment_peak
    return TuningMetrics(**values, trips=bool(metrics[TRIPS_COLUMN]))


def optimize(
    problem: SearchProblem[E],
    budget: int,
    store: ResultStore,
    runner: Runner,
    progress: Callable[[int], None] = lambda n_done: None,
) -> list[E]:
    """Return all evaluations in order, the initial point first: ``budget`` of them, rounded up to a whole generation.

    A converged search restarts from the initial point with another seed, so that a larger budget is always used.
    ``progress`` receives the number of finished evaluations.

    Raises MissingExtraError without the package cma, KluteSimError when the initial point fails.
    """
    n_variables = len(problem.variables)
    strategy = _make_strategy(n_variables, problem.seed)
    evaluations = list(_evaluate_points(problem, [np.zeros(n_variables)], store, runner, progress))
    if evaluations[0].metrics is None:
        raise KluteSimError(f"the simulation of the initial device and controller fails: {evaluations[0].failure}")
    n_restarts = 0
    while len(evaluations) < budget:
        if strategy.stop():
            n_restarts += 1
            strategy = _make_strategy(n_variables, problem.seed + 1_000_003 * n_restarts)
        points = [np.asarray(point, dtype=np.float64) for point in strategy.ask()]
        n_done, generation = len(evaluations), evaluations[-1].generation + 1
        offspring = list(_evaluate_points(problem, points, store, runner, progress, n_done, generation))
        strategy.tell(points, [evaluation.cost for evaluation in offspring])
        evaluations += offspring
    return evaluations


def reevaluate(
    problem: SearchProblem[E],
    evaluations: Sequence[E],
    store: ResultStore,
    runner: Runner,
    progress: Callable[[int], None] = lambda n_done: None,
) -> list[E]:
    """Evaluate the initial point and some of the best points, evenly spaced by rank, by finer simulations.

    The initial point is the first evaluation returned.
    """
    ranked = sorted(
        (evaluation for evaluation in evaluations[1:] if evaluation.metrics is not None),
        key=lambda evaluation: evaluation.cost,
    )
    count = math.ceil(REEVALUATED_FRACTION * len(evaluations))
    ranks = np.unique(np.linspace(0, count - 1, min(count, MAX_REEVALUATIONS)).astype(int))
    points = [evaluations[0].x, *(ranked[rank].x for rank in ranks if rank < len(ranked))]
    return list(_evaluate_points(problem, points, store, runner, progress, len(evaluations), is_fine=True))


def select_best(evaluations: Sequence[E]) -> E:
    """Return the evaluation of least cost among those that did not fail; the initial point is one of them."""
    return min(
        (evaluation for evaluation in evaluations if evaluation.metrics is not None),
        key=lambda evaluation: evaluation.cost,
    )


def select_pareto_front(evaluations: Sequence[Evaluation]) -> list[Evaluation]:
    """Return the Pareto front of tracking error and air, by increasing air; failures and penalties are left out."""
    valid = [evaluation for evaluation in evaluations if not evaluation.has_penalty]
    front: list[Evaluation] = []
    for evaluation in sorted(
        valid, key=lambda item: (item.metrics.air_g if item.metrics else 0.0, item.tracking_error)
    ):
        if not front or evaluation.tracking_error < front[-1].tracking_error:
            front.append(evaluation)
    return front


def import_cma() -> Any:
    """Return the package cma; raises MissingExtraError when it is not installed."""
    try:
        import cma as package
    except ImportError:
        raise MissingExtraError("tuning", "tune") from None
    return package


def _make_strategy(n_variables: int, seed: int) -> Any:
    rng = np.random.default_rng(seed)
    # The strategy gets its own generator: the package would seed that of NumPy for the whole process.
    # At verbosity -10 it also ignores the signal file in the working folder.
    options = {"randn": lambda *shape: rng.standard_normal(shape), "seed": np.nan, "verbose": -10}
    return import_cma().CMAEvolutionStrategy(np.zeros(n_variables), INITIAL_SIGMA, options)


def _evaluate_points(
    problem: SearchProblem[E],
    points: Sequence[Array],
    store: ResultStore,
    runner: Runner,
    progress: Callable[[int], None],
    n_done: int = 0,
    generation: int = 0,
    *,
    is_fine: bool = False,
) -> Iterator[E]:
    """Yield the evaluation of each of ``points``, simulated now or taken from ``store``."""
    cases_of_point: list[Sequence[Case] | None] = []
    for x in points:
        try:
            cases_of_point.append(problem.build_cases(x, is_fine=is_fine))
        except InputError:  # such as a tendon that is too long for the shank; it costs as much as a failure
            cases_of_point.append(None)
    cases = [case for point_cases in cases_of_point for case in point_cases or ()]
    results = {case.key: result for case in cases if (result := store.get(case.key)) is not None}
    missing = {case.key: case for case in cases if case.key not in results}

    def on_result(case: Case, result: CaseResult | None) -> None:
        if result is None:
            raise KluteSimError(
                "the process of a simulation was killed in every attempt, probably for lack of memory: use fewer --jobs"
            )
        if result.failure is not None and result.failure.startswith(UNEXPECTED_ERROR_PREFIX):
            raise KluteSimError(f"internal error in a simulation ({result.failure}): please report it")
        store.put(case.key, result)
        results[case.key] = result
        progress(n_done + len(results) * len(points) // len(cases))

    if missing:
        runner(list(missing.values()), on_result)
    progress(n_done + len(points))
    for x, point_cases in zip(points, cases_of_point, strict=True):
        point_results = None if point_cases is None else [results[case.key] for case in point_cases]
        yield problem.make_evaluation(x, point_results, generation)
