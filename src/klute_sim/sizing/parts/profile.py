"""Transfer of the tuned pressure profile to another device and another body."""

import math
from functools import cache

import numpy as np

from klute_sim.controllers.pressure import PressureProfile, load_default_profile
from klute_sim.device.device import DEFAULT_DEVICE, load_device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.laws import mckibben
from klute_sim.laws.mckibben import MuscleParameters
from klute_sim.sizing.evaluation.demand import StrideGeometry
from klute_sim.sizing.parts.actuator import compute_required_pressure
from klute_sim.units import BAR

TUNED_PROFILE_MASS = 75.0
"""Body mass [kg] of the walker with the default prosthesis for whom the profile was tuned."""


@cache
def _tuned_muscle() -> MuscleParameters:
    """Return the muscle of the default prosthesis."""
    return load_device(DEFAULT_DEVICE).parameters.muscle


@cache
def _tuned_profile() -> PressureProfile:
    """Return the tuned profile of the default prosthesis."""
    return load_default_profile()


def transfer_profile(parameters: DeviceParameters, mass: float, geometry: StrideGeometry) -> PressureProfile:
    """Return the profile that gives a device the same force per body mass [kg] as the default prosthesis.

    Assumed: both muscles have the same L/L0 at the same phase, that of ``geometry``. Pressures are clipped to the
    supply pressure.
    """
    muscle, tuned_muscle, tuned_profile = parameters.muscle, _tuned_muscle(), _tuned_profile()
    stride_ratios = np.minimum(geometry.free_muscle_length / muscle.resting_length, 1.0)
    ratios = np.interp(np.array(tuned_profile.gait_pct) / 100.0, geometry.phase, stride_ratios)
    pressures = []
    for bar, ratio in zip(tuned_profile.pressure_bar, ratios, strict=True):
        force = (
            mckibben.force(tuned_muscle, bar * BAR, float(ratio) * tuned_muscle.resting_length)
            * mass
            / TUNED_PROFILE_MASS
        )
        # Where the tuned muscle does not pull, there is no force to transfer, so the pressure is kept.
        pressure = (
            compute_required_pressure(muscle, force, float(ratio) * muscle.resting_length) if force > 0.0 else bar * BAR
        )
        pressures.append(
            parameters.supply.max_pressure if math.isnan(pressure) else min(pressure, parameters.supply.max_pressure)
        )
    return PressureProfile("carried over", tuned_profile.gait_pct, tuple(round(p / BAR, 3) for p in pressures))
