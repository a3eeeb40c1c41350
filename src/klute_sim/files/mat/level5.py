"""Read arrays of numbers from MAT-files of versions 5 to 7.

Source of the format: MathWorks, "MAT-File Format" (level 5). A file is a sequence of elements, each with a type and a
size; compressed elements hold one other element. Only the headers of all arrays, structs in full, and the arrays that
are asked for are decompressed. Sizes are checked before; nothing but numbers is ever built, so no file can run code.
"""

import math
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from klute_sim.errors import InputError
from klute_sim.files.limits import MB
from klute_sim.files.mat.contents import (
    MAX_ARRAYS,
    MAX_DECOMPRESSED_BYTES,
    MAX_STRUCT_DEPTH,
    MatContents,
    MatFile,
)
from klute_sim.types import Array

ByteOrder = Literal["<", ">"]
"""Little-endian or big-endian, as NumPy and struct write it."""
HEADER_BYTES = 128
"""Bytes before the first element: text, version and byte order."""
_HEAD_BYTES = 1024
"""Decompressed bytes that hold the header of an array: class, size and name."""
_VERSION = 0x0100
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


class _Location(NamedTuple):
    """Where the numbers of an array are."""

    element: int
    """Index of the top-level element."""
    offset: int
    """Position of the numbers in the content of the top-level element."""


class _Tag(NamedTuple):
    kind: int
    size: int
    start: int
    """Position of the data."""
    end: int
    """Position of the next element."""


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


def open_level5(content: bytes, description: str) -> MatFile:
    """Open the MAT-file ``content`` of versions 5 to 7, at least its header; ``description`` names it in errors.

    Raises InputError when it has another version, is damaged, or holds more than the limits allow.
    """
    order = _read_byte_order(content, description)
    reader = _Reader(MatContents(description), _split_elements(content, order, description), order)
    reader.read_names()
    return MatFile(reader.contents, reader.read_array)


def _read_byte_order(content: bytes, description: str) -> ByteOrder:
    order: ByteOrder = "<" if content[126:128] == b"IM" else ">"
    version = _unpack(f"{order}H", content, 124)
    if version != _VERSION:
        raise InputError(f"{description} has version {version >> 8}.{version & 255} of the MAT-file; allowed: 5 to 7.3")
    return order


def _split_elements(content: bytes, order: ByteOrder, description: str) -> list[_Element]:
    elements, offset = [], HEADER_BYTES
    while offset < len(content):
        tag = _read_tag(content, offset, order, description)
        end = tag.start + tag.size if tag.kind == _MI_COMPRESSED else tag.end
        is_compressed = tag.kind == _MI_COMPRESSED
        stored = memoryview(content)[tag.start if is_compressed else offset : min(end, len(content))]
        elements.append(_Element(stored, is_compressed))
        if len(elements) > MAX_ARRAYS:
            raise InputError(f"{description} has more than {MAX_ARRAYS:,} variables; allowed: up to {MAX_ARRAYS:,}")
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


class _Reader:
    """Finds the arrays of a file without their numbers, and reads the numbers on demand."""

    def __init__(self, contents: MatContents, elements: Sequence[_Element], order: ByteOrder) -> None:
        self.contents, self.elements, self.order = contents, elements, order
        self.description = contents.description
        self.locations: dict[str, _Location] = {}
        self.n_arrays = self.n_decompressed = 0

    def read_names(self) -> None:
        """Add the arrays of all elements to the contents."""
        for index, element in enumerate(self.elements):
            try:
                self._read_element(index, element)
            except zlib.error as error:
                raise _damage_error(self.description, str(error)) from None

    def read_array(self, name: str) -> Array:
        """Return the numbers of the array ``name``, column by column."""
        location = self.locations[name]
        content = self.elements[location.element].read_all(self.description)
        tag = _read_tag(content, location.offset, self.order, self.description)
        if tag.kind not in _NUMBER_TYPES:
            raise _damage_error(self.description, f"'{name}' has numbers of the unknown type {tag.kind}")
        dtype = np.dtype(_NUMBER_TYPES[tag.kind]).newbyteorder(self.order)
        n_values = self.contents.n_values[name]
        if tag.size != n_values * dtype.itemsize:
            raise _damage_error(self.description, f"the numbers of '{name}' do not fill its size")
        return np.frombuffer(content, dtype, n_values, tag.start)

    def _read_element(self, index: int, element: _Element) -> None:
        head = element.read_head()
        if len(head) < 8:
            raise _damage_error(self.description, "a variable is empty")
        kind, size = struct.unpack_from(f"{self.order}2I", head)
        if kind != _MI_MATRIX:
            return
        element.size = size + 8
        self.n_decompressed += element.size * element.is_compressed
        if max(size, self.n_decompressed) > MAX_DECOMPRESSED_BYTES:
            raise InputError(
                f"{self.description} decodes to {self.n_decompressed / MB:.4g} MB or more; allowed: up to "
                f"{MAX_DECOMPRESSED_BYTES / MB:g} MB"
            )
        self._read_array(index, element, head, 0, "", 0)

    def _read_array(
        self, index: int, element: _Element, content: bytes | memoryview, offset: int, name: str, depth: int
    ) -> int:
        """Add the array at ``offset`` under ``name`` or its own; return where the next element begins."""
        order, description = self.order, self.description
        self.n_arrays += 1
        if self.n_arrays > MAX_ARRAYS:
            raise InputError(f"{description} has more than {MAX_ARRAYS:,} arrays; allowed: up to {MAX_ARRAYS:,}")
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
            self.locations[name] = _Location(index, position)
            self.contents.add_numbers(name, shape)
        else:
            other = "a complex array" if array_class in _NUMBER_CLASSES else f"of the unknown class {array_class}"
            self.contents.unreadable[name] = _CLASS_NAMES.get(array_class, other)
        return end

    def _read_shape(self, content: bytes | memoryview, position: int) -> tuple[int, tuple[int, ...]]:
        tag = _read_tag(content, position, self.order, self.description)
        shape = struct.unpack_from(f"{self.order}{min(tag.size, 128) // 4}i", content, tag.start)
        if len(shape) < 2 or min(shape) < 0:
            raise _damage_error(self.description, "an array has no valid size")
        return tag.end, shape

    def _read_fields(
        self, index: int, element: _Element, content: bytes | memoryview, position: int, name: str, depth: int
    ) -> None:
        order, description = self.order, self.description
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


def _unpack(number_format: str, content: bytes | memoryview, offset: int) -> int:
    """Return the integer at ``offset``."""
    return int(struct.unpack_from(number_format, content, offset)[0])


def _damage_error(description: str, reason: str) -> InputError:
    return InputError(f"{description} is not a valid MAT-file: {reason}")
