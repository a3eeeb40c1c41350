"""The baselines that ship with the package: devices, controllers, and how they were made."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from importlib.resources.abc import Traversable

from klute_sim.controllers import learned, parse
from klute_sim.controllers.parse import Controller
from klute_sim.controllers.pressure import PressureProfile, parse_profile
from klute_sim.device.device import DEFAULT_DEVICE, Device, load_device, parse_device
from klute_sim.errors import InputError
from klute_sim.files.toml import parse_toml


@dataclass(frozen=True, kw_only=True)
class Baseline:
    """A device under a controller, or a passive foot; one that ships with the package, or the user's own."""

    name: str
    """Name of the baseline."""
    description: str
    """One sentence for the user."""
    origin: str
    """How the baseline was made: the choice and who made it, or the command."""
    device: Device
    """Device that the controller commands, or that the passive foot replaces."""
    controller: Controller
    """Controller of the device; off for a passive foot."""
    foot_stiffness: float | None
    """Stiffness of a passive foot in place of the device [N.m/deg]; None: the device."""
    is_shipped: bool = True
    """Whether it ships with the package; otherwise it is the user's own."""


def load_baselines(only: Sequence[str] = ()) -> list[Baseline]:
    """Return all baselines, or those named in ``only``, in the order of the file.

    Raises InputError when a name is unknown.
    """
    entries = parse_toml((_get_data_folder() / "baselines.toml").read_bytes(), "baselines.toml")["baseline"]
    names = [entry["name"] for entry in entries]
    for name in only:
        if name not in names:
            raise InputError(f"there is no baseline '{name}'; allowed: {', '.join(names)}")
    return [_parse_baseline(entry) for entry in entries if not only or entry["name"] in only]


def _parse_baseline(entry: dict[str, str | float]) -> Baseline:
    stiffness, device = entry.get("spring_foot_nm_per_deg"), str(entry.get("device", DEFAULT_DEVICE))
    return Baseline(
        name=str(entry["name"]),
        description=str(entry["description"]),
        origin=str(entry["origin"]),
        device=parse_device((_get_data_folder() / device).read_bytes(), device)
        if device.endswith(".toml")
        else load_device(device),
        controller=_load_controller(str(entry["controller"])),
        foot_stiffness=None if stiffness is None else float(stiffness),
    )


def _load_controller(spec: str) -> Controller:
    """Return the controller in the data file ``spec``, or that of the specification ``spec``."""
    if spec.endswith(".npz"):
        with resources.as_file(_get_data_folder() / spec) as path:
            return learned.load_policy_controller(path)
    return _load_profile(spec) if spec.endswith(".csv") else parse.parse_controller(spec)


def _load_profile(name: str) -> PressureProfile:
    return parse_profile((_get_data_folder() / name).read_text("utf-8"), name)


def _get_data_folder() -> Traversable:
    return resources.files("klute_sim.baselines")
