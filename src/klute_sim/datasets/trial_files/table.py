"""One trial file: the channels in its columns, converted to SI."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from klute_sim.datasets.trial_files.column_assignment import assign_columns, is_known_heading
from klute_sim.datasets.trial_files.expressions import Expression
from klute_sim.datasets.trial_files.sources import open_source
from klute_sim.errors import InputError
from klute_sim.files.limits import TRIAL
from klute_sim.files.reading import MissingFileError, read_bytes
from klute_sim.types import Array


@dataclass(frozen=True, eq=False)
class Table:
    """The requested columns of one trial file."""

    source: str
    """Path of the file for error messages."""
    columns: Mapping[str, Array]
    """Name -> samples in SI, NaN where the cell is empty; all of equal length."""
    headings: Mapping[str, str]
    """Name -> heading as written, or expression."""
    units: Mapping[str, str]
    """Name -> unit in the heading or the expression."""
    missing: Mapping[str, str]
    """Name -> reason why its expression does not belong to this file."""
    available: tuple[str, ...]
    """Headings of all columns."""
    ignored: tuple[str, ...]
    """Headings of columns that were not requested."""
    remarks: tuple[str, ...]
    """Remarks for the user, one sentence each."""
    digest: str
    """SHA-256 of the file."""
    locate_row: Callable[[int], str]
    """Maps the index of a row to its location in the file, such as ``line 17``."""


def read_trial_file(
    path: Path,
    column_units: Mapping[str, str],
    expressions: Mapping[str, Sequence[Expression]] = MappingProxyType({}),
    heading_row: int | None = None,
) -> Table:
    """Read the columns in ``column_units`` (name -> SI unit) that the file at ``path`` has.

    ``expressions`` (name -> expressions, of which the first applies whose columns the file has) say how columns follow
    from those of the file; other columns have headings ``name [unit]``. ``heading_row`` is the line of the heading of a
    text; by default it is searched for.

    Raises InputError for a file that cannot be read, and for a requested column that has no unit or one of another
    dimension, occurs twice, or has cells that are neither finite numbers nor empty.
    """
    source = str(path)
    content = _read_content(path)
    names = {
        name for alternatives in expressions.values() for expression in alternatives for name in expression.columns
    }
    file = open_source(
        content, path, heading_row, lambda heading: is_known_heading(heading, column_units, expressions), names
    )
    assignments = assign_columns(file, column_units, expressions, source)
    indices = sorted({index for a in assignments.by_channel.values() for index in a.indices.values()})
    raw = dict(zip(indices, file.read_columns(indices), strict=True))
    n_rows = _count_rows({file.headings[index]: samples for index, samples in raw.items()}, source)
    columns = {}
    for name, assignment in assignments.by_channel.items():
        columns[name] = assignment.compute(raw, n_rows, source)
        is_infinite = np.isinf(columns[name])
        if is_infinite.any():
            raise InputError(
                f"trial file {source}: column '{assignment.heading}', {file.locate_row(int(is_infinite.argmax()))}: "
                "the value is infinite; leave the cell of a missing sample empty"
            )
    return Table(
        source=source,
        columns=columns,
        headings={name: assignment.heading for name, assignment in assignments.by_channel.items()},
        units={name: assignment.unit for name, assignment in assignments.by_channel.items()},
        missing=assignments.missing,
        available=tuple(file.headings),
        ignored=assignments.ignored,
        remarks=assignments.remarks,
        digest=hashlib.sha256(content).hexdigest(),
        locate_row=file.locate_row,
    )


def _read_content(path: Path) -> bytes:
    try:
        return read_bytes(path, TRIAL)
    except MissingFileError:
        raise InputError(
            f"trial file {path} does not exist; give paths relative to the folder of dataset.toml"
        ) from None


def _count_rows(columns: Mapping[str, Array], source: str) -> int:
    """Return the number of rows; a column with one value holds for all rows, as a sampling rate in a MAT-file does."""
    lengths = {heading: len(samples) for heading, samples in columns.items() if len(samples) != 1}
    first = next(iter(lengths), "")
    for heading, length in lengths.items():
        if length != lengths[first]:
            raise InputError(
                f"trial file {source}: '{first}' has {lengths[first]} values and '{heading}' {length}; the columns of "
                "one file have one time, so they need the same number of values"
            )
    return lengths[first] if lengths else len(next(iter(columns.values()), ()))
