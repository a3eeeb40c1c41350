"""Markers of a leg: unit, missing samples, exchanged markers, axes and direction of walking."""

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.samples import MISSING_VALUE_CODES
from klute_sim.plausibility.units import Range, guess_units, round_digits
from klute_sim.types import Array

SEGMENT_RANGES: Mapping[tuple[str, str], Range] = MappingProxyType(
    {
        ("hip", "knee"): Range(0.17, 0.75, 0.42),
        ("knee", "ankle"): Range(0.16, 0.62, 0.41),
        ("heel", "toe"): Range(0.07, 0.42, 0.20),
    }
)
"""Upper and lower end of a segment -> length [m], from a child of three to the tallest adults, with soft tissue."""
MAX_LENGTH_CHANGE = 0.2
"""Largest relative change of a segment's length by skin and gaps."""
MIN_CHANGED_FRACTION = 0.03
"""Smallest fraction of frames with another length that shows exchanged markers."""
MIN_SIDE_DISTANCE = 0.03
"""Distance by which the right heel is to the left of the left heel [m] that shows exchanged sides."""
LEG_PER_STATURE = (0.36, 0.62)
"""Range of the length of thigh and shank over stature (Winter: 0.49)."""
MAX_MARKER_RATE = 2000.0
"""Largest sampling rate of markers and angles [Hz]."""
LENGTH_FACTORS = (1.0, 1e-3, 1e-2, 0.0254)
"""Factors to metres of the units of marker files."""


def find_missing_frames(name: str, position: Array, place: str) -> list[Finding]:
    """Return whether the marker ``name`` at ``position`` (n, 3) [m] has frames with a code or at the origin."""
    is_origin = (position == 0.0).all(axis=1)
    if 0 < is_origin.sum() < len(position):
        statement = (
            f"marker `{name}` is at the origin in {int(is_origin.sum())} frames: it looks like a code for a hidden "
            "marker; leave these cells empty"
        )
        return [Finding("marker-missing", place, statement)]
    for factor in LENGTH_FACTORS:
        written = position / factor
        for code in MISSING_VALUE_CODES:
            is_code = np.isclose(written, code, rtol=1e-9, atol=0.0).all(axis=1)
            if 0 < is_code.sum() < len(position):
                statement = (
                    f"marker `{name}` is {code:g} in {int(is_code.sum())} frames: it looks like a code for a hidden "
                    "marker; leave these cells empty"
                )
                return [Finding("marker-missing", place, statement)]
    return []


def find_frame_rate(time: Array, place: str) -> list[Finding]:
    """Return whether the frames are implausibly far apart or close together."""
    interval = float(np.median(np.diff(time)))
    if 1.0 / MAX_MARKER_RATE <= interval <= 0.11:
        return []
    if abs(interval - 1.0) < 1e-6:
        guess = "frame numbers or ms"
    elif 0.4 <= interval <= 110.0:
        guess = "ms"
    else:
        guess = "min" if interval < 1.0 / MAX_MARKER_RATE else "a wrong unit"
    statement = f"`time` has a sample every {round_digits(interval):g} s: it looks like {guess}; convert it to s"
    return [Finding("time-unit", place, statement)]


def find_length_unit(legs: Sequence[Mapping[str, Array]], place: str) -> list[Finding]:
    """Return whether all segments of ``legs``, landmark -> position (n, 3) [m], have lengths of another unit."""
    ratios: list[float] = []
    guesses: list[str] = []
    for leg in legs:
        for (upper, lower), plausible in SEGMENT_RANGES.items():
            if upper in leg and lower in leg:
                length = _measure_length(leg[upper], leg[lower])
                ratios.append(length / plausible.typical)
                guesses += guess_units(length, 1.0, "m", plausible)
    ratio = float(np.median(ratios)) if ratios else 1.0
    if 0.38 <= ratio <= 1.7:
        return []
    if ratio == 0.0:
        statement = "the markers of hip, knee and ankle are at one place; check which markers are named"
        return [Finding("marker-unit", place, statement)]
    length = SEGMENT_RANGES["knee", "ankle"].typical * ratio
    unit = max(guesses, key=guesses.count, default="another unit")
    if ratio < 1.0:
        unit = {-3: "m under a heading in mm", -2: "m under a heading in cm", -1: "cm under a heading in mm"}.get(
            round(math.log10(ratio)), "another unit"
        )
    statement = (
        f"a lower leg measures {round_digits(length):g} m by the markers: it looks like {unit}; correct the unit of "
        "the markers"
    )
    return [Finding("marker-unit", place, statement)]


