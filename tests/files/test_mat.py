"""MAT-files: equal to what SciPy reads, real files, and damage, bombs and other content in one sentence."""

import io
import os
import random
import struct
import zlib
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from klute_sim.errors import InputError
from klute_sim.files.mat.contents import MatFile
from klute_sim.files.mat.opening import open_mat

X = np.arange(5.0)
RNG = np.random.default_rng(1)


def write(content: Mapping[str, Any], *, compress: bool = True, **options: Any) -> bytes:
    stream = io.BytesIO()
    savemat(stream, dict(content), do_compression=compress, **options)
    return stream.getvalue()


def read(content: bytes) -> dict[str, np.ndarray]:
    file = open_mat(content, "trial file x.mat")
    return dict(zip(file.headings, file.read_columns(range(len(file.headings))), strict=True))


def read_error(content: bytes) -> str:
    with pytest.raises(InputError) as caught:
        read(content)
    sentence = str(caught.value)
    assert sentence.startswith("trial file x.mat")
    return sentence


@pytest.mark.parametrize("compress", [False, True])
@pytest.mark.parametrize("dtype", ["f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "?"])
@pytest.mark.parametrize("oned_as", ["row", "column"])
def test_vectors_of_any_number_type_are_read_exactly(dtype: str, compress: bool, oned_as: str) -> None:
    values = (100 * RNG.random(50)).astype(dtype)
    result = read(write({"x": values, "fs": 1000}, compress=compress, oned_as=oned_as))
    assert list(result) == ["x", "fs"]
    assert result["x"].dtype == np.float64
    assert np.array_equal(result["x"], values.astype(float))
    assert result["fs"].tolist() == [1000.0]


@pytest.mark.parametrize("compress", [False, True])
def test_fields_of_structs_have_dotted_names(compress: bool) -> None:
    content = {"run": {"force": X, "note": "text", "raw": {"counts": X.astype("i2"), "rate": 5.0}}}
    result = read(write(content, compress=compress))
    assert list(result) == ["run.force", "run.raw.counts", "run.raw.rate"]
    assert result["run.raw.counts"].tolist() == X.tolist()


def test_columns_and_rows_of_matrices_are_selected_as_in_matlab() -> None:
    matrix = RNG.random((30, 3))
    result = read(write({"data": matrix, "wide": matrix.T}))
    assert list(result) == [*(f"data(:,{k})" for k in (1, 2, 3)), *(f"wide({k},:)" for k in (1, 2, 3))]
    for k in range(3):
        assert np.array_equal(result[f"data(:,{k + 1})"], matrix[:, k])
        assert np.array_equal(result[f"wide({k + 1},:)"], matrix[:, k])


def test_big_endian_files_are_read() -> None:
    def element(kind: int, data: bytes) -> bytes:
        return struct.pack(">2I", kind, len(data)) + data + bytes(-len(data) % 8)

    parts = element(6, struct.pack(">2I", 6, 0)) + element(5, struct.pack(">2i", 3, 1)) + element(1, b"force")
    array = element(14, parts + element(9, struct.pack(">3d", 1.5, 2.0, -3.0)))
    header = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack(">H", 0x0100) + b"MI"
    assert {name: values.tolist() for name, values in read(header + array).items()} == {"force": [1.5, 2.0, -3.0]}


def test_other_content_is_named_and_does_not_disturb() -> None:
    cell = np.empty(2, dtype=object)
    cell[:] = ["a", X]
    structs = np.zeros(2, dtype=[("a", "O")])
    content = {"cell": cell, "note": "text", "z": 1j * X, "s": structs, "image": np.zeros((99, 99)), "x": X}
    file = open_mat(write(content), "x")
    assert file.headings == ("x",)
    assert file.contents.unreadable == {
        "cell": "a cell array",
        "note": "text",
        "z": "a complex array",
        "s": "an array of structs",
        "image": "an array of size 99x99; columns are vectors, or parts of a matrix",
    }


def with_class(array_class: int) -> MatFile:
    content = bytearray(write({"x": X}, compress=False))
    content[128 + 16] = array_class  # the flags follow the tags of the array and of the flags
    return open_mat(bytes(content), "x")


@pytest.mark.parametrize(
    ("array_class", "name"),
    [(3, "an object"), (16, "a function handle"), (5, "a sparse matrix"), (99, "of the unknown class 99")],
)
def test_classes_that_could_hold_code_are_never_built(array_class: int, name: str) -> None:
    file = with_class(array_class)
    assert (file.headings, file.contents.unreadable) == ((), {"x": name})


def test_matrix_is_refused_with_its_parts() -> None:
    assert open_mat(write({"data": np.zeros((9, 2))}), "x").contents.unreadable == {
        "data": "a matrix of size 9x2; name one part of it, data(:,1) to data(:,2)"
    }


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is not a MAT-file: it has 0 bytes; its header has 128"),
        (b"MATLAB 5.0" + bytes(200), "is not a MAT-file of version 5 or later; write it in MATLAB with save"),
        (write({"x": X}, format="4"), "is not a MAT-file"),
        (write({"x": X})[:150], "is not a valid MAT-file: it ends within a variable, as after an incomplete copy"),
        (write({"x": RNG.random(500)})[:-80], "it ends within a variable"),
        (write({"x": X}).replace(b"\x00\x01IM", b"\x00\x03IM"), "has version 3.0 of the MAT-file; allowed: 5 to 7.3"),
        (write({"x": X}).replace(b"\x00\x01IM", b"\x00\x02IM"), "has version 2.0 of the MAT-file; allowed: 5 to 7.3"),
        (write({"x": X})[:136] + bytes(9) + write({"x": X})[145:], "is not a valid MAT-file: Error -3 while decom"),
    ],
)  # fmt: skip
def test_other_files_are_refused(content: bytes, message: str) -> None:
    assert message in read_error(content)


