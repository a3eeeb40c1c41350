"""Train a control policy by reinforcement learning: :func:`train` and its result :class:`TrainingResult`."""

import json
import math
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from klute_sim.api.inputs import stage_progress
from klute_sim.api.rendering import Printable, Summary
from klute_sim.device.schema.foot import parse_foot_name
from klute_sim.errors import InputError
from klute_sim.gait.subject import resolve_subject
from klute_sim.recording.atomic_file import replace_atomically, write_atomically
from klute_sim.training.config import load_subject_config
from klute_sim.training.evaluate import compare_with_baseline
from klute_sim.training.folder import open_training_folder
from klute_sim.training.training import Training, open_training
from klute_sim.types import ProgressCallback

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

    from klute_sim.controllers.policy import Policy

DEFAULT_TRAINING_MINUTES = 20.0
"""Duration of a training without a limit [min]."""


@dataclass(frozen=True, repr=False)
class TrainingResult(Printable):
    """A finished training: the policy, its learning curve, and its comparison with a baseline."""

    training: Training
    """Training in its folder, which can be resumed."""
    comparison: dict[str, Any]
    """Mean totals of an episode with the policy and with the baseline, and the gain in return."""
    n_resumed_steps: int
    """Number of steps that the training in the folder had made before it resumed; 0 for a new training."""

    @property
    def folder(self) -> Path:
        """Folder of the training."""
        return self.training.folder

    @cached_property
    def policy(self) -> "Policy":
        """Trained policy as plain numbers, which runs on NumPy alone."""
        return self.training.export_policy()

    @property
    def learning_curve(self) -> list[tuple[float, ...]]:
        """Rows of the learning curve (:data:`klute_sim.training.training.LEARNING_CURVE_COLUMNS`)."""
        return self.training.progress.learning_curve

    @property
    def summary(self) -> dict[str, Any]:
        """Content of summary.json."""
        progress = self.training.progress
        return {
            "env": self.training.config.env,
            "algorithm": self.training.config.algorithm,
            "environment": self.training.config.environment,
            "seed": progress.seed,
            "minutes": progress.minutes,
            "steps": progress.steps,
            **self.comparison,
            "folder": str(self.folder),
        }

    def format_summary(self) -> Summary:
        """Yield the table of mean totals and the gain over the baseline."""
        yield self._build_table()
        summary = self.summary
        yield (
            f"The policy is better in {summary['n_better_episodes']} of {summary['episodes']} episodes; "
            f"mean gain in return {summary['gain']:.2f} ± {summary['gain_standard_error']:.2f} (standard error)."
        )

    def _build_table(self) -> "Table":
        from klute_sim.terminal_table import create_table

        summary = self.summary
        title = (
            f"{summary['algorithm'].upper()}, seed {summary['seed']}: {summary['steps']} steps in "
            f"{summary['minutes']:.1f} min"
        )
        table = create_table(title=title)
        table.add_column("mean per episode")
        table.add_column("policy", justify="right", style="bold")
        table.add_column(summary["baseline_name"].replace(" ", "\n"), justify="right")
        for name, value in summary["policy"].items():
            digits = 3 if name == "air_g" else 2
            table.add_row(name.replace("_", " "), f"{value:.{digits}f}", f"{summary['baseline'][name]:.{digits}f}")
        return table

    def __repr__(self) -> str:
        """Return one line: algorithm, steps, gain, and the folder."""
        summary = self.summary
        return (
            f"TrainingResult({summary['algorithm']}, {summary['steps']} steps, gain {summary['gain']:.2f}, "
            f"folder={summary['folder']!r})"
        )

    def plot(self) -> "Figure":
        """Return the figure of the learning curve."""
        from klute_sim.report.training.figure import build_figure

        return build_figure(self.learning_curve, self.summary)

    def save(self, folder: str | Path | None = None) -> Path:
        """Write policy.npz, figure.png, index.html and summary.json into ``folder``; None: the folder of the training.

        Returns the folder.
        """
        from klute_sim.report.run_page import FIGURE_FILE, write_run_page
        from klute_sim.report.style import save_figure
        from klute_sim.report.training.figure import DESCRIPTION

        target = self.folder if folder is None else Path(folder)
        target.mkdir(parents=True, exist_ok=True)
        with replace_atomically(target / "policy.npz") as temporary:
            self.policy.save(temporary)
        save_figure(self.plot(), target / FIGURE_FILE)
        write_atomically(target / "summary.json", json.dumps(self.summary, indent=2, allow_nan=False) + "\n")
        title = f"Training of a policy: {self.summary['env']}, {self.summary['algorithm'].upper()}"
        write_run_page(target, title, self.format_summary(), {FIGURE_FILE: DESCRIPTION})
        return target


