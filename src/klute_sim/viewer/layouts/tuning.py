"""Viewer recording of a tuning: objective of every evaluation, tracking error over air, and tuned parameters."""

from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.controllers.pressure import PressureProfile, load_profile
from klute_sim.files.json import read_json
from klute_sim.files.limits import RESULT
from klute_sim.files.lines import read_csv_records
from klute_sim.types import Array
from klute_sim.units import BAR
from klute_sim.viewer import chart, stream
from klute_sim.viewer.stream import BLUE, GREY, ORANGE, RED, SeriesLine

TIMELINE, GENERATION_TIMELINE, RESULT_ENTITY = "evaluation", "generation", "result"
EVALUATIONS_FILE = "evaluations.csv"
"""File with one row per evaluation, in their order."""
EVALUATION_COLUMNS = ("evaluation", "generation", "cost", "tracking_sd2", "air_g")
"""Columns of that file; evaluations that failed or touched the ground in swing have a cost only."""
MAX_VALID_COST = 1e8
"""Cost below which an evaluation neither failed nor touched the ground in swing."""
MAX_TRACKING_RATIO = 2.0
"""Ratio of tracking error to initial tracking error above which evaluations are omitted from the chart."""


def rebuild_recording(folder: Path, path: Path) -> None:
    """Write ``path`` (.rrd) from the files in the ``folder`` of a tuning.

    Raises MissingExtraError without rerun.
    """
    rr = stream.import_rerun()
    result = read_json(folder / "tuning.json", RESULT)
    lines = read_csv_records(folder / EVALUATIONS_FILE, RESULT)
    evaluations = {name: np.array([float(line[name] or "nan") for line in lines]) for name in EVALUATION_COLUMNS}
    initial = read_json(folder / "tune.json", RESULT)["profile"]
    before = PressureProfile(initial["name"], tuple(initial["gait_pct"]), tuple(initial["pressure_bar"]))
    charts = build_front_chart(evaluations, result), build_pressure_chart(before, load_profile(folder / "tuned.csv"))
    with stream.open_recording(path, "tuning", [result, lines], lambda: build_blueprint(*charts)) as out:
        stream.log_text(out, RESULT_ENTITY, format_page(result, evaluations))
        for result_chart in charts:
            chart.log_chart(out, result_chart)
        axes = [
            rr.TimeColumn(name, sequence=evaluations[column].astype(np.int64))
            for name, column in ((TIMELINE, "evaluation"), (GENERATION_TIMELINE, "generation"))
        ]
        for line in build_lines(evaluations):
            out.send_columns(line.entity, indexes=axes, columns=rr.Scalars.columns(scalars=line.values))
            stream.log_line_style(out, line)


def build_lines(evaluations: dict[str, Array]) -> list[SeriesLine]:
    """Build the lines of the objective with its running minimum, and of its two main terms."""
    is_valid = evaluations["cost"] < MAX_VALID_COST
    lines = []
    for name, column, label in (
        ("objective", "cost", "objective"),
        ("tracking", "tracking_sd2", "squared distance to the human"),
        ("air", "air_g", "air per stride"),
    ):
        value = np.where(is_valid, evaluations[column], np.nan)
        lines.append(SeriesLine(f"{name}/all", f"{label}, all evaluations", GREY, 3.0, value, markers_only=True))
        if column == "cost":
            minimum = np.fmin.accumulate(value)
            lines.append(SeriesLine(f"{name}/minimum", "running minimum", BLUE, 2.5, minimum))
    return lines


def build_front_chart(evaluations: dict[str, Array], result: dict[str, Any]) -> chart.Chart:
    """Build the chart of tracking error over air, for all evaluations and for the Pareto front."""
    air, tracking = evaluations["air_g"], evaluations["tracking_sd2"]
    is_shown = tracking < MAX_TRACKING_RATIO * tracking[0]
    front = np.array([[point["air_g"], point["tracking_sd2"]] for point in result["front"]]).reshape(-1, 2)
    curves = (
        chart.ChartCurve("evaluations", GREY, air[is_shown], tracking[is_shown], markers_only=True),
        chart.ChartCurve("Pareto front", RED, front[:, 0], front[:, 1]),
        chart.ChartCurve("before", ORANGE, air[:1], tracking[:1], markers_only=True),
    )
    return chart.Chart("front", "air per stride [g]", "squared distance to the human [sd²]", curves)


def build_pressure_chart(before: PressureProfile, tuned: PressureProfile) -> chart.Chart:
    """Build the chart of the pressure profile before and after tuning."""
    cycle = np.linspace(0.0, 1.0, 201)
    curves = (
        chart.ChartCurve("before", ORANGE, 100.0 * cycle, before.pressures_at(cycle) / BAR, thin=True),
        chart.ChartCurve("tuned", BLUE, 100.0 * cycle, tuned.pressures_at(cycle) / BAR),
    )
    return chart.Chart("profile", "gait cycle [%]", "commanded pressure [bar]", curves)


def format_page(result: dict[str, Any], evaluations: dict[str, Array]) -> str:
    """Return metrics, remarks and tuned parameters as Markdown."""
    cost, n_invalid = result["cost"], int((~(evaluations["cost"] < MAX_VALID_COST)).sum())
    reduction = 100.0 * (1.0 - cost["tuned"] / cost["before"])
    rows = [[row["name"], row["before"], row["tuned"], row["human"]] for row in result["table"]]
    variables = [[name, variable["before"], variable["tuned"]] for name, variable in result["design_variables"].items()]
    return "\n\n".join(
        [
            f"# The objective fell by {reduction:.0f} % in {result['evaluations']} evaluations (seed {result['seed']})",
            f"{n_invalid} of them are not in the plots: the foot touched the ground in swing, the gait failed, or the "
            "device was invalid.",
            stream.format_markdown_table(["", "before", "tuned", "human"], rows),
            *result["remarks"],
            stream.format_markdown_table(["tuned parameter", "before", "tuned"], variables),
        ]
    )


def build_blueprint(front_chart: chart.Chart, profile_chart: chart.Chart) -> Any:
    """Build the layout: objective, tracking error and air over the evaluations; both charts; the result."""
    import rerun.blueprint as rrb

    names = {
        "objective": "objective",
        "tracking": "tracking [sd²]",
        "air": "air per stride [g]",
    }
    first, *rest = (rrb.TimeSeriesView(origin=f"/{entity}", name=name) for entity, name in names.items())
    left = rrb.Vertical(first, rrb.Horizontal(*rest), row_shares=[3, 2])
    middle = rrb.Vertical(
        chart.build_view(front_chart, "tracking error over air"), chart.build_view(profile_chart, "pressure profile")
    )
    right = stream.build_text_view("result", RESULT_ENTITY)
    return stream.build_window_blueprint(rrb.Horizontal(left, middle, right, column_shares=[4, 3, 3]), TIMELINE)
