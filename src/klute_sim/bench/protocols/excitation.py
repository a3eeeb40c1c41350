"""Excitation signals for system identification: length and pressure commands that reveal effects of a device.

Every excitation starts at rest, moves with finite acceleration and keeps the unit no longer than the slack length of
its tendon plus the resting length of its muscle, so that the muscle never reaches its stop.
"""

from collections.abc import Callable
from typing import NamedTuple, Self

import numpy as np

from klute_sim.bench.trajectory import LengthTrajectory
from klute_sim.device.device import Device
from klute_sim.errors import InputError
from klute_sim.laws.mckibben import lock_length
from klute_sim.units import BAR

MAX_SPEED = 0.3
"""Speed of a quick release [m/s]."""
FAST_ACCELERATION, SLOW_ACCELERATION = 10.0, 3.0
"""Accelerations of quick moves and of all other moves [m/s^2]."""
STROKE_RATIO = 0.12
"""Stroke over the resting length of the muscle, for a unit with a tendon."""
CLAMPED_STROKE_RATIO = 0.08
"""Stroke over the resting length of a bare muscle; it pushes on its clamps at short lengths and low pressures."""
CLAMPED_MAX_LENGTH_RATIO = 0.99
"""Maximum length of a bare muscle over its resting length; the margin covers the position error of the tester."""
MAX_STROKE = 0.035
"""Maximum stroke of all excitations [m]."""
TENDON_STRETCH_RATIO, DEFAULT_TENDON_STRETCH = 2.0, 0.01
"""Largest stretch of a tendon alone, over the stretch at which its second spring engages, and [m] where the second
spring engages at once (assumed: both springs pull in half of the stroke)."""
MIN_STROKE = 0.001
"""Minimum stroke of all excitations [m]; a shorter stroke reveals nothing."""

PressureSteps = tuple[tuple[float, float], ...]
"""Steps of the pressure command: start time [s] and gauge pressure [Pa] of each."""


class OperatingLimits(NamedTuple):
    """Range of a device's commands."""

    min_length: float
    """Minimum unit length [m]."""
    max_length: float
    """Maximum unit length [m]."""
    residual_pressure: float
    """Gauge pressure [Pa] at which the muscle is barely inflated."""
    low_pressure: float
    """Gauge pressure [Pa] below 2 bar."""
    medium_pressure: float
    """Gauge pressure [Pa] of about half of the supply's."""
    high_pressure: float
    """Maximum gauge pressure [Pa]; it leaves the regulator a margin."""

    def length_at(self, fraction: float) -> float:
        """Return the unit length [m] at ``fraction`` of the stroke: 0 is short, 1 is long."""
        return self.min_length + fraction * (self.max_length - self.min_length)


def compute_limits(device: Device) -> OperatingLimits:
    """Return the operating limits of ``device``; raise InputError when its muscle can hardly contract.

    A cylinder moves as a muscle would, and a tendon alone is stretched.
    """
    muscle, tendon = device.parameters.muscle, device.parameters.tendon
    supply_pressure = device.parameters.supply.max_pressure
    resting_length = muscle.resting_length
    if resting_length == 0.0 and not tendon.is_rigid:
        stretch = min(TENDON_STRETCH_RATIO * tendon.engagement_stretch or DEFAULT_TENDON_STRETCH, MAX_STROKE)
        return OperatingLimits(tendon.slack_length, tendon.slack_length + stretch, 0.0, 0.0, 0.0, 0.0)
    stroke_ratio = CLAMPED_STROKE_RATIO if tendon.is_rigid else STROKE_RATIO
    stroke = min(stroke_ratio * resting_length, 0.4 * (resting_length - lock_length(muscle)), MAX_STROKE)
    if stroke < MIN_STROKE:
        has_muscle = device.spec.muscle is not None
        stop, longest = ("its muscle locks", "resting length") if has_muscle else ("its stop is", "extended length")
        raise InputError(
            f"device '{device.name}' cannot be tested: {stop} "
            f"{1e3 * (resting_length - lock_length(muscle)):.2g} mm below its {longest}; allowed: "
            f"{1e3 * MIN_STROKE / 0.4:.2g} mm or more"
        )
    max_length = tendon.slack_length + (CLAMPED_MAX_LENGTH_RATIO if tendon.is_rigid else 1.0) * resting_length
    return OperatingLimits(
        min_length=max_length - stroke,
        max_length=max_length,
        residual_pressure=min(0.3 * BAR, 0.06 * supply_pressure),
        low_pressure=min(1.2 * BAR, 0.25 * supply_pressure),
        medium_pressure=0.56 * supply_pressure,
        high_pressure=0.9 * supply_pressure,
    )


