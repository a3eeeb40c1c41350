"""Sources that were copied from a preset while the number beside them was changed."""

from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

from klute_sim.device.preset_files import read_presets
from klute_sim.files.toml import parse_toml


class SourcedNumber(NamedTuple):
    """A number of a preset and the text of its source."""

    source: str
    value: float


def find_outdated_sources(sources: Mapping[str, str], values: Mapping[str, float]) -> dict[str, float]:
    """Return the keys of ``values`` whose source is that of another value in a preset, with this value.

    The first of the presets that have a source decides: presets are in order of the number of sources, and then of
    values, that were copied from them. A source belongs to its value whatever it says: the reason of an assumption is
    not the reason of another value.
    """
    presets = sorted(_read_sourced_numbers(), key=lambda preset: _count_copies(preset, sources, values), reverse=True)
    outdated = {}
    for key, value in values.items():
        originals = [
            preset[key].value for preset in presets if key in preset and preset[key].source == sources.get(key)
        ]
        if originals and originals[0] != value:
            outdated[key] = originals[0]
    return outdated


def _count_copies(
    preset: Mapping[str, SourcedNumber], sources: Mapping[str, str], values: Mapping[str, float]
) -> tuple[int, int]:
    """Return how many sources, and how many numbers, equal those of ``preset``."""
    return (
        sum(sources.get(key) == number.source for key, number in preset.items()),
        sum(values.get(key) == number.value for key, number in preset.items()),
    )


@cache
def _read_sourced_numbers() -> list[dict[str, SourcedNumber]]:
    """Return ``section.key`` -> number and source for each preset."""
    presets = []
    for name, content in read_presets().items():
        document = parse_toml(content, f"device file {name}")
        sources: dict[str, str] = document["sources"]
        presets.append({key: SourcedNumber(source, _get_number(document, key)) for key, source in sources.items()})
    return presets


def _get_number(document: Mapping[str, Any], key: str) -> float:
    """Return the number ``section.key`` of the content of a device file."""
    section, _, name = key.rpartition(".")
    table = document
    for part in section.split("."):
        table = table[part]
    return float(table[name])
