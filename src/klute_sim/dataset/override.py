"""A device with some of its numbers changed for one trial."""

import json
import re
import tomllib
from collections.abc import Mapping
from typing import Any

from klute_sim.dataset.format import refuse_unknown_key
from klute_sim.device.files import Device
from klute_sim.device.schema import parse
from klute_sim.errors import InputError


def overridden(device: Device, changes: Mapping[str, float], where: str) -> Device:
    """``device`` with ``changes`` (``section.key`` -> value in the key's unit), checked as a device file is.

    The content is a device file that holds the changed numbers and names ``where`` as their source; without changes
    it is ``device`` itself. Raises InputError for a key that is no number of the device or a value it cannot have.
    """
    if not changes:
        return device
    keys = tomllib.loads(device.content.decode("utf-8-sig"))
    for key, value in changes.items():
        refuse_unknown_key(key, device.spec.numbers(), where)
        put(keys, key, value, where)
    try:
        spec = parse(keys, device.name)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    return Device(spec, to_toml(keys).encode())


def put(keys: dict[str, Any], key: str, value: float, source: str) -> None:
    """Give number ``key`` (``section.key``) of a device file's ``keys`` a new ``value``; ``source`` says where from."""
    section, _, name = key.rpartition(".")
    table = keys
    for part in section.split("."):
        table = table[part]
    table[name] = value
    keys.setdefault("sources", {})[key] = source


def to_toml(keys: Mapping[str, Any]) -> str:
    """The ``keys`` of a device file as TOML: single values, then tables, then lists of tables."""
    return "\n".join(_lines(keys, "")) + "\n"


def _lines(keys: Mapping[str, Any], above: str) -> list[str]:
    lines = _pairs({key: value for key, value in keys.items() if not isinstance(value, dict | list)})
    for title, section in keys.items():
        if isinstance(section, dict):
            # A table that holds nothing but tables needs no header of its own.
            header = (
                []
                if section and all(isinstance(value, dict) for value in section.values())
                else ["", f"[{above}{title}]"]
            )
            lines += [*header, *_lines(section, f"{above}{title}.")]
        elif isinstance(section, list):
            for item in section:
                lines += ["", f"[[{above}{title}]]", *_pairs(item)]
    return lines


def _pairs(values: Mapping[str, Any]) -> list[str]:
    return [f"{_key(key)} = {_text(v) if isinstance(v, str) else json.dumps(v)}" for key, v in values.items()]


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _text(key)


def _text(value: str) -> str:
    # JSON's strings are TOML's, but for the one control character that JSON leaves as it is.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
