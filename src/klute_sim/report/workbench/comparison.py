"""A comparison for the rerun viewer: every channel's curves and bands over one another, differences underneath."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.compare.comparison import Comparison, Part
from klute_sim.compare.results import as_json
from klute_sim.report import compare_words as words
from klute_sim.report.compare_table import remarks
from klute_sim.report.workbench import stream
from klute_sim.report.workbench.stream import MANY, ORANGE, WHITE, Line

TIMELINES = {"phase": "gait_cycle_percent", "time": "time"}
FIRST, HUMAN = WHITE, ORANGE
OTHERS = tuple(colour for colour in MANY if colour != HUMAN)
MOST_TRIALS = 6
"""Tabs: those of the first trials; every trial is in the file."""
NUMBERS = "numbers"


def write(found: Comparison, path: Path) -> None:
    """Write ``found`` to ``path`` (.rrd); raises MissingExtraError without rerun."""
    rr = stream.sdk()
    with stream.recorded(path, "comparison", as_json(found), lambda: blueprint(found)) as out:
        stream.tell(out, NUMBERS, page(found))
        for number, part in enumerate(found.parts, start=1):
            # The phases are whole percents.
            axis = (
                rr.TimeColumn(TIMELINES["phase"], sequence=np.rint(part.axis).astype(np.int64))
                if found.over == "phase"
                else rr.TimeColumn(TIMELINES["time"], duration=part.axis)
            )
            stream.send(out, axis, lines(part, number, found.over))


def lines(part: Part, number: int, over: str) -> Iterator[Line]:
    """All lines of the ``number``-th part.

    Parts and series go by numbers, because their names may hold what an entity's name may not.
    """
    colours = [HUMAN if s.reference else FIRST if k == 0 else OTHERS[(k - 1) % len(OTHERS)]
               for k, s in enumerate(part.series)]  # fmt: skip
    for channel, others in part.differences.items():
        here = f"part_{number}/{channel}"
        for k, (series, colour) in enumerate(zip(part.series, colours, strict=True)):
            curve = series.curves.get(channel)
            if curve is None:
                continue
            # A band has the name of its curve: legends show what is called alike once.
            name = words.named(series, over)
            yield Line(f"{here}/curves/series_{k}/mean", name, colour, 2.5, curve.mean)
            if not curve.unspread:
                for side, sign in (("low", -1.0), ("high", 1.0)):
                    yield Line(f"{here}/curves/series_{k}/{side}", name, colour, 0.7, curve.mean + sign * curve.sd)
            if series.label in others:
                d = others[series.label]
                yield Line(f"{here}/difference/series_{k}/mean", series.label, colour, 2.0, d.values)
                if d.band != "none":
                    for side, sign in (("low", -1.0), ("high", 1.0)):
                        yield Line(f"{here}/difference/series_{k}/{side}", series.label, colour, 0.7, sign * d.width)


def page(found: Comparison) -> str:
    """Every number of the comparison, and how to read it."""
    over, series = found.over, found.parts[0].series
    if found.alone:
        title, headings = words.named(series[0], over), ["trial", "channel", *words.EXTENT]
        rows = [[_trial(part), _channel(part, channel), *told] for part in found.parts
                for channel, told in words.extents(part, over)]  # fmt: skip
    else:
        title = f"{', '.join(each.label for each in series[1:])} against {series[0].label}"
        headings = ["trial", "channel", "series", "bias", "rms", "rms/sd", "largest", "at", "half of it"]
        rows = [
            [
                _trial(row.part),
                _channel(row.part, row.channel),
                row.other,
                words.bias(row.difference),
                words.number(row.difference.rms),
                words.number(row.difference.rms_sd),
                words.number(row.difference.largest, "+.3g"),
                words.place(row.difference.at, over),
                words.half(row, over),
            ]
            for row in words.rows(found)
        ]
    said = [f"- {remark}" for remark in remarks(found)]
    return f"# {title}\n\n{stream.table(headings, rows)}\n" + "\n".join(said)


def _trial(part: Part) -> str:
    return part.name or "-"


def _channel(part: Part, channel: str) -> str:
    return f"{words.spoken(channel)} [{words.unit(part.units[channel])}]"


def blueprint(found: Comparison) -> Any:
    """Layout: a tab for each part; in it the channels side by side, their differences underneath; then the numbers."""
    import rerun.blueprint as rrb

    tabs: list[Any] = []
    shown = [("curves", "{} [{}]"), *[("difference", "{}, difference [{}]")] * (not found.alone)]
    for number, part in enumerate(found.parts[:MOST_TRIALS], start=1):
        plots = []
        for place, channel in enumerate(part.differences):
            unit = words.unit(part.units[channel])
            # Names of series are long, and the colours are the same in all charts: one legend is enough.
            views = [
                rrb.TimeSeriesView(
                    origin=f"/part_{number}/{channel}/{inside}",
                    name=title.format(words.spoken(channel), unit),
                    plot_legend=rrb.PlotLegend(visible=inside == "curves" and place == 0),
                )
                for inside, title in shown
            ]
            plots.append(rrb.Vertical(*views, row_shares=[3, 2][: len(views)], name=words.spoken(channel)))
        tabs.append(rrb.Grid(*plots, grid_columns=min(3, len(plots)), name=part.name or "curves"))
    return stream.whole(rrb.Tabs(*tabs, stream.words("numbers", NUMBERS)), TIMELINES[found.over])
