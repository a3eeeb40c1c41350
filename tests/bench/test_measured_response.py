"""A measured frequency response that nobody made for this program (see ``KLUTE_SIM_DATA``), by laws of the supply.

30 sinusoids of 0.1 to 10 Hz through the joint of a pneumatic-muscle leg, open loop. What was commanded and what was
measured is not described, so gain, lag and dead time stand for all between the two.
"""

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from klute_sim.bench.protocols import library as protocols_library
from klute_sim.bench.run import run_protocol
from klute_sim.device.device import load_device, parse_device
from klute_sim.types import Array

DATA = Path(os.environ.get("KLUTE_SIM_DATA", "nowhere")) / "pam_leg_bode" / "OpenLoopBodeData.txt"
SLOW = 1.0
"""Below this frequency [Hz] steps may be longer, and a cycle is enough to settle in."""
STEPS, SETTLING = (2e-3, 2.5e-4), (1, 5)
"""Of the simulation [s], and cycles before the one that counts: below :data:`SLOW`, and from there."""
LEFT = {
    "gain": (0.90, 67.4),
    "gain lag": (2.92, 29.8),
    "gain delay": (0.90, 13.4),
    "gain lag delay": (0.86, 10.6),
}
"""Effects -> root mean square errors of their best fit, of gain [dB] and phase [deg]."""
SECTIONS = {
    "gain": '[effects.regulator_error]\nform = "gain"\ngain = {!r}\n',
    "lag": "[effects.pressure_lag]\ntime_constant_s = {!r}\n",
    "delay": "[effects.pressure_delay]\ndelay_s = {!r}\n",
}
NEUTRAL = {"gain": 1.0, "lag": 0.0, "delay": 0.0}
BEGIN = {"gain": 0.8, "lag": 0.03, "delay": 0.03}

Complex = NDArray[np.complex128]

pytestmark = [
    pytest.mark.extras,
    pytest.mark.skipif(not DATA.exists(), reason="KLUTE_SIM_DATA does not hold this measurement"),
]


class Measured(NamedTuple):
    frequency: Array
    """[Hz]"""
    response: Complex


class Fitted(NamedTuple):
    numbers: dict[str, float]
    """s, where it is not a ratio."""
    decibels: float
    degrees: float
    """Root mean square errors."""


@pytest.fixture(scope="module")
def measured() -> Measured:
    frequency, ratio, degrees = np.loadtxt(DATA, delimiter=",").T
    return Measured(frequency, ratio * np.exp(1j * np.radians(degrees)))


def simulated(numbers: dict[str, float], frequency: Array) -> Complex:
    """Pressure over command on the bench, of a bare muscle with these effects in its supply."""
    sections = "".join(SECTIONS[name].format(value) for name, value in numbers.items())
    device = parse_device(load_device("klute-3-4").content + sections.encode(), "measured")
    protocol, found = protocols_library.load_protocol("frequency"), []
    for part, step, cycles in zip((frequency < SLOW, frequency >= SLOW), STEPS, SETTLING, strict=True):
        changes = {"frequencies_hz": frequency[part].tolist(), "settling_cycles": cycles, "cycles": 1}
        found += run_protocol(device, protocol.model_copy(update=changes), dt=step).trials
    assert all(trial.metrics["pressure_coherence"] > 0.999 for trial in found)
    return np.array(
        [t.metrics["pressure_gain"] * np.exp(1j * np.radians(t.metrics["pressure_phase_deg"])) for t in found]
    )


def compute_closed_form(numbers: dict[str, float], frequency: Array) -> Complex:
    gain, lag, delay = ({**NEUTRAL, **numbers}[name] for name in NEUTRAL)
    pace = 2j * np.pi * frequency
    return np.asarray(gain * np.exp(-pace * delay) / (1.0 + pace * lag))


def fitted(measured: Measured, names: Sequence[str], response: Callable[[dict[str, float], Array], Complex]) -> Fitted:
    """Least squares of the ratio's logarithm: a neper of gain counts as much as a radian of phase."""

    def apart(values: Array) -> Array:
        model = response(dict(zip(names, map(float, values), strict=True)), measured.frequency)
        left = np.log(model / measured.response)
        return np.concatenate([left.real, left.imag])

    found = least_squares(apart, [BEGIN[name] for name in names], bounds=(0.0, 2.0), diff_step=1e-3, xtol=1e-5)
    nepers, radians = np.sqrt((found.fun.reshape(2, -1) ** 2).mean(axis=1))
    numbers = dict(zip(names, map(float, found.x), strict=True))
    return Fitted(numbers, float(20.0 / np.log(10.0) * nepers), float(np.degrees(radians)))


@pytest.fixture(scope="module")
def fits(measured: Measured) -> dict[str, Fitted]:
    """Each set of effects, fitted by simulation."""
    return {words: fitted(measured, words.split(), simulated) for words in LEFT}


@pytest.mark.parametrize("words", LEFT)
def test_residuals_of_models(fits: dict[str, Fitted], words: str) -> None:
    decibels, degrees = LEFT[words]
    assert fits[words].decibels == pytest.approx(decibels, abs=0.04)
    assert fits[words].degrees == pytest.approx(degrees, abs=0.4)


def test_gain_lag_and_dead_time_fit_and_dead_time_matters_most(fits: dict[str, Fitted]) -> None:
    gain, lag, delay, whole = fits.values()
    assert whole.decibels < 0.9
    assert whole.degrees < 11.0
    assert whole.degrees < delay.degrees < 0.5 * lag.degrees < 0.5 * gain.degrees
    # A lag that turns the phase far enough takes too much of the gain.
    assert lag.decibels > 3.0 * delay.decibels
    assert whole.numbers == pytest.approx({"gain": 0.84, "lag": 0.025, "delay": 0.034}, rel=0.05)


def test_residual_is_not_noise(fits: dict[str, Fitted], measured: Measured) -> None:
    """A first-order lag is too simple: the phase is measured later in the middle and earlier at the end."""
    model = compute_closed_form(fits["gain lag delay"].numbers, measured.frequency)
    early = np.degrees(np.angle(measured.response / model))
    middle = (measured.frequency > 1.5) & (measured.frequency < 6.5)
    assert (early[middle] < 0.0).all()
    assert early[middle].mean() == pytest.approx(-12.5, abs=1.0)
    assert early[-1] == pytest.approx(24.0, abs=1.5)


@pytest.mark.parametrize("words", LEFT)
def test_simulation_equals_the_closed_form(fits: dict[str, Fitted], measured: Measured, words: str) -> None:
    numbers = fits[words].numbers
    ratio = simulated(numbers, measured.frequency) / compute_closed_form(numbers, measured.frequency)
    assert np.abs(ratio) == pytest.approx(1.0, abs=0.005)
    assert np.degrees(np.angle(ratio)) == pytest.approx(0.0, abs=0.5)
    again = fitted(measured, words.split(), compute_closed_form).numbers
    # The implicit step is a lag of half its length.
    assert all(again[name] == pytest.approx(value, rel=1e-2, abs=2.0 * STEPS[1]) for name, value in numbers.items())
