"""Registry of bench protocols: protocols of the package by name, other protocol files by path."""

from functools import cache
from importlib import resources
from pathlib import Path
from typing import Annotated

from pydantic import Field, TypeAdapter, ValidationError

from klute_sim.bench.protocols.creep import CreepProtocol
from klute_sim.bench.protocols.frequency import FrequencyResponseProtocol
from klute_sim.bench.protocols.identification import IdentificationProtocol
from klute_sim.bench.protocols.isokinetic import IsokineticProtocol
from klute_sim.bench.protocols.isometric import IsometricProtocol
from klute_sim.bench.protocols.pressure_step import PressureStepProtocol
from klute_sim.bench.protocols.protocol import BenchProtocol
from klute_sim.bench.protocols.quick_release import QuickReleaseProtocol
from klute_sim.bench.protocols.workloop import WorkLoopProtocol
from klute_sim.device.device import list_presets
from klute_sim.errors import InputError
from klute_sim.files.limits import PROTOCOL
from klute_sim.files.reading import MissingFileError, read_bytes
from klute_sim.files.toml import parse_toml, validation_sentence

PROTOCOL_TYPES: dict[str, type[BenchProtocol]] = {
    "isometric": IsometricProtocol,
    "isokinetic": IsokineticProtocol,
    "quick-release": QuickReleaseProtocol,
    "step": PressureStepProtocol,
    "frequency": FrequencyResponseProtocol,
    "creep": CreepProtocol,
    "workloop": WorkLoopProtocol,
    "identification": IdentificationProtocol,
}
"""Protocol classes by the ``kind`` in a protocol file."""
IDENTIFICATION_PROTOCOLS = ("steps", "ramps", "sines", "release", "hold", "slack", "mixed")
"""Names of the identification protocols, in the order in which they are recorded."""

_protocol_adapter: TypeAdapter[BenchProtocol] = TypeAdapter(
    Annotated[
        IsometricProtocol
        | IsokineticProtocol
        | QuickReleaseProtocol
        | PressureStepProtocol
        | FrequencyResponseProtocol
        | CreepProtocol
        | WorkLoopProtocol
        | IdentificationProtocol,
        Field(discriminator="kind"),
    ]
)


def list_protocols() -> list[str]:
    """Return the names of the protocols of the package."""
    folder = resources.files(__package__)
    return sorted(file.name.removesuffix(".toml") for file in folder.iterdir() if file.name.endswith(".toml"))


@cache
def load_identification_protocols() -> dict[str, IdentificationProtocol]:
    """Return the identification protocols by name, in the order in which they are recorded."""
    protocols = {}
    for name in IDENTIFICATION_PROTOCOLS:
        protocol = load_protocol(name)
        assert isinstance(protocol, IdentificationProtocol)
        protocols[name] = protocol
    return protocols


def read_protocol_bytes(name_or_path: str | Path) -> bytes:
    """Return the content of the protocol of that name, or of the file at that path.

    Raises InputError when there is neither.
    """
    name = str(name_or_path)
    if name in ("", "."):  # a shell variable that is not set
        raise InputError("the name of the protocol is empty: give the path of a protocol file, or a name")
    if name in list_protocols():
        return (resources.files(__package__) / f"{name}.toml").read_bytes()
    if name in list_presets():
        raise InputError(f"'{name}' is a device: name a protocol before it (klute-sim bench PROTOCOL {name})")
    try:
        return read_bytes(name, PROTOCOL)
    except MissingFileError:
        raise InputError(
            f"no protocol '{name}': give the path of a protocol file (klute-sim bench NAME --toml prints one to "
            f"start from), or one of {', '.join(list_protocols())}"
        ) from None


def is_protocol(content: bytes) -> bool:
    """Return whether ``content`` is TOML with a ``kind`` of :data:`PROTOCOL_TYPES`."""
    try:
        return parse_toml(content, "file").get("kind") in PROTOCOL_TYPES
    except (InputError, TypeError):  # TypeError: a kind that is a list or a table
        return False


def load_protocol(name_or_path: str | Path) -> BenchProtocol:
    """Return the protocol of that name, or of the file at that path; raise InputError when it is invalid."""
    return parse_protocol(read_protocol_bytes(name_or_path), str(name_or_path))


def parse_protocol(content: bytes, source: str) -> BenchProtocol:
    """Return the protocol that ``content`` (TOML in UTF-8) describes; ``source`` names the file in errors.

    Raises InputError when the content is not TOML or not a valid protocol.
    """
    description = f"protocol file {source}"
    keys = parse_toml(content, description)
    if "kind" not in keys:
        hint = "; it looks like a device file, which stands after the protocol" if "muscle" in keys else ""
        raise InputError(f"{description}: key 'kind' is missing; allowed: {', '.join(PROTOCOL_TYPES)}{hint}")
    if keys["kind"] not in list(PROTOCOL_TYPES):
        raise InputError(f"{description}: kind = {keys['kind']!r} is refused; allowed: {', '.join(PROTOCOL_TYPES)}")
    return _validate_protocol(keys, description)


def change_protocol(protocol: BenchProtocol, changes: dict[str, object]) -> BenchProtocol:
    """Return ``protocol`` with other values of some keys; a single number may stand for a list with one entry.

    Raises InputError for an unknown key and for a refused value.
    """
    keys = protocol.model_dump()
    for key, value in changes.items():
        is_list = isinstance(keys.get(key), list)
        keys[key] = [value] if is_list and not isinstance(value, list | tuple) else value
        if is_list and isinstance(value, tuple):
            keys[key] = list(value)
        keys["sources"].pop(key, None)
    return _validate_protocol(keys, f"protocol {protocol.name}")


def _validate_protocol(keys: dict[str, object], description: str) -> BenchProtocol:
    try:
        protocol = _protocol_adapter.validate_python(keys)
    except ValidationError as error:
        protocol_type = PROTOCOL_TYPES[str(keys["kind"])]
        raise InputError(f"{description}: {validation_sentence(error, protocol_type, location_offset=1)}") from None
    for key in protocol.sources:
        if key not in protocol.numeric_keys():
            raise InputError(f"{description}: [sources] refers to '{key}', which is not a numeric key of this file")
    return protocol
