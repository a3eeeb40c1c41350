"""Settings of all tests: repeatable examples of hypothesis without a time limit, and the order of the files.

A busy machine must not fail a test, and a change must not fail by examples that only its run drew;
``--hypothesis-profile random`` draws new examples. One worker builds the compiled code first, which takes a minute of a
fresh machine; the others meanwhile run folders that need hardly any, and then find it on disk.
"""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import hypothesis
import pytest

hypothesis.settings.register_profile("repeatable", deadline=None, derandomize=True)
hypothesis.settings.register_profile("random", deadline=None)
hypothesis.settings.load_profile("repeatable")

FIRST_FILE = "device/test_compilation.py"
FOLDERS_WITHOUT_COMPILATION = ("laws", "sizing", "comparison", "controllers", "recording", "mocap", "plausibility")
"""Folders whose tests compile nothing; of the last two, three files do, which run late enough."""
TESTS = Path(__file__).parent


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    def rank(item: pytest.Item) -> int:
        file = item.path.relative_to(TESTS)
        if file.as_posix() == FIRST_FILE:
            return -1
        folders = FOLDERS_WITHOUT_COMPILATION
        return folders.index(file.parts[0]) if file.parts[0] in folders else len(folders)

    items.sort(key=rank)


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
