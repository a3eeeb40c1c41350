"""One trial file: columns ``name [unit]`` of a CSV or Parquet file, in SI."""

import hashlib
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from klute_sim.datasets import quantity, text
from klute_sim.errors import InputError
from klute_sim.recording.recording import Array

_HEADING = re.compile(r"(?P<name>\w+)\s*\[(?P<unit>[^\[\]]*)\]")
_WITHOUT_UNIT = re.compile(r"(?P<name>\w+)\s*([(\[{/,:].*)?")


@dataclass(frozen=True, eq=False)
class Table:
    """The columns of one file that somebody asked for."""

    where: str
    """The file, as errors say it."""
    columns: Mapping[str, Array]
    """Name -> samples in SI, finite or NaN where the cell is empty; all of one length."""
    headings: Mapping[str, str]
    """Name -> heading as written."""
    units: Mapping[str, str]
    """Name -> unit as the heading has it."""
    ignored: tuple[str, ...]
    """Headings nobody asked for."""
    digest: str
    """SHA-256 of the file."""
    locate_row: Callable[[int], str]
    """Row, counted from 0 -> where it is in the file, such as ``line 17``."""


def read_trial_file(path: Path, column_units: Mapping[str, str]) -> Table:
    """Read the columns ``wanted`` (name -> SI unit) as far as the file at ``path`` has them.

    Raises InputError when it cannot be read, when a wanted column has no unit or one of another dimension, occurs
    twice, or holds anything but finite numbers and empty cells.
    """
    where = str(path)
    content = _read_content(path)
    found: tuple[Sequence[str], Callable[[Sequence[int]], list[Array]], Callable[[int], str]]
    if content.startswith(b"PAR1") or path.suffix.lower() in {".parquet", ".pq"}:
        found = _open_parquet(content, where)
    else:
        file = text.parse_delimited_text(content, where)
        found = file.headings, file.read_columns, file.locate_row
    headings, fetch, place = found

    places: dict[str, int] = {}
    factors: list[float] = []
    ignored: list[str] = []
    for number, heading in enumerate(headings):
        name = _match_column(heading, column_units, where)
        if name is None:
            ignored.append(heading)
            continue
        if name in places:
            raise InputError(
                f"trial file {where}: columns '{headings[places[name]]}' and '{heading}' are the same channel; leave "
                "one out"
            )
        places[name] = number
        factors.append(_require_si_factor(heading, column_units[name], where))

    columns = {}
    for (name, number), factor, samples in zip(places.items(), factors, fetch([*places.values()]), strict=True):
        infinite = np.isinf(samples)
        if infinite.any():
            raise InputError(
                f"trial file {where}: column '{headings[number]}', {place(int(infinite.argmax()))}: the value is "
                "infinite; leave the cell of a missing sample empty"
            )
        columns[name] = samples * factor
    written = {name: headings[number] for name, number in places.items()}
    units = {name: heading[heading.index("[") + 1 : -1].strip() for name, heading in written.items()}
    return Table(where, columns, written, units, tuple(ignored), hashlib.sha256(content).hexdigest(), place)


def _read_content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError(
            f"trial file {path} does not exist; files are named relative to the folder of dataset.toml"
        ) from None
    except OSError as error:
        raise InputError(f"trial file {path} cannot be read: {error.strerror}") from None


def _match_column(heading: str, column_units: Mapping[str, str], where: str) -> str | None:
    """The wanted column that ``heading`` is, None for any other; capitals do not matter."""
    match = _HEADING.fullmatch(heading) or _WITHOUT_UNIT.fullmatch(heading)
    name = match["name"].lower() if match else ""
    if match is None or name not in column_units:
        return None
    if match.re is _WITHOUT_UNIT:
        example = quantity.EXAMPLE_UNITS[column_units[name]].split(",")[0]
        raise InputError(
            f"trial file {where}: column '{heading}' has no unit in square brackets; write for example "
            f"'{name} [{example}]'"
        )
    return name


def _require_si_factor(heading: str, si_unit: str, where: str) -> float:
    match = _HEADING.fullmatch(heading)
    factor = quantity.get_si_factor(match["unit"].strip(), si_unit) if match else None
    if factor is None:
        raise InputError(
            f"trial file {where}: column '{heading}' has a unit that does not fit; allowed are "
            f"{quantity.EXAMPLE_UNITS[si_unit]} and other units of that kind"
        )
    return factor


def _open_parquet(
    content: bytes, where: str
) -> tuple[list[str], Callable[[Sequence[int]], list[Array]], Callable[[int], str]]:
    """Headings, how to fetch columns and how to name a row."""
    if not content:
        raise InputError(f"trial file {where} is empty")
    try:
        file = pq.ParquetFile(pa.BufferReader(content))
        headings = list(file.schema_arrow.names)
    except (pa.ArrowException, OSError, ValueError) as error:
        raise InputError(f"trial file {where} is no Parquet file: {str(error).splitlines()[0]}") from None

    def fetch(places: Sequence[int]) -> list[Array]:
        columns = []
        for place in places:
            kind = file.schema_arrow.field(place).type
            number = (pa.types.is_integer, pa.types.is_floating, pa.types.is_decimal)
            if not any(is_kind(kind) for is_kind in number):
                raise InputError(
                    f"trial file {where}: column '{headings[place]}' holds {kind}; allowed are numbers in the unit of "
                    "the heading"
                )
            try:
                column = file.read(columns=[headings[place]]).column(0)
                columns.append(np.asarray(column.cast(pa.float64(), safe=False).to_numpy(), dtype=np.float64))
            except (pa.ArrowException, OSError, ValueError) as error:
                reason = str(error).splitlines()[0]
                raise InputError(f"trial file {where}: column '{headings[place]}' cannot be read: {reason}") from None
        return columns

    return headings, fetch, lambda row: f"row {row + 1}"
