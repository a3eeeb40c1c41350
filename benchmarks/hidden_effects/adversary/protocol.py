"""Inputs of the trials: ramps, pressure stairs, a chirp, phased work loops and a wander, each begun at rest."""

from typing import NamedTuple

import numpy as np
from benchmarks.hidden_effects.adversary.rig import BAR
from benchmarks.hidden_effects.adversary.simulate import STEP

REST_S = 0.8
"""Time at rest at the beginning of a trial [s]."""
PREPARATION_S = 6.0
"""Slow cycles and a rest before the log begins [s]: what the rubber and the friction remember."""
SHORT_MM, LONG_MM = 318.0, 345.0
"""Range of the unit's length [mm]."""
LOW_BAR, HIGH_BAR = 1.2, 4.6
"""Range of the pressure command [bar]."""
CORNER_S = 0.012
"""Time in which the crosshead changes its velocity, and the command its slope [s]."""
COMMAND_RATE = 25.0
"""Slope of a step of the command [bar/s]: that of the function generator."""


class InputProgram(NamedTuple):
    """Inputs of the trials of one group, at every step of the integration, with the preparation before them."""

    group: str
    use: str
    length: np.ndarray
    """Length of the unit [m]."""
    command: np.ndarray
    """Pressure command [Pa]."""


class _Path:
    """A piecewise linear path in time."""

    def __init__(self, value: float) -> None:
        self._points = [(0.0, value), (REST_S, value)]

    @property
    def time(self) -> float:
        return self._points[-1][0]

    def hold(self, duration: float) -> "_Path":
        self._points.append((self.time + duration, self._points[-1][1]))
        return self

    def move(self, value: float, speed: float) -> "_Path":
        time, last = self._points[-1]
        self._points.append((time + max(abs(value - last) / speed, 1e-3), value))
        return self

    def sample(self, duration: float) -> np.ndarray:
        time, value = np.transpose(self._points)
        grid = np.arange(round(duration / STEP) + 1) * STEP
        return _round_corners(np.interp(grid, time, value))


def draw_programs(rng: np.random.Generator) -> list[InputProgram]:
    """Return three programs to fit, one for validation and one for the test; together 25 s."""
    builders = {
        "fit_1": _draw_ramps,
        "fit_2": _draw_stairs,
        "fit_3": _draw_chirp,
        "validation_1": _draw_work_loops,
        "test_1": _draw_wander,
    }
    programs = []
    for group, build in builders.items():
        length, command = build(rng)
        programs.append(InputProgram(group, group.split("_")[0], *_prepare(length, command)))
    return programs


def _draw_ramps(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Ramps of rising speed, first at one pressure and then at another."""
    duration = 5.2
    path = _Path(rng.uniform(336.0, LONG_MM))
    for speed in (rng.uniform(12.0, 25.0), rng.uniform(40.0, 90.0), rng.uniform(130.0, 230.0)):
        for _ in range(2):
            path.move(rng.uniform(SHORT_MM, 325.0), speed).hold(0.12).move(rng.uniform(336.0, LONG_MM), speed).hold(0.1)
            if speed < 30.0:
                break
    levels = rng.permutation([rng.uniform(1.8, 2.8), rng.uniform(3.4, HIGH_BAR)])
    command = _Path(levels[0]).hold(2.3).move(levels[1], COMMAND_RATE)
    return path.sample(duration), command.sample(duration)


def _draw_stairs(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Stairs of the pressure up and down at three lengths."""
    duration = 5.4
    lengths = rng.permutation([rng.uniform(320.0, 326.0), rng.uniform(329.0, 335.0), rng.uniform(338.0, 344.0)])
    path, command = _Path(lengths[0]), _Path(rng.uniform(LOW_BAR, 2.0))
    for k in range(3):
        for level in (rng.uniform(2.6, 3.4), rng.uniform(3.8, HIGH_BAR), rng.uniform(LOW_BAR, 2.4)):
            command.move(level, COMMAND_RATE).hold(0.36)
        path.hold(1.25)
        if k < 2:
            path.move(lengths[k + 1], 90.0)
    return path.sample(duration), command.sample(duration)


def _draw_chirp(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A sine of falling amplitude and rising frequency, while the pressure swells slowly."""
    duration = 5.0
    time = np.maximum(np.arange(round(duration / STEP) + 1) * STEP - REST_S, 0.0)
    low, high = rng.uniform(0.3, 0.5), rng.uniform(2.5, 4.0)
    growth = np.log(high / low) / (duration - REST_S)
    phase = 2.0 * np.pi * low * np.expm1(growth * time) / growth
    amplitude = 11.0 * np.exp(-0.45 * growth * time)
    length = rng.uniform(330.0, 333.0) + amplitude * np.sin(phase)
    command = rng.uniform(2.7, 3.2) + rng.uniform(0.8, 1.3) * np.sin(2.0 * np.pi * rng.uniform(0.2, 0.35) * time)
    return _round_corners(length), _round_corners(command)


def _draw_work_loops(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Stretch-shorten cycles, in which the pressure steps at a phase of its own."""
    duration = 4.8
    path, command = _Path(rng.uniform(338.0, 343.0)), _Path(rng.uniform(1.5, 2.2))
    low, high = rng.uniform(1.5, 2.2), rng.uniform(3.6, HIGH_BAR)
    speed, wait = rng.uniform(50.0, 110.0), rng.uniform(0.05, 0.25)
    command.hold(wait)
    for _ in range(3):
        path.hold(0.15).move(rng.uniform(321.0, 326.0), speed).hold(0.15).move(rng.uniform(337.0, 343.0), speed)
        command.move(high, COMMAND_RATE).hold(0.5).move(low, COMMAND_RATE).hold(0.45)
    return path.sample(duration), command.sample(duration)


def _draw_wander(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Sums of sines without a common period."""
    duration = 4.8
    time = np.maximum(np.arange(round(duration / STEP) + 1) * STEP - REST_S, 0.0)

    def draw_sum(centre: float, half_range: float, highest: float) -> np.ndarray:
        frequencies = np.exp(rng.uniform(np.log(0.2), np.log(highest), 4))
        weights = rng.uniform(0.5, 1.0, 4) / np.sqrt(frequencies)
        phases = rng.uniform(0.0, 2.0 * np.pi, 4)
        waves = weights @ (
            np.sin(2.0 * np.pi * np.outer(frequencies, time) + phases[:, None]) - np.sin(phases)[:, None]
        )
        return centre + half_range * waves / np.abs(waves).max()

    return _round_corners(draw_sum(331.5, 12.0, 2.5)), _round_corners(draw_sum(2.9, 1.5, 1.5))


def _prepare(length: np.ndarray, command: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return both inputs in SI units after the preparation at the first pressure."""
    time = np.arange(round(PREPARATION_S / STEP)) * STEP
    cycles = np.where(time < 4.0, -4.0 * np.sin(np.pi * time / 2.0) ** 2, 0.0)
    before = length[0] + cycles
    return 1e-3 * np.concatenate([before, length]), BAR * np.concatenate([np.full(len(time), command[0]), command])


def _round_corners(values: np.ndarray) -> np.ndarray:
    """Return the moving mean of ``values`` over the time of a corner."""
    n = round(CORNER_S / STEP) | 1
    padded = np.pad(values, n // 2, mode="edge")
    return np.convolve(padded, np.full(n, 1.0 / n), mode="valid")
