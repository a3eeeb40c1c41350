"""Plausibility of the body mass against the ground reaction and the size of the legs."""

from collections.abc import Sequence

import numpy as np

from klute_sim.constants import GRAVITY
from klute_sim.mocap.strides.strides import PHASE_GRID, Stride
from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.gait import consistency

POUND_RATIO = (2.08, 2.42)
"""Range of the ratio of a mass in lb to one in kg, with an error of the plates of 6 to 9 %."""
MASS_RATIO_RANGE = (0.55, 2.6)
"""Plausible ratio of the given mass to that which the ground reaction supports; crutches carry half of the body."""
MIN_BODY_MASS_INDEX = 8.5
"""Smallest mass over squared stature [kg/m2] that the ground reaction can show (assumed: half of a slim adult)."""
MIN_MASS = 18.0
"""Smallest mass that the ground reaction can show [kg]; a subject has 20 kg or more."""


def estimate_stature(strides: Sequence[Stride], walking_speed: float | None) -> float | None:
    """Return the stature that the motion of the shank and the speed show [m]; None if they are unknown."""
    if walking_speed is None or not walking_speed > 0.2:
        return None
    changes = [
        float(np.interp(0.95 * s.toe_off, PHASE_GRID, s.channels["shank_angle"]) - s.channels["shank_angle"][1])
        for s in strides
    ]
    durations = [(0.95 * s.toe_off - PHASE_GRID[1]) * s.duration for s in strides]
    rate = float(np.radians(np.mean(changes)) / np.mean(durations))
    return consistency.estimate_stature(walking_speed, rate) if rate > 0.2 else None


def find_mass_findings(supported: float, given: float | None, stature: float | None) -> list[Finding]:
    """Return whether the body mass that the ground reaction supports [kg] contradicts the other numbers.

    ``given`` is the mass that the user states [kg], ``stature`` the body height that is given or that the motion shows.
    """
    place = "ground reaction"
    if given is not None:
        ratio = given / supported
        if POUND_RATIO[0] <= ratio <= POUND_RATIO[1]:
            statement = (
                f"it supports {supported:.0f} kg over a stride, the given mass is {given:g} kg: the mass looks "
                "like lb; give it in kg"
            )
            return [Finding("mass-unit", place, statement)]
        if not MASS_RATIO_RANGE[0] <= ratio <= MASS_RATIO_RANGE[1]:
            statement = (
                f"it supports {supported:.3g} kg over a stride, the given mass is {given:g} kg: {_guess(ratio)}; "
                "correct the unit"
            )
            return [Finding("grf_vertical-unit", place, statement)]
        return []
    is_light = stature is not None and supported < MIN_BODY_MASS_INDEX * stature**2
    if not is_light and supported >= MIN_MASS:
        return []
    size = "" if stature is None else f", but the legs are those of a person of about {stature:.1f} m"
    statement = (
        f"it supports {supported:.3g} kg over a stride{size}: forces look like lbf or per cent of body weight (%BW); "
        "correct the unit (or pass --mass)"
    )
    return [Finding("grf_vertical-unit", place, statement)]


def _guess(ratio: float) -> str:
    if 3.6 <= ratio <= 5.6:
        return "forces look like lbf"
    if 7.5 <= ratio <= 12.5:
        return f"forces look like kgf (a factor of {GRAVITY:.2f})"
    return "one of them is in another unit"
