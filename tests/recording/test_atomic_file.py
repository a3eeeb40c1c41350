"""Files appear complete or not at all."""

import errno
from pathlib import Path

import pytest

from klute_sim.recording.atomic_file import is_temporary, remove_temporary_files, replace_atomically, write_atomically


def test_content_replaces_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "x.json"
    for content in ("old", "new µ\n", b"\x00\r\n"):
        write_atomically(path, content)
        assert path.read_bytes() == (content if isinstance(content, bytes) else content.encode())
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()])
def test_failed_write_keeps_the_old_content(error: BaseException, tmp_path: Path) -> None:
    path = tmp_path / "x.png"
    path.write_text("old")

    def fail(temporary: Path) -> None:
        temporary.write_text("half")
        assert temporary.suffix == ".png"
        raise error

    with pytest.raises(type(error)), replace_atomically(path) as temporary:
        fail(temporary)
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_text() == "old"


def test_only_temporary_files_are_removed(tmp_path: Path) -> None:
    names = ["a.json", ".hidden", ".1-2", ".5.a.json", "1-2.a"]
    with replace_atomically(tmp_path / "b.json") as temporary:
        temporary.touch()
        names.append(temporary.name + ".left")
    for name in names:
        (tmp_path / name).touch()
    assert [name for name in names if is_temporary(name)] == names[-1:]
    remove_temporary_files(tmp_path)
    assert sorted(file.name for file in tmp_path.iterdir()) == sorted([*names[:-1], "b.json"])
