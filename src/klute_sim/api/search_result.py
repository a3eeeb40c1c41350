"""The result of a search with one objective (:mod:`klute_sim.tuning.search`): best point, files and figure."""

import json
from abc import abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

from klute_sim.api.rendering import Printable, Summary
from klute_sim.api.sweep import explain_interrupt
from klute_sim.device.device import Device
from klute_sim.files.toml import format_toml
from klute_sim.parameter_sweep.local import LocalRunner
from klute_sim.parameter_sweep.store import ResultStore
from klute_sim.recording.atomic_file import write_atomically
from klute_sim.tuning.search import (
    MAX_REEVALUATIONS,
    REEVALUATED_FRACTION,
    E,
    SearchProblem,
    optimize,
    reevaluate,
    select_best,
)
from klute_sim.types import ProgressCallback

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

P = TypeVar("P", bound=SearchProblem[Any])


def run_search(
    problem: SearchProblem[E], budget: int, store: ResultStore, n_jobs: int, progress: ProgressCallback | None
) -> tuple[list[E], list[E]]:
    """Return the evaluations of a search of ``budget`` evaluations, and the finer ones of its best points."""
    n_expected = budget + min(REEVALUATED_FRACTION * budget, MAX_REEVALUATIONS)

    def report(n_done: int) -> None:
        if progress is not None:
            progress(min(1.0, n_done / n_expected), "tuning")

    with store.lock(), explain_interrupt(store.folder), LocalRunner(n_jobs) as runner:
        evaluations = optimize(problem, budget, store, runner.run, report)
        return evaluations, reevaluate(problem, evaluations, store, runner.run, report)


