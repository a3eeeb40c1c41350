"""Excitation signals for system identification: length and pressure commands that reveal effects of a device.

Every excitation starts at rest, moves with finite acceleration and keeps the unit no longer than the slack length of
its tendon plus the resting length of its muscle, so that the muscle never reaches its stop. A cylinder stays away from
both stops. A tendon alone is stretched from its slack length on.
"""

import math
from collections.abc import Callable
from typing import NamedTuple, Self

import numpy as np

from klute_sim.bench.trajectory import LengthTrajectory
from klute_sim.device.device import Device, check_is_testable
from klute_sim.errors import InputError
from klute_sim.laws import damper as damper_law
from klute_sim.laws import tendon as tendon_law
from klute_sim.laws.damper import DamperParameters
from klute_sim.laws.mckibben import lock_length
from klute_sim.laws.tendon import TendonParameters
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
MAX_TRAVEL_RATIO = 0.4
"""Maximum stroke over the distance between both ends of the muscle's travel."""
MAX_STROKE = 0.035
"""Maximum stroke of all excitations [m]."""
TENDON_STRETCH_RATIO, DEFAULT_TENDON_STRETCH = 2.0, 0.01
"""Largest stretch of a tendon alone, over the stretch at which its second spring engages, and [m] where the second
spring engages at once (assumed: both springs pull in half of the stroke). Less where the force would be too large."""
CYLINDER_STROKE_RATIO = 0.8
"""Stroke of a cylinder alone over the distance between its stops; the rest is shared by both ends."""
MAX_PART_FORCE = 1000.0
"""Largest force [N] on a tendon, or of a damper, that is tested alone (assumed: somewhat more than the weight of a
person, which the parts of a prosthesis carry)."""
LOADING_SPEED = 0.05
"""Speed [m/s] at which a tendon alone is stretched from its slack length to the beginning of an excitation."""
MIN_STROKE = 0.001
"""Minimum stroke of a muscle or a cylinder [m]; a shorter stroke reveals nothing."""

PressureSteps = tuple[tuple[float, float], ...]
"""Steps of the pressure command: start time [s] and gauge pressure [Pa] of each."""


class OperatingLimits(NamedTuple):
    """Range of a device's commands."""

    far_length: float
    """Unit length [m] at the far end of the stroke."""
    home_length: float
    """Unit length [m] to which excitations return: the longest of a muscle or a cylinder, the slack one of a tendon
    alone."""
    residual_pressure: float
    """Gauge pressure [Pa] at which the muscle is barely inflated."""
    low_pressure: float
    """Gauge pressure [Pa] below 2 bar."""
    medium_pressure: float
    """Gauge pressure [Pa] of about half of the supply's."""
    high_pressure: float
    """Maximum gauge pressure [Pa]; it leaves the regulator a margin."""
    max_speed: float = MAX_SPEED
    """Maximum speed [m/s]."""

    @property
    def stroke(self) -> float:
        """Distance of the home length beyond the far one [m]; negative where excitations lengthen the unit."""
        return self.home_length - self.far_length

    def length_at(self, fraction: float) -> float:
        """Return the unit length [m] at ``fraction`` of the stroke: 0 is far, 1 is home."""
        return self.far_length + fraction * self.stroke

    def begin_at(self, fraction: float, rest_time: float) -> "ExcitationTrajectory":
        """Return a trajectory that rests for ``rest_time`` [s] and stands at ``fraction`` of the stroke then.

        A tendon alone rests without load and is stretched to ``fraction`` after that.
        """
        if self.stroke > 0.0:
            return ExcitationTrajectory(self.length_at(fraction), rest_time, self.max_speed)
        trajectory = ExcitationTrajectory(self.home_length, rest_time, self.max_speed)
        return trajectory.move(self.length_at(fraction), LOADING_SPEED)


def compute_limits(device: Device) -> OperatingLimits:
    """Return the operating limits of ``device``; raise InputError when it can hardly move."""
    check_is_testable(device)
    spec, tendon = device.spec, device.parameters.tendon
    if spec.muscle is None and spec.cylinder is None:
        return _compute_tendon_limits(tendon)
    muscle, supply_pressure = device.parameters.muscle, device.parameters.supply.max_pressure
    resting_length, travel = muscle.resting_length, muscle.resting_length - lock_length(muscle)
    travel_ratio, max_speed = MAX_TRAVEL_RATIO, MAX_SPEED
    if spec.muscle is None and tendon.is_rigid:
        travel_ratio, max_speed = CYLINDER_STROKE_RATIO, _compute_damper_speed(device.parameters.damper)
        home_length, stroke = resting_length - 0.5 * (1.0 - CYLINDER_STROKE_RATIO) * travel, MAX_STROKE
    elif tendon.is_rigid:
        home_length, stroke = CLAMPED_MAX_LENGTH_RATIO * resting_length, CLAMPED_STROKE_RATIO * resting_length
    else:
        home_length, stroke = tendon.slack_length + resting_length, STROKE_RATIO * resting_length
    stroke = min(stroke, travel_ratio * travel, MAX_STROKE)
    if stroke < MIN_STROKE:
        stop, longest = ("its muscle locks", "resting length") if spec.muscle else ("its stop is", "extended length")
        raise InputError(
            f"device '{device.name}' cannot be tested: {stop} {1e3 * travel:.2g} mm below its {longest}; allowed: "
            f"{1e3 * MIN_STROKE / travel_ratio:.2g} mm or more"
        )
    return OperatingLimits(
        far_length=home_length - stroke,
        home_length=home_length,
        residual_pressure=min(0.3 * BAR, 0.06 * supply_pressure),
        low_pressure=min(1.2 * BAR, 0.25 * supply_pressure),
        medium_pressure=0.56 * supply_pressure,
        high_pressure=0.9 * supply_pressure,
        max_speed=max_speed,
    )


def _compute_tendon_limits(tendon: TendonParameters) -> OperatingLimits:
    """Return the limits of a ``tendon`` alone: it is stretched as far as :data:`MAX_PART_FORCE` does at most."""
    stretch = min(
        TENDON_STRETCH_RATIO * tendon.engagement_stretch or DEFAULT_TENDON_STRETCH,
        tendon_law.stretch_at_tension(tendon, MAX_PART_FORCE),
        MAX_STROKE,
    )
    return OperatingLimits(tendon.slack_length + stretch, tendon.slack_length, 0.0, 0.0, 0.0, 0.0)


def _compute_damper_speed(damper: DamperParameters) -> float:
    """Return the speed [m/s], at most :data:`MAX_SPEED`, up to which ``damper`` has :data:`MAX_PART_FORCE` at most."""
    force = max(abs(damper_law.force(damper, sign * MAX_SPEED)) for sign in (-1.0, 1.0))
    return MAX_SPEED * min(1.0, math.sqrt(MAX_PART_FORCE / force)) if force else MAX_SPEED


class ExcitationTrajectory(LengthTrajectory):
    """Commanded unit length of an excitation."""

    def __init__(self, start_length: float, rest_time: float, max_speed: float = MAX_SPEED) -> None:
        """Start at ``start_length`` [m], rest there for ``rest_time`` [s], and never exceed ``max_speed`` [m/s]."""
        super().__init__(start_length, rest_time)
        self._max_speed = max_speed

    def move(self, target_length: float, speed: float, acceleration: float = SLOW_ACCELERATION) -> Self:
        """Append a move to ``target_length`` [m], slow unless ``acceleration`` [m/s^2] is given."""
        return super().move(target_length, min(speed, self._max_speed), acceleration)

    def add_sine(self, stroke: float, frequency: float, n_periods: int) -> Self:
        """Append ``n_periods`` of a sine of ``frequency`` [Hz] that shortens the unit by ``stroke`` [m] (signed).

        The stroke is smaller where the maximum speed or acceleration requires it.
        """
        start, angular_frequency = self.end_length, 2.0 * np.pi * frequency
        limit = min(self._max_speed / angular_frequency, FAST_ACCELERATION / angular_frequency**2)
        amplitude = float(np.clip(0.5 * stroke, -limit, limit))
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
    length, steps = at.begin_at(1.0, rest_time), [(0.0, at.medium_pressure)]
    for fraction in (1.0, 0.15, 0.55):
        length.move(at.length_at(fraction), 0.08).hold(0.02)
        steps += [(length.end_time + 0.4 * k, level) for k, level in enumerate(order)]
        length.hold(0.4 * len(order))
    return Excitation(length, tuple(steps))


