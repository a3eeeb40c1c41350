"""Bench protocols: what a tensile tester and a pressure regulator are told to do, so that effects show.

Each rests first, moves with finite acceleration, keeps the unit no longer than its slack length plus the muscle's
resting length (so that nothing is pulled against the stop), and is sampled at 200 Hz. Pressure steps take one sample.
"""

from collections.abc import Callable
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from klute_sim.dataset.trial import Use
from klute_sim.device.files import Device
from klute_sim.errors import InputError
from klute_sim.laws.mckibben import lock_length
from klute_sim.rigs.bench.path import Path, stairs
from klute_sim.units import BAR

Array = NDArray[np.float64]

SAMPLE = 5e-3
"""Of the commands [s]."""
REST = 0.5
"""At the start of every protocol [s]: the simulation begins in equilibrium."""
FASTEST = 0.3
"""Speed of a quick release [m/s]."""
HARD, SOFT = 10.0, 3.0
"""Accelerations [m/s^2], of quick moves and of the others."""
CONTRACTION = 0.12
"""Stroke over the muscle's resting length, with a tendon."""
CLAMPED = 0.08
"""The same for a bare muscle, which pushes on its clamps when it is short and its pressure is low."""
CLAMPED_FROM = 0.99
"""Longest length of a bare muscle over its resting length, which a tester must not exceed by its own error."""
LONGEST_STROKE = 0.035
SHORTEST_STROKE = 0.001
"""Of all protocols [m]; less than the shortest tells nothing."""


class Program(NamedTuple):
    """What to command, a sample every :data:`SAMPLE`."""

    time: Array
    """[s], from 0."""
    unit_length: Array
    """Of the muscle-tendon unit [m]."""
    command: Array
    """Gauge pressure [Pa]."""


class Limits(NamedTuple):
    """Between what the commands of a device stay; SI."""

    short: float
    long: float
    """Unit lengths."""
    empty: float
    low: float
    middle: float
    high: float
    """Gauge pressures: hardly inflated, below 2 bar, and two above; the highest leaves the regulator a margin."""

    def at(self, share: float) -> float:
        """Unit length [m] at ``share`` of the stroke: 0 short, 1 long."""
        return self.short + share * (self.long - self.short)


def limits(device: Device) -> Limits:
    """The limits for ``device``; raises InputError if its muscle can hardly contract."""
    muscle, tendon, supply = device.parameters.muscle, device.parameters.tendon, device.parameters.supply.pressure
    rest = muscle.resting_length
    share = CLAMPED if tendon.rigid else CONTRACTION
    stroke = min(share * rest, 0.4 * (rest - lock_length(muscle)), LONGEST_STROKE)
    if stroke < SHORTEST_STROKE:
        raise InputError(
            f"device '{device.name}' cannot be tested: its muscle locks {1e3 * (rest - lock_length(muscle)):.2g} mm "
            f"below its resting length; allowed: {1e3 * SHORTEST_STROKE / 0.4:.2g} mm or more"
        )
    long = tendon.slack_length + (CLAMPED_FROM if tendon.rigid else 1.0) * rest
    return Limits(
        short=long - stroke,
        long=long,
        empty=min(0.3 * BAR, 0.06 * supply),
        low=min(1.2 * BAR, 0.25 * supply),
        middle=0.56 * supply,
        high=0.9 * supply,
    )


