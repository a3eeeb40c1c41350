"""Read a MAT-file of version 7.3 in a separate process, from standard input.

``python -m klute_sim.files.mat.hdf5_process ARRAY ... SECONDS PARENT``; see :mod:`klute_sim.files.isolation`. Only
arrays of numbers inside the file are read: no links to other files, no external storage and no plug-ins.
"""

import importlib
import io
import json
import os
import sys
from typing import Any

import numpy as np

from klute_sim.files.isolation import MemoryLimit, read_and_reply
from klute_sim.files.limits import MAX_VALUES
from klute_sim.files.mat.contents import MAX_ARRAYS, MAX_DECOMPRESSED_BYTES, MAX_STRUCT_DEPTH

MEMORY_LIMIT = MemoryLimit(fixed=100_000_000 + 3 * MAX_DECOMPRESSED_BYTES, per_file_byte=4)
"""Memory for reading a file: the largest arrays, and their copy in the reply (assumed)."""
_NUMBER_CLASSES = frozenset(b"double single logical int8 int16 int32 int64 uint8 uint16 uint32 uint64".split())
_OTHER_CLASSES = {
    **{b"char": "text", b"cell": "a cell array", b"struct": "an array of structs"},
    b"function_handle": "a function handle",
}
"""MATLAB's name of a class that is not read -> what it is."""


class _Finder:
    """Finds the arrays of a file."""

    def __init__(self, library: Any) -> None:
        self.library = library
        self.arrays: dict[str, Any] = {}
        self.unreadable: dict[str, str] = {}
        self.n_links = 0

    def search(self, group: Any, prefix: str, depth: int) -> None:
        """Add the arrays in ``group``, whose names begin with ``prefix``."""
        for key in group:
            self.n_links += 1
            if self.n_links > MAX_ARRAYS:
                raise ValueError(f"it has more than {MAX_ARRAYS:,} arrays")
            if key.startswith("#"):  # what cells and objects refer to
                continue
            name = f"{prefix}{key}"
            if not isinstance(group.get(key, getlink=True), self.library.HardLink):
                self.unreadable[name] = "a link"
                continue
            item = group[key]
            if isinstance(item, self.library.Group):
                if depth + 1 < MAX_STRUCT_DEPTH:
                    self.search(item, f"{name}.", depth + 1)
                else:
                    self.unreadable[name] = "a struct that is nested too deeply"
            else:
                self._add(item, name)

    def _add(self, item: Any, name: str) -> None:
        is_array = isinstance(item, self.library.Dataset)
        kind = bytes(item.attrs.get("MATLAB_class", b"double")) if is_array else b""
        if not is_array or kind not in _NUMBER_CLASSES or "MATLAB_sparse" in item.attrs:
            self.unreadable[name] = _OTHER_CLASSES.get(kind, "an object, such as a table or a string")
        elif item.dtype.kind not in "biuf" or item.is_virtual or item.external:
            self.unreadable[name] = (
                f"of type {item.dtype}" if item.dtype.kind not in "biuf" else "stored in other files"
            )
        else:
            self.arrays[name] = item


def read_arrays(library: Any, content: bytes, names: list[str]) -> dict[str, Any]:
    """Return the arrays in ``names``, and all shapes in MATLAB's order as JSON under ``metadata``."""
    with library.File(io.BytesIO(content), "r") as file:
        finder = _Finder(library)
        finder.search(file, "", 0)
        shapes = {name: _get_shape(item) for name, item in finder.arrays.items()}
        folded = {name.casefold() for name in names}
        read = [name for name in finder.arrays if name.casefold() in folded]
        n_values = sum(finder.arrays[name].size for name in read)
        if n_values > MAX_VALUES:
            raise ValueError(f"its columns have {n_values:,} values; allowed: up to {MAX_VALUES:,}")
        metadata = {"shapes": shapes, "unreadable": finder.unreadable, "read": read}
        # HDF5 stores the transpose of MATLAB's array by rows, which is MATLAB's array by columns.
        arrays = {f"array{number}": _read_values(finder.arrays[name]) for number, name in enumerate(read)}
    return {"metadata": np.array(json.dumps(metadata)), **arrays}


def _get_shape(item: Any) -> list[int]:
    if "MATLAB_empty" in item.attrs:
        return [0, 0]
    shape = list(item.shape)[::-1]
    return shape + [1] * (2 - len(shape))


def _read_values(item: Any) -> Any:
    return np.empty(0) if "MATLAB_empty" in item.attrs else np.asarray(item[()]).reshape(-1)


def main() -> None:
    """Read the file at standard input, and the arrays that the command line names."""
    os.environ["HDF5_PLUGIN_PRELOAD"] = "::"  # no plug-ins
    content = sys.stdin.buffer.read()
    read_and_reply(
        lambda: read_arrays(importlib.import_module("h5py"), content, sys.argv[1:-2]),
        lambda: importlib.import_module("h5py"),
        len(content),
        MEMORY_LIMIT,
    )


if __name__ == "__main__":
    main()
