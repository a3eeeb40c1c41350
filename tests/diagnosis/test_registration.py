"""Registration of walks: signs, and no change without an error."""

import numpy as np
import pytest

from klute_sim.diagnosis.experiments.registration import (
    REGISTRATION_DEVIATIONS,
    SI_FACTORS,
    Registration,
    correct_inputs,
    describe_registration,
)
from klute_sim.gait.replay.rollout import ReplayInputs

LOAD = np.array([0.0, 800.0])
ANGLE = np.radians([0.0, 20.0])
FORWARD = np.array([0.0, 60.0])
INPUTS = ReplayInputs(
    shank_angle=ANGLE,
    shank_angular_acceleration=np.zeros(2),
    ankle_acceleration_x=np.zeros(2),
    ankle_acceleration_z=np.zeros(2),
    ground_moment=np.array([0.0, -50.0]),
    axial_force=np.cos(ANGLE) * LOAD + np.sin(ANGLE) * FORWARD,
    shear_force=np.sin(ANGLE) * LOAD - np.cos(ANGLE) * FORWARD,
    pressure_command=np.zeros(2),
)


def test_names_units_and_fields_agree() -> None:
    fields = [name.removeprefix("registration.").rpartition("_")[0] for name in REGISTRATION_DEVIATIONS]
    assert fields == list(Registration._fields)
    assert len(SI_FACTORS) == len(fields)


def test_moment_follows_the_lever_and_the_height() -> None:
    # A load 10 mm further in front of the ankle dorsiflexes: the moment falls by 8 N.m.
    shifted = correct_inputs(INPUTS, LOAD, Registration(cop_to_ankle=0.01))
    assert shifted.ground_moment - INPUTS.ground_moment == pytest.approx([0.0, -8.0])
    # A forward force at a height of another 10 mm: -0.6 N.m.
    raised = correct_inputs(INPUTS, LOAD, Registration(ankle_height=0.01))
    assert raised.ground_moment - INPUTS.ground_moment == pytest.approx([0.0, -0.6])
    louder = correct_inputs(INPUTS, LOAD, Registration(plate_gain=0.01))
    assert louder.ground_moment == pytest.approx(1.01 * INPUTS.ground_moment)
    assert louder.axial_force == pytest.approx(1.01 * INPUTS.axial_force)
    assert louder.shear_force == pytest.approx(1.01 * INPUTS.shear_force)


def test_corrections_that_matter_are_told() -> None:
    rows = [
        ("registration.cop_to_ankle_mm", -4.97, (-5.2, -4.7)),
        ("registration.ankle_height_mm", 2.1, (-3.0, 7.0)),
        ("registration.plate_gain_pct", -0.03, (-0.1, 0.04)),
        ("tendon.stiffness_1_n_per_mm", 60.0, (59.0, 61.0)),
    ]
    (sentence,) = describe_registration(rows)
    assert "the centre of pressure lies 5 mm further back than measured" in sentence
    assert describe_registration(rows[1:]) == []


def test_no_error_changes_nothing() -> None:
    unchanged = correct_inputs(INPUTS, LOAD, Registration())
    assert all(np.array_equal(a, b) for a, b in zip(unchanged, INPUTS, strict=True))
