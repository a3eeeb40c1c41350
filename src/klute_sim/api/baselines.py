"""Simulate the baselines of the package: :func:`simulate_baselines` and its result :class:`BaselineTable`."""

import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from klute_sim.api.gait import check_supply_pressure
from klute_sim.api.inputs import (
    ControllerLike,
    DeviceLike,
    get_input_name,
    stage_progress,
    to_controller,
    to_device,
)
from klute_sim.api.optional import import_pandas
from klute_sim.api.rendering import Printable, Summary
from klute_sim.api.sweep import explain_interrupt
from klute_sim.baselines import table
from klute_sim.baselines.library import Baseline, load_baselines
from klute_sim.errors import InputError
from klute_sim.gait.reference import MAX_GRF_TRACKING_RMS_BW
from klute_sim.gait.subject import ReferenceLike, Subject, resolve_subject
from klute_sim.parameter_sweep.evaluate import TRIPS_COLUMN, UNTRACKED_COLUMN
from klute_sim.parameter_sweep.local import LocalRunner
from klute_sim.parameter_sweep.store import ResultStore, open_store
from klute_sim.parameter_sweep.sweep import run_cases
from klute_sim.recording.atomic_file import write_atomically
from klute_sim.types import ProgressCallback
from klute_sim.units import BAR

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure
    from rich.table import Table

CONDITION_COLUMNS = (
    ("moment\nsd", "moment_distance [sd]", ".2f"),
    ("angle\nsd", "angle_distance [sd]", ".2f"),
    ("power\nsd", "power_distance [sd]", ".2f"),
    ("peak power\nW/kg", "ankle_power_peak [W/kg]", ".2f"),
    ("net work\nJ/kg", "ankle_work_net [J/kg]", "+.3f"),
    ("air\ng/stride", "air_per_stride [g]", ".2f"),
)
"""Title, column and format of the metrics shown for each condition; the first three need the reference speed."""
USER_PAIRS_NAME = "own"
"""Name that selects the user's own devices and controllers alone."""
N_DISTANCE_COLUMNS = 3
"""Number of leading columns of :data:`CONDITION_COLUMNS` that exist only on the level at the reference speed."""
LEVEL_COLUMNS = (
    ("quasi-stiffness\nN·m/kg/deg", "quasi_stiffness [N*m/kg/deg]", ".3f"),
    ("energy\nreturn", "energy_return [1]", ".2f"),
    ("roll-over\nradius m", "rollover_radius [m]", ".2f"),
    ("plantar-\nflexion deg", "ankle_plantarflexion [deg]", ".1f"),
    ("strides\nper tank", "strides_per_tank [1]", ".0f"),
)
"""Title, column and format of further metrics shown on the level at the reference speed."""


