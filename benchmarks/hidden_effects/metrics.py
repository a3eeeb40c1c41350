"""Metrics of the benchmark results against their targets."""

import statistics
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from benchmarks.hidden_effects.catalogue import BODY_EFFECTS, EFFECTS, JOINT_EFFECTS, instrument_forms
from benchmarks.hidden_effects.plan import ADVERSARY_BLOCK, GAIT_BLOCKS, JOINT_BLOCKS
from benchmarks.hidden_effects.score import (
    NAMING_VERDICTS,
    WRONG_OUTCOMES,
    Truth,
    Verdict,
    are_kinds_confused,
    is_absorbed,
    is_first_right,
    is_out_of_catalogue,
    is_wrong_alone,
    list_effect_sets,
    list_hidden_effects,
    residual_over_noise,
)
from scipy.stats import binomtest

MIN_RELEVANT_SIZE = 1.0
"""Size over the noise from which an effect should be identified."""


UNSCORED_BLOCKS = ("wrong_form", "outside", "faint_outside", "repeats", "imperfect")
"""Blocks that are not in the metrics of all effects."""
MIN_DECISIVE_CHI2 = 6.0
"""Chi squared that a proposed experiment must promise, as the program itself states."""


class DatasetResult(NamedTuple):
    """A dataset, its verdict and its score."""

    name: str
    truth: Truth
    verdict: Verdict
    outcome: str
    second_outcome: str | None = None
    """Score of an `indistinguishable` verdict after the proposed experiment."""


class Metric(NamedTuple):
    """A value with its basis and its target."""

    name: str
    value: float | None
    """Value; None without data."""
    n: int
    """Number of datasets or values."""
    target: str
    met: bool | None
    low: float | None = None
    """Lower end of the 95 % interval of a fraction (Wilson)."""
    high: float | None = None


class ParameterInterval(NamedTuple):
    """One parameter of a correctly identified effect."""

    key: str
    relative_error: float
    """Error relative to the distance from neutral."""
    is_covered: bool