@dataclass(frozen=True, repr=False)
class SearchResult(Printable, Generic[P, E]):
    """The evaluations of a search, and the best of them in finer simulations."""

    rig: ClassVar[str]
    """Rig of the simulations, as ``klute-sim tune --rig`` names it."""

    problem: P
    """Design space, simulations and objective."""
    evaluations: list[E]
    """All evaluations of the search, the initial point first."""
    reevaluations: list[E]
    """Finer evaluations: the initial point, then some of the best points."""
    folder: Path
    """Folder that holds the results of the evaluations."""

    @property
    def initial(self) -> E:
        """Reevaluation of the initial point."""
        return self.reevaluations[0]

    @property
    def best(self) -> E:
        """Reevaluation of least cost."""
        return select_best(self.reevaluations)

    @property
    def device(self) -> Device:
        """Tuned device; the initial device when only the controller was tuned."""
        device: Device = self.problem.space.decode(self.best.x)[0]
        return device

    @property
    @abstractmethod
    def controller_numbers(self) -> dict[str, Any]:
        """Tuned numbers of the controller, as ``tuned.toml`` holds them."""

    @property
    @abstractmethod
    def scope(self) -> str:
        """Sentence that states what was simulated."""

    @abstractmethod
    def describe_metrics(self, evaluation: E) -> dict[str, Any] | None:
        """Return the metrics of ``evaluation`` by name; None where a simulation failed."""

    @abstractmethod
    def format_metrics(self) -> list[list[str]]:
        """Return the rows of the table of metrics: label, before, tuned."""

    @property
    def summary(self) -> dict[str, Any]:
        """Content of tuning.json, without the folder and the list of files."""
        before_and_tuned = {"before": self.initial, "tuned": self.best}
        return {
            "rig": self.rig,
            "evaluations": len(self.evaluations),
            "reevaluations": len(self.reevaluations),
            "headline": self.format_headline(),
            "seed": self.problem.seed,
            "scope": self.scope,
            "cost": {name: evaluation.cost for name, evaluation in before_and_tuned.items()},
            "metrics": {name: self.describe_metrics(evaluation) for name, evaluation in before_and_tuned.items()},
            "design_variables": {
                variable.name: {"before": variable.initial, "tuned": variable.denormalize(float(x))}
                for variable, x in zip(self.problem.variables, self.best.x, strict=True)
            },
        }

    def format_summary(self) -> Summary:
        """Yield the table of metrics and of tuned numbers, the change of the objective, and what was simulated."""
        yield self._build_table()
        from klute_sim.report.tuning.text import format_search_size

        yield self.format_headline()
        n_generations, n_finalists = self.evaluations[-1].generation, len(self.reevaluations) - 1
        yield format_search_size(len(self.evaluations), n_generations, n_finalists, self.problem.seed)
        yield self.scope

    def format_headline(self) -> str:
        """Return by how much the objective fell, in one sentence."""
        from klute_sim.report.tuning.text import format_change

        return f"{format_change(self.initial.cost, self.best.cost)}."

    def _build_table(self) -> "Table":
        from klute_sim.terminal_table import create_table

        table = create_table()
        table.add_column("")
        for name in ("before", "tuned"):
            table.add_column(name, justify="right")
        rows = self.format_metrics()
        for number, row in enumerate(rows, 1):
            table.add_row(*row, end_section=number == len(rows))
        for name, values in self.summary["design_variables"].items():
            table.add_row(name, f"{values['before']:.4g}", f"{values['tuned']:.4g}")
        return table

    def __repr__(self) -> str:
        """Return one line: number of evaluations, cost before and after, and the folder."""
        cost = f"cost {self.initial.cost:.3g} -> {self.best.cost:.3g}"
        return f"{type(self).__name__}({len(self.evaluations)} evaluations, {cost}, folder={str(self.folder)!r})"

    def plot(self) -> "Figure":
        """Return the figure of the objective over the evaluations, and of the changes by the tuning."""
        from klute_sim.report.tuning.search_figure import build_figure

        before, tuned = (self.describe_metrics(evaluation) or {} for evaluation in (self.initial, self.best))
        falls = [
            evaluation.metrics is None or self.count_falls(evaluation) not in ("", 0) for evaluation in self.evaluations
        ]
        return build_figure(
            [evaluation.cost for evaluation in self.evaluations],
            falls,
            {name.split(" [")[0].replace("_", " "): (before[name], tuned.get(name)) for name in before},
            {name: (values["before"], values["tuned"]) for name, values in self.summary["design_variables"].items()},
        )

    def save(self, folder: str | Path | None = None) -> Path:
        """Write the files of ``klute-sim tune`` into ``folder``; None: the folder of the evaluations.

        Returns the folder.
        """
        target = self.folder if folder is None else Path(folder)
        self.write_files(target)
        return target

    def write_files(self, folder: Path) -> dict[str, Any]:
        """Write all files into ``folder`` and return the content of tuning.json."""
        from klute_sim.report.run_page import FIGURE_FILE, PAGE_FILE, write_run_page
        from klute_sim.report.style import save_figure
        from klute_sim.report.tuning.search_figure import DESCRIPTION
        from klute_sim.viewer.layouts.one_objective import EVALUATION_COLUMNS, EVALUATIONS_FILES

        evaluations_file = EVALUATIONS_FILES[self.rig]
        rows = [
            f"{number},{e.generation},{e.cost!r},{self.count_falls(e)}" for number, e in enumerate(self.evaluations)
        ]
        files = [evaluations_file, "tuned.toml", "tuning.json", FIGURE_FILE, PAGE_FILE]
        with ResultStore(folder).translate_write_errors():
            folder.mkdir(parents=True, exist_ok=True)
            if self.problem.space.device_keys:
                write_atomically(folder / "device.toml", self.device.content.decode("utf-8-sig"))
                files.append("device.toml")
            save_figure(self.plot(), folder / FIGURE_FILE)
            write_atomically(folder / "tuned.toml", format_toml(self.controller_numbers))
            write_atomically(folder / evaluations_file, "\n".join([",".join(EVALUATION_COLUMNS), *rows]) + "\n")
            files += ResultStore(folder).list_search_files(f"tune-{self.rig}")
            content = {"folder": str(folder), "files": sorted(files), **self.summary}
            write_atomically(folder / "tuning.json", json.dumps(content, indent=2, allow_nan=False) + "\n")
            write_run_page(folder, f"Tuning, rig {self.rig}", self.format_summary(), {FIGURE_FILE: DESCRIPTION})
        return content

    def count_falls(self, evaluation: E) -> int | str:
        """Return the number of simulations of ``evaluation`` that end in a fall; '' where none can."""
        return ""
