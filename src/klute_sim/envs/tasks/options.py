"""What may be asked of the walking task beside the walker and the device."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from klute_sim.controllers.pressure import PressureProfile
from klute_sim.device.device import Device, load_device
from klute_sim.envs.tasks import reward
from klute_sim.envs.tasks.actions import ACTION_KINDS
from klute_sim.envs.tasks.domain_randomization import RandomisationRanges
from klute_sim.errors import InputError

MAX_RESIDUAL_BAR = 20.0
"""[bar]"""
MAX_NOISE_SCALE, MAX_DELAY_INTERVALS = 100.0, 20
"""Times the typical noise; intervals."""
MAX_RESET_NOISE = 0.3
"""[rad]"""


@dataclass(frozen=True, kw_only=True)
class TaskOptions:
    """Validated when made."""

    action: str | None = None
    """Of :data:`klute_sim.envs.tasks.actions.ACTIONS`; None: what the device takes."""
    residual_bar: float = 1.0
    """Largest change of the base profile [bar]."""
    profile: PressureProfile | None = None
    """The base profile; None: that of ``klute-sim gait``."""
    sensor_noise: float = 0.0
    """Times the typical noise of each sensor (:data:`klute_sim.envs.tasks.instruments.OBSERVATIONS`)."""
    sensor_delay: int = 0
    """Whole intervals."""
    reward: Mapping[str, float] | None = None
    """Weights in the place of those of :data:`klute_sim.envs.tasks.reward.WEIGHTS`."""
    randomise: RandomisationRanges | Mapping[str, Any] | None = None
    """What differs from episode to episode."""
    reset_noise: float = 0.02
    """Of the ankle's angle when an episode starts [rad]."""

    def __post_init__(self) -> None:
        """Raise InputError for what cannot be."""
        if self.action is not None and self.action not in ACTION_KINDS:
            raise InputError(f"action is '{self.action}'; allowed: {', '.join(ACTION_KINDS)}")
        if not 0.0 < self.residual_bar <= MAX_RESIDUAL_BAR:
            raise InputError(f"residual_bar is {self.residual_bar:g}; allowed: above 0, up to {MAX_RESIDUAL_BAR:g} bar")
        if not 0.0 <= self.sensor_noise <= MAX_NOISE_SCALE:
            raise InputError(f"sensor_noise is {self.sensor_noise:g}; allowed: 0 to {MAX_NOISE_SCALE:g}")
        if self.sensor_delay not in range(MAX_DELAY_INTERVALS + 1):
            raise InputError(
                f"sensor_delay is {self.sensor_delay}; allowed: 0 to {MAX_DELAY_INTERVALS} whole intervals"
            )
        if not 0.0 <= self.reset_noise <= MAX_RESET_NOISE:
            raise InputError(f"reset_noise is {self.reset_noise:g}; allowed: 0 to {MAX_RESET_NOISE:g} rad")
        reward.resolve_weights(self.reward)
        object.__setattr__(self, "randomise", RandomisationRanges.from_mapping(self.randomise))


def resolve_device(device: Device | str | Path) -> Device:
    """The device, or the one of that name or file."""
    return device if isinstance(device, Device) else load_device(device)
