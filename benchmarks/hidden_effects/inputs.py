"""Random but plausible bench inputs of a tensile tester and a pressure regulator.

A program has the motion of the crosshead (length of the whole unit) and the pressure command. The acceleration is
finite. The command has 200 samples per second and is linear between them, so a step takes 5 ms and the log omits only
its noise. Every program rests for 0.3 s, moves in both directions at several speeds, changes the pressure in steps,
includes time below 2 bar, and once stretches a nearly empty muscle taut.
"""

from typing import NamedTuple

import numpy as np
from benchmarks.hidden_effects.truth import TRACE_STEP
from scipy.interpolate import CubicSpline

SAMPLE_INTERVAL = 5e-3  # s: 200 Hz, of the log and of the command
REST_DURATION = 0.3  # s
MAX_SPEED = 0.3  # m/s
SLACK_LENGTH, RESTING_LENGTH = 0.100, 0.250  # m: the nominal unit's, to place the motion
MIN_UNIT_LENGTH, MAX_UNIT_LENGTH = SLACK_LENGTH + 0.86 * RESTING_LENGTH, SLACK_LENGTH + 1.012 * RESTING_LENGTH
BAR = 1e5
Floats = np.ndarray


class InputProgram(NamedTuple):
    """One prescribed input."""

    name: str
    """Name of the trial group."""
    use: str
    """Use of the trials: fit, validation or test."""
    duration: float
    """Duration [s]."""
    length: Floats
    """Unit length on the trace grid [m]."""
    command: Floats
    """Pressure command on the sample grid [Pa]."""

    def spline_coefficients(self) -> Floats:
        """Return the cubic pieces of the length for the integrator."""
        t = np.arange(len(self.length)) * TRACE_STEP
        return np.ascontiguousarray(CubicSpline(t, self.length, bc_type="clamped").c)


def _trapezoidal_move(start: float, end: float, speed: float, acceleration: float) -> Floats:
    """Return a move with trapezoidal velocity from rest to rest on the trace grid, without its starting point."""
    distance = abs(end - start)
    speed = min(speed, np.sqrt(distance * acceleration))
    rise, total = speed / acceleration, distance / speed + speed / acceleration
    n = max(int(np.ceil(total / TRACE_STEP)), 2)
    t = np.arange(1, n + 1) * total / n  # stretched to whole samples
    up, down = np.minimum(t, rise), np.maximum(t - (total - rise), 0.0)
    travelled = acceleration * (up**2 / 2 - down**2 / 2) + speed * np.maximum(t - rise, 0.0)
    return start + np.sign(end - start) * travelled


def generate_ramps(rng: np.random.Generator, n_samples: int, quick_release: bool) -> Floats:
    """Return moves between random lengths at 10 to 300 mm/s with rests; ``quick_release`` adds fast ones."""
    position = rng.uniform(MIN_UNIT_LENGTH + 0.010, MAX_UNIT_LENGTH - 0.008)
    parts, count, speeds = (
        [np.full(round(REST_DURATION / TRACE_STEP), position)],
        0,
        rng.permutation([0.02, 0.05, 0.1, 0.2, 0.3]),
    )
    while sum(map(len, parts)) < n_samples:
        # Moves go to the other half of the range, which is far enough to reach the speed.
        upward = position < 0.5 * (MIN_UNIT_LENGTH + MAX_UNIT_LENGTH)
        target = (
            rng.uniform(MAX_UNIT_LENGTH - 0.012, MAX_UNIT_LENGTH)
            if upward
            else rng.uniform(MIN_UNIT_LENGTH, MIN_UNIT_LENGTH + 0.015)
        )
        if count % 3 == 2:
            target = 0.5 * (position + target)
        quick = quick_release and count % 2 == 1 and not upward
        speed = MAX_SPEED if quick else speeds[count % 5] * rng.uniform(0.8, 1.0)
        parts.append(_trapezoidal_move(position, target, speed, 12.0 if quick else rng.uniform(2.0, 5.0)))
        parts.append(np.full(int(rng.uniform(0.03, 0.25) / TRACE_STEP), target))
        position, count = target, count + 1
    return np.concatenate(parts)[:n_samples]


