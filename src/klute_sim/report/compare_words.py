"""Words and numbers of a comparison as a person says them."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from klute_sim.compare.comparison import Comparison, Part, Series
from klute_sim.compare.curve import extent
from klute_sim.compare.difference import ROUNDING, Band, Difference
from klute_sim.compare.results import AXIS_UNITS

SIGNS = {
    "ankle_angle": "dorsiflexion up",
    "ankle_moment": "net, plantarflexor up",
    "ankle_power": "net, generation up",
    "grf_vertical": "of a simulated walk tracked, not predicted",
    "grf_forward": "forward up; of a simulated walk partly prescribed",
    "cop_x": "from the ankle at heel strike, forward up",
    "carriage_x": "from heel strike on",
    "ankle_x": "from heel strike on",
    "air_drawn": "from heel strike on",
    "air_leaked": "from heel strike on",
}
"""What is up, and what else a reader has to know of a channel over phase."""
INTERVALS: dict[Band, str] = {
    "means": "its 95 % interval from the scatter of both (Welch's t)",
    "prediction": "the 95 % prediction interval of a single one, from the scatter of the other's repeats (Student's t)",
    "reference": "the 95 % interval of the reference's people, with the error of the mean beside it",
    "none": "",
}
"""What the difference is held against, for each kind of band."""
SPREAD = 0.4
"""Of the axis: where no shorter stretch holds half of the squared difference, it is nowhere in particular."""
MOST_STRETCHES = 3
"""Stretches beyond the band that a table lists: those with the largest shares."""


class Row(NamedTuple):
    """A channel of another series against the first's."""

    part: Part
    channel: str
    other: str
    difference: Difference

    @property
    def severity(self) -> float:
        """Its rms over the range of the first's curve [1]; to put the most different ones first."""
        mean, rms = self.part.series[0].curves[self.channel].mean, self.difference.rms
        known = mean[np.isfinite(mean)]
        if rms is None or not rms > 0.0:
            return 0.0
        span = float(np.ptp(known))
        return rms / span if span > 0.0 else float("inf")

    @property
    def located(self) -> bool:
        """Whether half of the squared difference is in a stretch of less than :data:`SPREAD` of the axis."""
        half, axis = self.difference.half, self.part.axis
        return half is not None and half[1] - half[0] < SPREAD * (axis[-1] - axis[0])


def rows(found: Comparison) -> Iterator[Row]:
    """Every difference, in the order of parts, channels and series."""
    for part in found.parts:
        for channel, others in part.differences.items():
            for label, difference in others.items():
                yield Row(part, channel, label, difference)


EXTENT = ("lowest", "at", "highest", "at", "sd", "largest sd", "at")
"""Headings of what is told of one series alone."""


