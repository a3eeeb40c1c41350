"""One trial file: columns ``name [unit]`` of a CSV or Parquet file, converted to SI."""

import hashlib
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from klute_sim.datasets import text, unit_conversion
from klute_sim.errors import InputError
from klute_sim.files.limits import TRIAL
from klute_sim.files.parquet import open_parquet
from klute_sim.files.reading import MissingFileError, read_bytes
from klute_sim.types import Array

_HEADING = re.compile(r"(?P<name>\w+)\s*\[(?P<unit>[^\[\]]*)\]")
_HEADING_WITHOUT_UNIT = re.compile(r"(?P<name>\w+)\s*([(\[{/,:].*)?")


@dataclass(frozen=True, eq=False)
class Table:
    """The requested columns of one trial file."""

    source: str
    """Path of the file for error messages."""
    columns: Mapping[str, Array]
    """Name -> samples in SI, NaN where the cell is empty; all of equal length."""
    headings: Mapping[str, str]
    """Name -> heading as written."""
    units: Mapping[str, str]
    """Name -> unit in the heading."""
    ignored: tuple[str, ...]
    """Headings of columns that were not requested."""
    digest: str
    """SHA-256 of the file."""
    locate_row: Callable[[int], str]
    """Maps the index of a row to its location in the file, such as ``line 17``."""


def read_trial_file(path: Path, column_units: Mapping[str, str]) -> Table:
    """Read the columns in ``column_units`` (name -> SI unit) that the file at ``path`` has.

    Raises InputError for a file that cannot be read, and for a requested column that has no unit or one of another
    dimension, occurs twice, or has cells that are neither finite numbers nor empty.
    """
    source = str(path)
    content = _read_content(path)
    headings: Sequence[str]
    read_columns: Callable[[Sequence[int]], list[Array]]
    locate_row: Callable[[int], str]
    if content.startswith(b"PAR1") or path.suffix.lower() in {".parquet", ".pq"}:
        table = open_parquet(content, TRIAL.describe(source))
        headings, read_columns, locate_row = table.headings, table.read_columns, _locate_parquet_row
    else:
        file = text.parse_delimited_text(content, source)
        headings, read_columns, locate_row = file.headings, file.read_columns, file.locate_row

    indices: dict[str, int] = {}
    factors: list[float] = []
    ignored: list[str] = []
    for index, heading in enumerate(headings):
        name = _match_column(heading, column_units, source)
        if name is None:
            ignored.append(heading)
            continue
        if name in indices:
            raise InputError(
                f"trial file {source}: columns '{headings[indices[name]]}' and '{heading}' are the same channel; "
                "remove one of them"
            )
        indices[name] = index
        factors.append(_require_si_factor(heading, column_units[name], source))

    columns = {}
    all_samples = read_columns([*indices.values()])
    for (name, index), factor, samples in zip(indices.items(), factors, all_samples, strict=True):
        is_infinite = np.isinf(samples)
        if is_infinite.any():
            raise InputError(
                f"trial file {source}: column '{headings[index]}', {locate_row(int(is_infinite.argmax()))}: the value "
                "is infinite; leave the cell of a missing sample empty"
            )
        columns[name] = samples * factor
    matched_headings = {name: headings[index] for name, index in indices.items()}
    units = {name: heading[heading.index("[") + 1 : -1].strip() for name, heading in matched_headings.items()}
    return Table(
        source, columns, matched_headings, units, tuple(ignored), hashlib.sha256(content).hexdigest(), locate_row
    )


def _read_content(path: Path) -> bytes:
    try:
        return read_bytes(path, TRIAL)
    except MissingFileError:
        raise InputError(
            f"trial file {path} does not exist; give paths relative to the folder of dataset.toml"
        ) from None


def _match_column(heading: str, column_units: Mapping[str, str], source: str) -> str | None:
    """Return the requested column that ``heading`` names, ignoring case, or None for other columns."""
    match = _HEADING.fullmatch(heading) or _HEADING_WITHOUT_UNIT.fullmatch(heading)
    name = match["name"].lower() if match else ""
    if match is None or name not in column_units:
        return None
    if match.re is _HEADING_WITHOUT_UNIT:
        example = unit_conversion.EXAMPLE_UNITS[column_units[name]].split(",")[0]
        raise InputError(
            f"trial file {source}: column '{heading}' has no unit in square brackets; write for example "
            f"'{name} [{example}]'"
        )
    return name


def _require_si_factor(heading: str, si_unit: str, source: str) -> float:
    match = _HEADING.fullmatch(heading)
    factor = unit_conversion.get_si_factor(match["unit"].strip(), si_unit) if match else None
    if factor is None:
        raise InputError(
            f"trial file {source}: column '{heading}' has a unit of the wrong kind; allowed: "
            f"{unit_conversion.EXAMPLE_UNITS[si_unit]} and other units of that kind"
        )
    return factor


def _locate_parquet_row(row: int) -> str:
    return f"row {row + 1}"
