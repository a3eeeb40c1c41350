"""Rules of Gymnasium for a single environment: order of calls, copies in mid-episode, threads, specification."""

from abc import ABC, abstractmethod
from copy import deepcopy
from dataclasses import replace
from enum import Enum
from typing import Any, Self

import gymnasium
import mujoco
import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from klute_sim.envs.base.errors import ClosedEnvError, ResetNeededError
from klute_sim.envs.base.task import CONTROL_INTERVAL
from klute_sim.envs.base.thread_guard import ThreadGuard
from klute_sim.envs.base.validation import validate_action, validate_reset_options, validate_seed
from klute_sim.rendering.frames import RENDER_MODES, VECTOR_RENDER_MODES, Frame, FrameSource, RenderOptions
from klute_sim.rendering.graphics_context import has_display
from klute_sim.types import Array

Observation = NDArray[np.float32]
SINGLE_MASK = np.ones(1, dtype=np.bool_)
"""Mask of the only simulation of a task."""
Step = tuple[Observation, float, bool, bool, dict[str, Any]]
"""Observation, reward, terminated, truncated and info."""


class EpisodeStatus(Enum):
    """Status of an environment; the value says what is missing for a step."""

    NEW = "the environment has no episode yet"
    RUNNING = ""
    ENDED = "the episode has ended"
    INTERRUPTED = "the last call was interrupted"
    CLOSED = "the environment is closed"


class DeviceEnv(gymnasium.Env[Observation, NDArray[np.float32]], ABC):
    """Environment whose subclass implements the start of an episode and one step.

    A copy (copy.copy, copy.deepcopy or pickle) continues in mid-episode exactly as the original does.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": list(RENDER_MODES),
        "render_fps": round(1.0 / CONTROL_INTERVAL),
    }

    def __init__(self, max_episode_steps: int, render_options: RenderOptions | None = None) -> None:
        """Set up an environment without an episode; ``max_episode_steps`` is the length of the longest.

        Without ``render_options`` it draws nothing. Without a display, ``metadata`` does not list the mode ``human``.
        """
        if not has_display():
            self.metadata = {**self.metadata, "render_modes": list(VECTOR_RENDER_MODES)}
        self._frame_source = FrameSource(render_options or RenderOptions())
        self.render_mode = self._frame_source.options.render_mode
        self.max_episode_steps = max_episode_steps
        """Number of steps after which every episode has been truncated."""
        self._thread_guard, self._status = ThreadGuard(), EpisodeStatus.NEW
        self._spec: EnvSpec | None = None

    @property
    def dt(self) -> float:
        """Return the interval between two actions [s]."""
        return CONTROL_INTERVAL

    @abstractmethod
    def _start_episode(self) -> tuple[Observation, dict[str, Any]]:
        """Start an episode with random numbers from ``self.np_random``; return observation and info."""

    @abstractmethod
    def _advance(self, action: Array) -> Step:
        """Hold the valid ``action`` for one interval."""

    @abstractmethod
    def _get_simulation(self) -> tuple[mujoco.MjModel, mujoco.MjData]:
        """Return model and state of the simulation of an episode."""

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode; there are no ``options``.

        Raises InvalidSeedError, InputError for any option, ClosedEnvError, and ConcurrentUseError.
        """
        with self._thread_guard:
            self._require_open()
            validate_reset_options(options)
            super().reset(seed=validate_seed(seed))
            self._status = EpisodeStatus.INTERRUPTED
            started = self._start_episode()
            self._status = EpisodeStatus.RUNNING
            self._show()
            return started

    def step(self, action: NDArray[np.float32]) -> Step:
        """Hold ``action`` for one interval.

        Raises InvalidActionError, ResetNeededError before a reset and after the end of the episode, ClosedEnvError, and
        ConcurrentUseError.
        """
        with self._thread_guard:
            self._require_open()
            if self._status is not EpisodeStatus.RUNNING:
                raise ResetNeededError(f"{self._status.value}: call reset() before step()")
            valid_action = validate_action(action, self.action_space.shape or ())
            self._status = EpisodeStatus.INTERRUPTED
            step = self._advance(valid_action)
            self._status = EpisodeStatus.ENDED if step[2] or step[3] else EpisodeStatus.RUNNING
            self._show()
            return step

    def render(self) -> Frame | None:
        """Return an image or distances; None without a render mode. The end of an episode can be drawn too.

        The mode ``human`` shows every step in a window by itself, and returns None.

        Raises ResetNeededError before the first reset, ClosedEnvError, and ConcurrentUseError.
        """
        with self._thread_guard:
            self._require_open()
            if self._status is EpisodeStatus.NEW:
                raise ResetNeededError(f"{self._status.value}: call reset() before render()")
            return self._frame_source.draw(*self._get_simulation())

    def close(self) -> None:
        """Release all resources; the environment cannot be used afterwards. Closing again does nothing."""
        with self._thread_guard:
            self._frame_source.close()
            self._status = EpisodeStatus.CLOSED

    def _show(self) -> None:
        """Show the simulation in a window, as Gymnasium's mode ``human`` demands of every reset and step."""
        if self.render_mode == "human":
            self._frame_source.draw(*self._get_simulation())

    def _require_open(self) -> None:
        if self._status is EpisodeStatus.CLOSED:
            raise ClosedEnvError("the environment is closed; make a new one")

    @property
    def spec(self) -> EnvSpec | None:
        """Return Gymnasium's specification with the length of the longest episode."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        # Options such as the number of strides decide the length, so that it cannot be registered.
        self._spec = None if spec is None else replace(spec, max_episode_steps=self.max_episode_steps)

    def __getstate__(self) -> dict[str, Any]:
        """Return the whole state; raises ConcurrentUseError while another thread steps."""
        with self._thread_guard:
            return dict(self.__dict__)

    def __copy__(self) -> Self:
        """Return a deep copy, because two environments cannot share one simulation."""
        return deepcopy(self)
