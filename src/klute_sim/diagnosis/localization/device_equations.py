"""Equations of muscle, damper and tendon, evaluated with channels."""

from collections.abc import Mapping

import numpy as np
from scipy.signal import savgol_filter

from klute_sim.datasets.trial import SensorLimits
from klute_sim.device.dynamics import (
    ZERO_INTERNAL_STATE,
    DeviceParameters,
    compute_muscle_force,
    compute_tendon_force,
)
from klute_sim.types import Array, Mask

SMOOTHING_TIME = 0.05
"""Window [s] over which lengths and angles are smoothed for their derivatives."""
MIN_SMOOTHED_SAMPLES = 5
"""Minimum number of samples in this window."""


def count_smoothed_samples(sampling_interval: float) -> int:
    """Return the odd number of samples at ``sampling_interval`` [s] in the smoothing window."""
    return max(MIN_SMOOTHED_SAMPLES, 2 * round(0.5 * SMOOTHING_TIME / sampling_interval) + 1)


def find_unlimited_samples(measured: Mapping[str, Array], limits: Mapping[str, SensorLimits]) -> Mask:
    """Return which samples are inside the limits of all sensors; an equation needs the values themselves."""
    is_inside = np.ones(len(next(iter(measured.values()))), dtype=np.bool_)
    for channel, limit in limits.items():
        if channel in measured:
            is_inside &= (measured[channel] > limit.low) & (measured[channel] < limit.high)
    return is_inside


def compute_force_residuals(
    values: Mapping[str, Array], channels: Mapping[str, Array], parameters: DeviceParameters
) -> dict[str, Array]:
    """Return the load cell's force minus that of muscle and damper, and of the tendon [N], by equation.

    ``values`` [SI] are time, unit length, force, pressure and, if it is one of the measured ``channels``, muscle
    length. Without it, the force gives the muscle length through the tendon.
    """
    force, unit_length, residuals, name = values["force"], values["unit_length"], {}, "muscle and damper"
    tendon = parameters.tendon
    if "muscle_length" in channels:
        length = channels["muscle_length"]
        if not tendon.is_rigid:
            tendon_force = [
                compute_tendon_force(parameters, ZERO_INTERNAL_STATE, *row)
                for row in zip(length, unit_length, strict=True)
            ]
            residuals["tendon"] = force - np.array(tendon_force)
    elif tendon.is_rigid:
        length = unit_length - tendon.slack_length
    else:
        length = unit_length - tendon.slack_length - _solve_tendon_stretch(parameters, force)
        name = "muscle, damper or tendon"
    sampling_interval = float(np.median(np.diff(values["time"])))
    window = count_smoothed_samples(sampling_interval)
    if len(length) > window:
        rate = savgol_filter(length, window, 2, deriv=1, delta=sampling_interval)
        rows = zip(values["pressure"], length, rate, strict=True)
        muscle_force = [compute_muscle_force(parameters, ZERO_INTERNAL_STATE, *row) for row in rows]
        residuals[name] = force - np.array(muscle_force)
    return residuals


def _solve_tendon_stretch(parameters: DeviceParameters, force: Array) -> Array:
    """Return the tendon stretch [m] at ``force`` [N], interpolated in a table of the tendon's force."""
    slack_length = parameters.tendon.slack_length
    stretch = np.linspace(0.0, 0.5 * slack_length, 2001)
    table = [compute_tendon_force(parameters, ZERO_INTERNAL_STATE, 0.0, slack_length + x) for x in stretch]
    return np.interp(force, table, stretch)
