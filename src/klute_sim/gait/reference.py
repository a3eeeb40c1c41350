"""Normative human gait over one cycle, from heel strike to heel strike: the reference of the gait rig.

The default reference is the mean of three published groups of able-bodied adults who walk on level ground at
comfortable speed: Winter (normal cadence, 19 adults), Bovi et al. 2011 (free speed, 20 adults) and Fukuchi et al. 2018
(1.2 m/s, 42 adults). Ankle power is from the first two; the standard deviations between subjects are from Winter. The
peak moments of the sources range from 1.32 to 1.63 N.m/kg, toe-off from 59 to 67 %.
"""

import hashlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from klute_sim.constants import GRAVITY
from klute_sim.errors import InputError
from klute_sim.files.limits import REFERENCE
from klute_sim.files.lines import read_csv_rows
from klute_sim.files.reading import NotTextError, read_text
from klute_sim.gait import reference_folder
from klute_sim.plausibility.finding import Finding, require_accepted
from klute_sim.plausibility.gait.body import describe_other_unit
from klute_sim.plausibility.gait.cycle import find_cycle_findings
from klute_sim.plausibility.gait.shapes import resample_cycle
from klute_sim.types import Array

DEFAULT_NAME = "able-bodied adults (Winter; Bovi et al. 2011; Fukuchi et al. 2018)"
"""Name of the default reference."""
DEFAULT_FILE = "normative_gait.csv"
"""File of the default reference in this package."""
DEFAULT_STRIDE_TIME = 1.10
"""Stride time [s] of the default reference; it reproduces power from moment and angle."""

PHASE_COLUMN = "gait_pct"
"""Column of the gait phase [%]."""
REQUIRED_COLUMNS = (
    "hip_flexion_deg",
    "knee_flexion_deg",
    "ankle_dorsiflexion_deg",
    "shank_forward_deg",
    "ankle_plantarflexor_moment_nm_per_kg",
    "ankle_power_w_per_kg",
    "grf_vertical_n_per_kg",
    "grf_forward_n_per_kg",
)
"""Columns that a reference file must have."""
DEVIATION_COLUMNS = ("ankle_dorsiflexion_sd_deg", "ankle_moment_sd_nm_per_kg", "ankle_power_sd_w_per_kg")
"""Optional columns with standard deviations."""

MAX_PELVIS_RANGE_DEG = 30.0
"""Maximum range of shank - (knee - hip) over the cycle [deg]; the pelvis tilts by a few degrees."""
MAX_MAGNITUDE = 1e4
"""Maximum absolute value of a column, in its unit (assumed)."""
MIN_PHASE_SPACING_PCT = 1e-3
"""Minimum distance of two rows [% of the cycle] (assumed)."""
MAX_CLOSURE_FRACTION = 0.15
"""Maximum difference of the two ends of a column, over its range, for a periodic stride."""
MOTION_CAPTURE_SUFFIXES = {".c3d", ".parquet"}
"""Suffixes of binary files that ``klute-sim import`` turns into a reference."""
STANCE_LOAD_BW = 0.02
"""Vertical ground reaction above which the foot counts as loaded [body weights]."""
MAX_GRF_TRACKING_RMS_BW = 0.05
"""Largest rms difference [body weights] in stance between the vertical ground reaction of a gait run and the reference
for which the load counts as tracked; the default gait run has 0.01.
"""


@dataclass(frozen=True)
class Reference:
    """A gait cycle as periodic splines over gait phase (0-1)."""

    name: str
    """Name of the reference: its file or folder, or :data:`DEFAULT_NAME`."""
    digest: str
    """SHA-256 of the file."""
    splines: Mapping[str, CubicSpline]
    """Periodic spline by column, in the unit of the column."""
    ranges: Mapping[str, tuple[float, float]]
    """Minimum and maximum of the rows of the file, by column."""
    stride_time: float = DEFAULT_STRIDE_TIME
    """Stride time [s]."""
    mass: float | None = None
    """Body mass of the subject [kg]; None: unknown."""
    stature: float | None = None
    """Body height of the subject [m]; None: unknown."""
    speed: float | None = None
    """Measured walking speed [m/s]; None: unknown. The rig computes its speed from angles, legs and stride time."""
    accepted: tuple[Finding, ...] = ()
    """Implausible properties that the user accepts."""
    assumed_deviations: tuple[str, ...] = ()
    """Columns of standard deviations that are assumed, at every speed and on every slope."""

    def __call__(self, column: str, phase: Array, derivative: int = 0) -> Array:
        """Return ``column``, or its ``derivative``-th derivative by phase, at ``phase`` (0-1, periodic)."""
        return np.asarray(self.splines[column](phase, derivative), dtype=np.float64)

    def describe(self) -> dict[str, Any]:
        """Return name, digest and numbers in JSON types, for result folders."""
        return {
            "name": self.name,
            "sha256": self.digest,
            "stride_time_s": self.stride_time,
            "mass_kg": self.mass,
            "stature_m": self.stature,
            "assumed_deviations": list(self.assumed_deviations),
        }

    def has_column(self, column: str) -> bool:
        """Return whether the reference has the optional ``column``."""
        return column in self.splines

    def compute_standard_deviation(self, column: str, phase: Array) -> Array:
        """Return the standard deviation ``column`` at ``phase``; interpolation cannot make it negative."""
        minimum, _ = self.ranges[column]
        return np.maximum(self(column, phase), minimum)

    def tilt_to_slope(self, slope: float) -> "Reference":
        """Return the same gait in the frame of ground with a ``slope`` [rad], uphill positive.

        Gait on slopes is assumed, not measured: the segments keep their inclination to gravity, the foot follows the
        ground, so the ankle compensates the slope, and the ground reaction keeps its magnitude and its inclination to
        gravity.
        """
        if slope == 0.0:
            return self
        tilt, sine, cosine = np.degrees(slope), np.sin(slope), np.cos(slope)
        vertical, forward = (self.splines[column] for column in ("grf_vertical_n_per_kg", "grf_forward_n_per_kg"))
        tilted = {
            "shank_forward_deg": _offset_spline(self.splines["shank_forward_deg"], tilt),
            "ankle_dorsiflexion_deg": _offset_spline(self.splines["ankle_dorsiflexion_deg"], tilt),
            "hip_flexion_deg": _offset_spline(self.splines["hip_flexion_deg"], -tilt),
            "grf_vertical_n_per_kg": _combine_splines(cosine, vertical, -sine, forward),
            "grf_forward_n_per_kg": _combine_splines(cosine, forward, sine, vertical),
        }
        # Standard deviations measured on level ground do not hold on a slope.
        level_only = set(DEVIATION_COLUMNS) - set(self.assumed_deviations)
        unchanged = {name: spline for name, spline in self.splines.items() if name not in level_only}
        return replace(self, splines=unchanged | tilted)

    def find_toe_off_phase(self) -> float:
        """Return the gait phase (0-1) of toe-off, where the load falls below :data:`STANCE_LOAD_BW`."""
        phase = np.arange(0.0, 1.0, 0.001)
        loaded = self("grf_vertical_n_per_kg", phase) > STANCE_LOAD_BW * GRAVITY
        swing = (phase > 0.5) & ~loaded  # in the first half, the load may dip between its two peaks
        return float(phase[np.argmax(swing)])


def _offset_spline(spline: CubicSpline, offset: float) -> CubicSpline:
    values = spline(spline.x) + offset
    values[-1] = values[0]
    return CubicSpline(spline.x, values, bc_type="periodic")


def _combine_splines(weight_a: float, spline_a: CubicSpline, weight_b: float, spline_b: CubicSpline) -> CubicSpline:
    """Return a weighted sum of two splines, which have the same knots and whose ends are equal up to rounding."""
    values = weight_a * spline_a(spline_a.x) + weight_b * spline_b(spline_a.x)
    values[-1] = values[0]
    return CubicSpline(spline_a.x, values, bc_type="periodic")


@cache
def load_default_reference() -> Reference:
    """Return the default reference."""
    return replace(parse_reference(_read_default_text(), DEFAULT_FILE), name=DEFAULT_NAME)


@cache
def _read_default_text() -> str:
    return (resources.files("klute_sim.gait") / DEFAULT_FILE).read_text("utf-8")


