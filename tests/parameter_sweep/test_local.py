"""Cases in worker processes: killed workers, blocked interrupts, and the end of the parent process."""

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
from tests.parameter_sweep.user_controllers import KillingController

pytestmark = pytest.mark.skipif(os.name == "nt", reason="POSIX signals")


def evaluate(cases: Iterable[GaitCase]) -> dict[str, CaseResult | None]:
    """Return the result of each of ``cases`` in two processes, by the name of its controller."""
    results = dict[str, CaseResult | None]()

    def on_result(case: GaitCase, result: CaseResult | None) -> None:
        assert case.controller_name not in results
        results[case.controller_name] = result

    with local.LocalRunner(2) as runner:
        runner.run(cases, on_result)
    return results


def make_plan(**controllers: PressureController) -> SweepPlan:
    return SweepPlan(devices={"a": load_device("klute-1-1-4-pair")}, controllers=controllers, strides=1, dt=1e-3)


@pytest.mark.slow
def test_killed_worker_is_retried_and_other_cases_are_unaffected(tmp_path: Path) -> None:
    plan = make_plan(
        off=create_off_controller(), killing=KillingController(str(tmp_path), 2), low=ConstantPressure(1e5)
    )
    results = evaluate(plan.iter_cases())
    assert len(list(tmp_path.iterdir())) == 2
    assert set(results) == {"off", "killing", "low"}
    assert results["killing"] == results["off"]
    assert results["off"] is not None
    assert results["off"].failure is None
    assert results["low"] is not None
    assert results["low"].failure is None


@pytest.mark.long
def test_case_whose_worker_is_killed_in_every_attempt_has_no_result(tmp_path: Path) -> None:
    plan = make_plan(killing=KillingController(str(tmp_path), 99), off=create_off_controller())
    results = evaluate(plan.iter_cases())
    assert len(list(tmp_path.iterdir())) == MAX_ATTEMPTS == 3
    assert results["killing"] is None
    assert results["off"] is not None


def test_processes_started_in_the_context_have_interrupts_blocked() -> None:
    code = "import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))"
    mask_before = signal.pthread_sigmask(signal.SIG_BLOCK, [])
    with local._block_interrupts():
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"
    assert signal.pthread_sigmask(signal.SIG_BLOCK, []) == mask_before


@pytest.mark.long
def test_workers_end_with_their_parent_even_if_it_is_killed(tmp_path: Path) -> None:
    code = (
        "from tests.parameter_sweep.user_controllers import HeartbeatController\n"
        "from klute_sim.device.device import load_device\n"
        "from klute_sim.parameter_sweep import local\n"
        "from klute_sim.parameter_sweep.plan import SweepPlan\n"
        "if __name__ == '__main__':\n"
        "    controllers = {'b': HeartbeatController('beat')}\n"
        "    plan = SweepPlan(devices={'a': load_device('klute-1-1-4-pair')}, controllers=controllers)\n"
        "    with local.LocalRunner(1) as runner:\n"
        "        runner.run(plan.iter_cases(), print)\n"
    )
    paths = os.pathsep.join([str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")])
    parent = subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path, env={**os.environ, "PYTHONPATH": paths})
    beat, deadline = tmp_path / "beat", time.monotonic() + 60.0
    while not beat.exists() and parent.poll() is None and time.monotonic() < deadline:
        time.sleep(0.05)
    parent.kill()
    parent.wait()
    assert beat.exists()
    time.sleep(1.0)  # the time of twenty beats
    last_beat = beat.read_text()
    time.sleep(0.5)
    assert beat.read_text() == last_beat
