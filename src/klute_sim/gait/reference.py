"""Measured human gait over one cycle, heel strike to heel strike: what the rig follows and is compared with.

The package's own reference is the mean of three published able-bodied adult groups walking level at
comfortable speed: Winter (normal cadence, 19 adults), Bovi et al. 2011 (free speed, 20 adults) and Fukuchi et
al. 2018 (1.2 m/s, 42 adults); ankle power is from the first two, standard deviations are Winter's, between
subjects. The sources' peak moments run from 1.32 to 1.63 N.m/kg and toe-off from 59 to 67 %.
"""

import csv
import hashlib
import io
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from klute_sim.errors import InputError
from klute_sim.gait import reference_folder
from klute_sim.recording.recording import Array

GRAVITY = 9.81
"""Acceleration of gravity [m/s2], as in the models; body weights are in its terms."""
DEFAULT_STRIDE_TIME = 1.10
"""Stride time [s] that goes with the package's reference: it reproduces power from moment and angle."""

PHASE_COLUMN = "gait_pct"
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
DEVIATION_COLUMNS = ("ankle_dorsiflexion_sd_deg", "ankle_moment_sd_nm_per_kg", "ankle_power_sd_w_per_kg")

MAX_PELVIS_RANGE_DEG = 30.0
"""Most that shank minus (knee minus hip) may vary over the cycle [deg]; the pelvis tilts by a few degrees."""
MAX_MAGNITUDE = 1e4
"""No number of a gait cycle, in the units of a reference, is larger (assumed)."""
MIN_PHASE_SPACING_PCT = 1e-3
"""Rows are no closer [% of the cycle] (assumed)."""
MAX_CLOSURE_FRACTION = 0.15
"""Largest mismatch of a column's two ends, over its range, that is still taken for one periodic stride."""
MOTION_CAPTURE_SUFFIXES = {".c3d", ".parquet"}
"""Endings of files that ``klute-sim import`` makes a reference of, and that are no text."""
STANCE_LOAD_BW = 0.02
"""Vertical ground reaction, in body weights, above which the foot counts as loaded."""


@dataclass(frozen=True)
class Reference:
    """A gait cycle as periodic splines over phase (0-1)."""

    name: str
    digest: str
    """SHA-256 of the file."""
    splines: Mapping[str, CubicSpline]
    """Column -> periodic spline, in the column's units."""
    ranges: Mapping[str, tuple[float, float]]
    """Column -> smallest and largest value at the rows of the file."""
    stride_time: float = DEFAULT_STRIDE_TIME
    """Stride time [s] the reference was walked at."""
    mass: float | None = None
    """Of the walker [kg], where a reference folder states it."""
    stature: float | None = None
    """Of the walker [m], likewise."""
    speed: float | None = None
    """That the walker had [m/s], likewise; the rig's follows from angles, legs and stride time."""

    def __call__(self, column: str, phase: Array, derivative: int = 0) -> Array:
        """``column``, or its ``order``-th derivative by phase, at ``phase`` (0-1, periodic)."""
        return np.asarray(self.splines[column](phase, derivative), dtype=np.float64)

    def has_column(self, column: str) -> bool:
        """Whether the file had the optional ``column``."""
        return column in self.splines

    def standard_deviation(self, column: str, phase: Array) -> Array:
        """Standard deviation ``column`` at ``phase``; interpolation may not make it negative."""
        lowest, _ = self.ranges[column]
        return np.maximum(self(column, phase), lowest)

    def tilt_to_slope(self, slope: float) -> "Reference":
        """The same gait in the frame of ground that rises by ``slope`` [rad] in the direction of walking.

        Nobody's gait on it was measured: the segments keep their inclination to gravity, the foot keeps to the ground,
        so the ankle makes up for the slope, and the ground reaction is the same in space (assumed).
        """
        if slope == 0.0:
            return self
        tilt, along, across = np.degrees(slope), np.sin(slope), np.cos(slope)
        up, forward = (self.splines[column] for column in ("grf_vertical_n_per_kg", "grf_forward_n_per_kg"))
        turned = {
            "shank_forward_deg": _offset_spline(self.splines["shank_forward_deg"], tilt),
            "ankle_dorsiflexion_deg": _offset_spline(self.splines["ankle_dorsiflexion_deg"], tilt),
            "hip_flexion_deg": _offset_spline(self.splines["hip_flexion_deg"], -tilt),
            "grf_vertical_n_per_kg": _combine_splines(across, up, -along, forward),
            "grf_forward_n_per_kg": _combine_splines(across, forward, along, up),
        }
        kept = {name: spline for name, spline in self.splines.items() if name not in DEVIATION_COLUMNS}
        return replace(self, splines=kept | turned)

    def find_toe_off_phase(self) -> float:
        """Phase (0-1) at which the reference foot leaves the ground (:data:`LOADED`)."""
        phase = np.arange(0.0, 1.0, 0.001)
        loaded = self("grf_vertical_n_per_kg", phase) > STANCE_LOAD_BW * GRAVITY
        swing = (phase > 0.5) & ~loaded  # the first half may dip between the humps
        return float(phase[np.argmax(swing)])


