"""Viewer recording of a tuning in predicted walks: objective and falls of every evaluation, and the tuned numbers."""

from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.files.json import read_json
from klute_sim.files.limits import RESULT
from klute_sim.files.lines import read_csv_records
from klute_sim.types import Array
from klute_sim.viewer import stream
from klute_sim.viewer.stream import BLUE, GREY, RED, SeriesLine

TIMELINE, RESULT_ENTITY = "evaluation", "result"
EVALUATIONS_FILE = "walk_evaluations.csv"
"""File with one row per evaluation, in their order."""
EVALUATION_COLUMNS = ("evaluation", "generation", "cost", "falls")
"""Columns of that file; an evaluation with numbers that are not valid has no falls."""


def rebuild_recording(folder: Path, path: Path) -> None:
    """Write ``path`` (.rrd) from the files in the ``folder`` of a tuning; raises MissingExtraError without rerun."""
    rr = stream.import_rerun()
    result = read_json(folder / "tuning.json", RESULT)
    lines = read_csv_records(folder / EVALUATIONS_FILE, RESULT)
    evaluations = {name: np.array([float(line[name] or "nan") for line in lines]) for name in EVALUATION_COLUMNS}
    with stream.open_recording(path, "tuning", [result, lines], build_blueprint) as out:
        stream.log_text(out, RESULT_ENTITY, format_page(result))
        axis = rr.TimeColumn(TIMELINE, sequence=evaluations["evaluation"].astype(np.int64))
        stream.send_lines(out, axis, build_lines(evaluations))


def build_lines(evaluations: dict[str, Array]) -> list[SeriesLine]:
    """Build the lines of the objective, without evaluations in which somebody falls, its minimum, and the falls."""
    cost = np.where(evaluations["falls"] == 0.0, evaluations["cost"], np.nan)
    return [
        SeriesLine("objective/all", "objective, nobody falls", GREY, 3.0, cost, markers_only=True),
        SeriesLine("objective/minimum", "running minimum", BLUE, 2.5, np.fmin.accumulate(cost)),
        SeriesLine("falls", "falls", RED, 2.0, evaluations["falls"], markers_only=True),
    ]


def format_page(result: dict[str, Any]) -> str:
    """Return the outcomes before and after tuning, and the tuned numbers, as Markdown."""
    cost = result["cost"]
    reduction = 100.0 * (1.0 - cost["tuned"] / cost["before"])
    before, tuned = (result["metrics"][name] or {} for name in ("before", "tuned"))
    rows = [[name.replace("_", " "), before.get(name), tuned.get(name)] for name in before]
    variables = [[name, value["before"], value["tuned"]] for name, value in result["design_variables"].items()]
    return "\n\n".join(
        [
            f"# The objective fell by {reduction:.0f} % in {result['evaluations']} evaluations (seed {result['seed']})",
            f"Means over the walks of {result['seconds']:g} s of: {', '.join(result['walkers'])}. The persons have not "
            "adapted to the tuned state machine.",
            stream.format_markdown_table(["", "before", "tuned"], rows),
            stream.format_markdown_table(["tuned number", "before", "tuned"], variables),
        ]
    )


def build_blueprint() -> Any:
    """Build the layout: objective over falls, and the result."""
    import rerun.blueprint as rrb

    plots = [rrb.TimeSeriesView(origin=f"/{entity}", name=entity) for entity in ("objective", "falls")]
    left = rrb.Vertical(*plots, row_shares=[3, 1])
    right = stream.build_text_view("result", RESULT_ENTITY)
    return stream.build_window_blueprint(rrb.Horizontal(left, right, column_shares=[3, 2]), TIMELINE)
