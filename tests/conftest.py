"""Settings of all tests: repeatable examples of hypothesis without a time limit, and the longest files first.

A busy machine must not fail a test, a change must not fail by examples that only its run drew, and no worker should
start a long file last. ``--hypothesis-profile random`` draws new examples.
"""

from collections.abc import Callable, Iterable
from typing import Any

import hypothesis
import pytest

hypothesis.settings.register_profile("repeatable", deadline=None, derandomize=True)
hypothesis.settings.register_profile("random", deadline=None)
hypothesis.settings.load_profile("repeatable")

LONGEST = ("test_docs.py", "test_diagnosis.py", "test_reproduce_command.py", "test_effects.py", "test_gait_command.py")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: LONGEST.index(item.path.name) if item.path.name in LONGEST else len(LONGEST))


@pytest.fixture
def in_process_runner(monkeypatch: pytest.MonkeyPatch) -> None:
    """Evaluate the cases of a sweep in the process of the test: a worker takes longer to start than a few cases.

    tests/parameter_sweep and the tests of ``klute-sim sweep`` run the workers themselves.
    """
    from klute_sim.parameter_sweep.evaluate import evaluate_case
    from klute_sim.parameter_sweep.local import LocalRunner

    def run(_: LocalRunner, cases: Iterable[Any], on_result: Callable[..., None]) -> None:
        for case in cases:
            on_result(case, evaluate_case(case))

    monkeypatch.setattr(LocalRunner, "run", run)
