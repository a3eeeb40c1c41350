"""The baselines that ship with the package, as data: what each is, and how it was made."""

import tomllib
from dataclasses import dataclass
from importlib import resources
from importlib.resources.abc import Traversable

from klute_sim.control import learned, word
from klute_sim.control.pressure import Profile, parse_profile
from klute_sim.control.word import Controller
from klute_sim.device.files import DEFAULT_PROSTHESIS, Device, load, read
from klute_sim.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Baseline:
    """A device under a controller, or a passive foot."""

    name: str
    what: str
    """In one sentence."""
    made: str
    """How: what was chosen by whom, or the command that made it."""
    device: Device
    controller: Controller
    foot: float | None
    """Stiffness of a passive foot in place of the device [N.m/deg]."""


def baselines(only: tuple[str, ...] = ()) -> list[Baseline]:
    """All, or ``only`` those, in the order of the file; raises InputError for a name that there is not."""
    text = (_folder() / "baselines.toml").read_text("utf-8")
    found = tomllib.loads(text)["baseline"]
    names = [entry["name"] for entry in found]
    for name in only:
        if name not in names:
            raise InputError(f"there is no baseline '{name}'; there are: {', '.join(names)}")
    return [_baseline(entry) for entry in found if not only or entry["name"] in only]


def _baseline(entry: dict[str, str | float]) -> Baseline:
    foot, device = entry.get("foot_nm_per_deg"), str(entry.get("device", DEFAULT_PROSTHESIS))
    return Baseline(
        name=str(entry["name"]),
        what=str(entry["what"]),
        made=str(entry["made"]),
        device=read((_folder() / device).read_bytes(), device) if device.endswith(".toml") else load(device),
        controller=_controller(str(entry["controller"])),
        foot=None if foot is None else float(foot),
    )


def _controller(text: str) -> Controller:
    """A file that lies beside the list, or what the command line calls it."""
    if text.endswith(".npz"):
        with resources.as_file(_folder() / text) as path:
            return learned.load(path)
    return _profile(text) if text.endswith(".csv") else word.parse(text)


def _profile(name: str) -> Profile:
    return parse_profile((_folder() / name).read_text("utf-8"), name)


def _folder() -> Traversable:
    return resources.files("klute_sim.baselines")
