"""Tables of a comparison and remarks on it, for a terminal."""

from collections.abc import Iterator

from rich.table import Table

from klute_sim.comparison.comparison import Comparison, ComparisonPart
from klute_sim.report.comparison import text as words
from klute_sim.report.comparison.text import DifferenceRow
from klute_sim.terminal_table import create_table

MIN_NAME_WIDTH_CHARS = 14
"""Width [characters] of the column of names in a narrow terminal."""
N_EXTENT_COLUMNS = 5
"""Number of :data:`words.EXTENT_HEADINGS` that fit a terminal; the page has all."""
MAX_ROWS = 40
"""Maximum number of rows for each series: those with the largest rms relative to the range of the first series."""


def build_tables(comparison: Comparison) -> Iterator[Table]:
    """Yield two tables for each series but the first (size and position of the differences); one for a single series.

    Each fits into 80 columns; in fewer, the names of channels wrap.
    """
    series, domain = comparison.parts[0].series, comparison.domain
    if comparison.is_single:
        yield _build_single_series_table(comparison)
    for other in series[1:]:
        rows = _select_largest([row for row in words.iter_rows(comparison) if row.label == other.label])
        title = f"{words.format_series(other, domain)} minus {words.format_series(series[0], domain)}"
        yield _build_size_table(rows, f"{title}: size of the difference")
        yield _build_position_table(rows, f"{title}: position of the difference", domain)


def _select_largest(rows: list[DifferenceRow]) -> list[DifferenceRow]:
    if len(rows) <= MAX_ROWS:
        return rows
    largest = sorted(range(len(rows)), key=lambda k: rows[k].relative_rms, reverse=True)[:MAX_ROWS]
    return [rows[k] for k in sorted(largest)]


def _build_size_table(rows: list[DifferenceRow], title: str) -> Table:
    is_partial = any(row.difference.compared_fraction < 1.0 for row in rows)
    has_sd = any(row.difference.rms_sd is not None for row in rows)
    table = _create_table(title)
    for heading in ("bias", "rms", *["rms/sd"] * has_sd, "corr.", *["compared"] * is_partial):
        table.add_column(heading, justify="right", no_wrap=True)
    for row, label in _iter_labelled(rows):
        if row is None:
            table.add_row(label)
            continue
        d = row.difference
        table.add_row(
            label,
            words.format_bias(d),
            words.format_number(d.rms),
            *[words.format_number(d.rms_sd)] * has_sd,
            words.format_correlation(d.correlation),
            *[f"{100.0 * d.compared_fraction:.0f} %"] * is_partial,
        )
    return table


def _build_position_table(rows: list[DifferenceRow], title: str, domain: str) -> Table:
    has_bands = any(row.difference.band != "none" and not words.has_simulated_band(row) for row in rows)
    table = _create_table(title)
    for heading in ("largest", "at", "half"):
        table.add_column(heading, justify="right", no_wrap=True)
    if has_bands:
        table.add_column("beyond the band")
    for row, label in _iter_labelled(rows):
        if row is None:
            table.add_row(label)
            continue
        table.add_row(
            label,
            words.format_number(row.difference.max_difference, signed=True),
            words.format_position(row.difference.max_position, domain),
            words.format_half_error_interval(row, domain),
            *[words.format_significant_regions(row, domain)] * has_bands,
        )
    return table


def _build_single_series_table(comparison: Comparison) -> Table:
    table = _create_table(words.format_series(comparison.parts[0].series[0], comparison.domain))
    for heading in words.EXTENT_HEADINGS[:N_EXTENT_COLUMNS]:
        table.add_column(heading, justify="right", no_wrap=True)
    for part in comparison.parts:
        if part.name:
            table.add_row(part.name)
        for channel, cells in words.iter_extents(part, comparison.domain):
            table.add_row(_format_label(part, channel), *cells[:N_EXTENT_COLUMNS])
    return table


def _create_table(title: str) -> Table:
    """Return a table whose first column is for names, which wrap between words and are never cut."""
    table = create_table(title=title)
    table.add_column("channel", min_width=MIN_NAME_WIDTH_CHARS, overflow="fold")
    return table


def _iter_labelled(rows: list[DifferenceRow]) -> Iterator[tuple[DifferenceRow | None, str]]:
    """Yield each row with its label; before the rows of a named trial, yield None with the name of the trial."""
    trial = ""
    for row in rows:
        if row.part.name != trial:
            trial = row.part.name
            yield None, trial
        yield row, _format_label(row.part, row.channel)


def _format_label(part: ComparisonPart, channel: str) -> str:
    return f"{'  ' * bool(part.name)}{words.format_channel(part, channel)}"


def collect_remarks(comparison: Comparison) -> list[str]:
    """Return remarks that limit or explain the comparison, one sentence each."""
    if comparison.is_single:
        return [*words.explain_numbers(comparison), *comparison.remarks]
    count = sum(row.label == comparison.parts[0].series[1].label for row in words.iter_rows(comparison))
    omitted = [f"The table shows the {MAX_ROWS} largest of {count} differences; comparison.csv has all of them."]
    return [*omitted * (count > MAX_ROWS), *words.explain_numbers(comparison), *comparison.remarks]