def extents(part: Part, over: str) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Every channel of the first series, with a cell for every heading of :data:`EXTENT`."""
    for channel, own in part.series[0].curves.items():
        found = extent(own, part.axis)
        ends = ((found.lowest, found.lowest_at), (found.highest, found.highest_at))
        cells = [cell for value, at in ends for cell in (number(value, ".4g"), place(at, over))]
        yield channel, (*cells, number(found.sd), number(found.sd_largest), place(found.sd_at, over))


def spoken(channel: str) -> str:
    """``ankle_moment`` -> ``ankle moment``, and ``grf`` in words."""
    return channel.replace("_", " ").replace("grf", "ground reaction").replace("cop x", "centre of pressure x")


def unit(written: str) -> str:
    """``N*m`` -> ``N·m``."""
    return written.replace("*", "·")


def number(value: float | None, form: str = ".3g") -> str:
    """``value``, or a dash where nothing is known; no minus before a zero."""
    return "-" if value is None else format(value + 0.0, form)


def bias(difference: Difference) -> str:
    """The mean difference, without what rounding leaves of differences that cancel out."""
    if difference.bias is None or difference.rms is None:
        return "-"
    return number(difference.bias if abs(difference.bias) > ROUNDING * difference.rms else 0.0, "+.3g")


def named(series: Series, over: str) -> str:
    """Its label and how many repeats it is the mean of."""
    if series.reference:
        return f"{series.label} (reference)"
    what = "stride" if over == "phase" else "recording"
    return f"{series.label} ({series.repeats} {what}{'s' * (series.repeats != 1)})"


def place(value: float | None, over: str) -> str:
    """A place on the axis, with its unit."""
    return "-" if value is None else f"{value:.4g} {AXIS_UNITS[over]}"


def stretch(begin: float, end: float) -> str:
    """Two ends without a unit."""
    return f"{begin:.4g}" if begin == end else f"{begin:.4g}-{end:.4g}"


def half(row: Row, over: str) -> str:
    """Where half of the squared difference is, if it is anywhere more than elsewhere."""
    if row.difference.half is None:
        return "-"
    return f"{stretch(*row.difference.half)} {AXIS_UNITS[over]}" if row.located else "spread out"


def beyond(difference: Difference, over: str) -> str:
    """The stretches beyond the band, those with the largest shares; or that there is no band."""
    if difference.band == "none":
        return "no band"
    if not difference.regions:
        return "nowhere"
    kept = sorted(difference.regions, key=lambda region: region.share, reverse=True)[:MOST_STRETCHES]
    told = ", ".join(stretch(r.begin, r.end) for r in difference.regions if r in kept)
    more = len(difference.regions) - len(kept)
    return f"{told} {AXIS_UNITS[over]}{f' and {more} more' if more else ''}"


def rules(found: Comparison) -> list[str]:
    """How to read the numbers, one sentence each."""
    first = found.parts[0].series[0].label
    if found.alone:
        what = "strides" if found.over == "phase" else "recordings"
        said = [f"Lowest and highest are those of the mean over the {what} of '{first}'; sd is between them, its rms."]
        simulated = (
            "Strides of a simulated walk repeat almost exactly: their band says nothing about people or devices."
        )
        return [*said, *[simulated] * _simulated(found, first)]
    differences = [row.difference for row in rows(found)]
    said = [f"Differences are those of the means, the other's minus that of '{first}'."]
    if any(difference.rms_sd is not None for difference in differences):
        yardstick = found.parts[0].yardstick
        kind = "between people" if yardstick.reference else "between its repeats"
        said.append(f"rms/sd: in the root mean square of the standard deviation of '{yardstick.label}' {kind}.")
    bands: list[Band] = ["means", "prediction", "reference"]
    for band in bands:
        if any(difference.band == band for difference in differences):
            said.append(
                f"Beyond the band{_whose(found, band)}: where the difference is more than {INTERVALS[band]}; point by "
                "point, not corrected for the number of points."
            )
    if any(difference.band == "none" for difference in differences):
        said.append(
            "No band: where nothing is repeated and no spread is known, the difference is located by its size alone."
        )
    said.append("Half: the shortest stretch that holds half of the squared difference, if it is a short one.")
    if any(difference.share < 1.0 for difference in differences):
        said.append("Compared: the share of the axis where both have a value; all numbers are of that share.")
    exact = {row.other for row in rows(found) if _exact(found, row)}
    if exact:
        said.append(
            "Strides of a simulated walk repeat almost exactly: a band of them alone"
            f"{_those(found, exact)} says nothing about people or devices, and nearly every difference is beyond it."
        )
    return said


def _whose(found: Comparison, band: Band) -> str:
    return _those(found, {row.other for row in rows(found) if row.difference.band == band})


def _those(found: Comparison, others: set[str]) -> str:
    everyone = {row.other for row in rows(found)}
    return "" if others == everyone else f" ({', '.join(sorted(others))})"


def _exact(found: Comparison, row: Row) -> bool:
    """Whether the band is made of the scatter of simulated strides alone."""
    if row.difference.band not in ("means", "prediction"):
        return False
    pair = (series for series in row.part.series if series is row.part.series[0] or series.label == row.other)
    return all(_simulated(found, series.label) for series in pair if series.repeats > 1)


def _simulated(found: Comparison, label: str) -> bool:
    """Whether all that is called ``label`` are strides of simulated walks."""
    own = [recording for run in found.runs if run.label == label for recording in run.parts.values()]
    return found.over == "phase" and all(recording.provenance.get("rig") for recording in own)
