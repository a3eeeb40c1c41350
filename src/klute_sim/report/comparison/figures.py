"""Pictures of a comparison: every channel's curves with their bands, and the difference underneath.

Matplotlib is imported when something is drawn.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from klute_sim.comparison.comparison import Comparison, ComparisonPart, ComparisonSeries
from klute_sim.comparison.curve import MeanCurve
from klute_sim.comparison.difference import Difference
from klute_sim.recording.recording import Array
from klute_sim.report.comparison import text as words
from klute_sim.report.style import STYLE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 120
BASELINE_COLOUR, HUMAN_COLOUR, HUMAN_BAND_COLOUR = "0.15", "0.45", "0.87"
SERIES_COLOURS = ("#1f77b4", "#e6842a", "#2ca02c", "#d62728", "#9467bd", "#8c564b", "#17becf", "#e377c2")
MAX_FIGURES = 6
"""Trials with a picture: those with the largest differences."""
MAX_CHANNELS_PER_FIGURE = 16
"""In one picture: likewise."""
X_LABELS = {"phase": "gait cycle [%]", "time": "time [s]"}


def build_figures(comparison: Comparison) -> Iterator[tuple[ComparisonPart, "Figure"]]:
    """The parts that are drawn, in their order, each with its picture."""
    import matplotlib

    worst = {part.name: 0.0 for part in comparison.parts}
    for row in words.iter_rows(comparison):
        worst[row.part.name] = max(worst[row.part.name], row.relative_rms)
    kept = sorted(worst, key=lambda name: worst[name], reverse=True)[:MAX_FIGURES]
    with matplotlib.rc_context(STYLE):
        for part in comparison.parts:
            if part.name in kept:
                yield part, build_part_figure(part, comparison.domain)


def build_part_figure(part: ComparisonPart, domain: str) -> "Figure":
    """The picture of one ``part``; to be called with the style set."""
    from matplotlib.figure import Figure

    channels = _select_channels(part)
    columns = 1 if len(channels) == 1 else 2
    rows = -(-len(channels) // columns)
    heights = [2.0] if len(part.series) == 1 else [2.0, 1.0]
    each = len(heights)
    figure = Figure(figsize=(5.6 * columns + 0.4, 0.9 + (1.1 + sum(heights)) * 0.76 * rows), layout="constrained")
    axes = figure.subplots(each * rows, columns, sharex=True, squeeze=False, height_ratios=heights * rows)
    for number, channel in enumerate(channels):
        row, column = divmod(number, columns)
        above, below = axes[each * row, column], axes[each * row + each - 1, column]
        _plot_curves(above, part, channel)
        if each > 1:
            _plot_differences(below, part, channel)
        below.set_xlabel(X_LABELS[domain] if row == rows - 1 or number + columns >= len(channels) else "")
        below.tick_params(labelbottom=True)
        remark = words.CHANNEL_NOTES.get(channel, "") if domain == "phase" else ""
        title = f"{words.humanize_channel(channel)} [{words.format_unit(part.units[channel])}]"
        above.set_title(f"{title} ({remark})" if remark else title)
    for spare in range(len(channels), rows * columns):
        for k in range(each):
            axes[each * (spare // columns) + k, spare % columns].set_visible(False)
    axes[0, 0].set_xlim(part.axis[0], part.axis[-1])
    handles, labels = _build_legend(part, domain)
    figure.legend(handles, labels, loc="outside upper center", ncols=min(4, len(labels)), title=part.name or None)
    figure.align_ylabels()
    return figure


def _select_channels(part: ComparisonPart) -> list[str]:
    """All channels, or those with the largest differences where they are too many; in their order."""
    worst = {
        channel: max(
            (words.DifferenceRow(part, channel, label, d).relative_rms for label, d in others.items()), default=0.0
        )
        for channel, others in part.differences.items()
    }
    kept = sorted(worst, key=lambda name: worst[name], reverse=True)[:MAX_CHANNELS_PER_FIGURE]
    return [channel for channel in part.differences if channel in kept]


def _build_line_styles(part: ComparisonPart) -> dict[str, dict[str, Any]]:
    """Label -> how its line is drawn."""
    found: dict[str, dict[str, Any]] = {}
    colours = iter(SERIES_COLOURS * (1 + len(part.series) // len(SERIES_COLOURS)))
    for number, series in enumerate(part.series):
        if series.is_reference:
            found[series.label] = {"color": HUMAN_COLOUR, "linestyle": "--", "linewidth": 1.1}
        else:
            found[series.label] = {"color": BASELINE_COLOUR if number == 0 else next(colours), "linewidth": 1.4}
    return found


def _plot_curves(axis: "Axes", part: ComparisonPart, channel: str) -> None:
    looks = _build_line_styles(part)
    # The reference's band lies under everything, and its line under the others'.
    for series in sorted(part.series, key=lambda one: not one.is_reference):
        if channel in series.curves:
            curve, look = series.curves[channel], looks[series.label]
            _fill_band(axis, part.axis, curve, **_get_band_style(series, look))
            axis.plot(part.axis, curve.mean, **look)
    axis.grid(alpha=0.25, linewidth=0.5)


def _get_band_style(series: ComparisonSeries, line_style: dict[str, Any]) -> dict[str, Any]:
    return {"color": HUMAN_BAND_COLOUR} if series.is_reference else {"color": line_style["color"], "alpha": 0.22}


def _fill_band(axis: "Axes", x: Array, curve: MeanCurve, **style: Any) -> None:
    if not curve.lacks_sd:
        axis.fill_between(x, curve.mean - curve.sd, curve.mean + curve.sd, linewidth=0.0, **style)


def _plot_differences(axis: "Axes", part: ComparisonPart, channel: str) -> None:
    looks = _build_line_styles(part)
    axis.axhline(0.0, color="0.4", linewidth=0.8)
    for number, (label, d) in enumerate(part.differences[channel].items()):
        colour = looks[label]["color"]
        if np.isfinite(d.half_width).any():
            band = {"color": "0.9", "zorder": 0.5} if len(part.series) == 2 else {"color": colour, "alpha": 0.12}
            axis.fill_between(part.axis, -d.half_width, d.half_width, linewidth=0.0, **band)
            axis.fill_between(
                part.axis, 0.0, d.values, where=_mask_regions(d, part.axis), color=colour, alpha=0.3, linewidth=0
            )
        axis.plot(part.axis, d.values, **{**looks[label], "linewidth": 1.0})
        if d.half_interval is not None and words.DifferenceRow(part, channel, label, d).is_localized:
            # In the panel's own height, so that several do not cover each other.
            axis.plot(d.half_interval, [1.0 + 0.045 * number] * 2, transform=axis.get_xaxis_transform(), color=colour,
                      linewidth=3.0, solid_capstyle="butt", clip_on=False)  # fmt: skip
    if any(d.rms for d in part.differences[channel].values()):
        # As high as the differences: a band that is much wider needs no more than to be seen to be.
        first = part.series[0].curves[channel].mean
        least = 1e-6 * float(np.nanmax(np.abs(first)))  # so that rounding is a straight line
        largest = max(least, *(abs(d.max_difference or 0.0) for d in part.differences[channel].values()))
        axis.set_ylim(-1.2 * largest, 1.2 * largest)
    axis.set_ylabel("difference")
    axis.grid(alpha=0.25, linewidth=0.5)


def _mask_regions(difference: Difference, x: Array) -> np.ndarray:
    """Which points are in a stretch beyond the band."""
    inside = np.zeros(x.shape, dtype=np.bool_)
    for region in difference.regions:
        inside |= (x >= region.begin) & (x <= region.end)
    return inside


def _build_legend(part: ComparisonPart, domain: str) -> tuple[list[Any], list[str]]:
    """Handles and words of the legend."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    looks = _build_line_styles(part)
    entries: list[tuple[Any, str]] = [
        (Line2D([], [], **looks[series.label]), words.format_series(series, domain)) for series in part.series
    ]
    curves = [curve for series in part.series for curve in series.curves.values()]
    differences = [d for others in part.differences.values() for d in others.values()]
    if any(not curve.lacks_sd for curve in curves):
        entries.append((Patch(color="0.75"), "mean ±1 sd"))
    if any(d.band != "none" for d in differences):
        entries.append((Patch(color="0.9"), "95 % interval of no difference"))
    single = looks[part.series[1].label]["color"] if len(part.series) == 2 else "0.5"
    if any(d.regions for d in differences):
        entries.append((Patch(color=single, alpha=0.3), "beyond it"))
    if any(
        words.DifferenceRow(part, c, n, d).is_localized for c, own in part.differences.items() for n, d in own.items()
    ):
        entries.append((Line2D([], [], color=single, linewidth=3.0), "half of the squared difference"))
    # Matplotlib leaves out what begins with an underscore.
    return [handle for handle, _ in entries], [f" {word}" if word.startswith("_") else word for _, word in entries]
