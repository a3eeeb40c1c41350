"""Tests of a joint or a free load that is moved by one muscle or by two antagonists.

All commands are a mean pressure and a *difference*: the first device gets their sum, the second the mean minus the
difference. With one device the difference is added to the mean pressure.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from klute_sim.errors import InputError, suggest
from klute_sim.types import Array
from klute_sim.units import BAR

REST_TIME = 0.5
"""Time at rest at the start of every trial [s]."""
HOLD_TIME = 2.0
"""Duration of a step [s]: the joint comes to rest with most devices (assumed)."""
FREQUENCIES_HZ = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Frequencies of the sines [Hz] (assumed)."""
SETTLING_CYCLES, FITTED_CYCLES = 2, 3
"""Smallest number of periods of a sine before the fitted ones, and fitted periods."""
MIN_SETTLING_TIME = 0.8
"""Shortest time [s] before the fitted periods, which fast sines fill with more periods (assumed)."""
MULTISINE_PERIOD = 10.0
"""Period of the multisine [s]; its frequencies are odd multiples of 0.1 Hz."""
MULTISINE_HARMONICS = (1, 3, 5, 9, 15, 25, 41)
"""Harmonics of the multisine: odd, so that even ones show non-linearity; spaced by about 1.6 (assumed)."""
CO_CONTRACTION_FACTORS = (0.6, 0.8, 1.0, 1.2, 1.4)
"""Mean pressures of the co-contraction over that of the test (assumed)."""
MAX_TEST_DURATION = 600.0
"""Longest trial [s]."""


class ProtocolSettings(NamedTuple):
    """Settings of a test."""

    mean_pressure: float
    """Mean pressure [Pa]."""
    difference: float
    """Amplitude of the difference [Pa]."""
    load: float
    """External moment [N m] or force [N] of the tests with a load."""
    frequencies_hz: tuple[float, ...] = FREQUENCIES_HZ
    """Frequencies of the sines [Hz]."""


@dataclass(frozen=True)
class JointTrial:
    """Plan of one trial."""

    name: str
    """Unique name, usable as a file name."""
    conditions: dict[str, float]
    """Set values by keys with units."""
    duration: float
    """Duration [s]."""
    difference: Callable[[Array], Array]
    """Pressure difference [Pa] over time [s]."""
    mean_pressure: float
    """Mean pressure [Pa]."""
    load: Callable[[Array], Array] | None = None
    """External moment [N m] or force [N] over time [s]; None without one."""
    events: dict[str, float] = field(default_factory=dict)
    """Times [s] and frequencies [Hz] that the metrics refer to."""


def plan_test(test: str, settings: ProtocolSettings) -> list[JointTrial]:
    """Return the trials of ``test``; raises InputError for an unknown test or a negative pressure."""
    if test not in TESTS:
        listing = f"allowed: {', '.join(TESTS)}"
        raise InputError(f"there is no test '{test}'; {suggest(test, TESTS, listing)}")
    if settings.difference > settings.mean_pressure or settings.difference < 0.0:
        raise InputError(
            f"the difference is {settings.difference / BAR:g} bar around a mean of {settings.mean_pressure / BAR:g} "
            "bar; allowed: 0 up to the mean pressure"
        )
    return list(TESTS[test][1](settings))


def _plan_steps(settings: ProtocolSettings) -> list[JointTrial]:
    def make_step(fraction: float) -> JointTrial:
        amplitude = fraction * settings.difference
        return JointTrial(
            name=f"step_{100.0 * fraction:+.0f}pct".replace("+", "up_").replace("-", "down_"),
            conditions={"difference_bar": amplitude / BAR},
            duration=REST_TIME + 2.0 * HOLD_TIME,
            difference=lambda t: np.where((t >= REST_TIME) & (t < REST_TIME + HOLD_TIME), amplitude, 0.0),
            mean_pressure=settings.mean_pressure,
            events={"begin": REST_TIME, "end": REST_TIME + HOLD_TIME},
        )

    return [make_step(fraction) for fraction in (0.5, 1.0, -0.5, -1.0)]


