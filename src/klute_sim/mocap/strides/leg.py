"""One leg of one trial: every channel of walking on one clock, with the signs of the rest of the program."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from klute_sim.gait.contacts import Contact
from klute_sim.mocap.parsing.channel_names import Side
from klute_sim.recording.recording import Array

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
"""Channels of a leg -> unit. Flexion, dorsiflexion, forward and up are positive; the moment is the plantarflexors'."""


@dataclass(frozen=True, eq=False)
class LegChannels:
    """A leg."""

    side: Side
    trial: str
    """Name of its first file."""
    time: Array
    channels: Mapping[str, Array]
    """Those of :data:`UNITS` that there are; NaN where not known."""
    contacts: Sequence[Contact]
    walking_speed: float | None = None
    """Of walking [m/s], where something tells it."""
    belt_speed: Array | None = None
    """Speed of the treadmill [m/s] at ``time``."""
    impulses: Sequence[float] = field(default_factory=tuple)
    """Vertical impulse [N.s] of each whole contact, not filtered."""

    @property
    def missing_channels(self) -> list[str]:
        """Channels that there are not."""
        return [name for name in LEG_UNITS if name not in self.channels]