def compute_metrics(rows: Sequence[DatasetResult]) -> list[Metric]:
    """Return all metrics in the order of the table of targets."""
    gait_rows = [row for row in rows if row.truth["block"] in GAIT_BLOCKS]
    joint_rows = [row for row in rows if row.truth["block"] in JOINT_BLOCKS]
    adversary_rows = [row for row in rows if row.truth["block"] == ADVERSARY_BLOCK]
    rows = [row for row in rows if row.truth["block"] not in (*GAIT_BLOCKS, *JOINT_BLOCKS, ADVERSARY_BLOCK)]
    rows_by_block = {
        block: [r for r in rows if r.truth["block"] == block] for block in {r.truth["block"] for r in rows}
    }

    def rows_of(*blocks: str) -> list[DatasetResult]:
        return [row for block in blocks for row in rows_by_block.get(block, ())]

    single = [row for row in rows_of("single", "instrument") if row.truth["size"] >= MIN_RELEVANT_SIZE]
    catalogued = _select_catalogued(rows)
    scored = [row for row in rows if row.truth["block"] not in UNSCORED_BLOCKS]
    parameter_intervals = list(iter_parameter_intervals(row for row in rows if row.truth["block"] != "imperfect"))
    identified = [
        row for row in _select_hidden(rows) if row.outcome == "right" and row.verdict["verdict"] in NAMING_VERDICTS
    ]
    gaps = [fraction for row in identified if (fraction := removed_gap_fraction(row)) is not None]
    other_gaps = [fraction for row in rows_of("wrong_form") if (fraction := removed_gap_fraction(row)) is not None]
    errors = [interval.relative_error for interval in parameter_intervals]
    times = [row.verdict["cpu_s"] for row in (*rows, *adversary_rows)]
    return [
        _fraction_metric("first name right, effect at least as large as the noise", single, _is_first_right, 0.95),
        _fraction_metric("exact set, singles at least as large as the noise", single, _is_right, 0.90),
        _fraction_metric("exact set, pairs", rows_of("pair"), _is_right, 0.85),
        _fraction_metric("exact set, triples", rows_of("triple"), _is_right, None),
        _fraction_metric(
            "false alarms on clean data", rows_of("clean"), lambda r: r.outcome == "false-alarm", 0.0, at_most=True
        ),
        _fraction_metric("wrong name, at any size", scored, _is_wrong, 0.02, at_most=True),
        _fraction_metric(
            "wrong name, all blocks of the bench", [*rows, *adversary_rows], _is_wrong, 0.02, at_most=True
        ),
        _fraction_metric(
            "outside the catalogue: flagged, or nothing left to flag",
            rows_of("outside"),
            lambda r: r.outcome in ("flagged", "absorbed"),
            0.97,
        ),
        _fraction_metric("instrument confused with physics", scored, _is_kind_confused, 0.02, at_most=True),
        _quantile_metric("relative error of a parameter, median", errors, 0.5, 0.03, at_most=True),
        _quantile_metric("relative error of a parameter, 90th percentile", errors, 0.9, 0.12, at_most=True),
        _coverage_metric(parameter_intervals, "95 % intervals that cover the truth", (0.93, 0.97)),
        _quantile_metric("misfit above the noise removed on test trials, identified, median", gaps, 0.5, 0.95),
        _quantile_metric("misfit above the noise removed on test trials, wrong form, median", other_gaps, 0.5, 0.85),
        _fraction_metric(
            "indistinguishable sets contain the truth",
            catalogued,
            _lists_truth,
            0.98,
        ),
        _fraction_metric(
            "resolved by the proposed measurement or experiment",
            _select_decisive(catalogued),
            _is_resolved,
            0.90,
        ),
        _fraction_metric("imperfect law: names right", _select_hidden(rows_of("imperfect")), _is_right, 0.90),
        _fraction_metric(
            "imperfect law: a name without an effect",
            [row for row in rows_of("imperfect") if not list_hidden_effects(row.truth)],
            lambda r: r.outcome == "false-alarm",
            0.05,
            at_most=True,
        ),
        _fraction_metric(
            "imperfect law: the recommended device is worse than refitted on test trials",
            rows_of("imperfect"),
            _is_worse_than_refitted,
            0.0,
            at_most=True,
        ),
        _coverage_metric(
            list(iter_parameter_intervals(rows_of("imperfect"))),
            "imperfect law: 95 % intervals that cover the truth",
            (0.90, 0.98),
        ),
        _fraction_metric(
            "outside the catalogue at 2 and 0.7 times the noise: a wrong name alone",
            [row for row in rows_of("faint_outside") if not is_absorbed(row.truth)],
            _is_wrong_alone,
            0.05,
            at_most=True,
        ),
        _fraction_metric(
            "a form outside the catalogue at 8, 2 and 0.7 times the noise: a wrong name alone",
            rows_of("wrong_form"),
            _is_wrong_alone,
            0.05,
            at_most=True,
        ),
        _fraction_metric(
            "wrong number: named, in the indistinguishable set, or without influence",
            rows_of("wrong_number"),
            lambda r: r.outcome in ("right", "loose", "absorbed"),
            0.90,
        ),
        _fraction_metric(
            "wrong number: a wrong name alone", rows_of("wrong_number"), _is_wrong_alone, 0.03, at_most=True
        ),
        _fraction_metric("slow, moving or noisy logs: nothing missing", rows_of("logging"), _is_right, 0.90),
        _quantile_metric("processor time of a dataset [s], median", times, 0.5, 20.0, at_most=True),
        _quantile_metric("processor time of a dataset [s], 90th percentile", times, 0.9, 90.0, at_most=True),
        *(_compute_gait_metrics(gait_rows) if gait_rows else ()),
        *(_compute_joint_metrics(joint_rows) if joint_rows else ()),
        *(_compute_adversary_metrics(adversary_rows) if adversary_rows else ()),
    ]


