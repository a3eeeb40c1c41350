"""First sentences on a comparison: in which channel each series differs most from the first, and where."""

from klute_sim.comparison.comparison import Comparison
from klute_sim.comparison.curve import summarize_curve
from klute_sim.report.comparison import text as words
from klute_sim.report.comparison.text import DifferenceRow

MIN_RELATIVE_RMS = 1e-9
"""Smallest rms difference over the range of the first series that is not a rounding error."""


def format_headline(comparison: Comparison) -> list[str]:
    """Return one sentence for each series but the first, or one on a single series."""
    if comparison.is_single:
        return [_describe_single_series(comparison)]
    rows = list(words.iter_rows(comparison))
    labels = dict.fromkeys(row.label for row in rows)
    return [_describe_series([row for row in rows if row.label == label], comparison.domain) for label in labels]


def _describe_series(rows: list[DifferenceRow], domain: str) -> str:
    label, first = rows[0].label, rows[0].part.series[0].label
    largest = max(rows, key=lambda row: row.relative_rms)
    if largest.relative_rms < MIN_RELATIVE_RMS:
        return f"'{label}' equals '{first}' in {_count_curves(rows)}."
    d, unit = largest.difference, words.format_unit(largest.part.units[largest.channel])
    amounts = [f"rms {words.format_number(d.rms)} {unit}".removesuffix(" 1")]
    if largest.relative_rms < float("inf"):
        amounts.append(f"{words.format_number(100.0 * largest.relative_rms)} % of its range")
    if d.rms_sd is not None:
        amounts.append(f"{words.format_number(d.rms_sd)} standard deviations")
    peak = f"{words.format_number(d.max_difference, signed=True)} {unit}".removesuffix(" 1")
    sentence = (
        f"'{label}' differs most from '{first}' in {words.humanize_channel(largest.channel)}{_format_trial(largest)}: "
        f"{', '.join(amounts)}; at most {peak} at {words.format_position(d.max_position, domain)}."
    )
    n_beyond, n_tested = _count_beyond(rows)
    if not n_tested:
        return sentence
    return f"{sentence} {n_beyond} of {n_tested} tested curves leave their 95 % band somewhere."


def _count_beyond(rows: list[DifferenceRow]) -> tuple[int, int]:
    tested = [row for row in rows if row.difference.band != "none" and not words.has_simulated_band(row)]
    return sum(bool(row.difference.regions) for row in tested), len(tested)


def _count_curves(rows: list[DifferenceRow]) -> str:
    return "the only compared curve" if len(rows) == 1 else f"all {len(rows)} compared curves"


def _format_trial(row: DifferenceRow) -> str:
    return f" of trial {row.part.name}" if row.part.name else ""


def _describe_single_series(comparison: Comparison) -> str:
    """Return in which channel the repeats vary most, relative to its range."""
    part = comparison.parts[0]
    repeats = "strides" if comparison.domain == "phase" else "recordings"
    label, count = part.series[0].label, part.series[0].n_repeats
    scatter: dict[str, float] = {}
    for channel, curve in part.series[0].curves.items():
        extent = summarize_curve(curve, part.axis)
        if extent.sd is not None and extent.minimum is not None and extent.maximum is not None:
            span = extent.maximum - extent.minimum
            scatter[channel] = extent.sd / span if span > 0.0 else 0.0
    if not scatter:
        return f"'{label}' is the mean of {count} {repeats}."
    channel = max(scatter, key=lambda name: scatter[name])
    sd = summarize_curve(part.series[0].curves[channel], part.axis).sd
    unit = words.format_unit(part.units[channel])
    if part.series[0].has_simulated_repeats:
        return (
            f"'{label}' is the mean of {count} simulated {repeats}, which repeat within a standard deviation of "
            f"{words.format_number(100.0 * scatter[channel])} % of the range of each channel."
        )
    return (
        f"'{label}' is the mean of {count} {repeats}; relative to its range, {words.humanize_channel(channel)} varies "
        f"most between them, by a standard deviation of {words.format_number(sd)} {unit}".removesuffix(" 1")
        + f" ({words.format_number(100.0 * scatter[channel])} % of the range)."
    )
