"""Tables and sentences of an import for a terminal; entries that several files share are merged.

The file import.json has all entries.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby, pairwise
from typing import Any

from rich.table import Table

from klute_sim.terminal_table import create_table

MAX_LISTED_FILES = 3
"""Maximum number of files that are listed by name; the rest are counted."""
NUMBER_PATTERN = re.compile(r"(?<![\w.-])-?(?:\d+\.\d+(?:e[-+]\d+)?|\d+(?= (?:degrees|%|ms|s|mm|N)(?!\w)))")
"""Numbers that may differ between merged sentences: decimal fractions, and integers with a unit."""


def collect_sentences(result: Mapping[str, Any], section: str) -> list[str]:
    """Return the sentences of ``section``; shared sentences are merged, with the range of their numbers."""
    files = {entry["file"] for entry in result["files"]}
    sentences = []
    for text in result[section]:
        file, colon, rest = text.partition(": ")
        sentences.append((file, rest) if colon and file in files else ("", text))
    return [f"{_format_files(names)}: {text}" if any(names) else text for names, text in _merge_sentences(sentences)]


def build_files_table(result: Mapping[str, Any]) -> Table:
    """Build the table of the imported files."""
    rows = []
    for entry in result["files"]:
        has_time = entry["rate_hz"] is not None
        duration, rate = (f"{entry['duration_s']:.2f}", f"{entry['rate_hz']:g}") if has_time else ("-", "-")
        rows.append((entry["file"], entry["type"], duration, rate, ", ".join(entry["content"])))
    return build_table(
        "Files", ("file", "kind", "seconds", "Hz", "contents"), rows, unbroken_columns=("file", "kind", "contents")
    )


def build_channels_table(result: Mapping[str, Any], *, all_files: bool) -> Table:
    """Build the table of the source of each channel.

    With ``all_files`` the table has all files; otherwise equal rows are merged, and trivial columns omitted.
    """
    headings = ["channel", "side", "column", "unit", "sign", "zero", "reason"]
    cells = [
        (entry["file"], *(entry[key] for key in ("channel", "side", "column", "unit")), f"{entry['sign']:+d}",
         f"{entry['zero']:g}", entry["reason"])
        for entry in result["channels"]
    ]  # fmt: skip
    if all_files:
        return build_table("Channels", headings, [row for _, *row in cells], unbroken_columns=("channel", "side"))
    texts = [
        (file, "\t".join((channel, side, collapse_ranges(column), *rest)))
        for file, channel, side, column, *rest in cells
    ]
    rows = [tuple(text.split("\t")) for _, text in _merge_sentences(texts)]
    trivial = {"sign": "+1", "zero": "0"}
    informative = [k for k, name in enumerate(headings) if {row[k] for row in rows} != {trivial.get(name)}]
    rows = [tuple(row[k] for k in informative) for row in rows]
    headings = [headings[k] for k in informative]
    return build_table("Channels", headings, rows, unbroken_columns=("channel", "side", "column"))


def build_trials_table(result: Mapping[str, Any]) -> Table:
    """Build the table of the trials of a dataset; measured channels that all trials share are in the title."""
    headings = ["files", "group", "strides", "stride, s", "peak, bar", "measured"]
    rows: list[tuple[str, ...]] = [
        (", ".join(trial["sources"]), trial["group"], str(trial["strides"]), f"{trial['stride_time_s']:.3f}",
         f"{trial['peak_command_bar']:.2f}", ", ".join(trial["measured"]))
        for trial in result["trials"]
    ]  # fmt: skip
    is_shared = len({row[-1] for row in rows}) == 1
    title = f"Trials; measured: {rows[0][-1]}" if is_shared else "Trials"
    if is_shared:
        headings, rows = headings[:-1], [row[:-1] for row in rows]
    return build_table(title, headings, rows, unbroken_columns=("files", "group", "measured"))


def build_table(
    title: str, headings: Sequence[str], rows: Iterable[Sequence[str]], unbroken_columns: Sequence[str]
) -> Table:
    """Build a table of ``rows``; words in ``unbroken_columns`` are not broken in a narrow terminal."""
    rows = list(rows)
    table = create_table(title=title)
    for k, heading in enumerate(headings):
        words = [word for row in rows for word in row[k].split()] if heading in unbroken_columns else []
        table.add_column(heading, overflow="fold", min_width=max(map(len, words), default=None))
    for row in rows:
        table.add_row(*row)
    return table


def collapse_ranges(names: str) -> str:
    """Return ``names`` with three or more consecutive numbers as a range: ``S 1, S 2, S 3, T`` -> ``S 1–3, T``."""
    collapsed: list[str] = []
    for stem, group in groupby(names.split(", "), key=lambda name: name.rstrip("0123456789").rstrip()):
        members = list(group)
        numbers = [name.removeprefix(stem).strip() for name in members]
        if len(members) > 2 and all(numbers) and all(int(b) == int(a) + 1 for a, b in pairwise(numbers)):
            first = f"{stem} {numbers[0]}" if " " in members[0].removeprefix(stem) else members[0]
            members = [f"{first}–{numbers[-1]}"]
        collapsed += members
    return ", ".join(collapsed)


def _merge_sentences(sentences: Iterable[tuple[str, str]]) -> Iterator[tuple[list[str], str]]:
    """Merge the sentences (file, sentence) that differ in measured numbers alone; yield (files, sentence)."""
    groups: dict[str, dict[str, str]] = {}
    for file, text in sentences:
        template = NUMBER_PATTERN.sub("#", text)
        while file in groups.get(template, {}):  # sentences of the same file are not merged
            template += " "
        groups.setdefault(template, {})[file] = text
    for texts in groups.values():
        fixed = NUMBER_PATTERN.split(next(iter(texts.values())))
        spans = [_format_span(numbers) for numbers in zip(*map(NUMBER_PATTERN.findall, texts.values()), strict=True)]
        yield list(texts), "".join(part for pair in zip(fixed, [*spans, ""], strict=True) for part in pair)


def _format_span(numbers: Sequence[str]) -> str:
    low, high = min(numbers, key=float), max(numbers, key=float)
    return low if low == high else f"{low} to {high}"


def _format_files(files: Sequence[str]) -> str:
    n_omitted = len(files) - MAX_LISTED_FILES
    return ", ".join(files[:MAX_LISTED_FILES]) + (f" and {n_omitted} more" if n_omitted > 0 else "")
