"""Joint centres, inverse dynamics, filters and events against known values and closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from klute_sim.comparison.alignment import resample
from klute_sim.errors import InputError
from klute_sim.gait import contacts
from klute_sim.mocap import trial
from klute_sim.mocap.formats.trc import Markers
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics import dynamics, filters, joints
from klute_sim.mocap.kinematics.from_markers import LegLandmarks
from klute_sim.mocap.kinematics.postprocess import ResampledLoads
from klute_sim.mocap.parsing import channel_names, conventions, mapping, markers
from klute_sim.mocap.strides import strides
from klute_sim.types import Array

CLUSTER = np.array([[0.05, 0.1, 0.0], [0.0, 0.25, 0.04], [-0.04, 0.15, -0.05], [0.06, 0.2, 0.05]])


def simulate_clusters(axes: Array, count: int = 60) -> tuple[Array, Array, Array]:
    """Return the clusters above and below a joint that rotates by ``axes`` (count, 3) [rad], and the joint centre."""
    joint = np.stack([np.linspace(0, 1, count), 0.5 + 0.05 * np.sin(np.arange(count)), np.zeros(count)], axis=1)
    sway = Rotation.from_rotvec(np.stack([0.1 * np.sin(np.arange(count) / 9)] * 3, axis=1))
    upper = np.stack([joint + sway.apply(p) for p in CLUSTER], axis=1)
    bent = sway * Rotation.from_rotvec(axes)
    lower = np.stack([joint + bent.apply(-p) for p in CLUSTER], axis=1)
    return upper, lower, joint


def test_ball_joint_centre_is_exact() -> None:
    angle = np.linspace(0, 3, 60)
    axes = np.stack([0.3 * np.sin(angle), 0.2 * np.cos(2 * angle), 0.8 * np.sin(2 * angle)], axis=1)
    upper, lower, joint = simulate_clusters(axes)
    result, residual = joints.fit_joint_centre(upper, lower, hinge=False)
    assert result == pytest.approx(joint, abs=1e-9)
    assert residual == pytest.approx(0.0, abs=1e-9)


def test_hinge_centre_is_on_axis_near_clusters() -> None:
    axes = np.zeros((60, 3))
    axes[:, 2] = np.linspace(0.0, 1.2, 60)
    upper, lower, joint = simulate_clusters(axes)
    result, residual = joints.fit_joint_centre(upper, lower, hinge=True)
    sway = Rotation.from_rotvec(np.stack([0.1 * np.sin(np.arange(60) / 9)] * 3, axis=1))
    inside = sway.inv().apply(result - joint)
    assert inside[:, :2] == pytest.approx(np.zeros((60, 2)), abs=1e-6)
    assert np.abs(inside[:, 2]).max() < 0.06
    assert residual < 1e-9


def test_hidden_markers_leave_gap_only() -> None:
    angle = np.linspace(0, 3, 60)
    upper, lower, joint = simulate_clusters(
        np.stack([0.3 * np.sin(angle), 0.2 * angle, 0.8 * np.sin(2 * angle)], axis=1)
    )
    lower[7, 1] = np.nan
    result, _ = joints.fit_joint_centre(upper, lower, hinge=False)
    assert np.isnan(result[7]).all()
    assert np.delete(result, 7, axis=0) == pytest.approx(np.delete(joint, 7, axis=0), abs=1e-9)


def test_hip_centres_match_regression() -> None:
    """The pelvis is 240 mm wide and 150 mm deep; regression of Harrington et al. 2007."""
    right, left = np.array([[0.0, 1.0, 0.12]]), np.array([[0.0, 1.0, -0.12]])
    back = np.array([[-0.15, 1.0, 0.0]])
    expected = [-0.24 * 0.15 - 0.0099, 1.0 - 0.30 * 0.24 - 0.0109, 0.33 * 0.24 + 0.0073]
    assert joints.estimate_hip_centre(right, left, back, "right")[0] == pytest.approx(expected)
    assert joints.estimate_hip_centre(right, left, back, "left")[0] == pytest.approx([*expected[:2], -expected[2]])


def make_landmarks(angular_acceleration: float = 0.0, acceleration: float = 0.0) -> LegLandmarks:
    """Return a leg with the knee 0.4 m above and 0.1 m ahead of the ankle, whose foot rotates and which accelerates."""
    time = np.arange(200) / 1000.0
    pitch = 0.5 * angular_acceleration * (time - 0.1) ** 2
    ankle = np.stack([0.5 * acceleration * time**2, np.full(200, 0.08), np.zeros(200)], axis=1)

    def locate(ahead: float, up: float, rotation: Array | float = 0.0) -> Array:
        rotation = np.broadcast_to(rotation, 200)
        x, y = ahead * np.cos(rotation) + up * np.sin(rotation), up * np.cos(rotation) - ahead * np.sin(rotation)
        return ankle + np.stack([x, y, np.zeros(200)], axis=1)

    return LegLandmarks(
        time, locate(0.2, 0.8), locate(0.1, 0.4), ankle, locate(-0.05, -0.06, pitch), locate(0.15, -0.06, pitch)
    )


def test_inclinations_match_geometry() -> None:
    still = make_landmarks()
    assert still.shank_angle[0] == pytest.approx(np.degrees(np.arctan2(0.1, 0.4)))
    assert still.thigh_angle[0] == pytest.approx(np.degrees(np.arctan2(0.1, 0.4)))
    assert still.knee_angle[0] == pytest.approx(0.0)
    assert still.foot_pitch[0] == pytest.approx(0.0)
    assert make_landmarks(angular_acceleration=2.0).foot_pitch[-1] == pytest.approx(
        np.degrees(0.5 * 2.0 * 0.099**2), abs=1e-6
    )


def test_ankle_moment_of_resting_foot_matches_statics() -> None:
    """800 N up and 50 N forward, 0.12 m ahead of and 0.08 m below the ankle: 96 + 4 N.m minus the foot's weight."""
    still = make_landmarks()
    point = np.stack([still.ankle[:, 0] + 0.12, np.zeros(200)], axis=1)
    moment = dynamics.compute_ankle_moment(still, np.full(200, 50.0), np.full(200, 800.0), point, 70.0)
    assert moment[100] == pytest.approx(100.0 - 0.0145 * 70 * 9.81 * 0.5 * 0.15)


