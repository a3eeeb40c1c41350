"""Tune a pressure profile, optionally with the device: :func:`tune` and its result :class:`TuningResult`."""

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from klute_sim.api.inputs import DeviceLike, to_device
from klute_sim.api.rendering import Printable, Summary
from klute_sim.api.search_result import run_search
from klute_sim.controllers.pressure import PressureProfile, load_default_profile, load_profile, profile_to_csv
from klute_sim.device.device import Device
from klute_sim.gait.metrics import compute_gait_metrics
from klute_sim.gait.subject import ReferenceLike, resolve_subject
from klute_sim.gait.summary import summarize_gait_run
from klute_sim.parameter_sweep.store import ResultStore
from klute_sim.recording.atomic_file import write_atomically
from klute_sim.recording.recording import Recording
from klute_sim.tuning import results
from klute_sim.tuning.design_variables import DEFAULT_DEVICE_KEYS, DesignSpace
from klute_sim.tuning.objective import Goals, make_weights
from klute_sim.tuning.search import (
    Evaluation,
    TuningProblem,
    import_cma,
    select_best,
    select_pareto_front,
)
from klute_sim.tuning.subject import describe_assumptions, make_human_goals
from klute_sim.types import ProgressCallback

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table


@dataclass(frozen=True, repr=False)
class TuningResult(Printable):
    """The evaluations of a search and the best of them, simulated at a fine time step."""

    problem: TuningProblem
    """Design space, subject and objective."""
    evaluations: list[Evaluation]
    """All evaluations of the search, the initial point first."""
    reevaluations: list[Evaluation]
    """Evaluations at a fine time step: the initial point, then some of the best points."""
    folder: Path
    """Folder that holds the results of the evaluations."""

    @property
    def initial(self) -> Evaluation:
        """Reevaluation of the initial point."""
        return self.reevaluations[0]

    @property
    def best(self) -> Evaluation:
        """Reevaluation of least cost."""
        return select_best(self.reevaluations)

    @property
    def device(self) -> Device:
        """Tuned device; the initial device when only the profile was tuned."""
        return self.problem.space.decode(self.best.x)[0]

    @property
    def profile(self) -> PressureProfile:
        """Tuned pressure profile."""
        return self.problem.space.decode(self.best.x)[1]

    @cached_property
    def recordings(self) -> tuple[Recording, Recording]:
        """Gait runs with the initial and with the tuned device and profile."""
        return results.simulate_point(self.problem, self.initial.x), results.simulate_point(self.problem, self.best.x)

    @cached_property
    def summary(self) -> dict[str, Any]:
        """Content of tuning.json, without the folder and the list of files."""
        from klute_sim.report.gait import table

        tuned = self.recordings[1]
        return {
            "evaluations": len(self.evaluations),
            "reevaluations": len(self.reevaluations),
            "seed": self.problem.seed,
            "subject": self.problem.subject.describe(),
            "assumptions": describe_assumptions(self.problem.subject),
            "headline": self.format_headline(),
            "cost": {"before": self.initial.cost, "tuned": self.best.cost},
            "objective": self.objective_rows,
            "table": results.build_metrics_table(*self.recordings),
            "remarks": table.collect_remarks(summarize_gait_run(tuned, compute_gait_metrics(tuned))),
            "design_variables": {
                variable.name: {"before": variable.initial, "tuned": variable.denormalize(float(x))}
                for variable, x in zip(self.problem.space.variables, self.best.x, strict=True)
            },
            "front": [
                {"air_g": air, "tracking_sd2": tracking_error}
                for air, tracking_error in map(results.get_front_point, select_pareto_front(self.evaluations))
            ],
        }

    @property
    def objective_rows(self) -> list[dict[str, Any]]:
        """Summands of the objective before and after tuning: tracking error, air, each penalty, and goals if any."""
        return results.build_objective_rows(self.problem, self.initial, self.best)

    def format_headline(self) -> str:
        """Return by how much the objective fell, and which parts of it fell, in one sentence."""
        from klute_sim.report.tuning import text

        return f"{text.format_change(self.initial.cost, self.best.cost)}{text.format_causes(self.objective_rows)}."

    @property
    def metrics(self) -> dict[str, dict[str, float | None]]:
        """Values before and after tuning and of the human ankle, by the label of the row."""
        return {row["name"]: {key: row[key] for key in ("before", "tuned", "human")} for row in self.summary["table"]}

    def format_summary(self) -> Summary:
        """Yield the change of the objective, the tables before and after tuning, and the remarks on the tuned gait."""
        from klute_sim.report.tuning.text import format_search_size

        yield self.format_headline()
        n_generations, n_finalists = self.evaluations[-1].generation, len(self.reevaluations) - 1
        yield format_search_size(len(self.evaluations), n_generations, n_finalists, self.problem.seed)
        yield self._build_table()
        yield self._build_objective_table()
        yield from self.summary["assumptions"]
        yield from self.problem.subject.remarks
        yield from self.summary["remarks"]

    def _build_table(self) -> "Table":
        from klute_sim.report.gait.reference_text import shorten_reference_name
        from klute_sim.terminal_table import create_table

        table = create_table()
        columns = ("before", "tuned", "human")
        reference = shorten_reference_name(self.problem.subject.reference.name)
        table.add_column("")
        for heading in (*columns[:2], reference):
            table.add_column(heading, justify="right")
        for row in self.summary["table"]:
            label = row["name"].replace("to human", f"to {reference}")
            table.add_row(label, *("-" if row[name] is None else f"{row[name]:.3f}" for name in columns))
        return table

    def _build_objective_table(self) -> "Table":
        from klute_sim.report.tuning.text import format_quantity
        from klute_sim.terminal_table import create_table

        table = create_table(title="Parts of the objective")
        table.add_column("")
        for name in ("before", "tuned"):
            table.add_column(name, justify="right", no_wrap=True)
        table.add_column("quantity", overflow="fold")
        for row in self.objective_rows:
            costs = [f"{row[name]:.3g}" for name in ("before", "tuned")]
            table.add_row(row["name"].removeprefix("the "), *costs, format_quantity(row))
        total = [f"{evaluation.cost:.3g}" for evaluation in (self.initial, self.best)]
        table.add_section()
        table.add_row("objective", *total, "")
        return table

    def __repr__(self) -> str:
        """Return one line: number of evaluations, cost before and after, and the folder."""
        cost = f"cost {self.initial.cost:.3g} -> {self.best.cost:.3g}"
        return f"TuningResult({len(self.evaluations)} evaluations, {cost}, folder={str(self.folder)!r})"

    def plot(self) -> "Figure":
        """Return the figure of the Pareto front and of the gait before and after tuning."""
        from klute_sim.report.tuning.figure import build_figure

        valid = [e for e in self.evaluations if e.metrics is not None and not e.metrics.trips]
        return build_figure(
            [results.get_front_point(evaluation) for evaluation in valid if not evaluation.has_penalty],
            [results.get_front_point(evaluation) for evaluation in valid if evaluation.has_penalty],
            [results.get_front_point(evaluation) for evaluation in select_pareto_front(self.evaluations)],
            [(results.get_front_point(evaluation), evaluation.has_penalty) for evaluation in (self.initial, self.best)],
            self.recordings,
        )

    def save(self, folder: str | Path | None = None) -> Path:
        """Write the files of ``klute-sim tune`` into ``folder``; None: the folder of the evaluations.

        Returns the folder.
        """
        self.write_files(self.folder if folder is None else Path(folder))
        return self.folder if folder is None else Path(folder)

    def write_files(self, folder: Path) -> dict[str, Any]:
        """Write all files into ``folder`` and return the content of tuning.json."""
        from klute_sim.report.run_page import FIGURE_FILE, PAGE_FILE, write_run_page
        from klute_sim.report.style import save_figure
        from klute_sim.report.tuning.figure import DESCRIPTION
        from klute_sim.viewer.layouts.tuning import EVALUATION_COLUMNS, EVALUATIONS_FILE

        device, profile = self.problem.space.decode(self.best.x)
        files = [EVALUATIONS_FILE, "tuned.csv", "tuning.json", FIGURE_FILE, PAGE_FILE]
        with ResultStore(folder).translate_write_errors():
            folder.mkdir(parents=True, exist_ok=True)
            if self.problem.space.device_keys:
                write_atomically(folder / "device.toml", device.content.decode("utf-8-sig"))
                files.append("device.toml")
            save_figure(self.plot(), folder / FIGURE_FILE)
            write_atomically(folder / "tuned.csv", profile_to_csv(profile))
            write_atomically(
                folder / EVALUATIONS_FILE, results.format_evaluations_csv(self.evaluations, EVALUATION_COLUMNS)
            )
            files += ResultStore(folder).list_search_files("tune")
            content = {"folder": str(folder), "files": sorted(files), **self.summary}
            write_atomically(folder / "tuning.json", json.dumps(content, indent=2, allow_nan=False) + "\n")
            title = f"Tuning of {self.problem.space.device.name}"
            write_run_page(folder, title, self.format_summary(), {FIGURE_FILE: DESCRIPTION})
        return content


