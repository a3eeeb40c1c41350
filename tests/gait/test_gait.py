"""The default gait run: its metrics, its commanded and delivered quantities, and its energy balance."""

from functools import cache

import numpy as np
import pytest

from klute_sim.controllers import pressure
from klute_sim.device.device import load_device, parse_device
from klute_sim.errors import InputError, SimulationError
from klute_sim.gait.metrics import GaitMetrics, compute_gait_metrics
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.laws import tendon as tendon_law
from klute_sim.recording.recording import Recording

DEVICE = load_device("klute-1-1-4-pair")
TEXT = DEVICE.content.decode()
WEIGHT = 75 * 9.81


@cache
def simulate_default_run() -> tuple[Recording, GaitMetrics]:
    recording = simulate_gait(DEVICE, pressure.load_default_profile())
    return recording, compute_gait_metrics(recording)


def select_steady_strides(recording: Recording) -> Recording:
    return recording.select(recording["stride"] >= 2)


@pytest.mark.slow
def test_strides_repeat_from_the_third_on() -> None:
    peaks = [s.ankle_moment_peak_nm_per_kg for s in simulate_default_run()[1].strides]
    assert len(peaks) == 5
    assert max(peaks[2:]) / min(peaks[2:]) < 1.01


def test_contact_and_toe_off_have_normal_phases() -> None:
    for stride in simulate_default_run()[1].steady_strides:
        assert stride.first_contact_pct is not None
        assert stride.toe_off_pct is not None
        assert 0 <= stride.first_contact_pct <= 1
        assert 60 <= stride.toe_off_pct <= 66
        assert not stride.touches_in_swing
        assert not stride.contact_lost_in_stance
        assert stride.sole_depth_max_mm < 10  # a shoe yields as much
        assert stride.toe_clearance_mm >= 10


def test_ground_reaction_has_a_human_shape() -> None:
    recording, metrics = simulate_default_run()
    for stride in metrics.steady_strides:
        assert all(0.85 <= peak <= 1.35 for peak in stride.grf_vertical_peaks_bw)
        assert stride.grf_vertical_max_bw < 1.5
        assert -0.26 <= stride.grf_forward_min_bw <= -0.1
        assert 0.1 <= stride.grf_forward_max_bw <= 0.26
    last = recording.select(recording["stride"] == 5)
    valley = last["grf_vertical"][(last["gait_phase"] > 22) & (last["gait_phase"] < 36)].min() / WEIGHT
    assert valley < min(metrics.strides[-1].grf_vertical_peaks_bw) - 0.1
    brake = last["gait_phase"][last["grf_forward"].argmin()]
    push = last["gait_phase"][last["grf_forward"].argmax()]
    assert brake < 25 < 40 < push


def test_ankle_angle_is_close_to_the_reference() -> None:
    for stride in simulate_default_run()[1].steady_strides:
        assert 18 <= stride.ankle_range_deg <= 35
        assert stride.angle_distance_sd.largest is not None
        assert stride.angle_distance_sd.largest < 1.5


def test_ankle_moment_and_power_are_close_to_the_reference() -> None:
    for stride in simulate_default_run()[1].steady_strides:
        assert 1.2 <= stride.ankle_moment_peak_nm_per_kg <= 1.8
        assert 40 <= stride.ankle_moment_peak_pct <= 55
        assert stride.moment_distance_sd.stance_rms is not None
        assert stride.moment_distance_sd.stance_rms <= 0.8
        assert 2 <= stride.ankle_power_peak_w_per_kg <= 5
        assert stride.ankle_work_net_j_per_kg >= 0.12


def test_rollover_radius_is_below_a_fifth_of_stature() -> None:
    """People roll over on 22 % of their stature; the yielding heel and sole of the rig make it smaller."""
    radius = simulate_default_run()[1].mean(lambda s: s.rollover_radius_m)
    assert radius is not None
    assert 0.16 * 1.75 < radius < 0.22 * 1.75


