"""Calibrate the probabilities of verdicts, and measure how reliable they are.

    python -m benchmarks.hidden_effects.calibrate OUT --seeds 1313 1515 1616 --write     # coefficients
    python -m benchmarks.hidden_effects.calibrate OUT --seeds 2121                       # reliability on another seed

OUT holds results of :mod:`benchmarks.hidden_effects.run`. An event is a name of a verdict, which is true if it is
hidden (an effect of all devices also if it is named on each of them), or the statement that nothing is missing, which
is true if nothing as large as the noise is hidden: less than that makes no difference to data. Coefficients are those
of a logistic regression with a normal prior, which few events hardly move.
"""

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from benchmarks.hidden_effects.archive import find_verdicts
from benchmarks.hidden_effects.metrics import MIN_RELEVANT_SIZE
from benchmarks.hidden_effects.score import format_effect, join_tendons, list_hidden_effects, residual_over_noise
from scipy.optimize import minimize
from scipy.stats import binomtest

from klute_sim.diagnosis import probability

EDGES = (0.0, 0.2, 0.5, 0.8, 0.9, 0.95, 1.0)
"""Edges of the bins of predicted probability."""
PRIOR_STD = 2.0
"""Standard deviation of the normal prior of each coefficient."""
MIN_COEFFICIENTS = {"names": (-np.inf, -np.inf, -np.inf, -np.inf, 0.0, -np.inf)}
"""Part -> lowest value of each coefficient: a name with a larger margin is no less probable."""
NO_DECISION_BLOCKS = ("defective",)
"""Blocks without a truth about effects."""


class Event(NamedTuple):
    """One statement of a verdict."""

    features: list[float]
    is_true: bool


def collect_events(rows: Sequence[tuple[Mapping[str, Any], Mapping[str, Any]]]) -> dict[str, list[Event]]:
    """Return the events of pairs of truth and verdict, by the part of the calibration they belong to."""
    events: dict[str, list[Event]] = {"names": [], "nothing_missing": []}
    for truth, verdict in rows:
        if verdict["verdict"] == "insufficient-data" or verdict.get("p_value") is None:
            continue
        hidden = [*list_hidden_effects(truth), *truth.get("present", ())]
        features = probability.list_nothing_features(verdict["verdict"], residual_over_noise(verdict))
        events["nothing_missing"].append(Event(features, not _hides_relevant_effect(truth)))
        names = list(map(format_effect, verdict["effects"]))
        false_names = set(join_tendons(names, hidden)) - set(hidden)
        for name, effect in zip(names, verdict["effects"], strict=True):
            if "evidence" in effect:
                features = probability.list_name_features(
                    verdict["verdict"], effect["evidence"]["margin"], residual_over_noise(verdict)
                )
                events["names"].append(Event(features, name not in false_names))
    return events


def _hides_relevant_effect(truth: Mapping[str, Any]) -> bool:
    """Return whether an effect as large as the noise, or an error of the law, is in the data of ``truth``."""
    is_relevant = bool(list_hidden_effects(truth)) and truth["size"] >= MIN_RELEVANT_SIZE
    return is_relevant or bool(truth.get("present")) or bool(truth.get("law_error"))


def fit_logistic(events: Sequence[Event], min_coefficients: Sequence[float] | None = None) -> list[float]:
    """Return the coefficients with the largest posterior probability, none below its lowest value."""
    features = np.array([event.features for event in events])
    signs = np.where([event.is_true for event in events], 1.0, -1.0)

    def negative_log_posterior(coefficients: np.ndarray) -> float:
        losses = np.logaddexp(0.0, -signs * (features @ coefficients))
        return float(losses.sum() + 0.5 * (coefficients @ coefficients) / PRIOR_STD**2)

    start = np.zeros(features.shape[1])
    bounds = None if min_coefficients is None else [(lowest, None) for lowest in min_coefficients]
    return [float(f"{c:.4g}") for c in minimize(negative_log_posterior, start, bounds=bounds).x]


def tabulate_reliability(coefficients: Sequence[float], events: Sequence[Event]) -> Iterator[str]:
    """Yield a row for each bin of predicted probability: mean prediction, observed fraction, Wilson interval, count."""
    predicted = np.array([probability.compute_logistic(coefficients, event.features) for event in events])
    is_true = np.array([event.is_true for event in events])
    yield "| predicted | mean | observed | 95 % interval | n |"
    yield "| --- | --- | --- | --- | --- |"
    for low, high in pairwise(EDGES):
        chosen = (predicted >= low) & ((predicted < high) | (high == EDGES[-1]))
        if chosen.any():
            count, n = int(is_true[chosen].sum()), int(chosen.sum())
            interval = binomtest(count, n).proportion_ci(method="wilson")
            yield (
                f"| {low:g} to {high:g} | {predicted[chosen].mean():.3f} | {count / n:.3f} "
                f"| {interval.low:.2f} to {interval.high:.2f} | {n} |"
            )
    brier = float(np.mean((predicted - is_true) ** 2)) if len(events) else float("nan")
    yield f"Brier score {brier:.4f} of {len(events)} events, {int(is_true.sum())} true."


def load_rows(folder: Path, seeds: Sequence[int]) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """Return truth and verdict of every dataset of ``seeds`` in ``folder``."""
    rows = []
    for name, file in find_verdicts(folder).items():
        if any(f"_{seed}_" in name for seed in seeds):
            truth = json.loads((folder / f"{name}.truth.json").read_text("utf-8"))
            if truth["block"] not in NO_DECISION_BLOCKS:
                rows.append((truth, json.loads(file.read_text("utf-8"))))
    return rows


def main() -> None:
    """Fit or evaluate the calibration and print the reliability."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of datasets and results")
    parser.add_argument("--seeds", type=int, nargs="+", required=True, help="seeds of the datasets")
    parser.add_argument("--write", action="store_true", help="fit the coefficients and write them into the package")
    arguments = parser.parse_args()
    words = f"seed{'s' * (len(arguments.seeds) > 1)} {', '.join(map(str, arguments.seeds))}"
    try:
        rows = load_rows(arguments.out, arguments.seeds)
    except ValueError as error:
        parser.error(str(error))
    if not rows:
        parser.error(f"{arguments.out / 'results'} has no verdict of {words}")
    events = collect_events(rows)
    if arguments.write:
        calibration = {part: fit_logistic(e, MIN_COEFFICIENTS.get(part)) for part, e in events.items()}
        source = {"benchmark": "hidden_effects", "seeds": arguments.seeds, "datasets": len(rows)}
        counts = {f"{part}_events": len(part_events) for part, part_events in events.items()}
        file = Path(probability.__file__).with_name(probability.CALIBRATION_FILE)
        file.write_text(json.dumps({**source, **counts, **calibration}, indent=1) + "\n", "utf-8")
        probability.load_calibration.cache_clear()
    for part, part_events in events.items():
        print(f"{part}, {len(rows)} datasets of {words}:")
        print("\n".join(tabulate_reliability(probability.load_calibration()[part], part_events)))


if __name__ == "__main__":
    main()