def test_ankle_moment_of_accelerated_foot_matches_inertia() -> None:
    """In swing: rotational inertia about the ankle, and acceleration of the centre of mass 0.03 m below the ankle."""
    mass, reach = 0.0145 * 70, np.hypot(0.15, 0.06)
    zeros = np.zeros(200)
    turned = dynamics.compute_ankle_moment(
        make_landmarks(angular_acceleration=20.0), zeros, zeros, np.zeros((200, 2)), 70.0
    )
    weight = mass * 9.81 * 0.075
    inertia = mass * ((0.475 * reach) ** 2 + (0.5 * reach) ** 2)
    assert turned[100] == pytest.approx(inertia * 20.0 - weight, rel=1e-3)
    pulled = dynamics.compute_ankle_moment(make_landmarks(acceleration=5.0), zeros, zeros, np.zeros((200, 2)), 70.0)
    assert pulled[100] == pytest.approx(mass * -0.03 * 5.0 - weight, rel=1e-6)


def test_walking_speed_is_relative_to_standing_foot() -> None:
    """The hip moves at 0.9 m/s in the laboratory, and a belt moves the heel backward at 0.3 m/s."""
    still, time = make_landmarks(), np.arange(200) / 1000.0
    hip, heel = still.hip.copy(), still.heel.copy()
    hip[:, 0] += 0.9 * time
    heel[:, 0] -= 0.3 * time
    zeros = np.zeros(200)
    foot = ResampledLoads([contacts.Contact(0.02, 0.18, True, True)], zeros, zeros, None, ())
    assert trial._estimate_walking_speed(replace(still, hip=hip, heel=heel), foot) == pytest.approx(1.2)
    assert trial._estimate_walking_speed(still, ResampledLoads([], zeros, zeros, None, ())) is None


def test_low_pass_has_cut_off_and_no_lag() -> None:
    time = np.arange(4000) / 200.0
    wave = np.sin(2 * np.pi * 6.0 * time)
    result = filters.low_pass(wave, 200.0, 6.0)[1000:3000]
    assert result == pytest.approx(wave[1000:3000] / np.sqrt(2.0), abs=2e-3)
    assert filters.low_pass(wave, 200.0, 0.0) is wave
    with pytest.raises(InputError, match=r"cutoff is 90 Hz; allowed at a sampling rate of 200 Hz"):
        filters.low_pass(wave, 200.0, 90.0)


