"""Open a trial file of any kind: Parquet, MAT-file or delimited text."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from klute_sim.datasets.trial_files import text
from klute_sim.files.limits import TRIAL
from klute_sim.files.mat.hdf5 import is_hdf5
from klute_sim.files.mat.opening import MAT_MAGIC, open_mat
from klute_sim.files.parquet import MAGIC as PARQUET_MAGIC
from klute_sim.files.parquet import open_parquet
from klute_sim.types import Array

PARQUET_SUFFIXES, MAT_SUFFIXES = (".parquet", ".pq"), (".mat",)


@dataclass(frozen=True, eq=False)
class ColumnSource:
    """An open trial file whose columns are decoded on demand."""

    headings: Sequence[str]
    """Headings of the columns."""
    read_columns: Callable[[Sequence[int]], list[Array]]
    """Returns the columns with these indices as numbers, NaN where there is none."""
    locate_row: Callable[[int], str]
    """Maps the index of a row to its location in the file, such as ``line 17``."""
    has_units: bool = True
    """Whether headings can state units; names in MATLAB cannot, so all columns need ``[columns]``."""
    unreadable: Mapping[str, str] = field(default_factory=dict)
    """Name of what cannot be a column -> what it is."""
    remarks: tuple[str, ...] = ()
    """Remarks for the user, one sentence each."""


def open_source(
    content: bytes,
    path: Path,
    heading_row: int | None,
    is_known: Callable[[str], bool],
    names: Collection[str],
) -> ColumnSource:
    """Open the file at ``path`` with the given ``content``; raises InputError when it cannot be read.

    ``heading_row`` is the line of the heading of a text; without it, the line with most headings that satisfy
    ``is_known``. ``names`` are those of the columns in expressions.
    """
    source, suffix = str(path), path.suffix.lower()
    if content.startswith(PARQUET_MAGIC) or suffix in PARQUET_SUFFIXES:
        table = open_parquet(content, TRIAL.describe(source))
        return ColumnSource(table.headings, table.read_columns, _describe_row)
    if content.startswith(MAT_MAGIC) or is_hdf5(content) or suffix in MAT_SUFFIXES:
        mat = open_mat(content, TRIAL.describe(source), names)
        unreadable = mat.contents.unreadable
        return ColumnSource(mat.headings, mat.read_columns, _describe_row, has_units=False, unreadable=unreadable)
    file = text.parse_delimited_text(content, source, heading_row, is_known)
    remark = f"trial file {source}: line {file.heading_line} is read as the heading (heading_row changes this)"
    return ColumnSource(
        file.headings,
        file.read_columns,
        file.locate_row,
        remarks=(remark,) if file.has_unexpected_preamble else (),
    )


def _describe_row(row: int) -> str:
    return f"row {row + 1}"