def test_ankle_without_pressure_is_passive() -> None:
    recording = simulate_gait(DEVICE, pressure.create_off_controller(), GaitOptions(strides=3))
    metrics = compute_gait_metrics(recording)
    work = metrics.mean(lambda s: s.ankle_work_net_j_per_kg)
    assert work is not None
    assert work <= 0.0
    assert select_steady_strides(recording)["pressure"].max() == 0.0
    assert metrics.mean(lambda s: s.air_g) == 0.0


@pytest.mark.slow
def test_peak_moment_is_converged_in_the_time_step() -> None:
    fine = compute_gait_metrics(
        simulate_gait(DEVICE, pressure.load_default_profile(), GaitOptions(strides=3, dt=2.5e-4))
    )
    coarse = simulate_default_run()[1].strides[2].ankle_moment_peak_nm_per_kg
    assert fine.strides[2].ankle_moment_peak_nm_per_kg == pytest.approx(coarse, rel=0.01)


def test_joint_moment_is_tension_times_moment_arm() -> None:
    recording, _ = simulate_default_run()
    springs = DEVICE.parameters.tendon
    stretch = recording["unit_length"] - recording["muscle_length"] - springs.slack_length
    tension = np.array([tendon_law.force(springs, x) for x in stretch])
    expected = tension * recording["moment_arm"]
    assert np.abs(recording["force"] - tension).max() <= 1e-9 * tension.max()
    assert np.abs(recording["actuator_moment"] - expected).max() <= 1e-9 * expected.max()
    loaded = tension > 1.0
    assert np.abs(recording["actuator_moment"][loaded] / expected[loaded] - 1).max() < 1e-9


def test_net_moment_is_the_sum_of_its_parts() -> None:
    recording, _ = simulate_default_run()
    parts = recording["actuator_moment"] + recording["passive_moment"] + recording["stop_moment"]
    assert recording["ankle_moment"] == pytest.approx(parts, abs=1e-9)
    # plantarflexor moment times plantarflexion rate
    rate = -np.radians(recording["ankle_velocity"])
    assert recording["ankle_power"] == pytest.approx(recording["ankle_moment"] * rate, rel=1e-9, abs=1e-9)
    angle = np.radians(recording.provenance["options"]["alignment_deg"] - recording["ankle_angle"])
    spring = -130 * (angle + 0.085) - 1.0 * rate
    assert recording["passive_moment"] == pytest.approx(spring, abs=1e-6)


def test_ankle_velocity_is_the_derivative_of_the_angle() -> None:
    recording, _ = simulate_default_run()
    step = recording["time"][1]
    slope = np.diff(recording["ankle_angle"]) / step
    middle = 0.5 * (recording["ankle_velocity"][1:] + recording["ankle_velocity"][:-1])
    assert np.sqrt(np.mean((slope - middle) ** 2)) < 0.02 * np.abs(slope).max()


def test_muscle_and_damper_balance_the_tendon_and_pressure_is_delivered() -> None:
    recording, _ = simulate_default_run()
    rest = DEVICE.parameters.muscle.resting_length
    free = recording["muscle_length"] < rest
    gap = recording["muscle_force"] + recording["damper_force"] - recording["force"]
    assert free.all()
    assert np.abs(gap).max() < 1e-6
    assert recording["muscle_length"][recording["stride"] > 1].max() < 0.985 * rest
    assert recording["pressure"] == pytest.approx(recording["pressure_command"], abs=0.05)
    assert recording["pressure"].max() <= 5.0


@pytest.mark.slow
def test_energy_balance_matches_the_work_on_the_ankle() -> None:
    for controller in (
        pressure.load_default_profile(),
        pressure.create_off_controller(),
        pressure.ConstantPressure(1e5),
    ):
        recording = simulate_gait(DEVICE, controller, GaitOptions(strides=2))
        assert abs(compute_gait_metrics(recording).strides[-1].ledger_residual_pct) < 0.2
    last = simulate_default_run()[0].select(simulate_default_run()[0]["stride"] == 5)
    step = simulate_default_run()[0]["time"][1]
    work = last["delivered_power"].sum() * step
    loop = -np.trapezoid(last["actuator_moment"], np.radians(last["ankle_angle"]))  # of the joint, not of the tendon
    assert work == pytest.approx(loop, rel=1e-3)
    gas, damper = last["gas_power"].sum() * step, last["damper_power"].sum() * step
    friction = last["friction_power"].sum() * step
    assert gas + damper + friction == pytest.approx(work, rel=0.01)
    assert damper < 0 < gas


