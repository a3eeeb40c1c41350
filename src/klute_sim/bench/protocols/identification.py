"""Bench protocols: what a tensile tester and a pressure regulator are told to do, so that effects show.

Each rests first, moves with finite acceleration, keeps the unit no longer than its slack length plus the muscle's
resting length (so that nothing is pulled against the stop), and is sampled at 200 Hz. Pressure steps take one sample.
"""

from collections.abc import Callable
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from klute_sim.bench.trajectory import LengthTrajectory, sample_staircase
from klute_sim.datasets.trial import Use
from klute_sim.device.device import Device
from klute_sim.errors import InputError
from klute_sim.laws.mckibben import lock_length
from klute_sim.units import BAR

Array = NDArray[np.float64]

SAMPLE_INTERVAL = 5e-3
"""Of the commands [s]."""
REST_TIME = 0.5
"""At the start of every protocol [s]: the simulation begins in equilibrium."""
MAX_SPEED = 0.3
"""Speed of a quick release [m/s]."""
FAST_ACCELERATION, SLOW_ACCELERATION = 10.0, 3.0
"""Accelerations [m/s^2], of quick moves and of the others."""
STROKE_RATIO = 0.12
"""Stroke over the muscle's resting length, with a tendon."""
CLAMPED_STROKE_RATIO = 0.08
"""The same for a bare muscle, which pushes on its clamps when it is short and its pressure is low."""
CLAMPED_MAX_LENGTH_RATIO = 0.99
"""Longest length of a bare muscle over its resting length, which a tester must not exceed by its own error."""
MAX_STROKE = 0.035
MIN_STROKE = 0.001
"""Of all protocols [m]; less than the shortest tells nothing."""


class Program(NamedTuple):
    """What to command, a sample every :data:`SAMPLE`."""

    time: Array
    """[s], from 0."""
    unit_length: Array
    """Of the muscle-tendon unit [m]."""
    command: Array
    """Gauge pressure [Pa]."""


class OperatingLimits(NamedTuple):
    """Between what the commands of a device stay; SI."""

    min_length: float
    max_length: float
    """Unit lengths."""
    residual_pressure: float
    low_pressure: float
    medium_pressure: float
    high_pressure: float
    """Gauge pressures: hardly inflated, below 2 bar, and two above; the highest leaves the regulator a margin."""

    def length_at(self, fraction: float) -> float:
        """Unit length [m] at ``share`` of the stroke: 0 short, 1 long."""
        return self.min_length + fraction * (self.max_length - self.min_length)


def compute_limits(device: Device) -> OperatingLimits:
    """The limits for ``device``; raises InputError if its muscle can hardly contract."""
    muscle, tendon, supply = device.parameters.muscle, device.parameters.tendon, device.parameters.supply.max_pressure
    rest = muscle.resting_length
    share = CLAMPED_STROKE_RATIO if tendon.is_rigid else STROKE_RATIO
    stroke = min(share * rest, 0.4 * (rest - lock_length(muscle)), MAX_STROKE)
    if stroke < MIN_STROKE:
        raise InputError(
            f"device '{device.name}' cannot be tested: its muscle locks {1e3 * (rest - lock_length(muscle)):.2g} mm "
            f"below its resting length; allowed: {1e3 * MIN_STROKE / 0.4:.2g} mm or more"
        )
    long = tendon.slack_length + (CLAMPED_MAX_LENGTH_RATIO if tendon.is_rigid else 1.0) * rest
    return OperatingLimits(
        min_length=long - stroke,
        max_length=long,
        residual_pressure=min(0.3 * BAR, 0.06 * supply),
        low_pressure=min(1.2 * BAR, 0.25 * supply),
        medium_pressure=0.56 * supply,
        high_pressure=0.9 * supply,
    )


