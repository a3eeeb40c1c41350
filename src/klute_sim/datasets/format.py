"""``dataset.toml``: which keys exist and what each may hold."""

import math
import re
import tomllib
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from klute_sim import units
from klute_sim.datasets.channels import Rig
from klute_sim.datasets.trial import Use
from klute_sim.errors import InputError

FORMAT_NAME = "klute-sim-dataset/1"

_PERCENT_PATTERN = re.compile(r"(?P<number>[^%]*)%")
_SINGLE_BRACKET_PATTERN = re.compile(rb"^[ \t]*\[[ \t]*trial[ \t]*\]", re.MULTILINE)


def _validate_text(value: Any) -> Any:
    """A name or path: not empty, no line ends or other control characters."""
    if isinstance(value, str) and not (value.strip() and value.isprintable()):
        raise PydanticCustomError("name", "allowed is a name or path on one line, not empty")
    return value


def _validate_number(value: Any) -> Any:
    if isinstance(value, bool) or not isinstance(value, int | float) or _parse_finite(value) is None:
        raise PydanticCustomError("number", "allowed is a finite number in the unit of the key")
    return value


def _validate_deviation(value: Any) -> Any:
    number, is_percent = _parse_amount(value)
    if number is None or number <= 0.0:
        raise PydanticCustomError(
            "spread",
            "allowed is a standard deviation above 0, in per cent of the device's value ('10 %') or in the unit of "
            "the key (0.5)",
        )
    if isinstance(value, str) and not is_percent:
        raise PydanticCustomError("bare", "a forgotten per cent sign, or a number in the unit of the key?")
    return value


def _parse_amount(value: Any) -> tuple[float | None, bool]:
    """The number in ``value`` and whether it is per cent."""
    percent = _PERCENT_PATTERN.fullmatch(value.strip()) if isinstance(value, str) else None
    return _parse_finite(percent["number"] if percent else value), percent is not None


def _parse_finite(value: Any) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


Name = Annotated[str, BeforeValidator(_validate_text)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class TrialEntry(_Section):
    """One ``[[trial]]``."""

    files: Annotated[list[Name], Field(min_length=1)]
    """Paths relative to the folder; several where channels have their own clocks."""
    group: Name | None = None
    """Trials with the same group are repeats; left out: a group of its own."""
    use: Use | None = None
    """Left out: the program splits whole groups."""
    device: dict[str, Annotated[int | float, BeforeValidator(_validate_number)]] = {}
    """``section.key`` -> value in the key's unit: what differs about the device."""
    checked: list[Name] = []
    """Measured channels whose instrument, in this trial, is known to be right: a second gauge, a calibrated cell."""


class DatasetFile(_Section):
    """The whole file."""

    format: Literal["klute-sim-dataset/1"]
    rig: Rig
    device: Name
    """A preset, or the path of a device file relative to the folder."""
    uncertain: dict[str, Annotated[float | int | str, BeforeValidator(_validate_deviation)]] = {}
    """``section.key`` -> standard deviation, as written."""
    trial: Annotated[list[TrialEntry], Field(min_length=1)]


def parse_dataset_file(content: bytes, where: str) -> DatasetFile:
    """Check the ``content`` of a ``dataset.toml`` found at ``where``; raises InputError with one sentence."""
    try:
        keys = tomllib.loads(content.decode("utf-8-sig"))
    except UnicodeDecodeError:
        raise InputError(f"{where} cannot be read: not a UTF-8 text file") from None
    except (ValueError, RecursionError) as error:
        mend = "; write [[trial]], with two brackets, for each trial" if _SINGLE_BRACKET_PATTERN.search(content) else ""
        raise InputError(f"{where} is not valid TOML: {error}{mend}") from None
    try:
        return DatasetFile.model_validate(keys)
    except ValidationError as error:
        raise InputError(f"{where}: {_describe_error(error)}") from None


def compute_standard_deviations(
    uncertainties: Mapping[str, float | int | str], numbers: Mapping[str, float], where: str
) -> dict[str, float]:
    """``uncertain`` as standard deviations in each key's own unit; ``numbers`` are the device's.

    Raises InputError for a key that is no number of the device, or a percentage of 0.
    """
    found = {}
    for key, value in uncertainties.items():
        check_known_key(key, numbers, f"{where}: [uncertain]")
        if isinstance(numbers[key], int):
            raise InputError(f"{where}: [uncertain] '{key}' is a count; allowed are measured numbers")
        number, is_percent = _parse_amount(value)
        deviation = (number or 0.0) * (abs(numbers[key]) / 100.0 if is_percent else 1.0)
        if deviation == 0.0:
            raise InputError(
                f"{where}: [uncertain] '{key}' = {value!r}, but the device's value is {numbers[key]:g}; give a "
                "standard deviation in the unit of the key"
            )
        found[key] = deviation
    return found


def check_known_key(key: str, numbers: Mapping[str, float], where: str) -> None:
    """Raise InputError unless ``key`` is one of the device's ``numbers``."""
    if key not in numbers:
        raise InputError(f"{where} names '{key}', which is no number of the device; allowed: {', '.join(numbers)}")


def _describe_error(error: ValidationError) -> str:
    # An unknown key is often the misspelt one that is also missing.
    problem = min(error.errors(include_url=False), key=lambda problem: problem["type"] != "extra_forbidden")
    place = problem["loc"]
    if problem["type"] == "extra_forbidden":
        owner = TrialEntry if place[0] == "trial" and len(place) > 1 else DatasetFile
        return f"unknown key '{_format_key(place)}'; allowed here: {', '.join(owner.model_fields)}"
    if problem["type"] == "missing":
        return f"key '{_format_key(place)}' is missing; allowed: {_describe_allowed(place)}"
    return f"'{_format_key(place)}' = {_format_input(problem)} is refused; {_describe_allowed(place, problem)}"


def _format_key(location: tuple[int | str, ...]) -> str:
    """Dotted, with trials and files counted from 1."""
    return ".".join(f"{part + 1}" if isinstance(part, int) else part for part in location)


def _format_input(details: ErrorDetails) -> str:
    told = repr(details["input"])
    return told if len(told) <= 60 else told[:57] + "..."


_ALLOWED_VALUES: dict[str, str] = {
    "format": f"'{FORMAT_NAME}'",
    "rig": "'bench' or 'gait'",
    "device": "a preset, or the path of a device file, as text",
    "uncertain": "a table of \"section.key\" = '10 %'",
    "trial": "one or more tables [[trial]]",
    "trial.files": "a list of one or more file names",
    "trial.group": "a name, as text",
    "trial.use": "'fit', 'select' or 'show'",
    "trial.checked": "a list of measured channels",
    "trial.device": 'a table of "section.key" = number',
}


def _describe_allowed(location: tuple[int | str, ...], details: ErrorDetails | None = None) -> str:
    if details and details["type"] in {"name", "number", "spread"}:
        return details["msg"]
    if details and details["type"] == "bare":
        number, unit = details["input"].strip(), units.split_unit(str(location[-1]))[1]
        return f'{number} % or {f"{number} {unit}".strip()}? Write "{number} %", or {number} without quotes'
    what = ".".join(part for part in location if isinstance(part, str))
    said = _ALLOWED_VALUES.get(what, _ALLOWED_VALUES["trial"])
    return f"allowed: {said}" if details else said
