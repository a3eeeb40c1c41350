"""Convert what a user may pass (an object, a name or a path) into the objects that the package works with."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

from klute_sim.controllers.parse import Controller, parse_controller
from klute_sim.device.device import Device, load_device
from klute_sim.types import ProgressCallback

DeviceLike: TypeAlias = Device | str | Path
"""A device, the name of a preset, or the path of a device file."""
ControllerLike: TypeAlias = Controller | str | Path
"""A controller, a specification such as ``"constant:3.5"``, or the path of a controller file."""


def to_device(device: DeviceLike, foot: str | None = None) -> Device:
    """Return ``device``, loaded if it is a name or a path, with ``foot`` in place of its own (None: its own).

    Raises InputError when there is no such device or foot.
    """
    loaded = device if isinstance(device, Device) else load_device(device)
    return loaded if foot is None else loaded.with_foot(foot)


def to_controller(controller: ControllerLike) -> Controller:
    """Return ``controller``, parsed if it is a specification or a path; raises InputError when it cannot be parsed."""
    return parse_controller(str(controller)) if isinstance(controller, str | Path) else controller


def get_input_name(item: Any) -> str:
    """Return ``item`` as the user typed it, or the name of the object."""
    if isinstance(item, str | Path):
        return str(item)
    return str(getattr(item, "name", None) or item.describe().get("kind"))


def ignore_progress(fraction: float, stage: str) -> None:
    """Do nothing; the progress callback where the user gives none."""


def stage_progress(
    progress: ProgressCallback | None, stage: str, start: float = 0.0, stop: float = 1.0
) -> Callable[[float], None]:
    """Return a callback that reports the fraction of one stage, which spans ``start`` to ``stop`` of the whole."""

    def report(fraction: float) -> None:
        if progress is not None:
            progress(start + (stop - start) * fraction, stage)

    return report