def test_short_gaps_are_filled_and_long_ones_remain() -> None:
    time = np.arange(100) / 100.0
    line = 3.0 * time
    short, long = line.copy(), line.copy()
    short[40:50], long[40:70] = np.nan, np.nan
    assert filters.fill_gaps(short, time) == pytest.approx(line)
    assert np.isnan(filters.fill_gaps(long, time)[40:70]).all()
    assert np.isnan(filters.low_pass(long, 100.0, 6.0)).sum() == 30
    edge = line.copy()
    edge[:5] = np.nan
    assert np.isnan(filters.low_pass(edge, 100.0, 6.0)).sum() == 5


def test_missing_samples_are_a_gap() -> None:
    time = np.arange(100) / 100.0 + np.where(np.arange(100) % 3, 0.001, 0.0)  # a clock with jitter
    samples = np.stack([time, time**2], axis=1)
    is_present = (time < 0.2) | (time > 0.5)
    all_times, complete = filters.insert_missing_samples(time[is_present], samples[is_present])
    assert all_times == pytest.approx(np.arange(100) / 100.0, abs=2e-3)
    assert np.isfinite(complete).all(axis=1).tolist() == is_present.tolist()
    for unchanged, original in zip(filters.insert_missing_samples(time, samples), (time, samples), strict=True):
        assert np.array_equal(unchanged, original)


def test_both_sides_of_a_gap_are_filtered() -> None:
    time = np.arange(0.0, 6.0, 0.01)
    shake = np.sin(2.0 * np.pi * 30.0 * time)
    shake[280:310] = np.nan
    result = filters.low_pass(shake, 100.0, 6.0)
    for part in (slice(50, 230), slice(360, 550)):
        assert np.abs(result[part]).max() < 0.01


def test_contact_events_are_interpolated() -> None:
    time = np.arange(0.0, 1.01, 0.01)
    load = np.where((time > 0.195) & (time < 0.805), 500.0, 0.0)
    (contact,) = contacts.find_contacts(time, load)
    # the line from 0 N at 0.19 s to 500 N at 0.20 s crosses 20 N after 0.4 ms
    assert contact.foot_strike == pytest.approx(0.19 + 0.01 * 20 / 500)
    assert contact.toe_off == pytest.approx(0.81 - 0.01 * 20 / 500)
    assert (contact.has_foot_strike, contact.has_toe_off) == (True, True)
    load[30:33] = 0.0  # a dip of 30 ms
    load[95:] = 500.0  # an impact at the end, too short for a contact
    assert len(contacts.find_contacts(time, load)) == 1
    begun = contacts.find_contacts(time, np.where(time < 0.5, 500.0, 0.0))[0]
    assert (begun.has_foot_strike, begun.has_toe_off) == (False, True)
    assert contacts.find_contacts(time, np.zeros(101)) == []


def test_a_gap_has_no_contact_event() -> None:
    time = np.arange(0.0, 1.01, 0.01)
    load = np.clip(1e4 * np.minimum(time - 0.1, 0.9 - time), 0.0, 500.0)
    load[40:60] = np.nan
    (bridged,) = contacts.find_contacts(time, load)
    assert (bridged.has_foot_strike, bridged.has_toe_off) == (True, True)
    load[5:20] = np.nan  # the heel strike is somewhere in it
    (contact,) = contacts.find_contacts(time, load)
    assert (contact.has_foot_strike, contact.has_toe_off) == (False, True)
    assert contact.foot_strike == 0.2
    assert contact.toe_off == bridged.toe_off


def test_a_swing_may_be_left_out() -> None:
    time = np.arange(0.0, 2.01, 0.01)
    phase = time % 1.0
    load = np.clip(5e3 * np.minimum(phase - 0.1, 0.7 - phase), 0.0, 500.0)
    events = contacts.find_contacts(time, load)
    assert len(events) == 2
    assert contacts.find_contacts(time, np.where(load > 0.0, load, np.nan)) == events


