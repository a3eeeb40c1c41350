"""Standard deviations for a reference that states none: those of able-bodied adults, scaled."""

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from klute_sim.gait.reference import DEVIATION_COLUMNS, Reference, load_default_reference

CURVE_OF_DEVIATION = dict(
    zip(
        DEVIATION_COLUMNS,
        ("ankle_dorsiflexion_deg", "ankle_plantarflexor_moment_nm_per_kg", "ankle_power_w_per_kg"),
        strict=True,
    )
)
"""Column of the curve by the column of its standard deviation."""


def assume_standard_deviations(reference: Reference, *, everywhere: bool = False) -> Reference:
    """Return ``reference`` with a standard deviation for ankle angle, moment and power.

    One that is missing is that of the default reference at the same gait phase, times the ratio of the ranges of the
    two curves (assumed: people vary by the same fraction). With ``everywhere``, the measured ones count as assumed,
    too: nobody has measured whether they hold at another speed or on another slope.
    """
    missing = [column for column in DEVIATION_COLUMNS if not reference.has_column(column)]
    default = load_default_reference()
    splines, ranges = dict(reference.splines), dict(reference.ranges)
    for column in missing:
        curve, spline = CURVE_OF_DEVIATION[column], default.splines[column]
        ratio = float(np.ptp(reference.ranges[curve]) / np.ptp(default.ranges[curve]))
        splines[column] = CubicSpline(spline.x, ratio * spline(spline.x), bc_type="periodic")
        low, high = default.ranges[column]
        ranges[column] = (ratio * low, ratio * high)
    assumed = DEVIATION_COLUMNS if everywhere else tuple(missing)
    return replace(reference, splines=splines, ranges=ranges, assumed_deviations=assumed)
