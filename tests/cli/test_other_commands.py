"""Help, version, errors, and ``klute-sim device``."""

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from klute_sim.device.device import load_device
from tests.command_line import run

SLOW_IMPORTS = ("gymnasium", "matplotlib", "mujoco", "numba", "numpy", "rerun", "scipy")


@pytest.mark.parametrize("command", [[], ["gait"], ["bench"], ["compare"], ["device"], ["view"]])
def test_help_has_examples_and_imports_nothing_slow(command: list[str]) -> None:
    code = (
        "import sys\nfrom klute_sim.cli import main\n"
        f"try: main({[*command, '--help']!r})\n"
        f"finally: print('slow imports:', [m for m in {SLOW_IMPORTS!r} if m in sys.modules])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Examples:" in done.stdout
    assert "slow imports: []" in done.stdout


def test_version_is_printed() -> None:
    from klute_sim import __version__

    assert __version__ in run("--version").stdout


def test_command_without_arguments_prints_the_help() -> None:
    done = run()
    assert done.returncode == 0
    assert done.stdout == run("--help").stdout
    assert done.stderr == ""


def test_preset_file_is_printed_as_a_template(tmp_path: Path) -> None:
    text = run("device", "klute-1-1-4-pair", "--toml").stdout
    assert text == load_device("klute-1-1-4-pair").content.decode()
    path = tmp_path / "mine.toml"
    path.write_text(text, "utf-8")
    assert load_device(path).parameters == load_device("klute-1-1-4-pair").parameters


def test_presets_are_listed() -> None:
    assert "klute-1-1-4-pair" in run("device").stdout
    assert {d["name"] for d in json.loads(run("device", "--json").stdout)} >= {"klute-3-4", "klute-3-4-pair"}


def test_model_is_shown_beside_the_measurement_and_not_called_validation() -> None:
    done = run("device", "klute-3-4")
    assert "model 736 N" in done.stdout
    assert "published 734 N" in done.stdout
    assert "consistency, not validation" in done.stdout


def test_assumed_numbers_are_marked() -> None:
    description = json.loads(run("device", "klute-1-1-4-pair", "--json").stdout)
    assumed = {row["key"] for row in description["numbers"] if row["assumed"]}
    assert "damper.bore_mm" in assumed
    assert "muscle.c10_kpa" not in assumed
    assert all(row["source"].startswith("assumed") == row["assumed"] for row in description["numbers"])
    forces = {row["ratio"]: row["friction_n"] for row in description["isometric_force"]}
    assert forces[0.96] == pytest.approx(2707, abs=1)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["device", "klute-3-4", "--pressure", "6"], "allows 0 to 5 bar"),
        (["device", "klute-3-4", "--pressure", "nan"], "allows 0 to 5 bar"),
        (["device", "missing.toml"], "no device 'missing.toml'"),
        (["stroll"], "there is no command 'stroll'; run klute-sim --help for a list of all commands"),
        (["diagnos"], "there is no command 'diagnos'; did you mean 'diagnose'? "),
        (["--gait"], "No such option"),
        (["gait", "--mass", "82 kg"], "'82 kg' is not a number; write the number alone, in kg"),
        (["gait", "--spring-foot", "stiff"], "'stiff' is not a number"),
        (["gait", "--device", "klute-1-1-4"], "no [tendon] section; did you mean 'klute-1-1-4-pair'?"),
        (["device", "klute-1-1-pair"], "no device 'klute-1-1-pair': did you mean 'klute-1-1-4-pair'? Give the path"),
        (["gait", "--height", "1.8"], "there is no option --height; the option for body height is --stature"),
        (["import", "a.csv", "--height", "1.8"], "the option for body height is --stature"),
        (["effects", "braid-hysteresis"], "there is no effect 'braid-hysteresis'; did you mean 'braid_hysteresis'? Th"),
        (["view", "no-such-run"], "no-such-run" if find_spec("rerun") else "'.[rerun]'"),
        (["device", ""], "name of the device is empty"),
        (["device", "--pressure", "3"], "--pressure needs the name of a device"),
        (["device", "--toml"], "--toml needs the name of a device"),
        (["device", "klute-3-4", "--toml", "--json"], "exclude each other"),
        (["gait", "--device", ""], "name of the device is empty"),
        (["gait", "--reference", ""], "the path is empty"),
        (["gait", "--controller", ""], "the name of the controller is empty"),
        (["gait", "--out", ""], "the path is empty"),
        (["gait", "--controller", "constant:9"], "supply of 'klute-1-1-4-pair' has 5 bar"),
        (["gait", "--backend", "fast"], "'fast' is not one of 'auto', 'compiled', 'python'"),
    ],
)
def test_bad_input_is_one_sentence(arguments: list[str], message: str) -> None:
    done = run(*arguments)
    assert done.returncode == 2
    assert message in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_existing_example_dataset_is_used(tmp_path: Path) -> None:
    command = ("diagnose", "e", "--example", "--only", "nothing")  # the example is written before the refusal
    assert "there is no effect or number 'nothing'" in run(*command, cwd=tmp_path).stderr
    assert "there is no effect or number 'nothing'" in run(*command, cwd=tmp_path).stderr
    (tmp_path / "e" / "dataset.toml").write_text("mine")
    assert "output folder e is not empty" in run(*command, cwd=tmp_path).stderr


def test_listed_descriptions_are_aligned() -> None:
    lines = run("device").stdout.splitlines()
    assert all(line.index("  ") > 0 for line in lines)
    assert len({len(line) - len(line.split(None, 1)[1]) for line in lines}) == 1


def test_names_with_brackets_are_printed_verbatim(tmp_path: Path) -> None:
    text = load_device("klute-3-4").content.decode().replace('name = "klute-3-4"', 'name = "x[/b]"')
    (tmp_path / "b.toml").write_text(text.replace('"dissertation Table 3.1"', '"see [klute1999]"', 1))
    done = run("device", str(tmp_path / "b.toml"))
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("x[/b]: ")
    assert "see [klute1999]" in done.stdout


def test_terminal_without_unicode_shows_the_numbers() -> None:
    command = [sys.executable, "-m", "klute_sim", "device", "klute-3-4"]
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "736 N" in done.stdout