@pytest.mark.parametrize(
    ("label", "channel", "side", "sign"),
    [
        ("ankle_angle_r", "ankle_angle", "right", 1),
        ("ankle_angle_l_moment", "ankle_moment", "left", -1),
        ("LeftAnklePlantarFlexionAngle", "ankle_angle", "left", -1),
        ("RightAnklePlantarFlexionMoment", "ankle_moment", "right", 1),
        ("RightKneeFlexionAngle", "knee_angle", "right", 1),
        ("hip_flexion_l", "hip_angle", "left", 1),
        ("pelvis_tilt", "pelvis_tilt", None, 1),
        ("LeftGRF_y", "grf_y", "left", 1),
        ("RightBeltSpeed", "belt_speed", "right", 1),
        ("grf_vertical", "grf_vertical", None, 1),
        ("shank_angle", "shank_angle", None, 1),
        ("AP GRF", "grf_forward", None, 1),
        ("Fore-aft GRF", "grf_forward", None, 1),
        ("GRF AP", "grf_forward", None, 1),
        ("Right anteroposterior ground reaction force", "grf_forward", "right", 1),
        ("Anterior-posterior GRF", "grf_forward", None, 1),
        ("vGRF", "grf_vertical", None, 1),
        ("Vertical ground reaction force", "grf_vertical", None, 1),
        ("GRFz", "grf_z", None, 1),
        ("Plantarflexor moment", "ankle_moment", None, 1),
        ("Dorsiflexion", "ankle_angle", None, 1),
        ("Hip", "hip_angle", None, 1),
        ("R Knee [deg]", "knee_angle", "right", 1),
        ("Ankle (degrees)", "ankle_angle", None, 1),
        ("left ankle [Nm/kg]", "ankle_moment", "left", 1),
    ],
)
def test_channel_labels_are_recognised(label: str, channel: str, side: str | None, sign: int) -> None:
    assert channel_names.parse_channel_label(label) == (channel, side, sign)


OTHERS = """hip_adduction_r knee_angle_r_beta reference_ankle_angle reference_ankle_angle_sd ankle_velocity
pelvis_tilt_moment hip_flexion_r_moment actuator_moment LeftKneeFlexionMoment subtalar_angle_r
MedioLateralGRF grf_moment_x ground_reaction_point_x"""


COMMANDS = ("Ankle angle setpoint [deg]", "ankle_angle_desired", "ankle_angle_target", "commanded ankle angle (deg)")
OTHER_PLANES = ("Ankle inversion angle", "Ankle Angle Frontal", "Hip abduction angle", "knee valgus angle")


@pytest.mark.parametrize(
    "label", [*OTHERS.split(), "Hip [N*m/kg]", "Ankle [mm]", *COMMANDS, *OTHER_PLANES, "knee_angle_r_acc"]
)
def test_other_labels_are_ignored(label: str) -> None:
    assert channel_names.parse_channel_label(label) is None


@pytest.mark.parametrize(
    ("label", "expected"),
    [
        ("ground_force_vx", ("0", "force", 0)),
        ("1_ground_force_py", ("1", "point", 1)),
        ("ground_force_2_v_3", ("2", "force", 2)),
        ("ground_force_r_vy", ("right", "force", 1)),
        ("l_ground_force_pz", ("left", "point", 2)),
        ("ground_force1_vy", ("1", "force", 1)),
        ("force2_pz", ("2", "point", 2)),
        ("ground_force_calcn_r_vx", ("right", "force", 0)),
        ("ground_force_calcn_l_mx", None),
        ("ground_force_hand_l_vx", ("hand_l", "force", 0)),
        ("muscle_force_vx", None),
        ("ground_torque_x", None),
        ("ground_moment_1_m_1", None),
    ],
)
def test_plate_labels_are_parsed(label: str, expected: tuple[str, str, int] | None) -> None:
    assert channel_names.parse_plate_label(label) == expected


