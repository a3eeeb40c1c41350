"""Walks in processes of their own: killed ones, and what becomes of them when the first process ends."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from controllers import Deadly

from klute_sim.control.pressure import off
from klute_sim.device.files import load
from klute_sim.sweep import local
from klute_sim.sweep.plan import Combination, Plan
from klute_sim.sweep.runner import TRIES
from klute_sim.sweep.walk import Walked

pytestmark = pytest.mark.skipif(os.name == "nt", reason="POSIX signals")


def test_a_killed_process_costs_its_own_walk_alone_and_that_is_tried_again(tmp_path: Path) -> None:
    for name in ("once", "always"):
        (tmp_path / name).mkdir()
    once, always = Deadly(str(tmp_path / "once"), 1), Deadly(str(tmp_path / "always"), 99)
    plan = Plan(
        devices={"a": load("klute-1-1-4-pair")},
        controllers={"always": always, "once": once, "off": off()},
        masses=(60.0, 75.0),
        strides=1,
        step=1e-3,
    )
    # The deadly ones on one mass only, so that every process but theirs has something to lose.
    some = [c for c in plan.combinations() if c.controller_word == "off" or c.mass == 60.0]
    told = dict[tuple[str, float], Walked | None]()

    def finished(combination: Combination, walked: Walked | None) -> None:
        told[combination.controller_word, combination.mass] = walked

    with local.Processes(2) as processes:
        processes.run(some, finished)
    assert len(told) == 4
    assert told["always", 60.0] is None
    assert len(list((tmp_path / "always").iterdir())) == TRIES == 3
    assert len(list((tmp_path / "once").iterdir())) == 1
    assert told["once", 60.0] == told["off", 60.0]
    assert told["off", 75.0] is not None
    assert told["off", 75.0].failure is None


@pytest.mark.long
def test_processes_end_with_the_first_one_even_if_that_is_killed(tmp_path: Path) -> None:
    code = (
        "from controllers import Beating\n"
        "from klute_sim.device.files import load\n"
        "from klute_sim.sweep import local\n"
        "from klute_sim.sweep.plan import Plan\n"
        "if __name__ == '__main__':\n"
        "    plan = Plan(devices={'a': load('klute-1-1-4-pair')}, controllers={'b': Beating('beat')})\n"
        "    with local.Processes(1) as processes:\n"
        "        processes.run(plan.combinations(), print)\n"
    )
    paths = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    first = subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path, env={**os.environ, "PYTHONPATH": paths})
    beat, patience = tmp_path / "beat", time.monotonic() + 60.0
    while not beat.exists() and first.poll() is None and time.monotonic() < patience:
        time.sleep(0.05)
    first.kill()
    first.wait()
    assert beat.exists()
    time.sleep(1.0)  # twenty beats
    last = beat.read_text()
    time.sleep(0.5)
    assert beat.read_text() == last
