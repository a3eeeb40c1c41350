"""Pressure over gait phase: a periodic profile, a constant, or off.

A controller commands; the supply clips the command to what it has and the regulator limits its rate. Commanded
and delivered pressure are recorded side by side.
"""

import csv
import io
import math
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from klute_sim.errors import InputError
from klute_sim.units import BAR

PROFILE_COLUMNS = ("gait_pct", "pressure_bar")


@runtime_checkable
class PressureController(Protocol):
    """Anything that commands pressure over the gait cycle."""

    def pressure_at(self, phase: float) -> float:
        """Commanded gauge pressure [Pa] at ``phase`` of the cycle (0-1)."""

    def describe(self) -> dict[str, Any]:
        """What this controller is, for a recording's provenance (JSON types)."""


@dataclass(frozen=True)
class ConstantPressure:
    """The same pressure all the time; 0 is *off*."""

    gauge_pressure: float
    """Gauge pressure [Pa]."""

    def __post_init__(self) -> None:
        """Raise InputError for a pressure that is negative or not finite."""
        if not (math.isfinite(self.gauge_pressure) and self.gauge_pressure >= 0.0):
            raise InputError(f"pressure is {self.gauge_pressure / BAR:g} bar; allowed: 0 bar or more")

    def pressure_at(self, phase: float) -> float:
        """See :class:`PressureController`."""
        return self.gauge_pressure

    def describe(self) -> dict[str, Any]:
        """See :class:`PressureController`."""
        return {"kind": "constant", "pressure_bar": self.gauge_pressure / BAR}


@dataclass(frozen=True)
class PressureProfile:
    """A periodic spline through knots of pressure over phase.

    Piecewise cubic and monotone between knots (Fritsch-Carlson), so that it never overshoots what was set.
    """

    name: str
    gait_pct: tuple[float, ...]
    """Phases of the knots, rising, from 0 to below 100 [%]."""
    pressure_bar: tuple[float, ...]
    """Gauge pressure at the knots [bar]."""

    def __post_init__(self) -> None:
        """Raise InputError for knots that are no periodic profile of pressures."""
        phase, pressure = np.array(self.gait_pct), np.array(self.pressure_bar)
        if len(phase) < 2 or len(phase) != len(pressure):
            raise InputError(
                f"pressure profile {self.name}: needs at least two rows of {' and '.join(PROFILE_COLUMNS)}"
            )
        if not (np.all(np.isfinite(phase)) and np.all(np.diff(phase) > 0) and phase[0] >= 0 and phase[-1] < 100):
            raise InputError(
                f"pressure profile {self.name}: gait_pct must rise, from 0 or more to less than 100; at 100 the "
                "profile begins again"
            )
        if not (np.all(np.isfinite(pressure)) and np.all(pressure >= 0)):
            raise InputError(f"pressure profile {self.name}: pressure_bar must be 0 or more everywhere")

    @cached_property
    def _interpolator(self) -> PchipInterpolator:
        phase, pressure = np.array(self.gait_pct) / 100.0, np.array(self.pressure_bar) * BAR
        # Three cycles, so that the middle one has its neighbours on both sides: periodic slopes.
        return PchipInterpolator(np.concatenate([phase - 1.0, phase, phase + 1.0]), np.tile(pressure, 3))

    def pressure_at(self, phase: float) -> float:
        """See :class:`PressureController`."""
        return float(self._interpolator(phase % 1.0))

    def pressures_at(self, phase: NDArray[np.float64]) -> NDArray[np.float64]:
        """Commanded gauge pressure [Pa] at many phases of the cycle (0-1)."""
        return np.asarray(self._interpolator(phase % 1.0), dtype=np.float64)

    def describe(self) -> dict[str, Any]:
        """See :class:`PressureController`."""
        knots = {"gait_pct": list(self.gait_pct), "pressure_bar": list(self.pressure_bar)}
        return {"kind": "profile", "name": self.name, **knots}


def create_off_controller() -> ConstantPressure:
    """No pressure at any time."""
    return ConstantPressure(0.0)


def load_default_profile() -> PressureProfile:
    """The shipped profile, tuned by hand for the default prosthesis, 75 kg and the package's reference."""
    file = resources.files("klute_sim.controllers") / "tuned_profile.csv"
    return parse_profile(file.read_text("utf-8"), "tuned_profile.csv")


def load_profile(path: str | Path) -> PressureProfile:
    """The profile in a CSV file with columns gait_pct and pressure_bar; raises InputError."""
    try:
        text = Path(path).read_text("utf-8-sig")  # spreadsheets put a mark in front
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a UTF-8 text file"
        raise InputError(f"pressure profile {path} cannot be read: {reason}") from None
    return parse_profile(text, str(path))


def parse_profile(text: str, source: str) -> PressureProfile:
    """The profile that CSV ``text`` holds; ``where`` names it in errors."""
    try:
        rows = [(number, row) for number, row in enumerate(csv.reader(io.StringIO(text)), start=1) if row]
    except csv.Error as error:
        raise InputError(f"pressure profile {source} is no CSV file: {error}") from None
    if not rows or tuple(cell.strip() for cell in rows[0][1]) != PROFILE_COLUMNS:
        raise InputError(f"pressure profile {source}: the heading must be '{','.join(PROFILE_COLUMNS)}'")
    knots = []
    for number, row in rows[1:]:
        try:
            phase, pressure = (float(cell) for cell in row)
        except ValueError:
            raise InputError(f"pressure profile {source}: row {number} is not two numbers") from None
        knots.append((phase, pressure))
    return PressureProfile(Path(source).name, tuple(k[0] for k in knots), tuple(k[1] for k in knots))


def profile_to_csv(profile: PressureProfile) -> str:
    """``profile`` as the CSV file that ``klute-sim gait --controller`` takes."""
    rows = [f"{phase:g},{bar:g}" for phase, bar in zip(profile.gait_pct, profile.pressure_bar, strict=True)]
    return "\n".join([",".join(PROFILE_COLUMNS), *rows]) + "\n"