class _ProtocolTrajectory(LengthTrajectory):
    """A length over time, and the pressures that go with it."""

    def __init__(self, start_length: float) -> None:
        """At ``start`` [m], at rest."""
        super().__init__(start_length, REST_TIME)

    def move(self, target_length: float, speed: float, acceleration: float = SLOW_ACCELERATION) -> Self:
        """To ``there`` [m] and to rest, at ``speed`` [m/s] as far as ``acceleration`` [m/s^2] lets it get there."""
        return super().move(target_length, speed, acceleration)

    def add_sine(self, stroke: float, frequency: float, n_periods: int) -> Self:
        """Whole ``periods`` of a sine [Hz] that goes down by ``stroke`` [m] or what speed and acceleration allow."""
        here, pace = self.end_length, 2.0 * np.pi * frequency
        half = min(0.5 * stroke, MAX_SPEED / pace, FAST_ACCELERATION / pace**2)
        return self.append_segment(n_periods / frequency, lambda t: here - half * (1.0 - np.cos(pace * t)), here)

    def to_program(self, *pressure_steps: tuple[float, float]) -> Program:
        """Whole samples, at rest to the end, the pressure command stepping to each (time [s], level [Pa]) in turn."""
        time, length = self.sample(SAMPLE_INTERVAL)
        return Program(time, length, sample_staircase(time, pressure_steps))


def build_pressure_steps(device: Device) -> Program:
    """Pressure steps at three lengths."""
    at = compute_limits(device)
    order = (at.high_pressure, at.low_pressure, at.medium_pressure, at.residual_pressure, at.medium_pressure)
    length, levels = _ProtocolTrajectory(at.length_at(1.0)), [(0.0, at.medium_pressure)]
    for share in (1.0, 0.15, 0.55):
        length.move(at.length_at(share), 0.08).hold(0.02)
        levels += [(length.end_time + 0.4 * k, level) for k, level in enumerate(order)]
        length.hold(0.4 * len(order))
    return length.to_program(*levels)


def build_ramps(device: Device) -> Program:
    """Ramps both ways, slow and fast, at four pressures."""
    at = compute_limits(device)
    length, levels = _ProtocolTrajectory(at.max_length), [(0.0, at.medium_pressure)]
    slow = (at.max_length - at.min_length) / 1.2
    for pressure, speed in (
        (at.medium_pressure, slow),
        (at.high_pressure, 0.15),
        (at.low_pressure, 0.06),
        (at.high_pressure, 0.04),
        (at.medium_pressure, 0.2),
    ):
        levels.append((length.end_time, pressure))
        length.hold(0.2).move(at.length_at(0.1), speed).hold(0.1).move(at.max_length, speed)
    return length.hold(0.1).to_program(*levels)


def build_sines(device: Device) -> Program:
    """Sines from 0.5 to 5 Hz, each at two pressures or more."""
    at = compute_limits(device)
    length, levels = _ProtocolTrajectory(at.length_at(0.97)), [(0.0, at.medium_pressure)]
    for frequency, periods, pressures in (
        (0.5, 1, (at.medium_pressure, at.high_pressure)),
        (1.25, 2, (at.low_pressure, at.high_pressure)),
        (2.5, 4, (at.medium_pressure, at.low_pressure, at.high_pressure)),
        (5.0, 6, (at.high_pressure, at.medium_pressure)),
    ):
        begin, part = length.end_time, periods / frequency / len(pressures)
        levels += [(begin + part * k, pressure) for k, pressure in enumerate(pressures)]
        length.add_sine(0.9 * (at.max_length - at.min_length), frequency, periods)
    return length.hold(0.2).to_program(*levels)


def build_quick_releases(device: Device) -> Program:
    """Quick releases and quick stretches at three pressures."""
    at = compute_limits(device)
    length, levels = _ProtocolTrajectory(at.max_length), [(0.0, at.high_pressure)]
    for pressure, share in (
        (at.high_pressure, 0.55),
        (at.medium_pressure, 0.15),
        (at.low_pressure, 0.35),
        (at.high_pressure, 0.05),
    ):
        levels.append((length.end_time, pressure))
        length.hold(0.35).move(at.length_at(share), MAX_SPEED, FAST_ACCELERATION).hold(0.4).move(
            at.max_length, MAX_SPEED, FAST_ACCELERATION
        ).hold(0.3)
    return length.to_program(*levels)


def build_holds(device: Device) -> Program:
    """A step of the length, a step of the pressure and a step back, each held."""
    at = compute_limits(device)
    length = _ProtocolTrajectory(at.max_length).move(at.length_at(0.3), 0.2, FAST_ACCELERATION).hold(2.3)
    pressed = length.end_time
    length.hold(1.8).move(at.length_at(0.95), 0.2, FAST_ACCELERATION).hold(2.2)
    return length.to_program((0.0, at.medium_pressure), (pressed, at.high_pressure), (pressed + 0.9, at.low_pressure))


