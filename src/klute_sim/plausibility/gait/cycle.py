"""A gait reference: curves of one leg over a stride, loads per body mass."""

from collections.abc import Mapping
from itertools import combinations
from types import MappingProxyType

import numpy as np

from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.gait import loads, shapes
from klute_sim.plausibility.gait.angles import check_angle, measure_span
from klute_sim.plausibility.samples import Samples, compute_correlation, compute_negative_share, find_missing_value_code
from klute_sim.plausibility.units import round_digits
from klute_sim.types import Array

ANGLE_PARTS: Mapping[str, str] = MappingProxyType(
    {
        "hip_flexion_deg": "hip",
        "knee_flexion_deg": "knee",
        "ankle_dorsiflexion_deg": "ankle",
        "shank_forward_deg": "shank",
    }
)
"""Column of a reference -> part of the leg."""
MOMENT, POWER = "ankle_plantarflexor_moment_nm_per_kg", "ankle_power_w_per_kg"
VERTICAL, FORWARD = "grf_vertical_n_per_kg", "grf_forward_n_per_kg"
POSITIVE_DIRECTIONS: Mapping[str, str] = MappingProxyType(
    {
        "hip_flexion_deg": "flexion is positive, and the hip is flexed at heel strike",
        "knee_flexion_deg": "flexion is positive, and the knee flexes most in swing",
        "ankle_dorsiflexion_deg": "dorsiflexion is positive, and the ankle plantarflexes at push-off",
        "shank_forward_deg": "forward is positive, and the shank leans forward at toe-off",
        MOMENT: "plantarflexor is positive, and the moment in stance is plantarflexor",
        POWER: "generation is positive, and the ankle generates power at push-off",
        VERTICAL: "up is positive, and the ground pushes the foot up",
        FORWARD: "forward is positive, and the ground brakes first and then pushes forward",
    }
)
"""Column of a reference -> its sign and what shows it."""
MAX_OPPOSITE_CORRELATION = -0.5
"""Correlation with the typical curve below which a column has the opposite sign (assumed: unusual gait stays above
0)."""
MIN_SIGN_SPAN_DEG = 8.0
"""Smallest span of an angle whose sign can be seen [deg]."""
SIZE_RANGES: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        **dict.fromkeys(ANGLE_PARTS, (5.0, 170.0)),
        MOMENT: (0.12, 4.8),
        POWER: (0.05, 35.0),
        VERTICAL: (2.4, 50.0),
        FORWARD: (0.05, 12.0),
    }
)
"""Column of a reference -> plausible largest magnitude."""
MIN_EXCHANGE_GAIN = 0.6
"""Smallest gain in the sum of two correlations that shows exchanged columns (assumed)."""
MIN_EXCHANGED_CORRELATION = 0.5
"""Smallest correlation of a column with the typical curve of the other one."""
MAX_PELVIS_RANGE_DEG = 30.0
"""Largest range of shank - (knee - hip), the tilt of the pelvis [deg]."""
MIN_LAG_PCT, MIN_EXCHANGED_LAG_PCT = 15, 35
"""Lags between angles and load [% of the stride] that show different clocks, and different feet (assumed; unusual gait,
such as running, stays below 9)."""
MIN_LAG_SCORE = 0.8
"""Smallest similarity of the shifted angles to typical gait for a lag to be reported (assumed)."""
MIN_REVERSED_SCORE = 0.7
"""Smallest similarity of reversed curves to typical gait for a reversal to be reported (assumed)."""
MAX_START_ERROR_PCT = 8
"""Largest distance of the heel strike from the start of the stride [%] (assumed; filtered forces rise early)."""
MIN_REVERSAL_GAIN = 0.15
"""Smallest gain in correlation that shows reversed time."""


