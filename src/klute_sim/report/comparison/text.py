"""Words and numbers of a comparison as a person says them."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from klute_sim.comparison.comparison import Comparison, ComparisonPart, ComparisonSeries
from klute_sim.comparison.curve import summarize_curve
from klute_sim.comparison.difference import ROUNDING_TOLERANCE, BandKind, Difference
from klute_sim.comparison.results import AXIS_UNITS

CHANNEL_NOTES = {
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
INTERVAL_DESCRIPTIONS: dict[BandKind, str] = {
    "means": "its 95 % interval from the scatter of both (Welch's t)",
    "prediction": "the 95 % prediction interval of a single one, from the scatter of the other's repeats (Student's t)",
    "reference": "the 95 % interval of the reference's people, with the error of the mean beside it",
    "none": "",
}
"""What the difference is held against, for each kind of band."""
MAX_LOCALIZED_FRACTION = 0.4
"""Of the axis: where no shorter stretch holds half of the squared difference, it is nowhere in particular."""
MAX_REGIONS = 3
"""Stretches beyond the band that a table lists: those with the largest shares."""


class DifferenceRow(NamedTuple):
    """A channel of another series against the first's."""

    part: ComparisonPart
    channel: str
    label: str
    difference: Difference

    @property
    def relative_rms(self) -> float:
        """Its rms over the range of the first's curve [1]; to put the most different ones first."""
        mean, rms = self.part.series[0].curves[self.channel].mean, self.difference.rms
        known = mean[np.isfinite(mean)]
        if rms is None or not rms > 0.0:
            return 0.0
        span = float(np.ptp(known))
        return rms / span if span > 0.0 else float("inf")

    @property
    def is_localized(self) -> bool:
        """Whether half of the squared difference is in a stretch of less than :data:`SPREAD` of the axis."""
        half, axis = self.difference.half_interval, self.part.axis
        return half is not None and half[1] - half[0] < MAX_LOCALIZED_FRACTION * (axis[-1] - axis[0])


def iter_rows(comparison: Comparison) -> Iterator[DifferenceRow]:
    """Every difference, in the order of parts, channels and series."""
    for part in comparison.parts:
        for channel, others in part.differences.items():
            for label, difference in others.items():
                yield DifferenceRow(part, channel, label, difference)


EXTENT_HEADINGS = ("lowest", "at", "highest", "at", "sd", "largest sd", "at")
"""Headings of what is told of one series alone."""


