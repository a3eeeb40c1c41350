"""Read and write recordings as Parquet.

Columns are called ``name [unit]``. The metadata of a column holds its unit, the metadata of the schema the provenance.
"""

import json
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from klute_sim.errors import InputError
from klute_sim.files.json import parse_json
from klute_sim.files.limits import RECORDING
from klute_sim.files.parquet import open_parquet
from klute_sim.files.reading import decode_text, read_bytes
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
    description = RECORDING.describe(path)
    table = open_parquet(read_bytes(path, RECORDING), description)
    columns = [(heading, table.read_column(index)) for index, heading in enumerate(table.headings)]
    provenance = f"{description}: its provenance"
    stored = parse_json(decode_text(table.metadata.get(_METADATA_KEY, b"{}"), provenance), provenance)
    if not isinstance(stored, dict):
        raise InputError(f"{provenance} is not a JSON object; pass a recording that klute-sim wrote")
    return Recording.from_columns(columns, stored)