def _compute_adversary_metrics(rows: Sequence[DatasetResult]) -> list[Metric]:
    """Return the metrics of the datasets with another physics: what is named, whether or not there is a strong effect.

    Parameters cannot be compared, because they are those of other laws.
    """
    hidden = _select_hidden(rows)
    relevant = [row for row in hidden if row.truth["size"] >= MIN_RELEVANT_SIZE]
    return [
        _fraction_metric(
            "other physics: names right, effect at least as large as the noise", relevant, _is_right, 0.90
        ),
        _fraction_metric("other physics: a wrong name alone", hidden, _is_wrong_alone, 0.05, at_most=True),
        _fraction_metric(
            "other physics: a name without a strong effect",
            [row for row in rows if not list_hidden_effects(row.truth)],
            lambda r: r.outcome == "false-alarm",
            0.05,
            at_most=True,
        ),
    ]


def _compute_joint_metrics(rows: Sequence[DatasetResult]) -> list[Metric]:
    """Return the same metrics for datasets of a joint, which may take one minute each."""

    def rows_of(*blocks: str) -> list[DatasetResult]:
        return [row for row in rows if row.truth["block"] in blocks]

    relevant = [row for row in rows_of("joint") if row.truth["size"] >= MIN_RELEVANT_SIZE]
    named = rows_of("joint", "joint_clean", "joint_pair")
    parameter_intervals = list(iter_parameter_intervals(rows_of("joint", "joint_pair")))
    errors = [interval.relative_error for interval in parameter_intervals]
    catalogued = _select_catalogued(rows)
    return [
        _fraction_metric(
            "joints: first name right, effect at least as large as the noise", relevant, _is_first_right, 0.95
        ),
        _fraction_metric("joints: exact set, effect at least as large as the noise", relevant, _is_right, 0.90),
        _fraction_metric("joints: exact set, pairs", rows_of("joint_pair"), _is_right, 0.85),
        _fraction_metric(
            "joints: false alarms on clean data",
            rows_of("joint_clean"),
            lambda r: r.outcome == "false-alarm",
            0.0,
            at_most=True,
        ),
        _fraction_metric("joints: wrong name, at any size", named, _is_wrong, 0.02, at_most=True),
        _fraction_metric(
            "joints: outside the catalogue: flagged, or nothing left to flag",
            rows_of("joint_outside"),
            lambda r: r.outcome in ("flagged", "absorbed"),
            0.95,
        ),
        _fraction_metric("joints: instrument confused with physics", named, _is_kind_confused, 0.02, at_most=True),
        _fraction_metric("joints: indistinguishable sets contain the truth", catalogued, _lists_truth, 0.98),
        _fraction_metric(
            "joints: resolved by the proposed measurement or experiment",
            _select_decisive(catalogued),
            _is_resolved,
            0.90,
        ),
        _fraction_metric(
            "joints: imperfect law: names right", _select_hidden(rows_of("joint_imperfect")), _is_right, 0.90
        ),
        _fraction_metric(
            "joints: imperfect law: a name without an effect",
            [row for row in rows_of("joint_imperfect") if not list_hidden_effects(row.truth)],
            lambda r: r.outcome == "false-alarm",
            0.05,
            at_most=True,
        ),
        _quantile_metric("joints: relative error of a parameter, median", errors, 0.5, 0.03, at_most=True),
        _quantile_metric("joints: relative error of a parameter, 90th percentile", errors, 0.9, 0.15, at_most=True),
        _coverage_metric(parameter_intervals, "joints: 95 % intervals that cover the truth", (0.90, 0.98)),
        _quantile_metric(
            "joints: processor time of a dataset [s], median",
            [row.verdict["cpu_s"] for row in rows],
            0.5,
            60.0,
            at_most=True,
        ),
    ]


