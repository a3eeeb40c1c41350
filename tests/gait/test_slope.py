"""Slopes: the assumed reference, the model and the response of the ankle."""

import math
from functools import cache

import numpy as np
import pytest

from klute_sim.constants import GRAVITY
from klute_sim.controllers.pressure import load_default_profile
from klute_sim.device.device import load_device
from klute_sim.gait.metrics import StrideMetrics, compute_gait_metrics
from klute_sim.gait.reference import load_default_reference
from klute_sim.gait.rig.build import measure_leg
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions, build_gait_rig
from klute_sim.recording.recording import Recording
from klute_sim.report.gait.table import collect_remarks

PHASE = np.linspace(0.0, 1.0, 201)


@cache
def simulate_run(degrees: float) -> Recording:
    return simulate_gait(
        load_device("klute-1-1-4-pair"),
        load_default_profile(),
        GaitOptions(strides=2, dt=1e-3, slope=math.radians(degrees)),
    )


def compute_stride(degrees: float) -> StrideMetrics:
    return compute_gait_metrics(simulate_run(degrees)).strides[-1]


def test_level_ground_keeps_the_reference() -> None:
    reference = load_default_reference()
    assert reference.tilt_to_slope(0.0) is reference


@pytest.mark.parametrize("degrees", [-5.0, 3.0])
def test_ankle_compensates_the_slope(degrees: float) -> None:
    level, turned = load_default_reference(), load_default_reference().tilt_to_slope(math.radians(degrees))
    for column in ("shank_forward_deg", "ankle_dorsiflexion_deg"):
        assert turned(column, PHASE) == pytest.approx(level(column, PHASE) + degrees, abs=1e-9)
    assert turned("knee_flexion_deg", PHASE) == pytest.approx(level("knee_flexion_deg", PHASE))
    # The ground reaction is the same in space; its components turn with the slope.
    normal, along = turned("grf_vertical_n_per_kg", PHASE), turned("grf_forward_n_per_kg", PHASE)
    sine, cosine = math.sin(math.radians(degrees)), math.cos(math.radians(degrees))
    assert cosine * normal + sine * along == pytest.approx(level("grf_vertical_n_per_kg", PHASE), abs=1e-3)
    assert cosine * along - sine * normal == pytest.approx(level("grf_forward_n_per_kg", PHASE), abs=1e-3)


def test_gravity_is_inclined_with_constant_magnitude() -> None:
    device = load_device("klute-1-1-4-pair")
    gravity = build_gait_rig(device, GaitOptions(slope=math.radians(5.0)), 1e-3).model.opt.gravity
    assert np.linalg.norm(gravity) == pytest.approx(GRAVITY)
    assert gravity[0] == pytest.approx(-GRAVITY * math.sin(math.radians(5.0)))  # backward on an upward slope
    assert build_gait_rig(device, GaitOptions(), 1e-3).model.opt.gravity == pytest.approx([0.0, 0.0, -GRAVITY], abs=0.0)


@pytest.mark.slow
def test_ankle_work_increases_uphill() -> None:
    strides = [compute_stride(degrees) for degrees in (-3.0, 0.0, 3.0)]
    for reading in (
        lambda s: s.ankle_moment_peak_nm_per_kg,
        lambda s: s.ankle_power_peak_w_per_kg,
        lambda s: s.grf_forward_max_bw,
    ):
        down, level, up = map(reading, strides)
        assert down < level < up
    assert simulate_run(3.0)["ankle_angle"].max() > simulate_run(-3.0)["ankle_angle"].max() + 3.0
    assert not any(s.touches_in_swing for s in strides)


@pytest.mark.slow
def test_small_slopes_have_linear_effects() -> None:
    """What remains of the load error blurs the effect of slopes below one degree."""
    down, level, up = (compute_stride(d).ankle_moment_peak_nm_per_kg for d in (-1.5, 0.0, 1.5))
    assert up - level == pytest.approx(level - down, rel=0.3)
    assert abs(up - level) > 0.01


