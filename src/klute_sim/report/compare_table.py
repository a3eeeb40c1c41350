"""The tables of a comparison, for a terminal."""

from collections.abc import Iterator

from rich import box
from rich.table import Table
from rich.text import Text

from klute_sim.compare.comparison import Comparison
from klute_sim.report import compare_words as words
from klute_sim.report.compare_words import Row

MOST_ROWS = 40
"""Shown of each series; of more, those whose rms is the most of the first's range."""


def tables(found: Comparison) -> Iterator[Table]:
    """A table for every other series, a row in it for every channel; or one of a series alone."""
    series, over = found.parts[0].series, found.over
    if found.alone:
        yield _alone(found)
    for other in series[1:]:
        rows = _largest([row for row in words.rows(found) if row.other == other.label])
        yield _table(rows, f"{words.named(other, over)} against {words.named(series[0], over)}", over)


def _largest(rows: list[Row]) -> list[Row]:
    if len(rows) <= MOST_ROWS:
        return rows
    kept = sorted(range(len(rows)), key=lambda k: rows[k].severity, reverse=True)[:MOST_ROWS]
    return [rows[k] for k in sorted(kept)]


def _table(rows: list[Row], title: str, over: str) -> Table:
    trials, partly = any(row.part.name for row in rows), any(row.difference.share < 1.0 for row in rows)
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
            f"{words.spoken(channel)} [{words.unit(part.units[channel])}]",
            words.bias(d),
            words.number(d.rms),
            *[words.number(d.rms_sd)] * spread,
            words.number(d.correlation, ".4f"),
            words.number(d.largest, "+.3g"),
            words.place(d.at, over),
            *[f"{100.0 * d.share:.0f} %"] * partly,
            words.half(row, over),
            *[words.beyond(d, over)] * bands,
        )
    return result


def _alone(found: Comparison) -> Table:
    title = words.named(found.parts[0].series[0], found.over)
    result = Table(title=Text(title), box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    trials = any(part.name for part in found.parts)
    for heading in [*["trial"] * trials, "channel"]:
        result.add_column(heading)
    for heading in words.EXTENT:
        result.add_column(heading, justify="right", no_wrap=True)
    for part in found.parts:
        for channel, told in words.extents(part, found.over):
            result.add_row(*[part.name] * trials, f"{words.spoken(channel)} [{words.unit(part.units[channel])}]", *told)
    return result


def remarks(found: Comparison) -> list[str]:
    """What a reader has to know beside the tables, one sentence each."""
    if found.alone:
        return [*words.rules(found), *found.remarks]
    count = sum(row.other == found.parts[0].series[1].label for row in words.rows(found))
    more = [f"Shown are the {MOST_ROWS} largest of {count} differences; comparison.csv has all."] * (count > MOST_ROWS)
    return [*more, *words.rules(found), *found.remarks]
