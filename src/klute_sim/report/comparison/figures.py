"""Figures of a comparison: curves of each channel with their bands, and the differences below.

Matplotlib is imported when a figure is built.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from klute_sim.comparison.comparison import Comparison, ComparisonPart, ComparisonSeries
from klute_sim.comparison.curve import MeanCurve
from klute_sim.comparison.difference import Difference
from klute_sim.report.comparison import text as words
from klute_sim.report.style import (
    HUMAN_BAND_COLOUR,
    MEASURED_COLOUR,
    SERIES_COLOURS,
    use_style,
)
from klute_sim.types import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BASELINE_COLOUR, REFERENCE_COLOUR = MEASURED_COLOUR, "0.45"
COLUMN_WIDTH_INCHES = 6.5
"""Width of a figure with one column [inches]."""
MAX_FIGURES = 6
"""Maximum number of trials with a figure: those with the largest differences."""
MAX_CHANNELS_PER_FIGURE = 16
"""Maximum number of channels in a figure: those with the largest differences."""
X_LABELS = {"phase": "gait cycle [%]", "time": "time [s]"}


def build_figures(comparison: Comparison) -> Iterator[tuple[ComparisonPart, "Figure"]]:
    """Yield the parts with the largest differences, in their order, each with its figure."""
    max_rms = {part.name: 0.0 for part in comparison.parts}
    for row in words.iter_rows(comparison):
        max_rms[row.part.name] = max(max_rms[row.part.name], row.relative_rms)
    selected = sorted(max_rms, key=lambda name: max_rms[name], reverse=True)[:MAX_FIGURES]
    for part in comparison.parts:
        if part.name in selected:
            yield part, build_part_figure(part, comparison.domain)


def build_part_figure(part: ComparisonPart, domain: str) -> "Figure":
    """Plot the curves of ``part`` and, in rows of their own, the differences from the baseline."""
    channels = _select_channels(part)
    columns = 1 if len(channels) == 1 else 2
    rows = -(-len(channels) // columns)
    heights = [2.0] if len(part.series) == 1 else [2.0, 1.0]
    n_panels = len(heights)
    size = {"width": COLUMN_WIDTH_INCHES} if columns == 1 else {}
    with use_style() as create_figure:
        figure = create_figure(0.9 + (1.1 + sum(heights)) * 0.8 * rows, **size)
        axes = figure.subplots(n_panels * rows, columns, sharex=True, squeeze=False, height_ratios=heights * rows)
        for number, channel in enumerate(channels):
            row, column = divmod(number, columns)
            top, bottom = axes[n_panels * row, column], axes[n_panels * row + n_panels - 1, column]
            _plot_curves(top, part, channel)
            if n_panels > 1:
                _plot_differences(bottom, part, channel)
            bottom.set_xlabel(X_LABELS[domain] if row == rows - 1 or number + columns >= len(channels) else "")
            bottom.tick_params(labelbottom=True)
            note = words.CHANNEL_NOTES.get(channel, "") if domain == "phase" else ""
            title = words.format_channel(part, channel)
            top.set_title(f"{title}\n{note}" if note else title)
        for unused in range(len(channels), rows * columns):
            for k in range(n_panels):
                axes[n_panels * (unused // columns) + k, unused % columns].set_visible(False)
        axes[0, 0].set_xlim(part.axis[0], part.axis[-1])
        handles, labels = _build_legend(part, domain)
        ncols = min(3, len(labels))
        figure.legend(handles, labels, loc="outside upper center", ncols=ncols, title=part.name or None)
        figure.align_ylabels()
    return figure


def _select_channels(part: ComparisonPart) -> list[str]:
    """Return at most :data:`MAX_CHANNELS_PER_FIGURE` channels with the largest differences, in their order."""
    max_rms = {
        channel: max(
            (words.DifferenceRow(part, channel, label, d).relative_rms for label, d in others.items()), default=0.0
        )
        for channel, others in part.differences.items()
    }
    selected = sorted(max_rms, key=lambda name: max_rms[name], reverse=True)[:MAX_CHANNELS_PER_FIGURE]
    return [channel for channel in part.differences if channel in selected]


def _build_line_styles(part: ComparisonPart) -> dict[str, dict[str, Any]]:
    """Return label -> arguments of ``plot`` for its line."""
    styles: dict[str, dict[str, Any]] = {}
    colours = iter(SERIES_COLOURS * (1 + len(part.series) // len(SERIES_COLOURS)))
    for number, series in enumerate(part.series):
        if series.is_reference:
            styles[series.label] = {"color": REFERENCE_COLOUR, "linestyle": "--", "linewidth": 1.1}
        else:
            is_baseline = number == 0
            # The baseline, often a measurement, is a thin line above the thick ones and stays visible where they agree.
            styles[series.label] = {
                "color": BASELINE_COLOUR if is_baseline else next(colours),
                "linewidth": 0.9 if is_baseline else 1.7,
                "zorder": 3.0 if is_baseline else 2.0,
            }
    return styles


def _plot_curves(axis: "Axes", part: ComparisonPart, channel: str) -> None:
    styles = _build_line_styles(part)
    # Drawing the reference first puts its band and line below all others.
    for series in sorted(part.series, key=lambda series: not series.is_reference):
        if channel in series.curves:
            curve, style = series.curves[channel], styles[series.label]
            _fill_band(axis, part.axis, curve, **_get_band_style(series, style))
            axis.plot(part.axis, curve.mean, **style)


def _get_band_style(series: ComparisonSeries, line_style: dict[str, Any]) -> dict[str, Any]:
    return {"color": HUMAN_BAND_COLOUR} if series.is_reference else {"color": line_style["color"], "alpha": 0.22}


def _fill_band(axis: "Axes", x: Array, curve: MeanCurve, **style: Any) -> None:
    if not curve.lacks_sd:
        axis.fill_between(x, curve.mean - curve.sd, curve.mean + curve.sd, linewidth=0.0, **style)


def _plot_differences(axis: "Axes", part: ComparisonPart, channel: str) -> None:
    styles = _build_line_styles(part)
    axis.axhline(0.0, color="0.4", linewidth=0.8)
    for number, (label, d) in enumerate(part.differences[channel].items()):
        colour = styles[label]["color"]
        is_tested = not words.has_simulated_band(words.DifferenceRow(part, channel, label, d))
        if is_tested and np.isfinite(d.half_width).any():
            band = {"color": "0.9", "zorder": 0.5} if len(part.series) == 2 else {"color": colour, "alpha": 0.12}
            axis.fill_between(part.axis, -d.half_width, d.half_width, linewidth=0.0, **band)
            axis.fill_between(
                part.axis, 0.0, d.values, where=_mask_regions(d, part.axis), color=colour, alpha=0.3, linewidth=0
            )
        axis.plot(part.axis, d.values, **{**styles[label], "linewidth": 1.0})
        if d.half_interval is not None and words.DifferenceRow(part, channel, label, d).is_localized:
            # Axes coordinates stack the bars of several series above the panel.
            axis.plot(d.half_interval, [1.0 + 0.045 * number] * 2, transform=axis.get_xaxis_transform(), color=colour,
                      linewidth=3.0, solid_capstyle="butt", clip_on=False)  # fmt: skip
    if any(d.rms for d in part.differences[channel].values()):
        # The limits follow the differences: a much wider band may be cut.
        first = part.series[0].curves[channel].mean
        min_limit = 1e-6 * float(np.nanmax(np.abs(first)))  # rounding errors appear as a straight line
        largest = max(min_limit, *(abs(d.max_difference or 0.0) for d in part.differences[channel].values()))
        axis.set_ylim(-1.2 * largest, 1.2 * largest)
    axis.set_ylabel("difference")


def _mask_regions(difference: Difference, x: Array) -> np.ndarray:
    """Return which points ``x`` are in a region beyond the band."""
    mask = np.zeros(x.shape, dtype=np.bool_)
    for region in difference.regions:
        mask |= (x >= region.begin) & (x <= region.end)
    return mask


def _build_legend(part: ComparisonPart, domain: str) -> tuple[list[Any], list[str]]:
    """Return handles and labels of the legend."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    styles = _build_line_styles(part)
    entries: list[tuple[Any, str]] = [
        (Line2D([], [], **styles[series.label]), words.format_series(series, domain)) for series in part.series
    ]
    curves = [curve for series in part.series for curve in series.curves.values()]
    rows = [
        words.DifferenceRow(part, channel, label, d)
        for channel, others in part.differences.items()
        for label, d in others.items()
    ]
    tested = [row.difference for row in rows if not words.has_simulated_band(row)]
    if any(not curve.lacks_sd for curve in curves):
        entries.append((Patch(color="0.75"), "mean ±1 sd"))
    if any(d.band != "none" for d in tested):
        entries.append((Patch(color="0.9"), "95 % interval of no difference"))
    single = styles[part.series[1].label]["color"] if len(part.series) == 2 else "0.5"
    if any(d.regions for d in tested):
        entries.append((Patch(color=single, alpha=0.3), "beyond it"))
    if any(row.is_localized for row in rows):
        entries.append((Line2D([], [], color=single, linewidth=3.0), "half of the squared difference"))
    # Matplotlib omits labels that begin with an underscore.
    return [handle for handle, _ in entries], [f" {label}" if label.startswith("_") else label for _, label in entries]
