"""Sensors and their faults: slow, noisy in colours, humming, quantised, drifting, and sampled with jitter."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from benchmarks.hidden_effects.adversary.protocol import PREPARATION_S, InputProgram
from benchmarks.hidden_effects.adversary.rig import BAR
from benchmarks.hidden_effects.adversary.simulate import STEP, Motion
from scipy.signal import lfilter

SAMPLE_RATE = 250.0
HUM_FREQUENCY = 50.0
JITTER_S = 0.15e-3
"""Standard deviation of the instant of a sample [s]; the log states the nominal time."""


class Sensor(NamedTuple):
    """A channel of the log."""

    unit: str
    scale: float
    """Unit of the log over SI."""
    white: float
    """Standard deviation of white noise, in the unit of the log, as all that follow."""
    pink: float
    """Standard deviation of noise whose power falls with the frequency."""
    hum: float
    """Amplitude at the frequency of the mains."""
    resolution: float
    tare: float
    """Standard deviation of the zero of a trial."""
    time_constant: float
    """Time constant of each of two stages of the amplifier [s]."""


SENSORS: Mapping[str, Sensor] = {
    "force": Sensor("N", 1.0, 1.8, 1.2, 0.8, 0.5, 0.4, 0.4e-3),
    "pressure": Sensor("bar", 1.0 / BAR, 0.003, 0.002, 0.0008, 0.0012, 0.001, 0.4e-3),
    "muscle_length": Sensor("mm", 1e3, 0.03, 0.02, 0.0, 0.01, 0.01, 0.2e-3),
}
LENGTH_NOISE_MM, LENGTH_RESOLUTION_MM = 0.01, 0.01
COMMAND_NOISE_BAR = 0.001
WANDER_BAR = 0.004
"""Standard deviation of what the regulator holds beside its command [bar]."""


class SensorFault(NamedTuple):
    """What is wrong with one channel, neutral by default."""

    gain: float = 1.0
    warm_up: float = 0.0
    """Shift of the zero that an amplifier that warms up has at the end of a trial, in the unit of the log."""
    slow_time: float = 0.0
    """Time constant of each of two stages of a filter [s]."""


def noise_level(channel: str) -> float:
    """Return the standard deviation of all noise of ``channel``, in the unit of the log."""
    sensor = SENSORS[channel]
    return float(np.sqrt(sensor.white**2 + sensor.pink**2 + 0.5 * sensor.hum**2 + sensor.resolution**2 / 12.0))


def draw_wander(rng: np.random.Generator, n: int) -> np.ndarray:
    """Return ``n`` steps of the regulator's own wander [Pa], correlated over about a second."""
    knots = rng.normal(0.0, WANDER_BAR * BAR, int(n * STEP) + 3)
    return np.interp(np.arange(n) * STEP, np.arange(len(knots)), knots)


def list_signals(motion: Motion) -> dict[str, np.ndarray]:
    """Return the true channels in SI units."""
    return {"force": motion.force, "pressure": motion.pressure, "muscle_length": motion.muscle_length}


def read_channel(channel: str, values: np.ndarray, fault: SensorFault) -> np.ndarray:
    """Return what ``channel`` shows without noise, in the unit of the log, from the end of the preparation."""
    sensor = SENSORS[channel]
    for time_constant in (sensor.time_constant, sensor.time_constant, fault.slow_time, fault.slow_time):
        values = _delay(values, time_constant)
    shown = fault.gain * sensor.scale * values[_preparation_steps() :]
    time = np.arange(len(shown)) * STEP
    return shown + fault.warm_up * -np.expm1(-1.5 * time / time[-1]) / -np.expm1(-1.5)


def record_trial(
    rng: np.random.Generator,
    program: InputProgram,
    signals: Mapping[str, np.ndarray],
    faults: Mapping[str, SensorFault],
    registration: float,
) -> dict[str, np.ndarray]:
    """Return the columns of the log of one trial; ``registration`` is the error of the length's zero [m]."""
    length = program.length[_preparation_steps() :] - registration
    command = program.command[_preparation_steps() :]
    grid = np.arange(len(length)) * STEP
    n = int(grid[-1] * SAMPLE_RATE) + 1
    time = np.arange(n) / SAMPLE_RATE
    instants = np.clip(time + rng.normal(0.0, JITTER_S, n), 0.0, grid[-1])
    shown_length = 1e3 * np.interp(instants, grid, length) + rng.normal(0.0, LENGTH_NOISE_MM, n)
    table = {
        "time": time,
        "length": np.round(shown_length / LENGTH_RESOLUTION_MM) * LENGTH_RESOLUTION_MM,
        "pressure_command": np.interp(instants, grid, command) / BAR + rng.normal(0.0, COMMAND_NOISE_BAR, n),
    }
    for channel, values in signals.items():
        sensor = SENSORS[channel]
        shown = np.interp(instants, grid, read_channel(channel, values, faults.get(channel, SensorFault())))
        shown += rng.normal(0.0, sensor.tare) + rng.normal(0.0, sensor.white, n) + sensor.pink * draw_pink(rng, n)
        shown += sensor.hum * np.sin(2.0 * np.pi * HUM_FREQUENCY * instants + rng.uniform(0.0, 2.0 * np.pi))
        table[channel] = np.round(shown / sensor.resolution) * sensor.resolution
    return table


def draw_pink(rng: np.random.Generator, n: int) -> np.ndarray:
    """Return ``n`` samples of noise whose power is inverse to the frequency, of standard deviation 1."""
    frequencies = np.fft.rfftfreq(n)
    frequencies[0] = np.inf
    spectrum = (rng.normal(size=len(frequencies)) + 1j * rng.normal(size=len(frequencies))) / np.sqrt(frequencies)
    noise = np.fft.irfft(spectrum, n)
    return noise / noise.std()


def _preparation_steps() -> int:
    return round(PREPARATION_S / STEP)


def _delay(values: np.ndarray, time_constant: float) -> np.ndarray:
    """Return ``values`` after a lag of first order, in steady state before the first of them."""
    if time_constant <= 0.0:
        return values
    share = -np.expm1(-STEP / time_constant)
    delayed, _ = lfilter([share], [1.0, share - 1.0], values, zi=[(1.0 - share) * values[0]])
    return np.asarray(delayed)
