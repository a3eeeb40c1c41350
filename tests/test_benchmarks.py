"""The benchmarks run, and their documentation speaks of what they measure."""

import json
import math
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_the_benchmark_runs_and_every_row_is_documented(tmp_path: Path) -> None:
    command = [sys.executable, ROOT / "benchmarks" / "speed.py", "--quick", "--json"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    page = (ROOT / "docs" / "speed.md").read_text("utf-8")
    assert len(found["ratios"]) >= 10
    for row in found["ratios"]:
        assert math.isfinite(row["ratio"])
        assert row["ratio"] > 0.0
        assert f"| {row['what'].strip()} | {row['against']} |" in page
    for what in found["memory_mib"]:
        assert f"| {what} |" in page
