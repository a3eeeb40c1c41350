"""What a benchmark's results say, against what was aimed at."""

import statistics
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from catalogue import BODY, EFFECTS, instrument_forms
from plan import WALKS
from scipy.stats import binomtest
from score import BAD, TOLD, Truth, Verdict, first_right, hidden, kinds_confused, left, sets

WORTH = 1.0
"""Size, over the noise, from which an effect ought to be found."""


DECISIVE = 6.0
"""Chi squared that a proposed experiment has to promise; the program says so beside it."""


class Row(NamedTuple):
    """A dataset, what was answered, and what that is worth."""

    name: str
    truth: Truth
    verdict: Verdict
    outcome: str
    second: str | None = None
    """What became of an ambiguous verdict when the experiment that it asks for was done."""


class Metric(NamedTuple):
    """A number, what it is of, and what was aimed at."""

    name: str
    value: float | None
    """None: of nothing."""
    of: int
    """Datasets, or numbers, it was counted over."""
    target: str
    met: bool | None
    low: float | None = None
    """95 % interval of a share (Wilson)."""
    high: float | None = None


class Interval(NamedTuple):
    """One number of an effect that was named as it is."""

    key: str
    true: float
    error: float
    """Relative, of the distance from neutral."""
    covered: bool


def metrics(rows: Sequence[Row]) -> list[Metric]:
    """All that was aimed at, in the order of the table of targets."""
    walked = [row for row in rows if row.truth["block"] in WALKS]
    rows = [row for row in rows if row.truth["block"] not in WALKS]
    by = {block: [r for r in rows if r.truth["block"] == block] for block in {r.truth["block"] for r in rows}}

    def of(*blocks: str) -> list[Row]:
        return [row for block in blocks for row in by.get(block, ())]

    alone = [row for row in of("single", "instrument") if row.truth["size"] >= WORTH]
    ambiguous = [row for row in rows if row.verdict["verdict"] == "ambiguous" and hidden(row.truth)]
    known = [row for row in ambiguous if not row.truth.get("deleted") and not row.truth["strangers"]]
    judged = [row for row in rows if row.truth["block"] not in ("wrong_form", "outside", "repeats")]
    numbers = list(intervals(rows))
    gaps = [share for row in rows if row.outcome == "right" and (share := removed(row)) is not None]
    other = [share for row in of("wrong_form") if (share := removed(row)) is not None]
    errors = [each.error for each in numbers]
    return [
        _share("first name right, effect at least as large as the noise", alone, _first, 0.95),
        _share("exact set, singles at least as large as the noise", alone, _right, 0.90),
        _share("exact set, pairs", of("pair"), _right, 0.85),
        _share("exact set, triples", of("triple"), _right, None),
        _share("false alarms on clean data", of("clean"), lambda r: r.outcome == "false-alarm", 0.0, most=True),
        _share("wrong name, at any size", judged, lambda r: r.outcome in BAD, 0.02, most=True),
        _share(
            "in no catalogue: flagged, or nothing left to flag",
            of("outside"),
            lambda r: r.outcome in ("flagged", "absorbed"),
            0.95,
        ),
        _share("instrument taken for physics or back", judged, _confused, 0.02, most=True),
        _quantile("error of a number, median", errors, 0.5, 0.03, most=True),
        _quantile("error of a number, 90th percentile", errors, 0.9, 0.15, most=True),
        _coverage(numbers),
        _quantile("gap above the floor removed on unseen trials, named, median", gaps, 0.5, 0.95),
        _quantile("gap above the floor removed on unseen trials, wrong form, median", other, 0.5, 0.85),
        _share("rival sets contain the truth", known, lambda r: hidden(r.truth) in sets(r.verdict), 0.98),
        _share("resolved by the experiment that was asked for", _second(known), lambda r: r.second == "right", 0.90),
        _quantile("seconds for a dataset, median", [row.verdict["s"] for row in rows], 0.5, 30.0, most=True),
        *(_of_walks(walked) if walked else ()),
    ]


def _of_walks(rows: Sequence[Row]) -> list[Metric]:
    """The same questions and targets, of the gait rig; but a dataset may take two minutes."""
    there = [row for row in rows if hidden(row.truth) and row.truth["size"] >= WORTH]
    clean, numbers = [row for row in rows if not hidden(row.truth)], list(intervals(rows))
    errors = [each.error for each in numbers]
    seconds = [row.verdict["s"] for row in rows]
    gaps = [share for row in there if row.outcome == "right" and (share := removed(row)) is not None]
    return [
        _share("walks: first name right, effect at least as large as the noise", there, _first, 0.95),
        _share("walks: exact set, effect at least as large as the noise", there, _right, 0.90),
        _share("walks: false alarms on clean data", clean, lambda r: r.outcome == "false-alarm", 0.0, most=True),
        _share("walks: wrong name, at any size", rows, lambda r: r.outcome in BAD, 0.02, most=True),
        _share("walks: instrument taken for the rest or back", rows, _confused, 0.02, most=True),
        _quantile("walks: error of a number, median", errors, 0.5, 0.03, most=True),
        _quantile("walks: error of a number, 90th percentile", errors, 0.9, 0.15, most=True),
        _coverage(numbers, "walks: 95 % intervals that cover the truth"),
        _quantile("walks: gap above the floor removed on unseen trials, median", gaps, 0.5, 0.95),
        _quantile("walks: seconds for a dataset, median", seconds, 0.5, 120.0, most=True),
    ]


