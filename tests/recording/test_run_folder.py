"""Run folders are complete or do not exist."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from klute_sim.errors import InputError, KluteSimError
from klute_sim.recording import folder_lock, run_folder
from klute_sim.recording.folder_lock import LOCK_FILE_NAME


def fill(scratch: Path) -> None:
    (scratch / "a").write_text("1")


def test_simultaneous_runs_get_separate_numbered_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with (
        run_folder.create_run_folder("gait", None) as (one, scratch),
        run_folder.create_run_folder("gait", None) as (two, other),
    ):
        fill(scratch)
        fill(other)
    assert [one, two] == [Path("runs/gait-001"), Path("runs/gait-002")]
    assert sorted(str(p) for p in Path("runs").rglob("*") if p.is_file()) == ["runs/gait-001/a", "runs/gait-002/a"]


@pytest.mark.parametrize("name", ["new", "deep/er/new", "empty", "link", "."])
def test_finished_run_fills_a_new_or_empty_folder(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    if name == "empty":
        (tmp_path / name).mkdir()
    if name == "link":
        (tmp_path / "elsewhere").mkdir()
        (tmp_path / name).symlink_to("elsewhere")
    with run_folder.create_run_folder("gait", name) as (folder, scratch):
        fill(scratch)
        assert not (folder / "a").exists()
    assert [file.name for file in (tmp_path / name).iterdir()] == ["a"]


@pytest.mark.parametrize("there", [True, False])
@pytest.mark.parametrize(
    "failure", [KeyboardInterrupt(), SystemExit(143), ValueError("x"), OSError(errno.ENOSPC, "full")]
)
def test_failed_run_leaves_no_files(failure: BaseException, there: bool, tmp_path: Path) -> None:
    expected = KluteSimError if isinstance(failure, OSError) else type(failure)
    folder = tmp_path / "runs" / "deep" / "r"
    if there:
        folder.mkdir(parents=True)

    def fail(scratch: Path) -> None:
        fill(scratch)
        raise failure

    with pytest.raises(expected), run_folder.create_run_folder("gait", folder) as (_, scratch):
        fail(scratch)
    assert [p for p in tmp_path.rglob("*") if not p.is_dir()] == []
    assert folder.exists() == there
    assert (tmp_path / "runs").exists() == there


def test_unusable_folders_are_refused_before_the_run(tmp_path: Path) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "x").touch()
    (tmp_path / "file").touch()
    (tmp_path / "broken").symlink_to("nowhere/at/all")
    before = sorted(tmp_path.rglob("*"))
    for name, says in {
        "full": "is not empty",
        "file": "is a file",
        "file/run": "cannot be written",
        "broken": "cannot be written",
        "x" * 300: "cannot be written",
        "y/" + "x" * 300: "cannot be written",
    }.items():
        with pytest.raises(InputError, match=says), run_folder.create_run_folder("gait", tmp_path / name):
            pytest.fail("it should not have started")
        assert sorted(tmp_path.rglob("*")) == before


def leave_unfinished_run(folder: Path) -> None:
    """Leave what a killed run leaves."""
    (folder / run_folder.SCRATCH_FOLDER_NAME).mkdir(parents=True)
    (folder / run_folder.SCRATCH_FOLDER_NAME / "half").touch()
    (folder / LOCK_FILE_NAME).write_text("99999999")


@pytest.mark.parametrize("requested", ["runs/gait-001", None])
def test_folder_of_a_killed_run_is_used_again(
    requested: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    leave_unfinished_run(Path("runs/gait-001"))
    with run_folder.create_run_folder("gait", requested) as (folder, scratch):
        fill(scratch)
    assert [str(path) for path in Path().rglob("*") if not path.is_dir()] == ["runs/gait-001/a"]
    assert folder == Path("runs/gait-001")
    assert sorted(path.name for path in folder.iterdir()) == ["a"]


def test_run_killed_while_its_files_moved_is_completed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    complete = Path("runs/gait-001") / run_folder.COMPLETE_FOLDER_NAME
    complete.mkdir(parents=True)
    (complete / "b").write_text("2")
    Path("runs/gait-001/a").write_text("1")
    with (
        pytest.raises(InputError, match="is not empty"),
        run_folder.create_run_folder("gait", "runs/gait-001"),
    ):
        pytest.fail("it should not have started")
    assert sorted(path.name for path in Path("runs/gait-001").iterdir()) == ["a", "b"]
    with run_folder.create_run_folder("gait", None) as (folder, scratch):
        fill(scratch)
    assert folder.name == "gait-002"


def test_folder_of_a_running_process_is_refused_and_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    code = (
        "import sys\n"
        "from klute_sim.recording.run_folder import create_run_folder\n"
        "with create_run_folder('gait', None) as (folder, scratch):\n"
        "    (scratch / 'b').touch()\n"
        "    print('ready', flush=True)\n"
        "    sys.stdin.read()\n"
    )
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", code], stdin=pipe, stdout=pipe, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        with (
            pytest.raises(InputError, match=rf"runs.gait-001 is in use by process {process.pid}; wait"),
            run_folder.create_run_folder("gait", "runs/gait-001"),
        ):
            pytest.fail("it should not have started")
        assert Path("runs/gait-001", run_folder.SCRATCH_FOLDER_NAME, "b").exists()
        process.kill()
    with run_folder.create_run_folder("gait", "runs/gait-001") as (folder, scratch):
        fill(scratch)
    assert [path.name for path in folder.iterdir()] == ["a"]


def test_without_file_locks_an_unfinished_run_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(descriptor: int) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(folder_lock, "_lock_file", fail)
    with run_folder.create_run_folder("gait", tmp_path / "new") as (_, scratch):
        fill(scratch)
    leave_unfinished_run(tmp_path / "r")
    with (
        pytest.raises(InputError, match=r"holds an unfinished run; if no process uses it, delete .*\.unfinished"),
        run_folder.create_run_folder("gait", tmp_path / "r"),
    ):
        pytest.fail("it should not have started")


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="needs a user whom permissions hold back")
def test_folder_without_permission_is_refused(tmp_path: Path) -> None:
    (tmp_path / "locked").mkdir(mode=0o555)
    with (
        pytest.raises(InputError, match="Permission denied"),
        run_folder.create_run_folder("gait", tmp_path / "locked" / "r"),
    ):
        pytest.fail("it should not have started")
