"""Walks in processes of their own: killed ones, and what becomes of them when the first process ends."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path

import pytest

from klute_sim.controllers.pressure import ConstantPressure, PressureController, create_off_controller
from klute_sim.device.device import load_device
from klute_sim.parameter_sweep import local
from klute_sim.parameter_sweep.evaluate import CaseResult
from klute_sim.parameter_sweep.plan import GaitCase, SweepPlan
from klute_sim.parameter_sweep.runner import MAX_ATTEMPTS
from tests.parameter_sweep.user_controllers import Deadly

pytestmark = pytest.mark.skipif(os.name == "nt", reason="POSIX signals")


def walked(combinations: Iterable[GaitCase]) -> dict[str, CaseResult | None]:
    """What becomes of ``combinations`` in two processes, by their controller's word."""
    told = dict[str, CaseResult | None]()

    def finished(combination: GaitCase, result: CaseResult | None) -> None:
        assert combination.controller_name not in told
        told[combination.controller_name] = result

    with local.LocalRunner(2) as processes:
        processes.run(combinations, finished)
    return told


def plan(**controllers: PressureController) -> SweepPlan:
    return SweepPlan(devices={"a": load_device("klute-1-1-4-pair")}, controllers=controllers, strides=1, dt=1e-3)


def test_a_killed_process_costs_its_own_walk_alone_and_that_is_tried_again(tmp_path: Path) -> None:
    told = walked(
        plan(off=create_off_controller(), deadly=Deadly(str(tmp_path), 2), low=ConstantPressure(1e5)).iter_cases()
    )
    assert len(list(tmp_path.iterdir())) == 2
    assert set(told) == {"off", "deadly", "low"}
    assert told["deadly"] == told["off"]
    assert told["off"] is not None
    assert told["off"].failure is None
    assert told["low"] is not None
    assert told["low"].failure is None


@pytest.mark.long
def test_a_walk_whose_process_is_killed_every_time_is_given_up(tmp_path: Path) -> None:
    told = walked(plan(deadly=Deadly(str(tmp_path), 99), off=create_off_controller()).iter_cases())
    assert len(list(tmp_path.iterdir())) == MAX_ATTEMPTS == 3
    assert told["deadly"] is None
    assert told["off"] is not None


def test_a_process_begun_while_interrupts_are_held_never_hears_of_them() -> None:
    asks = "import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))"
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [])
    with local._block_interrupts():
        held = subprocess.run([sys.executable, "-c", asks], capture_output=True, text=True, check=True)
    assert held.stdout == "True\n"
    assert signal.pthread_sigmask(signal.SIG_BLOCK, []) == before


@pytest.mark.long
def test_processes_end_with_the_first_one_even_if_that_is_killed(tmp_path: Path) -> None:
    code = (
        "from controllers import Beating\n"
        "from klute_sim.device.device import load\n"
        "from klute_sim.parameter_sweep import local\n"
        "from klute_sim.parameter_sweep.plan import Plan\n"
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