def create_ramps(at: OperatingLimits, rest_time: float) -> Excitation:
    """Return slow and fast length ramps in both directions at four pressures."""
    length, steps = at.begin_at(1.0, rest_time), [(0.0, at.medium_pressure)]
    slow = abs(at.stroke) / 1.2
    for pressure, speed in (
        (at.medium_pressure, slow),
        (at.high_pressure, 0.15),
        (at.low_pressure, 0.06),
        (at.high_pressure, 0.04),
        (at.medium_pressure, 0.2),
    ):
        steps.append((length.end_time, pressure))
        length.hold(0.2).move(at.length_at(0.1), speed).hold(0.1).move(at.home_length, speed)
    return Excitation(length.hold(0.1), tuple(steps))


def create_sines(at: OperatingLimits, rest_time: float) -> Excitation:
    """Return length sines from 0.5 to 5 Hz, each at two pressures or more."""
    length, steps = at.begin_at(0.97, rest_time), [(0.0, at.medium_pressure)]
    for frequency, n_periods, pressures in (
        (0.5, 1, (at.medium_pressure, at.high_pressure)),
        (1.25, 2, (at.low_pressure, at.high_pressure)),
        (2.5, 4, (at.medium_pressure, at.low_pressure, at.high_pressure)),
        (5.0, 6, (at.high_pressure, at.medium_pressure)),
    ):
        start, duration = length.end_time, n_periods / frequency / len(pressures)
        steps += [(start + duration * k, pressure) for k, pressure in enumerate(pressures)]
        length.add_sine(0.9 * at.stroke, frequency, n_periods)
    return Excitation(length.hold(0.2), tuple(steps))


def create_quick_releases(at: OperatingLimits, rest_time: float) -> Excitation:
    """Return quick releases and quick stretches at three pressures."""
    length, steps = at.begin_at(1.0, rest_time), [(0.0, at.high_pressure)]
    for pressure, fraction in (
        (at.high_pressure, 0.55),
        (at.medium_pressure, 0.15),
        (at.low_pressure, 0.35),
        (at.high_pressure, 0.05),
    ):
        steps.append((length.end_time, pressure))
        length.hold(0.35).move(at.length_at(fraction), MAX_SPEED, FAST_ACCELERATION)
        length.hold(0.4).move(at.home_length, MAX_SPEED, FAST_ACCELERATION).hold(0.3)
    return Excitation(length, tuple(steps))


def create_holds(at: OperatingLimits, rest_time: float) -> Excitation:
    """Return a length step, a pressure step and a step back, each held."""
    length = at.begin_at(1.0, rest_time).move(at.length_at(0.3), 0.2, FAST_ACCELERATION).hold(2.3)
    step_time = length.end_time
    length.hold(1.8).move(at.length_at(0.95), 0.2, FAST_ACCELERATION).hold(2.2)
    steps = ((0.0, at.medium_pressure), (step_time, at.high_pressure), (step_time + 0.9, at.low_pressure))
    return Excitation(length, steps)


def create_slack_test(at: OperatingLimits, rest_time: float) -> Excitation:
    """Return slow and fast slackening of a barely inflated muscle, then a staircase of the pressure."""
    length = at.begin_at(1.0, rest_time)
    for speed in (0.05, 0.2):
        length.move(at.length_at(0.1), speed).hold(0.2).move(at.home_length, speed).hold(0.2)
    inflation_time = length.end_time
    length.hold(0.4).move(at.length_at(0.5), 0.1).hold(0.3).move(at.home_length, 0.1).hold(0.2)
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
    length = at.begin_at(0.8, rest_time)
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
    length.add_sine(0.2 * at.stroke, 3.3, 3).move(at.length_at(0.95), 0.1)
    length.add_sine(0.8 * at.stroke, 1.7, 3).hold(0.3)
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
