"""Tune a state machine in predicted walks: :func:`tune_walk` and its result :class:`WalkTuningResult`."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from klute_sim.api.inputs import DeviceLike, to_device
from klute_sim.api.search_result import SearchResult, run_search
from klute_sim.controllers.state_machine import StateMachine, load_default_state_machine, load_state_machine
from klute_sim.parameter_sweep.store import open_store
from klute_sim.parameter_sweep.walk_plan import NO_PUSH
from klute_sim.tuning.design_variables import DEFAULT_DEVICE_KEYS
from klute_sim.tuning.machine_variables import DEFAULT_MACHINE_KEYS, MachineSpace
from klute_sim.tuning.search import import_cma
from klute_sim.tuning.walk_objective import make_walk_weights
from klute_sim.tuning.walk_problem import FINE_DURATION_FACTOR, WalkEvaluation, WalkTuningProblem
from klute_sim.types import ProgressCallback
from klute_sim.walker.person.build import Prosthesis
from klute_sim.walker.reflexes.walker_file import Walker, load_walker
from klute_sim.walker.simulation.simulate import select_adapted_walkers

ROWS = {
    "cost_minetti": "cost, Minetti and Alexander [J/kg/m]",
    "cost_bhargava": "cost, Bhargava et al. [J/kg/m]",
    "speed": "speed [m/s]",
    "asymmetry": "size of the step asymmetry [1]",
    "peak_load_left": "peak load, intact leg [body weights]",
    "device_work": "net work of the device per stride [J]",
}
"""Label of each metric in the table."""
ACUTE_REMARK = (
    "Predicted and acute (planar reflex model): the persons have adapted to the default state machine and not to the "
    "tuned one; adapt walkers to it with klute-sim walk adapt for a fair comparison."
)


class WalkTuningResult(SearchResult[WalkTuningProblem, WalkEvaluation]):
    """The evaluations of a search in predicted walks, and the best of them in longer walks."""

    rig = "walk"

    @property
    def machine(self) -> StateMachine:
        """Tuned state machine."""
        return self.problem.space.decode(self.best.x)[1]

    @property
    def controller_numbers(self) -> dict[str, Any]:
        """Tuned numbers of the state machine."""
        return {name: value for name, value in self.machine.describe().items() if name != "kind"}

    @property
    def scope(self) -> str:
        """Sentence that states the walks, and that they are acute."""
        names = ", ".join(walker.name for walker in self.problem.walkers)
        return f"Means over walks of {FINE_DURATION_FACTOR * self.problem.seconds:g} s of {names}. {ACUTE_REMARK}"

    def describe_metrics(self, evaluation: WalkEvaluation) -> dict[str, Any] | None:
        """Return the means over the walks by name."""
        return None if evaluation.metrics is None else asdict(evaluation.metrics)

    def format_metrics(self) -> list[list[str]]:
        """Return the outcomes before and after tuning."""
        both = [self.describe_metrics(evaluation) or {} for evaluation in (self.initial, self.best)]
        rows = [
            [label, *("-" if metrics.get(key) is None else f"{metrics[key]:.3f}" for metrics in both)]
            for key, label in ROWS.items()
        ]
        falls = [f"{metrics['n_falls']} of {metrics['n_walks']}" if metrics else "-" for metrics in both]
        return [*rows, ["falls", *falls]]

    def count_falls(self, evaluation: WalkEvaluation) -> int | str:
        """Return the number of walks that end in a fall; '' where a simulation failed."""
        return "" if evaluation.metrics is None else evaluation.metrics.n_falls


def tune_walk(
    device: DeviceLike = "klute-1-1-4-pair",
    *,
    machine: StateMachine | str | Path | None = None,
    machine_keys: Sequence[str] = DEFAULT_MACHINE_KEYS,
    foot: str | None = None,
    with_device: bool = False,
    device_keys: Sequence[str] = (),
    weights: Mapping[str, float] | None = None,
    walkers: Sequence[Walker | str | Path] = (),
    speed: float = 1.25,
    seconds: float = 10.0,
    uneven: float = 0.0,
    pushes: Sequence[tuple[float, float]] = (NO_PUSH,),
    budget: int = 150,
    seed: int = 0,
    folder: str | Path | None = None,
    n_jobs: int = 0,
    progress: ProgressCallback | None = None,
) -> WalkTuningResult:
    """Tune a state machine, optionally with the device, for persons who walk by muscles and reflexes.

    The objective is the mean over persons and pushes of the metabolic cost (mean of both laws), the deviation from the
    target speed and the step asymmetry; falls cost more than any walk (:mod:`klute_sim.tuning.walk_objective`). The
    persons do not adapt to what is tuned, so the result is *acute*. The search is CMA-ES. Evaluations are stored in
    ``folder`` as they finish; an interrupted search resumes there.

    Args:
        device: Device, name of a preset, or path of a device file.
        machine: Initial state machine or the path of its file; None: the default one.
        machine_keys: Numbers of the state machine to tune.
        foot: Foot below the ankle, such as ``"sach"``. None: that of the device.
        with_device: Whether to tune orifices, springs, resting length and mounting, too.
        device_keys: Further numbers of the device to tune (``section.key``).
        weights: Weights of effort [kg.m/J], speed [s/m] and symmetry [1]; None: 1, 10 and 10.
        walkers: Walkers, names of shipped ones, or paths; empty: the shipped ones that have adapted to the device with
            the default state machine, or to the nearest device.
        speed: Target speed [m/s].
        seconds: Duration of a walk of the search [s]; the best points walk twice as long at the end.
        uneven: Largest height of the blocks on the ground [mm].
        pushes: Pushes, each in walks of its own: impulse [N.s] and phase of the right leg's stride [%].
        budget: Number of evaluations, rounded up to a whole generation.
        seed: Random seed of search and ground.
        folder: Folder of the evaluations, new, empty or of the same search; None: the next ``runs/tune-walk-NNN``.
        n_jobs: Number of worker processes; 0: one per core.
        progress: Receives the completed fraction and the current stage.

    Raises InputError when an input is not usable, MissingExtraError without the package cma.
    """
    chosen = to_device(device, foot)
    start = load_default_state_machine() if machine is None else machine
    keys = tuple(dict.fromkeys([*(DEFAULT_DEVICE_KEYS if with_device else ()), *device_keys]))
    persons = [walker if isinstance(walker, Walker) else load_walker(walker) for walker in walkers]
    problem = WalkTuningProblem(
        space=MachineSpace(
            chosen, start if isinstance(start, StateMachine) else load_state_machine(start), tuple(machine_keys), keys
        ),
        walkers=tuple(persons or select_adapted_walkers(Prosthesis(device=chosen))),
        weights=make_walk_weights(weights or {}),
        speed=speed,
        seconds=seconds,
        unevenness_mm=uneven,
        pushes=tuple(pushes),
        seed=seed,
    )
    import_cma()  # before a folder is made
    store = open_store(folder, problem.describe(), "tune-walk")
    return WalkTuningResult(problem, *run_search(problem, budget, store, n_jobs, progress), store.folder)
