"""C3D through its library: a capture by hand, and files that are none."""

import os
import signal
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from klute_sim.errors import InputError, MissingExtraError
from klute_sim.files import isolation
from klute_sim.mocap.formats import c3d


def write_c3d(path: Path) -> Path:
    """Two markers, and a plate of 600 mm by 400 mm on which 800 N press 97.5 mm off its middle."""
    ezc3d = pytest.importorskip("ezc3d", reason="the extra 'c3d' is not installed")
    file = ezc3d.c3d()
    points = np.ones((4, 2, 50))
    points[:3] = np.arange(6.0).reshape(3, 2, 1) * 100.0
    points[:3, 0, 7] = np.nan
    channels = np.zeros((1, 6, 500))
    channels[0, 0], channels[0, 2], channels[0, 4] = 50.0, 800.0, 80_000.0
    file["data"]["points"], file["data"]["analogs"] = points, channels
    parameters = file["parameters"]
    parameters["POINT"]["LABELS"]["value"], parameters["POINT"]["UNITS"]["value"] = ["A", "B"], ["mm"]
    parameters["POINT"]["RATE"]["value"], parameters["ANALOG"]["RATE"]["value"] = [100.0], [1000.0]
    parameters["ANALOG"]["LABELS"]["value"] = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"]
    parameters["ANALOG"]["UNITS"]["value"] = ["N", "N", "N", "Nmm", "Nmm", "Nmm"]
    plate = parameters["FORCE_PLATFORM"]
    plate["USED"]["value"], plate["TYPE"]["value"] = [1], [2]
    corners = [[600.0, 400.0, 0.0], [0.0, 400.0, 0.0], [0.0, 0.0, 0.0], [600.0, 0.0, 0.0]]
    plate["CORNERS"]["value"] = np.array(corners).T.reshape(3, 4, 1)
    plate["ORIGIN"]["value"] = np.array([0.0, 0.0, -40.0]).reshape(3, 1)
    plate["CHANNEL"]["value"] = np.arange(1, 7).reshape(6, 1)
    file.write(str(path))
    return path


def test_capture_matches_known_values(tmp_path: Path) -> None:
    capture = c3d.read(write_c3d(tmp_path / "x.c3d"))
    assert capture.markers.positions["B"][0] == pytest.approx([0.1, 0.3, 0.5])
    assert np.isnan(capture.markers.positions["A"][7]).all()
    assert capture.markers.time[-1] == pytest.approx(0.49)
    (plate,) = capture.plates
    assert len(plate.time) == 500
    assert plate.time[-1] == pytest.approx(0.499)
    assert plate.force[0] == pytest.approx([50.0, 0.0, 800.0])
    # -My/Fz = -100 mm, and 50 N at 40 mm below the surface move it by 50 * -40 / 800 = -2.5 mm
    assert plate.cop[0] == pytest.approx([0.300 - 0.100 - 0.0025, 0.200, 0.0], abs=1e-6)


def test_invalid_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.c3d"
    for data, message in (
        (b"\x02\x51" + bytes(2000), "second byte"),
        (b"PK" + b"x" * 2000, "second byte"),
        (b"\x02\x50" + bytes(40), "is not a C3D file"),
        (b"\x09\x50" + bytes(2000), "truncated"),
        (b"\x02\x50" + bytes(510) + b"\x01\x50\x01\x20" + bytes(2000), "processor type -51"),
    ):
        path.write_bytes(data)
        with pytest.raises(InputError, match=message):
            c3d.read(path)


def test_truncated_file_is_refused(tmp_path: Path) -> None:
    data = write_c3d(tmp_path / "x.c3d").read_bytes()
    (tmp_path / "cut.c3d").write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match="truncated: 50 frames of 2 markers"):
        c3d.read(tmp_path / "cut.c3d")


def test_excessive_number_of_samples_is_refused(tmp_path: Path) -> None:
    data = bytearray(write_c3d(tmp_path / "x.c3d").read_bytes())
    struct.pack_into("<4H", data, 2, 60_000, 60_000, 1, 65_535)
    (tmp_path / "huge.c3d").write_bytes(data)
    with pytest.raises(InputError, match=r"more than \d+ samples"):
        c3d.read(tmp_path / "huge.c3d")


def test_missing_library_error_names_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    header = bytearray(2048)
    header[:2] = b"\x02\x50"
    struct.pack_into("<4H", header, 2, 1, 0, 1, 2)
    struct.pack_into("<f", header, 12, -1.0)
    struct.pack_into("<H", header, 16, 3)
    header[512:516] = b"\x01\x50\x01\x54"
    (tmp_path / "x.c3d").write_bytes(header)
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    with pytest.raises(MissingExtraError, match="'c3d'"):
        c3d.read(tmp_path / "x.c3d")


def test_library_crash_raises_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_c3d(tmp_path / "x.c3d")
    for code, error, message in (
        (-11, b"", "the file is damaged, and the C3D library crashed"),
        (1, b"noise\nno \x1b[2Jparameters\n", r"no \[2Jparameters"),
    ):
        done = subprocess.CompletedProcess("", code, b"", error)
        with monkeypatch.context() as patch:
            patch.setattr(subprocess, "run", lambda *_, done=done, **__: done)
            with pytest.raises(InputError, match=message):
                c3d.read(path)


def test_modules_of_working_folder_are_not_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_c3d(tmp_path / "x.c3d")
    (tmp_path / "ezc3d.py").write_text("raise SystemExit('from the working folder')")
    monkeypatch.chdir(tmp_path)
    assert len(c3d.read(path).plates) == 1


@pytest.mark.skipif(not hasattr(signal, "alarm"), reason="this system cannot end a process like that")
def test_reader_process_ends_by_itself(tmp_path: Path) -> None:
    (tmp_path / "ezc3d.py").write_text("while True:\n    pass\n")
    path = os.pathsep.join([str(tmp_path), *filter(None, sys.path)])
    command = [sys.executable, "-P", "-m", "klute_sim.mocap.formats.c3d_process", "walk.c3d", "1", str(os.getpid())]
    done = subprocess.run(command, env={**os.environ, "PYTHONPATH": path}, timeout=30, check=False)
    assert done.returncode == -signal.SIGALRM


def test_reader_timeout_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = write_c3d(tmp_path / "a.c3d")
    monkeypatch.setattr(isolation, "STARTUP_TIMEOUT", 0.0)
    with pytest.raises(InputError, match=r"a\.c3d cannot be read as C3D within 0 s: the file is damaged$"):
        c3d.read(file)


LIBRARIES = {
    "busy": ("while True: pass", "in reasonable time: the file is damaged"),
    "greedy": ("bytearray(700_000_000)", "MemoryError"),
}
"""Name -> what a library does with the file, and what the error says."""


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems limit neither time nor memory so")
@pytest.mark.parametrize("name", LIBRARIES)
def test_small_file_gets_little_time_and_memory(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    action, message = LIBRARIES[name]
    file = write_c3d(tmp_path / "a.c3d")
    (tmp_path / "library").mkdir()
    (tmp_path / "library" / "ezc3d.py").write_text(f"def c3d(*_, **__):\n    {action}\n")
    monkeypatch.syspath_prepend(tmp_path / "library")
    monkeypatch.setattr(isolation, "STARTUP_TIMEOUT", 300.0)  # the limits of the process itself must end it
    with pytest.raises(InputError, match=rf"a\.c3d cannot be read as C3D.*{message}"):
        c3d.read(file)
