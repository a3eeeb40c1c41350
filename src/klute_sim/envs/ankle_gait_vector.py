"""``klute_sim/AnkleGait`` on all cores: one model, many simulations, and no Python between their steps."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import fields
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from klute_sim.controllers.pressure import PressureProfile
from klute_sim.device.device import DEFAULT_DEVICE, Device
from klute_sim.envs.ankle_gait import make_action_space, make_observation_space, reset_simulation, validate_action
from klute_sim.envs.tasks.domain_randomization import RandomizationRanges
from klute_sim.envs.tasks.gait_task import CONTROL_INTERVAL, GaitTask, SimulationStates
from klute_sim.envs.tasks.options import TaskOptions, resolve_device
from klute_sim.errors import InputError, SimulationError
from klute_sim.gait.rig.setup import DRIVE_ACTUATORS, GaitOptions
from klute_sim.plant import batch, callbacks
from klute_sim.types import Array, Mask

Observations = NDArray[np.float32]
STATE_SPEC = mujoco.mjtState.mjSTATE_INTEGRATION
"""Parts of the MuJoCo state that restore a simulation."""
STATE_FIELDS = [field.name for field in fields(SimulationStates)]
"""Names of the arrays that the task reads."""


class AnkleGaitVectorEnv(VectorEnv[Observations, NDArray[np.float32], NDArray[Any]]):
    """``num_envs`` environments of :class:`klute_sim.envs.ankle_gait.AnkleGaitEnv` that are stepped together.

    ``gymnasium.make_vec("klute_sim/AnkleGait-v1", num_envs=64, vectorization_mode="vector_entry_point")``

    Spaces, reward and episodes equal those of the single environment bit for bit, with any number of threads:
    environment *i* behaves as a single one with seed ``seed + i``.
    """

    metadata: dict[str, Any] = {"render_modes": [], "render_fps": round(1.0 / CONTROL_INTERVAL)}  # noqa: RUF012

    def __init__(
        self,
        num_envs: int = 1,
        *,
        device: Device | str | Path = DEFAULT_DEVICE,
        mass: float = 75.0,
        stature: float = 1.75,
        speed: float | None = None,
        slope: float = 0.0,
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
        render_mode: None = None,
    ) -> None:
        """Create the environments on ``n_jobs`` threads (0: all cores); raises InputError when an option is invalid.

        :class:`klute_sim.envs.ankle_gait.AnkleGaitEnv` describes the other options.
        """
        gait_options = GaitOptions(mass=mass, stature=stature, speed=speed, slope=slope, strides=strides, dt=time_step)
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
        self._task = GaitTask(resolve_device(device), gait_options, options, num_envs, callbacks.choose_backend())
        self._reset_noise = reset_noise
        self._gait_rig = self._task.randomizer.gait_rigs[0]
        self._batch = batch.create_batch(self._gait_rig.model, num_envs, n_jobs)
        self._randomized_fields = {name: self._batch.expand(name) for name in self._task.randomizer.varying_fields}
        self._model = copy(self._gait_rig.model)
        self._scratch_data = mujoco.MjData(self._model)
        self._bound_states = {name: self._batch.bind(name) for name in STATE_FIELDS}
        self._states = SimulationStates(*(value.copy() for value in self._bound_states.values()))
        self._ctrl = self._batch.bind("ctrl")
        self.num_envs = num_envs
        self.single_action_space, self.single_observation_space = make_action_space(), make_observation_space()
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.metadata = {**self.metadata, "autoreset_mode": AutoresetMode(autoreset_mode)}
        self._autoreset_mode = AutoresetMode(autoreset_mode)
        self._rngs: list[np.random.Generator] | None = None
        self._done: Mask = np.zeros(num_envs, dtype=np.bool_)

    @property
    def dt(self) -> float:
        """Return the interval between two actions [s]."""
        return CONTROL_INTERVAL

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """Start episodes at heel strike in all environments, or where ``options["reset_mask"]`` is true."""
        mask = np.ones(self.num_envs, dtype=np.bool_)
        if options and "reset_mask" in options:
            mask = np.asarray(options["reset_mask"])
            if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
                raise InputError(
                    f"reset_mask has shape {mask.shape} and type {mask.dtype}; allowed: ({self.num_envs},) and bool, "
                    "with at least one to reset"
                )
            if self._rngs is None and not mask.all():
                raise InputError("the first reset must include all environments: leave out reset_mask")
        if seed is None or isinstance(seed, int):
            seeds = [None if seed is None else seed + i for i in range(self.num_envs)]
        else:
            seeds = list(seed)
        if len(seeds) != self.num_envs:
            raise InputError(f"seed has {len(seeds)} values; allowed: one value, or {self.num_envs}")
        if self._rngs is None:
            self._rngs = [seeding.np_random(env_seed)[0] for env_seed in seeds]
        else:
            for i in np.flatnonzero(mask):
                if seeds[i] is not None:
                    self._rngs[i] = seeding.np_random(seeds[i])[0]
        info = self._start_episodes(mask, self._rngs)
        return self._task.observations, info

    def _start_episodes(self, mask: Mask, rngs: list[np.random.Generator]) -> dict[str, Any]:
        """Start the episodes in ``mask`` and return their sampled values."""
        randomizer = self._task.randomizer
        info: dict[str, Array] = {}
        for i in np.flatnonzero(mask):
            episode = randomizer.sample(rngs[i])
            rig = randomizer.apply(episode, self._model)
            for name, values in self._randomized_fields.items():
                values[i] = randomizer.get_field_value(episode, name)
            reset_simulation(rig, self._scratch_data, rngs[i], self._reset_noise)
            self._task.assign_episode(int(i), episode)
            mujoco.mj_getState(self._model, self._scratch_data, self._batch.state[i], STATE_SPEC)
            for name in STATE_FIELDS:
                getattr(self._states, name)[i] = getattr(self._scratch_data, name)
            for name, value in episode.sampled_values.items():
                info.setdefault(name, np.zeros(self.num_envs))[i] = value
        self._task.reset(mask, self._states, rngs)
        self._done &= ~mask
        return _with_masks(info, mask)

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[Observations, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Hold ``actions`` (num_envs, 1) for one interval; raises InputError when an action is NaN.

        Actions of environments that are about to be reset are ignored.
        """
        active = ~self._done
        valid_actions = validate_action(actions, (self.num_envs, 1), active)[:, 0]
        rngs = self._rngs
        if rngs is None:
            raise InputError("reset the environments before stepping them")
        if not active.all() and self._autoreset_mode != AutoresetMode.NEXT_STEP:
            raise InputError("an episode has ended: reset it (options={'reset_mask': ...}) before the next step")
        infos = self._start_episodes(~active, rngs)
        command = self._task.decode_action(valid_actions)
        self._ctrl[active, : len(DRIVE_ACTUATORS)] = self._task.get_drive_command_rates()[active]
        for steps, scheduled_command in self._task.schedule_commands(command, active):
            self._ctrl[active, self._gait_rig.actuator.ctrl_address] = scheduled_command[active]
            with suppress(SimulationError):  # a failed device ends its episode
                batch.step_batch(self._batch, np.flatnonzero(active), steps)
        for name, value in self._bound_states.items():
            getattr(self._states, name)[active] = value[active]
        reward, terminated, truncated, info = self._task.evaluate(valid_actions, command, self._states, active, rngs)
        self._done = terminated | truncated
        if self._autoreset_mode == AutoresetMode.SAME_STEP and self._done.any():
            ended = self._done.copy()
            final_observations = np.full(self.num_envs, None, dtype=object)
            observations = self._task.observations
            for i in np.flatnonzero(ended):
                final_observations[i] = observations[i]
            infos |= {
                "final_obs": final_observations,
                "_final_obs": ended,
                "final_info": _with_masks(info, ended),
                "_final_info": ended,
            }
            active = active & ~ended
            infos |= self._start_episodes(ended, rngs)
        return self._task.observations, reward, terminated, truncated, infos | _with_masks(info, active)


def _with_masks(info: dict[str, Array], mask: Mask) -> dict[str, Any]:
    """Return ``info`` in the form of Gymnasium: 0 outside ``mask``, and the mask under ``_name``."""
    masked: dict[str, Any] = {}
    if not mask.any():
        return masked
    for name, value in info.items():
        masked[name], masked[f"_{name}"] = np.where(mask, value, 0.0), mask.copy()
    return masked
