"""What a MAT-file holds: vectors, and columns or rows of matrices, under the names that they have in MATLAB."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from klute_sim.errors import InputError
from klute_sim.files.limits import MAX_COLUMNS, MAX_VALUES, MB
from klute_sim.types import Array

MAX_DECOMPRESSED_BYTES = 256 * MB
"""Largest size of all arrays that are decompressed [bytes]; that of the largest number of values."""
MAX_STRUCT_DEPTH = 4
"""Deepest nesting of structs whose fields are read."""
MAX_ARRAYS = 100_000
"""Largest number of arrays in a file, counting fields of structs."""
MAX_SIGNALS = 64
"""Largest number of columns (or rows) of a matrix that counts as a table of signals (assumed)."""


class Signal(NamedTuple):
    """A vector, or a column or a row of a matrix."""

    array: str
    """Name of the array that it is part of."""
    selection: slice
    """Its values in the array, column by column."""


@dataclass(eq=False)
class MatContents:
    """Names in a MAT-file."""

    description: str
    """File in error messages."""
    signals: dict[str, Signal] = field(default_factory=dict)
    """Vectors, and columns or rows of matrices, by name, such as ``force``, ``run.force`` or ``data(:,3)``."""
    unreadable: dict[str, str] = field(default_factory=dict)
    """Name of any other variable, and of each matrix -> what it is."""
    n_values: dict[str, int] = field(default_factory=dict)
    """Number of values of each array."""

    def add_numbers(self, name: str, shape: Sequence[int]) -> None:
        """Add the array ``name`` with its ``shape`` in MATLAB; raises InputError when it is too large."""
        count = math.prod(shape)
        if count > MAX_VALUES:
            raise InputError(f"{self.description}: '{name}' has {count:,} values; allowed: up to {MAX_VALUES:,}")
        self.n_values[name] = count
        if count == max(shape):
            self.signals[name] = Signal(name, slice(None))
        elif len(shape) > 2 or min(shape) > MAX_SIGNALS or min(shape) == 0:
            size = "x".join(map(str, shape))
            self.unreadable[name] = f"an array of size {size}; columns are vectors, or parts of a matrix"
        else:
            parts = list(_list_signals(name, shape[0], shape[1]))
            self.unreadable[name] = (
                f"a matrix of size {shape[0]}x{shape[1]}; name one part of it, {parts[0][0]} to {parts[-1][0]}"
            )
            for part, selection in parts:
                self.signals[part] = Signal(name, selection)
        if len(self.signals) > MAX_COLUMNS:
            raise InputError(f"{self.description} has more than {MAX_COLUMNS} columns; allowed: up to {MAX_COLUMNS}")


def _list_signals(name: str, n_rows: int, n_columns: int) -> Iterator[tuple[str, slice]]:
    """Yield name and values of the columns of a matrix, or of its rows where it has fewer rows than columns."""
    for number in range(min(n_rows, n_columns)):
        if n_rows >= n_columns:
            yield f"{name}(:,{number + 1})", slice(number * n_rows, (number + 1) * n_rows)
        else:
            yield f"{name}({number + 1},:)", slice(number, None, n_rows)


@dataclass(frozen=True, eq=False)
class MatFile:
    """A MAT-file whose arrays are decoded on demand."""

    contents: MatContents
    """Names in the file."""
    read_array: Callable[[str], Array]
    """Returns the values of the array with that name, column by column, of any type of number."""

    @property
    def headings(self) -> tuple[str, ...]:
        """Names of the signals."""
        return tuple(self.contents.signals)

    def read_columns(self, indices: Sequence[int]) -> list[Array]:
        """Return the signals with these indices; raise InputError when they are too large or the file is damaged."""
        all_signals = list(self.contents.signals.values())
        signals = [all_signals[index] for index in indices]
        n_values = sum(self.contents.n_values[signal.array] for signal in signals)
        if n_values > MAX_VALUES:
            raise InputError(
                f"{self.contents.description}: its columns have {n_values:,} values; allowed: up to {MAX_VALUES:,}"
            )
        return [self.read_array(signal.array)[signal.selection].astype("f8") for signal in signals]
