"""Run the cases of a plan and keep their results in a store, so that an interrupted sweep can be resumed."""

from collections.abc import Callable, Sequence

from klute_sim.parameter_sweep import table
from klute_sim.parameter_sweep.evaluate import Case, CaseResult
from klute_sim.parameter_sweep.runner import Runner
from klute_sim.parameter_sweep.store import ResultStore


def run_sweep(
    plan: table.AnyPlan,
    store: ResultStore,
    runner: Runner,
    progress: Callable[[float], None] = lambda fraction: None,
) -> tuple[list[table.SweepRow], int]:
    """Simulate the cases of ``plan`` that ``store`` lacks.

    Returns the rows in the order of the plan, and the number of cases whose results were in the store already.
    ``progress`` receives the completed fraction.
    """
    cases: list[Case] = list(plan.iter_cases())
    results, n_resumed = run_cases(cases, store, runner, progress)
    return [table.build_row(case, result) for case, result in zip(cases, results, strict=True)], n_resumed


def run_cases(
    cases: Sequence[Case],
    store: ResultStore,
    runner: Runner,
    progress: Callable[[float], None] = lambda fraction: None,
) -> tuple[list[CaseResult | None], int]:
    """Return the result of each of ``cases``, and the number of results that ``store`` held already.

    A result is None when the process of its case was killed in every attempt. Each result is in the store before the
    next case is reported, so that an interrupt costs only the cases in progress. Cases that differ only in names are
    simulated once.
    """
    case_of_key = {case.key: case for case in cases}
    results = {key: result for key in case_of_key if (result := store.get(key))}
    n_resumed = len(results)
    n_lost = 0

    def on_result(case: Case, result: CaseResult | None) -> None:
        nonlocal n_lost
        if result is None:
            n_lost += 1  # not stored: the machine may be the cause, and the same command tries again
        else:
            store.put(case.key, result)
            results[case.key] = result
        progress((len(results) + n_lost) / len(case_of_key))

    progress(n_resumed / len(case_of_key))
    missing = [case for key, case in case_of_key.items() if key not in results]
    if missing:
        runner(missing, on_result)
    return [results.get(case.key) for case in cases], n_resumed
