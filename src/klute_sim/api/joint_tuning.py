"""Tune the PID controller of a joint: :func:`tune_joint` and its result :class:`JointTuningResult`."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from klute_sim.api.inputs import DeviceLike, to_device
from klute_sim.api.search_result import SearchResult, run_search
from klute_sim.envs.antagonist_joint import DEFAULT_JOINT_DEVICE
from klute_sim.envs.joint_pid import DEFAULT_GAINS
from klute_sim.parameter_sweep.store import open_store
from klute_sim.tuning.design_variables import DEFAULT_DEVICE_KEYS
from klute_sim.tuning.gain_variables import GainSpace
from klute_sim.tuning.joint_problem import (
    FINE_EPISODE_FACTOR,
    JointMetrics,
    JointTuningProblem,
    make_joint_weights,
)
from klute_sim.tuning.point_evaluation import PointEvaluation
from klute_sim.tuning.search import import_cma
from klute_sim.types import ProgressCallback

JointEvaluation = PointEvaluation[JointMetrics]


class JointTuningResult(SearchResult[JointTuningProblem, JointEvaluation]):
    """The evaluations of a search for gains, and the best of them in more episodes."""

    rig = "joint"

    @property
    def gains(self) -> dict[str, float]:
        """Tuned arguments of :class:`klute_sim.envs.joint_pid.PidController`."""
        return self.problem.space.decode(self.best.x)[1]

    @property
    def controller_numbers(self) -> dict[str, Any]:
        """Tuned gains."""
        return self.gains

    @property
    def scope(self) -> str:
        """Sentence that states the episodes."""
        episodes = FINE_EPISODE_FACTOR * self.problem.episodes
        return (
            f"The numbers are those of {episodes} episodes of {self.problem.seconds:g} s, half of them with targets "
            "that the search did not see."
        )

    def describe_metrics(self, evaluation: JointEvaluation) -> dict[str, Any] | None:
        """Return the metrics by column."""
        return None if evaluation.metrics is None else dict(evaluation.metrics)

    def format_metrics(self) -> list[list[str]]:
        """Return the metrics before and after tuning."""
        before, tuned = (self.describe_metrics(evaluation) or {} for evaluation in (self.initial, self.best))
        return [[column, *(f"{values[column]:.3f}" for values in (before, tuned))] for column in before]


def tune_joint(
    device: DeviceLike = DEFAULT_JOINT_DEVICE,
    *,
    gains: Mapping[str, float] | None = None,
    gain_keys: Sequence[str] = tuple(DEFAULT_GAINS),
    with_device: bool = False,
    device_keys: Sequence[str] = (),
    weights: Mapping[str, float] | None = None,
    load: float | None = None,
    episodes: int = 8,
    seconds: float = 5.0,
    budget: int = 150,
    seed: int = 0,
    folder: str | Path | None = None,
    n_jobs: int = 0,
    progress: ProgressCallback | None = None,
) -> JointTuningResult:
    """Tune the PID controller of the joint of ``klute_sim/AntagonistJoint``, optionally with the devices.

    The objective is the root mean square error of the angle [deg] plus 10 times the root mean square change of the
    actions in 10 ms (:mod:`klute_sim.tuning.joint_problem`). The search is CMA-ES. Evaluations are stored in ``folder``
    as they finish; an interrupted search resumes there.

    Args:
        device: Device on both tendons: a device, name of a preset, or path of a device file.
        gains: Initial gains that differ from the defaults, by argument of
            :class:`klute_sim.envs.joint_pid.PidController`.
        gain_keys: Gains to tune.
        with_device: Whether to tune orifices, springs, resting length and mounting, too.
        device_keys: Further numbers of the device to tune (``section.key``).
        weights: Weights of angle [1/deg] and smoothness [1]; None: 1 and 10.
        load: Mass at the end of the lever [kg]. None: that of the model.
        episodes: Number of episodes of an evaluation; the best points have twice as many at the end.
        seconds: Duration of an episode [s].
        budget: Number of evaluations, rounded up to a whole generation.
        seed: Random seed of the search and of the first target.
        folder: Folder of the evaluations, new, empty or of the same search; None: the next ``runs/tune-joint-NNN``.
        n_jobs: Number of worker processes; 0: one per core.
        progress: Receives the completed fraction and the current stage.

    Raises InputError when an input is not usable, MissingExtraError without the package cma.
    """
    keys = tuple(dict.fromkeys([*(DEFAULT_DEVICE_KEYS if with_device else ()), *device_keys]))
    problem = JointTuningProblem(
        space=GainSpace(to_device(device), {**DEFAULT_GAINS, **(gains or {})}, tuple(gain_keys), keys),
        weights=make_joint_weights(weights or {}),
        load_kg=load,
        episodes=episodes,
        seconds=seconds,
        seed=seed,
    )
    import_cma()  # before a folder is made
    store = open_store(folder, problem.describe(), "tune-joint")
    return JointTuningResult(problem, *run_search(problem, budget, store, n_jobs, progress), store.folder)
