"""Tables of a comparison and remarks on it, for a terminal."""

from collections.abc import Iterator

from rich import box
from rich.table import Table
from rich.text import Text

from klute_sim.comparison.comparison import Comparison
from klute_sim.report.comparison import text as words
from klute_sim.report.comparison.text import DifferenceRow

MAX_ROWS = 40
"""Maximum number of rows for each series: those with the largest rms relative to the range of the first series."""


def build_tables(comparison: Comparison) -> Iterator[Table]:
    """Yield a table with one row per channel for each series but the first, or one table for a single series."""
    series, domain = comparison.parts[0].series, comparison.domain
    if comparison.is_single:
        yield _build_single_series_table(comparison)
    for other in series[1:]:
        rows = _select_largest([row for row in words.iter_rows(comparison) if row.label == other.label])
        yield _build_difference_table(
            rows, f"{words.format_series(other, domain)} against {words.format_series(series[0], domain)}", domain
        )


def _select_largest(rows: list[DifferenceRow]) -> list[DifferenceRow]:
    if len(rows) <= MAX_ROWS:
        return rows
    largest = sorted(range(len(rows)), key=lambda k: rows[k].relative_rms, reverse=True)[:MAX_ROWS]
    return [rows[k] for k in sorted(largest)]


def _build_difference_table(rows: list[DifferenceRow], title: str, domain: str) -> Table:
    has_trials = any(row.part.name for row in rows)
    is_partial = any(row.difference.compared_fraction < 1.0 for row in rows)
    has_sd = any(row.difference.rms_sd is not None for row in rows)
    has_bands = any(row.difference.band != "none" for row in rows)
    table = Table(title=Text(title), box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    if has_trials:
        table.add_column("trial")
    table.add_column("channel")  # no no_wrap: in a narrow terminal, names wrap and numbers do not
    for heading in ("bias", "rms", *["rms/sd"] * has_sd, "corr.", "largest", "at", *["compared"] * is_partial):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("half", no_wrap=True)
    if has_bands:
        table.add_column("beyond the band")
    for row in rows:
        part, channel, _, d = row
        table.add_row(
            *[part.name] * has_trials,
            f"{words.humanize_channel(channel)} [{words.format_unit(part.units[channel])}]",
            words.format_bias(d),
            words.format_number(d.rms),
            *[words.format_number(d.rms_sd)] * has_sd,
            words.format_number(d.correlation, ".4f"),
            words.format_number(d.max_difference, "+.3g"),
            words.format_position(d.max_position, domain),
            *[f"{100.0 * d.compared_fraction:.0f} %"] * is_partial,
            words.format_half_error_interval(row, domain),
            *[words.format_significant_regions(d, domain)] * has_bands,
        )
    return table


def _build_single_series_table(comparison: Comparison) -> Table:
    title = words.format_series(comparison.parts[0].series[0], comparison.domain)
    table = Table(title=Text(title), box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    has_trials = any(part.name for part in comparison.parts)
    for heading in [*["trial"] * has_trials, "channel"]:
        table.add_column(heading)
    for heading in words.EXTENT_HEADINGS:
        table.add_column(heading, justify="right", no_wrap=True)
    for part in comparison.parts:
        for channel, cells in words.iter_extents(part, comparison.domain):
            table.add_row(
                *[part.name] * has_trials,
                f"{words.humanize_channel(channel)} [{words.format_unit(part.units[channel])}]",
                *cells,
            )
    return table


def collect_remarks(comparison: Comparison) -> list[str]:
    """Return remarks that limit or explain the comparison, one sentence each."""
    if comparison.is_single:
        return [*words.explain_numbers(comparison), *comparison.remarks]
    count = sum(row.label == comparison.parts[0].series[1].label for row in words.iter_rows(comparison))
    omitted = [f"The table shows the {MAX_ROWS} largest of {count} differences; comparison.csv has all of them."]
    return [*omitted * (count > MAX_ROWS), *words.explain_numbers(comparison), *comparison.remarks]
