"""A device pulled through a prescribed length, without MuJoCo: what chapter 7 needs beside the bench's own tests."""

import numpy as np

from klute_sim.device.rollout import Trace, rollout
from klute_sim.device.step import Parameters, settled
from klute_sim.reproduce.picture import Array

STEP = 2.5e-4
"""[s]"""


def pulled(parameters: Parameters, length: Array, command: Array) -> Trace:
    """From rest at the first ``length`` [m] and ``command`` [Pa] through all of them, one per :data:`STEP`."""
    start = settled(parameters, float(length[0]), float(command[0]))
    return rollout(parameters, length, command, STEP, start=start, threads=1)


def moving(parameters: Parameters, there: float, travel: float, speed: float, pressure: float) -> float:
    """Force [N] in passing unit length ``there`` [m] at ``speed`` [m/s], lengthening positive; 0: at rest.

    The ramp begins and ends ``travel`` [m] from there.
    """
    if speed == 0.0:
        return float(pulled(parameters, np.full(4, there), np.full(4, pressure)).tension[-1])
    count = round(2.0 * travel / abs(speed) / STEP)
    ramp = there + np.sign(speed) * travel * np.linspace(-1.0, 1.0, count + 1)
    found = pulled(parameters, ramp, np.full(len(ramp), pressure))
    return float(np.interp(0.0, np.sign(speed) * (ramp - there), found.tension))
