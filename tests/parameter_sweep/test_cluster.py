"""Walks by Ray, on a cluster of this machine alone."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.command_line import run

CODE = """
import json, sys
from tests.parameter_sweep.user_controllers import Deadly
from klute_sim.controllers.pressure import off
from klute_sim.device.device import load
from klute_sim.parameter_sweep import cluster
from klute_sim.parameter_sweep.plan import Plan

plan = Plan(
    devices={"a": load("klute-1-1-4-pair")},
    controllers={"off": off(), "once": Deadly(sys.argv[1], 1), "always": Deadly(sys.argv[2], 99)},
    strides=1,
    step=1e-3,
)
told = {}
def finished(combination, walked):
    told[combination.controller_word] = walked and [walked.failure, dict(walked.outcomes)]
with cluster.connected("local") as ray:
    cluster.run(plan.combinations(), finished, ray)
print(json.dumps(told))
"""


@pytest.mark.long
@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_a_worker_killed_in_a_walk_costs_nothing(tmp_path: Path) -> None:
    pytest.importorskip("ray")
    for name in ("once", "always"):
        (tmp_path / name).mkdir()
    paths = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-c", CODE, str(tmp_path / "once"), str(tmp_path / "always")]
    done = subprocess.run(
        command, env={**os.environ, "PYTHONPATH": paths}, capture_output=True, text=True, check=False, timeout=300
    )
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)  # and nothing of Ray's own
    assert set(told) == {"off", "once", "always"}
    assert told["off"][0] is None
    assert told["once"] == told["off"]
    assert told["always"] is None
    assert len(list((tmp_path / "once").iterdir())) == 1
    assert len(list((tmp_path / "always").iterdir())) == 3


@pytest.mark.long
def test_a_cluster_gives_the_table_of_the_cores(tmp_path: Path) -> None:
    pytest.importorskip("ray")
    asked = ("--mass", "60,75", "--strides", "1", "--step", "1", "--json")
    cores, cluster = (run("sweep", *asked, *more, cwd=tmp_path) for more in (["--out", "a"], ["--ray", "local"]))
    assert cores.returncode == cluster.returncode == 0, cores.stderr + cluster.stderr
    assert json.loads(cluster.stdout)["rows"] == json.loads(cores.stdout)["rows"]
    assert (tmp_path / "runs" / "sweep-001" / "sweep.parquet").read_bytes() == (
        tmp_path / "a" / "sweep.parquet"
    ).read_bytes()


@pytest.mark.parametrize(
    ("address", "says"),
    [
        ("127.0.0.1:1", "no Ray cluster at '127.0.0.1:1': Connection refused"),
        ("here", "an address is HOST:PORT"),
    ],
)
def test_an_address_that_nobody_answers_at_is_one_sentence(address: str, says: str, tmp_path: Path) -> None:
    pytest.importorskip("ray")
    done = run("sweep", "--ray", address, cwd=tmp_path)
    assert done.returncode == 2
    assert says in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_without_ray_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    done = run("sweep", "--ray", "local", cwd=tmp_path)
    assert done.returncode == 2
    assert "a sweep on a cluster needs the optional extra 'ray': pip install '.[ray]'" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []
