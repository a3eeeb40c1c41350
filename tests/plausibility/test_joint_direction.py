"""Direction of a driven joint, judged by the loads that were measured at it."""

import numpy as np

from klute_sim.plausibility.joint_direction import MirroredLoad, check_joint_direction
from klute_sim.plausibility.load_scale import LoadSeries
from klute_sim.plausibility.samples import Samples
from klute_sim.types import Array

ANGLE = 0.5 * np.sin(np.linspace(0.0, 6.0, 60))
POSITIONS = [("trial 'a'", Samples("angle_ankle", ANGLE, "deg", np.pi / 180.0))]


def make_load(measured: Array, angle: Array) -> MirroredLoad:
    """Return the load of a muscle that pulls 200 N more per radian."""

    def make(position: Array) -> LoadSeries:
        expected = 300.0 + 200.0 * position
        return LoadSeries(Samples("force_calf", measured, "N", 1.0), measured, expected, expected, 600.0, "trial 'a'")

    return MirroredLoad(make(angle), make(-angle))


def test_reversed_angle_is_found() -> None:
    isometric = make_load(np.full(60, 240.0), np.full(60, 0.3))
    (finding,) = check_joint_direction(POSITIONS, [make_load(300.0 - 200.0 * ANGLE, ANGLE), isometric])
    assert finding.name == "angle_ankle-sign"
    assert "`force_calf` is that of the declared devices only at the opposite position" in finding.statement


def test_right_angles_are_accepted() -> None:
    for measured in (
        300.0 + 200.0 * ANGLE,
        250.0 + 100.0 * ANGLE,  # a weaker muscle
        np.full(60, 300.0),  # a slack cable
        300.0 + 200.0 * np.sin(np.linspace(0.0, 6.0, 60) - 0.5),  # late
        np.full(60, np.nan),
    ):
        assert check_joint_direction(POSITIONS, [make_load(measured, ANGLE)]) == []
    assert check_joint_direction(POSITIONS, []) == []


def test_all_trials_have_to_agree() -> None:
    loads = [make_load(300.0 - 200.0 * ANGLE, ANGLE), make_load(300.0 + 200.0 * ANGLE, ANGLE)]
    assert check_joint_direction(POSITIONS, loads) == []
