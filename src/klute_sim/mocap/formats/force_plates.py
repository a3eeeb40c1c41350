"""Force plates of types 1 to 4 of C3D: force and centre of pressure in the laboratory frame from the raw channels.

The readings of the unloaded plate are subtracted from the channels before the centre of pressure is computed: a plate
that was not zeroed has offsets of the moments, too, and 20 N.m move the centre of pressure under 70 kg by 30 mm.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from klute_sim.datasets.foot_load import find_unloaded_samples
from klute_sim.errors import InputError
from klute_sim.mocap.formats.trc import LENGTH_UNITS
from klute_sim.types import Array

N_CHANNELS = {1: 6, 2: 6, 3: 8, 4: 6}
"""Supported type -> number of channels."""
FORCE_UNITS = {"N": 1.0, "kN": 1e3}
"""Force unit in the file -> newtons."""
MOMENT_UNITS = {"nmm": 1e-3, "ncm": 1e-2, "nm": 1.0, "knm": 1e3}
"""Moment unit in the file, in lower case and without separators -> newton metres."""
MIN_COP_FORCE = 1.0
"""Smallest force on the plate [N] with a centre of pressure (assumed)."""


@dataclass(frozen=True, eq=False)
class ForcePlate:
    """Samples of one force plate in the laboratory frame."""

    time: Array
    """Sample times (n,) [s]."""
    force: Array
    """Force on the body or on the plate, as the file has it (n, 3) [N]."""
    cop: Array
    """Centre of pressure (n, 3) [m]; NaN while the plate is not loaded."""
    offset: Array
    """Force (3,) [N] of the unloaded plate, which was subtracted."""


@dataclass(frozen=True, eq=False)
class RawPlate:
    """One force plate as a C3D file describes it."""

    plate_type: int
    """Type of the plate in the sense of the format."""
    channels: Array
    """Samples (channels, n) in the units of the file."""
    units: Sequence[str]
    """Unit of each channel; '' if the file does not state it."""
    corners: Array
    """Corners (3, 4) in the laboratory frame [m]."""
    origin: Array
    """Vector (3,) of the format's ORIGIN [m]."""
    calibration: Array
    """Matrix (6, 6) of type 4; empty if the file has none."""
    cop_polynomial: Array
    """Kistler's 12 coefficients of type 3, for lengths in the unit of the markers; empty if the file has none."""


def convert(plate: RawPlate, time: Array, force_unit: float, length_unit: float, name: str) -> ForcePlate:
    """Return the force and the centre of pressure of ``plate``, called ``name`` in error messages.

    ``force_unit`` [N] is that of channels without a known unit, ``length_unit`` [m] that of the markers. Raises
    InputError for an unsupported type and incomplete parameters.
    """
    rotation = _compute_rotation(plate.corners, name)
    center = plate.corners.mean(axis=1)
    origin = _orient_origin(plate)
    loads = _scale_channels(plate, force_unit, length_unit, name)
    # Channels 4 and 5 of a plate of type 1 are the centre of pressure.
    is_force = slice(0, 3) if plate.plate_type == 1 else slice(None)
    vertical = loads[2] if plate.plate_type != 3 else loads[4:].sum(axis=0)
    sign = -1.0 if -vertical.min() > vertical.max() else 1.0
    is_unloaded = find_unloaded_samples(sign * vertical)
    readings = np.median(loads[:, is_unloaded], axis=1) if is_unloaded.any() else np.zeros(len(loads))
    loads[is_force] -= readings[is_force, None]
    force = _compute_force(plate.plate_type, loads)
    is_loaded = np.abs(force[2]) > MIN_COP_FORCE
    center_x, center_y = np.full((2, force.shape[1]), np.nan)
    if plate.plate_type == 1:
        center_x[is_loaded], center_y[is_loaded] = loads[3:5, is_loaded]
    else:
        moment = _compute_moment(plate.plate_type, loads, force, origin)
        center_x[is_loaded] = -moment[1, is_loaded] / force[2, is_loaded]
        center_y[is_loaded] = moment[0, is_loaded] / force[2, is_loaded]
    if plate.plate_type == 3 and plate.cop_polynomial.size == 12:
        center_x, center_y = _correct_center(center_x, center_y, plate.cop_polynomial, length_unit)
    cop = rotation @ np.stack([center_x, center_y, np.zeros(len(center_x))]) + center[:, None]
    offset = rotation @ _compute_force(plate.plate_type, readings[:, None])[:, 0]
    return ForcePlate(time, (rotation @ force).T, cop.T, offset)


