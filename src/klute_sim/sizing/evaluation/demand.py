"""What a walker's stride asks of the device (chapter 7's use): force, length, pressure and air over the cycle.

Assumed throughout: the ankle moves as the reference, the tendon alone carries the plantarflexor moment (the return
spring of the prosthesis helps in truth), its arm is constant, and where it carries nothing it is just taut.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from klute_sim.controllers.pressure import PressureController
from klute_sim.device.dynamics import DeviceParameters, compute_equilibrium_state
from klute_sim.laws import damper as damper_law
from klute_sim.laws import mckibben, pneumatics
from klute_sim.laws import tendon as tendon_law
from klute_sim.recording.recording import Array
from klute_sim.sizing.parts.actuator import pressure_for_force
from klute_sim.sizing.target import MOMENT_COLUMN, WalkerTarget

SAMPLES_PER_STRIDE = 200
"""Phases of the stride that are looked at."""
MIN_LOADED_FORCE_FRACTION = 0.05
"""Tendon force over its peak above which strength is compared with demand."""


class StrideGeometry(NamedTuple):
    """How muscle and tendon lie over one stride, whatever the pressure; arrays over phase."""

    phase: Array
    """0-1."""
    tendon_force: Array
    """Tension that the moment asks for [N]."""
    unit_length: Array
    """Length of muscle and tendon together [m]."""
    free_muscle_length: Array
    """Length that is left to the muscle [m]; above L0 the stop carries."""


@dataclass(frozen=True)
class StrideDemand:
    """One stride; arrays over phase."""

    phase: Array
    """0-1."""
    tendon_force: Array
    """Tension that the moment asks for [N]."""
    length_ratio: Array
    """Muscle length over L0 under that tension, not above 1."""
    muscle_velocity: Array
    """Of the muscle's length [m/s], negative while shortening."""
    damping_force: Array
    """What the damper adds to the tension [N]; negative while shortening."""
    max_isometric_force: Array
    """Isometric force at the supply's pressure [N]."""
    commanded_isometric_force: Array
    """Isometric force at the profile's pressure [N]."""
    required_pressure: Array
    """Gauge pressure [Pa] at which muscle and damper carry the tension; NaN beyond 20 bar, 0 where there is none."""
    at_stop: np.ndarray
    """Where the muscle would be longer than L0: the stop carries, too."""
    peak_moment_fraction: float
    """Ankle moment that the device holds at rest at the supply's pressure, over the peak, at the peak's phase [1]."""
    air_mass: float
    """Taken from the supply in a stride under the profile [kg]; isothermal, no dead volume (assumed)."""

    @property
    def is_loaded(self) -> np.ndarray:
        """Where the tendon carries more than :data:`LOADED` of its peak."""
        return np.asarray(self.tendon_force > MIN_LOADED_FORCE_FRACTION * self.tendon_force.max())

    @property
    def force_margin(self) -> Array:
        """Isometric force at the supply's pressure over what tension and damper ask for [1]; NaN where unloaded."""
        asked = self.tendon_force - self.damping_force
        return np.where(
            self.is_loaded & (asked > 0.0), self.max_isometric_force / np.where(asked > 0.0, asked, 1.0), np.nan
        )


def compute_stride_geometry(
    parameters: DeviceParameters, neutral_ratio: float, moment_arm: float, walker: WalkerTarget
) -> StrideGeometry:
    """The stride of ``walker`` with the device mounted at ``neutral_ratio`` [L0] with a moment ``arm`` [m]."""
    tendon = parameters.tendon
    phase = np.arange(SAMPLES_PER_STRIDE) / SAMPLES_PER_STRIDE
    angle = np.radians(walker.reference("ankle_dorsiflexion_deg", phase))
    moment = walker.mass * walker.moment_scale * walker.reference(MOMENT_COLUMN, phase)
    pull = np.maximum(moment, 0.0) / moment_arm
    unit = neutral_ratio * parameters.muscle.resting_length + tendon.slack_length + moment_arm * angle
    stretch = np.array([tendon_law.stretch_at_tension(tendon, float(force)) for force in pull])
    return StrideGeometry(phase, pull, unit, unit - tendon.slack_length - stretch)


def compute_stride_demand(
    parameters: DeviceParameters, walker: WalkerTarget, geometry: StrideGeometry, profile: PressureController
) -> StrideDemand:
    """The demand of ``walker`` on the device that ``lies`` so, under ``profile``."""
    muscle, tendon, supply = parameters.muscle, parameters.tendon, parameters.supply
    phase, pull, unit, free = geometry
    rest = muscle.resting_length
    length = np.minimum(free, rest)
    step = walker.reference.stride_time / SAMPLES_PER_STRIDE
    rate = (np.roll(length, -1) - np.roll(length, 1)) / (2.0 * step)
    damping = np.array([damper_law.force(parameters.damper, float(v)) for v in rate])
    pressure = np.array([min(profile.pressure_at(float(p)), supply.max_pressure) for p in phase])

    def isometric(gauge: Array) -> Array:
        return np.array([mckibben.force(muscle, float(p), float(x)) for p, x in zip(gauge, length, strict=True)])

    needed = [
        pressure_for_force(muscle, float(force - braked), float(x)) if force > 0.0 else 0.0
        for force, braked, x in zip(pull, damping, length, strict=True)
    ]
    mass = [
        pneumatics.air_mass(float(p), mckibben.volume(muscle, float(x)), supply.temperature)
        for p, x in zip(pressure, length, strict=True)
    ]
    at = int(pull.argmax())
    held = (
        unit[at]
        - compute_equilibrium_state(parameters, float(unit[at]), supply.max_pressure).length
        - tendon.slack_length
    )
    return StrideDemand(
        phase=phase,
        tendon_force=pull,
        length_ratio=length / rest,
        muscle_velocity=rate,
        damping_force=damping,
        max_isometric_force=isometric(np.full(SAMPLES_PER_STRIDE, supply.max_pressure)),
        commanded_isometric_force=isometric(pressure),
        required_pressure=np.array(needed),
        at_stop=np.asarray(free > rest),
        peak_moment_fraction=tendon_law.force(tendon, float(held)) / float(pull[at]),
        air_mass=float(np.maximum(np.diff(np.append(mass, mass[0])), 0.0).sum()),
    )
