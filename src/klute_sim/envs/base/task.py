"""What a task gives to its environments: the interval between actions, spaces, results, and scheduled commands.

Every quantity of a task is an array with one entry per simulation, so a single environment and a batch share its code.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import mujoco
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from klute_sim.types import Array, Mask

CONTROL_INTERVAL = 0.01
"""Interval between two actions [s]."""


@dataclass(frozen=True)
class BatchStep:
    """Result of one interval of all simulations."""

    reward: Array
    """Reward (n,)."""
    terminated: Mask
    """Whether the episode has failed (n,)."""
    truncated: Mask
    """Whether the episode has reached its end (n,)."""
    info: Mapping[str, Array]
    """Entries (n,) of ``info``."""
    info_masks: Mapping[str, Mask] = field(default_factory=dict)
    """Simulations that have an entry of ``info``, for the entries that not all have."""

    def get_first_info(self) -> dict[str, float]:
        """Return the ``info`` of the first simulation."""
        masks = self.info_masks
        return {name: float(values[0]) for name, values in self.info.items() if name not in masks or masks[name][0]}


class ScheduledTask(Protocol):
    """Task whose controls of a whole interval follow from the actions at its beginning."""

    model: mujoco.MjModel
    """MuJoCo model of all simulations."""
    states_type: type
    """Dataclass of the arrays that the task reads, named as in MuJoCo."""
    n_actions: int
    """Number of actions of one simulation."""
    observation_rows: Sequence[tuple[Any, ...]]
    """Name, unit, lowest and highest value of each observation."""
    max_episode_steps: int
    """Number of intervals of an episode."""
    varying_fields: Sequence[str]
    """Fields of the model that differ between episodes."""
    failure_address: int
    """Index of the state in ``act`` that is not finite after a device has failed."""

    @property
    def observations(self) -> NDArray[np.float32]:
        """Return a copy of the observations (n, number of observations)."""

    @property
    def step_recorder(self) -> Callable[[Mask, Array], None] | None:
        """Return what receives ``act`` (simulations in the mask, steps, na) after each step; None needs nothing."""

    def start_episode(
        self, index: int, model: mujoco.MjModel, data: mujoco.MjData, rng: np.random.Generator
    ) -> Mapping[str, float]:
        """Sample an episode of simulation ``index`` and set ``data`` to its beginning.

        Changes the :attr:`varying_fields` of ``model``; returns the sampled values by name and unit.
        """

    def reset(self, mask: Mask, states: Any) -> None:
        """Reset observation and accounting of the simulations in ``mask``."""

    def schedule_controls(self, actions: Array, mask: Mask) -> Array:
        """Return the controls (n in ``mask``, steps, nu) of the interval that begins with ``actions`` (n, actions)."""

    def evaluate(self, actions: Array, states: Any, mask: Mask) -> BatchStep:
        """Return the result of the interval that ends now; only the simulations in ``mask`` advance."""


def make_action_space(n_actions: int = 1) -> "spaces.Box[np.float32]":
    """Return the space of the actions of one simulation."""
    return spaces.Box(-1.0, 1.0, (n_actions,), np.float32)


def make_observation_space(rows: Sequence[tuple[Any, ...]]) -> "spaces.Box[np.float32]":
    """Return the space of observations with name, unit, lowest and highest value in ``rows``."""
    low, high = (np.array([row[k] for row in rows], dtype=np.float32) for k in (2, 3))
    return spaces.Box(low, high, dtype=np.float32)