def find_cycle_findings(
    phase_pct: Array, columns: Mapping[str, Array], typical: Mapping[str, Array], place: str
) -> list[Finding]:
    """Return what is implausible in the ``columns`` of a reference at ``phase_pct`` [%].

    ``typical`` holds curves of able-bodied gait (:func:`shapes.resample_cycle`) of the same columns. Later checks are
    left out where an earlier finding explains them.
    """
    findings, columns = _find_missing(columns, place)
    curves = {name: shapes.resample_cycle(phase_pct, columns[name]) for name in typical if name in columns}
    lag = _find_lag(curves, shapes.find_contact(np.abs(curves[VERTICAL])), typical, place)
    if lag:
        return [*findings, *lag]
    exchanged = _find_exchanged(_warp(curves), typical, place)
    if exchanged:
        return [*findings, *exchanged]
    corrected: dict[str, Array] = {}
    for name, part in ANGLE_PARTS.items():
        checked = check_angle(part, name, columns[name], "deg", place)
        findings += checked.findings
        corrected[name] = shapes.resample_cycle(phase_pct, checked.degrees)
    findings += _find_load_units(columns, place)
    curves |= corrected
    if compute_negative_share(columns[VERTICAL]) > 0.6:
        findings.append(_describe_sign(VERTICAL, place))
        curves[VERTICAL] = -curves[VERTICAL]
    contact = shapes.find_contact(curves[VERTICAL])
    timing = _find_timing(curves, contact, typical, place)
    if timing:
        return [*findings, *timing]
    warped = _warp(curves)
    flagged = {finding.name for finding in findings}
    findings += _find_signs(warped, typical, {name for name in warped if f"{name}-zero" in flagged}, place)
    return findings


def _warp(curves: Mapping[str, Array]) -> dict[str, Array]:
    """Return ``curves`` with the toe-off of the typical ones, where the load shows one contact from the start."""
    contact = shapes.find_contact(curves[VERTICAL])
    has_start = len(contact.starts) == 1 and _measure_start_error(contact) <= MAX_START_ERROR_PCT
    toe_off = (contact.ends[0] - contact.starts[0]) % shapes.N_PHASES if has_start else 0
    return {name: shapes.warp_to_typical(curve, toe_off) for name, curve in curves.items()}


def _measure_start_error(contact: shapes.ContactIntervals) -> int:
    """Return the distance of the foot strike from the start of the stride [%]."""
    return min(contact.starts[0], shapes.N_PHASES - contact.starts[0])


def _find_missing(columns: Mapping[str, Array], place: str) -> tuple[list[Finding], dict[str, Array]]:
    findings, cleaned = [], dict(columns)
    for name, values in columns.items():
        code = find_missing_value_code(Samples(name, values, "", 1.0))
        if code is not None:
            statement = (
                f"`{name}` is {code.code:g} in {code.n_samples} row{'' if code.n_samples == 1 else 's'}: it looks like "
                "a code for a missing value; interpolate those rows or leave them out"
            )
            findings.append(Finding(f"{name}-missing", place, statement))
            known = ~np.isclose(values, code.code)
            cleaned[name] = np.interp(np.arange(len(values)), np.flatnonzero(known), values[known])
    return findings, cleaned


def _find_exchanged(curves: Mapping[str, Array], typical: Mapping[str, Array], place: str) -> list[Finding]:
    """Return the pair of columns that resemble each other's typical curve, while the other columns are ordinary."""
    correlations = shapes.correlate(curves, typical)
    best, pair = 0.0, ("", "")
    for first, second in combinations(curves, 2):
        crossed = correlations[first, second], correlations[second, first]
        gain = sum(crossed) - correlations[first, first] - correlations[second, second]
        others = [correlations[name, name] for name in curves if name not in (first, second)]
        if np.median(others) < MIN_EXCHANGED_CORRELATION or min(crossed) < MIN_EXCHANGED_CORRELATION:
            continue
        swapped = {**curves, first: curves[second], second: curves[first]}
        if gain > max(best, _get_min_gain(first, second, curves, swapped)):
            best, pair = gain, (first, second)
    if not best:
        return []
    statement = (
        f"`{pair[0]}` has the shape of `{pair[1]}` and the reverse: the columns look exchanged; exchange their headings"
    )
    return [Finding(f"{pair[0]}-exchanged", place, statement)]


