"""Viewer recording of a joint run: position of all trials, and pressures, forces and lengths of some over time."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from klute_sim import units
from klute_sim.datasets.mechanism_channels import normalize_name
from klute_sim.errors import InputError
from klute_sim.files.json import read_json
from klute_sim.files.limits import RESULT
from klute_sim.recording import parquet
from klute_sim.report.joint.table import DEVICE_METRICS
from klute_sim.viewer import chart, stream
from klute_sim.viewer.layouts.bench import (
    ALL_TRIALS_ENTITY,
    MAX_LEGEND_NAMES,
    METRICS_ENTITY,
    TIMELINE,
    RecordedBenchTrial,
    select_tab_trials,
)
from klute_sim.viewer.stream import PALETTE, SeriesLine

DEVICE_PLOTS = (
    ("gauge pressure [bar]", "pressure"),
    ("force [N]", "force"),
    ("length of the muscle [mm]", "muscle_length"),
    ("power delivered to the joint [W]", "delivered_power"),
)
"""Title and quantity of the plots with one line per device."""


def rebuild_recording(folder: Path, path: Path) -> None:
    """Write ``path`` (.rrd) from the files in the ``folder`` of a joint run.

    Raises MissingExtraError without rerun, and InputError for damaged files.
    """
    summary = read_json(folder / "summary.json", RESULT)
    trials = [
        RecordedBenchTrial(
            trial["name"],
            trial["conditions"],
            trial["metrics"],
            parquet.load_recording(folder / f"{trial['name']}.parquet"),
        )
        for trial in summary["trials"]
    ]
    if not trials:
        raise InputError(f"{folder} has no trial to show")
    rr = stream.import_rerun()
    with stream.open_recording(path, "joint", summary, lambda: build_blueprint(summary, trials)) as out:
        stream.log_text(out, METRICS_ENTITY, format_page(summary, trials))
        chart.log_chart(out, build_chart(summary, trials))
        for number in select_tab_trials(trials):
            trial = trials[number - 1]
            axis = rr.TimeColumn(TIMELINE, duration=trial.recording["time"])
            stream.send_lines(out, axis, build_lines(summary, trial, number))


def find_position_channel(summary: Mapping[str, Any], trial: RecordedBenchTrial) -> tuple[str, str]:
    """Return the channel of the joint's position, and its label with the unit."""
    joint = normalize_name(summary["joint"])
    channel = f"angle_{joint}" if f"angle_{joint}" in trial.recording else f"position_{joint}"
    return channel, f"{channel.split('_')[0]} [{trial.recording.units[channel]}]"


def build_chart(summary: Mapping[str, Any], trials: Sequence[RecordedBenchTrial]) -> chart.Chart:
    """Build the chart of the position of all ``trials`` over time."""
    channel, label = find_position_channel(summary, trials[0])
    curves = tuple(
        chart.ChartCurve(
            trial.name,
            PALETTE[k % len(PALETTE)],
            trial.recording["time"],
            trial.recording[channel],
            in_legend=1 < len(trials) <= MAX_LEGEND_NAMES,
        )
        for k, trial in enumerate(trials)
    )
    return chart.Chart(ALL_TRIALS_ENTITY, "time [s]", label, curves)


def build_lines(summary: Mapping[str, Any], trial: RecordedBenchTrial, number: int) -> list[SeriesLine]:
    """Build all lines over time of ``trial``, which is the ``number``-th."""
    prefix, channel = f"trial_{number:03d}", find_position_channel(summary, trial)[0]
    lines = [SeriesLine(f"{prefix}/{channel}", summary["joint"], PALETTE[0], 2.0, trial.recording[channel])]
    for _, quantity in DEVICE_PLOTS:
        for k, device in enumerate(summary["devices"]):
            name = f"{quantity}_{normalize_name(device)}"
            lines.append(SeriesLine(f"{prefix}/{name}", device, PALETTE[k % len(PALETTE)], 2.0, trial.recording[name]))
    return lines


def format_page(summary: Mapping[str, Any], trials: Sequence[RecordedBenchTrial]) -> str:
    """Return the metrics of the run as Markdown."""
    keys = [
        key
        for key in dict.fromkeys(key for trial in trials for key in (*trial.settings, *trial.metrics))
        if not key.startswith(DEVICE_METRICS)
    ]
    rows = [[trial.name, *(trial.get_value(key) for key in keys)] for trial in trials]
    headings = [f"{name} [{unit}]" if unit else name for name, unit in map(units.split_unit, keys)]
    devices = ", ".join(f"{tendon}: {device}" for tendon, device in summary["devices"].items())
    table = stream.format_markdown_table(["trial", *(heading.replace("_", " ") for heading in headings)], rows)
    return f"# {summary['test']}: {summary['model']} ({devices})\n\n{table}"


def build_blueprint(summary: Mapping[str, Any], trials: Sequence[RecordedBenchTrial]) -> Any:
    """Build the layout: a tab with all trials and their metrics, and a tab for each of some trials."""
    import rerun.blueprint as rrb

    channel, label = find_position_channel(summary, trials[0])
    tabs: list[Any] = [
        rrb.Horizontal(
            chart.build_view(build_chart(summary, trials), label),
            stream.build_text_view("metrics", METRICS_ENTITY),
            name="all trials",
        )
    ]
    for number in select_tab_trials(trials):
        prefix = f"trial_{number:03d}"
        views = [stream.build_plot_view(label, [f"{prefix}/{channel}"])]
        views += [
            stream.build_plot_view(
                title, [f"{prefix}/{quantity}_{normalize_name(device)}" for device in summary["devices"]]
            )
            for title, quantity in DEVICE_PLOTS
        ]
        tabs.append(rrb.Grid(*views, grid_columns=2, name=trials[number - 1].name))
    return stream.build_window_blueprint(rrb.Tabs(*tabs), TIMELINE)
