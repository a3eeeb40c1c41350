"""The rig aligns the foot and learns the path of the hip so that the foot carries the load of the reference."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from klute_sim.api.gait import state_alignment
from klute_sim.controllers.parse import parse_controller
from klute_sim.controllers.pressure import load_default_profile
from klute_sim.device.device import load_device
from klute_sim.errors import InputError
from klute_sim.gait.metrics import compute_gait_metrics
from klute_sim.gait.reference import load_default_reference
from klute_sim.gait.rig import learning
from klute_sim.gait.rig.hip_path import HipPath
from klute_sim.gait.rig.learning import prepare_gait_rig
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions, GaitRig, build_gait_rig
from klute_sim.gait.summary import summarize_gait_run
from klute_sim.report.gait.table import collect_remarks

DEVICE = load_device("klute-1-1-4-pair")
PHASE = np.arange(200) / 200.0
OPTIONS = GaitOptions(strides=2, dt=1e-3)


@cache
def prepare_default_rig() -> GaitRig:
    return prepare_gait_rig(DEVICE, load_default_profile(), OPTIONS)


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1))
def test_path_has_its_harmonics_and_their_derivatives(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cosine, sine = rng.normal(size=(2, 2, 5))
    waves = 2.0 * np.pi * np.outer(PHASE, np.arange(5))
    samples = np.cos(waves) @ cosine.T + np.sin(waves) @ sine.T
    path = HipPath.from_samples(samples, 4)
    assert path.evaluate(PHASE) == pytest.approx(samples, abs=1e-12)
    rates = 2.0 * np.pi * np.arange(5)
    slopes = (np.cos(waves) * rates) @ sine.T - (np.sin(waves) * rates) @ cosine.T
    assert path.evaluate(PHASE, 1) == pytest.approx(slopes, abs=1e-9)


def test_path_survives_its_mapping() -> None:
    path = prepare_default_rig().hip_path
    again = HipPath.from_mapping(path.to_mapping(), "a run")
    assert np.array_equal(again.coefficients, path.coefficients)
    assert (again.learning_strides, again.vertical_residual_bw) == (path.learning_strides, path.vertical_residual_bw)
    assert (again.max_learning_strides, again.has_converged) == (40, path.has_converged)


def test_convergence_needs_both_errors_below_their_tolerances() -> None:
    path = replace(HipPath(np.zeros((2, 1), dtype=np.complex128)), learning_strides=9, max_learning_strides=15)
    assert path.has_converged is None
    assert replace(path, vertical_residual_bw=0.009, forward_residual_bw=0.014).has_converged
    for errors in ((0.011, 0.014), (0.009, 0.018)):
        assert not replace(path, vertical_residual_bw=errors[0], forward_residual_bw=errors[1]).has_converged


def test_learning_that_is_cut_short_says_so() -> None:
    """A learning of two strides cannot converge from the planned path; the remark proposes a larger number."""
    options = replace(OPTIONS, strides=1, learning_strides=2, alignment=prepare_default_rig().options.alignment)
    recording = simulate_gait(DEVICE, load_default_profile(), options)
    summary = summarize_gait_run(recording, compute_gait_metrics(recording))
    assert (summary["hip_path"]["max_learning_strides"], summary["hip_path"]["has_converged"]) == (2, False)
    assert any(
        "NOT learned the path of the hip in 2 strides" in remark and "pass --learning-strides 5" in remark
        for remark in collect_remarks(summary)
    )


def test_stalled_learning_proposes_no_more_strides() -> None:
    recording = simulate_gait(DEVICE, load_default_profile(), replace(OPTIONS, strides=1))
    summary = summarize_gait_run(recording, compute_gait_metrics(recording))
    stalled = {"learning_strides": 12, "max_learning_strides": 40, "has_converged": False}
    remarks = " ".join(collect_remarks({**summary, "hip_path": {**summary["hip_path"], **stalled}}))
    assert "NOT learned the path of the hip in 40 strides: on the best one, stride 12" in remarks
    assert "more strides are unlikely to help" in remarks
    late = {**stalled, "learning_strides": 39}
    remarks = " ".join(collect_remarks({**summary, "hip_path": {**summary["hip_path"], **late}}))
    assert "pass --learning-strides 100" in remarks


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "a run holds no path of the hip; give the folder of a gait run"),
        ({"height_m": 3}, "holds no path of the hip"),
        (
            {
                **{name: {"cosine": [9.0], "sine": [0.0]} for name in ("forward_m", "height_m")},
                **{
                    "learning_strides": 1,
                    "max_learning_strides": 1,
                    "vertical_residual_bw": None,
                    "forward_residual_bw": None,
                },
            },
            "moves the hip by more than 1 m",
        ),
    ],
)
def test_damaged_path_is_refused_in_one_sentence(content: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        HipPath.from_mapping(content, "a run")


def test_filter_passes_low_harmonics_and_stops_high_ones() -> None:
    for harmonic, gain in ((0, 1.0), (12, 1.0), (15, 0.5), (18, 0.0), (40, 0.0)):
        wave = np.cos(2.0 * np.pi * harmonic * PHASE)[:, None]
        assert learning.apply_low_pass(wave) == pytest.approx(gain * wave, abs=1e-12)


def test_foot_carries_the_load_of_the_reference_only_after_learning() -> None:
    rig = prepare_default_rig()
    learned, planned = (
        compute_gait_metrics(simulate_gait(DEVICE, load_default_profile(), options)).strides[-1]
        for options in (rig.options, replace(OPTIONS, alignment=rig.options.alignment, learning_strides=0))
    )
    assert learned.grf_vertical_tracking_rms_bw < 0.02
    assert learned.grf_forward_tracking_rms_bw < 0.025
    assert planned.grf_vertical_tracking_rms_bw > 0.3
    assert rig.hip_path.vertical_residual_bw == pytest.approx(learned.grf_vertical_tracking_rms_bw, abs=2e-3)
    assert 1 <= rig.hip_path.learning_strides <= OPTIONS.learning_strides
    assert rig.hip_path.has_converged
    assert not learned.contact_lost_in_stance


def test_learned_path_is_repeatable_and_replayable() -> None:
    """The options of a prepared rig hold all that was found, so the same rig is built from them without learning."""
    rig = prepare_default_rig()
    again = build_gait_rig(DEVICE, rig.options, OPTIONS.dt)
    assert np.array_equal(again.commands, rig.commands)
    learned, replayed = (
        simulate_gait(DEVICE, load_default_profile(), replace(options, strides=1)) for options in (OPTIONS, rig.options)
    )
    for name in learned.channels:
        assert np.array_equal(learned[name], replayed[name], equal_nan=True), name


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mass", "stature", "speed", "controller"),
    [(114.0, 1.9, 1.9, "profile"), (45.0, 1.5, 0.7, "profile"), (75.0, 1.75, None, "constant:4")],
)
def test_other_subjects_speeds_and_controllers_carry_their_load(
    mass: float, stature: float, speed: float | None, controller: str
) -> None:
    options = replace(OPTIONS, mass=mass, stature=stature, speed=speed)
    metrics = compute_gait_metrics(simulate_gait(DEVICE, parse_controller(controller), options)).strides[-1]
    assert metrics.grf_vertical_tracking_rms_bw < 0.03
    assert metrics.grf_vertical_max_bw < 1.25 * 1.13
    assert not metrics.touches_in_swing
    assert metrics.toe_clearance_mm > 10.0


def test_alignment_follows_the_zero_of_the_ankle() -> None:
    """A laboratory whose ankles read 6 degrees more gets a foot that is turned by 6 degrees more."""
    reference = load_default_reference()
    spline = reference.splines["ankle_dorsiflexion_deg"]
    values = spline(spline.x) + 6.0
    values[-1] = values[0]
    splines = {**reference.splines, "ankle_dorsiflexion_deg": CubicSpline(spline.x, values, bc_type="periodic")}
    rigs = [
        prepare_gait_rig(DEVICE, load_default_profile(), replace(OPTIONS, reference=gait, learning_strides=0))
        for gait in (reference, replace(reference, splines=splines))
    ]
    first, second = (rig.options.alignment for rig in rigs)
    assert first is not None
    assert second is not None
    assert math.degrees(second - first) == pytest.approx(6.0, abs=0.5)


def test_foot_that_points_down_is_aligned_above_the_ground() -> None:
    """At 4 bar the foot hangs so low that the toe would drag, and no stride on the ground shows the hanging angle."""
    high, low = (
        prepare_gait_rig(DEVICE, parse_controller(f"constant:{pressure}"), replace(OPTIONS, learning_strides=0))
        for pressure in (4, 2)
    )
    assert high.options.alignment is not None
    assert low.options.alignment is not None
    assert high.options.alignment > low.options.alignment + math.radians(2.0)


def test_alignment_of_the_device_file_is_kept() -> None:
    options = replace(OPTIONS, learning_strides=0)
    aligned = state_alignment(DEVICE, -4.0)
    assert prepare_gait_rig(aligned, load_default_profile(), options).options.alignment == math.radians(-4.0)
    chosen = replace(options, alignment=0.1)
    assert prepare_gait_rig(aligned, load_default_profile(), chosen).options.alignment == 0.1
