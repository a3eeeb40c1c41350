"""Viewer recording of a training: learning curve, and the policy compared with a baseline."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.errors import InputError
from klute_sim.files.json import read_json
from klute_sim.files.limits import RESULT
from klute_sim.files.lines import read_csv_records
from klute_sim.training.folder import LEARNING_CURVE_FILE
from klute_sim.training.training import LEARNING_CURVE_COLUMNS
from klute_sim.types import Array
from klute_sim.viewer import stream
from klute_sim.viewer.stream import BLUE, GREEN, ORANGE, VIOLET, SeriesLine

TIMELINE, SUMMARY_ENTITY = "steps", "summary"
PLOTS = {
    "episode return": ("curve/episode_return", "evaluated/policy", "evaluated/baseline"),
    "steps per episode": ("curve/episode_steps",),
    "minutes": ("curve/minutes",),
}


def rebuild_recording(folder: Path, path: Path) -> None:
    """Write ``path`` (.rrd) from the files in the ``folder`` of a training, which may be unfinished.

    Raises MissingExtraError without rerun, and InputError before the end of the first episode.
    """
    rr = stream.import_rerun()
    lines = read_csv_records(folder / LEARNING_CURVE_FILE, RESULT)
    curve = {name: np.array([float(line[name]) for line in lines]) for name in LEARNING_CURVE_COLUMNS}
    if not lines:
        raise InputError(f"{folder} has no learning curve yet: no episode has ended")
    summary_file = folder / "summary.json"
    summary = read_json(summary_file, RESULT) if summary_file.is_file() else None
    layout = partial(build_blueprint, int(curve["steps"][-1]))
    with stream.open_recording(path, "training", [folder.name, summary, lines], layout) as out:
        stream.log_text(out, SUMMARY_ENTITY, format_page(curve, summary))
        axis = rr.TimeColumn(TIMELINE, sequence=curve["steps"].astype(np.int64))
        stream.send_lines(out, axis, build_lines(curve, summary))


def build_lines(curve: dict[str, Array], summary: dict[str, Any] | None) -> list[SeriesLine]:
    """Build the lines of the learning curve and, after the evaluation, of the returns of policy and baseline."""
    lines = [
        SeriesLine("curve/episode_return", "policy, exploring", BLUE, 2.0, curve["episode_return"]),
        SeriesLine("curve/episode_steps", "steps per episode", VIOLET, 2.0, curve["episode_steps"]),
        SeriesLine("curve/minutes", "minutes of training", VIOLET, 2.0, curve["minutes"]),
    ]
    if summary is not None:
        for name, label, colour in (
            ("policy", "policy, evaluated", GREEN),
            ("baseline", summary["baseline_name"], ORANGE),
        ):
            episode_return = np.full(len(curve["steps"]), float(summary[name]["return"]))
            lines.append(SeriesLine(f"evaluated/{name}", label, colour, 1.0, episode_return))
    return lines


def format_page(curve: dict[str, Array], summary: dict[str, Any] | None) -> str:
    """Return the progress of the training, and the metrics of policy and baseline, as Markdown."""
    if summary is None:
        return (
            f"# Training, not finished\n\n{int(curve['steps'][-1])} steps in {curve['minutes'][-1]:.1f} minutes so far."
        )
    title = f"# {summary['algorithm'].upper()}, seed {summary['seed']}"
    progress = f"{summary['steps']} steps in {summary['minutes']:.1f} minutes."
    gain = (
        f"The policy is better in {summary['n_better_episodes']} of {summary['episodes']} episodes, "
        f"by {summary['gain']:.2f} ± {summary['gain_standard_error']:.2f} on average (standard error)."
    )
    rows = [[name.replace("_", " "), value, summary["baseline"][name]] for name, value in summary["policy"].items()]
    table = stream.format_markdown_table(["mean per episode", "policy", summary["baseline_name"]], rows)
    return f"{title}\n\n{progress}\n\n{gain}\n\n{table}"


def build_blueprint(last_step: int) -> Any:
    """Build the layout: learning curve up to ``last_step``, episode length, minutes, and the summary."""
    import rerun.blueprint as rrb

    first, *rest = (stream.build_plot_view(name, entities, (0, last_step)) for name, entities in PLOTS.items())
    curves = rrb.Vertical(first, rrb.Horizontal(*rest), row_shares=[2, 1])
    return stream.build_window_blueprint(
        rrb.Horizontal(curves, stream.build_text_view("summary", SUMMARY_ENTITY), column_shares=[3, 2]), TIMELINE
    )
