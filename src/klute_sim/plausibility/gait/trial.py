"""A recorded gait trial with a prosthesis: motion and load of one foot, ankle angle and moment."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from klute_sim.mask_runs import find_runs
from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.gait import consistency, loads, positions
from klute_sim.plausibility.gait.angles import DEGREES_PER_RADIAN, check_angle, measure_span
from klute_sim.plausibility.gait.positions import ScaledSeries
from klute_sim.plausibility.gait.steps import Series, Step, average_cycle, find_steps, measure_stride_time
from klute_sim.plausibility.samples import (
    Samples,
    compute_negative_share,
    find_missing_value_code,
    find_zero_blocks,
)
from klute_sim.plausibility.spikes import check_position
from klute_sim.plausibility.units import UNITS, round_digits
from klute_sim.types import Array, Mask

STRIDE_TIME_RANGE = (0.38, 4.0)
"""Range of stride times [s]: a sprinting child, and the first steps with a prosthesis."""
MIN_ZERO_SAMPLES = 3
"""Smallest number of samples of exactly zero in a row that are missing samples."""
VARYING_CHANNELS = ("shank_angle", "ankle_x", "ankle_z", "ankle_angle")
"""Channels that are never constant in gait."""


GAIT_CHANNELS = (
    *("shank_angle", "ankle_x", "ankle_z", "grf_vertical", "grf_forward", "cop_x"),
    *("ankle_angle", "ankle_moment"),
)
"""Channels of motion and load: six that every trial has, and two that it may have."""
MAX_POUNDS = 330.0
"""Peak vertical force of a heavy walker in lbf."""


class GaitChannels(NamedTuple):
    """Channels of a trial, and the time unit as read."""

    place: str
    """Trial, such as ``trial 'a'``."""
    channels: Mapping[str, ScaledSeries]
    """Name of :data:`GAIT_CHANNELS` -> samples in SI units."""


def find_trial_findings(trial: GaitChannels) -> list[Finding]:
    """Return what is implausible in ``trial``; later checks are left out where an earlier finding explains them."""
    place = trial.place
    exchanged = _find_exchanged_cop(trial.channels, place)
    if exchanged:
        return exchanged
    findings, channels = _find_missing(trial)
    exchanged = _find_exchanged_forces(channels, place)
    if exchanged:
        return [*findings, *exchanged]
    findings += _find_load_units(channels, place)
    vertical = channels["grf_vertical"]
    if compute_negative_share(vertical.series.value) > 0.6:
        statement = "`grf_vertical` points down: it is the force on the body, up positive; multiply it by -1"
        findings.append(Finding("grf_vertical-sign", place, statement))
        channels["grf_vertical"] = vertical.multiply(-1.0)
    steps = find_steps(channels["grf_vertical"].series)
    if not steps:
        return findings
    timing, factor = find_time_unit(channels["grf_vertical"].series.time, steps, place)
    findings += timing
    if timing and not factor:
        return findings
    if factor:
        channels = {
            name: channel._replace(series=Series(channel.series.time * factor, channel.series.value))
            for name, channel in channels.items()
        }
        steps = find_steps(channels["grf_vertical"].series)
    has_load_fault = any(finding.name.startswith(("grf", "ankle_moment")) for finding in findings)
    findings += _find_motion(channels, steps, place, has_load_fault)
    return findings


def _find_missing(trial: GaitChannels) -> tuple[list[Finding], dict[str, ScaledSeries]]:
    """Return the findings on missing samples, and the channels with these samples interpolated."""
    findings, channels = [], dict(trial.channels)
    for name, channel in trial.channels.items():
        values = channel.series.value
        code = find_missing_value_code(Samples(name, values, channel.unit, channel.factor))
        is_missing = np.zeros(len(values), dtype=np.bool_)
        if code is not None:
            is_missing = np.isclose(values / channel.factor, code.code)
            text = f"{code.code:g} in {code.n_samples} sample{'' if code.n_samples == 1 else 's'}"
        elif name in VARYING_CHANNELS:
            is_missing = _find_zero_samples(values)
            text = f"exactly 0 in {int(is_missing.sum())} samples, far from its other samples"
            if not is_missing.any():
                spikes, is_spike = _find_spikes(channel, trial.place)
                findings += spikes
                channels[name] = _interpolate(channel, is_spike)
        if is_missing.any() and not is_missing.all():
            statement = f"`{name}` is {text}: it looks like a code for missing samples; leave these cells empty or out"
            findings.append(Finding(f"{name}-missing", trial.place, statement))
            channels[name] = _interpolate(channel, is_missing)
    return findings, channels


def _interpolate(channel: ScaledSeries, is_wrong: Mask) -> ScaledSeries:
    """Return ``channel`` with the samples ``is_wrong`` interpolated."""
    time, values = channel.series
    filled = np.interp(time, time[~is_wrong], values[~is_wrong])
    return channel._replace(series=Series(time, np.where(is_wrong, filled, values)))


def _find_spikes(channel: ScaledSeries, place: str) -> tuple[list[Finding], Mask]:
    """Return a finding for single wrong samples of a position or an angle, and which samples these are."""
    samples = Samples(channel.channel, channel.series.value, channel.unit, channel.factor)
    return check_position(samples, channel.series.time, "rad" if channel.channel.endswith("angle") else "m", place)


def _find_zero_samples(values: Array) -> Mask:
    """Return which samples lie in runs of zeros that the signal enters or leaves by a jump."""
    is_zero = find_zero_blocks(values, MIN_ZERO_SAMPLES)
    span = measure_span(values[~is_zero]) if (~is_zero).any() else 0.0
    steps = np.abs(np.diff(values, append=values[-1:]))
    jumps = steps > max(0.02 * span, 5.0 * float(np.percentile(steps, 95.0)))
    result = np.zeros(len(values), dtype=np.bool_)
    for start, stop in find_runs(is_zero):
        result[start:stop] = (start > 0 and jumps[start - 1]) or (stop < len(values) and jumps[stop - 1])
    return result


def _find_exchanged_cop(channels: Mapping[str, ScaledSeries], place: str) -> list[Finding]:
    """Return whether only the ankle is without samples where the foot is not loaded."""
    ankle, cop = (channels[name].series.value for name in ("ankle_x", "cop_x"))
    is_cop_known = float(np.mean(np.isfinite(cop) & (cop != 0.0))) > 0.95
    if not is_cop_known or float(np.mean(ankle == 0.0)) < 0.15:
        return []
    statement = (
        "`ankle_x` is 0 for a part of every stride and `cop_x` never is: only the centre of pressure is unknown in "
        "swing, so the columns look exchanged; exchange their headings"
    )
    return [Finding("ankle_x-exchanged", place, statement)]


def _find_exchanged_forces(channels: Mapping[str, ScaledSeries], place: str) -> list[Finding]:
    vertical, forward = (channels[name].series.value for name in ("grf_vertical", "grf_forward"))
    share = compute_negative_share(forward)
    is_one_sided = min(share, 1.0 - share) < 0.1
    if loads.measure_peak(forward) < 1.5 * loads.measure_peak(vertical) or not is_one_sided:
        return []
    statement = (
        "`grf_forward` is the larger force and has one sign, `grf_vertical` is the smaller one: the columns look "
        "exchanged; exchange their headings"
    )
    return [Finding("grf_vertical-exchanged", place, statement)]


def _find_load_units(channels: Mapping[str, ScaledSeries], place: str) -> list[Finding]:
    vertical, forward = channels["grf_vertical"], channels["grf_forward"]
    peak, forward_peak = (loads.measure_peak(channel.series.value) for channel in (vertical, forward))
    guess, findings = loads.guess_force_unit(peak), []
    low, high = loads.RATIO_RANGE
    ratio = forward_peak / peak if peak > 0.0 else 0.0
    if guess:
        findings.append(_describe_unit(vertical, peak, guess, place))
        if low < ratio < high:
            findings.append(_describe_unit(forward, forward_peak, "the same unit as `grf_vertical`", place))
    elif ratio > high and peak < MAX_POUNDS:
        findings.append(_describe_unit(vertical, peak, "lbf (`grf_forward` is too large for it)", place))
    elif ratio > high:
        findings.append(_describe_unit(forward, forward_peak, "a smaller unit than that of `grf_vertical`", place))
    elif 0.0 < ratio < low:
        findings.append(_describe_unit(forward, forward_peak, "kN, body weights, lbf or per cent of them", place))
    moment = channels.get("ankle_moment")
    if moment is not None:
        peak = loads.measure_peak(moment.series.value)
        guess = loads.guess_moment_unit(peak)
        if guess and peak > 0.0:
            findings.append(_describe_unit(moment, peak, guess, place))
    return findings


def _describe_unit(channel: ScaledSeries, peak: float, guess: str, place: str) -> Finding:
    statement = (
        f"`{channel.channel}` peaks at {round_digits(peak / channel.factor):g} {channel.unit}, which is not plausible: "
        f"it looks like {guess}; correct the unit in its heading or convert it"
    )
    return Finding(f"{channel.channel}-unit", place, statement)


def find_time_unit(time: Array, steps: list[Step], place: str) -> tuple[list[Finding], float]:
    """Return the finding on the unit of ``time`` [s as read], and the factor to seconds; 0 where none is needed."""
    stride_time = measure_stride_time(steps)
    low, high = STRIDE_TIME_RANGE
    if low <= stride_time <= high:
        return [], 0.0
    intervals = np.diff(time)
    is_counted = bool(np.allclose(intervals, 1.0, rtol=1e-6))
    guesses = [(unit, factor) for unit, factor in UNITS["s"].items() if low <= stride_time * factor <= high]
    guesses += [("frames, per cent or hundredths of a second", 0.01)] if low <= 0.01 * stride_time <= high else []
    guess, factor = guesses[0] if guesses else ("a wrong unit", 0.0)
    if abs(float(time[0])) < 1.0 and abs(float(time[-1]) - 100.0) < 1.5:
        guess, factor = "per cent of the recording", 1.1 / stride_time
    if is_counted:
        guess = "sample numbers (frames)" if guess != "ms" else "ms or sample numbers (frames)"
        factor = factor or 1.0 / stride_time
    statement = (
        f"`time` gives strides of {round_digits(stride_time):g} s, people need {low:g} to {high:g} s: it looks like "
        f"{guess}; correct the unit in its heading"
    )
    return [Finding("time-unit", place, statement)], factor


def _find_motion(
    channels: dict[str, ScaledSeries], steps: list[Step], place: str, has_load_fault: bool
) -> list[Finding]:
    findings: list[Finding] = []
    x, z = channels["ankle_x"], channels["ankle_z"]
    exchanged = positions.find_exchanged_axes(x, z, steps, place) + _find_exchanged_angles(channels, steps, place)
    if exchanged:
        return exchanged
    for name, part in (("shank_angle", "shank"), ("ankle_angle", "ankle")):
        if name in channels:
            channel = channels[name]
            unit = "rad" if channel.factor == 1.0 else "deg"
            checked = check_angle(part, name, channel.series.value * DEGREES_PER_RADIAN, unit, place)
            findings += checked.findings
            corrected = checked.degrees / DEGREES_PER_RADIAN
            channels[name] = channel._replace(series=Series(channel.series.time, corrected))
    findings += _check_position_units(channels, steps, place)
    motion = positions.measure_motion(channels["ankle_x"].series, channels["ankle_z"].series, steps)
    cop_findings, progression = positions.check_cop(
        channels["cop_x"], channels["ankle_x"].series, channels["grf_vertical"].series, steps, place
    )
    flagged = {finding.name.rsplit("-", 1)[0] for finding in findings}
    directions = _find_directions(channels, steps, motion, progression, flagged, place)
    blocking = [finding for finding in directions if finding.name.startswith(("time", "side", "forward"))]
    if blocking:
        return [*findings, *blocking]
    has_x_fault = any(finding.name.startswith("ankle_x") for finding in directions)
    if not flagged & {"ankle_z"}:
        findings += positions.check_height(channels["ankle_z"], steps, place)
    findings += directions
    findings += [] if has_x_fault else cop_findings
    if "ankle_angle" in channels and not flagged & {"ankle_angle", "shank_angle"}:
        has_opposite_shank = any(finding.name.startswith("shank_angle") for finding in directions)
        findings += [] if has_opposite_shank else consistency.check_ankle_sign(channels, steps, place)
    has_moment_arm = not cop_findings and not has_x_fault and not flagged & {"ankle_z", "ankle_x"}
    if "ankle_moment" in channels and has_moment_arm and not has_load_fault:
        findings += consistency.check_moment(channels, steps, place)
    if not has_load_fault and not any(finding.name.startswith(("grf", "shank", "ankle_x")) for finding in findings):
        findings += consistency.check_load_against_size(channels, steps, motion, place)
    return findings


def _find_exchanged_angles(channels: Mapping[str, ScaledSeries], steps: list[Step], place: str) -> list[Finding]:
    """Return whether shank and ankle angle are exchanged: only the shank swings forward from strike to toe-off."""
    if "ankle_angle" not in channels:
        return []
    changes, spans = [], []
    for name in ("shank_angle", "ankle_angle"):
        curve = average_cycle(channels[name].series, steps)
        changes.append(float(curve[60] - curve[2]))
        spans.append(measure_span(curve))
    if changes[0] > 0.3 * spans[0] or changes[1] < 0.6 * spans[1] or spans[1] < 1.3 * spans[0]:
        return []
    statement = (
        "`ankle_angle` turns like a shank and `shank_angle` like an ankle: the columns look exchanged; exchange their "
        "headings"
    )
    return [Finding("shank_angle-exchanged", place, statement)]


def _check_position_units(channels: dict[str, ScaledSeries], steps: list[Step], place: str) -> list[Finding]:
    """Return the findings on the units of the ankle's position, and correct these in ``channels``."""
    findings: list[Finding] = []
    x, z = channels["ankle_x"], channels["ankle_z"]
    motion = positions.measure_motion(x.series, z.series, steps)
    stance_share = float(np.mean([(s.toe_off - s.strike) / (s.next_strike - s.strike) for s in steps]))
    speed = consistency.estimate_walking_speed(channels, steps) / max(1.0 - stance_share, 0.15)
    for name, size, plausible, meaning in (
        ("ankle_x", motion.swing_speed, positions.SPEED_RANGE._replace(typical=speed), "per second the ankle travels"),
        ("ankle_z", motion.rise, positions.RISE_RANGE, "in swing the ankle rises by"),
    ):
        unit_findings, guess = positions.check_unit(channels[name], size, plausible, meaning, place)
        if guess:
            channels[name] = channels[name].multiply(UNITS["m"][guess] / channels[name].factor)
        findings += unit_findings
    if not findings and stance_share > 0.54 and motion.walking_speed > positions.MAX_WALKING_SPEED:
        statement = (
            f"`ankle_x` in [{x.unit}]: the foot walks at {motion.walking_speed:.1f} m/s, but stands for "
            f"{100 * stance_share:.0f} % of the stride: it looks like ft; correct the unit in its heading"
        )
        findings.append(Finding("ankle_x-unit", place, statement))
        channels["ankle_x"] = x.multiply(UNITS["m"]["ft"] / x.factor)
    return findings


