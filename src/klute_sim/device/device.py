"""Finding and reading device files: presets by name, anything else by path."""

import hashlib
import tomllib
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

from klute_sim.device.dynamics import DeviceParameters
from klute_sim.device.schema.document import DeviceSpec, parse_device_spec
from klute_sim.errors import InputError, suggest

DEFAULT_DEVICE = "klute-1-1-4-pair"


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
    def parameters(self) -> DeviceParameters:
        """What the law needs, SI."""
        return self.spec.to_parameters()

    @property
    def digest(self) -> str:
        """SHA-256 of the file."""
        return hashlib.sha256(self.content).hexdigest()


def _get_preset_folder() -> Traversable:
    return resources.files("klute_sim.device") / "presets"


def list_presets() -> list[str]:
    """Names of the devices that come with the package."""
    return sorted(f.name.removesuffix(".toml") for f in _get_preset_folder().iterdir() if f.name.endswith(".toml"))


def load_device(name_or_path: str | Path) -> Device:
    """The preset of that name, or the device file at that path.

    Raises InputError when there is neither, or when the file is not TOML or not a device.
    """
    wanted = str(name_or_path)
    if wanted in ("", "."):  # a shell variable that is not set
        raise InputError("the name of the device is empty: give the path of a device file, or a preset")
    if wanted in list_presets():
        return parse_device((_get_preset_folder() / f"{wanted}.toml").read_bytes(), wanted)
    try:
        content = Path(wanted).read_bytes()
    except FileNotFoundError:
        every = (
            "give the path of a device file (klute-sim device NAME --toml prints one to start from), or one of "
            f"{', '.join(list_presets())}"
        )
        raise InputError(f"no device '{wanted}': {suggest(wanted, list_presets(), every)}") from None
    except OSError as error:
        raise InputError(f"device file {wanted} cannot be read: {error.strerror}") from None
    return parse_device(content, wanted)


def parse_device(content: bytes, source: str) -> Device:
    """The device that ``content`` (TOML, UTF-8) describes; ``where`` names its place in errors."""
    try:
        keys = tomllib.loads(content.decode("utf-8-sig"))  # some editors put a mark in front
    except UnicodeDecodeError:
        raise InputError(f"device file {source} cannot be read: not a UTF-8 text file") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"device file {source} is not valid TOML: {error}") from None
    return Device(parse_device_spec(keys, source), content)


def check_takes_pressure(device: Device, commander: str) -> None:
    """Raise InputError if the device takes openings of its valve, where ``what`` commands pressures."""
    if device.parameters.supply.command_is_opening != 0.0:
        raise InputError(
            f"{commander} commands pressures, and '{device.name}' takes openings of its valve; "
            "allowed: a device file with takes = 'pressure' in [valve]"
        )
