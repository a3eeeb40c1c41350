"""Read JSON files that klute-sim wrote, and that anybody may have changed since."""

import json
from pathlib import Path
from typing import Any

from klute_sim.errors import InputError
from klute_sim.files.limits import FileKind
from klute_sim.files.reading import read_text
from klute_sim.files.values import check_json_structure, check_values


def read_json(path: str | Path, kind: FileKind) -> Any:
    """Return the content of the JSON file at ``path``; raise InputError when it cannot be read or is not JSON."""
    return parse_json(read_text(path, kind), kind.describe(path))


def parse_json(text: str, description: str) -> Any:
    """Return what ``text`` holds; ``description`` names the file in errors.

    Raises InputError when ``text`` is not JSON, is nested too deeply, or holds a number that is not finite, an integer
    of more than 63 bits or a control character.
    """
    check_json_structure(text, description)
    try:
        content = json.loads(text, parse_int=_parse_integer)
    except ValueError as error:
        raise InputError(f"{description} is not valid JSON: {error}") from None
    check_values(content, description)
    return content


def _parse_integer(text: str) -> int:
    if len(text) > 40:  # int() takes long for many digits, and refuses more than 4300
        raise ValueError(f"an integer has {len(text)} digits")
    return int(text)
