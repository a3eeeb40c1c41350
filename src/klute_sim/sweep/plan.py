"""What a sweep walks: every combination of devices, controllers, walkers, speeds and slopes that were listed."""

import hashlib
import itertools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from klute_sim.control.pressure import off
from klute_sim.control.word import Controller
from klute_sim.device.files import Device
from klute_sim.rigs.gait.assembly import GaitOptions
from klute_sim.rigs.gait.build import MODEL_MASS, MODEL_STATURE
from klute_sim.rigs.gait.reference import Reference, default
from klute_sim.rigs.gait.spring_foot import SpringFoot
from klute_sim.sweep.software import software

ABLE_BODIED = "able-bodied"
"""The word for the package's own reference."""


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
    stature: float = MODEL_STATURE
    """[m]"""
    reference_word: str = ABLE_BODIED
    reference: Reference | None = None
    """What is walked on; None: the package's own."""
    foot: float | None = None
    """Stiffness of a passive foot in place of the device [N.m/deg]."""
    software: Mapping[str, str] = field(default_factory=software)
    """Of whoever planned it: it may be walked elsewhere."""

    def options(self) -> GaitOptions:
        """What the gait rig is told; raises InputError for a value no subject or solver has."""
        return GaitOptions(
            mass=self.mass,
            stature=self.stature,
            speed=self.speed,
            slope=math.radians(self.slope_deg),
            strides=self.strides,
            step=self.step,
            reference=self.reference or _reference(),
            foot=None if self.foot is None else SpringFoot(stiffness=math.degrees(self.foot)),
        )

    @property
    def key(self) -> str:
        """Digest of all that its outcomes depend on; what things are called is not among it."""
        human = self.reference and [self.reference.digest, self.reference.stride_time]
        who = [self.device.digest, self.controller.describe(), human, self.stature]
        how = [self.speed, self.slope_deg, self.mass, self.strides, self.step, self.foot, dict(self.software)]
        return hashlib.sha256(json.dumps([*who, *how], sort_keys=True).encode()).hexdigest()[:32]


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What is combined with what; validated when made. The last one listed here changes first."""

    devices: Mapping[str, Device]
    """As named -> device."""
    controllers: Mapping[str, Controller]
    """As named -> controller."""
    references: Mapping[str, Reference | None] = field(default_factory=lambda: {ABLE_BODIED: None})
    """As named -> reference; None: the package's own."""
    speeds: Sequence[float | None] = (None,)
    """[m/s]; None: the reference's own."""
    slopes_deg: Sequence[float] = (0.0,)
    """[degrees], uphill positive"""
    masses: Sequence[float | None] = (None,)
    """[kg]; None: what the reference states, or that of the models."""
    statures: Sequence[float | None] = (None,)
    """[m]; likewise."""
    feet: Mapping[float, Device] = field(default_factory=dict)
    """Stiffness of a passive foot [N.m/deg] -> the device that it is in the place of; no pressure is asked for."""
    strides: int = 5
    step: float = 5e-4
    """Time step [s]."""

    def __post_init__(self) -> None:
        """Raise InputError for a value no subject or solver has."""
        for combination in self.combinations():
            combination.options()

    def combinations(self) -> Iterator[Combination]:
        """Every one, in the order of the table: passive feet after the devices."""
        for (device, controller, foot), (word, human), speed, slope, mass, stature in itertools.product(
            self._walked_on(), self.references.items(), self.speeds, self.slopes_deg, self.masses, self.statures
        ):
            yield Combination(
                device_word=device[0],
                device=device[1],
                controller_word=controller[0],
                controller=controller[1],
                reference_word=word,
                reference=human,
                speed=speed,
                slope_deg=slope,
                mass=_first(mass, human.mass if human else None, MODEL_MASS),
                stature=_first(stature, human.stature if human else None, MODEL_STATURE),
                strides=self.strides,
                step=self.step,
                foot=foot,
            )

    def _walked_on(self) -> Iterator[tuple[tuple[str, Device], tuple[str, Controller], float | None]]:
        """Device and controller, each as it was named, and the stiffness of a passive foot."""
        for device, controller in itertools.product(self.devices.items(), self.controllers.items()):
            yield device, controller, None
        for stiffness, replaced in self.feet.items():
            yield (f"spring foot {stiffness:g}", replaced), ("off", off()), stiffness

    def describe(self) -> dict[str, Any]:
        """The plan in JSON types, device files verbatim: equal plans, equal descriptions."""
        devices = {
            word: {"name": device.name, "sha256": device.digest, "file": device.content.decode("utf-8-sig")}
            for word, device in self.devices.items()
        }
        return {
            "devices": devices,
            "controllers": {word: controller.describe() for word, controller in self.controllers.items()},
            "references": {word: _described(human) for word, human in self.references.items()},
            "speeds_m_per_s": list(self.speeds),
            "slopes_deg": list(self.slopes_deg),
            "masses_kg": list(self.masses),
            "statures_m": list(self.statures),
            "feet_n_m_per_deg": list(self.feet),
            "strides": self.strides,
            "step_s": self.step,
            "software": software(),
        }


def _first(*values: float | None) -> float:
    """The first that is one."""
    return next(value for value in values if value is not None)


def _described(human: Reference | None) -> dict[str, Any]:
    human = human or _reference()
    return {
        **{"name": human.name, "sha256": human.digest, "stride_time_s": human.stride_time},
        **{"mass_kg": human.mass, "stature_m": human.stature},
    }
