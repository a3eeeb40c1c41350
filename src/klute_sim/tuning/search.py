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
from klute_sim.rigs.gait.assembly import assemble
from klute_sim.sweep.plan import Combination
from klute_sim.sweep.runner import Runner
from klute_sim.sweep.store import Store
from klute_sim.sweep.walk import UNEXPECTED, Walked
from klute_sim.tuning.knobs import Point, Tunable
from klute_sim.tuning.objective import FALL, Goals, Tracked, Weights, cost, tracking

SPREAD = 0.75
"""First standard deviation of the search, in the knobs' own spreads."""
STRIDES, STEP = 2, 1e-3
"""Of a walk that is tried; the second stride counts."""
FINE_STEP = 5e-4
"""Of those that are walked again: long steps flatter what was chosen because of them."""
AGAIN, MOST_AGAIN = 0.1, 200
"""Share of what was tried, the best of it, that is walked again, and how many at most."""


@dataclass(frozen=True, kw_only=True)
class Question:
    """What is tuned, for whom, and what is wanted."""

    tunable: Tunable
    mass: float
    """Of the body [kg]."""
    weights: Weights = field(default_factory=Weights)
    goals: Goals = field(default_factory=Goals)
    seed: int = 0

    def __post_init__(self) -> None:
        """Raise InputError for a body or a device that the rig has no place for."""
        combination = self.combination(np.zeros(len(self.tunable.knobs)))
        assemble(combination.device, combination.options(), STEP)

    def combination(self, places: Point, strides: int = STRIDES, step: float = STEP) -> Combination:
        """The walk with the knobs at ``places``; raises InputError for a device that cannot be."""
        device, profile = self.tunable.made(places)
        return Combination(
            device_word=device.name,
            device=device,
            controller_word=profile.name,
            controller=profile,
            speed=None,
            slope_deg=0.0,
            mass=self.mass,
            strides=strides,
            step=step,
        )


@dataclass(frozen=True)
class Tried:
    """One set of places of the knobs, and what it is worth."""

    places: Point
    cost: float
    tracked: Tracked | None
    """None: it did not walk."""
    failure: str | None = None
    """Why it did not."""
    generation: int = 0
    """Round of the search that asked for it; 0: where it began."""

    @property
    def tracking(self) -> float:
        """Squared distances without weights [sd^2]; infinite if it did not walk."""
        return math.inf if self.tracked is None else tracking(self.tracked, Weights())


def tracked(outcomes: Mapping[str, Any]) -> Tracked:
    """What the objective reads of a walk's ``outcomes`` (:data:`klute_sim.sweep.walk.HEADINGS`).

    Raises InputError for a reference that has no standard deviations to be near to.
    """
    values = {name: outcomes[heading] for name, heading in _HEADINGS.items()}
    missing = [_HEADINGS[name] for name, value in values.items() if value is None]
    if missing:
        raise InputError(f"there is no {missing[0]} to tune for: the reference needs standard deviations")
    return Tracked(**values, catches=bool(outcomes["trips"]))


