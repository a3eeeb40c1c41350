"""Files that decode to very much are refused in one sentence before they are decoded."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.files.bombs import BOMBS

ROOT = Path(__file__).parents[2]
MAX_MEGABYTES = 500.0
"""Limit of the memory of a process that reads all bombs, one after the other, with all libraries loaded [MB]."""


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("bombs")
    for name, (write, _, _) in BOMBS.items():
        write(folder / name)
    process = subprocess.run(
        [sys.executable, "-m", "tests.files.bombs", str(folder)], cwd=ROOT, capture_output=True, text=True, check=True
    )
    content: dict[str, Any] = json.loads(process.stdout)
    return content


@pytest.mark.parametrize("name", BOMBS)
def test_bomb_is_refused_in_one_sentence(name: str, result: dict[str, Any]) -> None:
    sentence = result["sentences"][name]
    assert BOMBS[name][2] in sentence
    assert sentence.isprintable()


def test_bombs_need_little_memory(result: dict[str, Any]) -> None:
    assert result["megabytes"] < MAX_MEGABYTES