@pytest.mark.parametrize("degrees", [-5.0, 0.0, 4.0])
def test_feedforward_carries_the_weight_and_the_inertia_of_the_rig_only(degrees: float) -> None:
    slope, device = math.radians(degrees), load_device("klute-1-1-4-pair")
    rig = build_gait_rig(device, GaitOptions(slope=slope), 1e-3)
    moved, phase, plan = float(rig.model.body_mass.sum()), rig.phase, rig.trajectory
    lift = plan.height(phase, 2) / plan.stride_time**2
    push = plan.velocity(phase, 1) / plan.stride_time
    assert rig.commands[:, 4] == pytest.approx(moved * (GRAVITY * math.sin(slope) + push), abs=1e-6)
    assert rig.commands[:, 5] == pytest.approx(moved * (GRAVITY * math.cos(slope) + lift), abs=1e-6)


def test_hip_hike_keeps_the_clearance_of_level_ground() -> None:
    device, slope = load_device("klute-1-1-4-pair"), math.radians(5.0)
    clearances = []
    for angle in (0.0, slope):
        rig = build_gait_rig(device, GaitOptions(slope=angle), 1e-3)
        limb, phase = measure_leg(rig.model), np.array([0.70, 0.80])
        shank = np.radians(rig.reference("shank_forward_deg", phase))
        thigh = shank - np.radians(rig.reference("knee_flexion_deg", phase))
        ankle_as_on_the_level = np.radians(load_default_reference()("ankle_dorsiflexion_deg", phase))
        ankle = limb.compute_ankle_height(shank - ankle_as_on_the_level)
        touching = ankle + limb.shank * np.cos(shank) + limb.thigh * np.cos(thigh)
        clearances.append(rig.trajectory.height(phase) - touching)
    assert clearances[1] == pytest.approx(clearances[0], abs=2e-3)


def test_slope_has_no_distance_to_the_reference() -> None:
    assert compute_stride(0.0).moment_distance_sd.stance_rms is not None
    assert compute_stride(3.0).moment_distance_sd.stance_rms is None
    summary = {
        "touches_in_swing": False,
        "slope_deg": 3.0,
        "grf_vertical_tracking_rms_bw": 0.1,
        "per_stride": [],
        "below_friction_fit_pct": 0.0,
        "without_source": [],
        "assumptions": {},
        "friction_offset_work_j_per_kg": 0.0,
        **{"mass_kg": 75.0, "stature_m": 1.75, "speed_m_per_s": 1.2, "stride_time_s": 1.1},
        **{"reference": "x", "reference_speed_m_per_s": None, "contact_lost_in_stance": False, "alignment_deg": 0.0},
        "hip_path": {"learning_strides": 0},
        "foot": "rigid",
        "distance_to_reference": {"moment_distance_sd": {"stance_rms": None}},
    }
    (remark,) = (said for said in collect_remarks(summary) if "rises by 3 degrees" in said)
    assert remark.endswith("and no distance to the reference is given.")
    assumed = collect_remarks(summary | {"distance_to_reference": {"moment_distance_sd": {"stance_rms": 0.5}}})
    assert not any("no distance" in said for said in assumed)
    assert not any("rises" in said for said in collect_remarks(summary | {"slope_deg": 0.0}))


@pytest.mark.slow
def test_slope_run_is_converged_in_the_time_step() -> None:
    fine = simulate_gait(
        load_device("klute-1-1-4-pair"),
        load_default_profile(),
        GaitOptions(strides=2, dt=5e-4, slope=math.radians(3.0)),
    )
    peak = compute_gait_metrics(fine).strides[-1].ankle_moment_peak_nm_per_kg
    assert peak == pytest.approx(compute_stride(3.0).ankle_moment_peak_nm_per_kg, rel=0.01)
