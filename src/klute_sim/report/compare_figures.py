"""Pictures of a comparison: every channel's curves with their bands, and the difference underneath.

Matplotlib is imported when something is drawn.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from klute_sim.compare.comparison import Comparison, Part, Series
from klute_sim.compare.curve import Curve
from klute_sim.compare.difference import Difference
from klute_sim.recording.recording import Samples
from klute_sim.report import compare_words as words
from klute_sim.report.style import STYLE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 120
FIRST, HUMAN, HUMAN_BAND = "0.15", "0.45", "0.87"
OTHERS = ("#1f77b4", "#e6842a", "#2ca02c", "#d62728", "#9467bd", "#8c564b", "#17becf", "#e377c2")
MOST_DRAWN = 6
"""Trials with a picture: those with the largest differences."""
MOST_CHANNELS = 16
"""In one picture: likewise."""
LABELS = {"phase": "gait cycle [%]", "time": "time [s]"}


def pictures(found: Comparison) -> Iterator[tuple[Part, "Figure"]]:
    """The parts that are drawn, in their order, each with its picture."""
    import matplotlib

    worst = {part.name: 0.0 for part in found.parts}
    for row in words.rows(found):
        worst[row.part.name] = max(worst[row.part.name], row.severity)
    kept = sorted(worst, key=lambda name: worst[name], reverse=True)[:MOST_DRAWN]
    with matplotlib.rc_context(STYLE):
        for part in found.parts:
            if part.name in kept:
                yield part, draw(part, found.over)


def draw(part: Part, over: str) -> "Figure":
    """The picture of one ``part``; to be called with the style set."""
    from matplotlib.figure import Figure

    channels = _worst_channels(part)
    columns = 1 if len(channels) == 1 else 2
    rows = -(-len(channels) // columns)
    heights = [2.0] if len(part.series) == 1 else [2.0, 1.0]
    each = len(heights)
    figure = Figure(figsize=(5.6 * columns + 0.4, 0.9 + (1.1 + sum(heights)) * 0.76 * rows), layout="constrained")
    axes = figure.subplots(each * rows, columns, sharex=True, squeeze=False, height_ratios=heights * rows)
    for number, channel in enumerate(channels):
        row, column = divmod(number, columns)
        above, below = axes[each * row, column], axes[each * row + each - 1, column]
        _curves(above, part, channel)
        if each > 1:
            _differences(below, part, channel)
        below.set_xlabel(LABELS[over] if row == rows - 1 or number + columns >= len(channels) else "")
        below.tick_params(labelbottom=True)
        remark = words.SIGNS.get(channel, "") if over == "phase" else ""
        title = f"{words.spoken(channel)} [{words.unit(part.units[channel])}]"
        above.set_title(f"{title} ({remark})" if remark else title)
    for spare in range(len(channels), rows * columns):
        for k in range(each):
            axes[each * (spare // columns) + k, spare % columns].set_visible(False)
    axes[0, 0].set_xlim(part.axis[0], part.axis[-1])
    handles, labels = _key(part, over)
    figure.legend(handles, labels, loc="outside upper center", ncols=min(4, len(labels)), title=part.name or None)
    figure.align_ylabels()
    return figure


def _worst_channels(part: Part) -> list[str]:
    """All channels, or those with the largest differences where they are too many; in their order."""
    worst = {
        channel: max((words.Row(part, channel, label, d).severity for label, d in others.items()), default=0.0)
        for channel, others in part.differences.items()
    }
    kept = sorted(worst, key=lambda name: worst[name], reverse=True)[:MOST_CHANNELS]
    return [channel for channel in part.differences if channel in kept]


def _looks(part: Part) -> dict[str, dict[str, Any]]:
    """Label -> how its line is drawn."""
    found: dict[str, dict[str, Any]] = {}
    colours = iter(OTHERS * (1 + len(part.series) // len(OTHERS)))
    for number, series in enumerate(part.series):
        if series.reference:
            found[series.label] = {"color": HUMAN, "linestyle": "--", "linewidth": 1.1}
        else:
            found[series.label] = {"color": FIRST if number == 0 else next(colours), "linewidth": 1.4}
    return found


def _curves(axis: "Axes", part: Part, channel: str) -> None:
    looks = _looks(part)
    # The reference's band lies under everything, and its line under the others'.
    for series in sorted(part.series, key=lambda one: not one.reference):
        if channel in series.curves:
            curve, look = series.curves[channel], looks[series.label]
            _band(axis, part.axis, curve, **_band_look(series, look))
            axis.plot(part.axis, curve.mean, **look)
    axis.grid(alpha=0.25, linewidth=0.5)


def _band_look(series: Series, look: dict[str, Any]) -> dict[str, Any]:
    return {"color": HUMAN_BAND} if series.reference else {"color": look["color"], "alpha": 0.22}


def _band(axis: "Axes", x: Samples, curve: Curve, **look: Any) -> None:
    if not curve.unspread:
        axis.fill_between(x, curve.mean - curve.sd, curve.mean + curve.sd, linewidth=0.0, **look)


def _differences(axis: "Axes", part: Part, channel: str) -> None:
    looks = _looks(part)
    axis.axhline(0.0, color="0.4", linewidth=0.8)
    for number, (label, d) in enumerate(part.differences[channel].items()):
        colour = looks[label]["color"]
        if np.isfinite(d.width).any():
            band = {"color": "0.9", "zorder": 0.5} if len(part.series) == 2 else {"color": colour, "alpha": 0.12}
            axis.fill_between(part.axis, -d.width, d.width, linewidth=0.0, **band)
            axis.fill_between(
                part.axis, 0.0, d.values, where=_inside(d, part.axis), color=colour, alpha=0.3, linewidth=0
            )
        axis.plot(part.axis, d.values, **{**looks[label], "linewidth": 1.0})
        if d.half is not None and words.Row(part, channel, label, d).located:
            # In the panel's own height, so that several do not cover each other.
            axis.plot(d.half, [1.0 + 0.045 * number] * 2, transform=axis.get_xaxis_transform(), color=colour,
                      linewidth=3.0, solid_capstyle="butt", clip_on=False)  # fmt: skip
    if any(d.rms for d in part.differences[channel].values()):
        # As high as the differences: a band that is much wider needs no more than to be seen to be.
        first = part.series[0].curves[channel].mean
        least = 1e-6 * float(np.nanmax(np.abs(first)))  # so that rounding is a straight line
        largest = max(least, *(abs(d.largest or 0.0) for d in part.differences[channel].values()))
        axis.set_ylim(-1.2 * largest, 1.2 * largest)
    axis.set_ylabel("difference")
    axis.grid(alpha=0.25, linewidth=0.5)


def _inside(d: Difference, axis: Samples) -> np.ndarray:
    """Which points are in a stretch beyond the band."""
    inside = np.zeros(axis.shape, dtype=np.bool_)
    for region in d.regions:
        inside |= (axis >= region.begin) & (axis <= region.end)
    return inside


def _key(part: Part, over: str) -> tuple[list[Any], list[str]]:
    """Handles and words of the legend."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    looks = _looks(part)
    entries: list[tuple[Any, str]] = [
        (Line2D([], [], **looks[series.label]), words.named(series, over)) for series in part.series
    ]
    curves = [curve for series in part.series for curve in series.curves.values()]
    differences = [d for others in part.differences.values() for d in others.values()]
    if any(not curve.unspread for curve in curves):
        entries.append((Patch(color="0.75"), "mean ±1 sd"))
    if any(d.band != "none" for d in differences):
        entries.append((Patch(color="0.9"), "95 % interval of no difference"))
    single = looks[part.series[1].label]["color"] if len(part.series) == 2 else "0.5"
    if any(d.regions for d in differences):
        entries.append((Patch(color=single, alpha=0.3), "beyond it"))
    if any(words.Row(part, c, n, d).located for c, own in part.differences.items() for n, d in own.items()):
        entries.append((Line2D([], [], color=single, linewidth=3.0), "half of the squared difference"))
    # Matplotlib leaves out what begins with an underscore.
    return [handle for handle, _ in entries], [f" {word}" if word.startswith("_") else word for _, word in entries]
