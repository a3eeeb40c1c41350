"""Finding and reading device files: presets by name, anything else by path."""

import hashlib
import tomllib
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

from klute_sim.device.schema import DeviceSpec, parse
from klute_sim.device.step import Parameters
from klute_sim.errors import InputError, meant

DEFAULT_PROSTHESIS = "klute-1-1-4-pair"


@dataclass(frozen=True)
class Device:
    """A device file, read and checked."""

    spec: DeviceSpec
    content: bytes
    """The file as it was read: a run keeps it verbatim."""

    @property
    def name(self) -> str:
        """The device's own name."""
        return self.spec.name

    @cached_property
    def parameters(self) -> Parameters:
        """What the law needs, SI."""
        return self.spec.parameters()

    @property
    def digest(self) -> str:
        """SHA-256 of the file."""
        return hashlib.sha256(self.content).hexdigest()


def _preset_folder() -> Traversable:
    return resources.files("klute_sim.device") / "presets"


def preset_names() -> list[str]:
    """Names of the devices that come with the package."""
    return sorted(f.name.removesuffix(".toml") for f in _preset_folder().iterdir() if f.name.endswith(".toml"))


def load(name_or_path: str | Path) -> Device:
    """The preset of that name, or the device file at that path.

    Raises InputError when there is neither, or when the file is not TOML or not a device.
    """
    wanted = str(name_or_path)
    if wanted in ("", "."):  # a shell variable that is not set
        raise InputError("the name of the device is empty: give the path of a device file, or a preset")
    if wanted in preset_names():
        return read((_preset_folder() / f"{wanted}.toml").read_bytes(), wanted)
    try:
        content = Path(wanted).read_bytes()
    except FileNotFoundError:
        every = (
            "give the path of a device file (klute-sim device NAME --toml prints one to start from), or one of "
            f"{', '.join(preset_names())}"
        )
        raise InputError(f"no device '{wanted}': {meant(wanted, preset_names(), every)}") from None
    except OSError as error:
        raise InputError(f"device file {wanted} cannot be read: {error.strerror}") from None
    return read(content, wanted)


def read(content: bytes, where: str) -> Device:
    """The device that ``content`` (TOML, UTF-8) describes; ``where`` names its place in errors."""
    try:
        keys = tomllib.loads(content.decode("utf-8-sig"))  # some editors put a mark in front
    except UnicodeDecodeError:
        raise InputError(f"device file {where} cannot be read: not a UTF-8 text file") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"device file {where} is not valid TOML: {error}") from None
    return Device(parse(keys, where), content)


def refuse_openings(device: Device, what: str) -> None:
    """Raise InputError if the device takes openings of its valve, where ``what`` commands pressures."""
    if device.parameters.supply.opens != 0.0:
        raise InputError(
            f"{what} commands pressures, and '{device.name}' takes openings of its valve; "
            "allowed: a device file with takes = 'pressure' in [valve]"
        )