def train(
    config: str | Path | None = None,
    *,
    env: str | None = None,
    minutes: float | None = None,
    steps: int | None = None,
    seed: int | None = None,
    reference: str | Path | None = None,
    foot: str | None = None,
    stride_time: float | None = None,
    accept: Collection[str] = (),
    mass: float | None = None,
    stature: float | None = None,
    speed: float | None = None,
    slope: float | None = None,
    folder: str | Path | None = None,
    progress: ProgressCallback | None = None,
) -> TrainingResult:
    """Train a control policy and compare it with a baseline in the same episodes.

    The baseline of the gait rig is the hand-tuned profile, that of a predicted walk the base controller, and that of
    the joint a PID controller. The numbers of a subject replace those of the configuration; ranges of its domain
    randomisation stay. The joint has no subject.

    Args:
        config: Path of a configuration file (TOML); None: the shipped one, or that of the training in ``folder``.
        env: ``"gait"``, the gait rig, ``"walk"``, a person who walks by muscles and reflexes, or ``"joint"``, a joint
            with two muscles. None: that of the configuration, or the gait rig.
        minutes: Total duration [min], without interruptions; None: 20, unless ``steps`` is given.
        steps: Total number of environment steps in place of ``minutes``; such a training is reproducible.
        seed: Random seed; None: 0, or that of the training in ``folder``.
        reference: Path of the file or folder of a reference gait. None: that of the configuration (able-bodied adults).
        foot: Foot below the ankle, such as ``"sach"`` or, in a shoe, ``"sach+shoe"``. None: that of the device.
        stride_time: Stride time of the reference [s]. None: the time that it states, or 1.1.
        accept: Names of findings about the reference file that are right although they look implausible.
        mass: Body mass [kg]. None: the mass that the reference states, or 75.
        stature: Stature [m]. None: the stature that the reference states, or 1.75.
        speed: Nominal walking speed [m/s]. None: the speed that reference and leg length imply.
        slope: Nominal ground slope [deg], uphill positive. None: 0.
        folder: Folder of the training; None: the next ``runs/train-NNN``. A training in it resumes.
        progress: Receives the completed fraction and the current stage.

    Raises InputError when inputs do not go together, MissingExtraError without Stable-Baselines3.
    """
    if minutes is not None and steps is not None:
        raise InputError("minutes and steps exclude each other; give one of them")
    subject = _collect_subject(reference, foot, stride_time, accept, mass, stature, speed, slope)
    if config is not None or env is not None or subject:
        settings, _ = load_subject_config(config, subject, env)  # before a folder is made
        if settings.env == "gait":
            _check_subject(settings.environment)
    lock = open_training_folder(folder)
    try:
        training = open_training(lock.folder, config, seed, subject, env)
    except BaseException:
        lock.release()
        with suppress(OSError):  # it has files of an earlier attempt
            lock.folder.rmdir()
        raise
    with lock:
        return _run(training, minutes, steps, progress)


def _collect_subject(
    reference: str | Path | None,
    foot: str | None,
    stride_time: float | None,
    accept: Collection[str],
    mass: float | None,
    stature: float | None,
    speed: float | None,
    slope: float | None,
) -> dict[str, Any]:
    """Return the given values as keywords of the environment, in the types of a configuration file."""
    values = {
        "reference": None if reference is None else str(reference),
        "foot": foot,
        "stride_time": stride_time,
        "accept": list(accept) or None,
        "mass": mass,
        "stature": stature,
        "speed": speed,
        "slope": None if slope is None else math.radians(slope),
    }
    return {name: value for name, value in values.items() if value is not None}


def _check_subject(environment: Mapping[str, Any]) -> None:
    """Raise InputError when the rig does not take the subject or the foot of the keywords ``environment``."""
    names = ("reference", "stride_time", "accept", "mass", "stature", "speed")
    slope = math.degrees(environment.get("slope", 0.0))
    if "foot" in environment:
        parse_foot_name(environment["foot"])
    resolve_subject(**{name: environment[name] for name in names if name in environment}, slope=slope)


def _run(
    training: Training, minutes: float | None, steps: int | None, progress: ProgressCallback | None
) -> TrainingResult:
    limit = DEFAULT_TRAINING_MINUTES if minutes is None and steps is None else minutes
    n_resumed_steps = training.progress.steps
    try:
        training.run(limit, steps, stage_progress(progress, "training"))
    except KeyboardInterrupt as interrupt:
        interrupt.add_note(
            f"Kept after {training.progress.steps} steps in {training.folder}; resume with: "
            f"klute-sim train --out {training.folder}"
        )
        raise
    settings = training.config
    if progress is not None:
        progress(1.0, "evaluating")
    comparison = compare_with_baseline(
        settings.training_environment,
        training.export_policy(),
        settings.environment,
        settings.evaluation_episodes,
        training.progress.seed,
    )
    return TrainingResult(training, comparison, n_resumed_steps)