def _get_min_gain(first: str, second: str, curves: Mapping[str, Array], swapped: Mapping[str, Array]) -> float:
    """Return the gain in correlation that shows an exchange; it is small where other evidence supports the exchange."""
    names = {first, second}
    if names <= {"hip_flexion_deg", "knee_flexion_deg", "shank_forward_deg"} and "knee_flexion_deg" in names:
        is_resolved = _measure_pelvis_range(curves) > MAX_PELVIS_RANGE_DEG > _measure_pelvis_range(swapped)
        return 0.25 if is_resolved else np.inf
    sizes = [[float(np.abs(c[name]).max()) for name in (first, second)] for c in (curves, swapped)]
    is_plausible = [
        [SIZE_RANGES[name][0] <= size <= SIZE_RANGES[name][1] for name, size in zip((first, second), pair, strict=True)]
        for pair in sizes
    ]
    if not any(is_plausible[0]) and all(is_plausible[1]):
        return 0.3
    if names & {MOMENT, POWER}:
        as_is, exchanged = (_correlate_power(c) for c in (curves, swapped))
        if exchanged > 0.9 and exchanged > as_is + 0.15:
            return 0.2
    return MIN_EXCHANGE_GAIN


def _correlate_power(curves: Mapping[str, Array]) -> float:
    """Return the correlation of the power with moment times velocity."""
    velocity = -np.gradient(curves["ankle_dorsiflexion_deg"])
    return compute_correlation(curves[POWER], curves[MOMENT] * velocity)


def _measure_pelvis_range(curves: Mapping[str, Array]) -> float:
    tilt = curves["shank_forward_deg"] - curves["knee_flexion_deg"] + curves["hip_flexion_deg"]
    return float(np.ptp(tilt))


def _find_load_units(columns: Mapping[str, Array], place: str) -> list[Finding]:
    peaks = {name: loads.measure_peak(columns[name]) for name in (VERTICAL, FORWARD, MOMENT, POWER)}
    guesses = {
        VERTICAL: loads.guess_force_unit_per_mass(peaks[VERTICAL]),
        MOMENT: loads.guess_moment_unit_per_mass(peaks[MOMENT]),
        POWER: loads.guess_power_unit_per_mass(peaks[POWER]),
    }
    units = {VERTICAL: "N/kg", FORWARD: "N/kg", MOMENT: "N·m/kg", POWER: "W/kg"}
    if peaks[VERTICAL] > 0.0:
        ratio = peaks[FORWARD] / peaks[VERTICAL]
        low, high = loads.RATIO_RANGE
        if guesses[VERTICAL] and low < ratio < high:
            guesses[FORWARD] = "the same unit as `grf_vertical_n_per_kg`"
        elif ratio > high and not guesses[VERTICAL]:
            guesses[FORWARD] = (
                "N, not divided by the body mass" if ratio > 6.0 else "lbf or per cent of body weight (%BW)"
            )
        elif ratio < low and not guesses[VERTICAL]:
            guesses[FORWARD] = "body weights (BW) or kN"
    findings = []
    for name, guess in guesses.items():
        if guess:
            statement = (
                f"`{name}` peaks at {round_digits(peaks[name]):g}, which is not plausible in {units[name]}: it looks "
                f"like {guess}; convert it to {units[name]}"
            )
            findings.append(Finding(f"{name}-unit", place, statement))
    return findings


def _find_lag(
    curves: Mapping[str, Array], contact: shapes.ContactIntervals, typical: Mapping[str, Array], place: str
) -> list[Finding]:
    """Return the finding on angles that are half a stride away from the load, or clearly earlier or later than it."""
    if len(contact.starts) != 1:
        return []
    lag, score = _measure_lag(curves, contact, typical)
    if score >= MIN_LAG_SCORE and abs(lag) >= MIN_EXCHANGED_LAG_PCT:
        statement = (
            f"the angles lag the load by {lag % shapes.N_PHASES} % of the stride: angles and load are of different "
            "feet (right and left exchanged)"
        )
        return [Finding("side-exchanged", place, statement)]
    lag, score = _measure_lag(_warp(curves), contact, typical)  # a short stance, as in running, is no lag
    if score < MIN_LAG_SCORE or abs(lag) < MIN_LAG_PCT or _is_reversed(curves, typical):
        return []
    statement = (
        f"the angles are {abs(lag)} % of the stride {'later' if lag > 0 else 'earlier'} than the load: they have "
        "different clocks, or are of different trials; shift one of them (in an import: [clock] in a file for --map)"
    )
    return [Finding("time-offset", place, statement)]