@dataclass(frozen=True, repr=False)
class BaselineTable(Printable):
    """Metrics of the baselines in every walking condition."""

    runs: list[table.BaselineRun]
    """Runs of the baselines with their results."""
    subject: Subject
    """Person who walks."""
    folder: Path
    """Folder that holds the results of the runs."""

    @cached_property
    def rows(self) -> list[dict[str, Any]]:
        """Baseline, condition, metrics and remark of each run, by column."""
        return table.build_rows(self.runs)

    def format_summary(self) -> Summary:
        """Yield a table per condition, a table of further metrics on the level, and the assumptions."""
        for condition in dict.fromkeys(row["condition"] for row in self.rows):
            rows = [row for row in self.rows if row["condition"] == condition]
            columns = CONDITION_COLUMNS if condition == "level" else CONDITION_COLUMNS[N_DISTANCE_COLUMNS:]
            yield _build_table(_format_title(rows[0]), rows, columns)
        level_rows = [row for row in self.rows if row["condition"] == "level"]
        yield _build_table(f"{_format_title(level_rows[0])}: further metrics", level_rows, LEVEL_COLUMNS)
        yield self.subject.format_sentence()
        yield (
            f"Assumed: a tank of {1e3 * table.TANK_VOLUME_M3:g} l at {table.TANK_PRESSURE_PA / BAR:g} bar that is used "
            f"down to {table.MIN_TANK_PRESSURE_PA / BAR:g} bar, and the limb kinematics on slopes and at other speeds."
        )
        if any(row["remark"] and not row["failure"] for row in self.rows):
            yield (
                f"Where the load is not tracked (rms error above {MAX_GRF_TRACKING_RMS_BW:g} body weights), the ankle "
                "does not carry the load of the reference; its moments and powers are not those of walking."
            )

    def __repr__(self) -> str:
        """Return one line: number of baselines and runs, and the folder."""
        n_baselines = len({run.baseline.name for run in self.runs})
        return f"BaselineTable({n_baselines} baselines, {len(self.runs)} runs, folder={str(self.folder)!r})"

    def to_pandas(self) -> "pd.DataFrame":
        """Return the rows as a DataFrame; raises MissingExtraError without pandas."""
        pandas = import_pandas("BaselineTable.to_pandas")
        frame: pd.DataFrame = pandas.DataFrame(self.rows)
        return frame

    def plot(self, metric: str | None = None) -> "Figure":
        """Return a figure of ``metric`` by baseline and condition; None: of the main metrics.

        Raises InputError when there is no such metric.
        """
        from klute_sim.report.sweep.figure import GAIT_METRICS, build_figure

        if metric is not None and not any(metric in row for row in self.rows):
            allowed = ", ".join(name for name in self.rows[0] if "[" in name)
            raise InputError(f"there is no metric '{metric}'; allowed: {allowed}")
        metrics = {metric: metric} if metric else GAIT_METRICS
        return build_figure(self.rows, ("condition",), metrics, (TRIPS_COLUMN, UNTRACKED_COLUMN), over="baseline")

    def save(self, folder: str | Path | None = None) -> Path:
        """Write table.json, figure.png and index.html into ``folder``; None: that of the results.

        Returns the folder.
        """
        from klute_sim.report.run_page import FIGURE_FILE, write_run_page
        from klute_sim.report.style import save_figure

        target = self.folder if folder is None else Path(folder)
        with ResultStore(target).translate_write_errors():
            target.mkdir(parents=True, exist_ok=True)
            write_atomically(target / "table.json", json.dumps(self.to_json(), indent=2, allow_nan=False) + "\n")
            save_figure(self.plot(), target / FIGURE_FILE)
            description = "Main metrics of every baseline in each walking condition."
            write_run_page(target, "Baselines", self.format_summary(), {FIGURE_FILE: description})
        return target

    def to_json(self) -> dict[str, Any]:
        """Return the content of table.json."""
        return {"folder": str(self.folder), "subject": self.subject.describe(), "rows": self.rows}