def _first(row: Row) -> bool:
    return first_right(row.truth, row.verdict)


def _right(row: Row) -> bool:
    return row.outcome == "right"


def _confused(row: Row) -> bool:
    return kinds_confused(row.truth, row.verdict)


def _second(rows: Iterable[Row]) -> list[Row]:
    """Where the program promised that the experiment would decide; of some rivals it says that none does."""
    return [r for r in rows if r.second is not None and r.verdict["next_experiment"]["separation_chi2"] >= DECISIVE]


def _share(
    name: str, rows: Sequence[Row], yes: Callable[[Row], bool], target: float | None, *, most: bool = False
) -> Metric:
    words = "" if target is None else (f"at most {100 * target:g} %" if most else f"at least {100 * target:g} %")
    if not rows:
        return Metric(name, None, 0, words, None)
    count = sum(map(yes, rows))
    value, around = count / len(rows), binomtest(count, len(rows)).proportion_ci(method="wilson")
    met = None if target is None else (value <= target if most else value >= target)
    return Metric(name, value, len(rows), words, met, around.low, around.high)


def _quantile(name: str, values: Sequence[float], which: float, target: float, *, most: bool = False) -> Metric:
    words = f"{'at most' if most else 'at least'} {target:g}"
    if len(values) < 2:
        return Metric(name, None, len(values), words, None)
    value = statistics.quantiles(values, n=100, method="inclusive")[round(100 * which) - 1]
    return Metric(name, value, len(values), words, value <= target if most else value >= target)


def _coverage(numbers: Sequence[Interval], name: str = "95 % intervals that cover the truth") -> Metric:
    words = "90 to 98 %"
    if not numbers:
        return Metric(name, None, 0, words, None)
    count = sum(each.covered for each in numbers)
    value, around = count / len(numbers), binomtest(count, len(numbers)).proportion_ci(method="wilson")
    return Metric(name, value, len(numbers), words, 0.90 <= value <= 0.98, around.low, around.high)


def intervals(rows: Iterable[Row]) -> Iterator[Interval]:
    """Of every effect that was named in the form it was hidden in, where nothing else was named."""
    for row in rows:
        if row.outcome != "right" or row.verdict["verdict"] != "named":
            continue
        for true in [*row.truth["effects"], *row.truth["instruments"]]:
            found = next(e for e in row.verdict["effects"] if _same(e, true))
            if len(found["parameters"]) != len(true["parameters"]) or not _same_form(found, true):
                continue
            forms = instrument_forms(true["channel"]) if true.get("channel") else EFFECTS | BODY
            own = forms[true["name"], true["form"]]
            values = zip(found["parameters"].items(), true["parameters"].items(), strict=True)
            for (_, told), (key, value) in values:  # a fault's numbers are called otherwise there
                neutral = own[key].neutral or 0.0
                error = abs(told["value"] - value) / abs(value - neutral)
                yield Interval(f"{true['name']}.{key}", value, error, told["low"] <= value <= told["high"])


def _same(found: Mapping[str, Any], true: Mapping[str, Any]) -> bool:
    return found["name"] == true["name"] and found["channel"] == true.get("channel")


def _same_form(found: Mapping[str, Any], true: Mapping[str, Any]) -> bool:
    return bool(true.get("channel")) or found["form"] == true["form"]


def removed(row: Row) -> float | None:
    """Of the channel that a refit leaves worst: the share of its gap above the floor that was removed.

    Channels are in the scale of their noise. None where a refit leaves next to nothing.
    """
    gaps = [gap for gap in row.verdict.get("gap", {}).values() if gap["floor"]]
    if not gaps or left(row.verdict) < WORTH:
        return None
    gap = max(gaps, key=lambda each: each["before"] / each["floor"])
    return float((gap["before"] - gap["after"]) / (gap["before"] - gap["floor"]))


def power(rows: Iterable[Row]) -> dict[str, dict[float, str]]:
    """Effect -> size that was wanted -> what became of it."""
    found: dict[str, dict[float, str]] = {}
    for row in rows:
        for one in [*row.truth["effects"], *row.truth["instruments"]]:
            if row.truth["block"] in ("single", "instrument", "walk"):
                name = f"{one['name']} of {one['channel']}" if one.get("channel") else f"{one['name']}, {one['form']}"
                found.setdefault(name, {})[row.truth["size"]] = row.outcome
    return found


def confusion(rows: Iterable[Row]) -> dict[str, dict[str, int]]:
    """What is hidden -> what was told -> how often; of single effects and faults."""
    found: dict[str, dict[str, int]] = {}
    for row in rows:
        true = hidden(row.truth)
        if len(true) == 1 and row.truth["block"] in ("single", "instrument", "twin", "walk"):
            told = " or ".join(" and ".join(each) for each in sets(row.verdict))
            word = told if row.verdict["verdict"] in TOLD else row.verdict["verdict"]
            own = found.setdefault(true[0], {})
            own[word] = own.get(word, 0) + 1
    return found
