"""Writer of trial files."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
from numpy.typing import NDArray

from klute_sim.errors import InputError
from klute_sim.recording.atomic_file import replace_atomically
from klute_sim.recording.recording import split_heading


def write_trial(path: str | Path, columns: Mapping[str, NDArray[np.floating[Any]]]) -> None:
    """Write ``columns`` (``name [unit]`` -> samples) to ``path`` as CSV; NaN becomes an empty cell.

    Reading restores all numbers exactly. The file is written completely or not at all. Raises InputError for a heading
    of another form, for columns of different lengths, and for a ``path`` that cannot be written.
    """
    path = Path(path)
    arrays = []
    for heading, samples in columns.items():
        split_heading(heading)
        array = np.asarray(samples, dtype=np.float64)
        if array.ndim != 1 or len(array) != len(next(iter(columns.values()))):
            raise InputError(f"column '{heading}' has shape {array.shape}; all columns need the same number of samples")
        arrays.append(pa.array(array, from_pandas=True))
    table = pa.table(arrays, names=[str(index) for index in range(len(arrays))])
    try:
        with replace_atomically(path) as temporary, temporary.open("wb") as file:
            file.write((",".join(columns) + "\n").encode())
            pyarrow.csv.write_csv(table, file, pyarrow.csv.WriteOptions(include_header=False))
    except OSError as error:
        raise InputError(f"trial file {path} cannot be written: {error.strerror or error}") from None