def _compute_gait_metrics(rows: Sequence[DatasetResult]) -> list[Metric]:
    """Return the same metrics for gait datasets, which may take two minutes each."""
    registration = [row for row in rows if row.truth["block"] == "walk_registration"]
    rows = [row for row in rows if row.truth["block"] != "walk_registration"]
    relevant = [row for row in rows if list_hidden_effects(row.truth) and row.truth["size"] >= MIN_RELEVANT_SIZE]
    clean, parameter_intervals = (
        [row for row in rows if not list_hidden_effects(row.truth)],
        list(iter_parameter_intervals(rows)),
    )
    errors = [interval.relative_error for interval in parameter_intervals]
    times = [row.verdict["cpu_s"] for row in rows]
    gaps = [
        fraction for row in relevant if row.outcome == "right" and (fraction := removed_gap_fraction(row)) is not None
    ]
    return [
        _fraction_metric(
            "walks: first name right, effect at least as large as the noise", relevant, _is_first_right, 0.97
        ),
        _fraction_metric("walks: exact set, effect at least as large as the noise", relevant, _is_right, 0.90),
        _fraction_metric(
            "walks: false alarms on clean data", clean, lambda r: r.outcome == "false-alarm", 0.0, at_most=True
        ),
        _fraction_metric("walks: wrong name, at any size", rows, _is_wrong, 0.02, at_most=True),
        _fraction_metric("walks: instrument confused with physics", rows, _is_kind_confused, 0.02, at_most=True),
        _quantile_metric("walks: relative error of a parameter, median", errors, 0.5, 0.03, at_most=True),
        _quantile_metric("walks: relative error of a parameter, 90th percentile", errors, 0.9, 0.15, at_most=True),
        _coverage_metric(parameter_intervals, "walks: 95 % intervals that cover the truth", (0.93, 0.97)),
        _quantile_metric("walks: misfit above the noise removed on test trials, median", gaps, 0.5, 0.95),
        _fraction_metric("walks: nothing missing where the registration is wrong", registration, _is_right, 0.90),
        _quantile_metric("walks: processor time of a dataset [s], median", times, 0.5, 120.0, at_most=True),
    ]


def _select_hidden(rows: Iterable[DatasetResult]) -> list[DatasetResult]:
    return [row for row in rows if list_hidden_effects(row.truth)]


def _is_worse_than_refitted(row: DatasetResult) -> bool:
    """Return whether the device that the verdict recommends misses the force of unseen trials by more."""
    gap = row.verdict.get("gap", {}).get("force")
    is_recommended = row.verdict.get("recommended") == "with-effects"
    return bool(gap) and is_recommended and gap["with_effects"] > 1.01 * gap["refitted"]


def _is_first_right(row: DatasetResult) -> bool:
    return is_first_right(row.truth, row.verdict)


def _is_right(row: DatasetResult) -> bool:
    return row.outcome == "right"


def _is_wrong(row: DatasetResult) -> bool:
    return row.outcome in WRONG_OUTCOMES


def _is_kind_confused(row: DatasetResult) -> bool:
    return are_kinds_confused(row.truth, row.verdict)


def _is_wrong_alone(row: DatasetResult) -> bool:
    return is_wrong_alone(row.outcome)


def _select_catalogued(rows: Iterable[DatasetResult]) -> list[DatasetResult]:
    """Return the `indistinguishable` results whose hidden effects the diagnosis may know."""
    return [
        row
        for row in _select_hidden(rows)
        if row.verdict["verdict"] == "indistinguishable" and not is_out_of_catalogue(row.truth)
    ]


def _lists_truth(row: DatasetResult) -> bool:
    return list_hidden_effects(row.truth) in list_effect_sets(row.verdict)


def _is_resolved(row: DatasetResult) -> bool:
    return row.second_outcome == "right"


def _select_decisive(rows: Iterable[DatasetResult]) -> list[DatasetResult]:
    """Return the results whose proposal was to be decisive and was made: a direct measurement, or an experiment.

    Verdicts that propose neither say that nothing decides, and are not in the row *resolved*.
    """
    return [
        r
        for r in rows
        if r.second_outcome is not None
        and (
            r.verdict.get("direct_measurements") or r.verdict["next_experiment"]["separation_chi2"] >= MIN_DECISIVE_CHI2
        )
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
    parameter_intervals: Sequence[ParameterInterval], name: str, target: tuple[float, float]
) -> Metric:
    lowest, highest = target
    words = f"{100 * lowest:g} to {100 * highest:g} %"
    if not parameter_intervals:
        return Metric(name, None, 0, words, None)
    count = sum(interval.is_covered for interval in parameter_intervals)
    value = count / len(parameter_intervals)
    around = binomtest(count, len(parameter_intervals)).proportion_ci(method="wilson")
    return Metric(name, value, len(parameter_intervals), words, lowest <= value <= highest, around.low, around.high)


