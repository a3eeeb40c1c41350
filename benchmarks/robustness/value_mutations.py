"""Mutations of what a file says, after which it is still well formed: other units, signs, columns, types and shapes."""

import io
import json
import random
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from benchmarks.robustness import expression_files
from benchmarks.robustness.mat_mutations import change_mat

FACTORS = (1e3, 1e-3, -1.0, 0.0, 57.29578, 0.0174533, 1e5, 1e-5, 1e15, 1e300, 1e-300)
"""Factors of values: wrong units, signs and magnitudes."""
ODD_VALUES: tuple[Any, ...] = (
    *(float("nan"), float("inf"), -1, 0, 10**18, 10**400, 1e308, True, None, "", "x", "\x1b[31m", "\u202e", [], {}),
    *([[[[1.0]]]], {"a": {"b": 1}}, ["x"], 5e-324, "1e5", "../../x", "a\nb"),
)
"""Values that replace others in JSON."""

ODD_PROVENANCE = (b"{}", b"[]", b"{", b"[" * 5000, b"\xff", b'{"a": NaN}', b'{"device": []}')
"""Contents of the metadata in which a recording holds its provenance."""

_TOML_NUMBER = re.compile(rb"(?m)^([\w\".]+ *= *)(-?\d[\d.e+-]*)")
_CELL_DELIMITERS = (b",", b"\t", b";")


def scale_toml_number(content: bytes, rng: random.Random) -> bytes:
    """Return the TOML ``content`` with one number in another unit, of another type or of another size."""
    matches = list(_TOML_NUMBER.finditer(content))
    if not matches:
        return content
    match = rng.choice(matches)
    value = float(match[2]) * rng.choice(FACTORS)
    text = rng.choice(
        (f"{value:.6g}", f"{value:f}"[:300], f"[{value:.6g}]", f'"{value:.6g}"', f"{{ a = {value:.6g} }}")
    )
    return content[: match.start(2)] + text.encode() + content[match.end(2) :]


def change_table(content: bytes, rng: random.Random) -> bytes:
    """Return the text table ``content`` with columns scaled, exchanged, repeated, deleted, or with odd cells."""
    lines = content.split(b"\n")
    delimiter = max(_CELL_DELIMITERS, key=content.count)
    width = max(line.count(delimiter) for line in lines)
    rows = [number for number, line in enumerate(lines) if line.count(delimiter) == width]
    cells = {number: lines[number].split(delimiter) for number in rows}
    first, second, kind = rng.randrange(width + 1), rng.randrange(width + 1), rng.randrange(7)
    factor, start = rng.choice(FACTORS), rng.randrange(len(rows))
    odd = rng.choice((b"nan", b"", b"1e15", b"1e5", b"-1e308", b"0", b"inf"))
    for position, number in enumerate(rows):
        row = cells[number]
        match kind:
            case 0:
                row[first] = _scale(row[first], factor)
            case 1:
                row[first], row[second] = row[second], row[first]
            case 2:
                row.insert(second, row[first])
            case 3:
                del row[first]
            case 4 if position == start:
                row[first] = odd
            case 5 if position >= start > 0:
                row[first] = odd
            case 6 if position > 0:
                row[first] = cells[rows[-position]][first]
        lines[number] = delimiter.join(row)
    return b"\n".join(lines)


def _scale(cell: bytes, factor: float) -> bytes:
    try:
        return f"{float(cell) * factor:.9g}".encode()
    except ValueError:
        return cell


def change_json(content: bytes, rng: random.Random) -> bytes:
    """Return the JSON ``content`` with one value replaced, scaled or deleted."""
    document = json.loads(content)
    slots: list[tuple[Any, Any]] = []
    pending = [document]
    while pending:
        value = pending.pop()
        items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
        for key, item in list(items):
            slots.append((value, key))
            pending.append(item)
    if not slots or rng.random() < 0.05:
        return json.dumps(rng.choice(ODD_VALUES)).encode()
    parent, key = rng.choice(slots)
    value = parent[key]
    if rng.random() < 0.2:
        del parent[key]
    elif isinstance(value, float) and rng.random() < 0.5:
        parent[key] = value * rng.choice(FACTORS)
    else:
        parent[key] = rng.choice(ODD_VALUES)
    return json.dumps(document).encode()


def change_parquet(content: bytes, rng: random.Random) -> bytes:
    """Return the Parquet file ``content`` with a column scaled, of another type, renamed, repeated or deleted."""
    table = pq.read_table(io.BytesIO(content))
    index = rng.randrange(table.num_columns)
    name, values = table.column_names[index], table.column(index).to_numpy().copy()
    changes: tuple[Callable[[], pa.Table], ...] = (
        lambda: table.set_column(index, name, pa.array(values * rng.choice(FACTORS))),
        lambda: table.set_column(index, name, pa.array(values[::-1])),
        lambda: table.set_column(index, name, pa.array([str(value) for value in values])),
        lambda: table.set_column(index, name, pa.array([[float(value)] for value in values])),
        lambda: table.set_column(index, name, pa.array([None] * len(values), pa.float64())),
        lambda: table.set_column(index, name, pa.array(np.nan_to_num(values).clip(-1e9, 1e9).astype(np.int64))),
        lambda: table.append_column(name, pa.array(values)),
        lambda: table.remove_column(index),
        lambda: table.slice(0, rng.choice((0, 1, 2, 3))),
        lambda: table.rename_columns([rng.choice((n, n.upper(), "x", "time [s]")) for n in table.column_names]),
        lambda: table.replace_schema_metadata(
            {"klute_sim": rng.choice((b"{}", b"[]", b"{", b"[" * 5000, b"\xff", b"NaN"))}
        ),
        lambda: pa.concat_tables([table] * rng.choice((2, 30))),
    )
    output = io.BytesIO()
    pq.write_table(rng.choice(changes)(), output, compression=rng.choice(("zstd", "snappy", "gzip", "none")))
    return output.getvalue()


def change_npz(content: bytes, rng: random.Random) -> bytes:
    """Return the NumPy archive ``content`` with an array of another shape, type or content, or without one."""
    with np.load(io.BytesIO(content)) as archive:
        arrays = {name: archive[name] for name in archive.files}
    name = rng.choice(list(arrays))
    array = arrays[name]
    if array.dtype.kind == "U":
        arrays[name] = np.array(change_json(str(array).encode(), rng).decode())
    else:
        shapes: tuple[Callable[[], Any], ...] = (
            lambda: array * rng.choice(FACTORS),
            lambda: array.T,
            lambda: array.reshape(-1),
            lambda: array[..., :0],
            lambda: array[None],
            lambda: array.astype(complex),
            lambda: array.astype(str),
            lambda: np.full_like(array, np.nan),
            lambda: np.zeros((300, 300), np.float16),
            lambda: np.float64(1.0),
        )
        with np.errstate(all="ignore"):
            arrays[name] = rng.choice(shapes)()
    if rng.random() < 0.1:
        del arrays[name]
    output = io.BytesIO()
    rng.choice((np.savez, np.savez_compressed))(output, **arrays)
    return output.getvalue()


VALUE_MUTATIONS = {
    ".toml": scale_toml_number,
    ".csv": change_table,
    ".mot": change_table,
    ".sto": change_table,
    ".trc": change_table,
    ".txt": change_table,
    ".json": change_json,
    ".parquet": change_parquet,
    ".npz": change_npz,
    ".mat": change_mat,
    expression_files.SUFFIX: expression_files.change_expression,
}
"""Mutation of the values by the suffix of the file."""
