"""Sign, unit and zero of the angle of a joint, judged by where the model rests."""

import numpy as np
import pytest

from klute_sim.plausibility.joint_trajectory import JointTrajectory, check_joint_trajectories
from klute_sim.plausibility.samples import Samples
from klute_sim.types import Array

TIME = np.linspace(0.0, 10.0, 400)
EXPECTED = np.radians(35.0 + 25.0 * np.sin(0.8 * TIME))
STOP_RANGE = np.radians(130.0)
OSCILLATION = np.radians(5.0) * np.sin(13.0 * TIME)


def make_trajectory(measured: Array, period: float = 0.5) -> JointTrajectory:
    samples = Samples("angle_elbow", measured, "deg", np.pi / 180.0)
    return JointTrajectory(samples, TIME, EXPECTED, period, STOP_RANGE, STOP_RANGE, "trial 'a'")


@pytest.mark.parametrize(
    ("measured", "name", "part"),
    [
        (-EXPECTED + OSCILLATION, "angle_elbow-sign", "the opposite direction (correlation -1.00)"),
        (np.radians(EXPECTED), "angle_elbow-unit", "is its unit rad?"),
        (EXPECTED - np.radians(90.0), "angle_elbow-zero", "add about 90 deg in [columns]"),
    ],
)
def test_mistake_is_found(measured: Array, name: str, part: str) -> None:
    (finding,) = check_joint_trajectories([make_trajectory(measured)])
    assert finding.name == name
    assert part in finding.statement


@pytest.mark.parametrize(
    "measured",
    [
        EXPECTED + OSCILLATION,
        0.6 * EXPECTED + np.radians(30.0),  # a stiffer model with other lengths
        np.radians(35.0 + 25.0 * np.sin(0.8 * (TIME - 0.5))),  # late
        np.full(400, 0.5),  # the joint rubs
        0.05 * EXPECTED,  # hardly moves
        np.where(TIME < 3.0, np.nan, EXPECTED),
    ],
)
def test_other_trajectory_is_accepted(measured: Array) -> None:
    assert check_joint_trajectories([make_trajectory(measured)]) == []


def test_joint_that_its_springs_hold_is_not_judged() -> None:
    """Devices without a supply cannot move the joint, and the model rests at one angle."""
    held = make_trajectory(EXPECTED)._replace(expected=np.full(400, 0.5), reach=0.0)
    assert check_joint_trajectories([held]) == []


def test_short_or_fast_trials_and_contradicting_ones_are_not_judged() -> None:
    assert check_joint_trajectories([make_trajectory(-EXPECTED, period=5.0)]) == []
    assert check_joint_trajectories([make_trajectory(-EXPECTED), make_trajectory(EXPECTED)]) == []
    assert check_joint_trajectories([]) == []
