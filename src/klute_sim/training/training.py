"""A training: Stable-Baselines3 on the batch of environments, kept as it goes, told from and gone on with.

Stable-Baselines3 and torch are an optional extra and are imported when they are used.
"""

import csv
import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from klute_sim.controllers.policy import Policy
from klute_sim.errors import InputError, MissingExtraError
from klute_sim.provenance import collect_versions
from klute_sim.training.config import TrainingConfig, load_config

CONFIG_FILE, CHECKPOINT_FILE, PROGRESS_FILE, LEARNING_CURVE_FILE = (
    "config.toml",
    "checkpoint.zip",
    "progress.json",
    "learning_curve.csv",
)
LEARNING_CURVE_COLUMNS = ("minutes", "steps", "episodes", "episode_return", "episode_steps")
"""Of the learning curve: since the start; of the episodes that ended since the last row, their mean."""
UNLIMITED_STEPS = 10**12
"""Steps that nobody waits for."""


@dataclass
class TrainingProgress:
    """How far a training has come; in :data:`PROGRESS`."""

    seed: int
    minutes: float = 0.0
    """Of training, interruptions left out."""
    steps: int = 0
    """Of environments, all of them together."""
    learning_curve: list[tuple[float, ...]] = field(default_factory=list)
    """The learning curve."""


class Training:
    """One training in one folder, begun or gone on with."""

    def __init__(self, folder: Path, config: TrainingConfig, progress: TrainingProgress) -> None:
        """Raises MissingExtraError without Stable-Baselines3, InputError for keywords that its algorithm has not."""
        try:
            import stable_baselines3
            import torch
        except ImportError:
            raise MissingExtraError("klute-sim train", "rl") from None
        from klute_sim.training.vec_env import GaitVecEnv

        torch.set_num_threads(
            1
        )  # the networks are small: more threads wait for one another, and take the simulations' cores
        self.folder, self.config, self.progress = folder, config, progress
        algorithm = getattr(stable_baselines3, config.algorithm.upper())
        # A training that is gone on with draws other episodes than it began with.
        envs = GaitVecEnv(config.num_envs, progress.seed + progress.steps, config.environment)
        if (folder / CHECKPOINT_FILE).exists():
            self.model = algorithm.load(folder / CHECKPOINT_FILE, env=envs, device="cpu")
            return
        function = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}[config.activation]
        shape = {"net_arch": list(config.hidden), "activation_fn": function}
        try:
            self.model = algorithm(
                "MlpPolicy", envs, seed=progress.seed, device="cpu", policy_kwargs=shape, **config.algorithm_options
            )
        except TypeError as error:
            raise InputError(f"configuration: [{config.algorithm}] {error}") from None

    def run(self, minutes: float | None, steps: int | None, report_progress: Callable[[float], None]) -> None:
        """Train until so many ``minutes`` or ``steps`` have been in all; ``told`` hears the finished share.

        Whatever ends it, also the user, what has been learned is kept.
        """
        from stable_baselines3.common.callbacks import BaseCallback

        began, saved, progress = time.monotonic(), time.monotonic(), self.progress
        minutes_before, steps_before = progress.minutes, progress.steps
        ended: list[tuple[float, int]] = []

        def now() -> float:
            return minutes_before + (time.monotonic() - began) / 60.0

        class Watch(BaseCallback):  # type: ignore[misc]
            def _on_step(watch) -> bool:  # noqa: N805, the training is `self` here
                for info in watch.locals["infos"]:
                    if "episode" in info:
                        ended.append((info["episode"]["r"], info["episode"]["l"]))
                progress.minutes, progress.steps = now(), steps_before + watch.num_timesteps - first
                share = max(progress.minutes / minutes if minutes else 0.0, progress.steps / steps if steps else 0.0)
                report_progress(min(share, 1.0))
                return share < 1.0

            def _on_rollout_end(watch) -> None:  # noqa: N805
                nonlocal saved
                if len(ended) >= self.config.num_envs:
                    self._record_episodes(ended)
                    ended.clear()
                if time.monotonic() - saved > 60.0 * self.config.checkpoint_minutes:
                    self.save()
                    saved = time.monotonic()

        first = self.model.num_timesteps
        try:
            self.model.learn(UNLIMITED_STEPS, callback=Watch(), reset_num_timesteps=False)
        finally:
            if ended:
                self._record_episodes(ended)
            self.save()

    def _record_episodes(self, finished: list[tuple[float, int]]) -> None:
        returns, lengths = np.mean(finished, axis=0)
        self.progress.learning_curve.append(
            (round(self.progress.minutes, 4), self.progress.steps, len(finished), float(returns), float(lengths))
        )

    def save(self) -> None:
        """Write checkpoint, progress and learning curve, each whole or not at all."""
        unfinished = self.folder / f".{CHECKPOINT_FILE}"
        self.model.save(unfinished)
        unfinished.replace(self.folder / CHECKPOINT_FILE)
        text = json.dumps({"seed": self.progress.seed, "minutes": self.progress.minutes, "steps": self.progress.steps})
        _write_atomically(self.folder / PROGRESS_FILE, text + "\n")
        rows = "".join(",".join(str(value) for value in row) + "\n" for row in self.progress.learning_curve)
        _write_atomically(self.folder / LEARNING_CURVE_FILE, ",".join(LEARNING_CURVE_COLUMNS) + "\n" + rows)

    def export_policy(self) -> Policy:
        """What has been learned, as plain numbers."""
        from klute_sim.training.vec_env import OBSERVATION_SCALE

        network, squashed = self.model.policy, self.config.algorithm == "sac"
        parts = [network.actor.latent_pi, network.actor.mu] if squashed else [network.mlp_extractor.policy_net]
        linear = [each for part in parts for each in part.modules() if hasattr(each, "in_features")]
        if not squashed:
            linear.append(network.action_net)
        layers = [(each.weight.detach().numpy().copy(), each.bias.detach().numpy().copy()) for each in linear]
        made = {
            "environment": "klute_sim/AnkleGait-v1",
            "config": self.config.model_dump(),
            "seed": self.progress.seed,
            "steps": self.progress.steps,
            "minutes": self.progress.minutes,
            "versions": collect_versions(),
        }
        return Policy(OBSERVATION_SCALE, layers, self.config.activation, squashed, made)


