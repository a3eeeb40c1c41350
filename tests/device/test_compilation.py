"""Every compiled function is built once and lies on disk for all other processes.

This file runs first: other workers find the machine code on disk instead of building it again (``tests/conftest.py``).
"""

import subprocess
import sys
from pathlib import Path
from typing import Any

from klute_sim.device import batch_outputs, recorded_rollout, rollout
from klute_sim.gait.replay import rollout as gait_replay
from klute_sim.plant import compiled_callbacks
from klute_sim.walker.simulation import backend

ROOT = Path(__file__).parents[2]
COUNT_BUILDS = (
    "from tests.device.test_compilation import load_all\n"
    "print(sum(function.stats.cache_misses.total() for function in load_all()))"
)


def load_all() -> list[Any]:
    """Build or load every compiled function; return those that count what they build."""
    compiled_callbacks.get_callbacks()
    backend.get_step_functions("compiled")
    return [
        recorded_rollout._compile_integrate(),
        rollout._compile_integrate(),
        batch_outputs._compile_evaluate_batch(),
        gait_replay._compile_integrate(),
    ]


def test_new_process_builds_nothing() -> None:
    for function in load_all():
        assert function.nopython_signatures
    completed = subprocess.run(
        [sys.executable, "-c", COUNT_BUILDS], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert int(completed.stdout) == 0
