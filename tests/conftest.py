"""The longest files first: a worker that gets one of them last would let the others wait."""

import pytest

LONGEST = ("test_docs.py", "test_diagnosis.py", "test_reproduce_command.py", "test_effects.py", "test_gait_command.py")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: LONGEST.index(item.path.name) if item.path.name in LONGEST else len(LONGEST))