def test_servos_track_the_reference_within_a_degree() -> None:
    recording = select_steady_strides(simulate_default_run()[0])
    from klute_sim.gait import reference
    from klute_sim.gait.rig import trajectory

    phase = recording["gait_phase"] / 100
    for channel, angle in (
        ("thigh_angle", trajectory.compute_thigh_angle),
        ("knee_angle", trajectory.compute_knee_angle),
    ):
        error = recording[channel] - np.degrees(angle(reference.load_default_reference(), phase))
        assert np.abs(error).max() < 2.0, channel
        assert np.sqrt(np.mean(error**2)) < 1.0, channel


def test_runs_are_bit_identical() -> None:
    first, second = (simulate_gait(DEVICE, pressure.load_default_profile(), GaitOptions(strides=1)) for _ in range(2))
    for name in first.channels:
        assert np.array_equal(first[name], second[name], equal_nan=True), name


@pytest.mark.slow
def test_mass_scales_load_and_speed_scales_distance() -> None:
    heavy = simulate_gait(DEVICE, pressure.load_default_profile(), GaitOptions(strides=2, mass=90))
    last = heavy.select(heavy["stride"] == 2)
    assert last["grf_vertical"].mean() == pytest.approx(
        90 / 75 * select_steady_strides(simulate_default_run()[0])["grf_vertical"].mean(), rel=0.1
    )
    slow = simulate_gait(DEVICE, pressure.load_default_profile(), GaitOptions(strides=1, speed=0.8))
    distance = slow["carriage_x"][-1] - slow["carriage_x"][0]
    assert distance / slow["time"][-1] == pytest.approx(0.8, rel=0.03)
    assert slow.provenance["options"]["speed_m_per_s"] == pytest.approx(0.8, rel=1e-3)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("mass", -75),
        ("mass", float("nan")),
        ("speed", 0.0),
        ("slope", 0.2),
        ("stature", 17.5),
        ("strides", 0),
        ("dt", 0.01),
    ],
)
def test_options_out_of_range_are_refused(name: str, value: float) -> None:
    with pytest.raises(InputError, match=r"(mass|speed|slope|stature|strides|time step) is .*allowed"):
        GaitOptions(**{name: value})  # type: ignore[arg-type]


def test_device_that_does_not_fit_is_refused() -> None:
    with pytest.raises(InputError, match=r"no \[tendon\] section"):
        simulate_gait(load_device("klute-3-4"), pressure.create_off_controller())
    text = TEXT.replace("resting_length_mm = 264.0", "resting_length_mm = 364.0")
    with pytest.raises(InputError, match="the shank has only 430 mm"):
        simulate_gait(parse_device(text.encode(), "x"), pressure.create_off_controller())
    text = TEXT[: TEXT.index("[mounting]")] + TEXT[TEXT.index("[sources]") :]
    with pytest.raises(InputError, match=r"no \[mounting\] section"):
        simulate_gait(
            parse_device(text.replace('"mounting.neutral', "#").encode(), "x"), pressure.create_off_controller()
        )


def test_run_that_leaves_its_path_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("klute_sim.gait.rig.setup.MAX_PATH_DEVIATION", 1e-4)
    with pytest.raises(SimulationError, match=r"left its path at t = .* % of stride 1"):
        simulate_gait(DEVICE, pressure.load_default_profile(), GaitOptions(strides=1))


def test_progress_increases_to_one() -> None:
    fractions: list[float] = []
    simulate_gait(
        DEVICE,
        pressure.create_off_controller(),
        GaitOptions(strides=1),
        lambda fraction, stage: fractions.append(fraction),
    )
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    assert len(fractions) > 5
