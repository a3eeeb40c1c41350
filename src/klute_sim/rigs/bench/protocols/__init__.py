"""Finding and reading protocol files: those of the package by name, anything else by path."""

import stat
import tomllib
from importlib import resources
from pathlib import Path
from typing import Annotated

from pydantic import Field, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from klute_sim.device.files import preset_names
from klute_sim.errors import InputError
from klute_sim.rigs.bench.kinds.creep import Creep
from klute_sim.rigs.bench.kinds.frequency import Frequency
from klute_sim.rigs.bench.kinds.isokinetic import Isokinetic
from klute_sim.rigs.bench.kinds.isometric import Isometric
from klute_sim.rigs.bench.kinds.quick_release import QuickRelease
from klute_sim.rigs.bench.kinds.step import Step
from klute_sim.rigs.bench.kinds.workloop import Workloop
from klute_sim.rigs.bench.plan import Protocol

KINDS: dict[str, type[Protocol]] = {
    "isometric": Isometric,
    "isokinetic": Isokinetic,
    "quick-release": QuickRelease,
    "step": Step,
    "frequency": Frequency,
    "creep": Creep,
    "workloop": Workloop,
}
"""What a protocol file can say under ``kind``."""
LARGEST = 1_000_000
"""Size of a file that is read [bytes]."""

_any: TypeAdapter[Protocol] = TypeAdapter(
    Annotated[
        Isometric | Isokinetic | QuickRelease | Step | Frequency | Creep | Workloop,
        Field(discriminator="kind"),
    ]
)


def names() -> list[str]:
    """Names of the protocols that come with the package."""
    folder = resources.files(__name__)
    return sorted(file.name.removesuffix(".toml") for file in folder.iterdir() if file.name.endswith(".toml"))


def content(name_or_path: str | Path) -> bytes:
    """The protocol file of that name, or at that path; raises InputError when there is neither."""
    wanted = str(name_or_path)
    if wanted in ("", "."):  # a shell variable that is not set
        raise InputError("the name of the protocol is empty: give the path of a protocol file, or a name")
    if wanted in names():
        return (resources.files(__name__) / f"{wanted}.toml").read_bytes()
    if wanted in preset_names():
        raise InputError(f"'{wanted}' is a device: name a protocol before it (klute-sim bench PROTOCOL {wanted})")
    try:
        return small(wanted, "protocol")
    except FileNotFoundError:
        raise InputError(
            f"no protocol '{wanted}': give the path of a protocol file (klute-sim bench NAME --toml prints one to "
            f"start from), or one of {', '.join(names())}"
        ) from None


def small(path: str, what: str) -> bytes:
    """The file at ``path``, which is a file of a ``what``; raises FileNotFoundError.

    Raises InputError for what cannot be read, is no regular file or is larger than :data:`LARGEST`: a device of the
    system may have no end.
    """
    try:
        about = Path(path).stat()
        if not stat.S_ISREG(about.st_mode):
            raise InputError(f"{what} file {path} cannot be read: it is no regular file")
        if about.st_size > LARGEST:
            raise InputError(f"{what} file {path} has {about.st_size} bytes; allowed: up to {LARGEST}")
        return Path(path).read_bytes()
    except FileNotFoundError:
        raise
    except OSError as error:
        raise InputError(f"{what} file {path} cannot be read: {error.strerror}") from None


def is_protocol(text: bytes) -> bool:
    """Whether a file with this ``text`` is meant to be a protocol: TOML with a ``kind`` of :data:`KINDS`."""
    try:
        return tomllib.loads(text.decode("utf-8-sig")).get("kind") in KINDS
    except (ValueError, TypeError, RecursionError):
        return False


def load(name_or_path: str | Path) -> Protocol:
    """The protocol of that name, or the protocol file at that path; raises InputError with one sentence."""
    return read(content(name_or_path), str(name_or_path))


def read(text: bytes, where: str) -> Protocol:
    """The protocol that ``text`` (TOML, UTF-8) describes; ``where`` names its place in errors."""
    try:
        keys = tomllib.loads(text.decode("utf-8-sig"))
    except UnicodeDecodeError:
        raise InputError(f"protocol file {where} cannot be read: not a UTF-8 text file") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"protocol file {where} is not valid TOML: {error}") from None
    if "kind" not in keys:
        hint = "; it looks like a device file, which stands after the protocol" if "muscle" in keys else ""
        raise InputError(f"protocol file {where}: key 'kind' is missing; allowed: {', '.join(KINDS)}{hint}")
    if keys["kind"] not in list(KINDS):
        raise InputError(f"protocol file {where}: kind = {keys['kind']!r}; allowed: {', '.join(KINDS)}")
    try:
        protocol = _any.validate_python(keys)
    except ValidationError as error:
        raise InputError(f"protocol file {where}: {_problem(error, KINDS[keys['kind']])}") from None
    for key in protocol.sources:
        if key not in protocol.numbers():
            raise InputError(f"protocol file {where}: sources names '{key}', which is no number of this file")
    return protocol


def _problem(error: ValidationError, kind: type[Protocol]) -> str:
    # An unknown key is often the misspelt one that is also missing.
    problem: ErrorDetails = min(error.errors(include_url=False), key=lambda p: p["type"] != "extra_forbidden")
    key = ".".join(str(part + 1 if isinstance(part, int) else part) for part in problem["loc"][1:])
    if problem["type"] == "extra_forbidden":
        return f"unknown key '{key}'; allowed here: {', '.join(kind.model_fields)}"
    if problem["type"] == "missing":
        return f"key '{key}' is missing"
    if problem["type"] == "protocol":
        return problem["msg"]
    return f"{key} = {problem['input']!r} is refused: {problem['msg'][0].lower()}{problem['msg'][1:]}"
