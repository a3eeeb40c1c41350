"""Score the answers of any method on a frozen release of the benchmark; needs nothing but Python.

    python score.pyz ANSWERS                 # in the folder of the release
    python score.pyz ANSWERS --json          # one JSON object with the lines and the outcome of every dataset
    python score.pyz ANSWERS --details       # a line for every dataset, in a release to develop on
    python score.pyz ANSWERS --only-answered # of a part of the datasets, in a release to develop on

ANSWERS is a folder with one file NAME.json for each folder datasets/NAME. DATA_CARD.md describes both.
"""

import argparse
import base64
import json
import math
import os
import sys
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.hidden_effects.release.answers import WITHHELD_FILE, Allowed, AnswerError, read_answer, read_numbers
from benchmarks.hidden_effects.score import (
    WRONG_OUTCOMES,
    is_absorbed,
    is_first_right,
    is_out_of_catalogue,
    is_wrong_alone,
    list_effect_sets,
    list_hidden_effects,
    score_verdict,
)

OPEN_FILE = "truths.json"
"""Truths of a release to develop on."""
SEALED_FILE = "truths.sealed"
"""File of the release with the ground truths."""
NAMES_FILE = "names.json"
"""File of the release with the allowed names and their kinds."""
Z_SCORE = 1.959964
"""Quantile of the 95 % interval."""


class ScoredAnswer(NamedTuple):
    """A dataset with its ground truth, the answer and its outcome."""

    name: str
    truth: Mapping[str, Any]
    answer: Mapping[str, Any]
    outcome: str


class Row(NamedTuple):
    """A line of the table: how many of how many, and what is better."""

    name: str
    count: int
    of: int
    higher_is_better: bool


def seal(truths: Mapping[str, Any]) -> str:
    """Return ``truths`` as text that nobody reads by accident; it is no protection against intent."""
    return base64.b85encode(zlib.compress(json.dumps(truths, sort_keys=True).encode(), 9)).decode() + "\n"


def unseal(text: str) -> dict[str, Any]:
    """Return the ground truths in ``text``."""
    truths: dict[str, Any] = json.loads(zlib.decompress(base64.b85decode(text.strip())))
    return truths


def score_answer(name: str, truth: Mapping[str, Any], answer: Mapping[str, Any]) -> ScoredAnswer:
    """Return the scored ``answer``."""
    return ScoredAnswer(name, truth, answer, score_verdict(truth, answer))