def _compute_rotation(corners: Array, name: str) -> Array:
    """Return the axes of the plate, as columns (3, 3) in the laboratory frame."""
    along = corners[:, 0] - corners[:, 1]
    normal = np.cross(along, corners[:, 0] - corners[:, 3])
    axes = np.stack([along, np.cross(normal, along), normal], axis=1)
    lengths = np.linalg.norm(axes, axis=0)
    if not (np.isfinite(lengths).all() and lengths.all()):
        raise InputError(f"{name} has no area: its four CORNERS must form a rectangle")
    return np.asarray(axes / lengths)


def _orient_origin(plate: RawPlate) -> Array:
    """Return the vector [m] from the sensors of ``plate`` to its surface, with z down; files differ in its sign.

    The first two numbers of type 3 are distances between sensors and axes.
    """
    if plate.plate_type == 3:
        return np.asarray(np.abs(plate.origin) * [1.0, 1.0, -1.0])
    return -plate.origin if plate.origin[2] > 0.0 else plate.origin


def _scale_channels(plate: RawPlate, force_unit: float, length_unit: float, name: str) -> Array:
    """Return the channels (channels, n) in N, N.m and m."""
    n_channels = N_CHANNELS.get(plate.plate_type)
    if n_channels is None:
        raise InputError(f"{name} is of type {plate.plate_type}; supported are {', '.join(map(str, N_CHANNELS))}")
    if len(plate.channels) < n_channels:
        raise InputError(f"{name} has {len(plate.channels)} channels; type {plate.plate_type} needs {n_channels}")
    if plate.plate_type == 4:  # the matrix turns any unit into that of forces and lengths
        matrix = plate.calibration if plate.calibration.size else np.eye(6)
        if matrix.shape != (6, 6):
            raise InputError(f"{name} of type 4 needs a CAL_MATRIX of 6 by 6 numbers")
        units = np.repeat([force_unit, force_unit * length_unit], 3)
        return np.asarray(units[:, None] * (matrix @ plate.channels[:6]))
    kinds = {1: "fffllm", 2: "fffmmm", 3: "ffffffff"}[plate.plate_type]
    fallbacks = {"f": force_unit, "m": force_unit * length_unit, "l": length_unit}
    factors = [_get_factor(unit, kind, fallbacks[kind]) for unit, kind in zip(plate.units, kinds, strict=False)]
    return np.array(factors)[:, None] * plate.channels[:n_channels]


def _get_factor(unit: str, kind: str, fallback: float) -> float:
    """Return the factor to SI of ``unit`` of a force (f), moment (m) or length (l); ``fallback`` if it is unknown."""
    if kind == "f":
        return FORCE_UNITS.get(unit, fallback)
    plain = "".join(c for c in unit.lower() if c.isalpha())
    return MOMENT_UNITS.get(plain, fallback) if kind == "m" else LENGTH_UNITS.get(plain, fallback)


def _compute_force(plate_type: int, loads: Array) -> Array:
    """Return the force (3, n) [N] in the axes of the plate."""
    if plate_type != 3:
        return loads[:3]
    return np.stack([loads[0] + loads[1], loads[2] + loads[3], loads[4:8].sum(axis=0)])


def _compute_moment(plate_type: int, loads: Array, force: Array, origin: Array) -> Array:
    """Return the moment (3, n) [N.m] about the middle of the plate's surface, in the axes of the plate."""
    if plate_type != 3:
        return np.asarray(loads[3:6] + np.cross(force, origin, axisa=0, axisc=0))
    x1, x2, y1, y2, z1, z2, z3, z4 = loads
    moment = np.stack(
        [
            origin[1] * (z1 + z2 - z3 - z4),
            origin[0] * (z2 + z3 - z1 - z4),
            origin[1] * (x2 - x1) + origin[0] * (y1 - y2),
        ]
    )
    return np.asarray(moment + np.cross(force, [0.0, 0.0, origin[2]], axisa=0, axisc=0))


def _correct_center(x: Array, y: Array, coefficients: Array, length_unit: float) -> tuple[Array, Array]:
    """Return the centre of pressure (n,) [m] after Kistler's correction for the bending of the plate."""
    x, y, a = x / length_unit, y / length_unit, coefficients
    shift_x = (a[0] * y**4 + a[1] * y**2 + a[2]) * x**3 + (a[3] * y**4 + a[4] * y**2 + a[5]) * x
    shift_y = (a[6] * x**4 + a[7] * x**2 + a[8]) * y**3 + (a[9] * x**4 + a[10] * x**2 + a[11]) * y
    return length_unit * (x - shift_x), length_unit * (y - shift_y)
