"""The unit of a joint's angle, judged by the stops of the joint."""

import numpy as np
import pytest

from klute_sim.plausibility.joint_angle import check_joint_angle

STOPS = (np.radians(-30.0), np.radians(100.0))
DEGREES = np.linspace(-20.0, 90.0, 50)


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_degrees_taken_for_radians_are_found(unit: str) -> None:
    (finding,) = check_joint_angle("angle_elbow", DEGREES, unit, STOPS, "trial 'a'")
    assert finding.name == "angle_elbow-unit"
    assert "looks like degrees that were taken for radians" in finding.statement


@pytest.mark.parametrize(
    "angle",
    [
        np.radians(DEGREES),
        np.radians(DEGREES) + np.radians(40.0),  # an encoder with another zero
        1e-3 * DEGREES,  # hardly moves
    ],
)
def test_angle_that_may_be_right_is_accepted(angle: np.ndarray) -> None:
    assert check_joint_angle("angle_elbow", angle, "deg", STOPS, "trial 'a'") == []


WRAPPED = np.where(DEGREES > 40.0, DEGREES - 360.0, DEGREES)
CODED = np.where(np.arange(50) % 10 == 5, -500.0, DEGREES)


@pytest.mark.parametrize(
    ("degrees", "name", "part"),
    [
        (WRAPPED, "wrapped", "1 jump of about 360 deg, so the encoder wraps"),
        (DEGREES + 360.0, "wrapped", "a full turn off"),
        (CODED, "missing", "-500 deg in 5 samples and -20 to 90 deg in the others"),
        (np.round(DEGREES * 4096.0 / 360.0), "unit", "look like the counts of an encoder"),
        (DEGREES + 170.0, "zero", "but the stops of its joint are at -30 deg and 100 deg: its zero or its sign"),
        (500.0 * DEGREES + 0.5, "unit", "its unit or its scale is wrong"),
    ],
)
def test_values_beyond_the_stops_are_explained(degrees: np.ndarray, name: str, part: str) -> None:
    (finding,) = check_joint_angle("angle_elbow", np.radians(degrees), "deg", STOPS, "trial 'a'")
    assert finding.name == f"angle_elbow-{name}"
    assert part in finding.statement