def test_markers_of_common_sets_are_identified() -> None:
    names = [
        "RKNE",
        "LANK",
        "RHEE",
        "LTOE",
        "RASI",
        "LPSI",
        "R.Knee.Lat",
        "L HEEL",
        "R SHANK 3",
        "Right Ankle",
        "hip_l",
    ]
    names += ["V.Sacral", "subject:RTIB", "L.Toe.Tip", "R FOOT LAT", "HEAD", "RELB", "LSHO", "R.Acromium", "R.Elbow"]
    result = markers.identify_markers(
        Markers(np.arange(2.0), {n: np.zeros((2, 3)) for n in names}), mapping.ImportMapping(), "x"
    )
    assert result.select("right", "knee") == ("RKNE", "R.Knee.Lat")
    assert result.select("left", "ankle") == ("LANK",)
    assert result.select("right", "ankle") == ("Right Ankle",)
    assert result.select("left", "heel") == ("L HEEL",)
    assert result.select("right", "heel") == ("RHEE",)
    assert result.select("left", "toe") == ("LTOE", "L.Toe.Tip")
    assert result.select("right", "toe") == ("R FOOT LAT",)
    assert result.select("right", "shank") == ("R SHANK 3", "subject:RTIB")
    assert result.select("left", "hip") == ("hip_l",)
    assert (result.select("right", "asis"), result.select("left", "psis"), result.sacrum) == (
        ("RASI",),
        ("LPSI",),
        ("V.Sacral",),
    )
    identified = {name for role in result.roles.values() for name in role} | set(result.sacrum)
    assert not identified & {"HEAD", "RELB", "LSHO", "R.Acromium", "R.Elbow"}


def test_swapped_sides_are_reported() -> None:
    joint = {"HEEL": (0.0, 0.0), "TOE": (0.2, 0.0), "KNEE": (0.0, 0.5)}
    positions = {
        f"{side}_{name}": np.tile([x, y, z], (3, 1))
        for side, z in (("R", -0.1), ("L", 0.1))
        for name, (x, y) in joint.items()
    }
    result, log = Markers(np.arange(3.0), positions), ImportLog()
    roles = markers.identify_markers(result, mapping.ImportMapping(), "x")
    assert markers.find_walking_frame(result, roles, mapping.ImportMapping(), "x", log).description.startswith(
        "forward is +x"
    )
    assert "check the sides of the marker names" in log.warnings[0]


def test_plateau_is_clipping_and_sine_is_not() -> None:
    wave = 20.0 * np.sin(np.linspace(0, 20, 2000))
    assert conventions.detect_clipping(wave) is None
    bound = conventions.detect_clipping(np.maximum(wave, -12.0))
    assert bound is not None
    assert bound[0] == -12.0


def test_jittered_times_are_resampled_and_rounded_times_kept() -> None:
    time = np.array([0.0, 0.0101, 0.0199, 0.03])
    clock = filters.make_uniform_time(time, "x")
    assert clock == pytest.approx([0.0, 0.01, 0.02, 0.03])
    pair = np.stack([time, 2.0 * time], axis=1)
    assert filters.resample_uniform(clock, time, pair) is pair
    uneven = np.array([0.0, 0.01, 0.027, 0.03])
    assert filters.resample_uniform(clock, uneven, np.stack([uneven, -uneven], axis=1)) == pytest.approx(
        np.stack([clock, -clock]).T
    )
    with pytest.raises(InputError, match=r"x has a sample every 0\.5 s"):
        filters.make_uniform_time(np.array([0.0, 0.5]), "x")


def test_strides_in_recording_end_with_their_own_samples() -> None:
    phase = strides.PHASE_GRID
    ramps = {"one": 5.0 * phase**3, "two": 50.0 + 4.0 * phase**3}
    separate = [strides.Stride(name, 0.3, 0.3 + 1.1, 0.6, {"knee_angle": ramp}) for name, ramp in ramps.items()]
    recording = strides.to_recording(separate, "right")
    assert np.all(np.diff(recording["time"]) > 0.0)
    result = resample.find_strides(recording, "strides_right.parquet")
    for stride, ramp in zip(result, ramps.values(), strict=True):
        assert resample.resample_phase(recording, stride, "knee_angle") == pytest.approx(ramp, abs=1e-12)


def test_sign_of_a_load_stands_in_the_row_of_its_column() -> None:
    log = ImportLog()
    place = {"channel": "grf_forward", "side": "left", "file": "a.csv", "unit": "N"}
    log.add_channel(**place, column="GRF_x", sign=1, zero=0.0, reason="unit by the label")
    for _ in range(2):
        log.add_sign(-1, "the ground brakes first", **place)
    log.add_sign(1, "the ground brakes first", **{**place, "side": "right"})
    left, right = log.channels
    assert (left["column"], left["sign"]) == ("GRF_x", -1)
    assert left["reason"] == "unit by the label; sign: the ground brakes first"
    assert (right["side"], right["column"], right["sign"]) == ("right", "force plates", 1)
