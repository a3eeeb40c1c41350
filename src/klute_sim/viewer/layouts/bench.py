"""Viewer recording of a bench run: force over length, metrics, and some trials over time."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from klute_sim import units
from klute_sim.errors import InputError
from klute_sim.files.json import read_json
from klute_sim.files.limits import RESULT
from klute_sim.recording import parquet
from klute_sim.recording.recording import Recording
from klute_sim.report.bench.table import TABLE_METRICS
from klute_sim.viewer import chart, stream
from klute_sim.viewer.layouts import gait
from klute_sim.viewer.stream import COMMAND_COLOUR, GREEN, PALETTE, SeriesLine

TIMELINE = "time"
MAX_TRIAL_TABS = 8
"""Maximum number of trials with a tab, evenly spaced.

All trials are in the chart of the first tab; over time, each would take a megabyte, and the Parquet files have it all.
"""
MAX_LEGEND_NAMES = 12
"""Maximum number of trials with names in the legend."""
MAX_HELD_RANGE_MM = 0.01
"""Range of the unit length [mm] up to which the length counts as constant."""
ALL_TRIALS_ENTITY, METRICS_ENTITY = "all_trials", "metrics"

TRIAL_PLOTS: tuple[gait.PlotSpec, ...] = (
    (
        "gauge pressure [bar]",
        (("pressure_command", "commanded", COMMAND_COLOUR), ("pressure", "delivered", GREEN)),
    ),
    ("device forces [N]", gait.MOTION_PLOTS[4][1]),
    ("lengths [mm]", (("length", "unit", stream.RED), ("muscle_length", "muscle", stream.VIOLET))),
    *gait.ENERGY_PLOTS[:3],
)
"""Title and series of the plots of one trial."""


class RecordedBenchTrial(NamedTuple):
    """A trial as read from the folder of its run."""

    name: str
    settings: Mapping[str, float]
    metrics: Mapping[str, float | None]
    recording: Recording

    def get_value(self, key: str) -> float | None:
        """Return the condition or metric ``key``; None if it does not exist."""
        return {**self.settings, **self.metrics}.get(key)


def rebuild_recording(folder: Path, path: Path) -> None:
    """Write ``path`` (.rrd) from the files in the ``folder`` of a bench run.

    Raises MissingExtraError without rerun, and InputError for damaged files.
    """
    summary = read_json(folder / "summary.json", RESULT)
    trials = load_trials(folder, summary)
    if not trials:
        raise InputError(f"{folder} has no trial to show")
    write_recording(summary, trials, path)


def load_trials(folder: Path, summary: Mapping[str, Any]) -> list[RecordedBenchTrial]:
    """Return all trials of the run in ``folder`` with its ``summary`` (content of summary.json)."""
    return [
        RecordedBenchTrial(
            trial["name"],
            trial["conditions"],
            trial["metrics"],
            parquet.load_recording(folder / f"{trial['name']}.parquet"),
        )
        for trial in summary["trials"]
    ]


def write_recording(summary: Mapping[str, Any], trials: Sequence[RecordedBenchTrial], path: Path) -> None:
    """Write the ``trials`` of a run and its ``summary`` (content of summary.json) to ``path`` (.rrd)."""
    rr = stream.import_rerun()
    with stream.open_recording(path, "bench", summary, lambda: build_blueprint(summary, trials)) as out:
        stream.log_text(out, METRICS_ENTITY, format_page(summary, trials))
        chart.log_chart(out, build_chart(trials, ALL_TRIALS_ENTITY))
        for number in select_tab_trials(trials):
            trial = trials[number - 1]
            axis = rr.TimeColumn(TIMELINE, duration=trial.recording["time"])
            stream.send_lines(out, axis, build_lines(trial, number))
            x_channel = "length" if has_motion([trial]) else "time"
            trial_chart = build_chart([trial], f"trial_{number:03d}/chart")
            chart.log_chart(out, trial_chart)
            chart.log_marker(out, trial_chart, axis, trial.recording[x_channel], trial.recording["force"])


def select_tab_trials(trials: Sequence[RecordedBenchTrial]) -> list[int]:
    """Return the numbers (from 1) of the trials with a tab."""
    positions = np.linspace(1, len(trials), min(len(trials), MAX_TRIAL_TABS))
    return [int(number) for number in np.unique(np.rint(positions))]


def build_lines(trial: RecordedBenchTrial, number: int) -> list[SeriesLine]:
    """Build all lines over time of ``trial``, which is the ``number``-th."""
    lines, energies = [], gait.compute_cumulative_energies(trial.recording)
    for _, series in TRIAL_PLOTS:
        for entity, name, colour in series:
            channel = entity.removeprefix("channels/")
            value = energies[entity] if entity in energies else trial.recording[channel]
            lines.append(SeriesLine(f"trial_{number:03d}/{entity}", name, colour, gait.get_line_width(colour), value))
    return lines


def has_motion(trials: Sequence[RecordedBenchTrial]) -> bool:
    """Return whether the crosshead moved in any of ``trials``."""
    return any(np.ptp(trial.recording["length"]) > MAX_HELD_RANGE_MM for trial in trials)


def build_chart(trials: Sequence[RecordedBenchTrial], entity: str) -> chart.Chart:
    """Build the chart of force over length of ``trials``, or over time if no crosshead moved."""
    x_channel, x_label = ("length", "length of the unit [mm]") if has_motion(trials) else ("time", "time [s]")
    curves = tuple(
        chart.ChartCurve(
            trial.name,
            PALETTE[k % len(PALETTE)],
            trial.recording[x_channel],
            trial.recording["force"],
            in_legend=1 < len(trials) <= MAX_LEGEND_NAMES,
        )
        for k, trial in enumerate(trials)
    )
    return chart.Chart(entity, x_label, "force [N]", curves)


def _build_chart_view(trials: Sequence[RecordedBenchTrial], entity: str) -> Any:
    title = "force over length (counter-clockwise: positive work)" if has_motion(trials) else "force over time"
    return chart.build_view(build_chart(trials, entity), title)


def format_page(summary: Mapping[str, Any], trials: Sequence[RecordedBenchTrial]) -> str:
    """Return metrics, remarks and assumptions of the run as Markdown."""
    rig = "MuJoCo tester" if summary["mujoco"] else "device only"
    keys = dict.fromkeys(
        key for trial in trials for key in (*trial.settings, *(TABLE_METRICS[summary["kind"]] or trial.metrics))
    )
    varied = [key for key in keys if len({t.get_value(key) for t in trials}) > 1] or list(keys)
    rows = [[trial.name, *(trial.get_value(key) for key in varied)] for trial in trials]
    table = stream.format_markdown_table(["trial", *(_format_heading(key) for key in varied)], rows)
    assumptions = [f"{key} ({reason})" for key, reason in summary["assumptions"].items()]
    return "\n\n".join(
        [
            f"# {summary['protocol']}: {summary['device']}, {rig}",
            *summary["remarks"],
            table,
            f"Assumed: {'; '.join(assumptions) or 'nothing'}.",
        ]
    )


def _format_heading(key: str) -> str:
    name, unit = units.split_unit(key)
    return f"{name.replace('_', ' ')} [{unit}]" if unit else name.replace("_", " ")


def build_blueprint(summary: Mapping[str, Any], trials: Sequence[RecordedBenchTrial]) -> Any:
    """Build the layout: a tab with all trials and their metrics, and a tab for each of some trials."""
    import rerun.blueprint as rrb

    tabs: list[Any] = [
        rrb.Horizontal(
            _build_chart_view(trials, ALL_TRIALS_ENTITY),
            stream.build_text_view("metrics", METRICS_ENTITY),
            name="all trials",
        )
    ]
    for number in select_tab_trials(trials):
        prefix, trial = f"trial_{number:03d}", trials[number - 1]
        views = [_build_chart_view([trial], f"{prefix}/chart")]
        views += [
            stream.build_plot_view(title, [f"{prefix}/{entity}" for entity, _, _ in series])
            for title, series in TRIAL_PLOTS
        ]
        tabs.append(rrb.Grid(*views, grid_columns=3, name=trial.name))
    return stream.build_window_blueprint(rrb.Tabs(*tabs), TIMELINE)
