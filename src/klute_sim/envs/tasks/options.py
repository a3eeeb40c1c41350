"""Options of the gait task besides subject and device."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from klute_sim.controllers.pressure import PressureProfile
from klute_sim.device.device import Device, load_device
from klute_sim.envs.tasks import reward
from klute_sim.envs.tasks.actions import ACTION_KINDS
from klute_sim.envs.tasks.domain_randomization import RandomizationRanges
from klute_sim.errors import InputError
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.gait.subject import ReferenceLike, resolve_subject

MAX_RESIDUAL_BAR = 20.0
"""Largest change of the base profile [bar]."""
MAX_NOISE_SCALE, MAX_DELAY_INTERVALS = 100.0, 20
"""Largest multiple of the typical noise, and largest sensor delay in intervals."""
MAX_RESET_NOISE = 0.3
"""Largest initial deviation of the ankle angle [rad]."""


@dataclass(frozen=True, kw_only=True)
class TaskOptions:
    """Options of the gait task, validated at construction."""

    action: str | None = None
    """Kind of action, one of :data:`klute_sim.envs.tasks.actions.ACTION_KINDS`; None selects that of the device."""
    residual_bar: float = 1.0
    """Largest change of the base profile [bar]."""
    profile: PressureProfile | None = None
    """Base profile; None selects that of ``klute-sim gait``."""
    sensor_noise: float = 0.0
    """Multiple of the typical sensor noise (:data:`klute_sim.envs.tasks.instruments.OBSERVATIONS`)."""
    sensor_delay: int = 0
    """Sensor delay in whole intervals."""
    reward: Mapping[str, float] | None = None
    """Weights that replace those of :data:`klute_sim.envs.tasks.reward.DEFAULT_WEIGHTS`."""
    domain_randomization: RandomizationRanges | Mapping[str, Any] | None = None
    """Ranges of the domain randomisation."""
    reset_noise: float = 0.02
    """Largest initial deviation of the ankle angle from the reference [rad]."""

    def __post_init__(self) -> None:
        """Raise InputError when an option is outside its range."""
        if self.action is not None and self.action not in ACTION_KINDS:
            raise InputError(f"action is '{self.action}'; allowed: {', '.join(ACTION_KINDS)}")
        check_action_limits(self.residual_bar, self.sensor_noise, self.sensor_delay)
        if not 0.0 <= self.reset_noise <= MAX_RESET_NOISE:
            raise InputError(f"reset_noise is {self.reset_noise:g}; allowed: 0 to {MAX_RESET_NOISE:g} rad")
        reward.resolve_weights(self.reward)
        object.__setattr__(self, "domain_randomization", RandomizationRanges.from_mapping(self.domain_randomization))


def check_action_limits(residual_bar: float, sensor_noise: float, sensor_delay: int) -> None:
    """Raise InputError when the largest change of a base controller, the noise or the delay is out of range."""
    if not 0.0 < residual_bar <= MAX_RESIDUAL_BAR:
        raise InputError(f"residual_bar is {residual_bar:g}; allowed: above 0, up to {MAX_RESIDUAL_BAR:g} bar")
    if not 0.0 <= sensor_noise <= MAX_NOISE_SCALE:
        raise InputError(f"sensor_noise is {sensor_noise:g}; allowed: 0 to {MAX_NOISE_SCALE:g}")
    if sensor_delay not in range(MAX_DELAY_INTERVALS + 1):
        raise InputError(f"sensor_delay is {sensor_delay}; allowed: 0 to {MAX_DELAY_INTERVALS} whole intervals")


def resolve_gait_options(
    reference: ReferenceLike,
    stride_time: float | None,
    accept: Collection[str],
    mass: float | None,
    stature: float | None,
    speed: float | None,
    slope: float,
    strides: int,
    time_step: float,
) -> GaitOptions:
    """Return the options of the rig for the subject of an environment; ``slope`` is in rad.

    Raises InputError when the reference cannot be read or a number is out of range.
    """
    subject = resolve_subject(
        reference, stride_time=stride_time, accept=accept, mass=mass, stature=stature, speed=speed
    )
    return replace(subject.build_options(strides, time_step), slope=slope)


def resolve_device(device: Device | str | Path, foot: str | None = None) -> Device:
    """Return ``device``, loaded if it is the name of a preset or a path, with ``foot`` in place of its own (None)."""
    loaded = device if isinstance(device, Device) else load_device(device)
    return loaded if foot is None else loaded.with_foot(foot)
