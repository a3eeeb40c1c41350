"""Force-velocity curves (Figs. 4.3, 4.10-4.12): muscle, bare actuator, ideal damper, fixed orifices.

Velocity is positive while shortening, as in chapter 2.
"""

from dataclasses import dataclass

import numpy as np

from klute_sim.laws import damper as damper_law
from klute_sim.laws import hill as hill_law
from klute_sim.laws import mckibben
from klute_sim.laws.damper import DamperParameters
from klute_sim.laws.hill import HillCurve
from klute_sim.laws.mckibben import MuscleParameters
from klute_sim.types import Array


@dataclass(frozen=True)
class ForceVelocityCurves:
    """Forces [N] over velocity [m/s]."""

    velocity: Array
    """Velocity [m/s], positive while shortening."""
    muscle: Array
    """Force of the emulated muscle [N]: (2.4) or its inversion, not below 0."""
    actuator_only: Array
    """Force of the actuator [N]; its model is independent of velocity (measured: -6 % at 300 mm/s)."""
    ideal_damper: Array
    """Force with a damper that provides (4.1) at every velocity [N]; actuator and muscle have the same F0."""
    fixed_orifices: Array
    """Force with one fixed orifice per direction [N]."""
    isometric: float
    """Isometric force F0 [N]."""

    @property
    def damping(self) -> Array:
        """Return the force of the ideal damper (4.1) [N]: positive while shortening, negative while lengthening."""
        return self.actuator_only - self.ideal_damper


@dataclass(frozen=True)
class ForceVelocityError:
    """Root mean square deviation from the muscle over velocity, relative to F0 [1]."""

    concentric: float
    """Deviation over velocities of 0 and above."""
    eccentric: float
    """Deviation over velocities of 0 and below."""


def compute_force_velocity(
    muscle: MuscleParameters,
    damper: DamperParameters,
    hill: HillCurve,
    peak_velocity: float,
    velocities: Array,
    pressure: float,
    length_ratio: float,
) -> ForceVelocityCurves:
    """Return the four curves at ``velocities`` [m/s], gauge ``pressure`` [Pa] and ``length_ratio`` L/L0.

    F0 is the isometric force of the actuator there (as in Fig. 3.9); ``peak_velocity`` is Vmax of the muscle [m/s].
    """
    velocity = np.asarray(velocities, dtype=np.float64)
    isometric = mckibben.force(muscle, pressure, length_ratio * muscle.resting_length)
    relative_force = [max(0.0, hill_law.force_velocity(hill, 1.0, float(v) / peak_velocity)) for v in velocity]
    target = isometric * np.array(relative_force)
    actuator_only = np.full(velocity.shape, isometric)
    desired = np.array([damper_law.desired_force(isometric, float(muscle_force)) for muscle_force in target])
    damper_force = np.array([damper_law.force(damper, -float(v)) for v in velocity])
    return ForceVelocityCurves(
        velocity, target, actuator_only, actuator_only - desired, actuator_only + damper_force, isometric
    )


def compute_rms_error(curves: ForceVelocityCurves, forces: Array) -> ForceVelocityError:
    """Return the deviation of ``forces`` [N], one of the curves, from the muscle; NaN for a side without velocities."""
    error = (forces - curves.muscle) / curves.isometric
    sides = (error[curves.velocity >= 0.0], error[curves.velocity <= 0.0])
    return ForceVelocityError(*(float(np.sqrt(np.mean(side * side))) if len(side) else float("nan") for side in sides))


def compute_required_orifices(
    curves: ForceVelocityCurves, bore: float, oil_density: float, discharge_coefficient: float
) -> Array:
    """Return the orifice [m] that gives the ideal damping at each velocity (Fig. 4.3); NaN where no damping is
    needed.
    """
    diameters = [
        damper_law.required_orifice(abs(float(force)), abs(float(v)), bore, oil_density, discharge_coefficient)
        if force != 0.0 and v != 0.0
        else float("nan")
        for v, force in zip(curves.velocity, curves.damping, strict=True)
    ]
    return np.array(diameters)


def build_velocity_grid(max_lengthening_speed: float, max_shortening_speed: float) -> Array:
    """Return velocities [m/s] from ``-max_lengthening_speed`` to ``max_shortening_speed``, including 0."""
    return np.concatenate(
        [np.linspace(-max_lengthening_speed, 0.0, 201)[:-1], np.linspace(0.0, max_shortening_speed, 401)]
    )
