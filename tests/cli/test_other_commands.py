"""Help, version and ``klute-sim device``."""

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from klute_sim.device.device import load_device
from tests.command_line import run

HEAVY = ("gymnasium", "matplotlib", "mujoco", "numba", "numpy", "rerun", "scipy")


@pytest.mark.parametrize("command", [[], ["gait"], ["bench"], ["compare"], ["device"], ["view"]])
def test_help_has_examples_and_needs_no_mujoco(command: list[str]) -> None:
    code = (
        "import sys\nfrom klute_sim.cli import main\n"
        f"try: main({[*command, '--help']!r})\n"
        f"finally: print('heavy:', [m for m in {HEAVY!r} if m in sys.modules])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Examples:" in done.stdout
    assert "heavy: []" in done.stdout


def test_version() -> None:
    from klute_sim import __version__

    assert __version__ in run("--version").stdout


def test_the_bare_command_is_its_help() -> None:
    done = run()
    assert done.returncode == 0
    assert done.stdout == run("--help").stdout
    assert done.stderr == ""


def test_a_presets_file_is_there_to_start_from(tmp_path: Path) -> None:
    text = run("device", "klute-1-1-4-pair", "--toml").stdout
    assert text == load_device("klute-1-1-4-pair").content.decode()
    mine = tmp_path / "mine.toml"
    mine.write_text(text, "utf-8")
    assert load_device(mine).parameters == load_device("klute-1-1-4-pair").parameters


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
        (["walk"], "there is no command 'walk'; all are in klute-sim --help"),
        (["diagnos"], "there is no command 'diagnos'; did you mean 'diagnose'? "),
        (["--gait"], "No such option"),
        (["gait", "--mass", "82 kg"], "'82 kg' is not a number; write the number alone, in kg"),
        (["gait", "--spring-foot", "stiff"], "'stiff' is not a number"),
        (["gait", "--device", "klute-1-1-4"], "no [tendon] section; did you mean 'klute-1-1-4-pair'?"),
        (["device", "klute-1-1-pair"], "no device 'klute-1-1-pair': did you mean 'klute-1-1-4-pair'? Give the path"),
        (["gait", "--height", "1.8"], "there is no option --height; how tall somebody is goes with --stature"),
        (["import", "a.csv", "--height", "1.8"], "goes with --stature"),
        (["effects", "braid-hysteresis"], "there is no effect 'braid-hysteresis'; did you mean 'braid_hysteresis'? Th"),
        (["view", "no-such-run"], "no-such-run" if find_spec("rerun") else "'.[rerun]'"),
        (["device", ""], "name of the device is empty"),
        (["device", "--pressure", "3"], "--pressure goes with the name of a device"),
        (["device", "--toml"], "--toml goes with the name of a device"),
        (["device", "klute-3-4", "--toml", "--json"], "do not go together"),
        (["gait", "--device", ""], "name of the device is empty"),
        (["gait", "--reference", ""], "the path is empty"),
        (["gait", "--controller", ""], "the name of the controller is empty"),
        (["gait", "--out", ""], "the path is empty"),
        (["gait", "--controller", "constant:9"], "supply of 'klute-1-1-4-pair' has 5 bar"),
        (["gait", "--law", "fast"], "'fast' is not one of 'auto', 'compiled', 'python'"),
    ],
)
def test_bad_input_is_one_sentence(arguments: list[str], says: str) -> None:
    done = run(*arguments)
    assert done.returncode == 2
    assert says in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_an_example_that_is_there_already_is_said_to_be(tmp_path: Path) -> None:
    wrong = ("diagnose", "e", "--example", "--only", "nothing")  # written, and then refused
    assert "there is no effect 'nothing'" in run(*wrong, cwd=tmp_path).stderr
    assert "the example dataset is in e already: leave out --example" in run(*wrong, cwd=tmp_path).stderr
    (tmp_path / "e" / "dataset.toml").write_text("mine")
    assert "output folder e is not empty" in run(*wrong, cwd=tmp_path).stderr


def test_names_of_devices_stand_apart_from_what_they_are() -> None:
    lines = run("device").stdout.splitlines()
    assert len({line.index("  ") > 0 and len(line) - len(line.split(None, 1)[1]) for line in lines}) == 1


def test_names_with_brackets_are_printed_as_they_are(tmp_path: Path) -> None:
    text = load_device("klute-3-4").content.decode().replace('name = "klute-3-4"', 'name = "x[/b]"')
    (tmp_path / "b.toml").write_text(text.replace('"dissertation Table 3.1"', '"see [klute1999]"', 1))
    done = run("device", str(tmp_path / "b.toml"))
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("x[/b]: ")
    assert "see [klute1999]" in done.stdout


def test_a_terminal_without_our_symbols_gets_the_numbers() -> None:
    command = [sys.executable, "-m", "klute_sim", "device", "klute-3-4"]
    poor = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run(command, env=poor, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "736 N" in done.stdout


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_output_that_cannot_be_written_is_one_sentence() -> None:
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "klute_sim", "device", "--json"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2
    assert "cannot be read or written: No space left on device" in done.stderr
    assert "Traceback" not in done.stderr
