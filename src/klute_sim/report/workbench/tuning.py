"""A search for the rerun viewer: the objective walk by walk, tracking against air, and what was turned."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.control.pressure import Profile, load_profile
from klute_sim.recording.recording import Samples
from klute_sim.report.workbench import chart, stream
from klute_sim.report.workbench.stream import BLUE, GREY, ORANGE, RED, Line
from klute_sim.units import BAR

TIMELINE, GENERATION, RESULT = "walk", "generation", "result"
TRIED = "tried.csv"
"""A row for every walk, in the order they were tried."""
COLUMNS = ("walk", "generation", "cost", "tracking_sd2", "air_g")
"""Of that; what did not walk, or caught in swing, has a cost alone."""
WALKED = 1e8
"""Cost below which a walk neither caught nor fell."""
FAR = 2.0
"""Times the tracking where the search began, what is left out of the chart."""


def remake(folder: Path, path: Path) -> None:
    """Write ``path`` (.rrd) from the files of a search's ``folder``; raises MissingExtraError without rerun."""
    rr = stream.sdk()
    result = json.loads((folder / "tuning.json").read_text("utf-8"))
    lines = list(csv.DictReader((folder / TRIED).read_text("utf-8").splitlines()))
    tried = {name: np.array([float(line[name] or "nan") for line in lines]) for name in COLUMNS}
    began = json.loads((folder / "tune.json").read_text("utf-8"))["profile"]
    before = Profile(began["name"], tuple(began["gait_pct"]), tuple(began["pressure_bar"]))
    drawn = front(tried, result), pressures(before, load_profile(folder / "tuned.csv"))
    with stream.recorded(path, "tuning", [result, lines], lambda: blueprint(*drawn)) as out:
        stream.tell(out, RESULT, page(result, tried))
        for one in drawn:
            chart.log(out, one)
        axes = [
            rr.TimeColumn(name, sequence=tried[column].astype(np.int64))
            for name, column in ((TIMELINE, "walk"), (GENERATION, "generation"))
        ]
        for line in series(tried):
            out.send_columns(line.entity, indexes=axes, columns=rr.Scalars.columns(scalars=line.value))
            stream.look(out, line)


def series(tried: dict[str, Samples]) -> list[Line]:
    """The objective of each walk and the least so far, and the same of its two main parts."""
    walked = tried["cost"] < WALKED
    found = []
    for name, column, label in (
        ("objective", "cost", "objective"),
        ("tracking", "tracking_sd2", "squared distance to the human"),
        ("air", "air_g", "air in a stride"),
    ):
        value = np.where(walked, tried[column], np.nan)
        found.append(Line(f"{name}/each", f"{label}, each walk", GREY, 3.0, value, dots=True))
        if column == "cost":
            least = np.fmin.accumulate(value)
            found.append(Line(f"{name}/least", "least so far", BLUE, 2.5, least))
    return found


def front(tried: dict[str, Samples], result: dict[str, Any]) -> chart.Chart:
    """Tracking against air of every walk, and those that nothing beats in both."""
    air, apart = tried["air_g"], tried["tracking_sd2"]
    near = apart < FAR * apart[0]
    best = np.array([[each["air_g"], each["tracking_sd2"]] for each in result["front"]]).reshape(-1, 2)
    curves = (
        chart.Curve("walks", GREY, air[near], apart[near], dots=True),
        chart.Curve("nothing beats both", RED, best[:, 0], best[:, 1]),
        chart.Curve("before", ORANGE, air[:1], apart[:1], dots=True),
    )
    return chart.Chart("front", "air in a stride [g]", "squared distance to the human [sd²]", curves)


def pressures(before: Profile, tuned: Profile) -> chart.Chart:
    """The profile where the search began, and as tuned."""
    cycle = np.linspace(0.0, 1.0, 201)
    curves = (
        chart.Curve("before", ORANGE, 100.0 * cycle, before.pressures(cycle) / BAR, thin=True),
        chart.Curve("tuned", BLUE, 100.0 * cycle, tuned.pressures(cycle) / BAR),
    )
    return chart.Chart("profile", "gait cycle [%]", "commanded pressure [bar]", curves)


def page(result: dict[str, Any], tried: dict[str, Samples]) -> str:
    """What came of it, what was turned, and what a reader has to know."""
    cost, out = result["cost"], int((~(tried["cost"] < WALKED)).sum())
    fell = 100.0 * (1.0 - cost["tuned"] / cost["before"])
    rows = [[row["name"], row["before"], row["tuned"], row["human"]] for row in result["table"]]
    knobs = [[name, knob["before"], knob["tuned"]] for name, knob in result["knobs"].items()]
    return "\n\n".join(
        [
            f"# The objective fell by {fell:.0f} % in {result['walks']} walks (seed {result['seed']})",
            f"{out} of them caught the ground in swing, fell, or had no device, and are not in the plots.",
            stream.table(["", "before", "tuned", "human"], rows),
            *result["remarks"],
            stream.table(["what was turned", "before", "tuned"], knobs),
        ]
    )


def blueprint(parts: chart.Chart, profile: chart.Chart) -> Any:
    """Layout: the objective over the walks, tracking and air under it; the charts; the result on the right."""
    import rerun.blueprint as rrb

    names = {
        "objective": "objective",
        "tracking": "tracking [sd²]",
        "air": "air in a stride [g]",
    }
    first, *rest = (rrb.TimeSeriesView(origin=f"/{entity}", name=name) for entity, name in names.items())
    left = rrb.Vertical(first, rrb.Horizontal(*rest), row_shares=[3, 2])
    middle = rrb.Vertical(chart.view(parts, "tracking against air"), chart.view(profile, "pressure profile"))
    right = stream.words("result", RESULT)
    return stream.whole(rrb.Horizontal(left, middle, right, column_shares=[4, 3, 3]), TIMELINE)
