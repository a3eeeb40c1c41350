"""Read arrays of numbers from MAT-files of versions 5 to 7, the format of MATLAB's ``save``.

Source of the format: MathWorks, "MAT-File Format" (level 5). A file is a sequence of elements, each with a type and a
size; compressed elements hold one other element. Only the headers of all arrays, structs in full, and the arrays that
are asked for are decompressed. Sizes are checked before; nothing but numbers is ever built, so no file can run code.
"""

import math
import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from klute_sim.errors import InputError
from klute_sim.files.limits import MAX_COLUMNS, MAX_VALUES, MB
from klute_sim.types import Array

ByteOrder = Literal["<", ">"]
"""Little-endian or big-endian, as NumPy and struct write it."""
HEADER_BYTES = 128
"""Bytes before the first element: text, version and byte order."""
MAX_DECOMPRESSED_BYTES = 256 * MB
"""Largest size of all elements that are decompressed [bytes]; that of the largest number of values."""
MAX_STRUCT_DEPTH = 4
"""Deepest nesting of structs whose fields are read."""
MAX_ELEMENTS = 100_000
"""Largest number of arrays in a file, counting fields of structs."""
MAX_SIGNALS = 64
"""Largest number of columns (or rows) of a matrix that counts as a table of signals (assumed)."""

_HEAD_BYTES = 1024
"""Decompressed bytes that hold the header of an array: class, size and name."""
_VERSION_5, _VERSION_7_3 = 0x0100, 0x0200
_MI_MATRIX, _MI_COMPRESSED = 14, 15
_NUMBER_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""Type of stored numbers -> NumPy's name."""
_STRUCT, _OPAQUE = 2, 17
_CLASS_NAMES = {
    **{1: "a cell array", _STRUCT: "an array of structs", 3: "an object", 4: "text", 5: "a sparse matrix"},
    **{16: "a function handle", _OPAQUE: "an object, such as a table or a string"},
}
"""Class of an array that is not read -> what it is."""
_NUMBER_CLASSES = range(6, 16)
_COMPLEX_FLAG = 0x0800


class Variable(NamedTuple):
    """A vector of a MAT-file, or a column or a row of a matrix."""

    name: str
    """Name as in MATLAB, such as ``force``, ``run.force`` or ``data(:,3)``."""
    array: "_NumberArray"
    """Array that it is part of."""
    selection: slice
    """Its values in the array, which is stored column by column."""


class _NumberArray(NamedTuple):
    element: int
    """Index of the top-level element."""
    offset: int
    """Position of the numbers' element in the content of the top-level element."""
    n_values: int
    """Number of values."""


class _Tag(NamedTuple):
    kind: int
    size: int
    start: int
    """Position of the data."""
    end: int
    """Position of the next element."""


@dataclass(eq=False)
class MatFile:
    """A MAT-file whose arrays are decoded on demand."""

    description: str
    """File in error messages."""
    variables: dict[str, Variable]
    """Vectors, and columns or rows of matrices, by name."""
    unreadable: dict[str, str]
    """Name of any other variable, and of each matrix -> what it is."""
    _elements: Sequence["_Element"]
    _order: ByteOrder

    @property
    def headings(self) -> tuple[str, ...]:
        """Names of the variables."""
        return tuple(self.variables)

    def read_columns(self, indices: Sequence[int]) -> list[Array]:
        """Return the variables with these indices; raise InputError when the file is damaged."""
        all_variables = list(self.variables.values())
        variables = [all_variables[index] for index in indices]
        n_values = sum(variable.array.n_values for variable in variables)
        if n_values > MAX_VALUES:
            raise InputError(f"{self.description}: its columns have {n_values:,} values; allowed: up to {MAX_VALUES:,}")
        return [self._read(variable) for variable in variables]

    def _read(self, variable: Variable) -> Array:
        element = self._elements[variable.array.element]
        content = element.read_all(self.description)
        tag = _read_tag(content, variable.array.offset, self._order, self.description)
        if tag.kind not in _NUMBER_TYPES:
            raise _damage_error(self.description, f"'{variable.name}' has numbers of the unknown type {tag.kind}")
        dtype = np.dtype(_NUMBER_TYPES[tag.kind]).newbyteorder(self._order)
        if tag.size != variable.array.n_values * dtype.itemsize:
            raise _damage_error(self.description, f"the numbers of '{variable.name}' do not fill its size")
        values = np.frombuffer(content, dtype, variable.array.n_values, tag.start)
        return values[variable.selection].astype(np.float64)


