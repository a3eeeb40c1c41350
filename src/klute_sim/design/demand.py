"""What a walker's stride asks of the device (chapter 7's use): force, length, pressure and air over the cycle.

Assumed throughout: the ankle moves as the reference, the tendon alone carries the plantarflexor moment (the return
spring of the prosthesis helps in truth), its arm is constant, and where it carries nothing it is just taut.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from klute_sim.control.pressure import PressureController
from klute_sim.design.actuator import pressure_for
from klute_sim.design.target import MOMENT, Walker
from klute_sim.device.step import Parameters, settled
from klute_sim.laws import damper as damper_law
from klute_sim.laws import mckibben, pneumatics
from klute_sim.laws import tendon as tendon_law
from klute_sim.recording.recording import Samples

SAMPLES = 200
"""Phases of the stride that are looked at."""
LOADED = 0.05
"""Tendon force over its peak above which strength is compared with demand."""


class Posture(NamedTuple):
    """How muscle and tendon lie over one stride, whatever the pressure; arrays over phase."""

    phase: Samples
    """0-1."""
    tendon: Samples
    """Tension that the moment asks for [N]."""
    unit: Samples
    """Length of muscle and tendon together [m]."""
    free: Samples
    """Length that is left to the muscle [m]; above L0 the stop carries."""


@dataclass(frozen=True)
class Demand:
    """One stride; arrays over phase."""

    phase: Samples
    """0-1."""
    tendon: Samples
    """Tension that the moment asks for [N]."""
    ratio: Samples
    """Muscle length over L0 under that tension, not above 1."""
    rate: Samples
    """Of the muscle's length [m/s], negative while shortening."""
    damping: Samples
    """What the damper adds to the tension [N]; negative while shortening."""
    strongest: Samples
    """Isometric force at the supply's pressure [N]."""
    commanded: Samples
    """Isometric force at the profile's pressure [N]."""
    needed_pressure: Samples
    """Gauge pressure [Pa] at which muscle and damper carry the tension; NaN beyond 20 bar, 0 where there is none."""
    at_stop: np.ndarray
    """Where the muscle would be longer than L0: the stop carries, too."""
    peak_share: float
    """Ankle moment that the device holds at rest at the supply's pressure, over the peak, at the peak's phase [1]."""
    air: float
    """Taken from the supply in a stride under the profile [kg]; isothermal, no dead volume (assumed)."""

    @property
    def loaded(self) -> np.ndarray:
        """Where the tendon carries more than :data:`LOADED` of its peak."""
        return np.asarray(self.tendon > LOADED * self.tendon.max())

    @property
    def margin(self) -> Samples:
        """Isometric force at the supply's pressure over what tension and damper ask for [1]; NaN where unloaded."""
        asked = self.tendon - self.damping
        return np.where(self.loaded & (asked > 0.0), self.strongest / np.where(asked > 0.0, asked, 1.0), np.nan)


def posture(parameters: Parameters, neutral_ratio: float, arm: float, walker: Walker) -> Posture:
    """The stride of ``walker`` with the device mounted at ``neutral_ratio`` [L0] with a moment ``arm`` [m]."""
    tendon = parameters.tendon
    phase = np.arange(SAMPLES) / SAMPLES
    angle = np.radians(walker.reference("ankle_dorsiflexion_deg", phase))
    moment = walker.mass * walker.moment_scale * walker.reference(MOMENT, phase)
    pull = np.maximum(moment, 0.0) / arm
    unit = neutral_ratio * parameters.muscle.resting_length + tendon.slack_length + arm * angle
    stretch = np.array([tendon_law.stretch_under(tendon, float(force)) for force in pull])
    return Posture(phase, pull, unit, unit - tendon.slack_length - stretch)


def over_stride(parameters: Parameters, walker: Walker, lies: Posture, profile: PressureController) -> Demand:
    """The demand of ``walker`` on the device that ``lies`` so, under ``profile``."""
    muscle, tendon, supply = parameters.muscle, parameters.tendon, parameters.supply
    phase, pull, unit, free = lies
    rest = muscle.resting_length
    length = np.minimum(free, rest)
    step = walker.reference.stride_time / SAMPLES
    rate = (np.roll(length, -1) - np.roll(length, 1)) / (2.0 * step)
    damping = np.array([damper_law.force(parameters.damper, float(v)) for v in rate])
    pressure = np.array([min(profile.pressure(float(p)), supply.pressure) for p in phase])

    def isometric(gauge: Samples) -> Samples:
        return np.array([mckibben.force(muscle, float(p), float(x)) for p, x in zip(gauge, length, strict=True)])

    needed = [
        pressure_for(muscle, float(force - braked), float(x)) if force > 0.0 else 0.0
        for force, braked, x in zip(pull, damping, length, strict=True)
    ]
    mass = [
        pneumatics.air_mass(float(p), mckibben.volume(muscle, float(x)), supply.temperature)
        for p, x in zip(pressure, length, strict=True)
    ]
    at = int(pull.argmax())
    held = unit[at] - settled(parameters, float(unit[at]), supply.pressure).length - tendon.slack_length
    return Demand(
        phase=phase,
        tendon=pull,
        ratio=length / rest,
        rate=rate,
        damping=damping,
        strongest=isometric(np.full(SAMPLES, supply.pressure)),
        commanded=isometric(pressure),
        needed_pressure=np.array(needed),
        at_stop=np.asarray(free > rest),
        peak_share=tendon_law.force(tendon, float(held)) / float(pull[at]),
        air=float(np.maximum(np.diff(np.append(mass, mass[0])), 0.0).sum()),
    )
