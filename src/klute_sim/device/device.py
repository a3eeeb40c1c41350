"""The device: load it from a preset or a file, build it from keywords, change it, and save it."""

import hashlib
import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from klute_sim.device.dynamics import DeviceParameters
from klute_sim.device.preset_files import read_presets
from klute_sim.device.schema.document import (
    Damper,
    DeviceSpec,
    Mounting,
    PublishedMeasurement,
    Tendon,
    parse_device_spec,
)
from klute_sim.device.schema.foot import RIGID_FOOT, FootSection, parse_foot_name
from klute_sim.device.schema.muscle import Muscle
from klute_sim.device.schema.parts import Cylinder
from klute_sim.device.schema.supply import Chamber, Leak, Line, Supply, Tank, Valve
from klute_sim.errors import InputError, suggest, suggest_from
from klute_sim.files.limits import DEVICE
from klute_sim.files.reading import MissingFileError, read_bytes
from klute_sim.files.toml import format_toml, parse_toml
from klute_sim.plausibility.device_numbers import check_device_numbers, describe_possible_units
from klute_sim.plausibility.finding import require_accepted

DEFAULT_DEVICE = "klute-1-1-4-pair"
"""Preset of the default prosthesis."""


MAX_INTEGER = 10**300
"""Bound of integers that a float can hold."""


