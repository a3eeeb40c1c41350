"""A sweep from its plan to its table."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from klute_sim.parameter_sweep import table
from klute_sim.parameter_sweep.evaluate import CaseResult
from klute_sim.parameter_sweep.plan import GaitCase, SweepPlan
from klute_sim.parameter_sweep.runner import Runner
from klute_sim.parameter_sweep.store import ResultStore


@dataclass(frozen=True)
class SweepResult:
    """A sweep that is done."""

    rows: list[table.SweepRow]
    """In the order of the plan."""
    n_resumed: int
    """How many walks were there from before."""

    @property
    def n_failed(self) -> int:
        """How many combinations have a reason in place of outcomes."""
        return sum(row[table.FAILURE_COLUMN] is not None for row in self.rows)


def run_sweep(
    plan: SweepPlan, store: ResultStore, runner: Runner, progress: Callable[[float], None] = lambda fraction: None
) -> SweepResult:
    """Walk what ``store`` lacks of ``plan`` by ``runner``; ``progress`` is told the finished fraction."""
    everything = list(plan.iter_cases())
    walked, kept = run_cases(everything, store, runner, progress)
    return SweepResult([table.build_row(each, found) for each, found in zip(everything, walked, strict=True)], kept)


def run_cases(
    cases: Sequence[GaitCase],
    store: ResultStore,
    runner: Runner,
    progress: Callable[[float], None] = lambda fraction: None,
) -> tuple[list[CaseResult | None], int]:
    """What became of each of ``everything``, and how many of them ``store`` had; None: its process was killed.

    Every walk is in the store before the next is told, so that whatever ends this costs only what was under way.
    Combinations that are the same under two names are walked once.
    """
    keys = {combination.key: combination for combination in cases}
    walked = {key: found for key in keys if (found := store.get(key))}
    kept = len(walked)
    lost = 0

    def finished(combination: GaitCase, result: CaseResult | None) -> None:
        nonlocal lost
        if result is None:
            lost += 1  # not kept: it may have been the machine's fault, and the same command tries it again
        else:
            store.put(combination.key, result)
            walked[combination.key] = result
        progress((len(walked) + lost) / len(keys))

    progress(kept / len(keys))
    missing = [combination for key, combination in keys.items() if key not in walked]
    if missing:
        runner(missing, finished)
    return [walked.get(each.key) for each in cases], kept