_HEADINGS = {
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


def search(
    question: Question,
    budget: int,
    store: Store,
    runner: Runner,
    progress: Callable[[int], None] = lambda done: None,
) -> list[Tried]:
    """Everything that was tried, the start first, in order; ``budget`` walks, or a few more to finish a round.

    A strategy that has nothing left to find is begun anew where tuning began, from another seed, so that a larger
    budget is never in vain. ``progress`` is told how many are done. Raises MissingExtraError without the package cma.
    """
    count = len(question.tunable.knobs)
    strategy = _strategy(count, question.seed)
    tried = list(_walked(question, [np.zeros(count)], store, runner, progress, 0))
    if tried[0].tracked is None:
        raise KluteSimError(f"where tuning begins does not walk: {tried[0].failure}")
    restarts = 0
    while len(tried) < budget:
        if strategy.stop():
            restarts += 1
            strategy = _strategy(count, question.seed + 1_000_003 * restarts)
        asked = [np.asarray(each, dtype=np.float64) for each in strategy.ask()]
        found = list(_walked(question, asked, store, runner, progress, len(tried)))
        strategy.tell(asked, [each.cost for each in found])
        tried += [replace(each, generation=tried[-1].generation + 1) for each in found]
    return tried


def again(
    question: Question,
    tried: Sequence[Tried],
    store: Store,
    runner: Runner,
    progress: Callable[[int], None] = lambda done: None,
) -> list[Tried]:
    """The start and some of the best of ``tried``, evenly by rank, walked at :data:`FINE_STEP`; the start first."""
    ranked = sorted((each for each in tried[1:] if each.tracked is not None), key=lambda each: each.cost)
    count = math.ceil(AGAIN * len(tried))
    ranks = np.unique(np.linspace(0, count - 1, min(count, MOST_AGAIN)).astype(int))
    chosen = [tried[0].places, *(ranked[k].places for k in ranks if k < len(ranked))]
    return list(_walked(question, chosen, store, runner, progress, len(tried), FINE_STEP))


def best(tried: Sequence[Tried]) -> Tried:
    """The cheapest of those that walked; where tuning begins, one does."""
    return min((each for each in tried if each.tracked is not None), key=lambda each: each.cost)


def front(tried: Sequence[Tried]) -> list[Tried]:
    """Those that nothing beats in both tracking and air, from the least air on; without any that catch or fall."""
    walked = [each for each in tried if each.tracked is not None and not each.tracked.catches]
    found: list[Tried] = []
    for each in sorted(walked, key=lambda one: (one.tracked.air_g if one.tracked else 0.0, one.tracking)):
        if not found or each.tracking < found[-1].tracking:
            found.append(each)
    return found


def cma() -> Any:
    """The package; raises MissingExtraError without it."""
    try:
        import cma as package
    except ImportError:
        raise MissingExtraError("tuning", "tune") from None
    return package


def _strategy(count: int, seed: int) -> Any:
    random = np.random.default_rng(seed)
    # With its own source of randomness: the package would seed NumPy's for the whole process.
    # From -10 on it takes no orders from a file in the working folder, either.
    options = {"randn": lambda *shape: random.standard_normal(shape), "seed": np.nan, "verbose": -10}
    return cma().CMAEvolutionStrategy(np.zeros(count), SPREAD, options)


def _walked(
    question: Question,
    asked: Sequence[Point],
    store: Store,
    runner: Runner,
    progress: Callable[[int], None],
    before: int,
    step: float = STEP,
) -> Iterator[Tried]:
    """``asked`` walked, by now or before."""
    combinations: list[Combination | None] = []
    for places in asked:
        try:
            combinations.append(question.combination(places, step=step))
        except InputError:  # a tendon that is too long for the shank, say: it cannot be walked, and is worth as much
            combinations.append(None)
    known = {c.key: found for c in combinations if c is not None and (found := store.get(c.key)) is not None}
    missing = {c.key: c for c in combinations if c is not None and c.key not in known}

    def finished(combination: Combination, walked: Walked | None) -> None:
        if walked is None:
            raise KluteSimError("a walk's process was killed again and again: there may be too little memory")
        store.put(combination.key, walked)
        known[combination.key] = walked
        progress(before + len(known))

    if missing:
        runner(list(missing.values()), finished)
    progress(before + len(asked))
    for places, combination in zip(asked, combinations, strict=True):
        walked = None if combination is None else known[combination.key]
        yield _judged(question, places, walked)


def _judged(question: Question, places: Point, walked: Walked | None) -> Tried:
    beyond = question.tunable.beyond(places)
    if walked is None:
        return Tried(places, FALL + beyond, None, "there is no such device")
    if walked.failure is not None:
        if walked.failure.startswith(UNEXPECTED):
            raise KluteSimError(f"a walk met a mistake of ours ({walked.failure}): please report it")
        return Tried(places, FALL + beyond, None, walked.failure)
    found = tracked(walked.outcomes)
    return Tried(places, cost(found, question.weights, question.goals) + beyond, found)