@dataclass(eq=False)
class _Element:
    """A top-level element, which may be compressed."""

    data: memoryview
    """Stored bytes."""
    is_compressed: bool
    """Whether ``data`` is compressed."""
    size: int = 0
    """Size of the content that its own header states [bytes]."""
    _decompressed: bytes = b""

    def read_head(self) -> bytes | memoryview:
        """Return the beginning of the content; raises zlib.error for damaged data."""
        return zlib.decompressobj().decompress(self.data, _HEAD_BYTES) if self.is_compressed else self.data

    def read_all(self, description: str) -> bytes | memoryview:
        """Return the content, never more than :attr:`size`; raises InputError for damaged data."""
        if not self.is_compressed:
            return self.data
        if not self._decompressed:
            try:
                self._decompressed = zlib.decompressobj().decompress(self.data, self.size)
            except zlib.error as error:
                raise _damage_error(description, str(error)) from None
        return self._decompressed


def open_mat(content: bytes, description: str) -> MatFile:
    """Open the MAT-file ``content`` of versions 5 to 7; ``description`` names it in errors.

    Raises InputError when it is no such file, is damaged, or holds more than the limits allow.
    """
    order = _check_header(content, description)
    file = MatFile(description, {}, {}, _split_elements(content, order, description), order)
    reader = _HeaderReader(file)
    for index, element in enumerate(file._elements):
        try:
            reader.read_element(index, element)
        except zlib.error as error:
            raise _damage_error(description, str(error)) from None
    return file


def _check_header(content: bytes, description: str) -> ByteOrder:
    """Return the byte order."""
    if len(content) < HEADER_BYTES:
        raise InputError(f"{description} is not a MAT-file: it has {len(content)} bytes; its header has {HEADER_BYTES}")
    orders: dict[bytes, ByteOrder] = {b"IM": "<", b"MI": ">"}
    order = orders.get(content[126:128])
    if order is None or not content.startswith(b"MATLAB"):
        raise InputError(
            f"{description} is not a MAT-file of version 5 or later; write it in MATLAB with save(..., '-v7')"
        )
    version = _unpack(f"{order}H", content, 124)
    if version == _VERSION_7_3:
        raise InputError(f"{description} is a MAT-file of version 7.3; write it in MATLAB with save(..., '-v7')")
    if version != _VERSION_5:
        raise InputError(f"{description} has version {version >> 8}.{version & 255} of the MAT-file; allowed: 5 to 7")
    return order


def _split_elements(content: bytes, order: ByteOrder, description: str) -> list[_Element]:
    elements, offset = [], HEADER_BYTES
    while offset < len(content):
        tag = _read_tag(content, offset, order, description)
        end = tag.start + tag.size if tag.kind == _MI_COMPRESSED else tag.end
        is_compressed = tag.kind == _MI_COMPRESSED
        stored = memoryview(content)[tag.start if is_compressed else offset : min(end, len(content))]
        elements.append(_Element(stored, is_compressed))
        if len(elements) > MAX_ELEMENTS:
            raise InputError(f"{description} has more than {MAX_ELEMENTS:,} variables; allowed: up to {MAX_ELEMENTS:,}")
        offset = end
    return elements


def _read_tag(content: bytes | memoryview, offset: int, order: ByteOrder, description: str) -> _Tag:
    """Return the tag at ``offset``; raises InputError where the element extends beyond ``content``."""
    if offset + 8 > len(content):
        raise _damage_error(description, "it ends within a variable, as after an incomplete copy")
    kind, size = struct.unpack_from(f"{order}2I", content, offset)
    if kind >> 16:  # a small element: two bytes each for size and type, and up to four bytes of data
        kind, size, start = kind & 0xFFFF, kind >> 16, offset + 4
        if size > 4:
            raise _damage_error(description, f"a small element has {size} bytes")
        return _Tag(kind, size, start, offset + 8)
    start = offset + 8
    if start + size > len(content):
        raise _damage_error(description, "it ends within a variable, as after an incomplete copy")
    return _Tag(kind, size, start, start + size + -size % 8)