def _offset_spline(spline: CubicSpline, offset: float) -> CubicSpline:
    values = spline(spline.x) + offset
    values[-1] = values[0]
    return CubicSpline(spline.x, values, bc_type="periodic")


def _combine_splines(weight_a: float, spline_a: CubicSpline, weight_b: float, spline_b: CubicSpline) -> CubicSpline:
    """Both splines have the rows of one file for knots; their ends are equal up to rounding."""
    values = weight_a * spline_a(spline_a.x) + weight_b * spline_b(spline_a.x)
    values[-1] = values[0]
    return CubicSpline(spline_a.x, values, bc_type="periodic")


def load_default_reference() -> Reference:
    """The package's reference."""
    file = resources.files("klute_sim.gait") / "normative_gait.csv"
    return parse_reference(file.read_text("utf-8"), "normative_gait.csv")


def load_reference(path: str | Path, stride_time: float | None = None) -> Reference:
    """The reference in a CSV file, or in a folder of ``klute-sim import``, walked at ``stride_time`` [s].

    Left out, that is what the folder states, or :data:`STRIDE_TIME`. Raises InputError with what is wrong, and where.
    """
    stated, folder = None, Path(path).absolute().name
    if Path(path).is_dir():
        path, stated = reference_folder.read_reference_folder(Path(path))
    if stride_time is None:
        stride_time = DEFAULT_STRIDE_TIME if stated is None else stated.stride_time
    if not 0.5 <= stride_time <= 3.0:
        raise InputError(f"stride time is {stride_time:g}; allowed: 0.5 to 3 s")
    try:
        text = Path(path).read_text("utf-8-sig")  # spreadsheets put a mark in front
    except OSError as error:
        raise InputError(f"reference {path} cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        reason = "not a UTF-8 text file"
        if Path(path).suffix.lower() in MOTION_CAPTURE_SUFFIXES:
            reason += f"; import it first: klute-sim import {path} --mass KG --out me, and give the folder 'me'"
        if Path(path).with_name(reference_folder.METADATA_FILE).is_file():
            reason = f"these are its strides; give the folder they are in: {Path(path).parent}"
        raise InputError(f"reference {path} cannot be read: {reason}") from None
    found = parse_reference(text, str(path), stride_time)
    if stated is None:
        return found
    return replace(found, name=folder, mass=stated.mass, stature=stated.stature, speed=stated.speed)


def parse_reference(text: str, source: str, stride_time: float = DEFAULT_STRIDE_TIME) -> Reference:
    """The reference that CSV ``text`` holds, walked at ``stride_time`` [s]; ``where`` names it in errors."""
    columns = _parse_columns(text, source)
    phase = columns.pop(PHASE_COLUMN)
    if phase[0] != 0.0 or phase[-1] != 100.0 or not np.all(np.diff(phase) >= MIN_PHASE_SPACING_PCT):
        raise InputError(
            f"reference {source}: {PHASE_COLUMN} must rise from 0 to 100, by {MIN_PHASE_SPACING_PCT:g} or more from row to row"
        )
    splines, ranges = {}, {}
    for name, values in columns.items():
        splines[name] = _fit_periodic_spline(name, phase / 100.0, values, source)
        ranges[name] = (float(values.min()), float(values.max()))
    weight = float(columns["grf_vertical_n_per_kg"].max())
    if not 0.3 * GRAVITY < weight < 5.0 * GRAVITY:
        raise InputError(
            f"reference {source}: grf_vertical_n_per_kg peaks at {weight:.3g}; walking is near 11 N/kg, up positive"
        )
    late = columns["grf_vertical_n_per_kg"][(phase > 60.0) & (phase < 95.0)]
    if not (late < STANCE_LOAD_BW * GRAVITY).any():
        raise InputError(
            f"reference {source}: grf_vertical_n_per_kg never falls below {STANCE_LOAD_BW * GRAVITY:.2f} N/kg in swing: "
            "take the force plate's offset off"
        )
    _check_segments(columns, source)
    return Reference(Path(source).name, hashlib.sha256(text.encode()).hexdigest(), splines, ranges, stride_time)


def _check_segments(columns: Mapping[str, Array], source: str) -> None:
    """The shank has to lean as knee and hip make it, up to the pelvis: a wrong sign shows here."""
    lean = columns["shank_forward_deg"] - (columns["knee_flexion_deg"] - columns["hip_flexion_deg"])
    if np.ptp(lean) > MAX_PELVIS_RANGE_DEG:
        raise InputError(
            f"reference {source}: shank_forward_deg departs from knee_flexion_deg - hip_flexion_deg by up to "
            f"{np.ptp(lean):.0f} degrees over the cycle; more than {MAX_PELVIS_RANGE_DEG:g} is a wrong sign"
        )


def _parse_columns(text: str, source: str) -> dict[str, Array]:
    try:
        rows = [(number, row) for number, row in enumerate(csv.reader(io.StringIO(text)), start=1) if row]
    except csv.Error as error:
        raise InputError(f"reference {source} is no CSV file: {error}") from None
    if len(rows) < 10:
        raise InputError(f"reference {source}: needs a heading and at least 9 rows over the cycle")
    heading = [name.strip() for name in rows[0][1]]
    for name in (PHASE_COLUMN, *REQUIRED_COLUMNS):
        if name not in heading:
            raise InputError(f"reference {source}: column '{name}' is missing")
    wanted = [n for n in (PHASE_COLUMN, *REQUIRED_COLUMNS, *DEVIATION_COLUMNS) if n in heading]
    columns: dict[str, Array] = {name: np.empty(len(rows) - 1) for name in wanted}
    for index, (number, row) in enumerate(rows[1:]):
        if len(row) != len(heading):
            raise InputError(f"reference {source}: row {number} has {len(row)} cells, the heading {len(heading)}")
        for name in wanted:
            cell = row[heading.index(name)]
            try:
                value = float(cell)
            except ValueError:
                value = np.nan
            if not abs(value) <= MAX_MAGNITUDE:
                raise InputError(
                    f"reference {source}: column '{name}', row {number}: '{cell}' is not a number from -{MAX_MAGNITUDE:g} to "
                    f"{MAX_MAGNITUDE:g}"
                )
            columns[name][index] = value
    for name in DEVIATION_COLUMNS:
        if name in columns and columns[name].min() < 0:
            raise InputError(f"reference {source}: column '{name}' is negative; a standard deviation is not")
    return columns


def _fit_periodic_spline(name: str, phase: Array, values: Array, source: str) -> CubicSpline:
    """Periodic cubic spline through measured values whose two ends nearly agree.

    An angle's mismatch is spread over the cycle, which leaves its rate smooth. A load's is taken up at the two ends
    alone: in swing it is zero and has to stay so.
    """
    mismatch = values[-1] - values[0]
    spread = float(np.ptp(values))
    if abs(mismatch) > MAX_CLOSURE_FRACTION * spread and spread > 0:
        raise InputError(
            f"reference {source}: column '{name}' does not close: {values[0]:g} at 0 %, {values[-1]:g} at 100 %"
        )
    closed = values.copy()
    if name.endswith("_deg"):
        closed -= mismatch * phase
        closed[-1] = closed[0]
    else:
        closed[0] = closed[-1] = 0.5 * (values[0] + values[-1])
    return CubicSpline(phase, closed, bc_type="periodic")
