"""Cases on a Ray cluster that consists of this machine alone."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.command_line import run

CODE = """
import json, sys
from tests.parameter_sweep.user_controllers import KillingController
from klute_sim.controllers.pressure import create_off_controller
from klute_sim.device.device import load_device
from klute_sim.parameter_sweep import cluster
from klute_sim.parameter_sweep.plan import SweepPlan

controllers = {
    "off": create_off_controller(),
    "once": KillingController(sys.argv[1], 1),
    "always": KillingController(sys.argv[2], 99),
}
plan = SweepPlan(devices={"a": load_device("klute-1-1-4-pair")}, controllers=controllers, strides=1, dt=1e-3)
results = {}
def on_result(case, result):
    results[case.controller_name] = result and [result.failure, dict(result.metrics)]
with cluster.connect("local") as ray:
    cluster.run_on_cluster(plan.iter_cases(), on_result, ray)
print(json.dumps(results))
"""
ROOT = Path(__file__).parents[2]


@pytest.mark.extras
@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_killed_worker_is_retried_and_other_cases_are_unaffected(tmp_path: Path) -> None:
    pytest.importorskip("ray")
    for name in ("once", "always"):
        (tmp_path / name).mkdir()
    paths = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-c", CODE, str(tmp_path / "once"), str(tmp_path / "always")]
    done = subprocess.run(
        command, env={**os.environ, "PYTHONPATH": paths}, capture_output=True, text=True, check=False, timeout=900
    )
    assert done.returncode == 0, done.stderr
    results = json.loads(done.stdout)  # without any output of Ray
    assert set(results) == {"off", "once", "always"}
    assert results["off"][0] is None
    assert results["once"] == results["off"]
    assert results["always"] is None
    assert len(list((tmp_path / "once").iterdir())) == 1
    assert len(list((tmp_path / "always").iterdir())) == 3


@pytest.mark.extras
def test_cluster_gives_the_same_table_as_local_processes(tmp_path: Path) -> None:
    pytest.importorskip("ray")
    arguments = ("--mass", "60,75", "--strides", "1", "--step", "1", "--json")
    local, cluster = (run("sweep", *arguments, *more, cwd=tmp_path) for more in (["--out", "a"], ["--ray", "local"]))
    assert local.returncode == cluster.returncode == 0, local.stderr + cluster.stderr
    assert json.loads(cluster.stdout)["rows"] == json.loads(local.stdout)["rows"]
    assert (tmp_path / "runs" / "sweep-001" / "sweep.parquet").read_bytes() == (
        tmp_path / "a" / "sweep.parquet"
    ).read_bytes()


@pytest.mark.extras
def test_cluster_adapts_a_walker_as_threads_do(tmp_path: Path) -> None:
    pytest.importorskip("ray")
    pytest.importorskip("cma")
    arguments = ("walk", "adapt", "--intact", "--evaluations", "16", "--sigma", "0.01")
    done = [run(*arguments, *more, cwd=tmp_path) for more in (["--out", "a"], ["--out", "b", "--ray", "local"])]
    assert [d.returncode for d in done] == [0, 0], done[0].stderr + done[1].stderr
    assert (tmp_path / "a" / "costs.csv").read_bytes() == (tmp_path / "b" / "costs.csv").read_bytes()


@pytest.mark.extras
@pytest.mark.parametrize("command", [("sweep",), ("walk", "adapt")])
@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("127.0.0.1:1", "no Ray cluster at '127.0.0.1:1': Connection refused"),
        ("here", "an address is HOST:PORT"),
    ],
)
def test_unreachable_address_is_refused_in_one_sentence(
    address: str, message: str, command: tuple[str, ...], tmp_path: Path
) -> None:
    pytest.importorskip("ray")
    done = run(*command, "--ray", address, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_missing_ray_is_named_as_optional_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    done = run("sweep", "--ray", "local", cwd=tmp_path)
    assert done.returncode == 2
    assert "a run on a cluster needs the optional extra 'ray': pip install '.[ray]'" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []
