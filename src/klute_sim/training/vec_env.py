"""The batch of environments as Stable-Baselines3 takes it; import it only where that is installed."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from klute_sim.envs.ankle_gait_vector import AnkleGaitVectorEnv
from klute_sim.errors import KluteSimError

OBSERVATION_SCALE = np.array([0.2, 2.0, 0.5, 3.0, 1.0, 3.0, 1.0, 1.0], dtype=np.float32)
"""Usual sizes of the observations, in their units (assumed: those of walking)."""


class GaitVecEnv(VecEnv):  # type: ignore[misc]
    """Observations over :data:`SCALE`; episodes begin anew in the step that ends them."""

    def __init__(self, n_envs: int, seed: int, options: dict[str, Any]) -> None:
        """``count`` environments with these keywords; the first reset is with ``seed``."""
        self.envs = AnkleGaitVectorEnv(n_envs, autoreset_mode=AutoresetMode.SAME_STEP, **options)
        inner = self.envs.single_observation_space
        assert isinstance(inner, spaces.Box)
        space: Any = spaces.Box(inner.low / OBSERVATION_SCALE, inner.high / OBSERVATION_SCALE, dtype=np.float32)
        super().__init__(n_envs, space, self.envs.single_action_space)
        self._seed: int | None = seed
        self._actions: Any = None
        self._returns, self._lengths = np.zeros(n_envs), np.zeros(n_envs, dtype=np.int64)

    def reset(self) -> NDArray[np.float32]:
        """All of them."""
        observed, _ = self.envs.reset(seed=self._seed)
        self._seed = None
        self._returns[:], self._lengths[:] = 0.0, 0
        return observed / OBSERVATION_SCALE

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """What is done in :meth:`step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """One step of all, with what Stable-Baselines3 wants to know of those that have ended."""
        observed, reward, terminated, truncated, told = self.envs.step(self._actions)
        done = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        self._returns += reward
        self._lengths += 1
        for i in np.flatnonzero(done).tolist():
            infos[i] = {
                "terminal_observation": told["final_obs"][i] / OBSERVATION_SCALE,
                "TimeLimit.truncated": bool(truncated[i]),
                "episode": {"r": float(self._returns[i]), "l": int(self._lengths[i])},
            }
        self._returns[done], self._lengths[done] = 0.0, 0
        return observed / OBSERVATION_SCALE, reward.astype(np.float32), done, infos

    def close(self) -> None:
        """Nothing to free."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Of the batch, once for each."""
        return [getattr(self.envs, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Raises KluteSimError: one simulation of a batch cannot be set apart."""
        raise KluteSimError(f"'{attr_name}' cannot be set: the simulations of a batch have no attributes of their own")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Raises KluteSimError, likewise."""
        raise KluteSimError(f"'{method_name}' cannot be called: simulations of a batch have no methods of their own")

    def env_is_wrapped(self, wrapper_class: Any, indices: Sequence[int] | int | None = None) -> list[bool]:
        """They are not."""
        return [False for _ in self._get_indices(indices)]
