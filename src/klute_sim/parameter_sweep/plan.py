"""The plan of a sweep: every combination of devices, controllers, references, subjects, speeds and slopes."""

import hashlib
import itertools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from klute_sim.controllers.parse import Controller
from klute_sim.controllers.pressure import create_off_controller
from klute_sim.device.device import Device
from klute_sim.errors import InputError
from klute_sim.gait.reference import DEFAULT_NAME, Reference, load_default_reference
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.gait.spring_foot import SpringFoot
from klute_sim.gait.subject import Subject, resolve_subject
from klute_sim.parameter_sweep.fingerprint import fingerprint_software

ABLE_BODIED_REFERENCE = "able-bodied"
"""Name of the reference that ships with the package."""


@dataclass(frozen=True, kw_only=True)
class GaitCase:
    """One gait simulation with everything it needs, so that it can run in any process."""

    device_name: str
    """Preset or file as the user named it."""
    device: Device
    """Device to simulate."""
    controller_name: str
    """Controller specification as the user typed it."""
    controller: Controller
    """Controller that commands the device."""
    subject: Subject
    """Person who walks, with speed and slope."""
    strides: int
    """Number of strides to simulate."""
    dt: float
    """Time step [s]."""
    reference_name: str = ABLE_BODIED_REFERENCE
    """Reference as the user named it."""
    foot_stiffness: float | None = None
    """Stiffness of a passive foot in place of the device [N.m/deg]; None: the device."""
    software: Mapping[str, str] = field(default_factory=fingerprint_software)
    """Software fingerprint of the process that planned the case."""

    def build_options(self) -> GaitOptions:
        """Return the options of the gait rig; raises InputError when a value is out of range."""
        stiffness = self.foot_stiffness
        foot = None if stiffness is None else SpringFoot(stiffness=math.degrees(stiffness))
        return self.subject.build_options(self.strides, self.dt, foot)

    @property
    def key(self) -> str:
        """Digest of all inputs that determine the metrics; names do not enter it."""
        subject = self.subject.describe()
        del subject["reference"]["name"]
        inputs = [self.device.digest, self.controller.describe(), subject, self.strides, self.dt, self.foot_stiffness]
        return hashlib.sha256(json.dumps([*inputs, dict(self.software)], sort_keys=True).encode()).hexdigest()[:32]


@dataclass(frozen=True, kw_only=True)
class SweepPlan:
    """The lists whose combinations a sweep simulates; the last list varies fastest."""

    devices: Mapping[str, Device]
    """Device by the name that the user gave it."""
    controllers: Mapping[str, Controller]
    """Controller by the specification that the user typed."""
    references: Mapping[str, Reference] = field(
        default_factory=lambda: {ABLE_BODIED_REFERENCE: load_default_reference()}
    )
    """Reference gait by the name that the user gave it."""
    stride_times: Sequence[float | None] = (None,)
    """Stride times of the references [s]; None: the time that the reference states."""
    speeds: Sequence[float | None] = (None,)
    """Walking speeds [m/s]; None: the speed that the reference implies."""
    slopes_deg: Sequence[float] = (0.0,)
    """Ground slopes [deg], uphill positive."""
    masses: Sequence[float | None] = (None,)
    """Body masses [kg]; None: the mass that the reference states, or that of the gait model."""
    statures: Sequence[float | None] = (None,)
    """Statures [m]; None: the stature that the reference states, or that of the gait model."""
    spring_feet: Mapping[float, Device] = field(default_factory=dict)
    """Device that a passive foot replaces by the stiffness of the foot [N.m/deg]; the pressure command is zero."""
    strides: int = 5
    """Number of strides per case."""
    dt: float = 5e-4
    """Time step [s]."""

    def __post_init__(self) -> None:
        """Raise InputError when a value is out of range."""
        if self.stride_times != (None,) and any(r.name == DEFAULT_NAME for r in self.references.values()):
            raise InputError(
                "a stride time requires a reference file: the stride time of the default reference is fixed"
            )
        for case in self.iter_cases():
            case.build_options()

    def iter_cases(self) -> Iterator[GaitCase]:
        """Yield the cases in the order of the table: passive feet after the devices."""
        for (device, controller, stiffness), reference, stride_time, speed, slope, mass, stature in itertools.product(
            iter_conditions(self.devices, self.controllers, self.spring_feet),
            self.references.items(),
            self.stride_times,
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
                reference_name=reference[0],
                subject=resolve_subject(
                    reference[1], stride_time=stride_time, mass=mass, stature=stature, speed=speed, slope=slope
                ),
                strides=self.strides,
                dt=self.dt,
                foot_stiffness=stiffness,
            )

    def describe(self) -> dict[str, Any]:
        """Return the plan in JSON types with the device files verbatim; equal plans have equal descriptions."""
        return {
            "devices": describe_devices(self.devices),
            "controllers": {name: controller.describe() for name, controller in self.controllers.items()},
            "references": {name: reference.describe() for name, reference in self.references.items()},
            "stride_times_s": list(self.stride_times),
            "speeds_m_per_s": list(self.speeds),
            "slopes_deg": list(self.slopes_deg),
            "masses_kg": list(self.masses),
            "statures_m": list(self.statures),
            "feet_n_m_per_deg": list(self.spring_feet),
            "strides": self.strides,
            "time_step_s": self.dt,
            "software": fingerprint_software(),
        }


def iter_conditions(
    devices: Mapping[str, Device], controllers: Mapping[str, Controller], spring_feet: Mapping[float, Device]
) -> Iterator[tuple[tuple[str, Device], tuple[str, Controller], float | None]]:
    """Yield (name, device), (name, controller) and the stiffness of a passive foot [N.m/deg] or None."""
    for device, controller in itertools.product(devices.items(), controllers.items()):
        yield device, controller, None
    for stiffness, replaced_device in spring_feet.items():
        yield (f"spring foot {stiffness:g}", replaced_device), ("off", create_off_controller()), stiffness


def describe_devices(devices: Mapping[str, Device]) -> dict[str, Any]:
    """Return name, digest and content of the files of ``devices`` (JSON types)."""
    return {
        name: {"name": device.name, "sha256": device.digest, "file": device.content.decode("utf-8-sig")}
        for name, device in devices.items()
    }
