"""Finding and reading protocol files: those of the package by name, anything else by path."""

import tomllib
from importlib import resources
from pathlib import Path
from typing import Annotated

from pydantic import Field, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

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
    try:
        return Path(wanted).read_bytes()
    except FileNotFoundError:
        raise InputError(
            f"no protocol '{wanted}': give the path of a protocol file (klute-sim bench NAME --toml prints one to "
            f"start from), or one of {', '.join(names())}"
        ) from None
    except OSError as error:
        raise InputError(f"protocol file {wanted} cannot be read: {error.strerror}") from None


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
    if keys.get("kind") not in KINDS:
        raise InputError(f"protocol file {where}: kind = {keys.get('kind')!r}; allowed: {', '.join(KINDS)}")
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
