"""A search for the rerun viewer: the objective walk by walk, tracking against air, and what was turned."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.controllers.pressure import PressureProfile, load_profile
from klute_sim.recording.recording import Array
from klute_sim.units import BAR
from klute_sim.viewer import chart, stream
from klute_sim.viewer.stream import BLUE, GREY, ORANGE, RED, SeriesLine

TIMELINE, GENERATION_TIMELINE, RESULT_ENTITY = "walk", "generation", "result"
EVALUATIONS_FILE = "tried.csv"
"""A row for every walk, in the order they were tried."""
EVALUATION_COLUMNS = ("walk", "generation", "cost", "tracking_sd2", "air_g")
"""Of that; what did not walk, or caught in swing, has a cost alone."""
MAX_VALID_COST = 1e8
"""Cost below which a walk neither caught nor fell."""
MAX_TRACKING_RATIO = 2.0
"""Times the tracking where the search began, what is left out of the chart."""


def rebuild_recording(folder: Path, path: Path) -> None:
    """Write ``path`` (.rrd) from the files of a search's ``folder``; raises MissingExtraError without rerun."""
    rr = stream.import_rerun()
    result = json.loads((folder / "tuning.json").read_text("utf-8"))
    lines = list(csv.DictReader((folder / EVALUATIONS_FILE).read_text("utf-8").splitlines()))
    tried = {name: np.array([float(line[name] or "nan") for line in lines]) for name in EVALUATION_COLUMNS}
    began = json.loads((folder / "tune.json").read_text("utf-8"))["profile"]
    before = PressureProfile(began["name"], tuple(began["gait_pct"]), tuple(began["pressure_bar"]))
    drawn = build_front_chart(tried, result), build_pressure_chart(before, load_profile(folder / "tuned.csv"))
    with stream.open_recording(path, "tuning", [result, lines], lambda: build_blueprint(*drawn)) as out:
        stream.log_text(out, RESULT_ENTITY, format_page(result, tried))
        for one in drawn:
            chart.log_chart(out, one)
        axes = [
            rr.TimeColumn(name, sequence=tried[column].astype(np.int64))
            for name, column in ((TIMELINE, "walk"), (GENERATION_TIMELINE, "generation"))
        ]
        for line in build_lines(tried):
            out.send_columns(line.entity, indexes=axes, columns=rr.Scalars.columns(scalars=line.values))
            stream.log_line_style(out, line)


def build_lines(evaluations: dict[str, Array]) -> list[SeriesLine]:
    """The objective of each walk and the least so far, and the same of its two main parts."""
    walked = evaluations["cost"] < MAX_VALID_COST
    found = []
    for name, column, label in (
        ("objective", "cost", "objective"),
        ("tracking", "tracking_sd2", "squared distance to the human"),
        ("air", "air_g", "air in a stride"),
    ):
        value = np.where(walked, evaluations[column], np.nan)
        found.append(SeriesLine(f"{name}/each", f"{label}, each walk", GREY, 3.0, value, markers_only=True))
        if column == "cost":
            least = np.fmin.accumulate(value)
            found.append(SeriesLine(f"{name}/least", "least so far", BLUE, 2.5, least))
    return found


def build_front_chart(evaluations: dict[str, Array], result: dict[str, Any]) -> chart.Chart:
    """Tracking against air of every walk, and those that nothing beats in both."""
    air, apart = evaluations["air_g"], evaluations["tracking_sd2"]
    near = apart < MAX_TRACKING_RATIO * apart[0]
    best = np.array([[each["air_g"], each["tracking_sd2"]] for each in result["front"]]).reshape(-1, 2)
    curves = (
        chart.ChartCurve("walks", GREY, air[near], apart[near], markers_only=True),
        chart.ChartCurve("nothing beats both", RED, best[:, 0], best[:, 1]),
        chart.ChartCurve("before", ORANGE, air[:1], apart[:1], markers_only=True),
    )
    return chart.Chart("front", "air in a stride [g]", "squared distance to the human [sd²]", curves)


def build_pressure_chart(before: PressureProfile, tuned: PressureProfile) -> chart.Chart:
    """The profile where the search began, and as tuned."""
    cycle = np.linspace(0.0, 1.0, 201)
    curves = (
        chart.ChartCurve("before", ORANGE, 100.0 * cycle, before.pressures_at(cycle) / BAR, thin=True),
        chart.ChartCurve("tuned", BLUE, 100.0 * cycle, tuned.pressures_at(cycle) / BAR),
    )
    return chart.Chart("profile", "gait cycle [%]", "commanded pressure [bar]", curves)


def format_page(result: dict[str, Any], evaluations: dict[str, Array]) -> str:
    """What came of it, what was turned, and what a reader has to know."""
    cost, out = result["cost"], int((~(evaluations["cost"] < MAX_VALID_COST)).sum())
    fell = 100.0 * (1.0 - cost["tuned"] / cost["before"])
    rows = [[row["name"], row["before"], row["tuned"], row["human"]] for row in result["table"]]
    knobs = [[name, knob["before"], knob["tuned"]] for name, knob in result["knobs"].items()]
    return "\n\n".join(
        [
            f"# The objective fell by {fell:.0f} % in {result['walks']} walks (seed {result['seed']})",
            f"{out} of them caught the ground in swing, fell, or had no device, and are not in the plots.",
            stream.format_markdown_table(["", "before", "tuned", "human"], rows),
            *result["remarks"],
            stream.format_markdown_table(["what was turned", "before", "tuned"], knobs),
        ]
    )


def build_blueprint(front_chart: chart.Chart, profile_chart: chart.Chart) -> Any:
    """Layout: the objective over the walks, tracking and air under it; the charts; the result on the right."""
    import rerun.blueprint as rrb

    names = {
        "objective": "objective",
        "tracking": "tracking [sd²]",
        "air": "air in a stride [g]",
    }
    first, *rest = (rrb.TimeSeriesView(origin=f"/{entity}", name=name) for entity, name in names.items())
    left = rrb.Vertical(first, rrb.Horizontal(*rest), row_shares=[3, 2])
    middle = rrb.Vertical(
        chart.build_view(front_chart, "tracking against air"), chart.build_view(profile_chart, "pressure profile")
    )
    right = stream.build_text_view("result", RESULT_ENTITY)
    return stream.build_window_blueprint(rrb.Horizontal(left, middle, right, column_shares=[4, 3, 3]), TIMELINE)
