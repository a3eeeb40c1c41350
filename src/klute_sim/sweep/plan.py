"""What a sweep walks: every combination of the devices, controllers, speeds, slopes and masses that were listed."""

import hashlib
import itertools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from klute_sim.control.word import Controller
from klute_sim.device.files import Device
from klute_sim.rigs.gait.assembly import GaitOptions
from klute_sim.rigs.gait.build import MODEL_MASS
from klute_sim.rigs.gait.reference import Reference, default
from klute_sim.rigs.gait.spring_foot import SpringFoot
from klute_sim.sweep.software import software


@cache
def _reference() -> Reference:
    """Read once in a process: it takes longer than the rest of a combination."""
    return default()


@dataclass(frozen=True, kw_only=True)
class Combination:
    """One walk: everything that it needs, wherever it is done."""

    device_word: str
    """As it was named: a preset or a file."""
    device: Device
    controller_word: str
    controller: Controller
    speed: float | None
    """[m/s]; None: the reference's own."""
    slope_deg: float
    """Of the ground [degrees], uphill positive; not in radians, so that the table has what was typed."""
    mass: float
    """Of the body [kg]."""
    strides: int
    step: float
    """Time step [s]."""
    foot: float | None = None
    """Stiffness of a passive foot in place of the device [N.m/deg]."""
    software: Mapping[str, str] = field(default_factory=software)
    """Of whoever planned it: it may be walked elsewhere."""

    def options(self) -> GaitOptions:
        """What the gait rig is told; raises InputError for a value no subject or solver has."""
        return GaitOptions(
            mass=self.mass,
            speed=self.speed,
            slope=math.radians(self.slope_deg),
            strides=self.strides,
            step=self.step,
            reference=_reference(),
            foot=None if self.foot is None else SpringFoot(stiffness=math.degrees(self.foot)),
        )

    @property
    def key(self) -> str:
        """Digest of all that its outcomes depend on; what things are called is not among it."""
        who = [self.device.digest, self.controller.describe()]
        how = [self.speed, self.slope_deg, self.mass, self.strides, self.step, self.foot, dict(self.software)]
        return hashlib.sha256(json.dumps([*who, *how], sort_keys=True).encode()).hexdigest()[:32]


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What is combined with what; validated when made. The last one listed here changes first."""

    devices: Mapping[str, Device]
    """As named -> device."""
    controllers: Mapping[str, Controller]
    """As named -> controller."""
    speeds: Sequence[float | None] = (None,)
    """[m/s]; None: the reference's own."""
    slopes_deg: Sequence[float] = (0.0,)
    """[degrees], uphill positive"""
    masses: Sequence[float] = (MODEL_MASS,)
    """[kg]"""
    strides: int = 5
    step: float = 5e-4
    """Time step [s]."""

    def __post_init__(self) -> None:
        """Raise InputError for a value no subject or solver has."""
        for combination in self.combinations():
            combination.options()

    def combinations(self) -> Iterator[Combination]:
        """Every one, in the order of the table."""
        for (device_word, device), (controller_word, controller), speed, slope, mass in itertools.product(
            self.devices.items(), self.controllers.items(), self.speeds, self.slopes_deg, self.masses
        ):
            yield Combination(
                device_word=device_word,
                device=device,
                controller_word=controller_word,
                controller=controller,
                speed=speed,
                slope_deg=slope,
                mass=mass,
                strides=self.strides,
                step=self.step,
            )

    def describe(self) -> dict[str, Any]:
        """The plan in JSON types, device files verbatim: equal plans, equal descriptions."""
        devices = {
            word: {"name": device.name, "sha256": device.digest, "file": device.content.decode("utf-8-sig")}
            for word, device in self.devices.items()
        }
        return {
            "devices": devices,
            "controllers": {word: controller.describe() for word, controller in self.controllers.items()},
            "speeds_m_per_s": list(self.speeds),
            "slopes_deg": list(self.slopes_deg),
            "masses_kg": list(self.masses),
            "strides": self.strides,
            "step_s": self.step,
            "software": software(),
        }
