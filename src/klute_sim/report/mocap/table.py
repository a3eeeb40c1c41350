"""What an import found and decided, for a terminal: what is doubted first, and what several files share said once.

All of it, entry by entry, is in import.json.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby, pairwise
from typing import Any

from rich import box
from rich.table import Table

MAX_LISTED_FILES = 3
"""Named before the rest are counted."""
NUMBER_PATTERN = re.compile(r"(?<![\w.-])-?(?:\d+\.\d+(?:e[-+]\d+)?|\d+(?= (?:degrees|%|ms|s|mm|N)(?!\w)))")
"""Numbers that may differ between files of which one sentence is told: decimal fractions, or with a unit."""


def collect_sentences(result: Mapping[str, Any], section: str) -> list[str]:
    """Those under ``title``; what is told of several files is one, with the span of its numbers."""
    files = {entry["file"] for entry in result["found"]}
    told = []
    for sentence in result[section]:
        file, colon, rest = sentence.partition(": ")
        told.append((file, rest) if colon and file in files else ("", sentence))
    return [f"{_format_files(names)}: {said}" if any(names) else said for names, said in _merge_sentences(told)]


def build_files_table(result: Mapping[str, Any]) -> Table:
    """The files."""
    rows = []
    for entry in result["found"]:
        rate = "-" if entry["rate_hz"] is None else f"{entry['rate_hz']:g}"
        rows.append((entry["file"], entry["kind"], f"{entry['seconds']:.2f}", rate, ", ".join(entry["holds"])))
    return build_table(
        "Found", ("file", "kind", "seconds", "Hz", "holds"), rows, unbroken_columns=("file", "kind", "holds")
    )


def build_channels_table(result: Mapping[str, Any], *, all_files: bool) -> Table:
    """Where each channel is from; ``whole``: every file's, else those that are alike once, without what is trivial."""
    headings = ["channel", "side", "from", "unit", "sign", "zero", "why"]
    cells = [
        (entry["file"], *(entry[key] for key in ("channel", "side", "column", "unit")), f"{entry['sign']:+d}",
         f"{entry['zero']:g}", entry["why"])
        for entry in result["mapped"]
    ]  # fmt: skip
    if all_files:
        return build_table("Mapped", headings, [row for _, *row in cells], unbroken_columns=("channel", "side"))
    texts = [(file, "\t".join((channel, side, collapse_ranges(of), *rest))) for file, channel, side, of, *rest in cells]
    rows = [tuple(text.split("\t")) for _, text in _merge_sentences(texts)]
    trivial = {"sign": "+1", "zero": "0"}
    kept = [k for k, name in enumerate(headings) if {row[k] for row in rows} != {trivial.get(name)}]
    rows = [tuple(row[k] for k in kept) for row in rows]
    return build_table("Mapped", [headings[k] for k in kept], rows, unbroken_columns=("channel", "side", "from"))


def build_trials_table(result: Mapping[str, Any]) -> Table:
    """Of a dataset; what all of them measured is no column."""
    headings = ["of", "group", "strides", "stride, s", "peak, bar", "measured"]
    rows: list[tuple[str, ...]] = [
        (", ".join(trial["of"]), trial["group"], str(trial["strides"]), f"{trial['stride_time_s']:.3f}",
         f"{trial['command_peak_bar']:.2f}", ", ".join(trial["measured"]))
        for trial in result["trials"]
    ]  # fmt: skip
    alike = len({row[-1] for row in rows}) == 1
    title = f"Trials; measured: {rows[0][-1]}" if alike else "Trials"
    if alike:
        headings, rows = headings[:-1], [row[:-1] for row in rows]
    return build_table(title, headings, rows, unbroken_columns=("of", "group", "measured"))


def build_table(
    title: str, headings: Sequence[str], rows: Iterable[Sequence[str]], unbroken_columns: Sequence[str]
) -> Table:
    """``rows`` under ``headings``; a word in the columns ``names`` is never cut."""
    rows = list(rows)
    made = Table(title=title, box=box.SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for k, heading in enumerate(headings):
        words = [word for row in rows for word in row[k].split()] if heading in unbroken_columns else []
        made.add_column(heading, overflow="fold", min_width=max(map(len, words), default=None))
    for row in rows:
        made.add_row(*row)
    return made


def collapse_ranges(names: str) -> str:
    """``S 1, S 2, S 3, T`` -> ``S 1–3, T``; all that is no run of three or more stays as it is written."""
    told: list[str] = []
    for stem, group in groupby(names.split(", "), key=lambda name: name.rstrip("0123456789").rstrip()):
        run = list(group)
        numbers = [name.removeprefix(stem).strip() for name in run]
        if len(run) > 2 and all(numbers) and all(int(b) == int(a) + 1 for a, b in pairwise(numbers)):
            run = [
                f"{stem} {numbers[0]}–{numbers[-1]}" if " " in run[0].removeprefix(stem) else f"{run[0]}–{numbers[-1]}"
            ]
        told += run
    return ", ".join(told)


def _merge_sentences(sentences: Iterable[tuple[str, str]]) -> Iterator[tuple[list[str], str]]:
    """(files, sentence) of what each file is told; those that differ in measured numbers alone are one."""
    groups: dict[str, dict[str, str]] = {}
    for file, said in sentences:
        form = NUMBER_PATTERN.sub("#", said)
        while file in groups.get(form, {}):  # one file's own sentences are about different things
            form += " "
        groups.setdefault(form, {})[file] = said
    for of in groups.values():
        between = NUMBER_PATTERN.split(next(iter(of.values())))
        spans = [_format_span(numbers) for numbers in zip(*map(NUMBER_PATTERN.findall, of.values()), strict=True)]
        yield list(of), "".join(word for pair in zip(between, [*spans, ""], strict=True) for word in pair)


def _format_span(numbers: Sequence[str]) -> str:
    low, high = min(numbers, key=float), max(numbers, key=float)
    return low if low == high else f"{low} to {high}"


def _format_files(files: Sequence[str]) -> str:
    rest = len(files) - MAX_LISTED_FILES
    return ", ".join(files[:MAX_LISTED_FILES]) + (f" and {rest} more" if rest > 0 else "")