def compute_rows(answers: Sequence[ScoredAnswer]) -> list[Row]:
    """Return the lines of the table, which are the same for all methods."""

    def count(
        name: str,
        blocks: Sequence[str],
        counts: Callable[[ScoredAnswer], bool],
        higher_is_better: bool = True,
        selects: Callable[[ScoredAnswer], bool] = lambda a: True,
    ) -> Row:
        selected = [a for a in answers if a.truth["block"] in blocks and selects(a)]
        return Row(name, sum(map(counts, selected)), len(selected), higher_is_better)

    def is_visible(a: ScoredAnswer) -> bool:
        return float(a.truth["size"]) >= 1.0

    def is_right(a: ScoredAnswer) -> bool:
        return a.outcome == "right"

    def is_best(a: ScoredAnswer) -> bool:
        if is_out_of_catalogue(a.truth):
            return a.answer["verdict"] == "unexplained" or a.outcome == "absorbed"
        return a.outcome == "right"

    def is_wrong(a: ScoredAnswer) -> bool:
        return a.outcome in WRONG_OUTCOMES

    def is_alone(a: ScoredAnswer) -> bool:
        return is_wrong_alone(a.outcome)

    blocks = sorted({a.truth["block"] for a in answers})
    return [
        count("the best answer, all datasets", blocks, is_best),
        count(
            "first name right, effect at least as large as the noise",
            ("single", "instrument"),
            lambda a: is_first_right(a.truth, a.answer),
            selects=is_visible,
        ),
        count("exact set, one effect", ("single", "instrument"), is_right, selects=is_visible),
        count("exact set, two effects", ("pair",), is_right),
        count("exact set, three effects", ("triple",), is_right),
        count("an effect is named in clean data", ("clean",), is_wrong, False),
        count(
            "outside the catalogue: unexplained, or absorbed",
            ("outside",),
            is_best,
        ),
        count(
            "outside the catalogue, faint: a wrong name alone",
            ("faint_outside",),
            is_alone,
            False,
            lambda a: not is_absorbed(a.truth),
        ),
        count("a form outside the catalogue: a wrong name alone", ("wrong_form",), is_alone, False),
        count(
            "wrong number: in a set, or without influence",
            ("wrong_number",),
            lambda a: a.outcome in ("right", "loose", "absorbed"),
        ),
        count("wrong number: a wrong name alone", ("wrong_number",), is_alone, False),
        count(
            "imperfect law: names right", ("imperfect",), is_right, selects=lambda a: bool(list_hidden_effects(a.truth))
        ),
        count(
            "imperfect law: a name without an effect",
            ("imperfect",),
            is_wrong,
            False,
            lambda a: not list_hidden_effects(a.truth),
        ),
        count(
            "the truth is in a set of several",
            blocks,
            lambda a: list_hidden_effects(a.truth) in list_effect_sets(a.answer),
            selects=lambda a: (
                a.answer["verdict"] == "indistinguishable"
                and bool(list_hidden_effects(a.truth))
                and not is_out_of_catalogue(a.truth)
            ),
        ),
        count("wrong names, all datasets", blocks, is_wrong, False),
    ]


def compute_wilson_interval(count: int, of: int) -> tuple[float, float]:
    """Return the 95 % interval of a fraction (Wilson 1927, J Am Stat Assoc 22:209)."""
    fraction, z2 = count / of, Z_SCORE**2
    center = (fraction + z2 / (2 * of)) / (1 + z2 / of)
    half = Z_SCORE * math.sqrt(fraction * (1 - fraction) / of + z2 / (4 * of * of)) / (1 + z2 / of)
    return max(0.0, center - half), min(1.0, center + half)


def format_table(rows: Sequence[Row], silent_rows: Sequence[Row]) -> str:
    """Return the table as Markdown; ``silent_rows`` are those of always answering ``nothing-missing``."""
    lines = ["| measure | value | 95 % interval | of | better | always nothing-missing |", "|---|---|---|---|---|---|"]
    for row, silent in zip(rows, silent_rows, strict=True):
        cells = [row.name, format_percentage(row), "-", str(row.of), "higher" if row.higher_is_better else "lower"]
        if row.of:
            low, high = compute_wilson_interval(row.count, row.of)
            cells[2] = f"{100 * low:.1f} to {100 * high:.1f} %"
        lines.append(f"| {' | '.join([*cells, format_percentage(silent)])} |")
    return "\n".join(lines)


def format_percentage(row: Row) -> str:
    """Return the value of a line; '-' where it counts no dataset."""
    return f"{100 * row.count / row.of:.1f} %" if row.of else "-"


def format_details(answers: Sequence[ScoredAnswer]) -> str:
    """Return a line of Markdown for every dataset, sorted by kind."""
    lines = ["| dataset | kind | hidden | size | answer | outcome |", "|---|---|---|---|---|---|"]
    for a in sorted(answers, key=lambda a: (a.truth["block"], a.name)):
        hidden = ", ".join(list_hidden_effects(a.truth)) or a.truth.get("defect") or "-"
        if a.truth.get("deleted"):
            hidden += " (withheld)"
        sets = [" + ".join(names) for names in list_effect_sets(a.answer) if names]
        answer = ": ".join([a.answer["verdict"], *([" or ".join(sets)] if sets else [])])
        size = f"{a.truth['size']:.1f}" if a.truth.get("size") else "-"
        lines.append(f"| {a.name} | {a.truth['block']} | {hidden} | {size} | {answer} | {a.outcome} |")
    return "\n".join(lines)


