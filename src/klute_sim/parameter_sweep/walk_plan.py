"""The plan of a sweep of predicted walks: conditions of the prosthesis, walkers, grounds and pushes."""

import hashlib
import itertools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from klute_sim.controllers.parse import Controller
from klute_sim.device.device import Device, check_accepts_pressure
from klute_sim.gait.spring_foot import SpringFoot
from klute_sim.parameter_sweep.fingerprint import fingerprint_walk_software
from klute_sim.parameter_sweep.plan import describe_devices, iter_conditions
from klute_sim.walker.person.body import load_body
from klute_sim.walker.person.build import MAX_DT, Ground, Prosthesis
from klute_sim.walker.reflexes.walker_file import Walker
from klute_sim.walker.simulation.simulate import WalkOptions, describe_prosthesis, select_adapted_walkers
from klute_sim.walker.simulation.walk import Push

NO_PUSH = (0.0, 0.0)
"""A push without impulse, which is none."""


@dataclass(frozen=True, kw_only=True)
class WalkCase:
    """One predicted walk with everything it needs, so that it can run in any process."""

    device_name: str
    """Preset or file as the user named it, or the spring foot."""
    device: Device
    """Device to simulate; with a spring foot only its geometry counts."""
    controller_name: str
    """Controller specification as the user typed it."""
    controller: Controller
    """Controller that commands the device."""
    walker: Walker
    """Walker with the reflexes of the person."""
    foot_stiffness: float | None = None
    """Stiffness of a passive foot in place of the device [N.m/deg]; None: the device."""
    slope_deg: float = 0.0
    """Ground slope [deg], uphill positive."""
    unevenness_mm: float = 0.0
    """Largest height of the blocks on the ground [mm]."""
    push: tuple[float, float] = NO_PUSH
    """Impulse [N.s] and phase of the right leg's stride [%] of a push."""
    seconds: float = 20.0
    """Duration [s]; a fall ends the walk earlier."""
    seed: int = 0
    """Random seed of the uneven ground."""
    dt: float = MAX_DT
    """Time step [s]."""
    software: Mapping[str, str] = field(default_factory=fingerprint_walk_software)
    """Software fingerprint of the process that planned the case."""

    @cached_property
    def prosthesis(self) -> Prosthesis:
        """Prosthesis of the person; raises InputError when the stiffness of a foot is out of range."""
        stiffness = self.foot_stiffness
        foot = None if stiffness is None else SpringFoot(stiffness=math.degrees(stiffness))
        return Prosthesis(device=self.device, spring_foot=foot)

    @property
    def active_controller(self) -> Controller | None:
        """Controller of the device; None with a passive foot."""
        return self.controller if self.foot_stiffness is None else None

    @property
    def is_acute(self) -> bool:
        """Whether the walker has adapted to another condition than this one."""
        return describe_prosthesis(self.prosthesis, self.active_controller) != dict(self.walker.condition)

    def build_options(self) -> WalkOptions:
        """Return the options of the walk; raises InputError when a value is out of range."""
        impulse, phase = self.push
        return WalkOptions(
            seconds=self.seconds,
            dt=self.dt,
            ground=Ground(slope=math.radians(self.slope_deg), unevenness=1e-3 * self.unevenness_mm, seed=self.seed),
            push=None if impulse == 0.0 else Push(impulse=impulse, phase=0.01 * phase),
        )

    @property
    def key(self) -> str:
        """Digest of all inputs that determine the metrics; names do not enter it."""
        controller = None if self.active_controller is None else self.active_controller.describe()
        numbers = [self.foot_stiffness, self.slope_deg, self.unevenness_mm, self.push, self.seconds, self.seed, self.dt]
        inputs = [self.device.digest, controller, self.walker.digest, load_body().digest, *numbers]
        return hashlib.sha256(json.dumps([*inputs, dict(self.software)], sort_keys=True).encode()).hexdigest()[:32]


@dataclass(frozen=True, kw_only=True)
class WalkSweepPlan:
    """The lists whose combinations a sweep of walks simulates; the last list varies fastest."""

    devices: Mapping[str, Device]
    """Device by the name that the user gave it."""
    controllers: Mapping[str, Controller]
    """Controller by the specification that the user typed."""
    spring_feet: Mapping[float, Device] = field(default_factory=dict)
    """Device that a passive foot replaces by the stiffness of the foot [N.m/deg]."""
    walkers: Sequence[Walker] = ()
    """Walkers; empty: for each prosthesis the shipped ones that have adapted to it, or to the nearest one."""
    slopes_deg: Sequence[float] = (0.0,)
    """Ground slopes [deg], uphill positive."""
    unevennesses_mm: Sequence[float] = (0.0,)
    """Largest heights of the blocks on the ground [mm]."""
    pushes: Sequence[tuple[float, float]] = (NO_PUSH,)
    """Impulse [N.s] and phase [%] of the pushes, one in each walk."""
    seconds: float = 20.0
    """Duration of a walk [s]."""
    seed: int = 0
    """Random seed of the uneven ground."""
    dt: float = MAX_DT
    """Time step [s]."""

    def __post_init__(self) -> None:
        """Raise InputError when a value is out of range, or a walker or a device does not fit."""
        for device in self.devices.values():
            check_accepts_pressure(device, "a sweep of walks")
        for case in self.iter_cases():
            case.build_options()
            case.walker.check_legs(is_intact=False)

    def iter_cases(self) -> Iterator[WalkCase]:
        """Yield the cases in the order of the table: passive feet after the devices."""
        for device, controller, stiffness in iter_conditions(self.devices, self.controllers, self.spring_feet):
            foot = None if stiffness is None else SpringFoot(stiffness=math.degrees(stiffness))
            walkers = self.walkers or select_adapted_walkers(Prosthesis(device=device[1], spring_foot=foot))
            for slope, unevenness, push, walker in itertools.product(
                self.slopes_deg, self.unevennesses_mm, self.pushes, walkers
            ):
                yield WalkCase(
                    device_name=device[0],
                    device=device[1],
                    controller_name=controller[0],
                    controller=controller[1],
                    walker=walker,
                    foot_stiffness=stiffness,
                    slope_deg=slope,
                    unevenness_mm=unevenness,
                    push=push,
                    seconds=self.seconds,
                    seed=self.seed,
                    dt=self.dt,
                )

    def describe(self) -> dict[str, Any]:
        """Return the plan in JSON types with the device files verbatim; equal plans have equal descriptions."""
        return {
            "rig": "walk",
            "devices": describe_devices(self.devices),
            "controllers": {name: controller.describe() for name, controller in self.controllers.items()},
            "feet_n_m_per_deg": list(self.spring_feet),
            "walkers": [{"name": case.walker.name, "sha256": case.walker.digest} for case in self._iter_first_cases()],
            "slopes_deg": list(self.slopes_deg),
            "unevennesses_mm": list(self.unevennesses_mm),
            "pushes": [list(push) for push in self.pushes],
            "seconds": self.seconds,
            "seed": self.seed,
            "time_step_s": self.dt,
            "software": fingerprint_walk_software(),
        }

    def _iter_first_cases(self) -> Iterator[WalkCase]:
        """Yield the first case of each walker."""
        names = set()
        for case in self.iter_cases():
            if case.walker.digest not in names:
                names.add(case.walker.digest)
                yield case