def build_slack_test(device: Device) -> Program:
    """A hardly inflated muscle is let slack and pulled taut, slowly and fast; then the pressure rises step by step."""
    at = compute_limits(device)
    length = _ProtocolTrajectory(at.max_length)
    for speed in (0.05, 0.2):
        length.move(at.length_at(0.1), speed).hold(0.2).move(at.max_length, speed).hold(0.2)
    inflated = length.end_time
    length.hold(0.4).move(at.length_at(0.5), 0.1).hold(0.3).move(at.max_length, 0.1).hold(0.2)
    stairs = length.end_time
    levels = [
        (stairs + 0.15 * k, at.residual_pressure + (at.low_pressure - at.residual_pressure) * k / 5.0) for k in range(6)
    ]
    length.hold(0.15 * 6 + 0.2)
    falls = length.end_time
    length.hold(0.5)
    return length.to_program(
        (0.0, at.residual_pressure), (inflated, at.low_pressure), *levels, (falls, at.medium_pressure)
    )


def build_mixed(device: Device) -> Program:
    """Everything at once, of another spectrum than the others: the pressure steps while the length moves."""
    at = compute_limits(device)
    length = _ProtocolTrajectory(at.length_at(0.8))
    for share, speed in ((0.2, 0.03), (0.9, 0.22), (0.35, 0.12), (1.0, 0.08), (0.1, 0.25), (0.7, 0.05), (0.25, 0.17)):
        length.move(at.length_at(share), speed).hold(0.06)
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
    levels = [(0.0, between[0])]
    k = 0
    while REST_TIME + 0.37 * k < length.end_time - 0.2:
        levels.append((REST_TIME + 0.37 * k, order[k % len(order)]))
        k += 1
    return length.to_program(*levels)


class IdentificationProtocol(NamedTuple):
    """A named program for any device."""

    name: str
    use: Use
    """What its trials are for, where the whole plan is recorded."""
    description: str
    """What it is for."""
    revealed_effects: tuple[str, ...]
    """Effects of the catalogue that it shows or tells apart best."""
    build_program: Callable[[Device], Program]


PROTOCOLS = {
    protocol.name: protocol
    for protocol in (
        IdentificationProtocol(
            "steps",
            "fit",
            "Pressure steps at three lengths, below 2 bar too: how pressure arrives, and what it pulls with where.",
            (
                *("pressure_lag", "pressure_delay", "regulator_error", "choked_valve", "supply_droop"),
                *("threshold_pressure", "end_taper", "bladder", "friction_offset", "thick_wall_bladder"),
                *("braid_extensibility", "tendon_stiffening", "quantisation"),
            ),
            build_pressure_steps,
        ),
        IdentificationProtocol(
            "ramps",
            "fit",
            "Ramps both ways from slow to fast at several pressures: dry friction does not mind the speed, oil does.",
            ("braid_hysteresis", "muscle_damping", "laminar_orifice", "discharge_loss", "seal_friction"),
            build_ramps,
        ),
        IdentificationProtocol(
            "sines",
            "select",
            "Sines from 0.5 to 5 Hz: what grows with speed, what is late, and what only turns round.",
            ("muscle_damping", "sensor_lag", "clock_skew", "tendon_hysteresis", "volume_coupling", "trapped_air"),
            build_sines,
        ),
        IdentificationProtocol(
            "release",
            "fit",
            "Quick releases and stretches: the damper at its strongest, and the tendon alone while the muscle waits.",
            ("discharge_loss", "muscle_damping", "tendon_slack", "sensor_lag"),
            build_quick_releases,
        ),
        IdentificationProtocol(
            "hold",
            "fit",
            "Steps that are held for seconds: what creeps although nothing moves.",
            ("bladder_relaxation", "bladder_softening", "tendon_hysteresis", "sensor_drift", "leak"),
            build_holds,
        ),
        IdentificationProtocol(
            "slack",
            "fit",
            "A hardly inflated muscle let slack and pulled taut: where pulling begins, in length and in pressure.",
            ("tendon_slack", "threshold_pressure", "sensor_offset"),
            build_slack_test,
        ),
        IdentificationProtocol(
            "mixed",
            "show",
            "Pressure steps while the length moves, at other speeds and levels: kept back to show the result on.",
            (),
            build_mixed,
        ),
    )
}
"""Name -> protocol."""
