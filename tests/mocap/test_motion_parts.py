"""Joint centres, inverse dynamics, filters and events, by hand and by closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from klute_sim.comparison.alignment import resample
from klute_sim.errors import InputError
from klute_sim.gait import contacts
from klute_sim.mocap import trial
from klute_sim.mocap.formats.trc import Markers
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics import dynamics, filters, joints
from klute_sim.mocap.kinematics.from_markers import LegLandmarks
from klute_sim.mocap.parsing import channel_names, conventions, mapping, markers
from klute_sim.mocap.strides import strides
from klute_sim.mocap.strides.postprocess import ResampledLoads

Array = NDArray[np.float64]
CLUSTER = np.array([[0.05, 0.1, 0.0], [0.0, 0.25, 0.04], [-0.04, 0.15, -0.05], [0.06, 0.2, 0.05]])


def bodies(axes: Array, count: int = 60) -> tuple[Array, Array, Array]:
    """Clusters above and below a joint at a moving place, that turn about it by ``axes`` (count, 3) [rad]."""
    place = np.stack([np.linspace(0, 1, count), 0.5 + 0.05 * np.sin(np.arange(count)), np.zeros(count)], axis=1)
    sway = Rotation.from_rotvec(np.stack([0.1 * np.sin(np.arange(count) / 9)] * 3, axis=1))
    upper = np.stack([place + sway.apply(p) for p in CLUSTER], axis=1)
    bent = sway * Rotation.from_rotvec(axes)
    lower = np.stack([place + bent.apply(-p) for p in CLUSTER], axis=1)
    return upper, lower, place


def test_the_centre_of_a_ball_joint_is_found_exactly() -> None:
    angle = np.linspace(0, 3, 60)
    axes = np.stack([0.3 * np.sin(angle), 0.2 * np.cos(2 * angle), 0.8 * np.sin(2 * angle)], axis=1)
    upper, lower, place = bodies(axes)
    found, residual = joints.fit_joint_centre(upper, lower, hinge=False)
    assert found == pytest.approx(place, abs=1e-9)
    assert residual == pytest.approx(0.0, abs=1e-9)


def test_of_a_hinge_a_point_of_the_axis_near_the_clusters_is_found() -> None:
    axes = np.zeros((60, 3))
    axes[:, 2] = np.linspace(0.0, 1.2, 60)
    upper, lower, place = bodies(axes)
    found, residual = joints.fit_joint_centre(upper, lower, hinge=True)
    sway = Rotation.from_rotvec(np.stack([0.1 * np.sin(np.arange(60) / 9)] * 3, axis=1))
    inside = sway.inv().apply(found - place)
    assert inside[:, :2] == pytest.approx(np.zeros((60, 2)), abs=1e-6)
    assert np.abs(inside[:, 2]).max() < 0.06
    assert residual < 1e-9


def test_markers_that_were_not_seen_leave_a_gap_only() -> None:
    angle = np.linspace(0, 3, 60)
    upper, lower, place = bodies(np.stack([0.3 * np.sin(angle), 0.2 * angle, 0.8 * np.sin(2 * angle)], axis=1))
    lower[7, 1] = np.nan
    found, _ = joints.fit_joint_centre(upper, lower, hinge=False)
    assert np.isnan(found[7]).all()
    assert np.delete(found, 7, axis=0) == pytest.approx(np.delete(place, 7, axis=0), abs=1e-9)


def test_hip_centres_by_hand() -> None:
    """Pelvis 240 mm wide, 150 mm deep, along the axes; regression of Harrington et al. 2007."""
    right, left = np.array([[0.0, 1.0, 0.12]]), np.array([[0.0, 1.0, -0.12]])
    back = np.array([[-0.15, 1.0, 0.0]])
    wanted = [-0.24 * 0.15 - 0.0099, 1.0 - 0.30 * 0.24 - 0.0109, 0.33 * 0.24 + 0.0073]
    assert joints.estimate_hip_centre(right, left, back, "right")[0] == pytest.approx(wanted)
    assert joints.estimate_hip_centre(right, left, back, "left")[0] == pytest.approx([*wanted[:2], -wanted[2]])


def leg(turning: float = 0.0, pull: float = 0.0) -> LegLandmarks:
    """Knee 0.4 m above and 0.1 m ahead of the ankle, foot 0.16 m long; about the ankle it turns, and all accelerate."""
    time = np.arange(200) / 1000.0
    pitch = 0.5 * turning * (time - 0.1) ** 2
    ankle = np.stack([0.5 * pull * time**2, np.full(200, 0.08), np.zeros(200)], axis=1)

    def at(ahead: float, up: float, turned: Array | float = 0.0) -> Array:
        turned = np.broadcast_to(turned, 200)
        x, y = ahead * np.cos(turned) + up * np.sin(turned), up * np.cos(turned) - ahead * np.sin(turned)
        return ankle + np.stack([x, y, np.zeros(200)], axis=1)

    return LegLandmarks(time, at(0.2, 0.8), at(0.1, 0.4), ankle, at(-0.05, -0.06, pitch), at(0.15, -0.06, pitch))


def test_inclinations_by_hand() -> None:
    still = leg()
    assert still.shank_angle[0] == pytest.approx(np.degrees(np.arctan2(0.1, 0.4)))
    assert still.thigh_angle[0] == pytest.approx(np.degrees(np.arctan2(0.1, 0.4)))
    assert still.knee_angle[0] == pytest.approx(0.0)
    assert still.foot_pitch[0] == pytest.approx(0.0)
    assert leg(turning=2.0).foot_pitch[-1] == pytest.approx(np.degrees(0.5 * 2.0 * 0.099**2), abs=1e-6)


def test_the_ankles_moment_of_a_foot_at_rest_by_hand() -> None:
    """800 N up and 50 N forward, 0.12 m ahead of and 0.08 m below the ankle: 96 + 4 N.m, less the foot's weight."""
    still = leg()
    point = np.stack([still.ankle[:, 0] + 0.12, np.zeros(200)], axis=1)
    moment = dynamics.compute_ankle_moment(still, np.full(200, 50.0), np.full(200, 800.0), point, 70.0)
    assert moment[100] == pytest.approx(100.0 - 0.0145 * 70 * 9.81 * 0.5 * 0.15)


