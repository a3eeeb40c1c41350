"""The result of a sweep: its rows, their table and figure, and its files."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from klute_sim.api.optional import import_pandas
from klute_sim.api.rendering import Printable, Summary
from klute_sim.errors import InputError
from klute_sim.parameter_sweep import display, table, walk_display
from klute_sim.parameter_sweep.evaluate import TRIPS_COLUMN, UNTRACKED_COLUMN
from klute_sim.parameter_sweep.joint_plan import JointSweepPlan
from klute_sim.parameter_sweep.plan import SweepPlan
from klute_sim.parameter_sweep.store import ResultStore
from klute_sim.parameter_sweep.walk_metrics import FELL_COLUMN
from klute_sim.parameter_sweep.walk_plan import WalkSweepPlan
from klute_sim.recording.atomic_file import replace_atomically

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

WALK_INPUT_COLUMNS = (
    "push_off_pressure [bar]",
    "push_off_lean [deg]",
    "foot_stiffness [N*m/deg]",
    *walk_display.WALK_INPUT_TITLES,
)
"""Inputs of a walk but the walker."""
INPUT_COLUMNS: dict[type, tuple[str, ...]] = {
    SweepPlan: tuple(display.INPUT_TITLES),
    WalkSweepPlan: WALK_INPUT_COLUMNS,
    JointSweepPlan: tuple(display.JOINT_INPUT_TITLES),
}
"""Plan -> inputs over which its figure shows the metrics."""
UNUSABLE_COLUMNS: dict[type, tuple[str, ...]] = {
    SweepPlan: (TRIPS_COLUMN, UNTRACKED_COLUMN),
    WalkSweepPlan: (FELL_COLUMN,),
    JointSweepPlan: (),
}
"""Plan -> columns that say that a case is not usable."""


@dataclass(frozen=True, repr=False)
class SweepResult(Printable):
    """The finished cases of a sweep, one row per combination."""

    plan: table.AnyPlan
    """Lists whose combinations were simulated."""
    rows: list[table.SweepRow]
    """Inputs, metrics and failure of each case, by column, in the order of the plan."""
    folder: Path
    """Folder that holds the results of the cases."""
    n_resumed: int = 0
    """Number of cases whose results were in the folder before."""

    @property
    def n_failed(self) -> int:
        """Number of cases with a failure in place of metrics."""
        return sum(row[table.FAILURE_COLUMN] is not None for row in self.rows)

    def format_summary(self) -> Summary:
        """Yield the table of the first cases, or of the conditions of walks, and the remarks on the sweep."""
        if isinstance(self.plan, WalkSweepPlan):
            yield walk_display.format_walk_table(self.rows)
            yield from walk_display.collect_walk_remarks(self.rows, self.n_failed)
            return
        if isinstance(self.plan, JointSweepPlan):
            yield display.format_joint_table(self.rows)
            yield from display.collect_joint_remarks(self.rows, self.n_failed)
            return
        yield display.format_table(self.rows)
        yield from display.collect_remarks(self.rows, self.n_failed)

    def __repr__(self) -> str:
        """Return one line: numbers of cases and failures, and the folder."""
        return f"SweepResult({len(self.rows)} cases, {self.n_failed} failed, folder={str(self.folder)!r})"

    def to_pandas(self) -> "pd.DataFrame":
        """Return the rows as a DataFrame; raises MissingExtraError without pandas."""
        pandas = import_pandas("SweepResult.to_pandas")
        frame: pd.DataFrame = pandas.DataFrame(self.rows, columns=list(table.get_column_types(self.plan)))
        return frame

    def plot(self, metric: str | None = None, over: str | None = None) -> "Figure":
        """Return a figure of ``metric`` over the input column ``over``; other inputs that vary have colours and styles.

        ``metric`` None: the main metrics. ``over`` None: the input with the most values. Walks of several persons give
        their mean and standard deviation. Raises InputError when a column does not exist.
        """
        from klute_sim.report.sweep.figure import GAIT_METRICS, JOINT_METRICS, WALK_METRICS, build_figure

        columns, kind = table.get_column_types(self.plan), type(self.plan)
        for column in (metric, over):
            if column is not None and column not in columns:
                raise InputError(f"there is no column '{column}'; allowed: {', '.join(columns)}")
        metrics = {SweepPlan: GAIT_METRICS, WalkSweepPlan: WALK_METRICS, JointSweepPlan: JOINT_METRICS}[kind]
        shown = {metric: metric} if metric else metrics
        return build_figure(self.rows, INPUT_COLUMNS[kind], shown, UNUSABLE_COLUMNS[kind], over)

    def save(self, folder: str | Path | None = None, *, with_csv: bool = False) -> Path:
        """Write sweep.parquet, figure.png, index.html and, with ``with_csv``, sweep.csv into ``folder``.

        None: the folder of the results. Returns the folder.
        """
        from klute_sim.report.run_page import FIGURE_FILE, write_run_page
        from klute_sim.report.style import save_figure
        from klute_sim.report.sweep.figure import DESCRIPTION

        target = self.folder if folder is None else Path(folder)
        with ResultStore(target).translate_write_errors():
            target.mkdir(parents=True, exist_ok=True)
            if with_csv:
                with replace_atomically(target / "sweep.csv") as temporary:
                    table.write_csv(self.rows, temporary)
            with replace_atomically(target / "sweep.parquet") as temporary:
                table.write_parquet(self.rows, self.plan, temporary)
            save_figure(self.plot(), target / FIGURE_FILE)
            write_run_page(target, f"Sweep: {len(self.rows)} cases", self.format_summary(), {FIGURE_FILE: DESCRIPTION})
        return target
