"""The result of a sweep: its rows, their table and figure, and its files."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from klute_sim.api.optional import import_pandas
from klute_sim.api.rendering import Summary, render_html, render_text
from klute_sim.errors import InputError
from klute_sim.parameter_sweep import display, table, walk_display
from klute_sim.parameter_sweep.joint_plan import JointSweepPlan
from klute_sim.parameter_sweep.plan import SweepPlan
from klute_sim.parameter_sweep.store import ResultStore
from klute_sim.parameter_sweep.walk_plan import WalkSweepPlan
from klute_sim.recording.atomic_file import replace_atomically

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

PLOT_COLUMNS: dict[type, tuple[str, str, tuple[str, ...]]] = {
    SweepPlan: ("ankle_work_net [J/kg]", "mass [kg]", ("device", "controller")),
    WalkSweepPlan: ("cost_minetti [J/kg/m]", "push_off_pressure [bar]", ("walker",)),
    JointSweepPlan: ("angle_error_rms [deg]", "proportional [1/rad]", ("device",)),
}
"""Plan -> metric and input that are plotted by default, and columns that name a line."""


@dataclass(frozen=True, repr=False)
class SweepResult:
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

    def __str__(self) -> str:
        """Return the summary that the terminal shows."""
        return render_text(self.format_summary())

    def _repr_html_(self) -> str:
        return render_html(self.format_summary())

    def to_pandas(self) -> "pd.DataFrame":
        """Return the rows as a DataFrame; raises MissingExtraError without pandas."""
        pandas = import_pandas("SweepResult.to_pandas")
        frame: pd.DataFrame = pandas.DataFrame(self.rows, columns=list(table.get_column_types(self.plan)))
        return frame

    def plot(self, metric: str | None = None, over: str | None = None) -> "Figure":
        """Return a figure of ``metric`` over the input column ``over``, one line per device and controller.

        None: net ankle work over body mass; of walks the cost after Minetti and Alexander over push-off pressure, one
        line per walker; of the joint the error of the angle over the proportional gain, one line per device. Raises
        InputError when a column does not exist.
        """
        from matplotlib.figure import Figure

        columns = table.get_column_types(self.plan)
        default_metric, default_over, line_columns = PLOT_COLUMNS[type(self.plan)]
        metric, over = metric or default_metric, over or default_over
        for column in (metric, over):
            if column not in columns:
                raise InputError(f"there is no column '{column}'; allowed: {', '.join(columns)}")
        figure = Figure(figsize=(7.0, 4.0), layout="constrained")
        axis = figure.subplots()
        points: dict[str, list[tuple[Any, Any]]] = {}
        for row in self.rows:
            if row[metric] is not None and row[over] is not None:
                label = ", ".join(row[column] for column in line_columns)
                points.setdefault(label, []).append((row[over], row[metric]))
        for label, pairs in points.items():
            axis.plot(*zip(*sorted(pairs), strict=True), "o-", label=label)
        axis.set_xlabel(over)
        axis.set_ylabel(metric)
        if points:
            axis.legend()
        return figure

    def save(self, folder: str | Path | None = None, *, with_csv: bool = False) -> Path:
        """Write sweep.parquet, and sweep.csv with ``with_csv``, into ``folder``; None: the folder of the results.

        Returns the folder.
        """
        target = self.folder if folder is None else Path(folder)
        with ResultStore(target).translate_write_errors():
            target.mkdir(parents=True, exist_ok=True)
            if with_csv:
                with replace_atomically(target / "sweep.csv") as temporary:
                    table.write_csv(self.rows, temporary)
            with replace_atomically(target / "sweep.parquet") as temporary:
                table.write_parquet(self.rows, self.plan, temporary)
        return target
