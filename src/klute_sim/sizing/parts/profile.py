"""The tuned pressure profile carried over to another device and another body."""

import math
from functools import cache

import numpy as np

from klute_sim.controllers.pressure import PressureProfile, load_default_profile
from klute_sim.device.device import DEFAULT_DEVICE, load_device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.laws import mckibben
from klute_sim.laws.mckibben import Muscle
from klute_sim.sizing.evaluation.demand import StrideGeometry
from klute_sim.sizing.parts.actuator import pressure_for_force
from klute_sim.units import BAR

TUNED_PROFILE_MASS = 75.0
"""Body mass [kg] of the walker, with the default prosthesis, that the tuned profile is for."""


@cache
def _tuned_muscle() -> Muscle:
    """The muscle that the tuned profile is for."""
    return load_device(DEFAULT_DEVICE).parameters.muscle


@cache
def _tuned_profile() -> PressureProfile:
    return load_default_profile()


def transfer_profile(parameters: DeviceParameters, mass: float, geometry: StrideGeometry) -> PressureProfile:
    """The profile under which a device pulls with as much force per body mass [kg] as the default prosthesis does.

    Assumed: the same L/L0 at the same phase in both, that of the stride as the device ``lies`` in it. Clipped to what
    the supply has.
    """
    own, hand_made, given = parameters.muscle, _tuned_muscle(), _tuned_profile()
    ratio_of = np.minimum(geometry.free_muscle_length / own.resting_length, 1.0)
    ratios = np.interp(np.array(given.gait_pct) / 100.0, geometry.phase, ratio_of)
    pressures = []
    for bar, ratio in zip(given.pressure_bar, ratios, strict=True):
        force = (
            mckibben.force(hand_made, bar * BAR, float(ratio) * hand_made.resting_length) * mass / TUNED_PROFILE_MASS
        )
        # Where it does not pull there is no force to carry over: the pressure stays.
        found = pressure_for_force(own, force, float(ratio) * own.resting_length) if force > 0.0 else bar * BAR
        pressures.append(
            parameters.supply.max_pressure if math.isnan(found) else min(found, parameters.supply.max_pressure)
        )
    return PressureProfile("carried over", given.gait_pct, tuple(round(p / BAR, 3) for p in pressures))