def iter_extents(part: ComparisonPart, domain: str) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Every channel of the first series, with a cell for every heading of :data:`EXTENT`."""
    for channel, own in part.series[0].curves.items():
        found = summarize_curve(own, part.axis)
        ends = ((found.lowest, found.lowest_at), (found.highest, found.highest_at))
        cells = [cell for value, at in ends for cell in (format_number(value, ".4g"), format_position(at, domain))]
        yield (
            channel,
            (*cells, format_number(found.sd), format_number(found.sd_largest), format_position(found.sd_at, domain)),
        )


def humanize_channel(channel: str) -> str:
    """``ankle_moment`` -> ``ankle moment``, and ``grf`` in words."""
    return channel.replace("_", " ").replace("grf", "ground reaction").replace("cop x", "centre of pressure x")


def format_unit(unit: str) -> str:
    """``N*m`` -> ``N·m``."""
    return unit.replace("*", "·")


def format_number(value: float | None, format_spec: str = ".3g") -> str:
    """``value``, or a dash where nothing is known; no minus before a zero."""
    return "-" if value is None else format(value + 0.0, format_spec)


def format_bias(difference: Difference) -> str:
    """The mean difference, without what rounding leaves of differences that cancel out."""
    if difference.bias is None or difference.rms is None:
        return "-"
    return format_number(difference.bias if abs(difference.bias) > ROUNDING_TOLERANCE * difference.rms else 0.0, "+.3g")


def format_series(series: ComparisonSeries, domain: str) -> str:
    """Its label and how many repeats it is the mean of."""
    if series.is_reference:
        return f"{series.label} (reference)"
    what = "stride" if domain == "phase" else "recording"
    return f"{series.label} ({series.n_repeats} {what}{'s' * (series.n_repeats != 1)})"


def format_position(value: float | None, domain: str) -> str:
    """A place on the axis, with its unit."""
    return "-" if value is None else f"{value:.4g} {AXIS_UNITS[domain]}"


def format_interval(start: float, end: float) -> str:
    """Two ends without a unit."""
    return f"{start:.4g}" if start == end else f"{start:.4g}-{end:.4g}"


def format_half_error_interval(row: DifferenceRow, domain: str) -> str:
    """Where half of the squared difference is, if it is anywhere more than elsewhere."""
    if row.difference.half_interval is None:
        return "-"
    return (
        f"{format_interval(*row.difference.half_interval)} {AXIS_UNITS[domain]}" if row.is_localized else "spread out"
    )


def format_significant_regions(difference: Difference, domain: str) -> str:
    """The stretches beyond the band, those with the largest shares; or that there is no band."""
    if difference.band == "none":
        return "no band"
    if not difference.regions:
        return "nowhere"
    kept = sorted(difference.regions, key=lambda region: region.fraction, reverse=True)[:MAX_REGIONS]
    told = ", ".join(format_interval(r.begin, r.end) for r in difference.regions if r in kept)
    more = len(difference.regions) - len(kept)
    return f"{told} {AXIS_UNITS[domain]}{f' and {more} more' if more else ''}"


def explain_numbers(comparison: Comparison) -> list[str]:
    """How to read the numbers, one sentence each."""
    first = comparison.parts[0].series[0].label
    if comparison.is_single:
        what = "strides" if comparison.domain == "phase" else "recordings"
        said = [f"Lowest and highest are those of the mean over the {what} of '{first}'; sd is between them, its rms."]
        simulated = (
            "Strides of a simulated walk repeat almost exactly: their band says nothing about people or devices."
        )
        return [*said, *[simulated] * _is_simulated(comparison, first)]
    differences = [row.difference for row in iter_rows(comparison)]
    said = [f"Differences are those of the means, the other's minus that of '{first}'."]
    if any(difference.rms_sd is not None for difference in differences):
        yardstick = comparison.parts[0].normalization_series
        kind = "between people" if yardstick.is_reference else "between its repeats"
        said.append(f"rms/sd: in the root mean square of the standard deviation of '{yardstick.label}' {kind}.")
    bands: list[BandKind] = ["means", "prediction", "reference"]
    for band in bands:
        if any(difference.band == band for difference in differences):
            said.append(
                f"Beyond the band{_format_labels_with_band(comparison, band)}: where the difference is more than {INTERVAL_DESCRIPTIONS[band]}; point by "
                "point, not corrected for the number of points."
            )
    if any(difference.band == "none" for difference in differences):
        said.append(
            "No band: where nothing is repeated and no spread is known, the difference is located by its size alone."
        )
    said.append("Half: the shortest stretch that holds half of the squared difference, if it is a short one.")
    if any(difference.compared_fraction < 1.0 for difference in differences):
        said.append("Compared: the share of the axis where both have a value; all numbers are of that share.")
    exact = {row.label for row in iter_rows(comparison) if _has_simulated_scatter_only(comparison, row)}
    if exact:
        said.append(
            "Strides of a simulated walk repeat almost exactly: a band of them alone"
            f"{_format_labels(comparison, exact)} says nothing about people or devices, and nearly every difference is beyond it."
        )
    return said


def _format_labels_with_band(comparison: Comparison, band: BandKind) -> str:
    return _format_labels(comparison, {row.label for row in iter_rows(comparison) if row.difference.band == band})


def _format_labels(comparison: Comparison, labels: set[str]) -> str:
    everyone = {row.label for row in iter_rows(comparison)}
    return "" if labels == everyone else f" ({', '.join(sorted(labels))})"


def _has_simulated_scatter_only(comparison: Comparison, row: DifferenceRow) -> bool:
    """Whether the band is made of the scatter of simulated strides alone."""
    if row.difference.band not in ("means", "prediction"):
        return False
    pair = (series for series in row.part.series if series is row.part.series[0] or series.label == row.label)
    return all(_is_simulated(comparison, series.label) for series in pair if series.n_repeats > 1)


def _is_simulated(comparison: Comparison, label: str) -> bool:
    """Whether all that is called ``label`` are strides of simulated walks."""
    own = [recording for run in comparison.runs if run.label == label for recording in run.parts.values()]
    return comparison.domain == "phase" and all(recording.provenance.get("rig") for recording in own)
