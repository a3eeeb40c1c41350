"""Tests of scripts/env.py that do not create an environment."""

import ast
import shutil
import sys
from pathlib import Path
from types import ModuleType

import pytest

from tests.load_script import load_script

ROOT = Path(__file__).parents[1]
SCRIPT = ROOT / "scripts" / "env.py"


@pytest.fixture
def env() -> ModuleType:
    return load_script("env")


@pytest.fixture
def tree(env: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a small copy of the repository that the script uses as its own."""
    for name in ("pyproject.toml", *env.LOCK_FILES.values()):
        shutil.copy(ROOT / name, tmp_path)
    monkeypatch.setattr(env, "ROOT", tmp_path)
    return tmp_path


def edit(file: Path, old: str, new: str) -> None:
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")


def test_old_python_is_refused_in_one_sentence(env):
    assert (
        env.unsupported_python_message(3, 11)
        == env.unsupported_python_message(3, 14)
        == env.unsupported_python_message(4, 0)
        == ""
    )
    assert env.unsupported_python_message(3, 10) == "klute-sim requires Python 3.11 or later; this is 3.10."


def test_old_python_can_read_the_file_as_far_as_the_refusal():
    ast.parse(SCRIPT.read_text(encoding="utf-8"), feature_version=(3, 6))


def test_stamp_changes_with_what_is_installed(env, tree):
    before = env.compute_stamp(tree, "locked")
    assert env.compute_stamp(tree, "locked") == before
    edit(tree / env.LOCK_FILES["locked"], "numpy==", "numpy==0.")
    locked = env.compute_stamp(tree, "locked")
    edit(tree / "pyproject.toml", '"numpy>=', '"numpy>=1000.')
    assert len({before, locked, env.compute_stamp(tree, "locked")}) == 3


@pytest.mark.parametrize("locked", ["locked", "extras"])
def test_stamp_differs_between_environments_and_each_reads_only_its_lock(env, tree, locked):
    before = {name: env.compute_stamp(tree, name) for name in env.ENVIRONMENT_FOLDERS}
    assert len(set(before.values())) == len(env.ENVIRONMENT_FOLDERS)
    edit(tree / env.LOCK_FILES[locked], "numpy==", "numpy==0.")
    assert [name for name in env.ENVIRONMENT_FOLDERS if env.compute_stamp(tree, name) != before[name]] == [locked]


def test_stamp_does_not_depend_on_the_settings_of_tools(env, tree):
    before = env.compute_stamp(tree, "locked")
    edit(tree / "pyproject.toml", "line-length = ", "line-length = 1")
    assert env.compute_stamp(tree, "locked") == before


def test_unknown_environment_is_refused(env, capsys):
    with pytest.raises(SystemExit) as refused:
        env.main(["--environment", "oldest", "pytest"])
    assert refused.value.code == 2
    assert "invalid choice: 'oldest'" in capsys.readouterr().err


def test_environment_is_made_once_and_stamped_last(env, tree, monkeypatch, capsys):
    made = []

    def make(folder: Path, resolution: str) -> None:
        assert not (folder / "klute-sim-stamp").exists()
        made.append(resolution)
        (folder / env.SCRIPTS_FOLDER).mkdir(parents=True)
        (folder / env.SCRIPTS_FOLDER / ("python.exe" if env.IS_WINDOWS else "python")).touch()

    monkeypatch.setattr(env, "create_environment", make)
    assert env.main([]) == env.main([]) == 0
    assert made == ["locked"]
    out, err = capsys.readouterr()
    assert out.count("activate") == 4  # two lines: "To activate it: ... activate"
    assert err == ""


def test_failed_install_is_one_line_and_leaves_no_stamp(env, tree, monkeypatch, capsys):
    monkeypatch.setattr(env.shutil, "which", lambda name: None)
    monkeypatch.setattr(env.subprocess, "run", lambda *_, **__: env.subprocess.CompletedProcess([], 1))
    assert env.main(["pytest"]) == 1
    *_, last = capsys.readouterr().err.splitlines()
    assert last.startswith("env: the environment is not ready: see the message above")
    assert not list(tree.rglob("klute-sim-stamp"))


def test_python_without_venv_is_told_what_to_install(env, tree, monkeypatch, capsys):
    monkeypatch.setattr(env.shutil, "which", lambda name: None)
    monkeypatch.setattr(env.importlib.util, "find_spec", lambda name: None)
    assert env.main(["pytest"]) == 1
    assert "install python3-venv, or uv" in capsys.readouterr().err


def test_floor_needs_uv(env, tree, monkeypatch, capsys):
    monkeypatch.setattr(env.shutil, "which", lambda name: None)
    assert env.main(["--environment", "floor", "pytest"]) == 1
    assert "needs uv" in capsys.readouterr().err


def test_missing_lock_file_is_no_traceback(env, tree, capsys):
    (tree / env.LOCK_FILES["locked"]).unlink()
    assert env.main(["pytest"]) == 1
    assert env.LOCK_FILES["locked"] in capsys.readouterr().err


def test_command_is_looked_for_in_the_environment(env, tmp_path, capsys):
    assert env.run_in_environment(["no-such-command"], tmp_path / ".venv") == 127
    assert "no command 'no-such-command' in .venv" in capsys.readouterr().err


def test_exit_code_is_passed_on_where_exec_is_not_used(env, tmp_path, monkeypatch):
    monkeypatch.setattr(env, "IS_WINDOWS", True)
    assert env.run_in_environment([sys.executable, "-c", "raise SystemExit(7)"], tmp_path) == 7


@pytest.mark.parametrize("environment", ["locked", "extras"])
def test_lock_file_names_no_index_and_no_machine(env, environment):
    text = (ROOT / env.LOCK_FILES[environment]).read_text(encoding="utf-8")
    assert not [word for word in ("://", "file:", "find-links", " /") if word in text]


def test_both_environments_have_the_same_versions(env):
    locked, extras = (
        {line.partition(" \\")[0] for line in (ROOT / file).read_text("utf-8").splitlines() if "==" in line}
        for file in env.LOCK_FILES.values()
    )
    assert locked < extras
