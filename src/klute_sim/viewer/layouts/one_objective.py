"""Viewer recording of a tuning with one objective: objective and falls of every evaluation, and the tuned numbers."""

from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.files.json import read_json
from klute_sim.files.limits import RESULT
from klute_sim.files.lines import read_csv_records
from klute_sim.types import Array
from klute_sim.viewer import stream
from klute_sim.viewer.stream import BLUE, GREY, RED, SeriesLine

INVALID_COST = 1e6
"""Cost from which on an evaluation has failed."""
TIMELINE, RESULT_ENTITY = "evaluation", "result"
EVALUATIONS_FILES = {"walk": "walk_evaluations.csv", "joint": "joint_evaluations.csv"}
"""Rig -> file with one row per evaluation, in their order."""
EVALUATION_COLUMNS = ("evaluation", "generation", "cost", "falls")
"""Columns of that file; falls are empty for the joint, and for an evaluation with numbers that are not valid."""


def rebuild_recording(folder: Path, path: Path) -> None:
    """Write ``path`` (.rrd) from the files in the ``folder`` of a tuning; raises MissingExtraError without rerun."""
    rr = stream.import_rerun()
    result = read_json(folder / "tuning.json", RESULT)
    lines = read_csv_records(folder / EVALUATIONS_FILES[result["rig"]], RESULT)
    evaluations = {name: np.array([float(line[name] or "nan") for line in lines]) for name in EVALUATION_COLUMNS}
    with stream.open_recording(path, "tuning", [result, lines], build_blueprint) as out:
        stream.log_text(out, RESULT_ENTITY, format_page(result))
        axis = rr.TimeColumn(TIMELINE, sequence=evaluations["evaluation"].astype(np.int64))
        stream.send_lines(out, axis, build_lines(evaluations))


def build_lines(evaluations: dict[str, Array]) -> list[SeriesLine]:
    """Build the lines of the objective, without failures and falls, its minimum, and the falls where there are any."""
    falls = evaluations["falls"]
    is_valid = (evaluations["cost"] < INVALID_COST) & ~(falls > 0.0)
    cost = np.where(is_valid, evaluations["cost"], np.nan)
    lines = [
        SeriesLine("objective/all", "objective", GREY, 3.0, cost, markers_only=True),
        SeriesLine("objective/minimum", "running minimum", BLUE, 2.5, np.fmin.accumulate(cost)),
    ]
    return [*lines, SeriesLine("falls", "falls", RED, 2.0, falls, markers_only=True)] if (falls > 0.0).any() else lines


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
            result["scope"],
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
