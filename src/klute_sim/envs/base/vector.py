"""Rules of Gymnasium for a vector environment: seeds, automatic resets, copies in mid-episode, and threads."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from klute_sim.envs.base.errors import ClosedEnvError, ResetNeededError
from klute_sim.envs.base.task import CONTROL_INTERVAL, BatchStep
from klute_sim.envs.base.thread_guard import ThreadGuard
from klute_sim.envs.base.validation import (
    validate_action,
    validate_count,
    validate_reset_mask,
    validate_reset_options,
    validate_seeds,
)
from klute_sim.errors import InputError
from klute_sim.rendering.frames import DEFAULT_CAMERA, VECTOR_RENDER_MODES, Frame, FrameSource, RenderOptions
from klute_sim.types import Array, Mask

Observations = NDArray[np.float32]


@dataclass(frozen=True, kw_only=True)
class VectorOptions:
    """Options of all vector environments."""

    num_envs: int
    """Number of environments."""
    n_jobs: int
    """Number of threads; 0: all cores."""
    autoreset_mode: AutoresetMode | str
    """When an ended episode restarts."""
    max_episode_steps: int | None
    """Number of steps after which every episode is truncated; None or -1: only as the task says."""
    render_mode: str | None = None
    """rgb_array or depth_array: one image of each environment; None: nothing."""
    width: int = 480
    """Width of an image [pixels]."""
    height: int = 480
    """Height of an image [pixels]."""
    camera: str = DEFAULT_CAMERA
    """Name of a camera of the model."""

    def __post_init__(self) -> None:
        """Raise InputError when an option is invalid."""
        validate_count("num_envs", self.num_envs, 1)
        validate_count("n_jobs", self.n_jobs, 0)
        if self.max_episode_steps not in (None, -1):
            validate_count("max_episode_steps", self.max_episode_steps, 1)
        try:
            object.__setattr__(self, "autoreset_mode", AutoresetMode(self.autoreset_mode))
        except ValueError:
            allowed = ", ".join(mode.value for mode in AutoresetMode)
            raise InputError(f"autoreset_mode is {self.autoreset_mode!r}; allowed: {allowed}") from None

    def make_render_options(self) -> RenderOptions:
        """Return what the environments draw; raises InputError when an option is invalid."""
        return RenderOptions(
            render_mode=self.render_mode,
            width=self.width,
            height=self.height,
            camera=self.camera,
            allowed_modes=VECTOR_RENDER_MODES,
        )


class DeviceVectorEnv(VectorEnv[Observations, NDArray[np.float32], NDArray[Any]], ABC):
    """Environments that are stepped together; a subclass implements the start of an episode and one interval.

    A copy (copy.copy, copy.deepcopy or pickle) continues in mid-episode exactly as the original does.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": list(VECTOR_RENDER_MODES),
        "render_fps": round(1.0 / CONTROL_INTERVAL),
    }

    def __init__(
        self,
        options: VectorOptions,
        spaces_of_one: tuple["spaces.Box[np.float32]", "spaces.Box[np.float32]"],
        task_max_steps: int,
    ) -> None:
        """Set up environments without episodes.

        ``spaces_of_one`` are the spaces of action and observation; ``task_max_steps`` is the length of the longest
        episode.
        """
        self._options = options
        self._frame_source = FrameSource(options.make_render_options())
        self.render_mode = options.render_mode
        self.num_envs, self._autoreset_mode = int(options.num_envs), AutoresetMode(options.autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self._autoreset_mode}
        limit = options.max_episode_steps
        self._time_limit = None if limit in (None, -1) else int(limit)
        self.max_episode_steps = task_max_steps if self._time_limit is None else min(task_max_steps, self._time_limit)
        """Number of steps after which every episode has been truncated."""
        self.single_action_space, self.single_observation_space = spaces_of_one
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self._thread_guard = ThreadGuard()
        self._obstacle = "the environments have no episodes yet"
        self._rngs: list[np.random.Generator] = []
        self._seeds: list[int] = []
        self._done: Mask = np.zeros(self.num_envs, dtype=np.bool_)
        self._elapsed_steps = np.zeros(self.num_envs, dtype=np.int64)

    @property
    def dt(self) -> float:
        """Return the interval between two actions [s]."""
        return CONTROL_INTERVAL

    @abstractmethod
    def _start_episode(self, index: int, rng: np.random.Generator) -> Mapping[str, float]:
        """Start an episode of simulation ``index``; return its ``info``."""

    @abstractmethod
    def _reset_task(self, mask: Mask) -> None:
        """Reset the task of the simulations in ``mask``, whose episodes have started."""

    @abstractmethod
    def _advance(self, actions: Array, active: Mask) -> BatchStep:
        """Hold the valid ``actions`` (n, actions of one) for one interval in the simulations ``active``."""

    @abstractmethod
    def _get_observations(self) -> Observations:
        """Return new arrays of the observations."""

    @property  # type: ignore[misc]  # as in Gymnasium's own vector environments, there is one for each environment
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """Return the random generators of the environments."""
        return tuple(self._rngs)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """Return the seeds of the environments."""
        return tuple(self._seeds)

    @property
    def spec(self) -> EnvSpec | None:
        """Return Gymnasium's specification with the length of the longest episode."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = None if spec is None else replace(spec, max_episode_steps=self.max_episode_steps)

    _spec: EnvSpec | None = None

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """Start episodes in all environments, or where ``options["reset_mask"]`` is true.

        Environment *i* gets ``seed + i``, or item *i* of a sequence. Raises InvalidSeedError, InputError for another
        option or mask, ResetNeededError when the first mask leaves out an environment, ClosedEnvError, and
        ConcurrentUseError.
        """
        with self._thread_guard:
            self._require_open()
            mask = np.ones(self.num_envs, dtype=np.bool_)
            valid_options = validate_reset_options(options, ("reset_mask",))
            if "reset_mask" in valid_options:
                mask = validate_reset_mask(valid_options["reset_mask"], self.num_envs)
            if self._obstacle and not mask.all():
                raise ResetNeededError(f"{self._obstacle}: reset all of them, without reset_mask")
            seeds = validate_seeds(seed, self.num_envs)
            if not self._rngs:
                self._rngs, self._seeds = map(list, zip(*map(seeding.np_random, seeds), strict=True))
            else:
                for i in np.flatnonzero(mask):
                    if seeds[i] is not None:
                        self._rngs[i], self._seeds[i] = seeding.np_random(seeds[i])
            self._obstacle = "the last call was interrupted"
            info = self._start_episodes(mask)
            self._obstacle = ""
            return self._get_observations(), info

    def _start_episodes(self, mask: Mask) -> dict[str, Any]:
        """Start the episodes in ``mask`` and return their ``info``."""
        info: dict[str, Array] = {}
        for i in np.flatnonzero(mask).tolist():
            for name, value in self._start_episode(i, self._rngs[i]).items():
                info.setdefault(name, np.zeros(self.num_envs))[i] = value
        self._reset_task(mask)
        self._done &= ~mask
        self._elapsed_steps[mask] = 0
        return mask_info(info, mask)

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[Observations, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Hold ``actions`` (num_envs, actions of one) for one interval; environments that restart now ignore theirs.

        Raises InvalidActionError, ResetNeededError before the first reset and, with ``AutoresetMode.DISABLED``, after
        the end of an episode, ClosedEnvError, and ConcurrentUseError.
        """
        with self._thread_guard:
            self._require_open()
            active = ~self._done
            if self._obstacle:
                raise ResetNeededError(f"{self._obstacle}: call reset() before step()")
            if not active.all() and self._autoreset_mode != AutoresetMode.NEXT_STEP:
                raise ResetNeededError(
                    "an episode has ended: call reset(options={'reset_mask': terminated | truncated}) before step()"
                )
            valid_actions = validate_action(actions, (self.num_envs, *(self.single_action_space.shape or ())), active)
            self._obstacle = "the last call was interrupted"
            result = self._step(valid_actions, active)
            self._obstacle = ""
            return result

    def _step(self, actions: Array, active: Mask) -> tuple[Observations, Array, Mask, Mask, dict[str, Any]]:
        infos = self._start_episodes(~active)
        step = self._advance(actions, active)
        self._elapsed_steps += active
        truncated = step.truncated
        if self._time_limit is not None:
            truncated = truncated | (active & (self._elapsed_steps >= self._time_limit))
        self._done = step.terminated | truncated
        if self._autoreset_mode == AutoresetMode.SAME_STEP and self._done.any():
            ended = self._done.copy()
            final_observations = np.full(self.num_envs, None, dtype=object)
            observations = self._get_observations()
            for i in np.flatnonzero(ended):
                final_observations[i] = observations[i]
            infos |= {
                "final_obs": final_observations,
                "_final_obs": ended,
                "final_info": mask_info(step.info, ended, step.info_masks),
                "_final_info": ended.copy(),
            }
            active = active & ~ended
            infos |= self._start_episodes(ended)
        infos |= mask_info(step.info, active, step.info_masks)
        return self._get_observations(), step.reward, step.terminated, truncated, infos

    def render(self) -> tuple[Frame, ...] | None:
        """Return an image or distances of each environment; None without a render mode.

        Raises ResetNeededError before the first reset, ClosedEnvError, and ConcurrentUseError.
        """
        with self._thread_guard:
            self._require_open()
            if not self._rngs:
                raise ResetNeededError(f"{self._obstacle}: call reset() before render()")
            return None if self.render_mode is None else tuple(map(self._draw, range(self.num_envs)))

    @abstractmethod
    def _draw(self, index: int) -> Frame:
        """Return the frame of environment ``index``; only called with a render mode."""

    def close_extras(self, **kwargs: Any) -> None:
        """Release the graphics context; MuJoCo's threads end with the environment."""
        self._frame_source.close()

    def _require_open(self) -> None:
        if self.closed:
            raise ClosedEnvError("the environments are closed; make new ones")

    def __getstate__(self) -> dict[str, Any]:
        """Return the whole state; raises ConcurrentUseError while another thread steps."""
        with self._thread_guard:
            return self._copy_state()

    def _copy_state(self) -> dict[str, Any]:
        """Return the attributes that a copy needs."""
        return dict(self.__dict__)

    def __copy__(self) -> Self:
        """Return a deep copy, because two environments cannot share simulations."""
        return deepcopy(self)


def mask_info(info: Mapping[str, Array], mask: Mask, info_masks: Mapping[str, Mask] | None = None) -> dict[str, Any]:
    """Return ``info`` in the form of Gymnasium: 0 outside ``mask``, and the mask under ``_name``.

    Entries in ``info_masks`` exist only there; an entry that no environment has is left out.
    """
    masked: dict[str, Any] = {}
    for name, value in info.items():
        owners = mask & info_masks[name] if info_masks and name in info_masks else mask
        if owners.any():
            masked[name], masked[f"_{name}"] = np.where(owners, value, 0.0), owners.copy()
    return masked
