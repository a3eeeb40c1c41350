"""``klute_sim/AnkleGait`` on all cores: one model, many simulations, no Python between their steps."""

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

from klute_sim.control.pressure import Profile
from klute_sim.device.files import DEFAULT_PROSTHESIS, Device
from klute_sim.envs.ankle_gait import action_space, begin, checked, observation_space
from klute_sim.envs.options import TaskOptions, device_of
from klute_sim.envs.randomise import Randomise
from klute_sim.envs.task import INTERVAL, Readings, Task
from klute_sim.errors import InputError, SimulationError
from klute_sim.plant import batch, router
from klute_sim.rigs.gait.assembly import DRIVES, GaitOptions

Observations = NDArray[np.float32]
Flags = NDArray[np.bool_]
STATE = mujoco.mjtState.mjSTATE_INTEGRATION
READ = [field.name for field in fields(Readings)]


class AnkleGaitVectorEnv(VectorEnv[Observations, NDArray[np.float32], NDArray[Any]]):
    """``num_envs`` environments of :class:`klute_sim.envs.ankle_gait.AnkleGaitEnv` stepped together.

    ``gymnasium.make_vec("klute_sim/AnkleGait-v1", num_envs=64, vectorization_mode="vector_entry_point")``

    Spaces, reward and episodes are those of the single environment, and so is every bit of the result at any number
    of threads: environment *i* behaves as a single one that was seeded with ``seed + i``.
    """

    metadata: dict[str, Any] = {"render_modes": [], "render_fps": round(1.0 / INTERVAL)}  # noqa: RUF012

    def __init__(
        self,
        num_envs: int = 1,
        *,
        device: Device | str | Path = DEFAULT_PROSTHESIS,
        mass: float = 75.0,
        stature: float = 1.75,
        speed: float | None = None,
        slope: float = 0.0,
        strides: int = 5,
        step: float = 5e-4,
        action: str | None = None,
        residual_bar: float = 1.0,
        profile: Profile | None = None,
        sensor_noise: float = 0.0,
        sensor_delay: int = 0,
        reward: Mapping[str, float] | None = None,
        randomise: Randomise | Mapping[str, Any] | None = None,
        reset_noise: float = 0.02,
        threads: int = 0,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: None = None,
    ) -> None:
        """As the single environment, on ``threads`` threads (0: all cores); raises InputError for what cannot be."""
        walker = GaitOptions(mass=mass, stature=stature, speed=speed, slope=slope, strides=strides, step=step)
        options = TaskOptions(
            action=action,
            residual_bar=residual_bar,
            profile=profile,
            sensor_noise=sensor_noise,
            sensor_delay=sensor_delay,
            reward=reward,
            randomise=randomise,
            reset_noise=reset_noise,
        )
        self._task, self._reset_noise = Task(device_of(device), walker, options, num_envs, router.choose()), reset_noise
        self._rig = self._task.casting.rigs[0]
        self._batch = batch.simulations(self._rig.model, num_envs, threads)
        self._own = {name: self._batch.expand(name) for name in self._task.casting.changing}
        self._model = copy(self._rig.model)
        self._scratch = mujoco.MjData(self._model)
        self._bound = {name: self._batch.bind(name) for name in READ}
        self._now = Readings(*(value.copy() for value in self._bound.values()))
        self._ctrl = self._batch.bind("ctrl")
        self.num_envs = num_envs
        self.single_action_space, self.single_observation_space = action_space(), observation_space()
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.metadata = {**self.metadata, "autoreset_mode": AutoresetMode(autoreset_mode)}
        self._mode = AutoresetMode(autoreset_mode)
        self._randoms: list[np.random.Generator] | None = None
        self._done: Flags = np.zeros(num_envs, dtype=np.bool_)

    @property
    def dt(self) -> float:
        """Time between two actions [s]."""
        return INTERVAL

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """Heel strike everywhere, or where ``options["reset_mask"]`` is true."""
        mask = np.ones(self.num_envs, dtype=np.bool_)
        if options and "reset_mask" in options:
            mask = np.asarray(options["reset_mask"])
            if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
                raise InputError(
                    f"reset_mask has shape {mask.shape} and type {mask.dtype}; allowed: ({self.num_envs},) and bool, "
                    "with at least one to reset"
                )
            if self._randoms is None and not mask.all():
                raise InputError("the first reset is of all environments")
        if seed is None or isinstance(seed, int):
            seeds = [None if seed is None else seed + i for i in range(self.num_envs)]
        else:
            seeds = list(seed)
        if len(seeds) != self.num_envs:
            raise InputError(f"{len(seeds)} seeds for {self.num_envs} environments")
        if self._randoms is None:
            self._randoms = [seeding.np_random(each)[0] for each in seeds]
        else:
            for i in np.flatnonzero(mask):
                if seeds[i] is not None:
                    self._randoms[i] = seeding.np_random(seeds[i])[0]
        told = self._begin(mask, self._randoms)
        return self._task.observed, told

    def _begin(self, mask: Flags, randoms: list[np.random.Generator]) -> dict[str, Any]:
        """Start the episodes of ``mask`` anew; tells what was drawn for them."""
        casting = self._task.casting
        told: dict[str, NDArray[np.float64]] = {}
        for i in np.flatnonzero(mask):
            episode = casting.draw(randoms[i])
            rig = casting.cast(episode, self._model)
            for name, own in self._own.items():
                own[i] = casting.value(episode, name)
            begin(rig, self._scratch, randoms[i], self._reset_noise)
            self._task.cast(int(i), episode)
            mujoco.mj_getState(self._model, self._scratch, self._batch.state[i], STATE)
            for name in READ:
                getattr(self._now, name)[i] = getattr(self._scratch, name)
            for name, value in episode.told.items():
                told.setdefault(name, np.zeros(self.num_envs))[i] = value
        self._task.begin(mask, self._now, randoms)
        self._done &= ~mask
        return _marked(told, mask)

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[Observations, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Hold ``actions`` (num_envs, 1) for one interval; raises InputError if one that counts is no number.

        What is said to an environment that is about to be reset does not count.
        """
        live = ~self._done
        chosen = checked(actions, (self.num_envs, 1), live)[:, 0]
        randoms = self._randoms
        if randoms is None:
            raise InputError("reset the environments before stepping them")
        if not live.all() and self._mode != AutoresetMode.NEXT_STEP:
            raise InputError("an episode has ended: reset it (options={'reset_mask': ...}) before the next step")
        infos = self._begin(~live, randoms)
        command = self._task.command(chosen)
        self._ctrl[live, : len(DRIVES)] = self._task.slopes()[live]
        for steps, asked in self._task.due(command, live):
            self._ctrl[live, self._rig.actuator.ctrl] = asked[live]
            with suppress(SimulationError):  # a failed device ends its episode
                batch.step(self._batch, np.flatnonzero(live), steps)
        for name, value in self._bound.items():
            getattr(self._now, name)[live] = value[live]
        reward, terminated, truncated, told = self._task.judge(chosen, command, self._now, live, randoms)
        self._done = terminated | truncated
        if self._mode == AutoresetMode.SAME_STEP and self._done.any():
            ended = self._done.copy()
            final = np.full(self.num_envs, None, dtype=object)
            observed = self._task.observed
            for i in np.flatnonzero(ended):
                final[i] = observed[i]
            infos |= {"final_obs": final, "_final_obs": ended, "final_info": _marked(told, ended), "_final_info": ended}
            live = live & ~ended
            infos |= self._begin(ended, randoms)
        return self._task.observed, reward, terminated, truncated, infos | _marked(told, live)


def _marked(told: dict[str, NDArray[np.float64]], which: Flags) -> dict[str, Any]:
    """``told`` as Gymnasium has it: 0 where an environment did not say it, and a mask ``_name`` of those that did."""
    marked: dict[str, Any] = {}
    if not which.any():
        return marked
    for name, value in told.items():
        marked[name], marked[f"_{name}"] = np.where(which, value, 0.0), which.copy()
    return marked
