"""Tune a state machine in predicted walks: :func:`tune_walk` and its result :class:`WalkTuningResult`."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from klute_sim.api.inputs import DeviceLike, to_device
from klute_sim.api.rendering import Summary, render_html, render_text
from klute_sim.api.sweep import explain_interrupt
from klute_sim.controllers.state_machine import StateMachine, load_default_state_machine, load_state_machine
from klute_sim.device.device import Device
from klute_sim.files.toml import format_toml
from klute_sim.parameter_sweep.local import LocalRunner
from klute_sim.parameter_sweep.store import ResultStore, open_store
from klute_sim.parameter_sweep.walk_plan import NO_PUSH
from klute_sim.recording.atomic_file import replace_atomically, write_atomically
from klute_sim.tuning.design_variables import DEFAULT_DEVICE_KEYS
from klute_sim.tuning.machine_variables import DEFAULT_MACHINE_KEYS, MachineSpace
from klute_sim.tuning.search import (
    MAX_REEVALUATIONS,
    REEVALUATED_FRACTION,
    import_cma,
    optimize,
    reevaluate,
    select_best,
)
from klute_sim.tuning.walk_objective import make_walk_weights
from klute_sim.tuning.walk_problem import FINE_DURATION_FACTOR, WalkEvaluation, WalkTuningProblem
from klute_sim.types import ProgressCallback
from klute_sim.walker.person.build import Prosthesis
from klute_sim.walker.reflexes.walker_file import Walker, load_walker
from klute_sim.walker.simulation.simulate import select_adapted_walkers

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

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


@dataclass(frozen=True, repr=False)
class WalkTuningResult:
    """The evaluations of a search in predicted walks, and the best of them in longer walks."""

    problem: WalkTuningProblem
    """Design space, persons and objective."""
    evaluations: list[WalkEvaluation]
    """All evaluations of the search, the initial point first."""
    reevaluations: list[WalkEvaluation]
    """Evaluations in longer walks: the initial point, then some of the best points."""
    folder: Path
    """Folder that holds the results of the evaluations."""

    @property
    def initial(self) -> WalkEvaluation:
        """Reevaluation of the initial point."""
        return self.reevaluations[0]

    @property
    def best(self) -> WalkEvaluation:
        """Reevaluation of least cost."""
        return select_best(self.reevaluations)

    @property
    def device(self) -> Device:
        """Tuned device; the initial device when only the state machine was tuned."""
        return self.problem.space.decode(self.best.x)[0]

    @property
    def machine(self) -> StateMachine:
        """Tuned state machine."""
        return self.problem.space.decode(self.best.x)[1]

    @property
    def summary(self) -> dict[str, Any]:
        """Content of tuning.json, without the folder and the list of files."""
        return {
            "rig": "walk",
            "evaluations": len(self.evaluations),
            "seed": self.problem.seed,
            "walkers": [walker.name for walker in self.problem.walkers],
            "seconds": FINE_DURATION_FACTOR * self.problem.seconds,
            "cost": {"before": self.initial.cost, "tuned": self.best.cost},
            "metrics": {
                name: None if evaluation.metrics is None else asdict(evaluation.metrics)
                for name, evaluation in (("before", self.initial), ("tuned", self.best))
            },
            "design_variables": {
                variable.name: {"before": variable.initial, "tuned": variable.denormalize(float(x))}
                for variable, x in zip(self.problem.variables, self.best.x, strict=True)
            },
        }

    def format_summary(self) -> Summary:
        """Yield the tables of outcomes and of tuned numbers, the change of the objective, and what it does not say."""
        yield self._build_table()
        reduction = 100.0 * (1.0 - self.best.cost / self.initial.cost)
        yield (
            f"The objective fell by {reduction:.0f} % in {len(self.evaluations)} evaluations "
            f"(seed {self.problem.seed}); the table shows walks of {self.summary['seconds']:g} s."
        )
        yield ACUTE_REMARK

    def _build_table(self) -> "Table":
        from rich import box
        from rich.table import Table

        summary = self.summary
        before, tuned = (summary["metrics"][name] or {} for name in ("before", "tuned"))
        table = Table(box=box.SIMPLE_HEAD)
        table.add_column("")
        for name in ("before", "tuned"):
            table.add_column(name, justify="right")
        for key, label in ROWS.items():
            values = [metrics.get(key) for metrics in (before, tuned)]
            table.add_row(label, *("-" if value is None else f"{value:.3f}" for value in values))
        falls = [f"{metrics['n_falls']} of {metrics['n_walks']}" if metrics else "-" for metrics in (before, tuned)]
        table.add_row("falls", *falls, end_section=True)
        for name, values in summary["design_variables"].items():
            table.add_row(name, f"{values['before']:.4g}", f"{values['tuned']:.4g}")
        return table

    def __repr__(self) -> str:
        """Return one line: number of evaluations, cost before and after, and the folder."""
        cost = f"cost {self.initial.cost:.3g} -> {self.best.cost:.3g}"
        return f"WalkTuningResult({len(self.evaluations)} evaluations, {cost}, folder={str(self.folder)!r})"

    def __str__(self) -> str:
        """Return the summary that the terminal shows."""
        return render_text(self.format_summary())

    def _repr_html_(self) -> str:
        return render_html(self.format_summary())

    def plot(self) -> "Figure":
        """Return the figure of the objective over the evaluations."""
        import numpy as np
        from matplotlib.figure import Figure

        costs = np.array([evaluation.cost for evaluation in self.evaluations])
        figure = Figure(figsize=(7.0, 4.0), layout="constrained")
        axis = figure.subplots()
        axis.plot(costs, ".", color="#999999", label="evaluations")
        axis.plot(np.minimum.accumulate(costs), color="#1f77b4", label="best so far")
        axis.set_ylim(top=max(2.0 * float(costs[0]), float(costs[0]) + 1.0))
        axis.set_xlabel("evaluation")
        axis.set_ylabel("objective")
        axis.legend()
        return figure

    def save(self, folder: str | Path | None = None) -> Path:
        """Write the files of ``klute-sim tune --rig walk`` into ``folder``; None: the folder of the evaluations.

        Returns the folder.
        """
        target = self.folder if folder is None else Path(folder)
        self.write_files(target)
        return target

    def write_files(self, folder: Path) -> dict[str, Any]:
        """Write all files into ``folder`` and return the content of tuning.json."""
        from klute_sim.report.style import COMPACT_DPI
        from klute_sim.viewer.layouts.walk_tuning import EVALUATION_COLUMNS, EVALUATIONS_FILE

        numbers = {name: value for name, value in self.machine.describe().items() if name != "kind"}
        rows = [f"{k},{e.generation},{e.cost!r},{e.metrics.n_falls if e.metrics else ''}" for k, e in self._number()]
        files = [EVALUATIONS_FILE, "tuned.toml", "tuning.json", "tuning.png"]
        with ResultStore(folder).translate_write_errors():
            folder.mkdir(parents=True, exist_ok=True)
            if self.problem.space.device_keys:
                write_atomically(folder / "device.toml", self.device.content.decode("utf-8-sig"))
                files.append("device.toml")
            with replace_atomically(folder / "tuning.png") as temporary:
                self.plot().savefig(temporary, dpi=COMPACT_DPI)
            write_atomically(folder / "tuned.toml", format_toml(numbers))
            write_atomically(folder / EVALUATIONS_FILE, "\n".join([",".join(EVALUATION_COLUMNS), *rows]) + "\n")
            content = {"folder": str(folder), "files": sorted(files), **self.summary}
            write_atomically(folder / "tuning.json", json.dumps(content, indent=2, allow_nan=False) + "\n")
        return content

    def _number(self) -> list[tuple[int, WalkEvaluation]]:
        return list(enumerate(self.evaluations))


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
    n_expected = budget + min(REEVALUATED_FRACTION * budget, MAX_REEVALUATIONS)

    def report(n_done: int) -> None:
        if progress is not None:
            progress(min(1.0, n_done / n_expected), "tuning")

    with store.lock(), explain_interrupt(store.folder), LocalRunner(n_jobs) as runner:
        evaluations = optimize(problem, budget, store, runner.run, report)
        reevaluations = reevaluate(problem, evaluations, store, runner.run, report)
    return WalkTuningResult(problem, evaluations, reevaluations, store.folder)
