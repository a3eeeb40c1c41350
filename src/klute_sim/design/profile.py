"""The tuned pressure profile carried over to another device and another body."""

import math
from functools import cache

import numpy as np

from klute_sim.control.pressure import Profile, tuned
from klute_sim.design.actuator import pressure_for
from klute_sim.design.demand import Posture
from klute_sim.device.files import DEFAULT_PROSTHESIS, load
from klute_sim.device.step import Parameters
from klute_sim.laws import mckibben
from klute_sim.laws.mckibben import Muscle
from klute_sim.units import BAR

TUNED_FOR = 75.0
"""Body mass [kg] of the walker, with the default prosthesis, that the tuned profile is for."""


@cache
def _hand_made() -> Muscle:
    """The muscle that the tuned profile is for."""
    return load(DEFAULT_PROSTHESIS).parameters.muscle


@cache
def _tuned() -> Profile:
    return tuned()


def carried_over(parameters: Parameters, mass: float, lies: Posture) -> Profile:
    """The profile under which a device pulls with as much force per body mass [kg] as the default prosthesis does.

    Assumed: the same L/L0 at the same phase in both, that of the stride as the device ``lies`` in it. Clipped to what
    the supply has.
    """
    own, hand_made, given = parameters.muscle, _hand_made(), _tuned()
    ratio_of = np.minimum(lies.free / own.resting_length, 1.0)
    ratios = np.interp(np.array(given.gait_pct) / 100.0, lies.phase, ratio_of)
    pressures = []
    for bar, ratio in zip(given.pressure_bar, ratios, strict=True):
        force = mckibben.force(hand_made, bar * BAR, float(ratio) * hand_made.resting_length) * mass / TUNED_FOR
        # Where it does not pull there is no force to carry over: the pressure stays.
        found = pressure_for(own, force, float(ratio) * own.resting_length) if force > 0.0 else bar * BAR
        pressures.append(parameters.supply.pressure if math.isnan(found) else min(found, parameters.supply.pressure))
    return Profile("carried over", given.gait_pct, tuple(round(p / BAR, 3) for p in pressures))
