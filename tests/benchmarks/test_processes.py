"""A sample of the campaign that kills commands at random moments (benchmarks/robustness/processes.py)."""

import random
import signal
from pathlib import Path

import pytest
from benchmarks.robustness.commands import COMMANDS
from benchmarks.robustness.processes import run_campaign

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="POSIX signals")


@pytest.mark.parametrize(
    ("command", "number"),
    [
        pytest.param("plan", "SIGKILL", marks=pytest.mark.slow),
        pytest.param("gait", "SIGKILL", marks=pytest.mark.slow),
        pytest.param("gait", "SIGTERM", marks=pytest.mark.slow),
        pytest.param("sweep", "SIGKILL", marks=pytest.mark.slow),
        pytest.param("sweep", "SIGHUP", marks=pytest.mark.slow),
        pytest.param("import", "SIGKILL", marks=pytest.mark.slow),
        pytest.param("tune", "SIGKILL", marks=pytest.mark.long),
        pytest.param("diagnose", "SIGKILL", marks=pytest.mark.long),
    ],
)
def test_killed_command_succeeds_when_it_is_given_again(command: str, number: str, tmp_path: Path) -> None:
    count = run_campaign(COMMANDS[command], 2, signal.Signals[number], random.Random(1), tmp_path)
    assert count.is_clean, count.remarks
    assert count.kills == count.succeeded + count.complete == 2