@dataclass(frozen=True, init=False, repr=False)
class Device:
    """A muscle-tendon unit: muscle, damper, tendon, supply and effects, as a device file describes them.

    A device without a muscle is a cylinder, a tendon or a foot alone.

    :func:`load_device` loads a preset or a file; the constructor builds a device from sections.
    """

    spec: DeviceSpec
    """Checked content of the device file."""
    content: bytes
    """Device file as TOML: the bytes that were read, or those written for a device that was built or changed here.

    A run folder holds a verbatim copy. :meth:`with_spec` keeps the content, so only :attr:`spec` then describes the
    device."""

    def __init__(
        self,
        *,
        muscle: Muscle | None = None,
        supply: Supply | None = None,
        cylinder: Cylinder | None = None,
        name: str = "device",
        description: str = "",
        damper: Damper | None = None,
        tendon: Tendon | None = None,
        valve: Valve | None = None,
        line: Line | None = None,
        chamber: Chamber | None = None,
        tank: Tank | None = None,
        leak: Leak | None = None,
        mounting: Mounting | None = None,
        foot: FootSection | None = None,
        effects: Mapping[str, Mapping[str, float | str]] | None = None,
        published: Sequence[PublishedMeasurement] = (),
        sources: Mapping[str, str] | None = None,
    ) -> None:
        """Build a device from the sections of a device file.

        ``effects`` maps the name of an effect to its parameters and, optionally, its ``form``. ``sources`` maps
        ``section.key`` to the source of the number.

        Raises InputError when sections do not fit together.
        """
        sections = {
            **{"muscle": muscle, "cylinder": cylinder, "damper": damper, "tendon": tendon, "supply": supply},
            **{"valve": valve, "line": line},
            **{"chamber": chamber, "tank": tank, "leak": leak, "mounting": mounting, "foot": foot},
        }
        content: dict[str, Any] = {"name": name, "description": description}
        for title, section in sections.items():
            if section is not None:
                content[title] = section.model_dump(exclude_unset=True, exclude_none=True)
        content["effects"] = {effect: dict(parameters) for effect, parameters in (effects or {}).items()}
        content["published"] = [measurement.model_dump() for measurement in published]
        content["sources"] = dict(sources or {})
        content = {key: value for key, value in content.items() if value}
        self._initialize(parse_device_spec(content, name), format_toml(content).encode())

    def _initialize(self, spec: DeviceSpec, content: bytes) -> None:
        object.__setattr__(self, "spec", spec)
        object.__setattr__(self, "content", content)

    @classmethod
    def from_spec(cls, spec: DeviceSpec, content: bytes) -> "Device":
        """Return the device of a checked ``spec`` and the TOML ``content`` that it was read from."""
        device = cls.__new__(cls)
        device._initialize(spec, content)
        return device

    @property
    def name(self) -> str:
        """Name of the device."""
        return self.spec.name

    @cached_property
    def parameters(self) -> DeviceParameters:
        """Physical parameters in SI units."""
        return self.spec.to_parameters()

    @property
    def digest(self) -> str:
        """SHA-256 of the device file."""
        return hashlib.sha256(self.content).hexdigest()

    def with_spec(self, spec: DeviceSpec) -> "Device":
        """Return a device with another checked ``spec`` and the file content of this one."""
        return Device.from_spec(spec, self.content)

    def with_changes(
        self, changes: Mapping[str, float], source: str = "changed", *, name: str | None = None
    ) -> "Device":
        """Return a device with changed numbers.

        ``changes`` maps ``section.key`` to a value in the unit of the key, such as
        ``{"tendon.stiffness_1_n_per_mm": 80}``. The file of the new device holds the changed numbers and names
        ``source`` as their source. With a ``name`` it is another device: the description and the published measurements
        of this one are left out. Without changes and a name the device itself is returned.

        Raises InputError when a key is not a number of the device or a value is not allowed.
        """
        if not changes and name is None:
            return self
        content, known = parse_toml(self.content, f"device {self.name}"), self.spec.collect_values()
        for key, value in changes.items():
            if key not in known:
                hint = suggest_from(key, known, "docs/devices.md lists all")
                raise InputError(f"{source}: '{key}' is not a number of device '{self.name}'; {hint}")
            set_number(content, key, value, source)
        if name is not None:
            content = {key: value for key, value in content.items() if key not in ("description", "published")}
            content["name"] = name
        try:
            spec = parse_device_spec(content, self.name)
        except InputError as error:
            raise InputError(f"{source}: {error}") from None
        return Device.from_spec(spec, format_toml(content).encode())

    def with_effect(
        self, name: str, *, form: str | None = None, source: str = "changed", **parameters: float
    ) -> "Device":
        """Return a device with effect ``name`` added or replaced.

        ``form`` is the form of the effect (None: its default form); ``parameters`` are in the units of their keys, such
        as ``with_effect("seal_friction", force_n=15)``.

        Raises InputError when there is no such effect, a parameter is unknown, missing or out of range, or the effect
        contradicts a section.
        """
        content = parse_toml(self.content, f"device {self.name}")
        section: dict[str, float | str] = {} if form is None else {"form": form}
        content.setdefault("effects", {})[name] = section | parameters
        sources: dict[str, str] = content.setdefault("sources", {})
        prefix = f"effects.{name}."
        for key in [key for key in sources if key.startswith(prefix)]:
            del sources[key]
        sources.update({prefix + key: source for key in parameters})
        return Device.from_spec(parse_device_spec(content, self.name), format_toml(content).encode())

    def with_foot(self, name: str) -> "Device":
        """Return a device with the foot ``name``, such as ``"sach"`` or ``"sach+shoe"``, in place of its own foot.

        Raises InputError when there is no such foot.
        """
        section = parse_foot_name(name)
        if self.spec.foot is None and name == RIGID_FOOT:
            return self
        content = parse_toml(self.content, f"device {self.name}")
        content["foot"] = section
        sources = content.get("sources", {})
        for key in [key for key in sources if key.startswith("foot.")]:
            del sources[key]
        return Device.from_spec(parse_device_spec(content, self.name), format_toml(content).encode())

    def save(self, path: str | Path) -> None:
        """Write the device file to ``path``; raises InputError when the file cannot be written."""
        try:
            Path(path).write_bytes(self.content)
        except OSError as error:
            raise InputError(f"device file {path} cannot be written: {error.strerror}") from None

    def __repr__(self) -> str:
        """Return the name of the device and the names of its effects."""
        effects = f", effects: {', '.join(self.spec.effects)}" if self.spec.effects else ""
        return f"<Device '{self.name}'{effects}>"

    def _repr_html_(self) -> str:
        """Return a table of all numbers with their sources, for notebooks."""
        sources = self.spec.collect_sources()
        rows = "".join(
            f"<tr><td>{html.escape(key)}</td><td>{value:g}</td><td>{html.escape(sources.get(key, ''))}</td></tr>"
            for key, value in self.spec.collect_values().items()
        )
        title = f"<p><b>{html.escape(self.name)}</b>: {html.escape(self.spec.description)}</p>"
        return f"{title}<table><tr><th>number</th><th>value</th><th>source</th></tr>{rows}</table>"


