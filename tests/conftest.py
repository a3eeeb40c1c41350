"""Settings of all tests: no time limit for examples of hypothesis, and the longest files first.

A busy machine must not fail a test, and no worker should start a long file last.
"""

import hypothesis
import pytest

hypothesis.settings.register_profile("no-deadline", deadline=None)
hypothesis.settings.load_profile("no-deadline")

LONGEST = ("test_docs.py", "test_diagnosis.py", "test_reproduce_command.py", "test_effects.py", "test_gait_command.py")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: LONGEST.index(item.path.name) if item.path.name in LONGEST else len(LONGEST))
