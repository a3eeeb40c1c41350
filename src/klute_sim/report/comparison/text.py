"""Numbers, phrases and explanations of a comparison, shared by its table, page and recording."""

from collections.abc import Iterator
from decimal import Decimal
from typing import NamedTuple

import numpy as np

from klute_sim.comparison.comparison import Comparison, ComparisonPart, ComparisonSeries
from klute_sim.comparison.curve import summarize_curve
from klute_sim.comparison.difference import MIN_SD_FRACTION, ROUNDING_TOLERANCE, BandKind, Difference
from klute_sim.comparison.results import AXIS_UNITS
from klute_sim.comparison.source import REFERENCE_LABEL

CHANNEL_NOTES = {
    "ankle_angle": "dorsiflexion up",
    "ankle_moment": "net, plantarflexor up",
    "ankle_power": "net, generation up",
    "grf_vertical": "in simulations tracked, not predicted",
    "grf_forward": "forward up; in simulations tracked, not predicted",
    "cop_x": "relative to the ankle at heel strike, forward up",
    "carriage_x": "relative to heel strike",
    "ankle_x": "relative to heel strike",
    "air_drawn": "since heel strike",
    "air_leaked": "since heel strike",
}
"""Channel over phase -> its sign convention, and how it was obtained."""
INTERVAL_DESCRIPTIONS: dict[BandKind, str] = {
    "means": "its 95 % interval from the scatter of both (Welch's t)",
    "prediction": "the 95 % prediction interval of one repeat, from the scatter of the other's repeats (Student's t)",
    "reference": "the 95 % interval of the reference's subjects, including the error of the mean",
    "none": "",
}
"""Kind of band -> the interval that a difference is compared with."""
SUBJECT_INTERVAL = "the 95 % interval of the strides of this subject, including the error of the mean"
"""The interval of the kind "reference" where the reference is made of strides of one subject."""
PLAIN_RANGE = (Decimal("1e-5"), Decimal("1e7"))
"""Range of the magnitudes that are shown without an exponent."""
MAX_LOCALIZED_FRACTION = 0.4
"""Largest fraction of the axis on which half of the squared difference counts as localized."""
MAX_REGIONS = 3
"""Maximum number of intervals beyond the band that are listed: those with the largest fractions of the difference."""


class DifferenceRow(NamedTuple):
    """One channel of a series compared with the first series."""

    part: ComparisonPart
    channel: str
    label: str
    difference: Difference

    @property
    def relative_rms(self) -> float:
        """Rms difference over the range of the first series [1]; ranks rows by their difference."""
        mean, rms = self.part.series[0].curves[self.channel].mean, self.difference.rms
        known = mean[np.isfinite(mean)]
        if rms is None or not rms > 0.0:
            return 0.0
        span = float(np.ptp(known))
        return rms / span if span > 0.0 else float("inf")

    @property
    def is_localized(self) -> bool:
        """Whether half of the squared difference lies on less than :data:`MAX_LOCALIZED_FRACTION` of the axis."""
        interval, axis = self.difference.half_interval, self.part.axis
        return interval is not None and interval[1] - interval[0] < MAX_LOCALIZED_FRACTION * (axis[-1] - axis[0])


def iter_rows(comparison: Comparison) -> Iterator[DifferenceRow]:
    """Yield every difference, in the order of parts, channels and series."""
    for part in comparison.parts:
        for channel, others in part.differences.items():
            for label, difference in others.items():
                yield DifferenceRow(part, channel, label, difference)


EXTENT_HEADINGS = ("lowest", "at", "highest", "at", "sd", "largest sd", "at")
"""Headings of the columns that describe a single series."""


