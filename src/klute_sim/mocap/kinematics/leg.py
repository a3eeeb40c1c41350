"""Channels of one leg in one trial on common times, with the standard signs of the package."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from klute_sim.gait.contacts import Contact
from klute_sim.mocap.parsing.channel_names import Side
from klute_sim.types import Array

LEG_UNITS = {
    "hip_angle": "deg",
    "knee_angle": "deg",
    "ankle_angle": "deg",
    "shank_angle": "deg",
    "ankle_moment": "N*m",
    "ankle_power": "W",
    "grf_vertical": "N",
    "grf_forward": "N",
}
"""Channel of a leg -> unit. Flexion, dorsiflexion, plantarflexor moment, forward and up are positive."""


@dataclass(frozen=True, eq=False)
class Leg:
    """One leg in one trial."""

    side: Side
    """Side of the leg."""
    trial: str
    """Name of the trial's first file."""
    time: Array
    """Uniform sample times (n,) [s]."""
    channels: Mapping[str, Array]
    """Available channels of :data:`LEG_UNITS`; NaN where unknown."""
    contacts: Sequence[Contact]
    """Contacts of the foot with the ground."""
    walking_speed: float | None = None
    """Walking speed [m/s], if known."""
    belt_speed: Array | None = None
    """Speed of the treadmill (n,) [m/s], if known."""
    impulses: Sequence[float] = field(default_factory=tuple)
    """Vertical impulse [N.s] of each complete contact, unfiltered."""

    @property
    def missing_channels(self) -> list[str]:
        """Channels of :data:`LEG_UNITS` that are not available."""
        return [name for name in LEG_UNITS if name not in self.channels]
