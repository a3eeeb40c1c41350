"""Order of the tests: the longest files first, so that no worker starts them last."""

import pytest

LONGEST = ("test_docs.py", "test_diagnosis.py", "test_reproduce_command.py", "test_effects.py", "test_gait_command.py")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: LONGEST.index(item.path.name) if item.path.name in LONGEST else len(LONGEST))
