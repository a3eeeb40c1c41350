"""Vector environments on MuJoCo's batch: one model, many simulations, and no Python between their steps."""

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import fields
from typing import Any, ClassVar

import mujoco
import numpy as np
from gymnasium import spaces

from klute_sim.envs.base.vector import DeviceVectorEnv, VectorOptions
from klute_sim.errors import SimulationError
from klute_sim.plant import batch
from klute_sim.plant.batch import get_model_field
from klute_sim.rendering.frames import Frame
from klute_sim.types import Array, Mask

STATE_SPEC = mujoco.mjtState.mjSTATE_INTEGRATION
"""Parts of the MuJoCo state that restore a simulation."""


class BatchVectorEnv(DeviceVectorEnv):
    """Environments whose simulations are one batch."""

    _NOT_COPIED: ClassVar = ("_batch", "_bound_states", "_randomized_fields", "_ctrl")
    """Attributes that belong to MuJoCo's threads."""

    def __init__(
        self,
        model: mujoco.MjModel,
        states_type: type,
        options: VectorOptions,
        spaces_of_one: tuple["spaces.Box[np.float32]", "spaces.Box[np.float32]"],
        task_max_steps: int,
        randomized_fields: Sequence[str] = (),
    ) -> None:
        """Set up simulations of ``model`` without episodes.

        ``states_type`` is a dataclass of the arrays that the task reads, and ``randomized_fields`` of the model differ
        between the simulations; :class:`DeviceVectorEnv` describes the other arguments.
        """
        super().__init__(options, spaces_of_one, task_max_steps)
        self._frame_source.options.check_camera(model)
        self._model = copy(model)
        self._scratch_data = mujoco.MjData(self._model)
        self._drawn_model: mujoco.MjModel | None = None
        self._state_names, self._randomized_names = [item.name for item in fields(states_type)], randomized_fields
        self._connect_batch(model)
        self._states = states_type(*(value.copy() for value in self._bound_states.values()))

    def _connect_batch(self, model: mujoco.MjModel) -> None:
        self._batch = batch.create_batch(model, self.num_envs, int(self._options.n_jobs))
        self._randomized_fields = {name: self._batch.expand(name) for name in self._randomized_names}
        self._bound_states = {name: self._batch.bind(name) for name in self._state_names}
        self._ctrl = self._batch.bind("ctrl")

    @abstractmethod
    def _prepare_episode(self, index: int, rng: np.random.Generator) -> Mapping[str, float]:
        """Set ``self._scratch_data`` to the start of an episode of simulation ``index``; return its ``info``."""

    def _start_episode(self, index: int, rng: np.random.Generator) -> Mapping[str, float]:
        info = self._prepare_episode(index, rng)
        mujoco.mj_getState(self._model, self._scratch_data, self._batch.state[index], STATE_SPEC)
        for name in self._state_names:
            getattr(self._states, name)[index] = getattr(self._scratch_data, name)
        return info

    def _step_batch(
        self,
        active: Mask,
        n_steps: int,
        add_steps: Callable[[Mask, Array], None] | None,
        controls: Array | None = None,
    ) -> None:
        """Take ``n_steps`` steps in the simulations ``active``.

        ``controls`` (active simulations, ``n_steps``, nu) are the commands of every step. ``add_steps`` receives
        ``active`` and the values of ``act`` after each step; None records nothing.
        """
        record = {"act": np.empty((int(active.sum()), n_steps, self._model.na))} if add_steps else {}
        with suppress(SimulationError):  # a failed device ends its episode
            batch.step_batch(self._batch, np.flatnonzero(active), n_steps, controls, record=record, is_isolated=True)
        if add_steps:
            add_steps(active, record["act"])

    def _read_states(self, active: Mask) -> None:
        """Copy the states of the simulations ``active`` from the batch."""
        for name, value in self._bound_states.items():
            getattr(self._states, name)[active] = value[active]

    def _draw(self, index: int) -> Frame:
        if self._drawn_model is None:
            self._drawn_model = copy(self._model)
        model = self._drawn_model
        for name, values in self._randomized_fields.items():
            field = get_model_field(model, name)
            field[:] = np.reshape(values[index], field.shape)
        data = mujoco.MjData(model)
        mujoco.mj_setState(model, data, self._batch.state[index], STATE_SPEC)
        for compute in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_camlight, mujoco.mj_tendon):
            compute(model, data)
        frame = self._frame_source.draw(model, data)
        assert frame is not None  # a batch has no window
        return frame

    def _copy_state(self) -> dict[str, Any]:
        state = {name: value for name, value in self.__dict__.items() if name not in self._NOT_COPIED}
        rows = {name: values.copy() for name, values in self._randomized_fields.items()}
        return state | {"_copied_batch": (copy(self._batch.model), self._batch.state.copy(), rows)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the state of :meth:`__getstate__`."""
        model, batch_state, rows = state.pop("_copied_batch")
        self.__dict__.update(state)
        self._connect_batch(model)
        self._batch.state[:] = batch_state
        for name, values in rows.items():
            self._randomized_fields[name][:] = values
