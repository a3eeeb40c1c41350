"""MAT-files of version 7.3: HDF5 files as MATLAB writes them, made here with h5py."""

import importlib.util
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from klute_sim.errors import InputError, MissingExtraError
from klute_sim.files import isolation
from klute_sim.files.mat.opening import open_mat

HEADER = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
X = np.arange(5.0)

needs_h5py = pytest.mark.skipif(importlib.util.find_spec("h5py") is None, reason="needs the extra mat")


def write(path: Path) -> bytes:
    """Write arrays as MATLAB does: transposed, with the class as an attribute, after a header of 512 bytes."""
    import h5py

    def add(group: Any, name: str, values: np.ndarray, matlab_class: str, **options: Any) -> None:
        item = group.create_dataset(name, data=np.atleast_2d(values).T, **options)
        item.attrs["MATLAB_class"] = np.bytes_(matlab_class)

    with h5py.File(path, "w", userblock_size=512) as file:
        add(file, "x", X, "double")
        add(file, "counts", np.arange(1000, dtype="i2"), "int16", chunks=(100, 1), compression="gzip")
        add(file, "data", np.arange(30.0).reshape(10, 3), "double")
        add(file, "note", np.frombuffer("text".encode("utf-16-le"), "u2"), "char")
        run = file.create_group("run")
        run.attrs["MATLAB_class"] = np.bytes_("struct")
        add(run, "force", 2 * X, "single")
        add(run, "T", np.zeros(6, "u4"), "table")
        cell = file.create_dataset("cell", (2, 1), dtype=h5py.ref_dtype)
        cell.attrs["MATLAB_class"] = np.bytes_("cell")
        empty = file.create_dataset("empty", data=np.array([0, 0], "u8"))
        empty.attrs["MATLAB_class"], empty.attrs["MATLAB_empty"] = np.bytes_("double"), np.uint8(1)
        file["outside"] = h5py.ExternalLink("/etc/passwd", "x")
        file["itself"] = file["/"]
        file.create_group("#refs#").create_dataset("a", data=X)
    content = path.read_bytes()
    return HEADER + content[len(HEADER) :]


@needs_h5py
def test_arrays_of_numbers_have_their_names_in_matlab(tmp_path: Path) -> None:
    names = ["x", "counts", "run.force", "data(:,3)", "empty"]
    file = open_mat(write(tmp_path / "x.mat"), "x", names)
    columns = file.read_columns([file.headings.index(name) for name in names])
    for values, expected in zip(columns, (X, np.arange(1000), 2 * X, np.arange(2.0, 30.0, 3.0), []), strict=True):
        assert values.tolist() == list(expected)
    unreadable = file.contents.unreadable
    assert unreadable["note"] == "text"
    assert unreadable["run.T"] == "an object, such as a table or a string"
    assert unreadable["cell"] == "a cell array"
    assert unreadable["outside"] == "a link"
    assert unreadable["itself.itself.itself.itself"] == "a struct that is nested too deeply"
    assert not any(name.startswith("#") for name in file.headings)


def test_missing_library_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("klute_sim.files.mat.hdf5.find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"reading MAT-files of version 7.3 needs the optional extra 'mat'"):
        open_mat(HEADER.ljust(512, b"\0") + b"\x89HDF\r\n\x1a\n", "x")


@needs_h5py
def test_bombs_are_refused(tmp_path: Path) -> None:
    import h5py

    with h5py.File(tmp_path / "x.mat", "w", userblock_size=512) as file:
        file.create_dataset("zeros", (1, 10**9), "f8", chunks=(1, 10**6), compression="gzip")
    content = (tmp_path / "x.mat").read_bytes()
    with pytest.raises(InputError, match=r"its columns have 1,000,000,000 values; allowed: up to 32,000,000"):
        open_mat(content, "x", ["zeros"])


@needs_h5py
@pytest.mark.slow
def test_damaged_files_are_refused_or_harmless(tmp_path: Path) -> None:
    intact = write(tmp_path / "x.mat")
    rng = random.Random(6)
    n_refused = 0
    for _ in range(60):
        damaged = bytearray(intact)
        for _ in range(3):
            damaged[rng.randrange(512, 6000)] = rng.randrange(256)
        cut = rng.choice((len(damaged), rng.randrange(600, len(damaged))))
        try:
            open_mat(bytes(damaged[:cut]), "x", ["x", "counts"])
        except InputError:
            n_refused += 1
    assert n_refused > 5


@needs_h5py
def test_time_limit_is_that_of_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    content = write(tmp_path / "x.mat")
    monkeypatch.setattr(isolation, "STARTUP_TIMEOUT", 0.0)
    with pytest.raises(InputError, match=r"cannot be read as MAT-file of version 7\.3 within 0 s: the file is damaged"):
        open_mat(content, "x")
