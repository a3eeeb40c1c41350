"""Environments of a task whose controls of an interval are known at its beginning: single, and as a batch."""

from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Any

import mujoco
import numpy as np

from klute_sim.envs.base.batch_vector import BatchVectorEnv
from klute_sim.envs.base.single import SINGLE_MASK, DeviceEnv, Observation, Step
from klute_sim.envs.base.task import (
    BatchStep,
    ScheduledTask,
    make_action_space,
    make_observation_space,
)
from klute_sim.envs.base.vector import Observations, VectorOptions
from klute_sim.errors import SimulationError
from klute_sim.plant import callbacks
from klute_sim.plant.batch import get_model_field
from klute_sim.rendering.frames import RenderOptions
from klute_sim.types import Array, Mask


def iter_segments(controls: Array, max_count: int) -> Iterator[tuple[int, int]]:
    """Yield the first step and the number of steps, at most ``max_count``, of segments with constant ``controls``."""
    changes = np.any(controls[1:] != controls[:-1], axis=1)
    start = 0
    for step in range(1, len(controls) + 1):
        if step == len(controls) or changes[step - 1] or step - start == max_count:
            yield start, step - start
            start = step


class ScheduledTaskEnv(DeviceEnv):
    """Single environment of a task."""

    def __init__(self, task: ScheduledTask, backend: str, render_options: RenderOptions) -> None:
        """Set up the environment of ``task``, which has one simulation, with a ``backend``, compiled or python."""
        super().__init__(task.max_episode_steps, render_options)
        render_options.check_camera(task.model)
        self._backend, self._task = backend, task
        self.model = task.model
        """MuJoCo model including the devices."""
        self.data = mujoco.MjData(self.model)
        """State of the simulation."""
        self.action_space = make_action_space(task.n_actions)
        self.observation_space = make_observation_space(task.observation_rows)

    def _start_episode(self) -> tuple[Observation, dict[str, Any]]:
        info = self._task.start_episode(0, self.model, self.data, self.np_random)
        self._task.reset(SINGLE_MASK, self._read_states())
        return self._task.observations[0], dict(info)

    def _advance(self, action: Array) -> Step:
        actions, acts = action[None], []
        controls, recorder = self._task.schedule_controls(actions, SINGLE_MASK)[0], self._task.step_recorder
        with callbacks.device_callbacks(self._backend, is_isolated=True):
            try:
                for start, count in iter_segments(controls, 1 if recorder is not None else len(controls)):
                    self.data.ctrl[:] = controls[start]
                    callbacks.step_model(self.model, self.data, count)
                    acts.append(self.data.act.copy())
            except SimulationError:
                # Under either law, a failed device ends the episode.
                self.data.act[self._task.failure_address] = np.nan
        if recorder is not None:
            recorder(SINGLE_MASK, np.reshape(acts, (1, -1, self.model.na)))
        step = self._task.evaluate(actions, self._read_states(), SINGLE_MASK)
        return (
            self._task.observations[0],
            float(step.reward[0]),
            bool(step.terminated[0]),
            bool(step.truncated[0]),
            step.get_first_info(),
        )

    def _get_simulation(self) -> tuple[mujoco.MjModel, mujoco.MjData]:
        return self.model, self.data

    def _read_states(self) -> Any:
        names = (field.name for field in fields(self._task.states_type))
        return self._task.states_type(*(getattr(self.data, name)[None] for name in names))


class ScheduledTaskVectorEnv(BatchVectorEnv):
    """Batch of environments of a task."""

    def __init__(self, task: ScheduledTask, options: VectorOptions) -> None:
        """Set up the environments of ``task``, which has as many simulations as ``options`` ask for."""
        self._task = task
        super().__init__(
            task.model,
            task.states_type,
            options,
            (make_action_space(task.n_actions), make_observation_space(task.observation_rows)),
            task.max_episode_steps,
            task.varying_fields,
        )

    def _prepare_episode(self, index: int, rng: np.random.Generator) -> Mapping[str, float]:
        info = self._task.start_episode(index, self._model, self._scratch_data, rng)
        for name, values in self._randomized_fields.items():
            values[index] = np.reshape(get_model_field(self._model, name), values[index].shape)
        return info

    def _reset_task(self, mask: Mask) -> None:
        self._task.reset(mask, self._states)

    def _get_observations(self) -> Observations:
        return self._task.observations

    def _advance(self, actions: Array, active: Mask) -> BatchStep:
        controls = self._task.schedule_controls(actions, active)
        if active.any():
            self._step_batch(active, controls.shape[1], self._task.step_recorder, controls)
        self._read_states(active)
        return self._task.evaluate(actions, self._states, active)
