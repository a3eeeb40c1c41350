"""What a benchmark's results say, against what was aimed at."""

import statistics
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from benchmarks.hidden_effects.catalogue import BODY_EFFECTS, EFFECTS, instrument_forms
from benchmarks.hidden_effects.plan import GAIT_BLOCKS
from benchmarks.hidden_effects.score import (
    NAMING_VERDICTS,
    WRONG_OUTCOMES,
    Truth,
    Verdict,
    are_kinds_confused,
    is_first_right,
    list_effect_sets,
    list_hidden_effects,
    residual_over_noise,
)
from scipy.stats import binomtest

MIN_RELEVANT_SIZE = 1.0
"""Size, over the noise, from which an effect ought to be found."""


MIN_DECISIVE_CHI2 = 6.0
"""Chi squared that a proposed experiment has to promise; the program says so beside it."""


class DatasetResult(NamedTuple):
    """A dataset, what was answered, and what that is worth."""

    name: str
    truth: Truth
    verdict: Verdict
    outcome: str
    second_outcome: str | None = None
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


class ParameterInterval(NamedTuple):
    """One number of an effect that was named as it is."""

    key: str
    true_value: float
    relative_error: float
    """Relative, of the distance from neutral."""
    is_covered: bool


def compute_metrics(rows: Sequence[DatasetResult]) -> list[Metric]:
    """All that was aimed at, in the order of the table of targets."""
    walked = [row for row in rows if row.truth["block"] in GAIT_BLOCKS]
    rows = [row for row in rows if row.truth["block"] not in GAIT_BLOCKS]
    by = {block: [r for r in rows if r.truth["block"] == block] for block in {r.truth["block"] for r in rows}}

    def of(*blocks: str) -> list[DatasetResult]:
        return [row for block in blocks for row in by.get(block, ())]

    alone = [row for row in of("single", "instrument") if row.truth["size"] >= MIN_RELEVANT_SIZE]
    ambiguous = [row for row in rows if row.verdict["verdict"] == "ambiguous" and list_hidden_effects(row.truth)]
    known = [row for row in ambiguous if not row.truth.get("deleted") and not row.truth["strangers"]]
    judged = [row for row in rows if row.truth["block"] not in ("wrong_form", "outside", "repeats")]
    numbers = list(iter_parameter_intervals(rows))
    gaps = [share for row in rows if row.outcome == "right" and (share := removed_gap_fraction(row)) is not None]
    other = [share for row in of("wrong_form") if (share := removed_gap_fraction(row)) is not None]
    errors = [each.relative_error for each in numbers]
    return [
        _fraction_metric("first name right, effect at least as large as the noise", alone, _is_first_right, 0.95),
        _fraction_metric("exact set, singles at least as large as the noise", alone, _is_right, 0.90),
        _fraction_metric("exact set, pairs", of("pair"), _is_right, 0.85),
        _fraction_metric("exact set, triples", of("triple"), _is_right, None),
        _fraction_metric(
            "false alarms on clean data", of("clean"), lambda r: r.outcome == "false-alarm", 0.0, at_most=True
        ),
        _fraction_metric("wrong name, at any size", judged, lambda r: r.outcome in WRONG_OUTCOMES, 0.02, at_most=True),
        _fraction_metric(
            "in no catalogue: flagged, or nothing left to flag",
            of("outside"),
            lambda r: r.outcome in ("flagged", "absorbed"),
            0.95,
        ),
        _fraction_metric("instrument taken for physics or back", judged, _is_kind_confused, 0.02, at_most=True),
        _quantile_metric("error of a number, median", errors, 0.5, 0.03, at_most=True),
        _quantile_metric("error of a number, 90th percentile", errors, 0.9, 0.15, at_most=True),
        _coverage_metric(numbers),
        _quantile_metric("gap above the floor removed on unseen trials, named, median", gaps, 0.5, 0.95),
        _quantile_metric("gap above the floor removed on unseen trials, wrong form, median", other, 0.5, 0.85),
        _fraction_metric(
            "rival sets contain the truth",
            known,
            lambda r: list_hidden_effects(r.truth) in list_effect_sets(r.verdict),
            0.98,
        ),
        _fraction_metric(
            "resolved by the experiment that was asked for",
            _select_decisive(known),
            lambda r: r.second_outcome == "right",
            0.90,
        ),
        _quantile_metric("seconds for a dataset, median", [row.verdict["s"] for row in rows], 0.5, 30.0, at_most=True),
        *(_compute_gait_metrics(walked) if walked else ()),
    ]


