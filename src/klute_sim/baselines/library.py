"""The baselines that ship with the package, as data: what each is, and how it was made."""

import tomllib
from dataclasses import dataclass
from importlib import resources
from importlib.resources.abc import Traversable

from klute_sim.controllers import learned, parse
from klute_sim.controllers.parse import Controller
from klute_sim.controllers.pressure import PressureProfile, parse_profile
from klute_sim.device.device import DEFAULT_DEVICE, Device, load_device, parse_device
from klute_sim.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Baseline:
    """A device under a controller, or a passive foot."""

    name: str
    description: str
    """In one sentence."""
    origin: str
    """How: what was chosen by whom, or the command that made it."""
    device: Device
    controller: Controller
    foot_stiffness: float | None
    """Stiffness of a passive foot in place of the device [N.m/deg]."""


def load_baselines(only: tuple[str, ...] = ()) -> list[Baseline]:
    """All, or ``only`` those, in the order of the file; raises InputError for a name that there is not."""
    text = (_get_data_folder() / "baselines.toml").read_text("utf-8")
    found = tomllib.loads(text)["baseline"]
    names = [entry["name"] for entry in found]
    for name in only:
        if name not in names:
            raise InputError(f"there is no baseline '{name}'; there are: {', '.join(names)}")
    return [_parse_baseline(entry) for entry in found if not only or entry["name"] in only]


def _parse_baseline(entry: dict[str, str | float]) -> Baseline:
    foot, device = entry.get("foot_nm_per_deg"), str(entry.get("device", DEFAULT_DEVICE))
    return Baseline(
        name=str(entry["name"]),
        description=str(entry["what"]),
        origin=str(entry["made"]),
        device=parse_device((_get_data_folder() / device).read_bytes(), device)
        if device.endswith(".toml")
        else load_device(device),
        controller=_load_controller(str(entry["controller"])),
        foot_stiffness=None if foot is None else float(foot),
    )


def _load_controller(text: str) -> Controller:
    """A file that lies beside the list, or what the command line calls it."""
    if text.endswith(".npz"):
        with resources.as_file(_get_data_folder() / text) as path:
            return learned.load_policy_controller(path)
    return _load_profile(text) if text.endswith(".csv") else parse.parse_controller(text)


def _load_profile(name: str) -> PressureProfile:
    return parse_profile((_get_data_folder() / name).read_text("utf-8"), name)


def _get_data_folder() -> Traversable:
    return resources.files("klute_sim.baselines")