class ExcitationTrajectory(LengthTrajectory):
    """Commanded unit length of an excitation."""

    def move(self, target_length: float, speed: float, acceleration: float = SLOW_ACCELERATION) -> Self:
        """Append a move to ``target_length`` [m], slow unless ``acceleration`` [m/s^2] is given."""
        return super().move(target_length, speed, acceleration)

    def add_sine(self, stroke: float, frequency: float, n_periods: int) -> Self:
        """Append ``n_periods`` of a sine of ``frequency`` [Hz] that shortens the unit by ``stroke`` [m].

        The stroke is smaller where the maximum speed or acceleration requires it.
        """
        start, angular_frequency = self.end_length, 2.0 * np.pi * frequency
        amplitude = min(0.5 * stroke, MAX_SPEED / angular_frequency, FAST_ACCELERATION / angular_frequency**2)
        return self.append_segment(
            n_periods / frequency, lambda t: start - amplitude * (1.0 - np.cos(angular_frequency * t)), start
        )


class Excitation(NamedTuple):
    """Commands of one identification trial."""

    trajectory: ExcitationTrajectory
    """Commanded unit length."""
    pressure_steps: PressureSteps
    """Steps of the pressure command; the first starts at 0 s."""


def create_pressure_steps(at: OperatingLimits, rest_time: float) -> Excitation:
    """Return pressure steps at three lengths."""
    order = (at.high_pressure, at.low_pressure, at.medium_pressure, at.residual_pressure, at.medium_pressure)
    length, steps = ExcitationTrajectory(at.length_at(1.0), rest_time), [(0.0, at.medium_pressure)]
    for fraction in (1.0, 0.15, 0.55):
        length.move(at.length_at(fraction), 0.08).hold(0.02)
        steps += [(length.end_time + 0.4 * k, level) for k, level in enumerate(order)]
        length.hold(0.4 * len(order))
    return Excitation(length, tuple(steps))


def create_ramps(at: OperatingLimits, rest_time: float) -> Excitation:
    """Return slow and fast length ramps in both directions at four pressures."""
    length, steps = ExcitationTrajectory(at.max_length, rest_time), [(0.0, at.medium_pressure)]
    slow = (at.max_length - at.min_length) / 1.2
    for pressure, speed in (
        (at.medium_pressure, slow),
        (at.high_pressure, 0.15),
        (at.low_pressure, 0.06),
        (at.high_pressure, 0.04),
        (at.medium_pressure, 0.2),
    ):
        steps.append((length.end_time, pressure))
        length.hold(0.2).move(at.length_at(0.1), speed).hold(0.1).move(at.max_length, speed)
    return Excitation(length.hold(0.1), tuple(steps))


def create_sines(at: OperatingLimits, rest_time: float) -> Excitation:
    """Return length sines from 0.5 to 5 Hz, each at two pressures or more."""
    length, steps = ExcitationTrajectory(at.length_at(0.97), rest_time), [(0.0, at.medium_pressure)]
    for frequency, n_periods, pressures in (
        (0.5, 1, (at.medium_pressure, at.high_pressure)),
        (1.25, 2, (at.low_pressure, at.high_pressure)),
        (2.5, 4, (at.medium_pressure, at.low_pressure, at.high_pressure)),
        (5.0, 6, (at.high_pressure, at.medium_pressure)),
    ):
        start, duration = length.end_time, n_periods / frequency / len(pressures)
        steps += [(start + duration * k, pressure) for k, pressure in enumerate(pressures)]
        length.add_sine(0.9 * (at.max_length - at.min_length), frequency, n_periods)
    return Excitation(length.hold(0.2), tuple(steps))


