"""Read and write recordings as Parquet.

Columns are called ``name [unit]``. The metadata of a column holds its unit, the metadata of the schema the provenance.
"""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from klute_sim.errors import InputError
from klute_sim.recording.recording import Recording

_METADATA_KEY = b"klute_sim"


def write_recording(recording: Recording, path: Path) -> None:
    """Write ``recording`` to ``path``; equal recordings give equal bytes."""
    fields = [
        pa.field(recording.format_heading(name), pa.float64(), metadata={"unit": recording.units[name]})
        for name in recording.channels
    ]
    provenance = json.dumps(recording.provenance, sort_keys=True)
    schema = pa.schema(fields, metadata={_METADATA_KEY: provenance.encode()})
    table = pa.table(list(recording.channels.values()), schema=schema)
    pq.write_table(table, path, compression="zstd")


def load_recording(path: str | Path) -> Recording:
    """Return the recording in ``path``.

    Raises InputError when ``path`` is not a Parquet file with numeric ``name [unit]`` columns.
    """
    try:
        table = pq.read_table(path)
    except (OSError, pa.ArrowException) as error:
        raise InputError(f"recording {path} cannot be read: {error}") from None
    stored = (table.schema.metadata or {}).get(_METADATA_KEY, b"{}")
    columns = []
    for heading, column in zip(table.column_names, table.columns, strict=True):
        try:
            columns.append((heading, column.to_numpy().astype(np.float64)))
        except (TypeError, ValueError, pa.ArrowException):
            raise InputError(f"recording {path}: column '{heading}' is not numeric") from None
    return Recording.from_columns(columns, json.loads(stored))
