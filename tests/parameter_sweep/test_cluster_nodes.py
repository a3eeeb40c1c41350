"""Sweeps on a Ray cluster of two nodes on this machine, reached through the loopback address only."""

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import klute_sim
from klute_sim.parameter_sweep.store import RESULTS_FOLDER
from tests.command_line import run

pytestmark = pytest.mark.extras

LOOPBACK = "127.0.0.1"
NODE = {"num_cpus": 1, "node_ip_address": LOOPBACK, "object_store_memory": 100_000_000}
CASES = ("--mass", "60,65,70,75,80,85", "--slope", "0,2", "--strides", "1", "--step", "1", "--json")
N_CASES = 12


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Return a cluster with one node, to which the tests add the second."""
    pytest.importorskip("ray")
    from ray.cluster_utils import Cluster

    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    cluster = Cluster(initialize_head=True, head_node_args={**NODE, "include_dashboard": False})
    yield cluster
    cluster.shutdown()


def start_sweep(cluster: Any, folder: Path) -> subprocess.Popen[str]:
    # Without the variable, Ray replaces the loopback address by another address of this machine.
    environment = {**os.environ, "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0", "COLUMNS": "130"}
    command = [sys.executable, "-m", "klute_sim", "sweep", *CASES, "--ray", cluster.address, "--out", "cluster"]
    return subprocess.Popen(
        command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def test_killed_node_loses_no_case_and_results_equal_those_of_local_processes(cluster: Any, tmp_path: Path) -> None:
    local = run("sweep", *CASES, "--out", "local", cwd=tmp_path)
    assert local.returncode == 0, local.stderr
    node = cluster.add_node(**NODE)
    sweep = start_sweep(cluster, tmp_path)
    results = tmp_path / "cluster" / RESULTS_FOLDER
    while sweep.poll() is None and not any(results.glob("*")):
        time.sleep(0.02)
    cluster.remove_node(node, allow_graceful=False)
    n_results_when_killed = len(list(results.glob("*")))
    out, err = sweep.communicate(timeout=600)
    assert sweep.returncode == 0, err
    assert 0 < n_results_when_killed < N_CASES - 1, "the node was not killed during the sweep"
    tables = [(tmp_path / name / "sweep.parquet").read_bytes() for name in ("local", "cluster")]
    assert tables[0] == tables[1]
    assert out.count('"failure": null') == local.stdout.count('"failure": null') == N_CASES


def test_node_with_other_version_is_refused_by_name(cluster: Any, tmp_path: Path) -> None:
    installed = Path(klute_sim.__file__).parent
    other = tmp_path / "installation" / "klute_sim"
    shutil.copytree(installed, other, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(installed.parents[1] / "models", other / "models", dirs_exist_ok=True)
    file = other / "__init__.py"
    text = file.read_text("utf-8")
    assert text.count(klute_sim.__version__) == 1
    file.write_text(text.replace(klute_sim.__version__, "0.0.9"), "utf-8")
    node = cluster.add_node(**NODE, env_vars={"PYTHONPATH": str(other.parent)})
    sweep = start_sweep(cluster, tmp_path)
    _, err = sweep.communicate(timeout=600)
    cluster.remove_node(node, allow_graceful=False)
    assert sweep.returncode == 2
    # Ray reports the node that the test before has killed whenever it notices it, in lines of its own.
    (error,) = [line for line in err.splitlines() if line.startswith("klute-sim")]
    assert "Traceback" not in err
    assert f"at {LOOPBACK} runs other software than this process" in error
    assert f"klute-sim 0.0.9 instead of {klute_sim.__version__}" in error
    assert not (tmp_path / "cluster").exists()