class _Length(Path):
    """A length over time, and the pressures that go with it."""

    def __init__(self, start: float) -> None:
        """At ``start`` [m], at rest."""
        super().__init__(start, REST)

    def move(self, there: float, speed: float, acceleration: float = SOFT) -> Self:
        """To ``there`` [m] and to rest, at ``speed`` [m/s] as far as ``acceleration`` [m/s^2] lets it get there."""
        return super().move(there, speed, acceleration)

    def swing(self, stroke: float, frequency: float, periods: int) -> Self:
        """Whole ``periods`` of a sine [Hz] that goes down by ``stroke`` [m] or what speed and acceleration allow."""
        here, pace = self.here, 2.0 * np.pi * frequency
        half = min(0.5 * stroke, FASTEST / pace, HARD / pace**2)
        return self.then(periods / frequency, lambda t: here - half * (1.0 - np.cos(pace * t)), here)

    def with_pressure(self, *levels: tuple[float, float]) -> Program:
        """Whole samples, at rest to the end, the pressure command stepping to each (time [s], level [Pa]) in turn."""
        time, length = self.sampled(SAMPLE)
        return Program(time, length, stairs(time, levels))


def steps(device: Device) -> Program:
    """Pressure steps at three lengths."""
    at = limits(device)
    order = (at.high, at.low, at.middle, at.empty, at.middle)
    length, levels = _Length(at.at(1.0)), [(0.0, at.middle)]
    for share in (1.0, 0.15, 0.55):
        length.move(at.at(share), 0.08).hold(0.02)
        levels += [(length.end + 0.4 * k, level) for k, level in enumerate(order)]
        length.hold(0.4 * len(order))
    return length.with_pressure(*levels)


def ramps(device: Device) -> Program:
    """Ramps both ways, slow and fast, at four pressures."""
    at = limits(device)
    length, levels = _Length(at.long), [(0.0, at.middle)]
    slow = (at.long - at.short) / 1.2
    for pressure, speed in ((at.middle, slow), (at.high, 0.15), (at.low, 0.06), (at.high, 0.04), (at.middle, 0.2)):
        levels.append((length.end, pressure))
        length.hold(0.2).move(at.at(0.1), speed).hold(0.1).move(at.long, speed)
    return length.hold(0.1).with_pressure(*levels)


def sines(device: Device) -> Program:
    """Sines from 0.5 to 5 Hz, each at two pressures or more."""
    at = limits(device)
    length, levels = _Length(at.at(0.97)), [(0.0, at.middle)]
    for frequency, periods, pressures in (
        (0.5, 1, (at.middle, at.high)),
        (1.25, 2, (at.low, at.high)),
        (2.5, 4, (at.middle, at.low, at.high)),
        (5.0, 6, (at.high, at.middle)),
    ):
        begin, part = length.end, periods / frequency / len(pressures)
        levels += [(begin + part * k, pressure) for k, pressure in enumerate(pressures)]
        length.swing(0.9 * (at.long - at.short), frequency, periods)
    return length.hold(0.2).with_pressure(*levels)


def release(device: Device) -> Program:
    """Quick releases and quick stretches at three pressures."""
    at = limits(device)
    length, levels = _Length(at.long), [(0.0, at.high)]
    for pressure, share in ((at.high, 0.55), (at.middle, 0.15), (at.low, 0.35), (at.high, 0.05)):
        levels.append((length.end, pressure))
        length.hold(0.35).move(at.at(share), FASTEST, HARD).hold(0.4).move(at.long, FASTEST, HARD).hold(0.3)
    return length.with_pressure(*levels)


def hold(device: Device) -> Program:
    """A step of the length, a step of the pressure and a step back, each held."""
    at = limits(device)
    length = _Length(at.long).move(at.at(0.3), 0.2, HARD).hold(2.3)
    pressed = length.end
    length.hold(1.8).move(at.at(0.95), 0.2, HARD).hold(2.2)
    return length.with_pressure((0.0, at.middle), (pressed, at.high), (pressed + 0.9, at.low))


def slack(device: Device) -> Program:
    """A hardly inflated muscle is let slack and pulled taut, slowly and fast; then the pressure rises step by step."""
    at = limits(device)
    length = _Length(at.long)
    for speed in (0.05, 0.2):
        length.move(at.at(0.1), speed).hold(0.2).move(at.long, speed).hold(0.2)
    inflated = length.end
    length.hold(0.4).move(at.at(0.5), 0.1).hold(0.3).move(at.long, 0.1).hold(0.2)
    stairs = length.end
    levels = [(stairs + 0.15 * k, at.empty + (at.low - at.empty) * k / 5.0) for k in range(6)]
    length.hold(0.15 * 6 + 0.2)
    falls = length.end
    length.hold(0.5)
    return length.with_pressure((0.0, at.empty), (inflated, at.low), *levels, (falls, at.middle))


