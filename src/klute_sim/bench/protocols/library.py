"""Finding and reading protocol files: those of the package by name, anything else by path."""

import stat
import tomllib
from importlib import resources
from pathlib import Path
from typing import Annotated

from pydantic import Field, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from klute_sim.bench.protocols.creep import CreepProtocol
from klute_sim.bench.protocols.frequency import FrequencyResponseProtocol
from klute_sim.bench.protocols.isokinetic import IsokineticProtocol
from klute_sim.bench.protocols.isometric import IsometricProtocol
from klute_sim.bench.protocols.pressure_step import PressureStepProtocol
from klute_sim.bench.protocols.protocol import BenchProtocol
from klute_sim.bench.protocols.quick_release import QuickReleaseProtocol
from klute_sim.bench.protocols.workloop import WorkLoopProtocol
from klute_sim.device.device import list_presets
from klute_sim.errors import InputError

PROTOCOL_TYPES: dict[str, type[BenchProtocol]] = {
    "isometric": IsometricProtocol,
    "isokinetic": IsokineticProtocol,
    "quick-release": QuickReleaseProtocol,
    "step": PressureStepProtocol,
    "frequency": FrequencyResponseProtocol,
    "creep": CreepProtocol,
    "workloop": WorkLoopProtocol,
}
"""What a protocol file can say under ``kind``."""
MAX_FILE_BYTES = 1_000_000
"""Size of a file that is read [bytes]."""

_protocol_adapter: TypeAdapter[BenchProtocol] = TypeAdapter(
    Annotated[
        IsometricProtocol
        | IsokineticProtocol
        | QuickReleaseProtocol
        | PressureStepProtocol
        | FrequencyResponseProtocol
        | CreepProtocol
        | WorkLoopProtocol,
        Field(discriminator="kind"),
    ]
)


def list_protocols() -> list[str]:
    """Names of the protocols that come with the package."""
    folder = resources.files(__package__)
    return sorted(file.name.removesuffix(".toml") for file in folder.iterdir() if file.name.endswith(".toml"))


def read_protocol_bytes(name_or_path: str | Path) -> bytes:
    """The protocol file of that name, or at that path; raises InputError when there is neither."""
    wanted = str(name_or_path)
    if wanted in ("", "."):  # a shell variable that is not set
        raise InputError("the name of the protocol is empty: give the path of a protocol file, or a name")
    if wanted in list_protocols():
        return (resources.files(__package__) / f"{wanted}.toml").read_bytes()
    if wanted in list_presets():
        raise InputError(f"'{wanted}' is a device: name a protocol before it (klute-sim bench PROTOCOL {wanted})")
    try:
        return read_small_file(wanted, "protocol")
    except FileNotFoundError:
        raise InputError(
            f"no protocol '{wanted}': give the path of a protocol file (klute-sim bench NAME --toml prints one to "
            f"start from), or one of {', '.join(list_protocols())}"
        ) from None


def read_small_file(path: str, file_type: str) -> bytes:
    """The file at ``path``, which is a file of a ``what``; raises FileNotFoundError.

    Raises InputError for what cannot be read, is no regular file or is larger than :data:`LARGEST`: a device of the
    system may have no end.
    """
    try:
        about = Path(path).stat()
        if not stat.S_ISREG(about.st_mode):
            raise InputError(f"{file_type} file {path} cannot be read: it is no regular file")
        if about.st_size > MAX_FILE_BYTES:
            raise InputError(f"{file_type} file {path} has {about.st_size} bytes; allowed: up to {MAX_FILE_BYTES}")
        return Path(path).read_bytes()
    except FileNotFoundError:
        raise
    except OSError as error:
        raise InputError(f"{file_type} file {path} cannot be read: {error.strerror}") from None


def is_protocol(content: bytes) -> bool:
    """Whether a file with this ``text`` is meant to be a protocol: TOML with a ``kind`` of :data:`KINDS`."""
    try:
        return tomllib.loads(content.decode("utf-8-sig")).get("kind") in PROTOCOL_TYPES
    except (ValueError, TypeError, RecursionError):
        return False


def load_protocol(name_or_path: str | Path) -> BenchProtocol:
    """The protocol of that name, or the protocol file at that path; raises InputError with one sentence."""
    return parse_protocol(read_protocol_bytes(name_or_path), str(name_or_path))


def parse_protocol(content: bytes, source: str) -> BenchProtocol:
    """The protocol that ``text`` (TOML, UTF-8) describes; ``where`` names its place in errors."""
    try:
        keys = tomllib.loads(content.decode("utf-8-sig"))
    except UnicodeDecodeError:
        raise InputError(f"protocol file {source} cannot be read: not a UTF-8 text file") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"protocol file {source} is not valid TOML: {error}") from None
    if "kind" not in keys:
        hint = "; it looks like a device file, which stands after the protocol" if "muscle" in keys else ""
        raise InputError(f"protocol file {source}: key 'kind' is missing; allowed: {', '.join(PROTOCOL_TYPES)}{hint}")
    if keys["kind"] not in list(PROTOCOL_TYPES):
        raise InputError(f"protocol file {source}: kind = {keys['kind']!r}; allowed: {', '.join(PROTOCOL_TYPES)}")
    try:
        protocol = _protocol_adapter.validate_python(keys)
    except ValidationError as error:
        raise InputError(
            f"protocol file {source}: {_format_validation_error(error, PROTOCOL_TYPES[keys['kind']])}"
        ) from None
    for key in protocol.sources:
        if key not in protocol.numeric_keys():
            raise InputError(f"protocol file {source}: sources names '{key}', which is no number of this file")
    return protocol


def _format_validation_error(error: ValidationError, protocol_type: type[BenchProtocol]) -> str:
    # An unknown key is often the misspelt one that is also missing.
    problem: ErrorDetails = min(error.errors(include_url=False), key=lambda p: p["type"] != "extra_forbidden")
    key = ".".join(str(part + 1 if isinstance(part, int) else part) for part in problem["loc"][1:])
    if problem["type"] == "extra_forbidden":
        return f"unknown key '{key}'; allowed here: {', '.join(protocol_type.model_fields)}"
    if problem["type"] == "missing":
        return f"key '{key}' is missing"
    if problem["type"] == "protocol":
        return problem["msg"]
    return f"{key} = {problem['input']!r} is refused: {problem['msg'][0].lower()}{problem['msg'][1:]}"
