"""Help, version and ``klute-sim device``."""

import json
import subprocess
import sys
from importlib.util import find_spec

import pytest


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "klute_sim", *arguments], capture_output=True, text=True, check=False)


@pytest.mark.parametrize("command", [[], ["gait"], ["device"], ["view"]])
def test_help_has_examples_and_needs_no_mujoco(command: list[str]) -> None:
    code = (
        "import sys\nfrom klute_sim.cli import main\n"
        f"try: main({[*command, '--help']!r})\n"
        "finally: print('heavy:', [m for m in ('mujoco', 'numpy', 'matplotlib', 'rerun') if m in sys.modules])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Examples:" in done.stdout
    assert "heavy: []" in done.stdout


def test_version() -> None:
    from klute_sim import __version__

    assert __version__ in run("--version").stdout


def test_devices_are_listed() -> None:
    assert "klute-1-1-4-pair" in run("device").stdout
    assert {d["name"] for d in json.loads(run("device", "--json").stdout)} >= {"klute-3-4", "klute-3-4-pair"}


def test_model_stands_beside_the_measurement_and_is_not_called_validation() -> None:
    done = run("device", "klute-3-4")
    assert "model 736 N" in done.stdout
    assert "published 734 N" in done.stdout
    assert "consistency, not validation" in done.stdout


def test_assumed_numbers_say_so() -> None:
    shown = json.loads(run("device", "klute-1-1-4-pair", "--json").stdout)
    assumed = {row["key"] for row in shown["numbers"] if row["assumed"]}
    assert "damper.bore_mm" in assumed
    assert "muscle.c10_kpa" not in assumed
    assert all(row["source"].startswith("assumed") == row["assumed"] for row in shown["numbers"])
    forces = {row["ratio"]: row["friction_n"] for row in shown["isometric_force"]}
    assert forces[0.96] == pytest.approx(2707, abs=1)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["device", "klute-3-4", "--pressure", "6"], "allows 0 to 5 bar"),
        (["device", "klute-3-4", "--pressure", "nan"], "allows 0 to 5 bar"),
        (["device", "missing.toml"], "no device 'missing.toml'"),
        (["walk"], "No such command 'walk'"),
        (["view", "no-such-run"], "no-such-run" if find_spec("rerun") else "klute-sim[rerun]"),
    ],
)
def test_bad_input_is_one_sentence(arguments: list[str], says: str) -> None:
    done = run(*arguments)
    assert done.returncode == 2
    assert says in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
