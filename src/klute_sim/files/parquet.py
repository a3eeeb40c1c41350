"""Read numeric columns of Parquet files; the footer shows what a file decodes to before it is decoded.

A small file can hold billions of values, since repeated values and compressed pages take almost no space.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from klute_sim.errors import InputError
from klute_sim.files.limits import MAX_DECODED_BYTES, MAX_TEXT_VALUES, MAX_VALUES, MB
from klute_sim.files.lines import check_column_count
from klute_sim.types import Array

MAGIC = b"PAR1"
"""First and last bytes of a Parquet file."""
MAX_FOOTER_BYTES = 16 * MB
"""Largest footer [bytes]: the description of all columns in all row groups."""
MAX_ROW_GROUPS = 10_000
"""Largest number of row groups."""
_ERRORS = (pa.ArrowException, OSError, ValueError, KeyError)


@dataclass(frozen=True, eq=False)
class ParquetTable:
    """A Parquet file whose footer was checked; columns are decoded on demand."""

    description: str
    """File in error messages."""
    headings: tuple[str, ...]
    """Names of the columns."""
    metadata: dict[bytes, bytes]
    """Metadata of the schema."""
    _file: pq.ParquetFile

    def read_column(self, index: int) -> Array:
        """Return the column with that index; an empty cell becomes NaN. Raises InputError unless it holds numbers."""
        heading, column_type = self.headings[index], self._file.schema_arrow.field(index).type
        predicates = (pa.types.is_integer, pa.types.is_floating, pa.types.is_decimal)
        if not any(matches(column_type) for matches in predicates):
            raise InputError(
                f"{self.description}: column '{heading}' holds {column_type}; allowed: numbers in the unit of the "
                "heading"
            )
        column = self._decode(index)
        try:
            return np.asarray(column.cast(pa.float64(), safe=False).to_numpy(), dtype=np.float64)
        except _ERRORS as error:
            raise self._column_error(heading, error) from None

    def read_columns(self, indices: Sequence[int]) -> list[Array]:
        """Return the columns with these indices; see :meth:`read_column`."""
        return [self.read_column(index) for index in indices]

    def read_rows(self) -> list[dict[str, Any]]:
        """Return all rows of a small table of numbers and text; raises InputError for other columns."""
        for heading, field in zip(self.headings, self._file.schema_arrow, strict=True):
            if pa.types.is_nested(field.type):
                raise InputError(
                    f"{self.description}: column '{heading}' holds {field.type}; allowed: numbers and text"
                )
        columns = [self._decode(index) for index in range(len(self.headings))]
        try:
            size = sum(_measure_text(column) for column in columns)
            if size > MAX_DECODED_BYTES:
                raise _size_error(self.description, size)
            values = [column.to_pylist() for column in columns]
        except _ERRORS as error:
            raise InputError(f"{self.description} cannot be read: {_first_line(error)}") from None
        return [dict(zip(self.headings, row, strict=True)) for row in zip(*values, strict=True)]

    def _decode(self, index: int) -> Any:
        heading = self.headings[index]
        try:
            return self._file.reader.read_column(index)
        except _ERRORS as error:
            raise self._column_error(heading, error) from None

    def _column_error(self, heading: str, error: Exception) -> InputError:
        return InputError(f"{self.description}: column '{heading}' cannot be read: {_first_line(error)}")


def open_parquet(content: bytes, description: str, *, with_text: bool = False) -> ParquetTable:
    """Open the Parquet file ``content``; ``description`` names it in errors, ``with_text`` allows columns of text.

    Raises InputError when it is no Parquet file, or when it decodes to more than the limits allow.
    """
    if not content:
        raise InputError(f"{description} is empty")
    footer_bytes = int.from_bytes(content[-8:-4], "little")
    if content[-4:] != MAGIC or content[:4] != MAGIC or footer_bytes > min(len(content) - 12, MAX_FOOTER_BYTES):
        raise InputError(f"{description} is not a Parquet file: it has no valid footer, as after an incomplete copy")
    try:
        footer = _open(content, []).metadata
        schema = footer.schema.to_arrow_schema()
        _check_footer(footer, len(schema), MAX_TEXT_VALUES if with_text else MAX_VALUES, description)
        # Text stays in its dictionary while it is decoded: a repeated text takes no space in the file.
        file = _open(content, [field.name for field in schema if with_text and _holds_text(field.type)])
        return ParquetTable(description, tuple(schema.names), dict(schema.metadata or {}), file)
    except _ERRORS as error:
        raise InputError(f"{description} is not a Parquet file: {_first_line(error)}") from None


def _open(content: bytes, text_columns: list[str]) -> pq.ParquetFile:
    return pq.ParquetFile(
        pa.BufferReader(content),
        pre_buffer=False,
        read_dictionary=text_columns,
        thrift_string_size_limit=MAX_FOOTER_BYTES,
        thrift_container_size_limit=1_000_000,
    )


def _holds_text(column_type: pa.DataType) -> bool:
    return bool(pa.types.is_string(column_type) or pa.types.is_binary(column_type))


def _check_footer(footer: Any, n_columns: int, max_values: int, description: str) -> None:
    check_column_count(max(n_columns, footer.num_columns), description)
    n_values = footer.num_rows * n_columns
    if not 0 <= n_values <= max_values or footer.num_row_groups > MAX_ROW_GROUPS:
        raise InputError(
            f"{description} has {footer.num_rows} rows of {n_columns} columns in {footer.num_row_groups} row groups; "
            f"allowed: up to {max_values:,} values"
        )
    n_rows = size = 0
    for number in range(footer.num_row_groups):
        group = footer.row_group(number)
        n_rows += group.num_rows
        size += max(group.total_byte_size, 0)  # the description of a column may abort the process if it is damaged
    if size > MAX_DECODED_BYTES:
        raise _size_error(description, size)
    if n_rows != footer.num_rows:
        raise InputError(f"{description} is damaged: its row groups have {n_rows} rows, its footer {footer.num_rows}")


def _size_error(description: str, size: int) -> InputError:
    return InputError(f"{description} decodes to {size / MB:.4g} MB; allowed: up to {MAX_DECODED_BYTES / MB:g} MB")


def _measure_text(column: Any) -> int:
    """Return an upper bound of the memory of ``column`` as Python text [bytes]; 0 for numbers."""
    dictionaries = [chunk.dictionary for chunk in column.chunks if pa.types.is_dictionary(chunk.type)]
    longest = max((len(text or "") for texts in dictionaries for text in texts.to_pylist()), default=0)
    return longest * len(column)


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