def test_the_ankles_moment_of_a_foot_that_turns_and_is_pulled() -> None:
    """In the air: what turns it, the centre's path about the ankle, and the pull on a centre 0.03 m below it."""
    mass, reach = 0.0145 * 70, np.hypot(0.15, 0.06)
    nothing = np.zeros(200)
    turned = dynamics.compute_ankle_moment(leg(turning=20.0), nothing, nothing, np.zeros((200, 2)), 70.0)
    weight = mass * 9.81 * 0.075
    inertia = mass * ((0.475 * reach) ** 2 + (0.5 * reach) ** 2)
    assert turned[100] == pytest.approx(inertia * 20.0 - weight, rel=1e-3)
    pulled = dynamics.compute_ankle_moment(leg(pull=5.0), nothing, nothing, np.zeros((200, 2)), 70.0)
    assert pulled[100] == pytest.approx(mass * -0.03 * 5.0 - weight, rel=1e-6)


def test_speed_is_the_hips_over_what_the_foot_stands_on() -> None:
    """A hip that goes 0.9 m/s through the room above a heel that a belt carries back at 0.3 m/s."""
    still, time = leg(), np.arange(200) / 1000.0
    hip, heel = still.hip.copy(), still.heel.copy()
    hip[:, 0] += 0.9 * time
    heel[:, 0] -= 0.3 * time
    nothing = np.zeros(200)
    foot = ResampledLoads([contacts.Contact(0.02, 0.18, True, True)], nothing, nothing, None, ())
    assert trial._estimate_walking_speed(replace(still, hip=hip, heel=heel), foot) == pytest.approx(1.2)
    assert trial._estimate_walking_speed(still, ResampledLoads([], nothing, nothing, None, ())) is None


def test_both_passes_together_have_the_cut_off_and_no_lag() -> None:
    time = np.arange(4000) / 200.0
    wave = np.sin(2 * np.pi * 6.0 * time)
    found = filters.low_pass(wave, 200.0, 6.0)[1000:3000]
    assert found == pytest.approx(wave[1000:3000] / np.sqrt(2.0), abs=2e-3)
    assert filters.low_pass(wave, 200.0, 0.0) is wave
    with pytest.raises(InputError, match=r"cut-off is 90 Hz; allowed at 200 Hz of sampling"):
        filters.low_pass(wave, 200.0, 90.0)


def test_short_gaps_are_bridged_and_long_ones_stay() -> None:
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


def test_events_are_where_the_line_crosses() -> None:
    time = np.arange(0.0, 1.01, 0.01)
    load = np.where((time > 0.195) & (time < 0.805), 500.0, 0.0)
    (contact,) = contacts.find_contacts(time, load)
    # between 0 N at 0.19 s and 500 N at 0.20 s, 20 N are passed after 0.4 ms
    assert contact.foot_strike == pytest.approx(0.19 + 0.01 * 20 / 500)
    assert contact.toe_off == pytest.approx(0.81 - 0.01 * 20 / 500)
    assert (contact.has_foot_strike, contact.has_toe_off) == (True, True)
    load[30:33] = 0.0  # a dip of 30 ms
    load[95:] = 500.0  # a knock at the end, too short
    assert len(contacts.find_contacts(time, load)) == 1
    begun = contacts.find_contacts(time, np.where(time < 0.5, 500.0, 0.0))[0]
    assert (begun.has_foot_strike, begun.has_toe_off) == (False, True)
    assert contacts.find_contacts(time, np.zeros(101)) == []


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
    ],
)
def test_names_that_are_known(label: str, channel: str, side: str | None, sign: int) -> None:
    assert channel_names.parse_channel_label(label) == (channel, side, sign)