def iter_parameter_intervals(rows: Iterable[DatasetResult]) -> Iterator[ParameterInterval]:
    """Yield the parameters of all effects that were identified in their hidden form and nothing else.

    A form that the catalogue did not contain when it was hidden has other parameters there, and is left out.
    """
    for row in rows:
        if row.outcome != "right" or row.verdict["verdict"] not in ("identified", "identified-in-part"):
            continue
        for true in [*row.truth["effects"], *row.truth["instruments"]]:
            reported = next(e for e in row.verdict["effects"] if _is_same_effect(e, true))
            if len(reported["parameters"]) != len(true["parameters"]) or not _is_same_form(reported, true):
                continue
            known = EFFECTS | BODY_EFFECTS | JOINT_EFFECTS
            forms = instrument_forms(true["channel"]) if true.get("channel") else known
            parameters = forms.get((true["name"], true["form"]))
            if parameters is None:
                continue
            values = zip(reported["parameters"].items(), true["parameters"].items(), strict=True)
            for (_, estimate), (key, value) in values:  # a fault's numbers are called otherwise there
                neutral = parameters[key].neutral or 0.0
                error = abs(estimate["value"] - value) / abs(value - neutral)
                yield ParameterInterval(f"{true['name']}.{key}", error, estimate["low"] <= value <= estimate["high"])


def _is_same_effect(reported: Mapping[str, Any], true: Mapping[str, Any]) -> bool:
    return reported["name"] == true["name"] and reported["channel"] == true.get("channel")


def _is_same_form(reported: Mapping[str, Any], true: Mapping[str, Any]) -> bool:
    return bool(true.get("channel")) or reported["form"] == true["form"]


def removed_gap_fraction(row: DatasetResult) -> float | None:
    """Return the fraction of the gap above the noise floor that was removed, in the worst channel after a refit.

    Channels are scaled by their noise. None where a refit leaves almost nothing.
    """
    gaps = [gap for gap in row.verdict.get("gap", {}).values() if gap["noise_floor"]]
    if not gaps or residual_over_noise(row.verdict) < MIN_RELEVANT_SIZE:
        return None
    gap = max(gaps, key=lambda channel_gap: channel_gap["refitted"] / channel_gap["noise_floor"])
    return float((gap["refitted"] - gap["with_effects"]) / (gap["refitted"] - gap["noise_floor"]))


def tabulate_coverage(rows: Iterable[DatasetResult]) -> dict[str, tuple[int, int]]:
    """Return block -> number of intervals that cover the truth, and of all."""
    counts: dict[str, tuple[int, int]] = {}
    for row in rows:
        for interval in iter_parameter_intervals([row]):
            covering, total = counts.get(row.truth["block"], (0, 0))
            counts[row.truth["block"]] = covering + interval.is_covered, total + 1
    return counts


def tabulate_power(rows: Iterable[DatasetResult]) -> dict[str, dict[float, str]]:
    """Return the outcome by effect and required size."""
    outcomes: dict[str, dict[float, str]] = {}
    for row in rows:
        for effect in [*row.truth["effects"], *row.truth["instruments"]]:
            if row.truth["block"] in ("single", "instrument", "walk"):
                name = (
                    f"{effect['name']} of {effect['channel']}"
                    if effect.get("channel")
                    else f"{effect['name']}, {effect['form']}"
                )
                outcomes.setdefault(name, {})[row.truth["size"]] = row.outcome
    return outcomes


def tabulate_confusion(rows: Iterable[DatasetResult]) -> dict[str, dict[str, int]]:
    """Return the number of reports by hidden and by reported effect, for single effects and faults."""
    counts: dict[str, dict[str, int]] = {}
    for row in rows:
        true = list_hidden_effects(row.truth)
        if len(true) == 1 and row.truth["block"] in ("single", "instrument", "twin", "walk"):
            reported = " or ".join(" and ".join(each) for each in list_effect_sets(row.verdict))
            label = reported if row.verdict["verdict"] in NAMING_VERDICTS else row.verdict["verdict"]
            hidden_counts = counts.setdefault(true[0], {})
            hidden_counts[label] = hidden_counts.get(label, 0) + 1
    return counts
