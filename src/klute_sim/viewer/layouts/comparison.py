"""Viewer recording of a comparison: curves and bands of every channel, with their differences below."""

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
"""Maximum number of trials with a tab; the file has all trials."""
NUMBERS_ENTITY = "numbers"


def write_recording(comparison: Comparison, path: Path) -> None:
    """Write ``comparison`` to ``path`` (.rrd).

    Raises MissingExtraError without rerun.
    """
    rr = stream.import_rerun()
    with stream.open_recording(path, "comparison", as_json(comparison), lambda: build_blueprint(comparison)) as out:
        stream.log_text(out, NUMBERS_ENTITY, format_page(comparison))
        for number, part in enumerate(comparison.parts, start=1):
            # Phases are integer percentages.
            axis = (
                rr.TimeColumn(TIMELINES["phase"], sequence=np.rint(part.axis).astype(np.int64))
                if comparison.domain == "phase"
                else rr.TimeColumn(TIMELINES["time"], duration=part.axis)
            )
            stream.send_lines(out, axis, build_lines(part, number, comparison.domain))


def build_lines(part: ComparisonPart, number: int, domain: str) -> Iterator[SeriesLine]:
    """Yield all lines of the ``number``-th part.

    Entities are named by the numbers of parts and series: labels may have characters that entity paths cannot have.
    """
    colours = [
        HUMAN_COLOUR if s.is_reference else BASELINE_COLOUR if k == 0 else SERIES_COLOURS[(k - 1) % len(SERIES_COLOURS)]
        for k, s in enumerate(part.series)
    ]
    for channel, others in part.differences.items():
        entity = f"part_{number}/{channel}"
        for k, (series, colour) in enumerate(zip(part.series, colours, strict=True)):
            curve = series.curves.get(channel)
            if curve is None:
                continue
            # A band has the name of its curve, because legends show equal names once.
            name = words.format_series(series, domain)
            yield SeriesLine(f"{entity}/curves/series_{k}/mean", name, colour, 2.5, curve.mean)
            if not curve.lacks_sd:
                for side, sign in (("low", -1.0), ("high", 1.0)):
                    yield SeriesLine(
                        f"{entity}/curves/series_{k}/{side}", name, colour, 0.7, curve.mean + sign * curve.sd
                    )
            if series.label in others:
                d = others[series.label]
                yield SeriesLine(f"{entity}/difference/series_{k}/mean", series.label, colour, 2.0, d.values)
                if d.band != "none":
                    for side, sign in (("low", -1.0), ("high", 1.0)):
                        yield SeriesLine(
                            f"{entity}/difference/series_{k}/{side}", series.label, colour, 0.7, sign * d.half_width
                        )


def format_page(comparison: Comparison) -> str:
    """Return all numbers of the comparison, and how to read them, as Markdown."""
    domain, series = comparison.domain, comparison.parts[0].series
    if comparison.is_single:
        title, headings = words.format_series(series[0], domain), ["trial", "channel", *words.EXTENT_HEADINGS]
        rows = [
            [_format_trial(part), words.format_channel(part, channel), *cells]
            for part in comparison.parts
            for channel, cells in words.iter_extents(part, domain)
        ]
    else:
        title = f"{', '.join(other.label for other in series[1:])} against {series[0].label}"
        headings = ["trial", "channel", "series", "bias", "rms", "rms/sd", "largest", "at", "half of the difference"]
        rows = [
            [
                _format_trial(row.part),
                words.format_channel(row.part, row.channel),
                row.label,
                words.format_bias(row.difference),
                words.format_number(row.difference.rms),
                words.format_number(row.difference.rms_sd),
                words.format_number(row.difference.max_difference, signed=True),
                words.format_position(row.difference.max_position, domain),
                words.format_half_error_interval(row, domain),
            ]
            for row in words.iter_rows(comparison)
        ]
    remarks = [f"- {remark}" for remark in collect_remarks(comparison)]
    return f"# {title}\n\n{stream.format_markdown_table(headings, rows)}\n" + "\n".join(remarks)


def _format_trial(part: ComparisonPart) -> str:
    return part.name or "-"


def build_blueprint(comparison: Comparison) -> Any:
    """Build the layout: a tab of channels and their differences for each part, and a tab with the numbers."""
    import rerun.blueprint as rrb

    tabs: list[Any] = []
    panels = [("curves", "{} [{}]"), *[("difference", "{}, difference [{}]")] * (not comparison.is_single)]
    for number, part in enumerate(comparison.parts[:MAX_TRIAL_TABS], start=1):
        plots = []
        for index, channel in enumerate(part.differences):
            unit = words.format_unit(part.units[channel])
            # All plots share their colours, and labels are long: one legend is enough.
            views = [
                rrb.TimeSeriesView(
                    origin=f"/part_{number}/{channel}/{panel}",
                    name=title.format(words.humanize_channel(channel), unit),
                    plot_legend=rrb.PlotLegend(visible=panel == "curves" and index == 0),
                )
                for panel, title in panels
            ]
            plots.append(rrb.Vertical(*views, row_shares=[3, 2][: len(views)], name=words.humanize_channel(channel)))
        tabs.append(rrb.Grid(*plots, grid_columns=min(3, len(plots)), name=part.name or "curves"))
    return stream.build_window_blueprint(
        rrb.Tabs(*tabs, stream.build_text_view("numbers", NUMBERS_ENTITY)), TIMELINES[comparison.domain]
    )
