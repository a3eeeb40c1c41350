"""A made walker: both legs over time, with the positions, loads and moments that belong together.

The curves are those of the package's own reference, changed for other kinds of gait. The feet roll over the ground
without slip, so positions and loads agree.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from klute_sim.gait.reference import REQUIRED_COLUMNS, load_default_reference
from klute_sim.types import Array

HIP, KNEE, ANKLE, SHANK, MOMENT, POWER, VERTICAL, FORWARD = REQUIRED_COLUMNS
REFERENCE = load_default_reference()
TOE_OFF = 0.63
"""Toe-off phase of the reference (0-1)."""
HEEL_X, TOE_X, SOLE_Z = -0.05, 0.15, -0.07
"""Points of the sole relative to the ankle [m], for a stature of 1.75 m."""
SIDES = ("right", "left")
Change = Callable[[Array, Array], Array]
"""Function of the phase (0-1) and the samples of a column that returns changed samples."""


@dataclass(frozen=True)
class Walker:
    """Subject and gait."""

    mass: float = 72.0
    """Body mass [kg]."""
    stature: float = 1.75
    """Stature [m]."""
    stride_time: float = 1.1
    """Stride time [s]."""
    speed: float = 1.25
    """Speed [m/s]."""
    toe_off: float = TOE_OFF
    """Toe-off phase (0-1)."""
    treadmill: bool = False
    """Whether the ground moves."""
    seconds: float = 5.0
    """Duration [s]."""
    rate: float = 100.0
    """Sampling rate [Hz]."""
    changes: Mapping[str, Change] = field(default_factory=dict)
    """Column of a reference -> its change."""
    slope_deg: float = 0.0
    """Slope of the ground [deg]."""

    @property
    def time(self) -> Array:
        """Sample times [s]."""
        return np.arange(round(self.seconds * self.rate) + 1) / self.rate

    def get_start(self, side: str) -> float:
        """Return the first heel strike of ``side`` [s]."""
        return 0.2 + (0.5 * self.stride_time if side == "left" else 0.0)

    def compute_curves(self, phase: Array) -> dict[str, Array]:
        """Return the columns of a reference at ``phase`` (0-1)."""
        reference = REFERENCE.tilt_to_slope(np.radians(self.slope_deg))
        phase = phase % 1.0
        typical = np.interp(phase, [0.0, self.toe_off, 1.0], [0.0, TOE_OFF, 1.0])
        curves = {name: reference(name, typical) for name in REQUIRED_COLUMNS}
        for name in (VERTICAL, FORWARD, MOMENT):
            curves[name] = np.where(phase < self.toe_off, curves[name], 0.0)
        for name, change in self.changes.items():
            curves[name] = np.asarray(change(phase, curves[name]), dtype=np.float64)
        if not {SHANK} & set(self.changes) and {HIP, KNEE} & set(self.changes):
            curves[SHANK] = curves[KNEE] - curves[HIP] + 4.0
        step = 1e-3
        ends = [np.interp((phase + d) % 1.0, *self._get_ankle_table()) for d in (-step, step)]
        rate = np.radians(ends[1] - ends[0]) / (2.0 * step * self.stride_time)
        curves[POWER] = -curves[MOMENT] * rate if POWER not in self.changes else curves[POWER]
        return curves

    def _get_ankle_table(self) -> tuple[Array, Array]:
        phase = np.linspace(0.0, 1.0, 201)
        typical = np.interp(phase, [0.0, self.toe_off, 1.0], [0.0, TOE_OFF, 1.0])
        angle = REFERENCE(ANKLE, typical % 1.0)
        change = self.changes.get(ANKLE)
        return phase, angle if change is None else np.asarray(change(phase, angle), dtype=np.float64)

    def compute_leg(self, side: str) -> dict[str, Array]:
        """Return angles [deg], loads [N], the moment [N.m] and points (n, 2), forward and up [m], over time."""
        time, start = self.time, self.get_start(side)
        phase = (time - start) / self.stride_time
        curves = self.compute_curves(phase)
        size = self.stature / 1.75
        pitch = np.radians(curves[SHANK] - curves[ANKLE])
        travel, height = self._roll_foot(size)
        cycle = np.floor(phase)
        x = np.interp(phase % 1.0, *travel) + cycle * self.speed * self.stride_time
        z = np.interp(phase % 1.0, *height)
        if self.treadmill:
            x = x - self.speed * (time - start)
        shank = np.radians(curves[SHANK])
        thigh = shank - np.radians(curves[KNEE])
        ankle = np.stack([x, z], axis=1)
        knee = ankle + 0.246 * self.stature * np.stack([np.sin(shank), np.cos(shank)], axis=1)
        hip = knee + 0.245 * self.stature * np.stack([np.sin(thigh), np.cos(thigh)], axis=1)
        points = {"HIP": hip, "KNEE": knee, "ANKLE": ankle}
        for name, ahead in (("HEEL", HEEL_X), ("TOE", TOE_X)):
            along = np.stack([np.cos(pitch), -np.sin(pitch)], axis=1)
            normal = np.stack([np.sin(pitch), np.cos(pitch)], axis=1)
            points[name] = ankle + size * (ahead * along + SOLE_Z * normal)
        vertical, forward = self.mass * curves[VERTICAL], self.mass * curves[FORWARD]
        moment = self.mass * curves[MOMENT]
        is_loaded = vertical > 25.0
        arm = np.divide(moment - z * forward, vertical, out=np.zeros_like(x), where=is_loaded)
        cop = np.where(is_loaded, x + np.clip(arm, -0.08, 0.22), 0.0)
        return {**curves, **points, "vertical": vertical, "forward": forward, "moment": moment, "cop": cop}

    def _roll_foot(self, size: float) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Return travel and height of the ankle [m] over the phase of one stride, as (phase, value)."""
        phase = np.linspace(0.0, 1.0, 401)
        curves = self.compute_curves(phase - 1e-9)
        pitch = np.radians(curves[SHANK] - curves[ANKLE])
        points = size * np.array([[HEEL_X, SOLE_Z], [TOE_X, SOLE_Z]])
        heights = [-(-x * np.sin(pitch) + z * np.cos(pitch)) for x, z in points]
        ground = np.maximum(*heights)
        pivot = np.where(heights[0] > heights[1], points[0, 0], points[1, 0])
        offsets = [-(x * np.cos(pitch) + z * np.sin(pitch)) for x, z in points]
        x = np.zeros(len(phase))
        for k in range(1, len(phase)):
            which = 0 if pivot[k] == points[0, 0] else 1
            x[k] = x[k - 1] + offsets[which][k] - offsets[which][k - 1]
        in_swing = phase > self.toe_off
        first = int(np.argmax(in_swing)) if in_swing.any() else len(phase) - 1
        fraction = np.clip((phase - phase[first]) / (1.0 - phase[first] + 1e-9), 0.0, 1.0)
        smooth = fraction**3 * (10.0 - 15.0 * fraction + 6.0 * fraction**2)
        stride = self.speed * self.stride_time
        travel = np.where(in_swing, x[first] + (stride - x[first]) * smooth, x)
        lift = ground[first] + (ground[-1] - ground[first]) * smooth + 0.05 * size * np.sin(np.pi * fraction)
        height = np.where(in_swing, np.maximum(lift, ground + 0.01 * np.sin(np.pi * fraction)), ground)
        return (phase, travel), (phase, height)


