"""Ranges of the numbers and effects of a device, from which an environment draws at each reset."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from numbers import Real
from typing import Any, Self

import numpy as np

from klute_sim.device.device import Device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.device.schema.document import parse_device_spec
from klute_sim.effects import catalogue
from klute_sim.errors import InputError
from klute_sim.files.toml import format_toml, parse_toml

GRID_SIZE = 5
"""Number of grid values, including both ends, of what changes more of a model than a row of numbers."""
MAX_VARIATION_FRACTION = 0.5
"""Largest allowed relative deviation from a nominal value."""
MAX_DRAWS = 100
"""Largest number of draws for one valid device (assumed)."""
PARAMETER_FIELD = "actuator_user"
"""Field of the model with the device parameters."""

Range = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class DeviceRanges:
    """Ranges of the domain randomisation, validated at construction; an absent range keeps the nominal value."""

    device: Mapping[str, float] = field(default_factory=dict)
    """Largest relative deviation by ``section.key`` of the device file."""
    effects: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Range by effect and parameter; ``form`` selects a form, as in a device file."""

    def __post_init__(self) -> None:
        """Raise InputError when a range is invalid."""
        _check_mapping("device", self.device, 'numbers of the device file with fractions, {"muscle.c10_kpa": 0.1}')
        for name, fraction in self.device.items():
            check_fraction(name, fraction)
        _check_mapping("effects", self.effects, "effects with the ranges of their parameters")
        for effect, content in self.effects.items():
            _check_mapping(f"effects.{effect}", content, 'ranges by parameter, {"time_constant_s": (0, 0.05)}')
            for key, value in content.items():
                if key != "form":
                    parse_range(f"effects.{effect}.{key}", value)

    @classmethod
    def from_mapping(cls, ranges: "Self | Mapping[str, Any] | None") -> Self:
        """Return the ranges of a mapping with these names; raises InputError when a name is unknown."""
        if ranges is None or isinstance(ranges, cls):
            return ranges or cls()
        known = [range_field.name for range_field in fields(cls)]
        if not isinstance(ranges, Mapping):
            raise InputError(f"domain_randomization is {ranges!r}; allowed: ranges by name, {', '.join(known)}")
        for name in ranges:
            if name not in known:
                raise InputError(f"domain_randomization has no '{name}'; allowed: {', '.join(known)}")
        return cls(**ranges)


def check_fraction(name: str, fraction: Any) -> None:
    """Raise InputError when the relative deviation ``fraction`` of the number ``name`` is out of range."""
    if isinstance(fraction, Mapping):
        keys = ", ".join(f'"{name}.{key}"' for key in fraction)
        raise InputError(f"domain_randomization has the table '{name}'; allowed: whole keys in quotation marks, {keys}")
    if not (isinstance(fraction, Real) and 0.0 <= float(fraction) <= MAX_VARIATION_FRACTION):
        raise InputError(
            f"domain_randomization has {name} = {fraction}; allowed: a fraction from 0 to {MAX_VARIATION_FRACTION:g}"
        )


def _check_mapping(name: str, value: Any, allowed: str) -> None:
    """Raise InputError unless ``value`` is a mapping; ``allowed`` describes it."""
    if not isinstance(value, Mapping):
        raise InputError(f"domain_randomization has {name} = {value!r}; allowed: {allowed}")


def parse_range(name: str, value: Any) -> Range:
    """Return both ends of the range ``value``; raises InputError unless it has two, finite and in order."""
    try:
        low, high = (float(end) for end in (() if isinstance(value, str) else value))
    except (TypeError, ValueError):
        raise InputError(
            f"domain_randomization has {name} = {value!r}; allowed: two numbers, lower limit first"
        ) from None
    if not -np.inf < low <= high < np.inf:
        raise InputError(
            f"domain_randomization has {name} = ({low:g}, {high:g}); allowed: two finite numbers, lower limit first"
        )
    return low, high


def build_parameter_ranges(device: Device, ranges: DeviceRanges) -> dict[str, Range]:
    """Return the key of each number of ``device`` that ``ranges`` vary, with the ends of its range.

    ``device`` has the effects already (:func:`add_mean_effects`). Raises InputError when a number cannot vary, or the
    device with one end of a range is not valid.
    """
    values, parameter_ranges = device.spec.collect_values(), {}
    allowed_keys = [
        key for key, value in values.items() if isinstance(value, float) and not key.startswith(("mounting.", "foot."))
    ]
    for key, fraction in ranges.device.items():
        if key not in allowed_keys:
            raise InputError(
                f"domain_randomization cannot vary '{key}' of '{device.name}'; allowed: {', '.join(allowed_keys)}"
            )
        parameter_ranges[key] = (values[key] * (1.0 - fraction), values[key] * (1.0 + fraction))
    for effect, content in ranges.effects.items():
        effect_ranges = {key: value for key, value in content.items() if key != "form"}
        parameter_ranges |= {f"effects.{effect}.{key}": parse_range(key, value) for key, value in effect_ranges.items()}
    for key, ends in parameter_ranges.items():
        for end in ends:
            device.with_changes({key: end}, "domain_randomization")
    return parameter_ranges


def sample_device(
    device: Device, parameter_ranges: Mapping[str, Range], rng: np.random.Generator
) -> tuple[DeviceParameters, dict[str, float]]:
    """Return the parameters of ``device`` with a number drawn from each of ``parameter_ranges``, and these numbers.

    Numbers that contradict each other, such as a bladder that is wider than its braid, are drawn again. Raises
    InputError when :data:`MAX_DRAWS` draws in succession make no valid device.
    """
    for _ in range(MAX_DRAWS):
        numbers = {key: float(rng.uniform(*ends)) for key, ends in parameter_ranges.items()}
        try:
            return device.with_changes(numbers, "domain_randomization").parameters, numbers
        except InputError as error:
            reason = error
    raise InputError(
        f"domain_randomization found no valid device in {MAX_DRAWS} draws ({reason}); allowed: ranges in which most "
        "devices are valid"
    )


def add_mean_effects(device: Device, effects: Mapping[str, Mapping[str, Any]]) -> Device:
    """Return ``device`` with ``effects`` (effect to parameter to range) at the middle of their ranges.

    Raises InputError when an effect has no such parameter or the device cannot have the effect.
    """
    if not effects:
        return device
    document = parse_toml(device.content, f"device {device.name}")
    for name, content in effects.items():
        if catalogue.find_form(name, None)[0].kind == "body":
            raise InputError(
                f"effect '{name}' belongs to the body and cannot be randomised; allowed: effects of the device"
            )
        catalogue.find_form(name, content.get("form"))
        mean_values = {
            key: value if key == "form" else 0.5 * sum(parse_range(key, value)) for key, value in content.items()
        }
        document.setdefault("effects", {})[name] = document.get("effects", {}).get(name, {}) | mean_values
    return Device.from_spec(
        parse_device_spec(document, f"{device.name} with randomised effects"), format_toml(document).encode()
    )
