"""Demand of a stride on the device (as in chapter 7): force, length, pressure and air over the gait cycle.

Assumed throughout: the ankle follows the reference; the tendon alone carries the plantarflexor moment (in reality the
return spring of the prosthesis helps); its moment arm is constant; it is just taut where it carries no load.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from klute_sim.controllers.pressure import PressureController
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.device.equilibrium import compute_equilibrium_state
from klute_sim.laws import damper as damper_law
from klute_sim.laws import mckibben, pneumatics
from klute_sim.laws import tendon as tendon_law
from klute_sim.sizing.parts.actuator import compute_required_pressure
from klute_sim.sizing.target import MOMENT_COLUMN, WalkerTarget
from klute_sim.types import Array

SAMPLES_PER_STRIDE = 200
"""Number of phases at which a stride is evaluated."""
MIN_LOADED_FORCE_FRACTION = 0.05
"""Tendon force over its peak above which the force margin is evaluated."""


class StrideGeometry(NamedTuple):
    """Lengths and tendon force over one stride, independent of pressure; arrays over phase."""

    phase: Array
    """Gait phase, 0 to 1."""
    tendon_force: Array
    """Tension that the ankle moment requires [N]."""
    unit_length: Array
    """Length of muscle and tendon together [m]."""
    free_muscle_length: Array
    """Length that the stretched tendon leaves to the muscle [m]; above L0 the stop carries load."""


@dataclass(frozen=True)
class StrideDemand:
    """Demand of one stride; arrays over phase."""

    phase: Array
    """Gait phase, 0 to 1."""
    tendon_force: Array
    """Tension that the ankle moment requires [N]."""
    length_ratio: Array
    """Muscle length over L0 under that tension, at most 1."""
    muscle_velocity: Array
    """Rate of the muscle length [m/s], negative while shortening."""
    damping_force: Array
    """Tension that the damper adds [N], negative while shortening."""
    max_isometric_force: Array
    """Isometric force at the supply pressure [N]."""
    commanded_isometric_force: Array
    """Isometric force at the pressure of the profile [N]."""
    required_pressure: Array
    """Gauge pressure [Pa] at which muscle and damper carry the tension; NaN above 20 bar, 0 without tension."""
    at_stop: np.ndarray
    """Whether the muscle would exceed L0, so that the stop carries load."""
    peak_moment_fraction: float
    """Static ankle moment at the supply pressure over the peak moment, at the phase of the peak [1]."""
    air_mass: float
    """Air drawn from the supply in one stride of the profile [kg]; isothermal (assumed)."""

    @property
    def is_loaded(self) -> np.ndarray:
        """Return where the tendon carries more than :data:`MIN_LOADED_FORCE_FRACTION` of its peak."""
        return np.asarray(self.tendon_force > MIN_LOADED_FORCE_FRACTION * self.tendon_force.max())

    @property
    def force_margin(self) -> Array:
        """Return the isometric force at the supply pressure over the force that tension and damper require [1].

        NaN where the tendon is unloaded.
        """
        required_force = self.tendon_force - self.damping_force
        return np.where(
            self.is_loaded & (required_force > 0.0),
            self.max_isometric_force / np.where(required_force > 0.0, required_force, 1.0),
            np.nan,
        )


def compute_stride_geometry(
    parameters: DeviceParameters, neutral_ratio: float, moment_arm: float, walker: WalkerTarget
) -> StrideGeometry:
    """Return the stride of ``walker`` for a device mounted at ``neutral_ratio`` [L0] with ``moment_arm`` [m]."""
    tendon = parameters.tendon
    phase = np.arange(SAMPLES_PER_STRIDE) / SAMPLES_PER_STRIDE
    angle = np.radians(walker.reference("ankle_dorsiflexion_deg", phase))
    moment = walker.mass * walker.moment_scale * walker.reference(MOMENT_COLUMN, phase)
    tendon_force = np.maximum(moment, 0.0) / moment_arm
    unit_length = neutral_ratio * parameters.muscle.resting_length + tendon.slack_length + moment_arm * angle
    stretch = np.array([tendon_law.stretch_at_tension(tendon, float(force)) for force in tendon_force])
    return StrideGeometry(phase, tendon_force, unit_length, unit_length - tendon.slack_length - stretch)


def compute_stride_demand(
    parameters: DeviceParameters, walker: WalkerTarget, geometry: StrideGeometry, profile: PressureController
) -> StrideDemand:
    """Return the demand of ``walker`` on a device with ``geometry`` under the pressure ``profile``."""
    muscle, tendon, supply = parameters.muscle, parameters.tendon, parameters.supply
    phase, tendon_force, unit_length, free_length = geometry
    resting_length = muscle.resting_length
    length = np.minimum(free_length, resting_length)
    dt = walker.reference.stride_time / SAMPLES_PER_STRIDE
    velocity = (np.roll(length, -1) - np.roll(length, 1)) / (2.0 * dt)
    damping = np.array([damper_law.force(parameters.damper, float(v)) for v in velocity])
    pressure = np.array([min(profile.pressure_at(float(p)), supply.max_pressure) for p in phase])

    def compute_isometric_forces(pressures: Array) -> Array:
        return np.array([mckibben.force(muscle, float(p), float(x)) for p, x in zip(pressures, length, strict=True)])

    required_pressure = [
        compute_required_pressure(muscle, float(force - damper_force), float(x)) if force > 0.0 else 0.0
        for force, damper_force, x in zip(tendon_force, damping, length, strict=True)
    ]
    air_mass = [
        pneumatics.air_mass(float(p), mckibben.gas_volume(muscle, float(x)) + supply.dead_volume, supply.temperature)
        for p, x in zip(pressure, length, strict=True)
    ]
    peak = int(tendon_force.argmax())
    tendon_stretch = (
        unit_length[peak]
        - compute_equilibrium_state(parameters, float(unit_length[peak]), supply.max_pressure).length
        - tendon.slack_length
    )
    return StrideDemand(
        phase=phase,
        tendon_force=tendon_force,
        length_ratio=length / resting_length,
        muscle_velocity=velocity,
        damping_force=damping,
        max_isometric_force=compute_isometric_forces(np.full(SAMPLES_PER_STRIDE, supply.max_pressure)),
        commanded_isometric_force=compute_isometric_forces(pressure),
        required_pressure=np.array(required_pressure),
        at_stop=np.asarray(free_length > resting_length),
        peak_moment_fraction=tendon_law.force(tendon, float(tendon_stretch)) / float(tendon_force[peak]),
        air_mass=float(np.maximum(np.diff(np.append(air_mass, air_mass[0])), 0.0).sum()),
    )
