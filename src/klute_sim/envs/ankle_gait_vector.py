"""``klute_sim/AnkleGait`` on all cores: one model, many simulations, and no Python between their steps."""

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from klute_sim.controllers.pressure import PressureProfile
from klute_sim.device.device import DEFAULT_DEVICE, Device
from klute_sim.envs.ankle_gait import reset_simulation
from klute_sim.envs.base.batch_vector import BatchVectorEnv
from klute_sim.envs.base.task import BatchStep, make_action_space, make_observation_space
from klute_sim.envs.base.vector import Observations, VectorOptions
from klute_sim.envs.tasks.domain_randomization import RandomizationRanges
from klute_sim.envs.tasks.gait_task import GaitTask, SimulationStates
from klute_sim.envs.tasks.instruments import OBSERVATIONS
from klute_sim.envs.tasks.options import TaskOptions, resolve_device, resolve_gait_options
from klute_sim.gait.rig.setup import DRIVE_ACTUATORS
from klute_sim.gait.subject import ReferenceLike
from klute_sim.plant import callbacks
from klute_sim.rendering.frames import DEFAULT_CAMERA
from klute_sim.types import Array, Mask


class AnkleGaitVectorEnv(BatchVectorEnv):
    """``num_envs`` environments of :class:`klute_sim.envs.ankle_gait.AnkleGaitEnv` that are stepped together.

    ``gymnasium.make_vec("klute_sim/AnkleGait-v2", num_envs=64, vectorization_mode="vector_entry_point")``

    Spaces, reward and episodes equal those of the single environment bit for bit, with any number of threads:
    environment *i* behaves as a single one with seed ``seed + i``.
    """

    def __init__(
        self,
        num_envs: int = 1,
        *,
        device: Device | str | Path = DEFAULT_DEVICE,
        mass: float | None = None,
        stature: float | None = None,
        speed: float | None = None,
        slope: float = 0.0,
        reference: ReferenceLike = None,
        stride_time: float | None = None,
        accept: Collection[str] = (),
        foot: str | None = None,
        strides: int = 5,
        time_step: float = 5e-4,
        action: str | None = None,
        residual_bar: float = 1.0,
        profile: PressureProfile | None = None,
        sensor_noise: float = 0.0,
        sensor_delay: int = 0,
        reward: Mapping[str, float] | None = None,
        domain_randomization: RandomizationRanges | Mapping[str, Any] | None = None,
        reset_noise: float = 0.02,
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
        :class:`klute_sim.envs.ankle_gait.AnkleGaitEnv` describes the other options.
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
        gait_options = resolve_gait_options(
            reference, stride_time, accept, mass, stature, speed, slope, strides, time_step
        )
        options = TaskOptions(
            action=action,
            residual_bar=residual_bar,
            profile=profile,
            sensor_noise=sensor_noise,
            sensor_delay=sensor_delay,
            reward=reward,
            domain_randomization=domain_randomization,
            reset_noise=reset_noise,
        )
        self._task = GaitTask(resolve_device(device, foot), gait_options, options, num_envs, callbacks.choose_backend())
        self._reset_noise = reset_noise
        self._gait_rig = self._task.randomizer.gait_rigs[0]
        super().__init__(
            self._gait_rig.model,
            SimulationStates,
            vector_options,
            (make_action_space(), make_observation_space(OBSERVATIONS)),
            self._task.max_episode_steps,
            self._task.randomizer.varying_fields,
        )

    def _prepare_episode(self, index: int, rng: np.random.Generator) -> Mapping[str, float]:
        randomizer = self._task.randomizer
        episode = randomizer.sample(rng)
        rig = randomizer.apply(episode, self._model)
        for name, values in self._randomized_fields.items():
            values[index] = randomizer.get_field_value(episode, name)
        with callbacks.device_callbacks("compiled", is_isolated=True):
            reset_simulation(rig, self._scratch_data, rng, self._reset_noise)
        self._task.assign_episode(index, episode)
        return episode.sampled_values

    def _reset_task(self, mask: Mask) -> None:
        self._task.reset(mask, self._states, self._rngs)

    def _get_observations(self) -> Observations:
        return self._task.observations

    def _advance(self, actions: Array, active: Mask) -> BatchStep:
        actions = actions[:, 0]
        command = self._task.decode_action(actions)
        self._ctrl[active, : len(DRIVE_ACTUATORS)] = self._task.get_drive_command_rates()[active]
        for steps, scheduled_command in self._task.schedule_commands(command, active):
            self._ctrl[active, self._gait_rig.actuator.ctrl_address] = scheduled_command[active]
            self._step_batch(active, steps, self._task.add_steps if self._task.samples_air else None)
        self._read_states(active)
        return self._task.evaluate(actions, command, self._states, active, self._rngs)
