"""The vector environment in the interface of Stable-Baselines3; import this module only where that is installed."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from klute_sim.errors import KluteSimError
from klute_sim.training.environments import TrainingEnvironment

REWARD_SCALE = 0.03
"""Factor of the reward that the algorithm gets: about 1 - gamma, so that the value of a state is about the mean reward.

A critic starts at 0. Without the factor, it would take most of a short training to reach values of 30, and until then
its errors would hide what an action changes. The returns in the learning curve and in the evaluation are without it.
"""


class TrainingVecEnv(VecEnv):  # type: ignore[misc]
    """Vector environment with scaled observations and rewards, whose ended episodes restart in the same step.

    Observations are divided by the scale of their environment, rewards multiplied by :data:`REWARD_SCALE`.
    """

    def __init__(self, environment: TrainingEnvironment, n_envs: int, seed: int, options: dict[str, Any]) -> None:
        """Create ``n_envs`` of an ``environment`` with the keywords ``options``; the first reset uses ``seed``."""
        self.envs = environment.make_envs(n_envs, autoreset_mode=AutoresetMode.SAME_STEP, **options)
        unscaled = self.envs.single_observation_space
        assert isinstance(unscaled, spaces.Box)
        self._scale = np.array(environment.observation_scale, dtype=np.float32)
        space: Any = spaces.Box(unscaled.low / self._scale, unscaled.high / self._scale, dtype=np.float32)
        super().__init__(n_envs, space, self.envs.single_action_space)
        self._seed: int | None = seed
        self._actions: Any = None
        self._returns, self._lengths = np.zeros(n_envs), np.zeros(n_envs, dtype=np.int64)

    def reset(self) -> NDArray[np.float32]:
        """Reset all environments."""
        observations, _ = self.envs.reset(seed=self._seed)
        self._seed = None
        self._returns[:], self._lengths[:] = 0.0, 0
        return observations / self._scale

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Store the actions of the next :meth:`step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Step all environments and report ended episodes in the form of Stable-Baselines3."""
        observations, reward, terminated, truncated, info = self.envs.step(self._actions)
        is_done = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        self._returns += reward
        self._lengths += 1
        for i in np.flatnonzero(is_done).tolist():
            infos[i] = {
                "terminal_observation": info["final_obs"][i] / self._scale,
                "TimeLimit.truncated": bool(truncated[i]),
                "episode": {"r": float(self._returns[i]), "l": int(self._lengths[i])},
            }
        self._returns[is_done], self._lengths[is_done] = 0.0, 0
        return observations / self._scale, (REWARD_SCALE * reward).astype(np.float32), is_done, infos

    def close(self) -> None:
        """Release the environments."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return the attribute of the batch once for each environment."""
        return [getattr(self.envs, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Raise KluteSimError: attributes of single environments cannot be set."""
        raise KluteSimError(f"'{attr_name}' cannot be set: single environments of a batch have no attributes")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Raise KluteSimError: methods of single environments cannot be called."""
        raise KluteSimError(f"'{method_name}' cannot be called: single environments of a batch have no methods")

    def env_is_wrapped(self, wrapper_class: Any, indices: Sequence[int] | int | None = None) -> list[bool]:
        """Return False for each environment."""
        return [False for _ in self._get_indices(indices)]