def simulate_baselines(
    only: Sequence[str] = (),
    *,
    own: Sequence[tuple[DeviceLike, ControllerLike]] = (),
    reference: ReferenceLike = None,
    foot: str | None = None,
    stride_time: float | None = None,
    accept: Collection[str] = (),
    mass: float | None = None,
    stature: float | None = None,
    speed: float | None = None,
    slope: float = table.SLOPE_DEG,
    strides: int = 5,
    time_step: float = 5e-4,
    folder: str | Path | None = None,
    n_jobs: int = 0,
    progress: ProgressCallback | None = None,
) -> BaselineTable:
    """Simulate the baselines at the reference speed, at 0.8 and 1.25 of it, and 5 degrees uphill and downhill.

    Args:
        only: Names of baselines; empty: all of them. ``["own"]``: only those of ``own``.
        own: Further pairs of a device and a controller, which are simulated like the baselines.
        reference: Reference gait, or the path of its file or folder. None: able-bodied adults.
        foot: Foot below the ankle, such as ``"sach"`` or, in a shoe, ``"sach+shoe"``. None: that of the device.
        stride_time: Stride time of the reference [s]. None: the time that it states, or 1.1.
        accept: Names of findings about the reference file that are right although they look implausible.
        mass: Body mass [kg]. None: the mass that the reference states, or 75.
        stature: Stature [m]. None: the stature that the reference states, or 1.75.
        speed: Walking speed on the level and on slopes [m/s]. None: the speed that reference and leg length imply.
        slope: Ground slope of the conditions uphill and downhill [deg].
        strides: Number of strides per run.
        time_step: Time step [s].
        folder: Folder of the results, new, empty or of the same runs; None: the next ``runs/baselines-NNN``.
        n_jobs: Number of worker processes; 0: one per core.
        progress: Receives the completed fraction and the current stage.

    Raises InputError when a name is unknown, a value is out of range, or the folder holds something else.
    """
    subject = resolve_subject(
        reference, stride_time=stride_time, accept=accept, mass=mass, stature=stature, speed=speed
    )
    baselines = select_baselines(only, own, foot)
    runs = table.plan_runs(baselines, subject, strides, time_step, table.create_conditions(slope))
    store = open_store(folder, table.describe_runs(runs, subject), "baselines")
    with store.lock(), explain_interrupt(store.folder), LocalRunner(n_jobs) as runner:
        cases = [run.case for run in runs]
        results, _ = run_cases(cases, store, runner.run, stage_progress(progress, "simulating"))
    finished = [replace(run, result=result) for run, result in zip(runs, results, strict=True)]
    return BaselineTable(finished, subject, store.folder)


def select_baselines(
    only: Sequence[str], user_pairs: Sequence[tuple[DeviceLike, ControllerLike]], foot: str | None = None
) -> list[Baseline]:
    """Return the shipped baselines named in ``only`` (empty: all), then a baseline for each pair of ``user_pairs``.

    All have the ``foot``; None: that of their device.

    Raises InputError when a name is unknown, or when ``only`` selects :data:`USER_PAIRS_NAME` and there is no pair.
    """
    if USER_PAIRS_NAME in only and not user_pairs:
        raise InputError(f"only '{USER_PAIRS_NAME}' is selected, but there is none: give a device or a controller")
    names = [name for name in only if name != USER_PAIRS_NAME]
    shipped = [] if USER_PAIRS_NAME in only and not names else load_baselines(names)
    baselines = [*shipped, *(_create_user_baseline(*pair) for pair in user_pairs)]
    return [replace(baseline, device=to_device(baseline.device, foot)) for baseline in baselines]


def _create_user_baseline(device: DeviceLike, controller: ControllerLike) -> Baseline:
    chosen_device, chosen_controller = to_device(device), to_controller(controller)
    check_supply_pressure(chosen_device, chosen_controller)
    return Baseline(
        name=f"{get_input_name(device)}, {get_input_name(controller)}",
        description="The user's own device and controller.",
        origin="the user",
        device=chosen_device,
        controller=chosen_controller,
        foot_stiffness=None,
        is_shipped=False,
    )


def _format_title(row: dict[str, Any]) -> str:
    if row["slope [deg]"]:
        return f"{abs(row['slope [deg]']):g} degrees {row['condition']}"
    speed = row["speed_requested [m/s]"]
    return "level, the reference's speed" if speed is None else f"level, {speed:.2f} m/s"


def _build_table(title: str, rows: list[dict[str, Any]], columns: tuple[tuple[str, str, str], ...]) -> "Table":

    from klute_sim.terminal_table import create_table

    result = create_table(title=title)
    result.add_column("")
    for name, _, _ in columns:
        result.add_column(name, justify="right", no_wrap=True)
    result.add_column("")
    for row in rows:
        cells = ["-" if row.get(column) is None else format(row[column], spec) for _, column, spec in columns]
        result.add_row(row["baseline"], *cells, row["remark"] or "")
    return result
