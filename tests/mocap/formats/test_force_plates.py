"""Force plates of every type under a known force at a known place."""

from dataclasses import replace

import numpy as np
import pytest

from klute_sim.errors import InputError
from klute_sim.mocap.formats import force_plates
from klute_sim.mocap.formats.force_plates import RawPlate
from klute_sim.types import Array

FORCE = np.array([40.0, -90.0, 750.0])
"""Force in the axes of the plate [N]; z points down into the ground."""
CENTER = np.array([0.12, -0.08, 0.0])
"""Centre of pressure in the axes of the plate, from the middle of its surface [m]."""
DEPTH = 0.05
"""Depth of the sensors below the surface [m]."""
ARMS = (0.21, 0.26)
"""Distances of the sensors of a Kistler plate from its middle [m]."""
CORNERS = np.array([[2.0, 5.3, 0.0], [2.0, 4.7, 0.0], [1.6, 4.7, 0.0], [1.6, 5.3, 0.0]]).T
"""The plate's x is the laboratory's y, its y the laboratory's x, and its z points down [m]."""
EXPECTED_FORCE = np.array([FORCE[1], FORCE[0], -FORCE[2]])
EXPECTED_COP = np.array([1.8 + CENTER[1], 5.0 + CENTER[0], 0.0])
TIME = np.arange(100) / 1000.0
STEP = slice(40, 80)
"""Samples with the load; the plate is empty in the others."""


def make_channels(plate_type: int) -> Array:
    """Return what the channels of a plate read under the load, in N, m and N.m."""
    if plate_type == 1:
        return np.array([*FORCE, *CENTER[:2], 3.0])
    moment = np.cross(CENTER - [0.0, 0.0, DEPTH], FORCE)  # about the sensors, which are below the surface
    if plate_type != 3:
        return np.array([*FORCE, *moment])
    a, b = ARMS
    z = FORCE[2] / 4.0 + np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]]) @ [moment[0] / (4 * b), moment[1] / (4 * a)]
    return np.array([FORCE[0] / 2, FORCE[0] / 2, FORCE[1] / 2, FORCE[1] / 2, *z])


def make_plate(plate_type: int) -> RawPlate:
    loads = make_channels(plate_type)
    channels = np.zeros((len(loads), len(TIME)))
    channels[:, STEP] = loads[:, None]
    kinds = {1: "NNNmmN", 3: "N" * 8}.get(plate_type, "NNN")
    origin = np.array([*ARMS, -DEPTH]) if plate_type == 3 else np.array([0.0, 0.0, -DEPTH])
    units = [*kinds, "Nm", "Nm", "Nm"] if kinds == "NNN" else [*kinds]
    return RawPlate(plate_type, channels, units, CORNERS, origin, np.empty((0, 0)), np.empty(0))


def check(plate: RawPlate, length_unit: float = 1.0) -> None:
    result = force_plates.convert(plate, TIME, 1.0, length_unit, "plate")
    assert result.force[STEP] == pytest.approx(np.tile(EXPECTED_FORCE, (40, 1)))
    assert result.cop[STEP] == pytest.approx(np.tile(EXPECTED_COP, (40, 1)))
    assert np.isnan(result.cop[:40]).all()


@pytest.mark.parametrize("plate_type", [1, 2, 3, 4])
def test_force_and_centre_are_those_of_the_load(plate_type: int) -> None:
    check(make_plate(plate_type))
    plate = make_plate(plate_type)
    check(replace(plate, origin=-plate.origin))  # some files have the distance of the sensors with the other sign


@pytest.mark.parametrize("signs", [(1.0, 1.0, 1.0), (-1.0, 1.0, -1.0), (1.0, -1.0, 1.0)])
def test_sensor_distances_of_type_3_have_no_sign(signs: tuple[float, ...]) -> None:
    plate = make_plate(3)
    check(replace(plate, origin=np.abs(plate.origin) * signs))


@pytest.mark.parametrize(("unit", "factor"), [("Nm", 1.0), ("N.m", 1.0), ("Nmm", 1e3), ("N*mm", 1e3), ("", 1e3)])
def test_moments_have_the_unit_of_their_channels(unit: str, factor: float) -> None:
    plate = make_plate(2)
    plate.channels[3:] *= factor
    check(replace(plate, units=["N"] * 3 + [unit] * 3), length_unit=1e-3)  # without a unit it is that of the markers


def test_calibration_matrix_converts_volts() -> None:
    matrix = np.diag([2.0, 2.0, 4.0, 0.6, 0.6, 0.3]) + 0.01
    plate = make_plate(4)
    volts = np.linalg.solve(matrix, plate.channels)
    check(replace(plate, channels=volts, units=["V"] * 6, calibration=matrix))


@pytest.mark.parametrize("plate_type", [1, 2, 3, 4])
def test_readings_of_the_empty_plate_are_subtracted_from_every_channel(plate_type: int) -> None:
    plate = make_plate(plate_type)
    readings = np.array([6.0, -9.0, 25.0, 12.0, -20.0, 5.0, 3.0, 8.0])[: len(plate.channels)]
    if plate_type == 1:
        readings[3:] = 0.0  # an unloaded plate has no centre of pressure
    check(replace(plate, channels=plate.channels + readings[:, None]))


def test_bending_of_a_kistler_plate_is_corrected() -> None:
    polynomial = np.zeros(12)
    polynomial[5], polynomial[11] = -8e-3, 5e-2
    plate = replace(make_plate(3), cop_polynomial=polynomial)
    result = force_plates.convert(plate, TIME, 1.0, 1.0, "plate")
    assert result.cop[50] == pytest.approx([1.8 + 0.95 * CENTER[1], 5.0 + 1.008 * CENTER[0], 0.0])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"plate_type": 7}, "of type 7; supported are 1, 2, 3, 4"),
        ({"channels": np.zeros((5, 100))}, "has 5 channels; type 2 needs 6"),
        ({"corners": np.zeros((3, 4))}, "four CORNERS must form a rectangle"),
    ],
)
def test_incomplete_plates_are_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        force_plates.convert(replace(make_plate(2), **changes), TIME, 1.0, 1.0, "plate")  # type: ignore[arg-type]
