"""Only regular files of limited size are read, by every reader, without blocking."""

import os
import re
import signal
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from benchmarks.robustness import file_kinds

from klute_sim.datasets import dataset
from klute_sim.errors import InputError, KluteSimError
from klute_sim.files.limits import FileKind
from klute_sim.files.lines import check_duration, check_time_stamps
from klute_sim.files.reading import MissingFileError, NotTextError, read_bytes, read_text
from tests import command_line

KIND = FileKind("device file", 100)


@contextmanager
def fail_when_blocked() -> Iterator[None]:
    def fail(*_: object) -> None:
        raise AssertionError("the reader blocks")

    previous = signal.signal(signal.SIGALRM, fail)
    signal.alarm(30)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, previous)


def test_regular_files_are_read(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"x" * 100)
    (tmp_path / "empty").touch()
    (tmp_path / "link").symlink_to(tmp_path / "a")
    assert read_bytes(tmp_path / "a", KIND) == read_bytes(tmp_path / "link", KIND) == b"x" * 100
    assert read_bytes(tmp_path / "empty", KIND) == b""
    (tmp_path / "bom").write_bytes(b"\xef\xbb\xbfmass")
    assert read_text(tmp_path / "bom", KIND) == "mass"


def test_other_than_regular_files_are_refused_in_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    (tmp_path / "large").write_bytes(b"x" * 101)
    (tmp_path / "latin").write_bytes(b"\xe9")
    monkeypatch.chdir(tmp_path)  # the path of a socket is short
    with socket.socket(socket.AF_UNIX) as server, fail_when_blocked():
        server.bind("socket")
        for path, message in (
            (tmp_path / "fifo", r"device file .*fifo cannot be read: it is a FIFO \(named pipe\); give a regular file"),
            (Path("/dev/zero"), "device file /dev/zero cannot be read: it is a device; give a regular file"),
            (tmp_path / "socket", "it is a socket; give a regular file"),
            (tmp_path, "cannot be read: Is a directory; give a file"),
            (tmp_path / "loop", "cannot be read: Too many levels of symbolic links"),
            (tmp_path / "large", r"device file .*large has 0.000101 MB; allowed: up to 0.0001 MB"),
            (tmp_path / "a\0b", "the path contains a null character"),
            (Path("/proc/self/environ"), "longer than the system states; copy it first"),
        ):
            with pytest.raises(InputError, match=message):
                read_bytes(path, KIND)
    with pytest.raises(MissingFileError, match=r"device file .*none cannot be read: No such file"):
        read_bytes(tmp_path / "none", KIND)
    with pytest.raises(NotTextError, match="not a UTF-8 text file"):
        read_text(tmp_path / "latin", KIND)


def test_unreadable_file_is_refused_in_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def deny(*_: object) -> int:
        raise PermissionError(13, "Permission denied")

    (tmp_path / "a").touch()
    monkeypatch.setattr(os, "open", deny)  # the user root may read everything
    with pytest.raises(InputError, match=r"a cannot be read: Permission denied"):
        read_bytes(tmp_path / "a", KIND)


@pytest.mark.parametrize("name", [name for name in file_kinds.KINDS if name != "columns"])  # lines of a dataset file
def test_every_reader_refuses_endless_and_blocking_files(name: str, tmp_path: Path) -> None:
    kind = file_kinds.KINDS[name]
    if kind.library and find_spec(kind.library) is None:
        pytest.skip(f"needs {kind.library}")
    (tmp_path / "intact").mkdir()
    originals = kind.make(tmp_path / "intact")
    os.mkfifo(tmp_path / "fifo")
    for number, replaced in enumerate(originals):
        for special in (tmp_path / "fifo", Path("/dev/zero")):
            folder = tmp_path / f"{number}_{special.name}"
            folder.mkdir()
            copies = [folder / file.name for file in originals]
            for file, copy in zip(originals, copies, strict=True):
                copy.symlink_to(special) if file == replaced else copy.write_bytes(file.read_bytes())
            if replaced.name == "key.json":  # the result of a case, which is simulated again
                with fail_when_blocked():
                    assert kind.use(copies) is None
                continue
            with fail_when_blocked(), pytest.raises(KluteSimError) as caught:
                kind.use(copies)
            expected = "is not the plan of a sweep" if replaced.name == "sweep.json" else "cannot be read: it is"
            assert expected in str(caught.value)


@pytest.mark.parametrize(
    "arguments",
    [
        ("device", "PATH"),
        ("gait", "--device", "PATH"),
        ("gait", "--controller", "PATH"),
        ("gait", "--reference", "PATH"),
        ("bench", "PATH"),
        ("compare", "PATH"),
        ("import", "PATH", "--mass", "70"),
        ("reproduce", "--numbers", "PATH"),
    ],
)
def test_commands_refuse_special_files(arguments: tuple[str, ...], tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo.csv")
    (tmp_path / "zero.toml").symlink_to("/dev/zero")
    for path in (tmp_path / "fifo.csv", tmp_path / "zero.toml"):
        with fail_when_blocked():
            run = command_line.run(*(argument.replace("PATH", str(path)) for argument in arguments), cwd=tmp_path)
        assert run.returncode == 2, run.stderr
        assert run.stderr.count("\n") == 1
        assert "Traceback" not in run.stderr


def test_wrong_time_stamp_is_refused_and_long_regular_times_are_left_to_plausibility() -> None:
    time = np.arange(1000) * 0.01
    for stamp in (1e5, 1e15):
        with pytest.raises(InputError, match=re.escape(f"a.mot: time spans {stamp:g} s; allowed: up to 3600 s")):
            check_time_stamps(np.append(time, stamp), "a.mot")
    check_time_stamps(1e3 * time, "a.mot")
    check_time_stamps(np.append(time, 60.0), "a.mot")
    with pytest.raises(InputError, match="are the times in milliseconds"):
        check_duration(1e3 * time, "a.csv")


def test_trial_of_years_is_refused(tmp_path: Path) -> None:
    example = Path(dataset.__file__).parent / "example"
    lines = (example / "fit_1_a.csv").read_text().splitlines()
    (tmp_path / "a.csv").write_text("\n".join([*lines[:-1], "1e15" + lines[-1][lines[-1].index(",") :]]))
    (tmp_path / "dataset.toml").write_text(
        'format = "klute-sim-dataset/2"\nrig = "bench"\ndevice = "klute-3-4-pair"\n[[trial]]\nfiles = ["a.csv"]\n'
        'use = "fit"\n[[trial]]\nfiles = ["b.csv"]\nuse = "validation"\n'
    )
    (tmp_path / "b.csv").write_text("\n".join(lines))
    with pytest.raises(InputError, match="time"):
        dataset.load_dataset(tmp_path)
    with pytest.raises(InputError, match=r"trial 'a': time spans 1e\+15 s; allowed: up to 3600 s"):
        dataset.load_dataset(tmp_path, accept=["time-gap", "time-unit"])
