"""Export of gait runs: the moments of hip and knee against the ground reaction."""

import numpy as np
import pytest

from klute_sim.controllers.pressure import load_default_profile
from klute_sim.device.device import load_device
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.mocap.export import to_joint_moments, to_markers
from klute_sim.recording.recording import Recording

GRAVITY_M_PER_S2 = 9.81
THIGH_KG, BELOW_KNEE_KG = 7.5, 3.4


def test_exported_moments_hold_the_ground_reaction_in_single_support() -> None:
    """From 20 to 45 % of the cycle the leg turns slowly, so gravity and ground reaction balance the moments.

    The moment of a force F at r about a joint extends the leg by ``r x F``; hip flexion turns the thigh forward, knee
    flexion turns the shank backward. Accelerations of the leg are left out; they account for the tolerance.
    """
    recording = simulate_gait(load_device("klute-1-1-4-pair"), load_default_profile(), GaitOptions(strides=1, dt=1e-3))
    middle = (recording["gait_phase"] > 20.0) & (recording["gait_phase"] < 45.0)
    moments, markers = to_joint_moments(recording, "right").columns, to_markers(recording, "right").positions
    hip, knee, ankle = (markers[f"R {name}"][:, :2] for name in ("HIP", "KNEE", "ANKLE"))
    force = np.stack([recording["grf_forward"], recording["grf_vertical"]], axis=1)
    contact = np.stack([recording["cop_x"], np.zeros(len(recording))], axis=1)
    shank_centre = 0.5 * (knee + ankle)

    def turn_forward(joint: np.ndarray) -> np.ndarray:
        """Return the moment about the right axis with which ground reaction and the weight below swing the leg."""
        arm, weight_arm = contact - joint, (shank_centre - joint)[:, 0]
        return arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0] - BELOW_KNEE_KG * GRAVITY_M_PER_S2 * weight_arm

    thigh_weight = THIGH_KG * GRAVITY_M_PER_S2 * (0.5 * (hip + knee) - hip)[:, 0]
    hip_flexion, knee_flexion = -(turn_forward(hip) - thigh_weight), turn_forward(knee)
    for label, expected in (("hip_flexion_r_moment", hip_flexion), ("knee_angle_r_moment", knee_flexion)):
        assert moments[label][middle] == pytest.approx(expected[middle], abs=20.0), label
        assert np.corrcoef(moments[label][middle], expected[middle])[0, 1] > 0.9, label


def test_gait_without_drives_has_only_the_moment_of_the_ankle() -> None:
    zero = np.zeros(3)
    recording = Recording(
        {"time": np.arange(3.0), "ankle_moment": zero + 2.0}, {"time": "s", "ankle_moment": "N*m"}, {}
    )
    assert list(to_joint_moments(recording, "left").columns) == ["time", "ankle_angle_l_moment"]