OTHERS = """hip_adduction_r knee_angle_r_beta reference_ankle_angle reference_ankle_angle_sd ankle_velocity
pelvis_tilt_moment hip_flexion_r_moment actuator_moment LeftKneeFlexionMoment subtalar_angle_r"""


@pytest.mark.parametrize("label", OTHERS.split())
def test_names_that_are_something_else(label: str) -> None:
    assert channel_names.parse_channel_label(label) is None


@pytest.mark.parametrize(
    ("label", "wanted"),
    [
        ("ground_force_vx", ("0", "force", 0)),
        ("1_ground_force_py", ("1", "point", 1)),
        ("ground_force_2_v_3", ("2", "force", 2)),
        ("ground_force_r_vy", ("right", "force", 1)),
        ("l_ground_force_pz", ("left", "point", 2)),
        ("ground_torque_x", None),
        ("ground_moment_1_m_1", None),
    ],
)
def test_names_of_plates(label: str, wanted: tuple[str, str, int] | None) -> None:
    assert channel_names.parse_plate_label(label) == wanted


def test_markers_of_common_sets_are_known() -> None:
    some = ["RKNE", "LANK", "RHEE", "LTOE", "RASI", "LPSI", "R.Knee.Lat", "L HEEL", "R SHANK 3", "Right Ankle", "hip_l"]
    some += ["V.Sacral", "subject:RTIB", "L.Toe.Tip", "R FOOT LAT", "HEAD", "RELB", "LSHO", "R.Acromium", "R.Elbow"]
    found = markers.identify_markers(
        Markers(np.arange(2.0), {n: np.zeros((2, 3)) for n in some}), mapping.ImportMapping(), "x"
    )
    assert found.select("right", "knee") == ("RKNE", "R.Knee.Lat")
    assert found.select("left", "ankle") == ("LANK",)
    assert found.select("right", "ankle") == ("Right Ankle",)
    assert found.select("left", "heel") == ("L HEEL",)
    assert found.select("right", "heel") == ("RHEE",)
    assert found.select("left", "toe") == ("LTOE", "L.Toe.Tip")
    assert found.select("right", "toe") == ("R FOOT LAT",)
    assert found.select("right", "shank") == ("R SHANK 3", "subject:RTIB")
    assert found.select("left", "hip") == ("hip_l",)
    assert (found.select("right", "asis"), found.select("left", "psis"), found.sacrum) == (
        ("RASI",),
        ("LPSI",),
        ("V.Sacral",),
    )
    everything = {name for role in found.roles.values() for name in role} | set(found.sacrum)
    assert not everything & {"HEAD", "RELB", "LSHO", "R.Acromium", "R.Elbow"}


def test_swapped_sides_are_told() -> None:
    place = {"HEEL": (0.0, 0.0), "TOE": (0.2, 0.0), "KNEE": (0.0, 0.5)}
    positions = {
        f"{side}_{name}": np.tile([x, y, z], (3, 1))
        for side, z in (("R", -0.1), ("L", 0.1))
        for name, (x, y) in place.items()
    }
    found, findings = Markers(np.arange(3.0), positions), ImportLog()
    roles = markers.identify_markers(found, mapping.ImportMapping(), "x")
    assert markers.find_walking_frame(found, roles, mapping.ImportMapping(), "x", findings).description.startswith(
        "forward is +x"
    )
    assert "names swapped" in findings.warnings[0]


def test_a_swing_is_not_clipped_and_a_plateau_is() -> None:
    wave = 20.0 * np.sin(np.linspace(0, 20, 2000))
    assert conventions.detect_clipping(wave) is None
    bound = conventions.detect_clipping(np.maximum(wave, -12.0))
    assert bound is not None
    assert bound[0] == -12.0


def test_an_uneven_clock_is_made_even_and_one_that_rounds_is_kept() -> None:
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


def test_a_stride_in_the_file_of_all_strides_ends_with_its_own_end() -> None:
    phase = strides.PHASE_GRID
    ramps = {"one": 5.0 * phase**3, "two": 50.0 + 4.0 * phase**3}
    of = [strides.Stride(name, 0.3, 0.3 + 1.1, 0.6, {"knee_angle": ramp}) for name, ramp in ramps.items()]
    recording = strides.to_recording(of, "right")
    assert np.all(np.diff(recording["time"]) > 0.0)
    found = resample.find_strides(recording, "strides_right.parquet")
    for stride, ramp in zip(found, ramps.values(), strict=True):
        assert resample.resample_phase(recording, stride, "knee_angle") == pytest.approx(ramp, abs=1e-12)