def read_allowed(release: Path, truths: Mapping[str, Any]) -> dict[str, Allowed]:
    """Return what an answer may name, by dataset; raises FileNotFoundError when ``release`` is incomplete."""
    kinds, withheld = (json.loads((release / name).read_text("utf-8")) for name in (NAMES_FILE, WITHHELD_FILE))
    return {
        name: Allowed(kinds, withheld.get(name, ()), truth["raw_size_by_channel"].keys(), read_numbers(release, name))
        for name, truth in truths.items()
    }


def score_folder(truths: Mapping[str, Any], allowed: Mapping[str, Allowed], folder: Path) -> list[ScoredAnswer]:
    """Return the scored answers in ``folder``; raises AnswerError with a line for each fault.

    ``allowed`` holds what an answer may name, by dataset.
    """
    scored, faults = [], []
    for name, truth in sorted(truths.items()):
        try:
            scored.append(score_answer(name, truth, read_answer(folder / f"{name}.json", allowed[name])))
        except AnswerError as error:
            faults.append(str(error))
    faults += [
        f"{path} belongs to no dataset of this release; remove it"
        for path in sorted(folder.glob("*.json"))
        if path.stem not in truths
    ]
    if faults:
        raise AnswerError("\n".join(faults))
    return scored


def main(arguments: Sequence[str] | None = None) -> int:
    """Score a folder of answers; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("answers", type=Path, help="folder of answers, NAME.json")
    parser.add_argument(
        "--release", type=Path, default=Path("."), help="folder of the release  [default: the current folder]"
    )
    parser.add_argument(
        "--only-answered", action="store_true", help="leave out datasets without an answer, in a release to develop on"
    )
    output = parser.add_mutually_exclusive_group()
    output.add_argument("--json", action="store_true", help="print one JSON object instead of the table")
    output.add_argument(
        "--details", action="store_true", help="print truth, answer and outcome of every dataset instead"
    )
    options = parser.parse_args(arguments)
    try:
        truths = unseal((options.release / SEALED_FILE).read_text("ascii"))
        allowed = read_allowed(options.release, truths)
    except FileNotFoundError as error:
        parser.error(f"{error.filename} is missing; run this in the folder of the release, or use --release")
    for option in ("details", "only_answered"):
        if getattr(options, option) and not (options.release / OPEN_FILE).exists():
            name = option.replace("_", "-")
            parser.error(f"{options.release} has no {OPEN_FILE}: --{name} is for a release to develop on")
    if not options.answers.is_dir():
        parser.error(f"{options.answers} is no folder; it should contain a file NAME.json for each dataset")
    if options.only_answered:
        n_datasets = len(truths)
        truths = {name: truth for name, truth in truths.items() if (options.answers / f"{name}.json").exists()}
        print(f"{n_datasets - len(truths)} of {n_datasets} datasets have no answer and do not count", file=sys.stderr)
    try:
        answers = score_folder(truths, allowed, options.answers)
    except AnswerError as error:
        print(error, file=sys.stderr)
        return 2
    rows = compute_rows(answers)
    if options.json:
        outcomes = {a.name: a.outcome for a in answers}
        text = json.dumps({"rows": [row._asdict() for row in rows], "outcomes": outcomes}, indent=1)
    elif options.details:
        text = format_details(answers)
    else:
        silent = {"verdict": "nothing-missing", "effects": [], "alternatives": []}
        text = format_table(rows, compute_rows([score_answer(a.name, a.truth, silent) for a in answers]))
    try:
        print(text, flush=True)
    except BrokenPipeError:  # the reader has seen enough, such as `head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python flushes once more at its end
    return 0


if __name__ == "__main__":
    sys.exit(main())