def _plan_sines(settings: ProtocolSettings) -> list[JointTrial]:
    def make_sine(frequency: float) -> JointTrial:
        begin = REST_TIME + max(SETTLING_CYCLES, math.ceil(MIN_SETTLING_TIME * frequency)) / frequency
        end = begin + FITTED_CYCLES / frequency
        angular = 2.0 * np.pi * frequency
        return JointTrial(
            name=f"sine_{frequency:g}Hz",
            conditions={"frequency_hz": frequency, "difference_bar": settings.difference / BAR},
            duration=end,
            difference=lambda t: settings.difference * np.sin(angular * np.maximum(t - REST_TIME, 0.0)),
            mean_pressure=settings.mean_pressure,
            events={"begin": begin, "end": end, "frequency_hz": frequency},
        )

    return [make_sine(frequency) for frequency in settings.frequencies_hz]


def _plan_multisine(settings: ProtocolSettings) -> list[JointTrial]:
    """Plan one trial: harmonics of equal amplitude with Schroeder's phases (IEEE Trans. Inf. Theory 16:85, 1970)."""
    count = len(MULTISINE_HARMONICS)
    base = 2.0 * np.pi / MULTISINE_PERIOD

    def signal(t: Array) -> Array:
        moved = np.maximum(t - REST_TIME, 0.0)
        waves = sum(
            np.cos(h * base * moved - np.pi * k * (k - 1) / count) - np.cos(np.pi * k * (k - 1) / count)
            for k, h in enumerate(MULTISINE_HARMONICS, 1)
        )
        return np.asarray(waves, dtype=np.float64)

    peak = float(np.abs(signal(np.linspace(0.0, REST_TIME + MULTISINE_PERIOD, 20_001))).max())
    return [
        JointTrial(
            name="multisine",
            conditions={"difference_bar": settings.difference / BAR},
            duration=REST_TIME + 2.0 * MULTISINE_PERIOD,
            difference=lambda t: settings.difference * signal(t) / peak,
            mean_pressure=settings.mean_pressure,
            events={"begin": REST_TIME + MULTISINE_PERIOD, "end": REST_TIME + 2.0 * MULTISINE_PERIOD},
        )
    ]


def _plan_co_contraction(settings: ProtocolSettings) -> list[JointTrial]:
    def make_level(factor: float) -> JointTrial:
        mean = factor * settings.mean_pressure
        return JointTrial(
            name=f"mean_{mean / BAR:.3g}bar",
            conditions={"mean_bar": mean / BAR, "load": settings.load},
            duration=REST_TIME + 2.0 * HOLD_TIME,
            difference=lambda t: np.zeros(len(t)),
            mean_pressure=mean,
            load=lambda t: np.where(t >= REST_TIME, settings.load, 0.0),
            events={"begin": REST_TIME, "end": REST_TIME + 2.0 * HOLD_TIME},
        )

    return [make_level(factor) for factor in CO_CONTRACTION_FACTORS]


def _plan_quick_release(settings: ProtocolSettings) -> list[JointTrial]:
    def make_release(factor: float) -> JointTrial:
        return JointTrial(
            name=f"release_{100.0 * factor:.0f}pct",
            conditions={"load": factor * settings.load, "mean_bar": settings.mean_pressure / BAR},
            duration=REST_TIME + HOLD_TIME,
            difference=lambda t: np.zeros(len(t)),
            mean_pressure=settings.mean_pressure,
            load=lambda t: np.where(t < REST_TIME, factor * settings.load, 0.0),
            events={"begin": REST_TIME, "end": REST_TIME + HOLD_TIME},
        )

    return [make_release(factor) for factor in (0.5, 1.0)]


TESTS: dict[str, tuple[str, Callable[[ProtocolSettings], Sequence[JointTrial]]]] = {
    "steps": ("Steps of the pressure difference: final angle, rise, overshoot and settling.", _plan_steps),
    "sines": ("Sines of the pressure difference: gain, phase and coherence at each frequency.", _plan_sines),
    "multisine": ("A sum of sines: gain at its lowest frequency, bandwidth and non-linearity.", _plan_multisine),
    "co-contraction": ("A load at several mean pressures: the stiffness that they give.", _plan_co_contraction),
    "quick-release": ("A load that is released: peak speed, overshoot and settling.", _plan_quick_release),
}
"""Test -> what it does, and the function that plans its trials."""