def set_number(content: dict[str, Any], key: str, value: float, source: str) -> None:
    """Set number ``key`` (``section.key``) in the ``content`` of a device file and record its ``source``."""
    section, _, name = key.rpartition(".")
    table = content
    for part in section.split("."):
        table = table[part]
    table[name] = value
    content.setdefault("sources", {})[key] = source


def list_presets() -> list[str]:
    """Return the names of the devices that come with the package."""
    return list(read_presets())


def load_device(name_or_path: str | Path) -> Device:
    """Return the preset of that name, or the device in the file at that path.

    Raises InputError when neither exists, or when the file is not a valid device file. The numbers of a file must also
    be plausible, except those that its key ``accept`` names.
    """
    name = str(name_or_path)
    if name in ("", "."):  # a shell variable that is not set
        raise InputError("the name of the device is empty: give the path of a device file, or a preset")
    if name in read_presets():
        return parse_device(read_presets()[name], name)
    try:
        content = read_bytes(name, DEVICE)
    except MissingFileError:
        hint = (
            "give the path of a device file (klute-sim device NAME --toml prints one to start from), or one of "
            f"{', '.join(list_presets())}"
        )
        raise InputError(f"no device '{name}': {suggest(name, list_presets(), hint)}") from None
    try:
        device = parse_device(content, name)
    except InputError as error:
        guess = describe_possible_units(_collect_numbers(parse_toml(content, f"device file {name}")), str(error))
        raise (InputError(f"{error}; {guess}") if guess else error) from None
    findings = check_device_numbers(device.spec.collect_values(), f"device file {name}")
    require_accepted(findings, device.spec.accept, _format_accept_key)
    return device


def _collect_numbers(content: Mapping[str, Any]) -> dict[str, float]:
    """Return ``section.key`` -> number for the unchecked ``content`` of a device file."""
    return {
        f"{title}.{key}": float(value)
        for title, section in content.items()
        if isinstance(section, dict)
        for key, value in section.items()
        if isinstance(value, float) or (type(value) is int and abs(value) < MAX_INTEGER)
    }


def _format_accept_key(names: Sequence[str]) -> str:
    return f"the line accept = [{', '.join(map(repr, names))}] above the first section of the file"


def parse_device(content: bytes, source: str) -> Device:
    """Return the device that ``content`` (TOML, UTF-8) describes; ``source`` names the file in errors."""
    return Device.from_spec(parse_device_spec(parse_toml(content, f"device file {source}"), source), content)


def check_accepts_pressure(device: Device, command_source: str) -> None:
    """Raise InputError when ``command_source`` commands pressures but the device expects valve openings."""
    if device.parameters.supply.command_is_opening != 0.0:
        raise InputError(
            f"{command_source} commands pressures, but the commands of '{device.name}' are openings of its valve; "
            "allowed: a device file with command = 'pressure' in [valve]"
        )


def check_is_testable(device: Device, place: str = "") -> None:
    """Raise InputError when ``device`` has no part with a force on a tester; ``place`` stands before the sentence."""
    if device.spec.muscle is None and device.spec.cylinder is None and device.spec.tendon is None:
        raise InputError(
            f"{place}device '{device.name}' has nothing that a tester can pull; allowed: a device with [muscle], "
            "[cylinder] or [tendon]. A [foot] has no force on a tester: describe a foot alone as a [tendon], a spring "
            "whose length increases by the compression of the foot"
        )
