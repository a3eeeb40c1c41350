"""Training with Stable-Baselines3 on the vector environment: checkpoints, learning curve and resumption.

Stable-Baselines3 and torch are an optional extra and are imported when they are used.
"""

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.controllers.policy import Policy
from klute_sim.errors import InputError, MissingExtraError
from klute_sim.files.json import read_json
from klute_sim.files.limits import RESULT
from klute_sim.files.lines import read_csv_records
from klute_sim.files.reading import MissingFileError
from klute_sim.gait.code_digest import POLICY_KEY, compute_policy_digest
from klute_sim.provenance import collect_versions
from klute_sim.recording.atomic_file import replace_atomically, write_atomically
from klute_sim.training.checkpoint import load_checkpoint
from klute_sim.training.config import TrainingConfig, compute_reference_digest, load_config, load_subject_config
from klute_sim.training.evaluate import check_baseline
from klute_sim.training.folder import CHECKPOINT_FILE, CONFIG_FILE, LEARNING_CURVE_FILE, PROGRESS_FILE

LEARNING_CURVE_COLUMNS = ("minutes", "steps", "episodes", "episode_return", "episode_steps")
"""Columns of the learning curve: totals since the start, and means over the episodes that ended since the last row."""
INSTALLATION_ADVICE = (
    "; without a graphics card, first pip install torch --index-url https://download.pytorch.org/whl/cpu; "
    "without torch: python examples/cross_entropy.py (docs/training.md)"
)
"""End of the sentence without Stable-Baselines3: the default torch brings 4 GB of CUDA."""
UNLIMITED_STEPS = 10**12
"""Number of steps that a training never reaches."""


@dataclass
class TrainingProgress:
    """Progress of a training, stored in :data:`PROGRESS_FILE`."""

    seed: int
    """Random seed."""
    minutes: float = 0.0
    """Training time without interruptions [min]."""
    steps: int = 0
    """Number of steps of all environments together."""
    learning_curve: list[tuple[float, ...]] = field(default_factory=list)
    """Rows of the learning curve."""

    def set_steps(self, steps: int) -> None:
        """Follow the checkpoint, which a killed process may have written without its progress."""
        self.steps = steps
        self.learning_curve = [row for row in self.learning_curve if row[1] <= steps]


class Training:
    """A new or resumed training in one folder."""

    def __init__(self, folder: Path, config: TrainingConfig, progress: TrainingProgress) -> None:
        """Set up the training, from its checkpoint if there is one.

        Raises MissingExtraError without Stable-Baselines3, and InputError when its algorithm refuses a keyword, the
        environment refuses the actions of its baseline, or the checkpoint cannot be read.
        """
        try:
            import stable_baselines3
            import torch
        except ImportError:
            raise MissingExtraError("klute-sim train", "rl", INSTALLATION_ADVICE) from None
        from klute_sim.training.vec_env import TrainingVecEnv

        torch.set_num_threads(1)  # the networks are small: more threads would only take cores from the simulations
        self.folder, self.config, self.progress = folder, config, progress
        algorithm = getattr(stable_baselines3, config.algorithm.upper())
        # A resumed training samples other episodes than it started with.
        seed = progress.seed + progress.steps
        envs = TrainingVecEnv(config.training_environment, config.num_envs, seed, config.environment)
        check_baseline(config.training_environment, config.environment)
        activation = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}[config.activation]
        algorithm_options = config.algorithm_options
        policy_options = {"net_arch": list(config.hidden), "activation_fn": activation}
        try:
            policy_options |= algorithm_options.pop("policy_kwargs", {})
            self.model = algorithm(
                "MlpPolicy",
                envs,
                seed=progress.seed,
                device="cpu",
                policy_kwargs=policy_options,
                **algorithm_options,
            )
        except (AssertionError, TypeError, ValueError) as error:
            raise InputError(f"configuration: [{config.algorithm}] {error}") from None
        if (folder / CHECKPOINT_FILE).exists():
            load_checkpoint(self.model, folder / CHECKPOINT_FILE)
            progress.set_steps(self.model.num_timesteps)

    def run(self, minutes: float | None, steps: int | None, report_progress: Callable[[float], None]) -> None:
        """Train up to a total of ``minutes`` or ``steps``; ``report_progress`` receives the completed fraction.

        The model is saved however the training ends, also on an interruption by the user.
        """
        from stable_baselines3.common.callbacks import BaseCallback

        start, last_checkpoint, progress = time.monotonic(), time.monotonic(), self.progress
        minutes_before, steps_before = progress.minutes, progress.steps
        finished_episodes: list[tuple[float, int]] = []

        def elapsed_minutes() -> float:
            return minutes_before + (time.monotonic() - start) / 60.0

        class ProgressMonitor(BaseCallback):  # type: ignore[misc]
            def _on_step(monitor) -> bool:  # noqa: N805, `self` is the training here
                for info in monitor.locals["infos"]:
                    if "episode" in info:
                        finished_episodes.append((info["episode"]["r"], info["episode"]["l"]))
                progress.minutes = elapsed_minutes()
                progress.steps = steps_before + monitor.num_timesteps - first_timestep
                fraction = max(progress.minutes / minutes if minutes else 0.0, progress.steps / steps if steps else 0.0)
                report_progress(min(fraction, 1.0))
                return fraction < 1.0

            def _on_rollout_end(monitor) -> None:  # noqa: N805
                nonlocal last_checkpoint
                if len(finished_episodes) >= self.config.num_envs:
                    self._record_episodes(finished_episodes)
                    finished_episodes.clear()
                if time.monotonic() - last_checkpoint > 60.0 * self.config.checkpoint_minutes:
                    self.save()
                    last_checkpoint = time.monotonic()

        first_timestep = self.model.num_timesteps
        if (minutes and progress.minutes >= minutes) or (steps and progress.steps >= steps):
            return
        try:
            self.model.learn(UNLIMITED_STEPS, callback=ProgressMonitor(), reset_num_timesteps=False)
        finally:
            if finished_episodes:
                self._record_episodes(finished_episodes)
            self.save()

    def _record_episodes(self, episodes: list[tuple[float, int]]) -> None:
        returns, lengths = np.mean(episodes, axis=0)
        self.progress.learning_curve.append(
            (round(self.progress.minutes, 4), self.progress.steps, len(episodes), float(returns), float(lengths))
        )

    def save(self) -> None:
        """Write checkpoint, progress and learning curve, each atomically."""
        with replace_atomically(self.folder / CHECKPOINT_FILE) as temporary:
            self.model.save(temporary)
        self.save_progress()

    def save_progress(self) -> None:
        """Write progress and learning curve, each atomically."""
        text = json.dumps({"seed": self.progress.seed, "minutes": self.progress.minutes, "steps": self.progress.steps})
        write_atomically(self.folder / PROGRESS_FILE, text + "\n")
        rows = "".join(",".join(str(value) for value in row) + "\n" for row in self.progress.learning_curve)
        write_atomically(self.folder / LEARNING_CURVE_FILE, ",".join(LEARNING_CURVE_COLUMNS) + "\n" + rows)

    def export_policy(self) -> Policy:
        """Return the learned policy as plain numbers."""
        environment = self.config.training_environment
        network = self.model.policy
        if self.config.algorithm == "sac":
            modules = [network.actor.latent_pi, network.actor.mu]
        else:
            modules = [network.mlp_extractor.policy_net, network.action_net]
        linear_layers = [layer for module in modules for layer in module.modules() if hasattr(layer, "in_features")]
        layers = [(layer.weight.detach().numpy().copy(), layer.bias.detach().numpy().copy()) for layer in linear_layers]
        metadata = {
            "environment": environment.id,
            "config": self.config.model_dump(),
            "seed": self.progress.seed,
            "steps": self.progress.steps,
            "minutes": self.progress.minutes,
            "versions": collect_versions(),
            POLICY_KEY: compute_policy_digest(environment.id),
        }
        observation_scale = np.array(environment.observation_scale, dtype=np.float32)
        return Policy(observation_scale, layers, self.config.activation, network.squash_output, metadata)


