"""Run folders appear whole or not at all."""

import errno
from pathlib import Path

import pytest

from klute_sim.errors import InputError, KluteSimError
from klute_sim.recording import run_folder


def test_default_folders_are_numbered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_folder.choose("gait", None) == Path("runs/gait-001")
    (tmp_path / "runs" / "gait-001").mkdir(parents=True)
    assert run_folder.choose("gait", None) == Path("runs/gait-002")


def test_a_finished_run_takes_its_place_even_an_empty_one(tmp_path: Path) -> None:
    for name in ("new", "deep/er/new", "empty"):
        folder = tmp_path / name
        if name == "empty":
            folder.mkdir()
        with run_folder.writing(run_folder.choose("gait", folder)) as scratch:
            (scratch / "a").write_text("1")
            assert not (folder / "a").exists()
        assert [file.name for file in folder.iterdir()] == ["a"]
        assert [file.name for file in folder.parent.iterdir() if file.name.startswith(".")] == []


@pytest.mark.parametrize("failure", [KeyboardInterrupt(), ValueError("x"), OSError(errno.ENOSPC, "full")])
def test_a_failed_run_leaves_nothing(failure: BaseException, tmp_path: Path) -> None:
    expected = KluteSimError if isinstance(failure, OSError) else type(failure)

    def fail(scratch: Path) -> None:
        (scratch / "half").write_text("1")
        raise failure

    with pytest.raises(expected), run_folder.writing(tmp_path / "runs" / "deep" / "r") as scratch:
        fail(scratch)
    assert list(tmp_path.iterdir()) == []


def test_places_that_cannot_take_a_run_are_refused(tmp_path: Path) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "x").touch()
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="is not empty"):
        run_folder.choose("gait", tmp_path / "full")
    with pytest.raises(InputError, match="is a file"):
        run_folder.choose("gait", tmp_path / "file")
    with pytest.raises(InputError, match="cannot be written"):
        run_folder.choose("gait", tmp_path / "file" / "run")