def start_training(folder: Path, config: TrainingConfig, content: bytes, seed: int) -> Training:
    """A training in the new ``folder`` that keeps its configuration's ``content``."""
    training = Training(folder, config, TrainingProgress(seed))
    (folder / CONFIG_FILE).write_bytes(content)
    return training


def resume_training(folder: Path) -> Training:
    """The training that was kept in ``folder``. Its checkpoint is a pickle: *it can run code*.

    Raises InputError if there is none.
    """
    try:
        kept = json.loads((folder / PROGRESS_FILE).read_text("utf-8"))
        progress = TrainingProgress(int(kept["seed"]), float(kept["minutes"]), int(kept["steps"]))
        rows = list(csv.reader((folder / LEARNING_CURVE_FILE).read_text("utf-8").splitlines()))[1:]
        progress.learning_curve = [tuple(float(cell) for cell in row) for row in rows]
    except OSError as error:
        raise InputError(f"there is no training to resume in {folder}: {error.filename}: {error.strerror}") from None
    except (KeyError, ValueError) as error:
        raise InputError(f"the training in {folder} cannot be resumed: {error}") from None
    return Training(folder, load_config(folder / CONFIG_FILE)[0], progress)


def _write_atomically(path: Path, text: str) -> None:
    unfinished = path.with_name(f".{path.name}")
    unfinished.write_text(text, "utf-8")
    unfinished.replace(path)