def _compressed_array(stated_bytes: int, n_zeros: int, shape: tuple[int, int], *, array_class: int = 6) -> bytes:
    parts = struct.pack("<2I2I", 6, 8, array_class, 0) + struct.pack("<2I2i", 5, 8, *shape)
    parts += struct.pack("<2H4s", 1, 1, b"x") + struct.pack("<2I", 9, n_zeros)
    data = zlib.compress(struct.pack("<2I", 14, stated_bytes) + parts + bytes(n_zeros))
    header = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    return header + struct.pack("<2I", 15, len(data)) + data


def test_sizes_are_checked_before_anything_is_decompressed() -> None:
    assert "decodes to 4000 MB or more; allowed: up to 256 MB" in read_error(_compressed_array(4 * 10**9, 80, (10, 1)))
    assert "'x' has 500,000,000 values; allowed: up to 32,000,000" in read_error(
        _compressed_array(136, 80, (500_000_000, 1))
    )
    assert "the numbers of 'x' do not fill its size" in read_error(_compressed_array(136, 80, (11, 1)))
    larger_than_stated = _compressed_array(136, 20_000_000, (10, 1))
    assert "it ends within a variable" in read_error(larger_than_stated)


def test_many_values_in_all_columns_are_refused() -> None:
    data = write({name: np.zeros(11_000_000, np.int8) for name in "abc"})
    assert "its columns have 33,000,000 values; allowed: up to 32,000,000" in read_error(data)


@pytest.mark.parametrize("compress", [False, True])
def test_random_damage_is_refused_or_harmless(compress: bool) -> None:
    content = {"run": {"force": X, "raw": {"counts": X.astype("i2")}}, "data": RNG.random((20, 2)), "note": "text"}
    intact = write(content, compress=compress)
    rng = random.Random(3)
    n_refused = 0
    for _ in range(2000):
        damaged = bytearray(intact)
        for _ in range(rng.choice((1, 1, 3))):
            damaged[rng.randrange(120, len(damaged))] = rng.choice((0, 1, 14, 255, rng.randrange(256)))
        try:
            read(bytes(damaged))
        except InputError:
            n_refused += 1
    assert 100 < n_refused < 2000


def find_real_files() -> list[Path]:
    folder = Path(os.environ.get("KLUTE_SIM_DATA", "/nonexistent"))
    return sorted(folder.glob("pam_fill_tests/*.mat")) + sorted(folder.glob("prosthetic_foot_desr/*.mat"))


@pytest.mark.extras
def test_real_files_are_read_as_scipy_reads_them() -> None:
    files = find_real_files()
    if not files:
        pytest.skip("set KLUTE_SIM_DATA to the folder of the measured data")
    for path in files:
        expected = loadmat(path, simplify_cells=True)
        for name, values in read(path.read_bytes()).items():
            variable, _, selection = name.partition("(")
            value: Any = expected
            for part in variable.split("."):
                value = value[part]
            reference = value[:, int(selection[2:-1]) - 1] if selection else value
            assert np.array_equal(values, reference)


def test_no_other_exception_for_any_bytes_after_the_header() -> None:
    header = write({})[:128]
    rng = random.Random(4)
    for _ in range(2000):
        with suppress(InputError):
            read(header + rng.randbytes(rng.randrange(100)))
