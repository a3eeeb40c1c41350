"""Test that the speed benchmark runs and that its documentation lists every measurement."""

import json
import math
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.slow
def test_benchmark_runs_and_is_documented(tmp_path: Path) -> None:
    command = [sys.executable, ROOT / "benchmarks" / "speed.py", "--quick", "--json"]
    completed = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert completed.returncode == 0, completed.stderr
    result = json.loads(completed.stdout)
    page = (ROOT / "docs" / "speed.md").read_text("utf-8")
    assert len(result["ratios"]) >= 10
    for row in result["ratios"]:
        assert math.isfinite(row["ratio"])
        assert row["ratio"] > 0.0
        assert f"| {row['what'].strip()} | {row['against']} |" in page
    for label in result["memory_mib"]:
        assert f"| {label} |" in page
