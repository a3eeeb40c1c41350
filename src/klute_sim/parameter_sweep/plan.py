"""What a sweep walks: every combination of devices, controllers, walkers, speeds and slopes that were listed."""

import hashlib
import itertools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from klute_sim.controllers.parse import Controller
from klute_sim.controllers.pressure import create_off_controller
from klute_sim.device.device import Device
from klute_sim.gait.reference import Reference, load_default_reference
from klute_sim.gait.rig.build import MODEL_MASS, MODEL_STATURE
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.gait.spring_foot import SpringFoot
from klute_sim.parameter_sweep.fingerprint import fingerprint_software

ABLE_BODIED_REFERENCE = "able-bodied"
"""The word for the package's own reference."""


@cache
def _load_default_reference() -> Reference:
    """Read once in a process: it takes longer than the rest of a combination."""
    return load_default_reference()


@dataclass(frozen=True, kw_only=True)
class GaitCase:
    """One walk: everything that it needs, wherever it is done."""

    device_name: str
    """As it was named: a preset or a file."""
    device: Device
    controller_name: str
    controller: Controller
    speed: float | None
    """[m/s]; None: the reference's own."""
    slope_deg: float
    """Of the ground [degrees], uphill positive; not in radians, so that the table has what was typed."""
    mass: float
    """Of the body [kg]."""
    strides: int
    dt: float
    """Time step [s]."""
    stature: float = MODEL_STATURE
    """[m]"""
    reference_name: str = ABLE_BODIED_REFERENCE
    reference: Reference | None = None
    """What is walked on; None: the package's own."""
    foot_stiffness: float | None = None
    """Stiffness of a passive foot in place of the device [N.m/deg]."""
    software: Mapping[str, str] = field(default_factory=fingerprint_software)
    """Of whoever planned it: it may be walked elsewhere."""

    def build_options(self) -> GaitOptions:
        """What the gait rig is told; raises InputError for a value no subject or solver has."""
        return GaitOptions(
            mass=self.mass,
            stature=self.stature,
            speed=self.speed,
            slope=math.radians(self.slope_deg),
            strides=self.strides,
            dt=self.dt,
            reference=self.reference or _load_default_reference(),
            spring_foot=None
            if self.foot_stiffness is None
            else SpringFoot(stiffness=math.degrees(self.foot_stiffness)),
        )

    @property
    def key(self) -> str:
        """Digest of all that its outcomes depend on; what things are called is not among it."""
        human = self.reference and [self.reference.digest, self.reference.stride_time]
        who = [self.device.digest, self.controller.describe(), human, self.stature]
        how = [self.speed, self.slope_deg, self.mass, self.strides, self.dt, self.foot_stiffness, dict(self.software)]
        return hashlib.sha256(json.dumps([*who, *how], sort_keys=True).encode()).hexdigest()[:32]


@dataclass(frozen=True, kw_only=True)
class SweepPlan:
    """What is combined with what; validated when made. The last one listed here changes first."""

    devices: Mapping[str, Device]
    """As named -> device."""
    controllers: Mapping[str, Controller]
    """As named -> controller."""
    references: Mapping[str, Reference | None] = field(default_factory=lambda: {ABLE_BODIED_REFERENCE: None})
    """As named -> reference; None: the package's own."""
    speeds: Sequence[float | None] = (None,)
    """[m/s]; None: the reference's own."""
    slopes_deg: Sequence[float] = (0.0,)
    """[degrees], uphill positive"""
    masses: Sequence[float | None] = (None,)
    """[kg]; None: what the reference states, or that of the models."""
    statures: Sequence[float | None] = (None,)
    """[m]; likewise."""
    spring_feet: Mapping[float, Device] = field(default_factory=dict)
    """Stiffness of a passive foot [N.m/deg] -> the device that it is in the place of; no pressure is asked for."""
    strides: int = 5
    dt: float = 5e-4
    """Time step [s]."""

    def __post_init__(self) -> None:
        """Raise InputError for a value no subject or solver has."""
        for combination in self.iter_cases():
            combination.build_options()

    def iter_cases(self) -> Iterator[GaitCase]:
        """Every one, in the order of the table: passive feet after the devices."""
        for (device, controller, foot), (word, human), speed, slope, mass, stature in itertools.product(
            self._iter_device_controller_pairs(),
            self.references.items(),
            self.speeds,
            self.slopes_deg,
            self.masses,
            self.statures,
        ):
            yield GaitCase(
                device_name=device[0],
                device=device[1],
                controller_name=controller[0],
                controller=controller[1],
                reference_name=word,
                reference=human,
                speed=speed,
                slope_deg=slope,
                mass=_first_not_none(mass, human.mass if human else None, MODEL_MASS),
                stature=_first_not_none(stature, human.stature if human else None, MODEL_STATURE),
                strides=self.strides,
                dt=self.dt,
                foot_stiffness=foot,
            )

    def _iter_device_controller_pairs(
        self,
    ) -> Iterator[tuple[tuple[str, Device], tuple[str, Controller], float | None]]:
        """Device and controller, each as it was named, and the stiffness of a passive foot."""
        for device, controller in itertools.product(self.devices.items(), self.controllers.items()):
            yield device, controller, None
        for stiffness, replaced in self.spring_feet.items():
            yield (f"spring foot {stiffness:g}", replaced), ("off", create_off_controller()), stiffness

    def describe(self) -> dict[str, Any]:
        """The plan in JSON types, device files verbatim: equal plans, equal descriptions."""
        devices = {
            word: {"name": device.name, "sha256": device.digest, "file": device.content.decode("utf-8-sig")}
            for word, device in self.devices.items()
        }
        return {
            "devices": devices,
            "controllers": {word: controller.describe() for word, controller in self.controllers.items()},
            "references": {word: _describe_reference(human) for word, human in self.references.items()},
            "speeds_m_per_s": list(self.speeds),
            "slopes_deg": list(self.slopes_deg),
            "masses_kg": list(self.masses),
            "statures_m": list(self.statures),
            "feet_n_m_per_deg": list(self.spring_feet),
            "strides": self.strides,
            "step_s": self.dt,
            "software": fingerprint_software(),
        }


def _first_not_none(*values: float | None) -> float:
    """The first that is one."""
    return next(value for value in values if value is not None)


def _describe_reference(reference: Reference | None) -> dict[str, Any]:
    reference = reference or _load_default_reference()
    return {
        **{"name": reference.name, "sha256": reference.digest, "stride_time_s": reference.stride_time},
        **{"mass_kg": reference.mass, "stature_m": reference.stature},
    }
