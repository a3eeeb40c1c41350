"""``klute_sim/AntagonistJoint`` on all cores: one model, many simulations, and no Python between their steps."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from gymnasium.vector import AutoresetMode

from klute_sim.device.device import Device
from klute_sim.envs.antagonist_joint import (
    DEFAULT_JOINT_DEVICE,
    make_action_space,
    make_observation_space,
    resolve_devices,
)
from klute_sim.envs.base.vector import BatchStep, BatchVectorEnv, Observations, VectorOptions
from klute_sim.envs.tasks.joint_task import CONTROL_INTERVAL, JointOptions, JointStates, JointTask
from klute_sim.plant import callbacks
from klute_sim.types import Array, Mask


class AntagonistJointVectorEnv(BatchVectorEnv):
    """``num_envs`` environments of :class:`klute_sim.envs.antagonist_joint.AntagonistJointEnv`, stepped together.

    ``gymnasium.make_vec("klute_sim/AntagonistJoint-v0", num_envs=64, vectorization_mode="vector_entry_point")``

    Spaces, reward and episodes equal those of the single environment bit for bit, with any number of threads:
    environment *i* behaves as a single one with seed ``seed + i``.
    """

    def __init__(
        self,
        num_envs: int = 1,
        *,
        device: Device | str | Path | Mapping[str, Device | str | Path] = DEFAULT_JOINT_DEVICE,
        duration: float = 5.0,
        time_step: float = 5e-4,
        n_jobs: int = 0,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        render_mode: None = None,
    ) -> None:
        """Create the environments on ``n_jobs`` threads (0: all cores); raises InputError when an option is invalid.

        ``max_episode_steps`` truncates episodes earlier, as in ``gymnasium.make``.
        :class:`klute_sim.envs.antagonist_joint.AntagonistJointEnv` describes the other options.
        """
        vector_options = VectorOptions(
            num_envs=num_envs,
            n_jobs=n_jobs,
            autoreset_mode=autoreset_mode,
            max_episode_steps=max_episode_steps,
            render_mode=render_mode,
        )
        options = JointOptions(duration=duration, time_step=time_step)
        self._task = JointTask(resolve_devices(device), options, num_envs, callbacks.choose_backend())
        super().__init__(
            self._task.model,
            JointStates,
            vector_options,
            (make_action_space(), make_observation_space()),
            options.actions_per_episode,
        )

    @property
    def dt(self) -> float:
        """Return the interval between two actions [s]."""
        return CONTROL_INTERVAL

    def _start_episode(self, index: int, rng: np.random.Generator) -> Mapping[str, float]:
        self._task.start_episode(index, self._scratch_data, rng)
        return {}

    def _reset_task(self, mask: Mask) -> None:
        self._task.reset(mask, self._states)

    def _get_observations(self) -> Observations:
        return self._task.observations

    def _advance(self, actions: Array, active: Mask) -> BatchStep:
        controls = self._task.schedule_controls(actions, active)
        if active.any():
            self._step_batch(active, controls.shape[1], None, controls)
        self._read_states(active)
        return BatchStep(*self._task.evaluate(actions, self._states, active))
