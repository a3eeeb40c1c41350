"""The plan of a sweep of the controlled joint: devices, gains of the PID controller, and loads."""

import hashlib
import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from klute_sim.device.device import Device, check_accepts_pressure
from klute_sim.envs.joint_pid import DEFAULT_GAINS, PidController
from klute_sim.envs.tasks.joint_task import JointOptions
from klute_sim.errors import InputError, suggest
from klute_sim.parameter_sweep.fingerprint import fingerprint_joint_software
from klute_sim.parameter_sweep.plan import describe_devices

MAX_EPISODES = 1000
"""Largest number of episodes of a case."""


@dataclass(frozen=True, kw_only=True)
class JointCase:
    """Episodes of the controlled joint in one condition, with everything they need, so that they can run anywhere."""

    device_name: str
    """Preset or file as the user named it."""
    device: Device
    """Device on both tendons."""
    gains: Mapping[str, float] = field(default_factory=lambda: dict(DEFAULT_GAINS))
    """Argument of the PID controller -> value."""
    load_kg: float | None = None
    """Mass at the end of the lever [kg]; None: that of the model."""
    episodes: int = 8
    """Number of episodes, each with another target."""
    seconds: float = 5.0
    """Duration of an episode [s]."""
    seed: int = 0
    """Random seed of the first target; the others follow it."""
    dt: float = 5e-4
    """Time step [s]."""
    software: Mapping[str, str] = field(default_factory=fingerprint_joint_software)
    """Software fingerprint of the process that planned the case."""

    def build_options(self) -> JointOptions:
        """Return the options of the task; raises InputError when a value is out of range."""
        if not 1 <= self.episodes <= MAX_EPISODES:
            raise InputError(f"the number of episodes is {self.episodes}; allowed: 1 to {MAX_EPISODES}")
        return JointOptions(duration=self.seconds, time_step=self.dt, load=self.load_kg)

    def build_controller(self) -> PidController:
        """Return a controller; raises InputError when a gain is out of range."""
        return PidController(**self.gains)

    @property
    def key(self) -> str:
        """Digest of all inputs that determine the metrics; names do not enter it."""
        numbers = [self.load_kg, self.episodes, self.seconds, self.seed, self.dt]
        inputs = [self.device.digest, dict(self.gains), *numbers, dict(self.software)]
        return hashlib.sha256(json.dumps(inputs, sort_keys=True).encode()).hexdigest()[:32]


@dataclass(frozen=True, kw_only=True)
class JointSweepPlan:
    """The lists whose combinations a sweep of the controlled joint simulates; the last list varies fastest."""

    devices: Mapping[str, Device]
    """Device by the name that the user gave it."""
    gains: Mapping[str, Sequence[float]] = field(default_factory=dict)
    """Argument of the PID controller -> values; the others have their defaults."""
    loads_kg: Sequence[float | None] = (None,)
    """Masses at the end of the lever [kg]; None: that of the model."""
    episodes: int = 8
    """Number of episodes of each case."""
    seconds: float = 5.0
    """Duration of an episode [s]."""
    seed: int = 0
    """Random seed of the first target."""
    dt: float = 5e-4
    """Time step [s]."""

    def __post_init__(self) -> None:
        """Raise InputError when a value is out of range, or a device takes no pressures."""
        check_gain_names(self.gains)
        for device in self.devices.values():
            check_accepts_pressure(device, "the controlled joint")
        for case in self.iter_cases():
            case.build_options()
            case.build_controller()

    def iter_cases(self) -> Iterator[JointCase]:
        """Yield the cases in the order of the table."""
        gain_lists = [self.gains.get(name, (default,)) for name, default in DEFAULT_GAINS.items()]
        conditions = itertools.product(self.devices.items(), itertools.product(*gain_lists), self.loads_kg)
        for (name, device), values, load in conditions:
            yield JointCase(
                device_name=name,
                device=device,
                gains=dict(zip(DEFAULT_GAINS, values, strict=True)),
                load_kg=load,
                episodes=self.episodes,
                seconds=self.seconds,
                seed=self.seed,
                dt=self.dt,
            )

    def describe(self) -> dict[str, Any]:
        """Return the plan in JSON types with the device files verbatim; equal plans have equal descriptions."""
        return {
            "rig": "joint",
            "devices": describe_devices(self.devices),
            "gains": {name: list(values) for name, values in self.gains.items()},
            "loads_kg": list(self.loads_kg),
            "episodes": self.episodes,
            "seconds": self.seconds,
            "seed": self.seed,
            "time_step_s": self.dt,
            "software": fingerprint_joint_software(),
        }


def check_gain_names(gains: Mapping[str, Any]) -> None:
    """Raise InputError unless the PID controller has all ``gains``."""
    for name in gains:
        if name not in DEFAULT_GAINS:
            listing = f"allowed: {', '.join(DEFAULT_GAINS)}"
            raise InputError(f"the PID controller has no gain '{name}'; {suggest(name, DEFAULT_GAINS, listing)}")
