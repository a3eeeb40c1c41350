"""Design targets: a muscle described by its Hill parameters, or the calf muscle of a walker."""

from dataclasses import dataclass, field

import numpy as np

from klute_sim.errors import InputError
from klute_sim.gait.reference import Reference, load_default_reference
from klute_sim.laws.hill import HillCurve
from klute_sim.laws.hill_tables import GENERIC_HILL_CURVE, HILL_CURVES, MUSCLE_SCALES
from klute_sim.sizing.parts.limits import check_range

DEFAULT_PEAK_VELOCITY = 0.300
"""Vmax [m/s] of a target that specifies none (assumed); fastest test of chapter 3."""
MOMENT_COLUMN = "ankle_plantarflexor_moment_nm_per_kg"
"""Reference column with the moment that the calf muscle of a walker must produce."""
PEAK_MOMENT_RANGE = (0.1, 10.0)
"""Allowed range of the peak ankle moment [N m/kg]."""


@dataclass(frozen=True, kw_only=True)
class MuscleTarget:
    """A muscle to emulate; None leaves a quantity to the actuator."""

    name: str = "generic"
    """Name of the muscle."""
    hill: HillCurve = GENERIC_HILL_CURVE
    """Shape of the force-velocity curve, relative to F0 and Vmax."""
    isometric_force: float | None = None
    """Isometric force F0 that the actuators must reach [N]."""
    resting_length: float | None = None
    """Resting length l0 [m]."""
    peak_velocity: float | None = None
    """Maximum shortening velocity Vmax [m/s]; None selects :data:`DEFAULT_PEAK_VELOCITY`."""

    def __post_init__(self) -> None:
        """Raise InputError when a value is outside its physical range."""
        check_range("a/F0", self.hill.a, 0.01, 10.0, "")
        check_range("b/Vmax", self.hill.b, 0.01, 10.0, "")
        check_range("eccentric saturation over F0", self.hill.saturation, 1.01, 3.0, "")
        if self.isometric_force is not None:
            check_range("F0", self.isometric_force, 0.01, 1e5, "N")
        if self.resting_length is not None:
            check_range("l0", self.resting_length, 20.0, 2000.0, "mm", 1e-3)
        if self.peak_velocity is not None:
            check_range("Vmax", self.peak_velocity, 5.0, 5000.0, "mm/s", 1e-3)

    @property
    def design_peak_velocity(self) -> float:
        """Return the maximum shortening velocity Vmax of the design [m/s]."""
        return DEFAULT_PEAK_VELOCITY if self.peak_velocity is None else self.peak_velocity


def load_table_target(muscle_name: str) -> MuscleTarget:
    """Return the muscle ``muscle_name`` of Table 2.4, with its resting length where Tables 2.1-2.3 give one.

    Raises InputError when Table 2.4 has no such muscle.
    """
    if muscle_name not in HILL_CURVES:
        raise InputError(f"Table 2.4 has no muscle '{muscle_name}'; it has: {', '.join(HILL_CURVES)}")
    printed = HILL_CURVES[muscle_name]
    return MuscleTarget(
        name=muscle_name,
        hill=printed.constants,
        isometric_force=printed.isometric_force,
        resting_length=MUSCLE_SCALES[muscle_name].resting_length if muscle_name in MUSCLE_SCALES else None,
        peak_velocity=printed.max_velocity,
    )


@dataclass(frozen=True, kw_only=True)
class WalkerTarget:
    """A person whose ankle moves as in a reference and whose calf muscle the device replaces."""

    mass: float
    """Body mass [kg]."""
    reference: Reference = field(default_factory=load_default_reference)
    """Reference gait of the ankle."""
    moment_scale: float = 1.0
    """Ankle moment over the moment of the reference [1]."""
    muscle: MuscleTarget = field(default_factory=MuscleTarget)
    """Force-velocity shape and Vmax of the muscle; F0 and l0 follow from the walker."""

    def __post_init__(self) -> None:
        """Raise InputError when the body or its peak ankle moment is outside the limits of the gait rig."""
        check_range("mass", self.mass, 20.0, 250.0, "kg")
        check_range("ankle moment over the reference's", self.moment_scale, 0.1, 3.0, "")
        per_kg = self.compute_peak_moment()[0] / (self.mass * self.moment_scale)
        low, high = PEAK_MOMENT_RANGE
        if not low <= per_kg <= high:
            raise InputError(
                f"reference {self.reference.name}: {MOMENT_COLUMN} peaks at {per_kg:.3g}; allowed: "
                f"{low:g} to {high:g} N·m/kg (walking is near 1.4, plantarflexor positive)"
            )

    def compute_peak_moment(self) -> tuple[float, float]:
        """Return the largest plantarflexor moment [N m] and the dorsiflexion angle [rad] at which it occurs."""
        phase = np.arange(0.0, 1.0, 0.001)
        moment = self.reference(MOMENT_COLUMN, phase)
        peak = int(moment.argmax())
        angle = np.radians(self.reference("ankle_dorsiflexion_deg", phase[peak : peak + 1]))
        return self.mass * self.moment_scale * float(moment[peak]), float(angle[0])

    def compute_ankle_range_of_motion(self) -> float:
        """Return the range of motion of the ankle [rad]."""
        low, high = self.reference.ranges["ankle_dorsiflexion_deg"]
        return float(np.radians(high - low))