def generate_sines(rng: np.random.Generator, n_samples: int, low_hz: float, high_hz: float, n_sines: int) -> Floats:
    """Return the sum of sines between two frequencies [Hz] with a smooth start, scaled to the limits."""
    t = np.arange(n_samples) * TRACE_STEP
    frequency = np.exp(np.linspace(np.log(low_hz), np.log(high_hz), n_sines)) * rng.uniform(0.9, 1.1, n_sines)
    phase, amplitude = rng.uniform(0, 2 * np.pi, n_sines), 1.0 / frequency ** rng.uniform(0.3, 0.8)
    wave = (amplitude[:, None] * np.sin(2 * np.pi * frequency[:, None] * t + phase[:, None])).sum(axis=0)
    ramp = np.clip((t - REST_DURATION) / 0.4, 0.0, 1.0)
    wave *= ramp**3 * (10 - 15 * ramp + 6 * ramp**2)  # no jump in acceleration
    mean_length = rng.uniform(0.5, 0.65) * (MAX_UNIT_LENGTH - MIN_UNIT_LENGTH) + MIN_UNIT_LENGTH
    top, bottom = (
        (MAX_UNIT_LENGTH - mean_length) / max(wave.max(), 1e-9),
        (mean_length - MIN_UNIT_LENGTH) / max(-wave.min(), 1e-9),
    )
    max_speed = np.abs(np.gradient(wave, TRACE_STEP)).max()
    return mean_length + wave * min(top, bottom, rng.uniform(0.2, MAX_SPEED) / max_speed)


def generate_cycles(rng: np.random.Generator, n_samples: int) -> Floats:
    """Return stretch-shorten cycles about one length, each with its own speed."""
    low, high = (
        rng.uniform(MIN_UNIT_LENGTH, MIN_UNIT_LENGTH + 0.012),
        rng.uniform(MAX_UNIT_LENGTH - 0.01, MAX_UNIT_LENGTH),
    )
    parts, speeds = [np.full(round(REST_DURATION / TRACE_STEP), low)], rng.permutation([0.03, 0.08, 0.15, 0.25])
    for i in range(1000):
        speed = speeds[i % 4] * rng.uniform(0.8, 1.1)
        parts += [_trapezoidal_move(low, high, speed, 4.0), _trapezoidal_move(high, low, speed, 4.0)]
        if sum(map(len, parts)) >= n_samples:
            break
    return np.concatenate(parts)[:n_samples]


def generate_command(rng: np.random.Generator, length: Floats, low_hz: float, high_hz: float) -> Floats:
    """Return the pressure command: held levels, ramps and sines, joined by steps."""
    n = (len(length) - 1) // 5 + 1
    start = rng.uniform(2.0, 4.0)
    levels = [rng.uniform(0.4, 1.6), rng.uniform(4.0, 5.0), rng.uniform(2.0, 3.2), rng.uniform(2.5, 4.5)]
    order, parts, current_level, k = (
        rng.permutation(4),
        [np.full(round(REST_DURATION / SAMPLE_INTERVAL), start)],
        start,
        0,
    )
    while sum(map(len, parts)) < n:
        level = levels[order[k % 4]]
        m = int(rng.uniform(0.3, 0.8) / SAMPLE_INTERVAL)
        kind = ("step", "sine", "step", "ramp")[k % 4]
        t = np.arange(m) * SAMPLE_INTERVAL
        if kind == "step":
            part = np.full(m, level)
        elif kind == "ramp":
            part = np.linspace(current_level, level, m)
        else:
            size = min(level, 5.0 - level, rng.uniform(0.4, 1.5))
            part = level + size * np.sin(2 * np.pi * rng.uniform(low_hz, high_hz) * t)
        parts.append(part)
        current_level, k = part[-1], k + 1
    out = np.concatenate(parts)[:n]
    # At the greatest length after the start, a nearly empty muscle is pulled against its stop.
    late = np.arange(n) * SAMPLE_INTERVAL > 0.8
    peak = int(np.argmax(np.where(late, length[::5][:n], 0.0)))
    half = int(rng.uniform(0.08, 0.15) / SAMPLE_INTERVAL)
    out[max(peak - half, round(REST_DURATION / SAMPLE_INTERVAL)) : peak + half] = rng.uniform(0.05, 0.5)
    return np.clip(out, 0.0, 5.0) * BAR


def generate_programs(rng: np.random.Generator) -> list[InputProgram]:
    """Return three inputs for fits, one for validation and one for the test, the last two with another spectrum."""
    out = []
    names = {"fit_1": "fit", "fit_2": "fit", "fit_3": "fit", "validation_1": "validation", "test_1": "test"}
    for name, use in names.items():
        duration = round(float(rng.uniform(3.5, 6.0)) / SAMPLE_INTERVAL) * SAMPLE_INTERVAL
        n = round(duration / TRACE_STEP) + 1
        if name == "fit_2":
            length = generate_sines(rng, n, 0.5, 4.0, 5)
        elif use == "validation":
            length = generate_sines(rng, n, 0.9, 6.0, 4)
        elif use == "test":
            length = generate_cycles(rng, n)
        else:
            length = generate_ramps(rng, n, quick_release=name == "fit_3")
        band = {"fit": (0.5, 2.0), "validation": (1.5, 4.0), "test": (1.0, 3.0)}[use]
        out.append(InputProgram(name, use, duration, length, generate_command(rng, length, *band)))
    return out


def hold_still(program: InputProgram) -> InputProgram:
    """Return the program without motion, which contains too little information."""
    return program._replace(length=np.full_like(program.length, 0.5 * (MIN_UNIT_LENGTH + MAX_UNIT_LENGTH)))
