"""Condition to which a walker adapts, and the objective: what a walk costs."""

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from klute_sim.constants import GRAVITY
from klute_sim.controllers.parse import Controller
from klute_sim.errors import InputError
from klute_sim.types import Array
from klute_sim.walker.person.body import Body
from klute_sim.walker.person.build import Ground, Prosthesis, build_walker_model
from klute_sim.walker.reflexes.gain_table import GAINS, INITIAL_STATE, Reflexes, SearchedNumber
from klute_sim.walker.simulation import state as layout
from klute_sim.walker.simulation.commands import DeviceCommands
from klute_sim.walker.simulation.simulator import WalkSimulator
from klute_sim.walker.simulation.walk import Push, Walk

HORIZON = 18.0
"""Duration of an evaluation [s]."""
TRANSIENT = 3.0
"""Time from the start that does not count [s]."""
UNEVEN_FROM = 12.0
"""Distance from which the ground of an evaluation is uneven [m]."""
UNEVENNESS = 0.01
"""Largest height of its blocks [m]."""
PUSHES = (Push(impulse=10.0, phase=0.3, after=4.5), Push(impulse=-10.0, phase=0.8, after=7.5))
"""Pushes in an evaluation."""
MIN_SPEED = 0.5
"""Mean speed [m/s] below which a walker counts as standing, which is a fall."""
N_CHECKS = 3
"""Number of times at which that speed is checked."""
SPEED_TOLERANCE = 0.02
"""Deviation from the target speed that costs nothing [m/s]."""
MAX_COST = 1e6
"""Cost of a walk that is not finite."""


@dataclass(frozen=True, kw_only=True)
class ObjectiveWeights:
    """Weights of the terms of the objective; all are assumed."""

    speed: float = 30.0
    """Weight of the deviation from the target speed [s/m]."""
    metabolic: float = 1.0
    """Weight of the metabolic cost after Minetti and Alexander [kg*m/J]."""
    squared_activation: float = 3.0
    """Weight of the mean sum of squared activations."""
    overload: float = 400.0
    """Weight of the mean squared load above :data:`~klute_sim.walker.simulation.stepping.OVERLOAD_BW` [1/BW^2]."""
    knee_stop: float = 200.0
    """Weight of the mean angle of a knee beyond the onset of its stop [1/rad]."""
    swing_dorsiflexion: float = 30.0
    """Weight of the mean dorsiflexion beyond that of people in swing [1/rad]."""
    trunk_lean: float = 20.0
    """Weight of the mean inclination of the trunk beyond that of people [1/rad]."""
    bounds: float = 0.02
    """Weight of the squared violation of the bounds, in widths."""


@dataclass(frozen=True, kw_only=True)
class AdaptationProblem:
    """Condition to which a walker adapts."""

    body: Body
    """Body of the walker."""
    prosthesis: Prosthesis | None = None
    """Prosthesis; None: two legs of flesh, with equal gains."""
    controller: Controller | None = None
    """Controller of the device; None: the prosthesis has no device."""
    speed: float = 1.25
    """Target speed [m/s]."""
    horizon: float = HORIZON
    """Duration of an evaluation [s]."""
    weights: ObjectiveWeights = ObjectiveWeights()
    """Weights of the objective."""
    seed: int = 0
    """Random seed of the search and of the ground."""

    def __post_init__(self) -> None:
        """Raise InputError when the speed or the horizon is out of range."""
        if not 0.8 <= self.speed <= 1.8:
            raise InputError(f"target speed is {self.speed:g}; allowed: 0.8 to 1.8 m/s")
        if not TRANSIENT + 1.0 <= self.horizon <= 120.0:
            raise InputError(f"horizon is {self.horizon:g}; allowed: {TRANSIENT + 1.0:g} to 120 s")

    @property
    def numbers(self) -> tuple[SearchedNumber, ...]:
        """Numbers that the search changes, in the order of a point."""
        legs = GAINS if self.prosthesis is None else GAINS + GAINS
        return legs + INITIAL_STATE

    def build_model(self) -> mujoco.MjModel:
        """Return the model of an evaluation: level ground first, then blocks."""
        ground = Ground(unevenness=UNEVENNESS, uneven_from=UNEVEN_FROM, seed=self.seed)
        return build_walker_model(self.body, self.prosthesis, ground=ground)

    def encode(self, reflexes: Reflexes) -> Array:
        """Return the point of ``reflexes`` in the units of the numbers."""
        legs = [reflexes.left] if self.prosthesis is None else [reflexes.left, reflexes.right]
        return np.concatenate([*legs, reflexes.initial])

    def decode(self, point: Array) -> Reflexes:
        """Return the reflexes at ``point``, limited to the bounds."""
        low, high = (np.array([getattr(number, name) for number in self.numbers]) for name in ("low", "high"))
        values, n = np.clip(point, low, high), len(GAINS)
        right = values[:n] if self.prosthesis is None else values[n : 2 * n]
        return Reflexes(values[:n].copy(), right.copy(), values[-len(INITIAL_STATE) :].copy())


