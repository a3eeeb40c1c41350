"""Options of an import of motion-capture files."""

from dataclasses import dataclass, field
from typing import Literal

from klute_sim.datasets.channels import CONTACT_FORCE_THRESHOLD
from klute_sim.errors import InputError
from klute_sim.mocap.parsing.channel_names import Side
from klute_sim.mocap.parsing.mapping import ImportMapping
from klute_sim.plausibility.gait.body import describe_other_unit

MOTION_CUTOFF_HZ = 6.0
"""Default low-pass cutoff of angles and markers [Hz]; usual for walking (Winter)."""
STRIDE_TIME_RANGE = (0.6, 2.5)
"""Stride times [s] of walking."""
FRAME_RATE_RANGE = (10.0, 20_000.0)
"""Frame rates [Hz] of motion and analogue signals (assumed)."""
LOAD_CUTOFF_HZ = 20.0
"""Default low-pass cutoff of ground reactions and moments [Hz] (assumed: keeps both peaks of the vertical load and
removes the ringing of force plates)."""


@dataclass(frozen=True, kw_only=True)
class ImportOptions:
    """Options for reading motion-capture files."""

    mass: float | None = None
    """Body mass [kg]; None estimates it from the impulse of the ground reaction."""
    stature: float | None = None
    """Body height [m]; stored, not used by the import."""
    side: Side | None = None
    """Leg of the reference; None selects the leg with more strides, the right leg if both have equally many."""
    motion_cutoff: float = MOTION_CUTOFF_HZ
    """Low-pass cutoff of angles and markers [Hz]; 0 disables the filter."""
    load_cutoff: float = LOAD_CUTOFF_HZ
    """Low-pass cutoff of ground reactions and moments [Hz]; 0 disables the filter."""
    contact_threshold: float = CONTACT_FORCE_THRESHOLD
    """Vertical ground reaction [N] above which a foot is on the ground."""
    ankle_zero: Literal["foot-flat", "file"] = "foot-flat"
    """Zero of the ankle angle: the flat foot in mid-stance, or the zero of the file."""
    stride_time: float | None = None
    """Duration [s] of a stride in a file over the gait cycle [%]."""
    frame_rate: float | None = None
    """Frame rate [Hz] of Visual3D exports without times."""
    use_listed_events: bool = True
    """Whether strides are cut at the foot strikes that a file lists; otherwise at those of the load."""
    mapping: ImportMapping = field(default_factory=ImportMapping)
    """User's assignment of columns and markers."""
    accept: frozenset[str] = frozenset()
    """Names of findings that are right although they look implausible."""

    def __post_init__(self) -> None:
        """Raise InputError for values out of bounds."""
        bounds = {
            "mass": (self.mass, 20.0, 250.0, "kg"),
            "stature": (self.stature, 1.0, 2.4, "m"),
            "stride duration": (self.stride_time, *STRIDE_TIME_RANGE, "s from heel strike to heel strike"),
            "frame rate": (self.frame_rate, *FRAME_RATE_RANGE, "Hz"),
            "motion cutoff": (self.motion_cutoff, 0.0, 1000.0, "Hz (0: no filter)"),
            "load cutoff": (self.load_cutoff, 0.0, 1000.0, "Hz (0: no filter)"),
            "contact threshold": (self.contact_threshold, 1.0, 500.0, "N"),
        }
        for name, (value, lower, upper, unit) in bounds.items():
            if value is not None and not lower <= value <= upper:
                hint = describe_other_unit(name, value)
                raise InputError(f"{name} is {value:g}; allowed: {lower:g} to {upper:g} {unit}{hint}")