class _HeaderReader:
    """Finds the arrays of a file, without their numbers."""

    def __init__(self, file: MatFile) -> None:
        self.file = file
        self.n_arrays = self.n_decompressed = 0

    def read_element(self, index: int, element: _Element) -> None:
        """Add the variables of the top-level ``element``."""
        head = element.read_head()
        if len(head) < 8:
            raise _damage_error(self.file.description, "a variable is empty")
        kind, size = struct.unpack_from(f"{self.file._order}2I", head)
        if kind != _MI_MATRIX:
            return
        element.size = size + 8
        self.n_decompressed += element.size * element.is_compressed
        if max(size, self.n_decompressed) > MAX_DECOMPRESSED_BYTES:
            raise InputError(
                f"{self.file.description} decodes to {self.n_decompressed / MB:.4g} MB or more; allowed: up to "
                f"{MAX_DECOMPRESSED_BYTES / MB:g} MB"
            )
        self._read_array(index, element, head, 0, "", 0)

    def _read_array(
        self, index: int, element: _Element, content: bytes | memoryview, offset: int, name: str, depth: int
    ) -> int:
        """Add the array at ``offset`` under ``name`` or its own; return where the next element begins."""
        order, description = self.file._order, self.file.description
        self.n_arrays += 1
        if self.n_arrays > MAX_ELEMENTS:
            raise InputError(f"{description} has more than {MAX_ELEMENTS:,} arrays; allowed: up to {MAX_ELEMENTS:,}")
        is_array = offset + 8 <= len(content) and _unpack(f"{order}I", content, offset) == _MI_MATRIX
        if not is_array:
            raise _damage_error(description, f"there is no array at byte {offset} of a variable")
        size = _unpack(f"{order}I", content, offset + 4)
        end = offset + 8 + size
        if size == 0:  # the empty array
            return end
        flags = _read_tag(content, offset + 8, order, description)
        if flags.size != 8:
            raise _damage_error(description, "an array has no class")
        flag_word = _unpack(f"{order}I", content, flags.start)
        array_class = flag_word & 0xFF
        position = flags.end
        shape: tuple[int, ...] = ()
        if array_class != _OPAQUE:
            position, shape = self._read_shape(content, position)
        name_tag = _read_tag(content, position, order, description)
        name = name or bytes(content[name_tag.start : name_tag.start + name_tag.size]).decode("utf-8", "replace")
        if not name:  # data of MATLAB's objects
            return end
        position = name_tag.end
        if array_class == _STRUCT and math.prod(shape) == 1 and depth < MAX_STRUCT_DEPTH:
            if depth == 0:
                content = element.read_all(description)
            self._read_fields(index, element, content, position, name, depth)
        elif array_class in _NUMBER_CLASSES and not flag_word & _COMPLEX_FLAG:
            self._add_numbers(_NumberArray(index, position, math.prod(shape)), name, shape)
        else:
            other = "a complex array" if array_class in _NUMBER_CLASSES else f"of the unknown class {array_class}"
            self.file.unreadable[name] = _CLASS_NAMES.get(array_class, other)
        return end

    def _read_shape(self, content: bytes | memoryview, position: int) -> tuple[int, tuple[int, ...]]:
        tag = _read_tag(content, position, self.file._order, self.file.description)
        shape = struct.unpack_from(f"{self.file._order}{min(tag.size, 128) // 4}i", content, tag.start)
        if len(shape) < 2 or min(shape) < 0:
            raise _damage_error(self.file.description, "an array has no valid size")
        return tag.end, shape

    def _read_fields(
        self, index: int, element: _Element, content: bytes | memoryview, position: int, name: str, depth: int
    ) -> None:
        order, description = self.file._order, self.file.description
        length_tag = _read_tag(content, position, order, description)
        length = _unpack(f"{order}i", content, length_tag.start) if length_tag.size == 4 else 0
        names_tag = _read_tag(content, length_tag.end, order, description)
        if length <= 0 or names_tag.size % length:
            raise _damage_error(description, f"the struct '{name}' has no valid names of fields")
        names = bytes(content[names_tag.start : names_tag.start + names_tag.size])
        position = names_tag.end
        for start in range(0, len(names), length):
            field = names[start : start + length].split(b"\0")[0].decode("utf-8", "replace")
            position = self._read_array(index, element, content, position, f"{name}.{field}", depth + 1)

    def _add_numbers(self, array: _NumberArray, name: str, shape: tuple[int, ...]) -> None:
        if array.n_values > MAX_VALUES:
            raise InputError(
                f"{self.file.description}: '{name}' has {array.n_values:,} values; allowed: up to {MAX_VALUES:,}"
            )
        if array.n_values == max(shape):
            self.file.variables[name] = Variable(name, array, slice(None))
        elif len(shape) > 2 or min(shape) > MAX_SIGNALS or min(shape) == 0:
            size = "x".join(map(str, shape))
            self.file.unreadable[name] = f"an array of size {size}; columns are vectors, or parts of a matrix"
        else:
            parts = list(_list_signals(name, shape))
            self.file.unreadable[name] = (
                f"a matrix of size {shape[0]}x{shape[1]}; name one part of it, {parts[0][0]} to {parts[-1][0]}"
            )
            for part, selection in parts:
                self.file.variables[part] = Variable(part, array, selection)
        if len(self.file.variables) > MAX_COLUMNS:
            raise InputError(
                f"{self.file.description} has more than {MAX_COLUMNS} columns; allowed: up to {MAX_COLUMNS}"
            )


def _list_signals(name: str, shape: tuple[int, ...]) -> Iterator[tuple[str, slice]]:
    """Yield name and values of the columns of a matrix, or of its rows where it has fewer rows than columns."""
    n_rows, n_columns = shape
    for number in range(min(shape)):
        if n_rows >= n_columns:
            yield f"{name}(:,{number + 1})", slice(number * n_rows, (number + 1) * n_rows)
        else:
            yield f"{name}({number + 1},:)", slice(number, None, n_rows)


def _unpack(number_format: str, content: bytes | memoryview, offset: int) -> int:
    """Return the integer at ``offset``."""
    return int(struct.unpack_from(number_format, content, offset)[0])


def _damage_error(description: str, reason: str) -> InputError:
    return InputError(f"{description} is not a valid MAT-file: {reason}")
