"""A comparison for the rerun viewer: every channel's curves and bands over one another, differences underneath.

rerun is an optional extra and is imported when it is used.
"""

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from klute_sim.compare.comparison import Comparison, Part
from klute_sim.compare.results import as_json
from klute_sim.errors import MissingExtraError
from klute_sim.recording.recording import Samples
from klute_sim.report import compare_words as words

TIMELINES = {"phase": "gait_cycle_percent", "time": "time"}

FIRST, HUMAN = (200, 200, 200), (255, 150, 40)
OTHERS = ((31, 119, 180), (44, 160, 44), (214, 39, 40), (148, 103, 189), (140, 86, 75), (23, 190, 207))
MOST_TRIALS = 6
"""Tabs: those of the first trials; every trial is in the file."""


class Line(NamedTuple):
    """A series in a plot."""

    entity: str
    name: str
    colour: tuple[int, int, int]
    width: float
    value: Samples
    """In the channel's unit; NaN where there is none."""


def write(found: Comparison, path: Path) -> None:
    """Write ``found`` to ``path`` (.rrd); raises MissingExtraError without rerun."""
    try:
        import rerun as rr
    except ImportError:
        raise MissingExtraError("a rerun recording", "rerun") from None

    identity = hashlib.sha256(json.dumps(as_json(found), sort_keys=True).encode()).hexdigest()
    stream = rr.RecordingStream("klute-sim", recording_id=identity, send_properties=False)
    stream.save(path, default_blueprint=blueprint(found))
    for number, part in enumerate(found.parts, start=1):
        # The phases are whole percents.
        axis = (
            rr.TimeColumn(TIMELINES["phase"], sequence=np.rint(part.axis).astype(np.int64))
            if found.over == "phase"
            else rr.TimeColumn(TIMELINES["time"], duration=part.axis)
        )
        for line in lines(part, number, found.over):
            stream.send_columns(line.entity, indexes=[axis], columns=rr.Scalars.columns(scalars=line.value))
            style = rr.SeriesLines(names=line.name, colors=line.colour, widths=line.width)
            stream.log(line.entity, style, static=True)
    stream.flush()
    stream.disconnect()


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
            yield Line(f"{here}/curves/series_{k}/mean", words.named(series, over), colour, 2.5, curve.mean)
            if not curve.unspread:
                for side, sign in (("low", -1.0), ("high", 1.0)):
                    name = f"{series.label} {'-' if sign < 0.0 else '+'} 1 sd"
                    yield Line(f"{here}/curves/series_{k}/{side}", name, colour, 0.7, curve.mean + sign * curve.sd)
            if series.label in others:
                d = others[series.label]
                yield Line(f"{here}/difference/series_{k}/mean", series.label, colour, 2.0, d.values)
                if d.band != "none":
                    for side, sign in (("low", -1.0), ("high", 1.0)):
                        name = f"{series.label}, 95 % of no difference"
                        yield Line(f"{here}/difference/series_{k}/{side}", name, colour, 0.7, sign * d.width)


def blueprint(found: Comparison) -> Any:
    """Layout: a tab for each part; in it the channels side by side, their differences underneath."""
    import rerun.blueprint as rrb

    tabs = []
    shown = [("curves", "{} [{}]"), *[("difference", "{}, difference [{}]")] * (not found.alone)]
    for number, part in enumerate(found.parts[:MOST_TRIALS], start=1):
        plots = []
        for channel in part.differences:
            unit = words.unit(part.units[channel])
            views = [
                rrb.TimeSeriesView(
                    origin=f"/part_{number}/{channel}/{inside}", name=title.format(words.spoken(channel), unit)
                )
                for inside, title in shown
            ]
            plots.append(rrb.Vertical(*views, row_shares=[2, 1][: len(views)], name=words.spoken(channel)))
        tabs.append(rrb.Grid(*plots, grid_columns=min(3, len(plots)), name=part.name or "comparison"))
    return rrb.Blueprint(
        rrb.Tabs(*tabs),
        rrb.TimePanel(state="collapsed", timeline=TIMELINES[found.over]),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
    )
