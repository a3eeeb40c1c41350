"""What an import can be told."""

from dataclasses import dataclass, field
from typing import Literal

from klute_sim.datasets.channels import CONTACT_FORCE_THRESHOLD
from klute_sim.errors import InputError
from klute_sim.mocap.parsing.channel_names import Side
from klute_sim.mocap.parsing.mapping import ImportMapping

MOTION_CUTOFF_HZ = 6.0
"""Of angles and markers [Hz]: the usual one for walking (Winter)."""
LOAD_CUTOFF_HZ = 20.0
"""Of ground reactions and moments [Hz] (assumed: keeps the humps, loses the plates' ringing)."""


@dataclass(frozen=True, kw_only=True)
class ImportOptions:
    """How to read a laboratory's files."""

    mass: float | None = None
    """Body mass [kg]; None: from the impulse of the ground reaction."""
    stature: float | None = None
    """[m]; only noted."""
    side: Side | None = None
    """The leg that becomes the reference; None: the one with more strides, the right one of two equals."""
    motion_cutoff: float = MOTION_CUTOFF_HZ
    load_cutoff: float = LOAD_CUTOFF_HZ
    contact_threshold: float = CONTACT_FORCE_THRESHOLD
    """Vertical ground reaction [N] above which a foot is on the ground."""
    ankle_zero: Literal["foot-flat", "file"] = "foot-flat"
    """Whether 0 degrees of the ankle is moved to where the foot is flat in mid-stance."""
    mapping: ImportMapping = field(default_factory=ImportMapping)

    def __post_init__(self) -> None:
        """Raise InputError for values that mean nothing."""
        bounds = {
            "mass": (self.mass, 20.0, 250.0, "kg"),
            "stature": (self.stature, 1.0, 2.4, "m"),
            "cut-off": (self.motion_cutoff, 0.0, 1000.0, "Hz (0: no filter)"),
            "cut-off of loads": (self.load_cutoff, 0.0, 1000.0, "Hz (0: no filter)"),
            "threshold": (self.contact_threshold, 1.0, 500.0, "N"),
        }
        for name, (value, low, high, unit) in bounds.items():
            if value is not None and not low <= value <= high:
                raise InputError(f"{name} is {value:g}; allowed: {low:g} to {high:g} {unit}")