def mixed(device: Device) -> Program:
    """Everything at once, of another spectrum than the others: the pressure steps while the length moves."""
    at = limits(device)
    length = _Length(at.at(0.8))
    for share, speed in ((0.2, 0.03), (0.9, 0.22), (0.35, 0.12), (1.0, 0.08), (0.1, 0.25), (0.7, 0.05), (0.25, 0.17)):
        length.move(at.at(share), speed).hold(0.06)
    length.swing(0.2 * (at.long - at.short), 3.3, 3).move(at.at(0.95), 0.1)
    length.swing(0.8 * (at.long - at.short), 1.7, 3).hold(0.3)
    between = 0.5 * (at.low + at.middle), 0.5 * (at.middle + at.high)
    order = (between[1], at.low, between[0], at.high, 0.5 * (at.empty + at.low), between[1], at.middle)
    levels = [(0.0, between[0])]
    k = 0
    while REST + 0.37 * k < length.end - 0.2:
        levels.append((REST + 0.37 * k, order[k % len(order)]))
        k += 1
    return length.with_pressure(*levels)


class Protocol(NamedTuple):
    """A named program for any device."""

    name: str
    use: Use
    """What its trials are for, where the whole plan is recorded."""
    sentence: str
    """What it is for."""
    shows: tuple[str, ...]
    """Effects of the catalogue that it shows or tells apart best."""
    program: Callable[[Device], Program]


PROTOCOLS = {
    protocol.name: protocol
    for protocol in (
        Protocol(
            "steps",
            "fit",
            "Pressure steps at three lengths, below 2 bar too: how pressure arrives, and what it pulls with where.",
            (
                *("pressure_lag", "pressure_delay", "regulator_error", "choked_valve", "supply_droop"),
                *("threshold_pressure", "end_taper", "bladder", "friction_offset", "thick_wall_bladder"),
                *("braid_extensibility", "tendon_stiffening", "quantisation"),
            ),
            steps,
        ),
        Protocol(
            "ramps",
            "fit",
            "Ramps both ways from slow to fast at several pressures: dry friction does not mind the speed, oil does.",
            ("braid_hysteresis", "muscle_damping", "laminar_orifice", "discharge_loss", "seal_friction"),
            ramps,
        ),
        Protocol(
            "sines",
            "select",
            "Sines from 0.5 to 5 Hz: what grows with speed, what is late, and what only turns round.",
            ("muscle_damping", "sensor_lag", "clock_skew", "tendon_hysteresis", "volume_coupling", "trapped_air"),
            sines,
        ),
        Protocol(
            "release",
            "fit",
            "Quick releases and stretches: the damper at its strongest, and the tendon alone while the muscle waits.",
            ("discharge_loss", "muscle_damping", "tendon_slack", "sensor_lag"),
            release,
        ),
        Protocol(
            "hold",
            "fit",
            "Steps that are held for seconds: what creeps although nothing moves.",
            ("bladder_relaxation", "bladder_softening", "tendon_hysteresis", "sensor_drift", "leak"),
            hold,
        ),
        Protocol(
            "slack",
            "fit",
            "A hardly inflated muscle let slack and pulled taut: where pulling begins, in length and in pressure.",
            ("tendon_slack", "threshold_pressure", "sensor_offset"),
            slack,
        ),
        Protocol(
            "mixed",
            "show",
            "Pressure steps while the length moves, at other speeds and levels: kept back to show the result on.",
            (),
            mixed,
        ),
    )
}
"""Name -> protocol."""