def tune(
    device: DeviceLike = "klute-1-1-4-pair",
    *,
    profile: PressureProfile | str | Path | None = None,
    foot: str | None = None,
    with_device: bool = False,
    device_keys: Sequence[str] = (),
    goal_human: bool = False,
    weights: Mapping[str, float] | None = None,
    reference: ReferenceLike = None,
    stride_time: float | None = None,
    accept: Collection[str] = (),
    mass: float | None = None,
    stature: float | None = None,
    speed: float | None = None,
    slope: float = 0.0,
    budget: int = 600,
    seed: int = 0,
    folder: str | Path | None = None,
    n_jobs: int = 0,
    progress: ProgressCallback | None = None,
) -> TuningResult:
    """Tune a pressure profile, optionally with the device, so that the gait resembles the human one on little air.

    The objective is the mean squared distance of net moment, angle and power from the reference in stance, in its
    standard deviations, plus 0.1 per gram of air in a stride, plus penalties (:mod:`klute_sim.tuning.objective`).
    Standard deviations that the reference does not state, or that were measured at another speed or slope, are assumed
    (:mod:`klute_sim.tuning.subject`); the summary says so. The search is CMA-ES. Evaluations are stored in ``folder``
    as they finish; an interrupted search resumes there.

    Args:
        device: Device, name of a preset, or path of a device file.
        profile: Initial profile or the path of its CSV file; None: the hand-tuned profile.
        foot: Foot below the ankle, such as ``"sach"`` or, in a shoe, ``"sach+shoe"``. None: that of the device.
        with_device: Whether to tune orifices, springs, resting length and mounting, too.
        device_keys: Further numbers of the device to tune (``section.key``).
        goal_human: Whether to penalize the shortfall from the human ankle, that of the reference.
        weights: Weights of moment, angle, power [1/sd2] and air [1/g]; None: 1, 1, 1 and 0.1.
        reference: Reference gait, or the path of its file or folder. None: able-bodied adults.
        stride_time: Stride time of the reference [s]. None: the time that it states, or 1.1.
        accept: Names of findings about the reference file that are right although they look implausible.
        mass: Body mass [kg]. None: the mass that the reference states, or 75.
        stature: Stature [m]. None: the stature that the reference states, or 1.75.
        speed: Walking speed [m/s]; it scales the stride time. None: the speed that reference and leg length imply.
        slope: Ground slope [deg], uphill positive; limb kinematics on slopes are assumed.
        budget: Number of evaluations, rounded up to a whole generation.
        seed: Random seed of the search.
        folder: Folder of the evaluations, new, empty or of the same search; None: the next ``runs/tune-NNN``.
        n_jobs: Number of worker processes; 0: one per core.
        progress: Receives the completed fraction and the current stage.

    Raises InputError when an input is not usable, MissingExtraError without the package cma.
    """
    if profile is None:
        initial_profile = load_default_profile()
    else:
        initial_profile = profile if isinstance(profile, PressureProfile) else load_profile(profile)
    keys = tuple(dict.fromkeys([*(DEFAULT_DEVICE_KEYS if with_device else ()), *device_keys]))
    subject = resolve_subject(
        reference, stride_time=stride_time, accept=accept, mass=mass, stature=stature, speed=speed, slope=slope
    )
    problem = TuningProblem(
        space=DesignSpace(to_device(device, foot), initial_profile, keys),
        subject=subject,
        weights=make_weights(weights or {}),
        goals=make_human_goals(subject.reference) if goal_human else Goals(),
        seed=seed,
    )
    import_cma()  # before a folder is made
    store = results.open_tuning_store(folder, problem)
    return TuningResult(problem, *run_search(problem, budget, store, n_jobs, progress), store.folder)