def open_training(
    folder: Path,
    config_path: str | Path | None,
    seed: int | None,
    subject: Mapping[str, Any] | None = None,
    env: str | None = None,
) -> Training:
    """Return the training in the locked ``folder``: the one that it holds, else a new one.

    ``config_path`` and ``seed`` are those of the training; None: the shipped configuration and 0 for a new training.
    ``subject`` holds keywords of the environment, which replace those of the configuration; None: no keyword. ``env``
    names the environment; None: that of the configuration.

    Raises InputError when they differ from those of the training in the folder, or when it is damaged.
    """
    if (folder / CONFIG_FILE).exists():
        return _resume_training(folder, config_path, seed, subject or {}, env)
    config, content = load_subject_config(config_path, subject or {}, env)
    training = Training(folder, config, TrainingProgress(seed or 0))
    write_atomically(folder / CONFIG_FILE, content)
    training.save_progress()
    return training


def _resume_training(
    folder: Path, config_path: str | Path | None, seed: int | None, subject: Mapping[str, Any], env: str | None
) -> Training:
    config, content = load_config(folder / CONFIG_FILE, env)
    if config_path is not None and load_subject_config(config_path, subject)[1] != content:
        raise InputError(
            f"output folder {folder} holds a training with another configuration: leave the configuration out to "
            "resume it, or name a new or an empty folder"
        )
    check_same_subject(folder, config, subject)
    progress = _read_progress(folder) if (folder / PROGRESS_FILE).exists() else TrainingProgress(seed or 0)
    if seed is not None and seed != progress.seed:
        raise InputError(
            f"output folder {folder} holds a training with the seed {progress.seed}: leave the seed out to resume it, "
            "or name a new or an empty folder"
        )
    return Training(folder, config, progress)


def check_same_subject(folder: Path, config: TrainingConfig, subject: Mapping[str, Any]) -> None:
    """Raise InputError unless the training with ``config`` has this ``subject`` and its reference is unchanged."""
    given = {name: str(Path(value).absolute()) if name == "reference" else value for name, value in subject.items()}
    different = [name for name, value in given.items() if config.environment.get(name) != value]
    if different:
        raise InputError(
            f"output folder {folder} holds a training of another subject (other {', '.join(different)}): leave the "
            "subject out to resume it, or name a new or an empty folder"
        )
    stored_digest = config.reference_sha256
    if stored_digest is not None and stored_digest != compute_reference_digest(config.environment):
        raise InputError(
            f"reference {config.environment['reference']} has changed since the training in {folder} started: restore "
            "it, or name a new or an empty folder"
        )


def _read_progress(folder: Path) -> TrainingProgress:
    try:
        stored = read_json(folder / PROGRESS_FILE, RESULT)
        progress = TrainingProgress(int(stored["seed"]), float(stored["minutes"]), int(stored["steps"]))
        rows = read_csv_records(folder / LEARNING_CURVE_FILE, RESULT)
        progress.learning_curve = [tuple(float(cell) for cell in row.values()) for row in rows]
    except MissingFileError:  # killed before the first row was written
        return progress
    except (InputError, AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"the training in {folder} cannot be resumed: {error}") from None
    return progress