def load_reference(path: str | Path, stride_time: float | None = None, accept: Collection[str] = ()) -> Reference:
    """Return the reference in a CSV file, or in a folder of ``klute-sim import``.

    ``stride_time`` [s] is by default that of the folder, or :data:`DEFAULT_STRIDE_TIME` for a CSV file. ``accept``
    names findings that are right although they look implausible; those that the import accepted are in the folder.

    Raises InputError when the file cannot be read or is not a reference, ImplausibleInputError when it holds something
    implausible.
    """
    metadata, folder_name = None, Path(path).absolute().name
    if Path(path).is_dir():
        path, metadata = reference_folder.read_reference_folder(Path(path))
    if stride_time is None:
        stride_time = DEFAULT_STRIDE_TIME if metadata is None else metadata.stride_time
    check_stride_time(stride_time)
    try:
        text = read_text(path, REFERENCE)
    except NotTextError:
        reason = "not a UTF-8 text file"
        if Path(path).suffix.lower() in MOTION_CAPTURE_SUFFIXES:
            reason += f"; import it first: klute-sim import {path} --mass KG --out me, and give the folder 'me'"
        if Path(path).with_name(reference_folder.METADATA_FILE).is_file():
            reason = f"the file holds single strides; give its folder instead: {Path(path).parent}"
        raise InputError(f"reference {path} cannot be read: {reason}") from None
    accepted = accept if metadata is None else {*accept, *metadata.accepted}
    reference = parse_reference(text, str(path), stride_time, accepted)
    if metadata is None:
        return reference
    return replace(reference, name=folder_name, mass=metadata.mass, stature=metadata.stature, speed=metadata.speed)


def check_stride_time(stride_time: float) -> None:
    """Raise InputError when ``stride_time`` [s] is out of range."""
    if not 0.5 <= stride_time <= 3.0:
        hint = describe_other_unit("stride time", stride_time)
        raise InputError(f"stride time is {stride_time:g}; allowed: 0.5 to 3 s{hint}")


def parse_reference(
    text: str, source: str, stride_time: float = DEFAULT_STRIDE_TIME, accept: Collection[str] = ()
) -> Reference:
    """Return the reference in CSV ``text``, with stride time ``stride_time`` [s]; ``source`` names it in errors.

    ``accept`` names findings that are right although they look implausible.
    """
    phase, columns = _parse_phase_and_columns(text, source)
    findings = find_cycle_findings(phase, columns, _get_typical_curves(), f"reference {source}")
    accepted = require_accepted(findings, accept)
    return replace(_fit_reference(phase, columns, text, source, stride_time), accepted=accepted)


@cache
def _get_typical_curves() -> Mapping[str, Array]:
    phase, columns = _parse_phase_and_columns(_read_default_text(), DEFAULT_FILE)
    return {name: resample_cycle(phase, columns[name]) for name in REQUIRED_COLUMNS}


def _parse_phase_and_columns(text: str, source: str) -> tuple[Array, dict[str, Array]]:
    """Return the gait phase [%] and the other columns of CSV ``text``."""
    columns = _parse_columns(text, source)
    phase = columns.pop(PHASE_COLUMN)
    if phase[0] != 0.0 or phase[-1] != 100.0 or not np.all(np.diff(phase) >= MIN_PHASE_SPACING_PCT):
        hint = "; it looks like a fraction, so multiply it by 100" if phase[0] == 0.0 and phase[-1] == 1.0 else ""
        raise InputError(
            f"reference {source}: {PHASE_COLUMN} must increase from 0 to 100, by {MIN_PHASE_SPACING_PCT:g} or more "
            f"from row to row, but runs from {phase[0]:g} to {phase[-1]:g}{hint}"
        )
    return phase, columns


def _fit_reference(phase: Array, columns: Mapping[str, Array], text: str, source: str, stride_time: float) -> Reference:
    splines, ranges = {}, {}
    for name, values in columns.items():
        splines[name] = _fit_periodic_spline(name, phase / 100.0, values, source)
        ranges[name] = (float(values.min()), float(values.max()))
    peak_load = float(columns["grf_vertical_n_per_kg"].max())
    if not 0.3 * GRAVITY < peak_load < 5.0 * GRAVITY:
        raise InputError(
            f"reference {source}: grf_vertical_n_per_kg peaks at {peak_load:.3g}; allowed: "
            f"{0.3 * GRAVITY:.1f} to {5.0 * GRAVITY:.1f} N/kg, up positive"
        )
    swing_load = columns["grf_vertical_n_per_kg"][(phase > 60.0) & (phase < 95.0)]
    if not (swing_load < STANCE_LOAD_BW * GRAVITY).any():
        raise InputError(
            f"reference {source}: grf_vertical_n_per_kg never falls below {STANCE_LOAD_BW * GRAVITY:.2f} N/kg in "
            "swing; subtract the offset of the force plate"
        )
    _check_segments(columns, source)
    return Reference(Path(source).name, hashlib.sha256(text.encode()).hexdigest(), splines, ranges, stride_time)


