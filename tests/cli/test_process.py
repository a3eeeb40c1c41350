"""How the process of a command ends: signals, output that cannot be written, no memory, and a full disk."""

import ctypes
import errno
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from klute_sim import cli
from klute_sim.cli import process
from klute_sim.viewer import stream
from tests.command_line import run

LONG_OUTPUT = ("effects", "--json")
"""A command that starts fast and prints more than fits into a buffer."""
posix = pytest.mark.skipif(os.name == "nt", reason="POSIX signals")


def start(code: str, cwd: Path | None = None) -> "subprocess.CompletedProcess[str]":
    return subprocess.run([sys.executable, "-c", code], cwd=cwd, capture_output=True, text=True, check=False)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("arguments", [LONG_OUTPUT, ("--help",)])
def test_unwritable_output_is_one_sentence(arguments: tuple[str, ...], unbuffered: str) -> None:
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "klute_sim", *arguments],
            env={**os.environ, "PYTHONUNBUFFERED": unbuffered},
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    sentence = "klute-sim: a file or the output cannot be read or written: No space left on device\n"
    assert (done.returncode, done.stderr) == (2, sentence)


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("arguments", [LONG_OUTPUT, ("--help",)])
def test_closed_pipe_is_silent(arguments: tuple[str, ...], unbuffered: str) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(
        [sys.executable, "-m", "klute_sim", *arguments],
        env={**os.environ, "PYTHONUNBUFFERED": unbuffered},
        stdout=writer,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    os.close(writer)
    assert (done.returncode, done.stderr) == (0, "")


@posix
@pytest.mark.parametrize("name", ["SIGTERM", pytest.param("SIGHUP", marks=pytest.mark.slow)])
def test_signal_leaves_no_half_written_run(name: str, tmp_path: Path) -> None:
    number = signal.Signals[name]
    code = (
        "import os, signal\n"
        f"signal.signal({number:d}, signal.SIG_DFL)\n"  # which nohup ignores
        "from klute_sim.recording import parquet\n"
        "def write_half(recording, path):\n"
        f"    path.write_bytes(b'half'); os.kill(os.getpid(), {number:d})\n"
        "parquet.write_recording = write_half\n"
        "from klute_sim.cli import main\n"
        "main(['gait', '--strides', '1', '--step', '1', '--learning-strides', '0', '--out', 'r'])\n"
    )
    done = start(code, tmp_path)
    assert done.returncode == 128 + number
    assert done.stderr.strip() == "klute-sim: interrupted; no file was left half-written"
    assert list(tmp_path.iterdir()) == []


def test_signal_while_a_module_is_imported_is_no_error(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    """MuJoCo reports it as an ImportError."""

    def import_command(*_: object) -> None:
        try:
            raise process.TerminationError(signal.SIGTERM)
        except KeyboardInterrupt as interrupt:
            raise ImportError("initialization failed") from interrupt

    monkeypatch.setattr(cli._LazyGroup, "get_command", import_command)
    with pytest.raises(SystemExit) as exit_info:
        cli.main(["gait"])
    assert exit_info.value.code == 128 + signal.SIGTERM
    assert capsys.readouterr().err == "klute-sim: interrupted; no file was left half-written\n"


def test_errors_of_their_own_follow_from_no_interrupt() -> None:
    error = ValueError("wrong")
    error.__cause__ = ImportError("missing")
    assert process.find_interrupt(error) is None
    error.__cause__, error.__context__ = None, KeyboardInterrupt()  # raised by what removes unfinished files
    assert process.find_interrupt(error) is None


@posix
def test_ignored_hangup_stays_ignored() -> None:
    previous = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    try:
        with process.raise_on_termination():
            os.kill(os.getpid(), signal.SIGHUP)
            with pytest.raises(KeyboardInterrupt):
                os.kill(os.getpid(), signal.SIGTERM)
            os.kill(os.getpid(), signal.SIGTERM)  # while unfinished files are removed
    finally:
        signal.signal(signal.SIGHUP, previous)


@posix
@pytest.mark.parametrize(("name", "error"), [("SIGTERM", process.TerminationError), ("SIGINT", KeyboardInterrupt)])
def test_signal_in_a_callback_is_not_lost(name: str, error: type[BaseException]) -> None:
    number = signal.Signals[name]
    callback = ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), number))  # an exception cannot leave it
    previous = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with process.raise_on_termination(), pytest.raises(error):
            call_and_wait(callback)
    finally:
        signal.signal(signal.SIGINT, previous)


def call_and_wait(callback: Callable[[], None]) -> None:
    callback()
    time.sleep(60.0)


@pytest.mark.parametrize(
    ("error", "is_memory"),
    [
        (MemoryError(), True),
        (ImportError("libx.so: failed to map segment from shared object"), True),
        (ValueError("Error: engine error: Could not allocate memory"), True),
        (ImportError("No module named 'x'"), False),
        (ValueError("x"), False),
    ],
)
def test_lack_of_memory_is_recognized(
    error: Exception, is_memory: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr("klute_sim.recording.parquet.write_recording", fail)
    arguments = ("gait", "--strides", "1", "--step", "1", "--learning-strides", "0", "--out", "r")
    if is_memory:
        done = run(*arguments, cwd=tmp_path)
        assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)
        assert done.stderr.startswith("klute-sim: not enough memory; use fewer strides")
    else:
        with pytest.raises(type(error)):
            run(*arguments, cwd=tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_full_disk_while_the_viewer_recording_is_written(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="the extra 'rerun' is not installed")

    def fail(path: Path, content: bytes) -> None:
        path.write_bytes(content[:100])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(stream, "write_atomically", fail)
    done = run("gait", "--strides", "1", "--step", "1", "--learning-strides", "0", "--out", "r", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (2, "klute-sim: the disk is full: r was not written\n")
    assert list(tmp_path.iterdir()) == []
