"""Checks of the content of TOML and JSON: nesting before it is parsed, numbers and text after it."""

import math
import re
from collections.abc import Iterator
from typing import Any

from klute_sim.errors import InputError
from klute_sim.files.limits import MAX_INTEGER, MAX_JSON_ITEMS, MAX_NESTING, MAX_TOML_ITEMS

# Strings always match, closed or not, so that the search never goes back: its time is proportional to the text.
_TOML_TOKEN = re.compile(
    r'"""(?:[^\\"]|\\.|"(?!""))*+(?:""")?+|'
    r"'''(?:[^']|'(?!''))*+(?:''')?+|"
    r'"(?:[^"\\\n]|\\.)*+"?+|'
    r"'[^'\n]*+'?+|#[^\n]*+|[\[\]{}=,.\n]",
    re.DOTALL,
)
_JSON_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*+"?+|[\[\]{}]', re.DOTALL)
_UNSAFE = re.compile(
    "[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
)
"""Control characters, which terminals interpret, and characters that turn the direction of writing."""


def check_toml_structure(text: str, description: str) -> None:
    """Raise InputError when ``text`` has too many items for the parser, or is nested too deeply."""
    _check_item_count(sum(map(text.count, "=,[{")), MAX_TOML_ITEMS, description)
    depth = dots = 0
    for token in _TOML_TOKEN.finditer(text):
        match token[0]:
            case ".":
                dots += 1
            case "[" | "{":
                depth, dots = depth + 1, 0
            case "]" | "}":
                depth, dots = depth - 1, 0
            case "=" | "," | "\n":
                dots = 0
        if depth + dots > MAX_NESTING:
            raise _nesting_error(description)


def check_json_structure(text: str, description: str) -> None:
    """Raise InputError when ``text`` has too many items for the parser, or is nested too deeply."""
    _check_item_count(sum(map(text.count, ",[{")), MAX_JSON_ITEMS, description)
    depth = 0
    for token in _JSON_TOKEN.finditer(text):
        depth += 1 if token[0] in "[{" else -1 if token[0] in "]}" else 0
        if depth > MAX_NESTING:
            raise _nesting_error(description)


def _check_item_count(count: int, limit: int, description: str) -> None:
    if count > limit:
        raise InputError(f"{description} has more than {limit:,} keys, list items and tables; allowed: up to {limit:,}")


def _nesting_error(description: str) -> InputError:
    return InputError(f"{description} is nested too deeply; allowed: tables and lists in up to {MAX_NESTING} others")


def check_values(content: Any, description: str) -> None:
    """Raise InputError unless ``content`` holds only tables, lists, truth values, safe text and finite numbers."""
    for location, value in _iterate_values(content):
        problem = _describe_problem(value)
        if problem:
            raise InputError(f"{description}: '{location}' {problem}" if location else f"{description} {problem}")


def _describe_problem(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return ""
    if isinstance(value, int) and abs(value) > MAX_INTEGER:
        return f"is an integer of {value.bit_length()} bits; allowed: up to 63 bits"
    if isinstance(value, float) and not math.isfinite(value):
        return f"is {value:g}; allowed: finite numbers"
    if isinstance(value, str):
        unsafe = _UNSAFE.search(value)
        return f"contains the control character U+{ord(unsafe[0]):04X}; allowed: printable text" if unsafe else ""
    if not isinstance(value, int | float):
        return f"is a {type(value).__name__}; allowed: numbers, text, truth values, lists and tables"
    return ""


def _iterate_values(content: Any) -> Iterator[tuple[str, Any]]:
    """Yield the dotted key and the value of all scalars and keys, without recursion."""
    pending: list[tuple[str, Any]] = [("", content)]
    while pending:
        location, value = pending.pop()
        if isinstance(value, dict):
            for key, item in value.items():
                yield location, str(key)
                pending.append((f"{location}.{key}" if location else str(key), item))
        elif isinstance(value, list):
            pending.extend((f"{location}.{number}", item) for number, item in enumerate(value, start=1))
        else:
            yield location, value
