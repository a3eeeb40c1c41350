"""A comparison for the rerun viewer: every channel's curves and bands over one another, differences underneath."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.comparison.comparison import Comparison, ComparisonPart
from klute_sim.comparison.results import as_json
from klute_sim.report.comparison import text as words
from klute_sim.report.comparison.table import collect_remarks
from klute_sim.viewer import stream
from klute_sim.viewer.stream import ORANGE, PALETTE, WHITE, SeriesLine

TIMELINES = {"phase": "gait_cycle_percent", "time": "time"}
BASELINE_COLOUR, HUMAN_COLOUR = WHITE, ORANGE
SERIES_COLOURS = tuple(colour for colour in PALETTE if colour != HUMAN_COLOUR)
MAX_TRIAL_TABS = 6
"""Tabs: those of the first trials; every trial is in the file."""
NUMBERS_ENTITY = "numbers"


def write_recording(comparison: Comparison, path: Path) -> None:
    """Write ``found`` to ``path`` (.rrd); raises MissingExtraError without rerun."""
    rr = stream.import_rerun()
    with stream.open_recording(path, "comparison", as_json(comparison), lambda: build_blueprint(comparison)) as out:
        stream.log_text(out, NUMBERS_ENTITY, format_page(comparison))
        for number, part in enumerate(comparison.parts, start=1):
            # The phases are whole percents.
            axis = (
                rr.TimeColumn(TIMELINES["phase"], sequence=np.rint(part.axis).astype(np.int64))
                if comparison.domain == "phase"
                else rr.TimeColumn(TIMELINES["time"], duration=part.axis)
            )
            stream.send_lines(out, axis, build_lines(part, number, comparison.domain))


def build_lines(part: ComparisonPart, number: int, domain: str) -> Iterator[SeriesLine]:
    """All lines of the ``number``-th part.

    Parts and series go by numbers, because their names may hold what an entity's name may not.
    """
    colours = [HUMAN_COLOUR if s.is_reference else BASELINE_COLOUR if k == 0 else SERIES_COLOURS[(k - 1) % len(SERIES_COLOURS)]
               for k, s in enumerate(part.series)]  # fmt: skip
    for channel, others in part.differences.items():
        here = f"part_{number}/{channel}"
        for k, (series, colour) in enumerate(zip(part.series, colours, strict=True)):
            curve = series.curves.get(channel)
            if curve is None:
                continue
            # A band has the name of its curve: legends show what is called alike once.
            name = words.format_series(series, domain)
            yield SeriesLine(f"{here}/curves/series_{k}/mean", name, colour, 2.5, curve.mean)
            if not curve.lacks_sd:
                for side, sign in (("low", -1.0), ("high", 1.0)):
                    yield SeriesLine(
                        f"{here}/curves/series_{k}/{side}", name, colour, 0.7, curve.mean + sign * curve.sd
                    )
            if series.label in others:
                d = others[series.label]
                yield SeriesLine(f"{here}/difference/series_{k}/mean", series.label, colour, 2.0, d.values)
                if d.band != "none":
                    for side, sign in (("low", -1.0), ("high", 1.0)):
                        yield SeriesLine(
                            f"{here}/difference/series_{k}/{side}", series.label, colour, 0.7, sign * d.half_width
                        )


def format_page(comparison: Comparison) -> str:
    """Every number of the comparison, and how to read it."""
    over, series = comparison.domain, comparison.parts[0].series
    if comparison.is_single:
        title, headings = words.format_series(series[0], over), ["trial", "channel", *words.EXTENT_HEADINGS]
        rows = [[_format_trial(part), _format_channel(part, channel), *told] for part in comparison.parts
                for channel, told in words.iter_extents(part, over)]  # fmt: skip
    else:
        title = f"{', '.join(each.label for each in series[1:])} against {series[0].label}"
        headings = ["trial", "channel", "series", "bias", "rms", "rms/sd", "largest", "at", "half of it"]
        rows = [
            [
                _format_trial(row.part),
                _format_channel(row.part, row.channel),
                row.label,
                words.format_bias(row.difference),
                words.format_number(row.difference.rms),
                words.format_number(row.difference.rms_sd),
                words.format_number(row.difference.max_difference, "+.3g"),
                words.format_position(row.difference.max_position, over),
                words.format_half_error_interval(row, over),
            ]
            for row in words.iter_rows(comparison)
        ]
    said = [f"- {remark}" for remark in collect_remarks(comparison)]
    return f"# {title}\n\n{stream.format_markdown_table(headings, rows)}\n" + "\n".join(said)


def _format_trial(part: ComparisonPart) -> str:
    return part.name or "-"


def _format_channel(part: ComparisonPart, channel: str) -> str:
    return f"{words.humanize_channel(channel)} [{words.format_unit(part.units[channel])}]"


def build_blueprint(comparison: Comparison) -> Any:
    """Layout: a tab for each part; in it the channels side by side, their differences underneath; then the numbers."""
    import rerun.blueprint as rrb

    tabs: list[Any] = []
    shown = [("curves", "{} [{}]"), *[("difference", "{}, difference [{}]")] * (not comparison.is_single)]
    for number, part in enumerate(comparison.parts[:MAX_TRIAL_TABS], start=1):
        plots = []
        for place, channel in enumerate(part.differences):
            unit = words.format_unit(part.units[channel])
            # Names of series are long, and the colours are the same in all charts: one legend is enough.
            views = [
                rrb.TimeSeriesView(
                    origin=f"/part_{number}/{channel}/{inside}",
                    name=title.format(words.humanize_channel(channel), unit),
                    plot_legend=rrb.PlotLegend(visible=inside == "curves" and place == 0),
                )
                for inside, title in shown
            ]
            plots.append(rrb.Vertical(*views, row_shares=[3, 2][: len(views)], name=words.humanize_channel(channel)))
        tabs.append(rrb.Grid(*plots, grid_columns=min(3, len(plots)), name=part.name or "curves"))
    return stream.build_window_blueprint(
        rrb.Tabs(*tabs, stream.build_text_view("numbers", NUMBERS_ENTITY)), TIMELINES[comparison.domain]
    )