def find_exchanged_markers(leg: Mapping[str, Array], side: str, up: int, place: str) -> list[Finding]:
    """Return whether landmarks of the ``side`` leg are in the wrong order along the axis ``up``, or change places."""
    order = [name for name in ("ankle", "knee", "hip") if name in leg]
    heights = [float(np.nanmedian(leg[name][:, up])) for name in order]
    for (lower, low), (upper, high) in zip(
        zip(order, heights, strict=True), zip(order[1:], heights[1:], strict=True), strict=False
    ):
        if low > high + 0.03:
            statement = (
                f"the {side} {upper} is below the {side} {lower}: their markers are exchanged (or the axis does not "
                "point up); exchange their names"
            )
            return [Finding("marker-exchanged", place, statement)]
    for upper, lower in SEGMENT_RANGES:
        if upper not in leg or lower not in leg:
            continue
        lengths = np.linalg.norm(leg[upper] - leg[lower], axis=1)
        known = lengths[np.isfinite(lengths)]
        typical = float(np.median(known)) if known.size else 0.0
        is_other = np.abs(known - typical) > MAX_LENGTH_CHANGE * typical
        if known.size and float(is_other.mean()) > MIN_CHANGED_FRACTION:
            statement = (
                f"the distance from the {side} {upper} to the {side} {lower} changes from {typical:.2f} to "
                f"{float(known[is_other][0]):.2f} m in {100 * is_other.mean():.0f} % of the frames: markers change "
                "places or jump; repair their trajectories"
            )
            return [Finding("marker-exchanged", place, statement)]
    return []


def find_walking_direction(legs: Mapping[str, Mapping[str, Array]], rate: float, place: str) -> list[Finding]:
    """Return whether feet move backward, or right is left; landmarks (n, 3) are forward, up, right [m]."""
    skews = []
    for leg in legs.values():
        if "ankle" not in leg:
            continue
        speed = np.gradient(leg["ankle"][:, 0]) * rate
        known = speed[np.isfinite(speed)]
        if known.size > 20:
            low, middle, high = np.percentile(known, [2.0, 40.0, 98.0])
            skews.append(float((high - middle) - (middle - low)))
    if skews and max(skews) < -0.5:
        statement = (
            "the feet swing backward, from toe to heel: the markers of heel and toe are exchanged, the forward axis "
            "points backward, or time is reversed; correct the names or the axis"
        )
        return [Finding("forward-sign", place, statement)]
    if len(legs) == 2 and all("heel" in leg for leg in legs.values()):
        distance = float(np.nanmedian(legs["right"]["heel"][:, 2]) - np.nanmedian(legs["left"]["heel"][:, 2]))
        if distance < -MIN_SIDE_DISTANCE:
            statement = (
                f"the right heel is {-100 * distance:.0f} cm to the left of the left heel: the sides of the markers "
                "are exchanged; exchange right and left"
            )
            return [Finding("side-exchanged", place, statement)]
    return []


def find_stature(leg: Mapping[str, Array], stature: float, place: str) -> list[Finding]:
    """Return whether thigh and shank contradict the ``stature`` [m]."""
    if not {"hip", "knee", "ankle"} <= leg.keys():
        return []
    length = _measure_length(leg["hip"], leg["knee"]) + _measure_length(leg["knee"], leg["ankle"])
    low, high = LEG_PER_STATURE
    if low <= length / stature <= high:
        return []
    statement = (
        f"thigh and shank are {length:.2f} m long by the markers, {100 * length / stature:.0f} % of the stature of "
        f"{stature:g} m, {100 * low:.0f} to {100 * high:.0f} % are possible: correct the stature, or the unit of the "
        "markers"
    )
    return [Finding("stature-unit", place, statement)]


def _measure_length(first: Array, second: Array) -> float:
    distance = np.linalg.norm(first - second, axis=1)
    known = distance[np.isfinite(distance)]
    return float(np.median(known)) if known.size else 0.0