def _compute_gait_metrics(rows: Sequence[DatasetResult]) -> list[Metric]:
    """The same questions and targets, of the gait rig; but a dataset may take two minutes."""
    there = [row for row in rows if list_hidden_effects(row.truth) and row.truth["size"] >= MIN_RELEVANT_SIZE]
    clean, numbers = [row for row in rows if not list_hidden_effects(row.truth)], list(iter_parameter_intervals(rows))
    errors = [each.relative_error for each in numbers]
    seconds = [row.verdict["s"] for row in rows]
    gaps = [share for row in there if row.outcome == "right" and (share := removed_gap_fraction(row)) is not None]
    return [
        _fraction_metric(
            "walks: first name right, effect at least as large as the noise", there, _is_first_right, 0.95
        ),
        _fraction_metric("walks: exact set, effect at least as large as the noise", there, _is_right, 0.90),
        _fraction_metric(
            "walks: false alarms on clean data", clean, lambda r: r.outcome == "false-alarm", 0.0, at_most=True
        ),
        _fraction_metric(
            "walks: wrong name, at any size", rows, lambda r: r.outcome in WRONG_OUTCOMES, 0.02, at_most=True
        ),
        _fraction_metric("walks: instrument taken for the rest or back", rows, _is_kind_confused, 0.02, at_most=True),
        _quantile_metric("walks: error of a number, median", errors, 0.5, 0.03, at_most=True),
        _quantile_metric("walks: error of a number, 90th percentile", errors, 0.9, 0.15, at_most=True),
        _coverage_metric(numbers, "walks: 95 % intervals that cover the truth"),
        _quantile_metric("walks: gap above the floor removed on unseen trials, median", gaps, 0.5, 0.95),
        _quantile_metric("walks: seconds for a dataset, median", seconds, 0.5, 120.0, at_most=True),
    ]


def _is_first_right(row: DatasetResult) -> bool:
    return is_first_right(row.truth, row.verdict)


def _is_right(row: DatasetResult) -> bool:
    return row.outcome == "right"


def _is_kind_confused(row: DatasetResult) -> bool:
    return are_kinds_confused(row.truth, row.verdict)


def _select_decisive(rows: Iterable[DatasetResult]) -> list[DatasetResult]:
    """Where the program promised that the experiment would decide; of some rivals it says that none does."""
    return [
        r
        for r in rows
        if r.second_outcome is not None and r.verdict["next_experiment"]["separation_chi2"] >= MIN_DECISIVE_CHI2
    ]


def _fraction_metric(
    name: str,
    rows: Sequence[DatasetResult],
    predicate: Callable[[DatasetResult], bool],
    target: float | None,
    *,
    at_most: bool = False,
) -> Metric:
    words = "" if target is None else (f"at most {100 * target:g} %" if at_most else f"at least {100 * target:g} %")
    if not rows:
        return Metric(name, None, 0, words, None)
    count = sum(map(predicate, rows))
    value, around = count / len(rows), binomtest(count, len(rows)).proportion_ci(method="wilson")
    met = None if target is None else (value <= target if at_most else value >= target)
    return Metric(name, value, len(rows), words, met, around.low, around.high)


def _quantile_metric(
    name: str, values: Sequence[float], quantile: float, target: float, *, at_most: bool = False
) -> Metric:
    words = f"{'at most' if at_most else 'at least'} {target:g}"
    if len(values) < 2:
        return Metric(name, None, len(values), words, None)
    value = statistics.quantiles(values, n=100, method="inclusive")[round(100 * quantile) - 1]
    return Metric(name, value, len(values), words, value <= target if at_most else value >= target)


