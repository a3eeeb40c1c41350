"""Limits of the numbers of a device file, for programs that choose numbers."""

import math
from functools import cache
from typing import Any, get_args

from klute_sim.device.schema import effects as schema_effects
from klute_sim.device.schema.document import DeviceSpec


def find_limits(key: str) -> tuple[float, float]:
    """Return the smallest and the largest value that number ``key`` (``section.key``) may have in a device file.

    An open limit is the nearest number inside. Numbers of effects have the limits of the catalogue, relations between
    numbers are not considered.
    """
    section, _, name = key.partition(".")
    if section == "effects":
        return schema_effects.find_parameter_limits(*name.split("."))
    return _find_section_limits(section, name)


@cache
def _find_section_limits(section: str, name: str) -> tuple[float, float]:
    lower, upper = -math.inf, math.inf
    for limit in _list_limits(DeviceSpec.model_fields[section].annotation, name):
        lower = max(lower, getattr(limit, "ge", -math.inf), math.nextafter(getattr(limit, "gt", -math.inf), math.inf))
        upper = min(upper, getattr(limit, "le", math.inf), math.nextafter(getattr(limit, "lt", math.inf), -math.inf))
    return lower, upper


def _list_limits(section: Any, name: str) -> list[Any]:
    """Return the limits in the annotation of key ``name`` of a ``section``, which may be optional."""
    models = [option for option in (section, *get_args(section)) if hasattr(option, "model_fields")]
    field = models[0].model_fields[name]
    nested = [metadata for option in get_args(field.annotation) for metadata in getattr(option, "__metadata__", ())]
    limits = [entry for metadata in nested for entry in getattr(metadata, "metadata", [metadata])]
    return [*field.metadata, *limits]