def create_runner() -> Walker:
    """Return a runner."""
    toe_off = 0.36

    def in_stance(peak: float, power: float = 1.0) -> Change:
        return lambda p, _: np.where(p < toe_off, peak * np.sin(np.pi * np.clip(p / toe_off, 0.0, 1.0)) ** power, 0.0)

    changes: dict[str, Change] = {
        VERTICAL: in_stance(24.0),
        FORWARD: lambda p, _: np.where(p < toe_off, -3.5 * np.sin(2.0 * np.pi * p / toe_off), 0.0),
        MOMENT: in_stance(2.8, 1.3),
        HIP: lambda p, _: 20.0 + 30.0 * np.cos(2.0 * np.pi * (p - 0.85)),
        KNEE: lambda p, _: (
            25.0 + 15.0 * np.exp(-(((p - 0.16) / 0.07) ** 2)) + 70.0 * np.exp(-(((p - 0.68) / 0.13) ** 2))
        ),
        ANKLE: lambda p, _: np.interp(
            p, [0.0, 0.05, 0.18, 0.38, 0.55, 0.8, 1.0], [5.0, 3.0, 22.0, -22.0, -5.0, 5.0, 5.0]
        ),
    }
    return Walker(stride_time=0.7, speed=3.0, toe_off=toe_off, changes=changes)


def scale(factor: float, offset: float = 0.0) -> Change:
    """Return a change that multiplies samples by ``factor`` and adds ``offset``."""
    return lambda _, values: factor * values + offset


UNUSUAL_WALKERS: Mapping[str, Walker] = {
    "ordinary": Walker(),
    "small woman": Walker(mass=44.0, stature=1.50, stride_time=1.0, speed=1.1),
    "obese man": Walker(mass=150.0, stature=1.80, stride_time=1.25, speed=0.95),
    "child": Walker(mass=25.0, stature=1.25, stride_time=0.85, speed=1.0),
    "slow amputee": Walker(
        stride_time=1.8,
        speed=0.4,
        toe_off=0.70,
        changes={
            **{HIP: scale(0.55, 5.0), KNEE: scale(0.7), SHANK: scale(0.6), ANKLE: scale(0.35, 2.0)},
            **{VERTICAL: scale(0.9), FORWARD: scale(0.3), MOMENT: scale(0.7)},
        },
    ),
    "fast": Walker(stride_time=0.88, speed=2.2, toe_off=0.58, changes={HIP: scale(1.2), FORWARD: scale(1.6)}),
    "runner": create_runner(),
    "uphill": Walker(slope_deg=10.0),
    "downhill": Walker(slope_deg=-10.0),
    "stiff ankle": Walker(changes={ANKLE: lambda p, _: np.where(p < 0.62, 12.0 * np.clip(p, 0.0, 0.62), 4.0)}),
    "toe walker": Walker(changes={ANKLE: scale(0.5, -15.0)}),
    "crutches with half load": Walker(
        changes={VERTICAL: scale(0.47), FORWARD: scale(0.35), MOMENT: scale(0.42)}, speed=0.9, stride_time=1.3
    ),
    "crouch": Walker(changes={KNEE: scale(0.6, 28.0), HIP: scale(0.9, 15.0)}),
    "stiff knee": Walker(changes={KNEE: scale(0.15, 2.0)}),
    "treadmill": Walker(treadmill=True),
    "low sampling rate": Walker(rate=50.0),
    "high sampling rate": Walker(rate=1000.0, seconds=3.0),
}
"""Name -> right gait, ordinary and unusual."""
