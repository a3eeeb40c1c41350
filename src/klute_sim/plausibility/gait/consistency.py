"""Consistency of the ankle's angle and moment and of the load with the motion of the shank."""

from collections.abc import Mapping

import numpy as np

from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.gait.positions import Motion, ScaledSeries
from klute_sim.plausibility.gait.steps import (
    LOADED_STANCE_PCT,
    MIN_KNOWN_PHASES,
    TOE_OFF_PCT,
    Step,
    average_cycle,
    measure_stride_time,
)
from klute_sim.plausibility.samples import compute_correlation
from klute_sim.types import Array

MIN_LOAD_PER_STATURE = 33.0
"""Smallest mean vertical force of one foot over the stride, over the square of the stature [N/m2] (assumed: half of the
load of a slim adult on crutches is 45, pounds under newtons are 25)."""
SPEED_PER_SHANK_RATE = 0.9
"""Walking speed over mean shank rate in stance and leg length [1], from the typical gait."""
MAX_STATURE = 1.85
"""Largest stature that the motion can show [m]; a larger estimate is a long stride."""
ADULT_LEG = 0.86
"""Length of thigh and shank of an adult [m]."""
STATURE_PER_LEG = 2.03
"""Stature over the length of thigh and shank [1] (Winter: 0.245 + 0.246)."""
MIN_FLAT_FOOT_MOTION = 0.03
"""Smallest motion of the ankle over the flat foot that shows its sign [rad]."""
MOMENT_RATIO_RANGE = (0.3, 3.0)
"""Plausible ratio of a measured ankle moment to that of the ground reaction."""


def check_ankle_sign(channels: Mapping[str, ScaledSeries], steps: list[Step], place: str) -> list[Finding]:
    """Return whether the ankle plantarflexes while the shank leans forward over the flat foot."""
    shank, ankle = (average_cycle(channels[name].series, steps)[14:36] for name in ("shank_angle", "ankle_angle"))
    is_opposite = compute_correlation(shank, ankle) < -0.8 and float(ankle[-1] - ankle[0]) < -MIN_FLAT_FOOT_MOTION
    if not is_opposite or float(shank[-1] - shank[0]) < 2.0 * MIN_FLAT_FOOT_MOTION:
        return []
    statement = (
        "`ankle_angle` has the opposite sign: dorsiflexion is positive, and the ankle dorsiflexes while the shank "
        "leans forward over the flat foot; multiply it by -1"
    )
    return [Finding("ankle_angle-sign", place, statement)]


def check_moment(channels: Mapping[str, ScaledSeries], steps: list[Step], place: str) -> list[Finding]:
    """Return the finding on the ankle moment compared with that of the ground reaction about the ankle."""
    moment = average_cycle(channels["ankle_moment"].series, steps)[LOADED_STANCE_PCT]
    ground = compute_ground_moment(channels, steps)
    known = np.isfinite(ground) & np.isfinite(moment)
    moment, ground = moment[known], ground[known]
    if len(moment) < MIN_KNOWN_PHASES or not ground.any():
        return []
    correlation, ratio = compute_correlation(moment, ground), float(moment @ ground / (ground @ ground))
    if correlation < -0.7:
        statement = (
            "`ankle_moment` has the opposite sign: plantarflexor is positive, and the load in front of the ankle needs "
            "a plantarflexor moment; multiply it by -1"
        )
        return [Finding("ankle_moment-sign", place, statement)]
    if correlation > 0.8 and ratio > MOMENT_RATIO_RANGE[1]:
        other = "the ground reaction in lbf or kgf, or the moment in lbf·in"
    elif correlation > 0.8 and 0.0 < ratio < MOMENT_RATIO_RANGE[0]:
        other = "the moment in kgf·m or per kg of body mass, or the ground reaction in a smaller unit"
    else:
        return []
    statement = (
        f"`ankle_moment` is {ratio:.2g} times the moment of the ground reaction about the ankle: it looks like "
        f"{other}; correct the units"
    )
    name = "grf_vertical-unit" if 3.0 < ratio < 12.0 else "ankle_moment-unit"
    return [Finding(name, place, statement)]


def compute_ground_moment(channels: Mapping[str, ScaledSeries], steps: list[Step]) -> Array:
    """Return the mean moment of the ground reaction about the ankle at 4 to 57 % of the cycle [N.m].

    A load in front of the ankle is positive; NaN where it is unknown.
    """
    vertical, forward, height = (
        average_cycle(channels[name].series, steps)[LOADED_STANCE_PCT]
        for name in ("grf_vertical", "grf_forward", "ankle_z")
    )
    cop, x = channels["cop_x"].series, channels["ankle_x"].series
    ankle = np.interp(cop.time, x.time, x.value, left=np.nan, right=np.nan)
    arm = average_cycle(cop._replace(value=cop.value - ankle), steps)[LOADED_STANCE_PCT]
    return np.asarray(arm * vertical + height * forward)


def estimate_walking_speed(channels: Mapping[str, ScaledSeries], steps: list[Step]) -> float:
    """Return the walking speed of an adult whose shank turns over the foot as fast as this one [m/s]."""
    return max(0.15, SPEED_PER_SHANK_RATE * ADULT_LEG * _measure_shank_rate(channels, steps))


def estimate_stature(walking_speed: float, shank_rate: float) -> float:
    """Return the stature [m] of a person who walks at this speed [m/s] with this mean shank rate in stance [rad/s]."""
    return min(STATURE_PER_LEG * walking_speed / (SPEED_PER_SHANK_RATE * shank_rate), MAX_STATURE)


def _measure_shank_rate(channels: Mapping[str, ScaledSeries], steps: list[Step]) -> float:
    """Return the mean forward angular velocity of the shank in stance [rad/s]."""
    shank = average_cycle(channels["shank_angle"].series, steps)
    return float(shank[60] - shank[2]) / (58.0 / TOE_OFF_PCT * _measure_stance(steps))


def _measure_stance(steps: list[Step]) -> float:
    return float(np.mean([step.toe_off - step.strike for step in steps]))


def check_load_against_size(
    channels: Mapping[str, ScaledSeries], steps: list[Step], motion: Motion, place: str
) -> list[Finding]:
    """Return whether the load is too small for a person with legs as long as the motion shows."""
    rate, stance = _measure_shank_rate(channels, steps), _measure_stance(steps)
    if not rate > 0.2 or not motion.walking_speed > 0.2:
        return []
    stature = estimate_stature(motion.walking_speed, rate)
    force = average_cycle(channels["grf_vertical"].series, steps)
    mean_load = float(np.nanmean(force[:62])) * stance / measure_stride_time(steps)
    if stature < 0.9 or mean_load > MIN_LOAD_PER_STATURE * stature**2:
        return []
    statement = (
        f"`grf_vertical` is {mean_load:.0f} N on average over the stride, but the legs are those of a person of about "
        f"{stature:.1f} m: it looks like lbf or per cent of body weight (%BW); correct the unit in its heading"
    )
    return [Finding("grf_vertical-unit", place, statement)]
