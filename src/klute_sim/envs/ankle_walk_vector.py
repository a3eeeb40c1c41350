"""``klute_sim/AnkleWalk`` on all cores: many persons, and no Python between the time steps of an interval."""

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from klute_sim.controllers.parse import Controller
from klute_sim.device.device import DEFAULT_DEVICE, Device
from klute_sim.envs.ankle_walk import resolve_base, resolve_prosthesis
from klute_sim.envs.base.task import BatchStep, make_action_space, make_observation_space
from klute_sim.envs.base.vector import DeviceVectorEnv, Observations, VectorOptions
from klute_sim.envs.tasks.instruments import OBSERVATIONS
from klute_sim.envs.tasks.walk.options import WalkTaskOptions
from klute_sim.envs.tasks.walk.task import WalkTask
from klute_sim.errors import InputError
from klute_sim.plant import callbacks
from klute_sim.rendering.frames import DEFAULT_CAMERA, Frame, FrameSource
from klute_sim.types import Array, Mask


class AnkleWalkVectorEnv(DeviceVectorEnv):
    """``num_envs`` environments of :class:`klute_sim.envs.ankle_walk.AnkleWalkEnv` that are stepped together.

    ``gymnasium.make_vec("klute_sim/AnkleWalk-v0", num_envs=16, vectorization_mode="vector_entry_point")``

    Spaces, reward and episodes equal those of the single environment bit for bit, with any number of threads:
    environment *i* behaves as a single one with seed ``seed + i``.
    """

    def __init__(
        self,
        num_envs: int = 1,
        *,
        device: Device | str | Path = DEFAULT_DEVICE,
        foot: str | None = None,
        alignment: float | None = None,
        spring_foot: float | None = None,
        action: str = "pressure",
        base: Controller | str = "machine",
        residual_bar: float = 1.0,
        walkers: Sequence[str | Path] | None = None,
        gain_noise: float = 0.0,
        unevenness: float = 0.0,
        speed: float = 1.25,
        duration: float = 20.0,
        time_step: float = 1e-3,
        sensor_noise: float = 0.0,
        sensor_delay: int = 0,
        reward: Mapping[str, float] | None = None,
        n_jobs: int = 0,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        width: int = 480,
        height: int = 480,
        camera: str = DEFAULT_CAMERA,
    ) -> None:
        """Create the environments on ``n_jobs`` threads (0: all cores); raises InputError when an option is invalid.

        ``max_episode_steps`` truncates episodes earlier, as in ``gymnasium.make``.
        :class:`klute_sim.envs.ankle_walk.AnkleWalkEnv` describes the other options.
        """
        vector_options = VectorOptions(
            num_envs=num_envs,
            n_jobs=n_jobs,
            autoreset_mode=autoreset_mode,
            max_episode_steps=max_episode_steps,
            render_mode=render_mode,
            width=width,
            height=height,
            camera=camera,
        )
        options = WalkTaskOptions(
            prosthesis=resolve_prosthesis(device, foot, alignment, spring_foot),
            base=resolve_base(base),
            action=action,
            residual_bar=residual_bar,
            walkers=walkers,
            gain_noise=gain_noise,
            unevenness=unevenness,
            speed=speed,
            duration=duration,
            time_step=time_step,
            sensor_noise=sensor_noise,
            sensor_delay=sensor_delay,
            reward=reward,
        )
        if callbacks.choose_backend() != "compiled":
            raise InputError("the vector environment needs the compiled backend; step single environments instead")
        self._task = WalkTask(options, num_envs, "compiled")
        spaces_of_one = make_action_space(), make_observation_space(OBSERVATIONS)
        super().__init__(vector_options, spaces_of_one, options.actions_per_episode)
        # Each person has a model, which resets on uneven ground replace.
        self._frame_sources = [FrameSource(self._frame_source.options) for _ in range(num_envs)]
        self._n_threads = min(int(n_jobs) or os.cpu_count() or 1, num_envs)
        self._start_threads()

    def _start_threads(self) -> None:
        self._pool = ThreadPoolExecutor(self._n_threads) if self._n_threads > 1 else None

    def _start_episodes(self, mask: Mask) -> dict[str, Any]:
        with callbacks.device_callbacks("compiled", is_isolated=True):
            return super()._start_episodes(mask)

    def _start_episode(self, index: int, rng: np.random.Generator) -> Mapping[str, float]:
        return self._task.start_episode(index, rng)

    def _reset_task(self, mask: Mask) -> None:
        self._task.reset(mask, self._rngs)

    def _get_observations(self) -> Observations:
        return self._task.observations

    def _advance(self, actions: Array, active: Mask) -> BatchStep:
        self._task.set_actions(actions[:, 0], active)
        indices = np.flatnonzero(active).tolist()
        with callbacks.device_callbacks("compiled", is_isolated=True):
            if self._pool is None:
                self._advance_people(indices)
            else:
                n = self._n_threads
                list(self._pool.map(self._advance_people, [indices[k::n] for k in range(n)]))
            callbacks.pop_fault_messages()  # a failed device ends its episode, because its state is not finite
        return self._task.evaluate(actions[:, 0], active, self._rngs)

    def _advance_people(self, indices: Sequence[int]) -> None:
        for index in indices:
            self._task.get_person(index).advance()

    def _draw(self, index: int) -> Frame:
        simulator = self._task.get_person(index).simulator
        frame = self._frame_sources[index].draw(simulator.model, simulator.data)
        assert frame is not None  # a vector environment has no window
        return frame

    def close_extras(self, **kwargs: Any) -> None:
        """Release the graphics contexts and end the threads."""
        for source in self._frame_sources:
            source.close()
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None

    def _copy_state(self) -> dict[str, Any]:
        return {name: value for name, value in super()._copy_state().items() if name != "_pool"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the state of :meth:`__getstate__`."""
        self.__dict__.update(state)
        self._start_threads()
