"""Mutations of MAT-files after which they are still well formed, or are damaged beneath an intact compression."""

import io
import random
import struct
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np
from benchmarks.robustness import byte_mutations
from scipy.io import loadmat, savemat

HEADER_BYTES, MI_COMPRESSED = 128, 15


def change_mat(content: bytes, rng: random.Random) -> bytes:
    """Return the MAT-file ``content`` with other variables, or with damage beneath its compression."""
    if not content.startswith(b"MATLAB"):  # version 7.3 of h5py, whose values are mutated by bytes
        return byte_mutations.overwrite_count(content, rng)
    return rng.choice((_change_variable, _damage_elements))(content, rng)


def _change_variable(content: bytes, rng: random.Random) -> bytes:
    """Return ``content`` with one variable of another shape, type or content."""
    variables = {name: value for name, value in loadmat(io.BytesIO(content)).items() if not name.startswith("__")}
    name = rng.choice(list(variables))
    value = variables[name]
    numbers = value if value.dtype.kind in "biuf" else np.arange(5.0)
    nested: Any = {"a": {"b": {"c": {"d": {"e": numbers}}}}}
    changes: tuple[Callable[[], Any], ...] = (
        lambda: numbers.T,
        lambda: numbers[:0],
        lambda: numbers[:5],
        lambda: numbers * rng.choice((1e3, -1.0, 0.0, 1e300, 1e-300)),
        lambda: np.full_like(numbers, np.nan, dtype=float),
        lambda: numbers * 1j,
        lambda: numbers.astype(rng.choice(("i1", "u1", "i8", "f4", "?"))),
        lambda: numbers[..., np.newaxis],
        lambda: np.zeros((300, 300)),
        lambda: "text" * 1000,
        lambda: nested,
        lambda: np.array([numbers, "x", nested], dtype=object),
        lambda: {"length": numbers, "volts": "text"},
        lambda: np.zeros(3, dtype=[("length", "O"), ("volts", "O")]),
        lambda: 1.0,
    )
    with np.errstate(all="ignore"):
        variables[name] = rng.choice(changes)()
    if rng.random() < 0.1:
        del variables[name]
    output = io.BytesIO()
    savemat(output, variables, do_compression=rng.random() < 0.5)
    return output.getvalue()


def _damage_elements(content: bytes, rng: random.Random) -> bytes:
    """Return ``content`` with wrong bytes or counts in one element, which is compressed again if it was."""
    elements, position = [], HEADER_BYTES
    while position + 8 <= len(content):
        kind, size = struct.unpack_from("<2I", content, position)
        elements.append((kind, content[position + 8 : position + 8 + size]))
        position += 8 + size
    chosen = rng.randrange(len(elements))
    kind, data = elements[chosen]
    data = zlib.decompress(data) if kind == MI_COMPRESSED else data
    for _ in range(rng.choice((1, 1, 3))):
        data = rng.choice((byte_mutations.overwrite_count, byte_mutations.flip_bytes))(data, rng)
    elements[chosen] = kind, zlib.compress(data) if kind == MI_COMPRESSED else data
    return content[:HEADER_BYTES] + b"".join(struct.pack("<2I", kind, len(data)) + data for kind, data in elements)