def _coverage_metric(
    parameter_intervals: Sequence[ParameterInterval], name: str = "95 % intervals that cover the truth"
) -> Metric:
    words = "90 to 98 %"
    if not parameter_intervals:
        return Metric(name, None, 0, words, None)
    count = sum(each.is_covered for each in parameter_intervals)
    value, around = (
        count / len(parameter_intervals),
        binomtest(count, len(parameter_intervals)).proportion_ci(method="wilson"),
    )
    return Metric(name, value, len(parameter_intervals), words, 0.90 <= value <= 0.98, around.low, around.high)


def iter_parameter_intervals(rows: Iterable[DatasetResult]) -> Iterator[ParameterInterval]:
    """Of every effect that was named in the form it was hidden in, where nothing else was named."""
    for row in rows:
        if row.outcome != "right" or row.verdict["verdict"] != "named":
            continue
        for true in [*row.truth["effects"], *row.truth["instruments"]]:
            found = next(e for e in row.verdict["effects"] if _is_same_effect(e, true))
            if len(found["parameters"]) != len(true["parameters"]) or not _is_same_form(found, true):
                continue
            forms = instrument_forms(true["channel"]) if true.get("channel") else EFFECTS | BODY_EFFECTS
            own = forms[true["name"], true["form"]]
            values = zip(found["parameters"].items(), true["parameters"].items(), strict=True)
            for (_, told), (key, value) in values:  # a fault's numbers are called otherwise there
                neutral = own[key].neutral or 0.0
                error = abs(told["value"] - value) / abs(value - neutral)
                yield ParameterInterval(f"{true['name']}.{key}", value, error, told["low"] <= value <= told["high"])


def _is_same_effect(reported: Mapping[str, Any], true: Mapping[str, Any]) -> bool:
    return reported["name"] == true["name"] and reported["channel"] == true.get("channel")


def _is_same_form(reported: Mapping[str, Any], true: Mapping[str, Any]) -> bool:
    return bool(true.get("channel")) or reported["form"] == true["form"]


def removed_gap_fraction(row: DatasetResult) -> float | None:
    """Of the channel that a refit leaves worst: the share of its gap above the floor that was removed.

    Channels are in the scale of their noise. None where a refit leaves next to nothing.
    """
    gaps = [gap for gap in row.verdict.get("gap", {}).values() if gap["floor"]]
    if not gaps or residual_over_noise(row.verdict) < MIN_RELEVANT_SIZE:
        return None
    gap = max(gaps, key=lambda each: each["before"] / each["floor"])
    return float((gap["before"] - gap["after"]) / (gap["before"] - gap["floor"]))


def tabulate_power(rows: Iterable[DatasetResult]) -> dict[str, dict[float, str]]:
    """Effect -> size that was wanted -> what became of it."""
    found: dict[str, dict[float, str]] = {}
    for row in rows:
        for one in [*row.truth["effects"], *row.truth["instruments"]]:
            if row.truth["block"] in ("single", "instrument", "walk"):
                name = f"{one['name']} of {one['channel']}" if one.get("channel") else f"{one['name']}, {one['form']}"
                found.setdefault(name, {})[row.truth["size"]] = row.outcome
    return found


def tabulate_confusion(rows: Iterable[DatasetResult]) -> dict[str, dict[str, int]]:
    """What is hidden -> what was told -> how often; of single effects and faults."""
    found: dict[str, dict[str, int]] = {}
    for row in rows:
        true = list_hidden_effects(row.truth)
        if len(true) == 1 and row.truth["block"] in ("single", "instrument", "twin", "walk"):
            told = " or ".join(" and ".join(each) for each in list_effect_sets(row.verdict))
            word = told if row.verdict["verdict"] in NAMING_VERDICTS else row.verdict["verdict"]
            own = found.setdefault(true[0], {})
            own[word] = own.get(word, 0) + 1
    return found