def _find_directions(
    channels: Mapping[str, ScaledSeries],
    steps: list[Step],
    motion: positions.Motion,
    progression: float,
    flagged: set[str],
    place: str,
) -> list[Finding]:
    """Return the findings on signs, reversed time and the foot of the load."""
    shank = average_cycle(channels["shank_angle"].series, steps)
    forward = average_cycle(channels["grf_forward"].series, steps)
    push = float(np.nanmean(forward[40:60]) - np.nanmean(forward[2:24]))
    shank_change, shank_span = float(shank[60] - shank[2]), measure_span(shank)
    opposite = {
        "shank_angle": shank_change < -0.3 * shank_span,
        "ankle_x": motion.swing_speed < -positions.SPEED_RANGE.low,
        "grf_forward": push < -0.25 * measure_span(forward),
        "cop_x": bool(progression < positions.MAX_COP_PROGRESSION),
    }
    opposite = {name: is_opposite for name, is_opposite in opposite.items() if name not in flagged or name == "ankle_x"}
    is_lifted_under_load = motion.rise < -2.0 * positions.RISE_RANGE.low
    if is_lifted_under_load and opposite["ankle_x"]:
        statement = (
            "the foot travels and rises while it is loaded, and rests without load: motion and load are of different "
            "feet (right and left exchanged), or their clocks differ"
        )
        return [Finding("side-exchanged", place, statement)]
    if sum(opposite.values()) >= 3:
        if motion.height_difference < 0.0:
            statement = "everything runs backward, from toe-off to foot strike: time is reversed; reverse the samples"
            return [Finding("time-reversed", place, statement)]
        statement = (
            f"{', '.join(f'`{name}`' for name, value in opposite.items() if value)} have the opposite sign: the "
            "forward axis points backward; multiply them by -1"
        )
        return [Finding("forward-sign", place, statement)]
    reasons = {
        "shank_angle": "forward is positive, and the shank leans forward at toe-off",
        "ankle_x": "forward is positive, and the foot moves forward in swing",
        "grf_forward": "forward is positive, and the ground brakes first and then pushes forward",
        "cop_x": "forward is positive, and the centre of pressure moves from heel to toe",
    }
    findings = [
        Finding(f"{name}-sign", place, f"`{name}` has the opposite sign: {reasons[name]}; multiply it by -1")
        for name, is_opposite in opposite.items()
        if is_opposite
    ]
    if abs(motion.swing_speed) < positions.SPEED_RANGE.low and "ankle_x" not in flagged:
        statement = (
            f"`ankle_x` hardly moves in swing ({round_digits(motion.swing_speed):g} m/s relative to stance): it looks "
            "like the sideways axis; give the forward axis"
        )
        findings.append(Finding("ankle_x-axis", place, statement))
    if is_lifted_under_load and "ankle_z" not in flagged:
        statement = "`ankle_z` is lower in swing than in stance: up is positive; multiply it by -1"
        findings.append(Finding("ankle_z-sign", place, statement))
    elif motion.rise < positions.RISE_RANGE.low and "ankle_z" not in flagged:
        statement = (
            f"`ankle_z` rises by {1e3 * motion.rise:.0f} mm in swing: it looks like the sideways axis; give the height"
        )
        findings.append(Finding("ankle_z-axis", place, statement))
    return findings
