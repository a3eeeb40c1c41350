"""Controllers that follow the gait phase: a periodic pressure profile, a constant pressure, or off.

The supply clips the commanded pressure to its range, and the regulator limits its rate. A recording holds the commanded
and the delivered pressure.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from scipy.interpolate import PchipInterpolator

from klute_sim.errors import InputError
from klute_sim.files.limits import PROFILE
from klute_sim.files.lines import read_csv_rows
from klute_sim.files.reading import read_text
from klute_sim.types import Array
from klute_sim.units import BAR

PROFILE_COLUMNS = ("gait_pct", "pressure_bar")
"""Columns of a profile file."""


@runtime_checkable
class PressureController(Protocol):
    """A controller that commands a pressure over the gait cycle."""

    def pressure_at(self, phase: float) -> float:
        """Return the commanded gauge pressure [Pa] at gait ``phase`` (0-1)."""

    def describe(self) -> dict[str, Any]:
        """Return a description of the controller for the provenance of a recording (JSON types)."""


@dataclass(frozen=True)
class ConstantPressure:
    """A constant pressure; 0 is *off*."""

    gauge_pressure: float
    """Gauge pressure [Pa]."""

    def __post_init__(self) -> None:
        """Raise InputError when the pressure is negative or not finite."""
        if not (math.isfinite(self.gauge_pressure) and self.gauge_pressure >= 0.0):
            raise InputError(f"pressure is {self.gauge_pressure / BAR:g} bar; allowed: 0 bar or more")

    def pressure_at(self, phase: float) -> float:
        """Return the constant gauge pressure [Pa]."""
        return self.gauge_pressure

    def describe(self) -> dict[str, Any]:
        """Return a description of the controller for the provenance of a recording (JSON types)."""
        return {"kind": "constant", "pressure_bar": self.gauge_pressure / BAR}


@dataclass(frozen=True)
class PressureProfile:
    """A periodic spline through knots of pressure over gait phase.

    The spline is piecewise cubic and monotone between knots (Fritsch-Carlson), so it never overshoots a knot.
    """

    name: str
    """Name of the profile, such as its file."""
    gait_pct: tuple[float, ...]
    """Gait phases of the knots, increasing, from 0 to below 100 [%]."""
    pressure_bar: tuple[float, ...]
    """Gauge pressure at the knots [bar]."""

    def __post_init__(self) -> None:
        """Raise InputError when the knots are not a periodic profile of pressures."""
        phase, pressure = np.array(self.gait_pct), np.array(self.pressure_bar)
        if len(phase) < 2 or len(phase) != len(pressure):
            raise InputError(
                f"pressure profile {self.name}: needs at least two rows of {' and '.join(PROFILE_COLUMNS)}"
            )
        if not (np.all(np.isfinite(phase)) and np.all(np.diff(phase) > 0) and phase[0] >= 0 and phase[-1] < 100):
            raise InputError(
                f"pressure profile {self.name}: gait_pct must increase, from 0 or more to less than 100; at 100 the "
                "profile repeats"
            )
        if not (np.all(np.isfinite(pressure)) and np.all(pressure >= 0)):
            raise InputError(f"pressure profile {self.name}: pressure_bar must be 0 or more everywhere")

    @cached_property
    def _interpolator(self) -> PchipInterpolator:
        phase, pressure = np.array(self.gait_pct) / 100.0, np.array(self.pressure_bar) * BAR
        # Three cycles give the middle cycle neighbours on both sides, and therefore periodic slopes.
        return PchipInterpolator(np.concatenate([phase - 1.0, phase, phase + 1.0]), np.tile(pressure, 3))

    def pressure_at(self, phase: float) -> float:
        """Return the commanded gauge pressure [Pa] at gait ``phase`` (0-1)."""
        return float(self._interpolator(phase % 1.0))

    def pressures_at(self, phase: Array) -> Array:
        """Return the commanded gauge pressures [Pa] at an array of gait phases (0-1)."""
        return np.asarray(self._interpolator(phase % 1.0), dtype=np.float64)

    def describe(self) -> dict[str, Any]:
        """Return a description of the controller for the provenance of a recording (JSON types)."""
        knots = {"gait_pct": list(self.gait_pct), "pressure_bar": list(self.pressure_bar)}
        return {"kind": "profile", "name": self.name, **knots}


def create_off_controller() -> ConstantPressure:
    """Return a controller that never commands pressure."""
    return ConstantPressure(0.0)


def load_default_profile() -> PressureProfile:
    """Return the profile of the package, tuned by hand for the default prosthesis, 75 kg and the default reference."""
    file = resources.files("klute_sim.controllers") / "tuned_profile.csv"
    return parse_profile(file.read_text("utf-8"), "tuned_profile.csv")


def load_profile(path: str | Path) -> PressureProfile:
    """Return the profile in a CSV file with the columns gait_pct and pressure_bar.

    Raises InputError when the file cannot be read or is not a profile.
    """
    return parse_profile(read_text(path, PROFILE), str(path))


def parse_profile(text: str, source: str) -> PressureProfile:
    """Return the profile in CSV ``text``; ``source`` names the file in errors."""
    rows = read_csv_rows(text, f"pressure profile {source}")
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
    """Return ``profile`` as a CSV file for ``klute-sim gait --controller``."""
    rows = [f"{phase:g},{bar:g}" for phase, bar in zip(profile.gait_pct, profile.pressure_bar, strict=True)]
    return "\n".join([",".join(PROFILE_COLUMNS), *rows]) + "\n"
