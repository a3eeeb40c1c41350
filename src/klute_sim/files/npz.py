"""Read NumPy archives (``.npz``): arrays of numbers and text within a memory limit, never pickles."""

import io
import math
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from klute_sim.errors import InputError
from klute_sim.files.limits import MAX_ARCHIVE_ENTRIES, FileKind
from klute_sim.files.reading import read_bytes

_COMPRESSIONS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_MAX_HEADER_BYTES = 10_000
"""Longest header of an array [bytes]; NumPy's own limit."""


def read_npz(path: str | Path, kind: FileKind) -> dict[str, NDArray[Any]]:
    """Return the arrays of the archive at ``path`` by name; raise InputError when it is not one or is too large."""
    return parse_npz(read_bytes(path, kind), kind.describe(path), kind.max_bytes)


def parse_npz(content: bytes, description: str, max_bytes: int) -> dict[str, NDArray[Any]]:
    """Return the arrays of the archive ``content``, which hold up to ``max_bytes`` altogether.

    Raises InputError when ``content`` is not an archive of plain arrays, or is too large once it is decompressed.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = archive.infolist()
            _check_sizes(entries, description, max_bytes)
            return {entry.filename.removesuffix(".npy"): _read_array(archive, entry) for entry in entries}
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, ValueError, NotImplementedError, RuntimeError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"{description} is not an archive of NumPy arrays: {reason}") from None


def _check_sizes(entries: list[zipfile.ZipInfo], description: str, max_bytes: int) -> None:
    total = sum(entry.file_size for entry in entries)
    if len(entries) > MAX_ARCHIVE_ENTRIES or total > max_bytes:
        raise InputError(
            f"{description} holds {len(entries)} arrays of {total / 1e6:.4g} MB; allowed: up to {MAX_ARCHIVE_ENTRIES} "
            f"arrays of {max_bytes / 1e6:.4g} MB"
        )


def _read_array(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> NDArray[Any]:
    if entry.compress_type not in _COMPRESSIONS:
        raise ValueError(f"the entry {entry.filename[:40]!r} has another compression than deflate")
    with archive.open(entry) as file:
        data = file.read(entry.file_size)  # zipfile never returns more than the size it states
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version not in readers:
        raise ValueError(f"the array {entry.filename[:40]!r} has format {version}")
    shape, _, dtype = readers[version](stream, max_header_size=_MAX_HEADER_BYTES)
    if dtype.kind not in "biufU":
        raise ValueError(f"the array {entry.filename[:40]!r} holds {dtype}; allowed: numbers and text")
    if any(size < 0 for size in shape) or math.prod(shape) * dtype.itemsize != len(data) - stream.tell():
        raise ValueError(f"the array {entry.filename[:40]!r} states shape {shape}, which its data does not fill")
    stream.seek(0)
    array: NDArray[Any] = np.lib.format.read_array(stream, allow_pickle=False, max_header_size=_MAX_HEADER_BYTES)
    return array
