"""Random but sensible bench inputs: what a tensile tester and a pressure regulator can be told to do.

A program is the crosshead's motion (the length of the whole unit) and the pressure command. The motion has finite
acceleration; the command is issued at 200 Hz and is linear between its samples, so that a step takes 5 ms and the log
of it misses nothing but its noise. Every program rests for its first 0.3 s, visits both directions and several speeds,
steps the pressure, spends time below 2 bar, and once pulls a nearly empty muscle taut.
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
    use: str
    duration: float
    length: Floats
    """Unit length on the trace grid [m]."""
    command: Floats
    """Pressure command on the sample grid [Pa]."""

    def spline_coefficients(self) -> Floats:
        """Cubic pieces of the length, as the integrator wants them."""
        t = np.arange(len(self.length)) * TRACE_STEP
        return np.ascontiguousarray(CubicSpline(t, self.length, bc_type="clamped").c)


def _trapezoidal_move(start: float, end: float, speed: float, acceleration: float) -> Floats:
    """Trapezoidal velocity from rest to rest, on the trace grid, without the starting point."""
    way = abs(end - start)
    speed = min(speed, np.sqrt(way * acceleration))
    rise, total = speed / acceleration, way / speed + speed / acceleration
    n = max(int(np.ceil(total / TRACE_STEP)), 2)
    t = np.arange(1, n + 1) * total / n  # stretched to whole samples
    up, down = np.minimum(t, rise), np.maximum(t - (total - rise), 0.0)
    gone = acceleration * (up**2 / 2 - down**2 / 2) + speed * np.maximum(t - rise, 0.0)
    return start + np.sign(end - start) * gone


def generate_ramps(rng: np.random.Generator, n_samples: int, quick_release: bool) -> Floats:
    """Moves between random lengths at speeds from 10 to 300 mm/s, with rests; ``release`` adds quick ones."""
    here = rng.uniform(MIN_UNIT_LENGTH + 0.010, MAX_UNIT_LENGTH - 0.008)
    parts, count, speeds = (
        [np.full(round(REST_DURATION / TRACE_STEP), here)],
        0,
        rng.permutation([0.02, 0.05, 0.1, 0.2, 0.3]),
    )
    while sum(map(len, parts)) < n_samples:
        # Far enough to reach the speed: always towards the other half of the range.
        upward = here < 0.5 * (MIN_UNIT_LENGTH + MAX_UNIT_LENGTH)
        there = (
            rng.uniform(MAX_UNIT_LENGTH - 0.012, MAX_UNIT_LENGTH)
            if upward
            else rng.uniform(MIN_UNIT_LENGTH, MIN_UNIT_LENGTH + 0.015)
        )
        if count % 3 == 2:
            there = 0.5 * (here + there)
        quick = quick_release and count % 2 == 1 and not upward
        speed = MAX_SPEED if quick else speeds[count % 5] * rng.uniform(0.8, 1.0)
        parts.append(_trapezoidal_move(here, there, speed, 12.0 if quick else rng.uniform(2.0, 5.0)))
        parts.append(np.full(int(rng.uniform(0.03, 0.25) / TRACE_STEP), there))
        here, count = there, count + 1
    return np.concatenate(parts)[:n_samples]


def generate_sines(rng: np.random.Generator, n_samples: int, low_hz: float, high_hz: float, n_sines: int) -> Floats:
    """Several sines between two frequencies [Hz], begun softly, as large and fast as the limits allow."""
    t = np.arange(n_samples) * TRACE_STEP
    frequency = np.exp(np.linspace(np.log(low_hz), np.log(high_hz), n_sines)) * rng.uniform(0.9, 1.1, n_sines)
    phase, amplitude = rng.uniform(0, 2 * np.pi, n_sines), 1.0 / frequency ** rng.uniform(0.3, 0.8)
    wave = (amplitude[:, None] * np.sin(2 * np.pi * frequency[:, None] * t + phase[:, None])).sum(axis=0)
    begun = np.clip((t - REST_DURATION) / 0.4, 0.0, 1.0)
    wave *= begun**3 * (10 - 15 * begun + 6 * begun**2)  # no jump in acceleration
    middle = rng.uniform(0.5, 0.65) * (MAX_UNIT_LENGTH - MIN_UNIT_LENGTH) + MIN_UNIT_LENGTH
    top, bottom = (
        (MAX_UNIT_LENGTH - middle) / max(wave.max(), 1e-9),
        (middle - MIN_UNIT_LENGTH) / max(-wave.min(), 1e-9),
    )
    fastest = np.abs(np.gradient(wave, TRACE_STEP)).max()
    return middle + wave * min(top, bottom, rng.uniform(0.2, MAX_SPEED) / fastest)


def generate_cycles(rng: np.random.Generator, n_samples: int) -> Floats:
    """Stretch-shorten cycles, each at its own speed, about one length."""
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
    """Pressure command: held levels, ramps and sines, joined by steps."""
    n = (len(length) - 1) // 5 + 1
    start = rng.uniform(2.0, 4.0)
    levels = [rng.uniform(0.4, 1.6), rng.uniform(4.0, 5.0), rng.uniform(2.0, 3.2), rng.uniform(2.5, 4.5)]
    order, parts, here, k = rng.permutation(4), [np.full(round(REST_DURATION / SAMPLE_INTERVAL), start)], start, 0
    while sum(map(len, parts)) < n:
        level = levels[order[k % 4]]
        m = int(rng.uniform(0.3, 0.8) / SAMPLE_INTERVAL)
        kind = ("step", "sine", "step", "ramp")[k % 4]
        t = np.arange(m) * SAMPLE_INTERVAL
        if kind == "step":
            part = np.full(m, level)
        elif kind == "ramp":
            part = np.linspace(here, level, m)
        else:
            size = min(level, 5.0 - level, rng.uniform(0.4, 1.5))
            part = level + size * np.sin(2 * np.pi * rng.uniform(low_hz, high_hz) * t)
        parts.append(part)
        here, k = part[-1], k + 1
    out = np.concatenate(parts)[:n]
    # Once, a nearly empty muscle is pulled against its stop: at the longest moment after the start.
    late = np.arange(n) * SAMPLE_INTERVAL > 0.8
    peak = int(np.argmax(np.where(late, length[::5][:n], 0.0)))
    half = int(rng.uniform(0.08, 0.15) / SAMPLE_INTERVAL)
    out[max(peak - half, round(REST_DURATION / SAMPLE_INTERVAL)) : peak + half] = rng.uniform(0.05, 0.5)
    return np.clip(out, 0.0, 5.0) * BAR


def generate_programs(rng: np.random.Generator) -> list[InputProgram]:
    """Three inputs to fit on, one to select with and one to show, the last two of another spectrum."""
    out = []
    for name, use in (("fit_1", "fit"), ("fit_2", "fit"), ("fit_3", "fit"), ("select_1", "select"), ("show_1", "show")):
        duration = round(float(rng.uniform(3.5, 6.0)) / SAMPLE_INTERVAL) * SAMPLE_INTERVAL
        n = round(duration / TRACE_STEP) + 1
        if name == "fit_2":
            length = generate_sines(rng, n, 0.5, 4.0, 5)
        elif use == "select":
            length = generate_sines(rng, n, 0.9, 6.0, 4)
        elif use == "show":
            length = generate_cycles(rng, n)
        else:
            length = generate_ramps(rng, n, quick_release=name == "fit_3")
        band = {"fit": (0.5, 2.0), "select": (1.5, 4.0), "show": (1.0, 3.0)}[use]
        out.append(InputProgram(name, use, duration, length, generate_command(rng, length, *band)))
    return out


def hold_still(program: InputProgram) -> InputProgram:
    """The same program with nothing moving: too little to learn from."""
    return program._replace(length=np.full_like(program.length, 0.5 * (MIN_UNIT_LENGTH + MAX_UNIT_LENGTH)))
