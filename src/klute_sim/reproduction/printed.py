"""The list of what the source prints, and what a user adds to it."""

import difflib
import tomllib
from collections.abc import Mapping
from functools import cache
from importlib import resources
from pathlib import Path

from pydantic import BaseModel, ConfigDict, TypeAdapter

from klute_sim.errors import InputError
from klute_sim.reproduction.item import PublishedItem

DEFAULT_TOLERANCE, SUPPLIED_TOLERANCE = 1e-6, 0.1
"""What a number may differ by, relative, where the list does not say: printed, and supplied by a user."""


class _PublishedEntry(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)
    id: str
    quantity: str
    unit: str
    published: float | str | None = None
    within: float | None = None
    against: str = ""
    note: str = ""
    measured: bool = False
    input: bool = False
    lost: bool = True
    """Where nothing is published: whether the source has it, on a page that we have not."""


class PublishedTable(BaseModel):
    """A table or figure, or several that belong together."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)
    title: str
    shows: str
    items: list[_PublishedEntry]


@cache
def load_tables() -> dict[str, PublishedTable]:
    """Identifier -> row, in the order of the source's pages."""
    content = (resources.files("klute_sim.reproduction") / "printed.toml").read_text("utf-8")
    return TypeAdapter(dict[str, PublishedTable]).validate_python(tomllib.loads(content))


def list_items(supplied_values: Mapping[str, float] | None = None) -> list[PublishedItem]:
    """Every item, with the numbers ``supplied`` (identifier -> number) in the place of missing ones."""
    given, found = supplied_values or {}, []
    for row_id, row in load_tables().items():
        for entry in row.items:
            name, published, note = f"{row_id}.{entry.id}", entry.published, entry.note
            within = DEFAULT_TOLERANCE if entry.within is None else entry.within
            if name in given:
                published, within = given[name], SUPPLIED_TOLERANCE
                told = f"The published number was supplied by the user and is compared within {100.0 * within:g} %."
                note = " ".join(filter(None, [note, told]))
            number = float(published) if isinstance(published, int | float) else published
            found.append(
                PublishedItem(
                    name,
                    row.title,
                    entry.quantity,
                    entry.unit,
                    number,
                    within,
                    entry.against,
                    note,
                    entry.measured,
                    entry.input,
                )
            )
    return found


def published_numbers() -> dict[str, float]:
    """The printed numbers, by item."""
    return {item.id: item.published for item in list_items() if isinstance(item.published, float)}


def list_missing_items() -> list[PublishedItem]:
    """The items whose number the source has on a page that our copy lacks."""
    lost = {f"{name}.{entry.id}" for name, row in load_tables().items() for entry in row.items if entry.lost}
    return [item for item in list_items() if item.published is None and item.id in lost]


def render_template() -> str:
    """A file for :func:`supplied` with nothing filled in."""
    lines = [
        "# Numbers that are missing from the copy of the source that this package was made from.",
        "# Fill in what you have, as 'name = number' in the unit that stands there, and take away the # before it.",
        "# A number of the device itself (Table 4.1, springs) is only compared; to use it, put it into a device file.",
    ]
    title = ""
    for item in list_missing_items():
        if item.row_title != title:
            title = item.row_title
            lines += ["", f"# {title}"]
        lines.append(f'# "{item.id}" =   # {item.quantity} [{item.unit}]')
    return "\n".join(lines) + "\n"


def load_supplied_values(path: Path) -> dict[str, float]:
    """The numbers of a file that :func:`template` began.

    Raises InputError for a file that cannot be read, a name that is not missing, and what is not a finite number.
    """
    try:
        content = tomllib.loads(path.read_text("utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "not a UTF-8 text file"
        raise InputError(f"file of published numbers {path} cannot be read: {why}") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"file of published numbers {path} is not valid TOML: {error}") from None
    known, found = {item.id for item in list_missing_items()}, {}
    for name, value in content.items():
        if name not in known:
            near = difflib.get_close_matches(name, known, 1)
            hint = f"; did you mean '{near[0]}'?" if near else ""
            raise InputError(
                f"{path}: no missing number is called '{name}' (put it in quotation marks; klute-sim reproduce "
                f"--missing lists all){hint}"
            )
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < float("inf"):
            raise InputError(f"{path}: '{name}' is {value!r}; allowed: a number")
        found[name] = float(value)
    return found