def iter_extents(part: ComparisonPart, domain: str) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield each channel of the first series, with a cell for each of :data:`EXTENT_HEADINGS`."""
    for channel, curve in part.series[0].curves.items():
        extent = summarize_curve(curve, part.axis)
        extremes = ((extent.minimum, extent.minimum_at), (extent.maximum, extent.maximum_at))
        cells = [cell for value, at in extremes for cell in (format_number(value), format_position(at, domain))]
        yield (
            channel,
            (*cells, format_number(extent.sd), format_number(extent.max_sd), format_position(extent.max_sd_at, domain)),
        )


def humanize_channel(channel: str) -> str:
    """Return ``channel`` in words: ``ankle_moment`` -> ``ankle moment``; ``grf`` is spelled out."""
    return channel.replace("_", " ").replace("grf", "ground reaction").replace("cop x", "centre of pressure x")


def format_channel(part: ComparisonPart, channel: str) -> str:
    """Return ``channel`` in words with its unit in brackets; a pure number has none."""
    unit = format_unit(part.units[channel])
    return humanize_channel(channel) if unit == "1" else f"{humanize_channel(channel)} [{unit}]"


def format_unit(unit: str) -> str:
    """Return ``unit`` with multiplication dots: ``N*m`` -> ``N·m``."""
    return unit.replace("*", "·")


def format_number(value: float | None, *, signed: bool = False) -> str:
    """Return ``value`` with three significant digits, ``signed`` with its sign, or a dash for None.

    Exponents appear only outside :data:`PLAIN_RANGE`; zero has no sign.
    """
    if value is None:
        return "-"
    rounded = Decimal(f"{value:.2e}")
    if rounded == 0:
        return "0"
    is_plain = PLAIN_RANGE[0] <= abs(rounded) < PLAIN_RANGE[1]
    return format(rounded, "+f" if signed else "f") if is_plain else format(value, "+.2e" if signed else ".2e")


def format_correlation(value: float | None) -> str:
    """Return a correlation with three decimals, or a dash for None."""
    return "-" if value is None else f"{value + 0.0:.3f}"


def format_bias(difference: Difference) -> str:
    """Return the mean difference; a mean within the rounding error is 0."""
    if difference.bias is None or difference.rms is None:
        return "-"
    is_rounding_error = abs(difference.bias) <= ROUNDING_TOLERANCE * difference.rms
    return format_number(0.0 if is_rounding_error else difference.bias, signed=True)


def format_series(series: ComparisonSeries, domain: str) -> str:
    """Return the label of ``series`` and the number of repeats that it is the mean of."""
    if series.is_reference:
        return f"{series.label} (reference)"
    noun = "stride" if domain == "phase" else "recording"
    return f"{series.label} ({series.n_repeats} {noun}{'s' * (series.n_repeats != 1)})"


def format_position(value: float | None, domain: str) -> str:
    """Return a position on the axis of ``domain`` with its unit, or a dash for None."""
    return "-" if value is None else f"{value:.4g} {AXIS_UNITS[domain]}"


def format_interval(start: float, end: float) -> str:
    """Return both ends of an interval without a unit."""
    return f"{start:.4g}" if start == end else f"{start:.4g}-{end:.4g}"


def format_half_error_interval(row: DifferenceRow, domain: str) -> str:
    """Return the shortest interval with half of the squared difference, or that the difference is spread out."""
    if row.difference.half_interval is None:
        return "-"
    return (
        f"{format_interval(*row.difference.half_interval)} {AXIS_UNITS[domain]}" if row.is_localized else "spread out"
    )


def format_significant_regions(row: DifferenceRow, domain: str) -> str:
    """Return the intervals beyond the band with the largest differences, or that there is no band to test with."""
    difference = row.difference
    if has_simulated_band(row):
        return "not tested"
    if difference.band == "none":
        return "no band"
    if not difference.regions:
        return "nowhere"
    largest = sorted(difference.regions, key=lambda region: region.fraction, reverse=True)[:MAX_REGIONS]
    intervals = ", ".join(format_interval(r.begin, r.end) for r in difference.regions if r in largest)
    n_omitted = len(difference.regions) - len(largest)
    return f"{intervals} {AXIS_UNITS[domain]}{f' and {n_omitted} more' if n_omitted else ''}"


def explain_numbers(comparison: Comparison) -> list[str]:
    """Return how to read the numbers, one sentence each."""
    first = comparison.parts[0].series[0].label
    if comparison.is_single:
        repeats = "strides" if comparison.domain == "phase" else "recordings"
        explanations = [
            f"Lowest and highest are values of the mean over the {repeats} of '{first}'; sd is the rms standard "
            f"deviation between {repeats}."
        ]
        if comparison.parts[0].series[0].has_simulated_repeats:
            explanations.append(
                "Simulated strides repeat almost exactly: their band says nothing about people or devices."
            )
        return explanations
    rows = list(iter_rows(comparison))
    differences = [row.difference for row in rows]
    explanations = [f"Differences are those of the means: each other series minus '{first}'."]
    normalization = comparison.parts[0].normalization_series
    is_of_people = all(s.label == REFERENCE_LABEL for s in comparison.parts[0].series if s.is_reference)
    if normalization.has_simulated_repeats and normalization.n_repeats > 1:
        explanations.append(
            f"rms/sd is not given: the strides of the simulation '{normalization.label}' repeat almost exactly, so "
            "their standard deviation is no measure of a difference; --reference adds that between people."
        )
    elif any(difference.rms_sd is not None for difference in differences):
        scatter = "between its repeats"
        if normalization.is_reference:
            scatter = "between subjects" if is_of_people else "between the strides of this subject"
        explanations.append(
            f"rms/sd: rms difference divided by the rms standard deviation of '{normalization.label}' {scatter}; '-' "
            f"if that is unknown or below {100.0 * MIN_SD_FRACTION:g} % of the channel's range."
        )
    intervals = INTERVAL_DESCRIPTIONS if is_of_people else {**INTERVAL_DESCRIPTIONS, "reference": SUBJECT_INTERVAL}
    bands: list[BandKind] = ["means", "prediction", "reference"]
    for band in bands:
        labelled = {row.label for row in rows if row.difference.band == band and not has_simulated_band(row)}
        if labelled:
            labels = _format_labels(comparison, labelled)
            explanations.append(
                f"Beyond the band{labels}: intervals where the difference exceeds {intervals[band]}. "
                "Each point is tested alone, without correction for multiple comparisons."
            )
    if any(difference.band == "none" for difference in differences):
        explanations.append(
            "No band: there are neither repeats nor a known standard deviation, so no difference can be tested."
        )
    explanations.append("Half: the shortest interval with half of the squared difference; 'spread out' if it is long.")
    if any(difference.compared_fraction < 1.0 for difference in differences):
        explanations.append(
            "Compared: the fraction of the axis where both series have values; all numbers refer to that fraction."
        )
    simulated = {row.label for row in rows if has_simulated_band(row)}
    if simulated:
        explanations.append(
            f"Not tested{_format_labels(comparison, simulated)}: simulated strides repeat almost exactly, and a band "
            "from them alone says nothing about people or devices."
        )
    return explanations


def _format_labels(comparison: Comparison, labels: set[str]) -> str:
    """Return ``labels`` in parentheses, or nothing if they are all labels of the comparison."""
    all_labels = {row.label for row in iter_rows(comparison)}
    return "" if labels == all_labels else f" ({', '.join(sorted(labels))})"


def has_simulated_band(row: DifferenceRow) -> bool:
    """Return whether the band is made from the scatter of simulated strides alone."""
    if row.difference.band not in ("means", "prediction"):
        return False
    pair = (series for series in row.part.series if series is row.part.series[0] or series.label == row.label)
    return all(series.has_simulated_repeats for series in pair if series.n_repeats > 1)
