"""Force over velocity (Figs. 4.3, 4.10-4.12): muscle, actuator alone, with an ideal damper, with fixed orifices.

Velocity is positive while shortening, as in chapter 2.
"""

from dataclasses import dataclass

import numpy as np

from klute_sim.laws import damper as damper_law
from klute_sim.laws import hill as hill_law
from klute_sim.laws import mckibben
from klute_sim.laws.damper import Damper
from klute_sim.laws.hill import HillCurve
from klute_sim.laws.mckibben import Muscle
from klute_sim.recording.recording import Array


@dataclass(frozen=True)
class ForceVelocityCurves:
    """Forces [N] over velocity [m/s]."""

    velocity: Array
    """Shortening positive."""
    muscle: Array
    """The muscle that is emulated: (2.4), or its inversion; not below 0."""
    actuator_only: Array
    """The actuator, whose model does not depend on velocity (measured: -6 % at 300 mm/s)."""
    ideal_damper: Array
    """With a damper that gives (4.1) at every velocity; it only has to brake, because both have the same F0."""
    fixed_orifices: Array
    """With one fixed orifice per direction."""
    isometric: float
    """F0 [N]."""

    @property
    def damping(self) -> Array:
        """What the ideal damper takes [N], eq. (4.1): positive while shortening, negative while lengthening."""
        return self.actuator_only - self.ideal_damper


@dataclass(frozen=True)
class ForceVelocityError:
    """Distance to the muscle, rms over velocity, over F0 [1]."""

    concentric: float
    """Over the velocities of 0 and above."""
    eccentric: float
    """Over the velocities of 0 and below."""


def compute_force_velocity(
    muscle: Muscle,
    damper: Damper,
    hill: HillCurve,
    peak_velocity: float,
    velocities: Array,
    pressure: float,
    length_ratio: float,
) -> ForceVelocityCurves:
    """The four curves at ``velocities`` [m/s], gauge ``pressure`` [Pa] and ``ratio`` = L/L0.

    F0 is the actuator's own isometric force there (as in Fig. 3.9), ``peak_velocity`` is the muscle's Vmax [m/s].
    """
    velocity = np.asarray(velocities, dtype=np.float64)
    isometric = mckibben.force(muscle, pressure, length_ratio * muscle.resting_length)
    wanted = [max(0.0, hill_law.force_velocity(hill, 1.0, float(v) / peak_velocity)) for v in velocity]
    target = isometric * np.array(wanted)
    alone = np.full(velocity.shape, isometric)
    desired = np.array([damper_law.desired_force(isometric, float(wished)) for wished in target])
    braked = np.array([damper_law.force(damper, -float(v)) for v in velocity])
    return ForceVelocityCurves(velocity, target, alone, alone - desired, alone + braked, isometric)


def compute_rms_error(curves: ForceVelocityCurves, forces: Array) -> ForceVelocityError:
    """How far ``forces`` [N], one of the curves, are from the muscle's; NaN where a side has no velocity."""
    distance = (forces - curves.muscle) / curves.isometric
    sides = (distance[curves.velocity >= 0.0], distance[curves.velocity <= 0.0])
    return ForceVelocityError(*(float(np.sqrt(np.mean(side * side))) if len(side) else float("nan") for side in sides))


def required_orifice(
    curves: ForceVelocityCurves, bore: float, oil_density: float, discharge_coefficient: float
) -> Array:
    """Orifice [m] that would give the ideal damping at each velocity (Fig. 4.3); NaN where none is wanted."""
    found = [
        damper_law.required_orifice(abs(float(force)), abs(float(v)), bore, oil_density, discharge_coefficient)
        if force != 0.0 and v != 0.0
        else float("nan")
        for v, force in zip(curves.velocity, curves.damping, strict=True)
    ]
    return np.array(found)


def velocity_grid(max_lengthening_speed: float, max_shortening_speed: float) -> Array:
    """Velocities [m/s] from ``-slowest`` (lengthening) to ``fastest`` (shortening), 0 among them."""
    return np.concatenate(
        [np.linspace(-max_lengthening_speed, 0.0, 201)[:-1], np.linspace(0.0, max_shortening_speed, 401)]
    )
