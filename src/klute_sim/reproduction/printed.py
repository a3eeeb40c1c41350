"""The published items of the source and the numbers that a user supplies."""

import difflib
from collections.abc import Mapping
from functools import cache
from importlib import resources
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from klute_sim.errors import InputError
from klute_sim.files.limits import PUBLISHED_NUMBERS
from klute_sim.files.toml import parse_toml, read_toml
from klute_sim.reproduction.item import Dependence, ItemKind, PublishedItem

SUPPLIED_TOLERANCE = 0.1
"""Relative tolerance of numbers that a user supplies."""


class _PublishedEntry(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)
    id: str
    kind: ItemKind
    quantity: str
    unit: str
    published: float | str | None = None
    kind_reason: str = ""
    dependence: Dependence | None = None
    tolerance: float | None = None
    at_most: float | None = None
    at_least: float | None = None
    criterion: str = ""
    contradiction: str = ""
    note: str = ""
    is_checked: bool = True
    is_missing: bool = True
    """Whether an item without published value is on a page that this copy of the source lacks."""


class PublishedTable(BaseModel):
    """A table or figure, or several related ones."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)
    title: str
    description: str
    items: list[_PublishedEntry]


class _KindDefault(BaseModel):
    """Tolerance of the numbers of a kind that have none of their own."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)
    tolerance: float
    """Relative tolerance."""
    criterion: str
    """Reason of the tolerance."""


class _PublishedFile(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)
    defaults: dict[ItemKind, _KindDefault]
    tables: dict[str, PublishedTable]


@cache
def _load_file() -> _PublishedFile:
    content = (resources.files("klute_sim.reproduction") / "printed.toml").read_bytes()
    return _PublishedFile.model_validate(parse_toml(content, "printed.toml"))


def load_tables() -> dict[str, PublishedTable]:
    """Return the published tables by identifier, in the order of the source."""
    return _load_file().tables


def list_items(supplied_values: Mapping[str, float] | None = None) -> list[PublishedItem]:
    """Return all items, with ``supplied_values`` (identifier to number) in place of missing numbers."""
    supplied = supplied_values or {}
    return [
        _make_item(f"{table_id}.{entry.id}", table, entry, supplied.get(f"{table_id}.{entry.id}"))
        for table_id, table in load_tables().items()
        for entry in table.items
    ]


def _make_item(
    item_id: str, table: PublishedTable, entry: _PublishedEntry, supplied_value: float | None
) -> PublishedItem:
    published, tolerance, criterion, note = entry.published, entry.tolerance, entry.criterion, entry.note
    default = _load_file().defaults.get(entry.kind)
    if supplied_value is not None:
        published, tolerance = supplied_value, SUPPLIED_TOLERANCE * (abs(supplied_value) or 1.0)
        criterion = f"{100.0 * SUPPLIED_TOLERANCE:g} %, as for every number that a user supplies (assumed)."
        note = " ".join(filter(None, [note, "The published number was supplied by the user."]))
    elif isinstance(published, float) and tolerance is None and default is not None:
        tolerance, criterion = default.tolerance * (abs(published) or 1.0), default.criterion
    return PublishedItem(
        item_id,
        table.title,
        entry.quantity,
        entry.unit,
        published,
        entry.kind,
        entry.kind_reason,
        entry.dependence,
        tolerance,
        entry.at_most,
        entry.at_least,
        criterion,
        entry.contradiction,
        note,
        entry.is_checked,
    )


def get_published_numbers() -> dict[str, float]:
    """Return the printed numbers by item identifier."""
    return {item.id: item.published for item in list_items() if isinstance(item.published, float)}


def list_missing_items() -> list[PublishedItem]:
    """Return the items whose number is on a page that this copy of the source lacks."""
    missing = {f"{name}.{entry.id}" for name, row in load_tables().items() for entry in row.items if entry.is_missing}
    return [item for item in list_items() if item.published is None and item.id in missing]


def render_template() -> str:
    """Return a file for :func:`load_supplied_values` without any numbers."""
    lines = [
        "# Numbers that are missing from the copy of the source on which this package is based.",
        "# Fill in a number as 'name = number' in the unit of its line, and remove the # at the start of the line.",
        "# Numbers of the device (Table 4.1, springs) are only compared; to use one, enter it in a device file.",
    ]
    title = ""
    for item in list_missing_items():
        if item.table_title != title:
            title = item.table_title
            lines += ["", f"# {title}"]
        lines.append(f'# "{item.id}" =   # {item.quantity} [{item.unit}]')
    return "\n".join(lines) + "\n"


def load_supplied_values(path: Path) -> dict[str, float]:
    """Return the numbers of a file that :func:`render_template` began.

    Raises InputError when the file cannot be read, a name is not missing, or a value is not a finite number.
    """
    content = read_toml(path, PUBLISHED_NUMBERS)
    known, values = {item.id for item in list_missing_items()}, {}
    for name, value in content.items():
        if name not in known:
            suggestions = difflib.get_close_matches(name, known, 1)
            hint = f"; did you mean '{suggestions[0]}'?" if suggestions else ""
            raise InputError(
                f"{path}: no missing number is called '{name}' (put it in quotation marks; klute-sim reproduce "
                f"--missing lists all){hint}"
            )
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < float("inf"):
            raise InputError(f"{path}: '{name}' is {value!r}; allowed: a number")
        values[name] = float(value)
    return values
