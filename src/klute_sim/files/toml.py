"""Read, check and write TOML files: one reader and one sentence per error for every file format of the package."""

import json
import re
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails
from pydantic_core.core_schema import ErrorType

from klute_sim.errors import InputError, suggest
from klute_sim.files.limits import FileKind
from klute_sim.files.reading import decode_text, read_bytes
from klute_sim.files.values import check_toml_structure, check_values

MAX_VALUE_LENGTH = 60
"""Maximum number of letters of a refused value that an error message quotes."""

_BUILTIN_ERROR_TYPES = frozenset(get_args(ErrorType))


def read_toml(path: str | Path, kind: FileKind) -> dict[str, Any]:
    """Return the content of the TOML file at ``path``, whose ``kind`` sets its limits and its name in errors.

    Raises InputError when the file cannot be read or is not valid TOML.
    """
    return parse_toml(read_bytes(path, kind), kind.describe(path))


def parse_toml(content: bytes, description: str) -> dict[str, Any]:
    """Return what ``content`` (TOML in UTF-8, with or without byte order mark) holds.

    ``description`` names the file in errors, such as ``"device file my.toml"``.

    Raises InputError when ``content`` is not UTF-8 text or not valid TOML, is nested too deeply, or holds a number that
    is not finite, an integer of more than 63 bits, a date or a control character.
    """
    text = decode_text(content, description)
    check_toml_structure(text, description)
    try:
        keys = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{description} is not valid TOML: {error}") from None
    except ValueError:  # int() refuses more than 4300 digits
        raise InputError(f"{description} holds an integer of thousands of digits; allowed: up to 63 bits") from None
    check_values(keys, description)
    return keys


def validation_sentence(
    error: ValidationError,
    model: type[BaseModel],
    *,
    max_problems: int = 1,
    location_offset: int = 0,
    describe_allowed: Callable[[ErrorDetails], str] | None = None,
) -> str:
    """Return one sentence that names each refused key, its value and what is allowed.

    ``model`` is the pydantic model of the file; an unknown key is answered with the keys of the table it stands in.
    At most ``max_problems`` problems are listed. The first ``location_offset`` parts of each location are left out
    (the tag of a discriminated union). ``describe_allowed`` may say what is allowed at a problem, or ''.
    """
    # An unknown key comes first: it is often the misspelt form of a key that is also missing.
    problems = sorted(error.errors(include_url=False), key=lambda problem: problem["type"] != "extra_forbidden")
    sentence = "; ".join(
        _format_problem(problem, model, problem["loc"][location_offset:], describe_allowed)
        for problem in problems[:max_problems]
    )
    hidden = len(problems) - max_problems
    return f"{sentence} (and {hidden} more)" if hidden > 0 and max_problems > 1 else sentence


def _format_problem(
    problem: ErrorDetails,
    model: type[BaseModel],
    location: tuple[int | str, ...],
    describe_allowed: Callable[[ErrorDetails], str] | None,
) -> str:
    key = format_location(location)
    allowed = describe_allowed(problem) if describe_allowed is not None else ""
    if problem["type"] == "extra_forbidden":
        fields = _find_table(model, location).model_fields
        hint = suggest(str(location[-1]), fields, f"allowed here: {', '.join(fields)}")
        return f"unknown key '{key}'; {hint}"
    if problem["type"] == "missing":
        return f"key '{key}' is missing" + (f"; allowed: {allowed}" if allowed else "")
    if problem["type"] not in _BUILTIN_ERROR_TYPES:  # a rule of the model itself, whose message is a sentence
        return f"[{key}] {problem['msg']}" if key else problem["msg"]
    value = repr(problem["input"])
    if len(value) > MAX_VALUE_LENGTH:
        value = value[: MAX_VALUE_LENGTH - 3] + "..."
    reason = f"; allowed: {allowed}" if allowed else f": {problem['msg'][0].lower()}{problem['msg'][1:]}"
    return f"{key} = {value} is refused{reason}"


def format_location(location: tuple[int | str, ...]) -> str:
    """Return a dotted key; list items are counted from 1."""
    return ".".join(str(part + 1) if isinstance(part, int) else part for part in location)


def _find_table(model: type[BaseModel], location: tuple[int | str, ...]) -> type[BaseModel]:
    """Return the model of the table that the last part of ``location`` stands in."""
    table = model
    for part in location[:-1]:
        if isinstance(part, str) and part in table.model_fields:
            table = _find_model(table.model_fields[part].annotation) or table
    return table


def _find_model(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((model for part in get_args(annotation) if (model := _find_model(part)) is not None), None)


def format_toml(content: Mapping[str, Any]) -> str:
    """Return ``content`` as TOML: single values first, then tables, then lists of tables."""
    return "\n".join(_format_lines(content, "")) + "\n"


def _format_lines(content: Mapping[str, Any], prefix: str) -> list[str]:
    lines = _format_pairs({key: value for key, value in content.items() if not _is_table(value)})
    for title, section in content.items():
        if isinstance(section, dict):
            # A table that holds nothing but tables needs no header of its own.
            is_parent = bool(section) and all(isinstance(value, dict) for value in section.values())
            header = [] if is_parent else ["", f"[{prefix}{format_key(title)}]"]
            lines += [*header, *_format_lines(section, f"{prefix}{format_key(title)}.")]
        elif _is_table(section):
            for item in section:
                lines += ["", f"[[{prefix}{format_key(title)}]]", *_format_pairs(item)]
    return lines


def _is_table(value: Any) -> bool:
    """Return whether ``value`` is a table or a list of tables, which need a header."""
    return isinstance(value, dict) or (isinstance(value, list) and bool(value) and isinstance(value[0], dict))


def _format_pairs(values: Mapping[str, Any]) -> list[str]:
    return [
        f"{format_key(key)} = {format_text(value) if isinstance(value, str) else json.dumps(value)}"
        for key, value in values.items()
    ]


def format_key(key: str) -> str:
    """Return ``key`` as it stands in TOML: in quotation marks where it has other characters than a plain key."""
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else format_text(key)


def format_text(value: str) -> str:
    """Return ``value`` as a string of TOML."""
    # JSON strings are TOML strings, except for the one control character that JSON leaves as it is.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