def _measure_lag(
    curves: Mapping[str, Array], contact: shapes.ContactIntervals, typical: Mapping[str, Array]
) -> tuple[int, float]:
    """Return by how much the angles are later than the load [% of the stride], and their similarity to typical gait."""
    motion = {name: curves[name] for name in ("knee_flexion_deg", "shank_forward_deg", "hip_flexion_deg")}
    shift, score = shapes.find_best_shift(motion, typical)
    half = shapes.N_PHASES // 2
    return (shift - contact.starts[0] + half) % shapes.N_PHASES - half, score


def _is_reversed(curves: Mapping[str, Array], typical: Mapping[str, Array]) -> bool:
    """Return whether the curves resemble gait that runs backward."""
    names = ("knee_flexion_deg", "shank_forward_deg", "ankle_dorsiflexion_deg", MOMENT, VERTICAL)
    selected = {name: curves[name] for name in names}
    _, score = shapes.find_best_shift(selected, typical)
    _, reversed_score = shapes.find_best_shift(selected, typical, reverse=True)
    return reversed_score > max(score + MIN_REVERSAL_GAIN, MIN_REVERSED_SCORE)


def _find_timing(
    curves: Mapping[str, Array], contact: shapes.ContactIntervals, typical: Mapping[str, Array], place: str
) -> list[Finding]:
    """Return whether the stride is reversed, incomplete or doubled, or begins late."""
    shank = curves["shank_forward_deg"]
    if len(contact.starts) > 1:
        statement = (
            f"the foot is loaded {len(contact.starts)} times: the rows hold more than one stride; cut it from heel "
            "strike to the next heel strike of the same foot"
        )
        return [Finding("stride-length", place, statement)]
    is_stance = contact.loaded_pct > 86 or (contact.loaded_pct > 80 and abs(shank[-1] - shank[0]) > 35.0)
    ends = np.abs(curves[VERTICAL][[0, -1]]).max() / np.max(np.abs(curves[VERTICAL]))
    difference = abs(float(shank[-1] - shank[0]))
    if is_stance and ends < 0.6 and difference > 25.0:
        statement = (
            f"the foot is loaded for {contact.loaded_pct} % of the rows and the shank ends {difference:.0f} degrees"
            " from where it starts: the file holds only the stance; add the swing, up to the next heel strike"
        )
        return [Finding("stride-length", place, statement)]
    if _is_reversed(curves, typical):
        statement = (
            "all curves resemble gait that runs backward: time is reversed; reverse the order of the rows below "
            "`gait_pct`"
        )
        return [Finding("time-reversed", place, statement)]
    if not contact.starts:
        return []
    start = contact.starts[0]
    if _measure_start_error(contact) > MAX_START_ERROR_PCT:
        statement = (
            f"the foot strikes the ground at {start} %: the stride does not begin with the heel strike; cut it from "
            "heel strike to heel strike"
        )
        return [Finding("stride-start", place, statement)]
    return []


def _find_signs(
    curves: Mapping[str, Array], typical: Mapping[str, Array], shifted: set[str], place: str
) -> list[Finding]:
    findings = []
    for name, curve in curves.items():
        if name in shifted or name == VERTICAL:
            continue
        if name in ANGLE_PARTS and measure_span(curve) < MIN_SIGN_SPAN_DEG:
            continue
        if compute_correlation(curve, typical[name]) < MAX_OPPOSITE_CORRELATION:
            findings.append(_describe_sign(name, place))
    is_power_opposite = _correlate_power(curves) < -0.7 and compute_correlation(curves[POWER], typical[POWER]) < 0.0
    if is_power_opposite and not findings and not shifted:
        findings.append(_describe_sign(POWER, place))
    return findings


def _describe_sign(name: str, place: str) -> Finding:
    statement = f"`{name}` has the opposite sign: {POSITIVE_DIRECTIONS[name]}; multiply it by -1"
    return Finding(f"{name}-sign", place, statement)
