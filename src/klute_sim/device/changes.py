"""A device with some of its numbers changed for one trial."""

import json
import re
import tomllib
from collections.abc import Mapping
from typing import Any

from klute_sim.datasets.format import check_known_key
from klute_sim.device.device import Device
from klute_sim.device.schema.document import parse_device_spec
from klute_sim.errors import InputError


def apply_changes(device: Device, changes: Mapping[str, float], where: str) -> Device:
    """``device`` with ``changes`` (``section.key`` -> value in the key's unit), checked as a device file is.

    The content is a device file that holds the changed numbers and names ``where`` as their source; without changes
    it is ``device`` itself. Raises InputError for a key that is no number of the device or a value it cannot have.
    """
    if not changes:
        return device
    keys = tomllib.loads(device.content.decode("utf-8-sig"))
    for key, value in changes.items():
        check_known_key(key, device.spec.collect_values(), where)
        set_value(keys, key, value, where)
    try:
        spec = parse_device_spec(keys, device.name)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    return Device(spec, to_toml(keys).encode())


def set_value(content: dict[str, Any], key: str, value: float, source: str) -> None:
    """Give number ``key`` (``section.key``) of a device file's ``keys`` a new ``value``; ``source`` says where from."""
    section, _, name = key.rpartition(".")
    table = content
    for part in section.split("."):
        table = table[part]
    table[name] = value
    content.setdefault("sources", {})[key] = source


def to_toml(content: Mapping[str, Any]) -> str:
    """The ``keys`` of a device file as TOML: single values, then tables, then lists of tables."""
    return "\n".join(_format_lines(content, "")) + "\n"


def _format_lines(content: Mapping[str, Any], prefix: str) -> list[str]:
    lines = _format_pairs({key: value for key, value in content.items() if not isinstance(value, dict | list)})
    for title, section in content.items():
        if isinstance(section, dict):
            # A table that holds nothing but tables needs no header of its own.
            header = (
                []
                if section and all(isinstance(value, dict) for value in section.values())
                else ["", f"[{prefix}{title}]"]
            )
            lines += [*header, *_format_lines(section, f"{prefix}{title}.")]
        elif isinstance(section, list):
            for item in section:
                lines += ["", f"[[{prefix}{title}]]", *_format_pairs(item)]
    return lines


def _format_pairs(values: Mapping[str, Any]) -> list[str]:
    return [
        f"{_format_key(key)} = {_format_text(v) if isinstance(v, str) else json.dumps(v)}" for key, v in values.items()
    ]


def _format_key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _format_text(key)


def _format_text(value: str) -> str:
    # JSON's strings are TOML's, but for the one control character that JSON leaves as it is.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
