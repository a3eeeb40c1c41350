"""A bench run for the rerun viewer: work loops of force over length, and every trial over time."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from klute_sim import units
from klute_sim.errors import InputError
from klute_sim.recording import parquet
from klute_sim.recording.recording import Recording
from klute_sim.report.bench.table import TABLE_METRICS
from klute_sim.viewer import chart, stream
from klute_sim.viewer.layouts import gait
from klute_sim.viewer.stream import GREEN, PALE_GREEN, PALETTE, SeriesLine

TIMELINE = "time"
MAX_TRIAL_TABS = 8
"""Trials with a tab of their own, evenly chosen. The others are charted beside them and no more: over time each would
take a megabyte, and their Parquet files have it all."""
MAX_LEGEND_NAMES = 12
"""Trials up to which their names are in the legends."""
MAX_HELD_RANGE_MM = 0.01
"""Range of a unit's length [mm] up to which it was held, and force is not charted over length."""
ALL_TRIALS_ENTITY, METRICS_ENTITY = "every", "readings"

TRIAL_PLOTS: tuple[gait.PlotSpec, ...] = (
    (
        "gauge pressure [bar]",
        (("pressure_command", "commanded", PALE_GREEN), ("pressure", "delivered", GREEN)),
    ),
    ("device forces [N]", gait.MOTION_PLOTS[4][1]),
    ("lengths [mm]", (("length", "unit", stream.RED), ("muscle_length", "muscle", stream.VIOLET))),
    *gait.ENERGY_PLOTS[:3],
)
"""Of one trial: title and series."""


class RecordedBenchTrial(NamedTuple):
    """A trial as its folder tells of it."""

    name: str
    settings: Mapping[str, float]
    metrics: Mapping[str, float | None]
    recording: Recording

    def get_value(self, key: str) -> float | None:
        """A setting or reading."""
        return {**self.settings, **self.metrics}.get(key)


def rebuild_recording(folder: Path, path: Path) -> None:
    """Write ``path`` (.rrd) from the files of a bench run's ``folder``.

    Raises MissingExtraError without rerun and InputError for files that are damaged.
    """
    told = json.loads((folder / "summary.json").read_text("utf-8"))
    trials = [
        RecordedBenchTrial(
            each["name"], each["setting"], each["readings"], parquet.read(folder / f"{each['name']}.parquet")
        )
        for each in told["trials"]
    ]
    if not trials:
        raise InputError(f"{folder} has no trials to show")
    write_recording(told, trials, path)


def write_recording(summary: Mapping[str, Any], trials: Sequence[RecordedBenchTrial], path: Path) -> None:
    """Write ``trials`` of the run that ``told`` (its summary.json) is of to ``path``."""
    rr = stream.import_rerun()
    with stream.open_recording(path, "bench", summary, lambda: build_blueprint(summary, trials)) as out:
        stream.log_text(out, METRICS_ENTITY, format_page(summary, trials))
        chart.log_chart(out, build_chart(trials, ALL_TRIALS_ENTITY))
        for number in select_tab_trials(trials):
            trial = trials[number - 1]
            axis = rr.TimeColumn(TIMELINE, duration=trial.recording["time"])
            stream.send_lines(out, axis, build_lines(trial, number))
            across = "length" if has_motion([trial]) else "time"
            own = build_chart([trial], f"trial_{number:03d}/chart")
            chart.log_chart(out, own, axis, (trial.recording[across], trial.recording["force"]))


def select_tab_trials(trials: Sequence[RecordedBenchTrial]) -> list[int]:
    """Numbers of the trials with a tab, from 1."""
    places = np.linspace(1, len(trials), min(len(trials), MAX_TRIAL_TABS))
    return [int(number) for number in np.unique(np.rint(places))]


def build_lines(trial: RecordedBenchTrial, number: int) -> list[SeriesLine]:
    """All series of ``trial``, the ``number``-th, over time."""
    found, energies = [], gait.compute_cumulative_energies(trial.recording)
    for _, plotted in TRIAL_PLOTS:
        for entity, name, colour in plotted:
            channel = entity.removeprefix("channels/")
            value = energies[entity] if entity in energies else trial.recording[channel]
            width = 1.0 if colour in gait.THIN_LINE_COLOURS else 2.0
            found.append(SeriesLine(f"trial_{number:03d}/{entity}", name, colour, width, value))
    return found


def has_motion(trials: Sequence[RecordedBenchTrial]) -> bool:
    """Whether the crosshead moved in any of ``trials``."""
    return any(np.ptp(trial.recording["length"]) > MAX_HELD_RANGE_MM for trial in trials)


def build_chart(trials: Sequence[RecordedBenchTrial], entity: str) -> chart.Chart:
    """Force over length of ``trials``; over time where the crosshead held still in all of them."""
    across, label = ("length", "length of the unit [mm]") if has_motion(trials) else ("time", "time [s]")
    curves = tuple(
        chart.ChartCurve(
            trial.name,
            PALETTE[k % len(PALETTE)],
            trial.recording[across],
            trial.recording["force"],
            in_legend=1 < len(trials) <= MAX_LEGEND_NAMES,
        )
        for k, trial in enumerate(trials)
    )
    return chart.Chart(entity, label, "force [N]", curves)


def _build_chart_view(trials: Sequence[RecordedBenchTrial], entity: str) -> Any:
    title = "force over length (counter-clockwise: work done)" if has_motion(trials) else "force over time"
    return chart.build_view(build_chart(trials, entity), title)


def format_page(summary: Mapping[str, Any], trials: Sequence[RecordedBenchTrial]) -> str:
    """What was run, what was read off each trial, and what was assumed."""
    where = "MuJoCo tester" if summary["mujoco"] else "device alone"
    keys = dict.fromkeys(
        key for trial in trials for key in (*trial.settings, *(TABLE_METRICS[summary["kind"]] or trial.metrics))
    )
    differs = [key for key in keys if len({t.get_value(key) for t in trials}) > 1] or list(keys)
    rows = [[trial.name, *(trial.get_value(key) for key in differs)] for trial in trials]
    table = stream.format_markdown_table(["trial", *(_format_heading(key) for key in differs)], rows)
    assumed = [f"{key} ({why})" for key, why in summary["assumptions"].items()]
    return "\n\n".join(
        [
            f"# {summary['protocol']}: {summary['device']}, {where}",
            *summary["remarks"],
            table,
            f"Assumed: {'; '.join(assumed) or 'nothing'}.",
        ]
    )


def _format_heading(key: str) -> str:
    name, unit = units.split_unit(key)
    return f"{name.replace('_', ' ')} [{unit}]" if unit else name.replace("_", " ")


def build_blueprint(summary: Mapping[str, Any], trials: Sequence[RecordedBenchTrial]) -> Any:
    """Layout: a tab with all trials and what was read off them, then one for each of some trials."""
    import rerun.blueprint as rrb

    tabs: list[Any] = [
        rrb.Horizontal(
            _build_chart_view(trials, ALL_TRIALS_ENTITY),
            stream.build_text_view("readings", METRICS_ENTITY),
            name="all trials",
        )
    ]
    for number in select_tab_trials(trials):
        here, trial = f"trial_{number:03d}", trials[number - 1]
        views = [_build_chart_view([trial], f"{here}/chart")]
        views += [
            stream.build_plot_view(title, [f"{here}/{entity}" for entity, _, _ in series])
            for title, series in TRIAL_PLOTS
        ]
        tabs.append(rrb.Grid(*views, grid_columns=3, name=trial.name))
    return stream.build_window_blueprint(rrb.Tabs(*tabs), TIMELINE)