@dataclass(frozen=True)
class WalkEvaluation:
    """Cost of a point and what it consists of."""

    cost: float
    """Value of the objective."""
    duration: float
    """Time walked [s]."""
    speed: float
    """Mean speed after the transient [m/s]."""
    terms: dict[str, float]
    """Terms of the objective before the weights; empty after a fall."""


def evaluate(problem: AdaptationProblem, simulator: WalkSimulator, point: Array) -> WalkEvaluation:
    """Return the evaluation of ``point``, walked by ``simulator``; call inside ``device_callbacks``."""
    reflexes = problem.decode(point)
    simulator.reset(reflexes)
    state, horizon = simulator.state, problem.horizon
    commands = DeviceCommands(simulator, problem.controller, round(horizon / simulator.settings.dt) + 1)
    walk = Walk(simulator, commands, PUSHES)
    begin, x_begin = state.copy(), 0.0
    is_walking = walk.advance(TRANSIENT)
    if is_walking:
        begin, x_begin = state.copy(), float(simulator.data.qpos[0])
        for _ in range(N_CHECKS):
            is_walking = is_walking and walk.advance((horizon - TRANSIENT) / N_CHECKS)
            is_walking = is_walking and simulator.data.qpos[0] > MIN_SPEED * simulator.time
    widths = np.array([number.width for number in problem.numbers])
    violation = float(np.sum(((point - problem.encode(reflexes)) / widths) ** 2))
    penalty = problem.weights.bounds * violation
    time, x = simulator.time, float(simulator.data.qpos[0])
    if not is_walking:
        # A fall costs more than any walk, and less the longer and the farther it comes.
        done = 0.7 * time / horizon + 0.3 * min(max(x, 0.0), 1.4 * time) / (1.4 * horizon)
        cost = 100.0 + 400.0 * (1.0 - done) + penalty
        return WalkEvaluation(cost if math.isfinite(cost) else MAX_COST, time, x / max(time, 1e-3), {})
    duration, distance = time - TRANSIENT, x - x_begin
    terms = compute_terms(state - begin, duration, distance, simulator.settings.body_weight / GRAVITY, problem.speed)
    cost = sum(getattr(problem.weights, name) * value for name, value in terms.items()) + penalty
    return WalkEvaluation(cost if math.isfinite(cost) else MAX_COST, time, distance / duration, terms)


def compute_terms(sums: Array, duration: float, distance: float, mass: float, speed: float) -> dict[str, float]:
    """Return the terms of the objective from the ``sums`` of a state over ``duration`` [s] and ``distance`` [m]."""
    return {
        "speed": max(0.0, abs(distance / duration - speed) - SPEED_TOLERANCE),
        "metabolic": float(sums[layout.METABOLIC_MINETTI]) / (mass * distance),
        "squared_activation": float(sums[layout.SQUARED_ACTIVATION]) / duration,
        "overload": float(sums[layout.OVERLOAD]) / duration,
        "knee_stop": float(sums[layout.KNEE_STOP]) / duration,
        "swing_dorsiflexion": float(sums[layout.SWING_DORSIFLEXION]) / duration,
        "trunk_lean": float(sums[layout.TRUNK_LEAN]) / duration,
    }
