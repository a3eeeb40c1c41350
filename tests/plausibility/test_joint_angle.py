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
        np.radians(500.0 * DEGREES),  # neither unit fits
    ],
)
def test_angle_that_may_be_right_is_accepted(angle: np.ndarray) -> None:
    assert check_joint_angle("angle_elbow", angle, "deg", STOPS, "trial 'a'") == []