def create_quick_releases(at: OperatingLimits, rest_time: float) -> Excitation:
    """Return quick releases and quick stretches at three pressures."""
    length, steps = ExcitationTrajectory(at.max_length, rest_time), [(0.0, at.high_pressure)]
    for pressure, fraction in (
        (at.high_pressure, 0.55),
        (at.medium_pressure, 0.15),
        (at.low_pressure, 0.35),
        (at.high_pressure, 0.05),
    ):
        steps.append((length.end_time, pressure))
        length.hold(0.35).move(at.length_at(fraction), MAX_SPEED, FAST_ACCELERATION)
        length.hold(0.4).move(at.max_length, MAX_SPEED, FAST_ACCELERATION).hold(0.3)
    return Excitation(length, tuple(steps))


def create_holds(at: OperatingLimits, rest_time: float) -> Excitation:
    """Return a length step, a pressure step and a step back, each held."""
    length = ExcitationTrajectory(at.max_length, rest_time).move(at.length_at(0.3), 0.2, FAST_ACCELERATION).hold(2.3)
    step_time = length.end_time
    length.hold(1.8).move(at.length_at(0.95), 0.2, FAST_ACCELERATION).hold(2.2)
    steps = ((0.0, at.medium_pressure), (step_time, at.high_pressure), (step_time + 0.9, at.low_pressure))
    return Excitation(length, steps)


def create_slack_test(at: OperatingLimits, rest_time: float) -> Excitation:
    """Return slow and fast slackening of a barely inflated muscle, then a staircase of the pressure."""
    length = ExcitationTrajectory(at.max_length, rest_time)
    for speed in (0.05, 0.2):
        length.move(at.length_at(0.1), speed).hold(0.2).move(at.max_length, speed).hold(0.2)
    inflation_time = length.end_time
    length.hold(0.4).move(at.length_at(0.5), 0.1).hold(0.3).move(at.max_length, 0.1).hold(0.2)
    staircase_time = length.end_time
    staircase = [
        (staircase_time + 0.15 * k, at.residual_pressure + (at.low_pressure - at.residual_pressure) * k / 5.0)
        for k in range(6)
    ]
    length.hold(0.15 * 6 + 0.2)
    final_time = length.end_time
    length.hold(0.5)
    initial = [(0.0, at.residual_pressure), (inflation_time, at.low_pressure)]
    return Excitation(length, (*initial, *staircase, (final_time, at.medium_pressure)))


def create_mixed(at: OperatingLimits, rest_time: float) -> Excitation:
    """Return pressure steps during length moves, with another spectrum than the other excitations."""
    length = ExcitationTrajectory(at.length_at(0.8), rest_time)
    for fraction, speed in (
        (0.2, 0.03),
        (0.9, 0.22),
        (0.35, 0.12),
        (1.0, 0.08),
        (0.1, 0.25),
        (0.7, 0.05),
        (0.25, 0.17),
    ):
        length.move(at.length_at(fraction), speed).hold(0.06)
    length.add_sine(0.2 * (at.max_length - at.min_length), 3.3, 3).move(at.length_at(0.95), 0.1)
    length.add_sine(0.8 * (at.max_length - at.min_length), 1.7, 3).hold(0.3)
    between = 0.5 * (at.low_pressure + at.medium_pressure), 0.5 * (at.medium_pressure + at.high_pressure)
    order = (
        between[1],
        at.low_pressure,
        between[0],
        at.high_pressure,
        0.5 * (at.residual_pressure + at.low_pressure),
        between[1],
        at.medium_pressure,
    )
    steps = [(0.0, between[0])]
    k = 0
    while rest_time + 0.37 * k < length.end_time - 0.2:
        steps.append((rest_time + 0.37 * k, order[k % len(order)]))
        k += 1
    return Excitation(length, tuple(steps))


EXCITATIONS: dict[str, Callable[[OperatingLimits, float], Excitation]] = {
    "steps": create_pressure_steps,
    "ramps": create_ramps,
    "sines": create_sines,
    "release": create_quick_releases,
    "hold": create_holds,
    "slack": create_slack_test,
    "mixed": create_mixed,
}
"""Excitations by the names that a protocol file uses."""
