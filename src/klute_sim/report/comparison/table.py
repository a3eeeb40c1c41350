"""The tables of a comparison, for a terminal."""

from collections.abc import Iterator

from rich import box
from rich.table import Table
from rich.text import Text

from klute_sim.comparison.comparison import Comparison
from klute_sim.report.comparison import text as words
from klute_sim.report.comparison.text import DifferenceRow

MAX_ROWS = 40
"""Shown of each series; of more, those whose rms is the most of the first's range."""


def build_tables(comparison: Comparison) -> Iterator[Table]:
    """A table for every other series, a row in it for every channel; or one of a series alone."""
    series, over = comparison.parts[0].series, comparison.domain
    if comparison.is_single:
        yield _build_single_series_table(comparison)
    for other in series[1:]:
        rows = _select_largest([row for row in words.iter_rows(comparison) if row.label == other.label])
        yield _build_difference_table(
            rows, f"{words.format_series(other, over)} against {words.format_series(series[0], over)}", over
        )


def _select_largest(rows: list[DifferenceRow]) -> list[DifferenceRow]:
    if len(rows) <= MAX_ROWS:
        return rows
    kept = sorted(range(len(rows)), key=lambda k: rows[k].relative_rms, reverse=True)[:MAX_ROWS]
    return [rows[k] for k in sorted(kept)]


def _build_difference_table(rows: list[DifferenceRow], title: str, domain: str) -> Table:
    trials, partly = any(row.part.name for row in rows), any(row.difference.compared_fraction < 1.0 for row in rows)
    spread, bands = (any(row.difference.rms_sd is not None for row in rows),
                     any(row.difference.band != "none" for row in rows))  # fmt: skip
    result = Table(title=Text(title), box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    if trials:
        result.add_column("trial")
    result.add_column("channel")  # where the terminal is narrow, words wrap and numbers do not
    for heading in ("bias", "rms", *["rms/sd"] * spread, "corr.", "largest", "at", *["compared"] * partly):
        result.add_column(heading, justify="right", no_wrap=True)
    result.add_column("half", no_wrap=True)
    if bands:
        result.add_column("beyond the band")
    for row in rows:
        part, channel, _, d = row
        result.add_row(
            *[part.name] * trials,
            f"{words.humanize_channel(channel)} [{words.format_unit(part.units[channel])}]",
            words.format_bias(d),
            words.format_number(d.rms),
            *[words.format_number(d.rms_sd)] * spread,
            words.format_number(d.correlation, ".4f"),
            words.format_number(d.max_difference, "+.3g"),
            words.format_position(d.max_position, domain),
            *[f"{100.0 * d.compared_fraction:.0f} %"] * partly,
            words.format_half_error_interval(row, domain),
            *[words.format_significant_regions(d, domain)] * bands,
        )
    return result


def _build_single_series_table(comparison: Comparison) -> Table:
    title = words.format_series(comparison.parts[0].series[0], comparison.domain)
    result = Table(title=Text(title), box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    trials = any(part.name for part in comparison.parts)
    for heading in [*["trial"] * trials, "channel"]:
        result.add_column(heading)
    for heading in words.EXTENT_HEADINGS:
        result.add_column(heading, justify="right", no_wrap=True)
    for part in comparison.parts:
        for channel, told in words.iter_extents(part, comparison.domain):
            result.add_row(
                *[part.name] * trials,
                f"{words.humanize_channel(channel)} [{words.format_unit(part.units[channel])}]",
                *told,
            )
    return result


def collect_remarks(comparison: Comparison) -> list[str]:
    """What a reader has to know beside the tables, one sentence each."""
    if comparison.is_single:
        return [*words.explain_numbers(comparison), *comparison.remarks]
    count = sum(row.label == comparison.parts[0].series[1].label for row in words.iter_rows(comparison))
    more = [f"Shown are the {MAX_ROWS} largest of {count} differences; comparison.csv has all."] * (count > MAX_ROWS)
    return [*more, *words.explain_numbers(comparison), *comparison.remarks]
