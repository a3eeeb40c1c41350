"""Run folders are complete or do not exist."""

import errno
import os
from pathlib import Path

import pytest

from klute_sim.errors import InputError, KluteSimError
from klute_sim.recording import run_folder


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


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="needs a user whom permissions hold back")
def test_folder_without_permission_is_refused(tmp_path: Path) -> None:
    (tmp_path / "locked").mkdir(mode=0o555)
    with (
        pytest.raises(InputError, match="Permission denied"),
        run_folder.create_run_folder("gait", tmp_path / "locked" / "r"),
    ):
        pytest.fail("it should not have started")