def _check_segments(columns: Mapping[str, Array], source: str) -> None:
    """Raise InputError when the inclination of the shank contradicts knee and hip, as with a wrong sign."""
    pelvis_angle = columns["shank_forward_deg"] - (columns["knee_flexion_deg"] - columns["hip_flexion_deg"])
    if np.ptp(pelvis_angle) > MAX_PELVIS_RANGE_DEG:
        raise InputError(
            f"reference {source}: shank_forward_deg - (knee_flexion_deg - hip_flexion_deg) varies by "
            f"{np.ptp(pelvis_angle):.0f} degrees over the cycle; allowed: up to "
            f"{MAX_PELVIS_RANGE_DEG:g}; check the signs"
        )


def _parse_columns(text: str, source: str) -> dict[str, Array]:
    rows = read_csv_rows(text, f"reference {source}")
    if len(rows) < 10:
        raise InputError(f"reference {source}: needs a heading and at least 9 rows")
    heading = [name.strip() for name in rows[0][1]]
    for name in (PHASE_COLUMN, *REQUIRED_COLUMNS):
        if name not in heading:
            raise InputError(
                f"reference {source}: column '{name}' is missing; if the file has other headings or units, create a "
                "reference with klute-sim import FILE --out FOLDER and pass that folder"
            )
    names = [n for n in (PHASE_COLUMN, *REQUIRED_COLUMNS, *DEVIATION_COLUMNS) if n in heading]
    columns: dict[str, Array] = {name: np.empty(len(rows) - 1) for name in names}
    for index, (number, row) in enumerate(rows[1:]):
        if len(row) != len(heading):
            raise InputError(f"reference {source}: row {number} has {len(row)} cells, the heading {len(heading)}")
        for name in names:
            cell = row[heading.index(name)]
            try:
                value = float(cell)
            except ValueError:
                value = np.nan
            if not abs(value) <= MAX_MAGNITUDE:
                raise InputError(
                    f"reference {source}: column '{name}', row {number}: '{cell}' is not a number from "
                    f"-{MAX_MAGNITUDE:g} to {MAX_MAGNITUDE:g}{_describe_excess(value)}"
                )
            columns[name][index] = value
    for name in DEVIATION_COLUMNS:
        if name in columns and columns[name].min() < 0:
            raise InputError(f"reference {source}: column '{name}' is negative; allowed: 0 or more")
    return columns


def _describe_excess(value: float) -> str:
    """Return a clause on what a number beyond :data:`MAX_MAGNITUDE` may be; '' for no number."""
    if not np.isfinite(value):
        return ""
    return "; is it a code for a missing value?" if abs(value) > 1e7 else "; is it in another unit, such as N·mm?"


def _fit_periodic_spline(name: str, phase: Array, values: Array, source: str) -> CubicSpline:
    """Return a periodic cubic spline through measured values whose two ends nearly agree.

    The mismatch of an angle is distributed over the cycle, which keeps its rate smooth. The mismatch of a load is
    removed at the two ends only, because a load must stay zero in swing.
    """
    mismatch = values[-1] - values[0]
    value_range = float(np.ptp(values))
    if abs(mismatch) > MAX_CLOSURE_FRACTION * value_range and value_range > 0:
        raise InputError(
            f"reference {source}: column '{name}' is not periodic: {values[0]:g} at 0 %, {values[-1]:g} at 100 %"
        )
    closed = values.copy()
    if name.endswith("_deg"):
        closed -= mismatch * phase
        closed[-1] = closed[0]
    else:
        closed[0] = closed[-1] = 0.5 * (values[0] + values[-1])
    return CubicSpline(phase, closed, bc_type="periodic")
