"""Gait metrics of synthetic recordings with known values."""

import io
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from klute_sim.gait.metrics import GaitMetrics, compute_gait_metrics, compute_reference_metrics
from klute_sim.gait.summary import summarize_gait_run
from klute_sim.recording.recording import Recording
from klute_sim.report.gait import figure
from klute_sim.report.gait.headline import format_headline
from klute_sim.report.gait.table import build_stride_table, build_table, collect_remarks
from klute_sim.types import Array

MASS, STEP, COUNT = 80.0, 1e-3, 1000
WEIGHT = MASS * 9.81
PHASE = 100.0 * np.arange(COUNT) / COUNT
CIRCLE = 0.35


def channels() -> dict[str, Array]:
    """Return one stride that equals its reference, with stance from 0 to 60 % and a known roll-over circle."""
    stance = PHASE <= 60
    load = np.where(stance, WEIGHT * (1.0 + 0.1 * np.sin(4 * np.pi * PHASE / 60)), 0.0)
    angle = 10 * np.sin(2 * np.pi * PHASE / 100)
    moment = np.where(stance, MASS * 1.4 * np.sin(np.pi * PHASE / 60), 0.0)
    power = moment * -np.radians(np.gradient(angle, STEP))
    shank = np.radians(np.linspace(-20, 20, COUNT))
    ankle_height = 0.09
    # a wheel of radius CIRCLE, centred on the shank above the ankle: the contact is below the centre
    centre = CIRCLE - ankle_height
    zero = np.zeros(COUNT)
    human = {"ankle_angle": angle, "ankle_moment": moment, "ankle_power": power}
    ground = {"grf_vertical": load, "grf_forward": 0.2 * WEIGHT * np.sin(2 * np.pi * PHASE / 60) * stance}
    values = {
        "gait_phase": PHASE,
        "stride": zero + 1.0,
        "ankle_power": power,
        "actuator_power": power,
        "actuator_moment": 0.9 * moment,
        "sole_height": np.where(PHASE < 60.0, -1e-3, 12e-3),
        "shank_angle": np.degrees(shank),
        "ankle_x": zero,
        "ankle_z": CIRCLE - centre * np.cos(shank),
        "cop_x": np.where(stance, centre * np.sin(shank), np.nan),
        "gas_power": power,
        "friction_power": zero,
        "damper_power": zero,
        "stop_power": zero,
        "effects_power": zero,
        "bladder_power": zero,
        "tendon_power": zero,
        "delivered_power": power,
        "residual_power": zero,
        "force_residual": zero,
        "air_mass": 1e-3 * (1 - np.cos(2 * np.pi * PHASE / 100)),
        "air_leaked": zero,
        "supply_pressure": zero + 5.0,
        "air_drawn": 2e-3 * PHASE / PHASE[-1],
        **human,
        **ground,
        **{f"reference_{name}": values for name, values in {**human, **ground}.items()},
        "reference_ankle_angle_sd": zero + 3.0,
        "reference_ankle_moment_sd": zero + 0.2 * MASS,
        "reference_ankle_power_sd": zero + 0.3 * MASS,
        "pressure": zero,
        "pressure_command": zero,
        "force": zero,
        "muscle_force": zero,
        "damper_force": zero,
    }
    return {"time": np.arange(COUNT) * STEP, **values}


def recording(strides: int = 1, **changed: Array) -> Recording:
    compute_metrics = {**channels(), **changed}
    tiled = {name: np.tile(values, strides) for name, values in compute_metrics.items()}
    tiled["time"] = np.arange(strides * COUNT) * STEP
    tiled["stride"] = np.repeat(np.arange(1.0, strides + 1), COUNT)
    provenance = {
        "device": {
            "name": "test",
            "assumed": {"damper.bore_mm": "assumed: lost"},
            "without_source": [],
            "valve": False,
        },
        "controller": {},
        "reference": {"name": "itself"},
        "options": {
            **{"mass_kg": MASS, "stature_m": 1.75, "speed_m_per_s": 1.2, "stride_time_s": 1.0, "strides": strides},
            "alignment_deg": 0.0,
        },
        "hip_path": {
            **{"learning_strides": 3, "max_learning_strides": 15, "has_converged": True},
            **{"vertical_residual_bw": 0.009, "forward_residual_bw": 0.01},
        },
    }
    return Recording(tiled, dict.fromkeys(tiled, "1"), provenance)


def compute_metrics(**changed: Array) -> GaitMetrics:
    return compute_gait_metrics(recording(**changed))


def test_stride_equal_to_its_reference_has_distance_zero() -> None:
    stride = compute_metrics().strides[0]
    for distance in (stride.angle_distance_sd, stride.moment_distance_sd, stride.power_distance_sd):
        assert distance.stance_rms == distance.swing_rms == distance.largest == 0.0
    human = compute_reference_metrics(recording())
    assert human.ankle_work_net_j_per_kg == stride.ankle_work_net_j_per_kg
    assert human.grf_vertical_peaks_bw == stride.grf_vertical_peaks_bw


def test_distance_is_in_standard_deviations() -> None:
    stance = PHASE <= 60
    offset = channels()["ankle_angle"] + np.where(stance, 6.0, -3.0)
    distance = compute_metrics(ankle_angle=offset).strides[0].angle_distance_sd
    assert (distance.stance_rms, distance.swing_rms, distance.largest) == pytest.approx((2.0, 1.0, 2.0), rel=1e-3)


def test_distance_uses_minimum_standard_deviations() -> None:
    offset = channels()["ankle_moment"] + 0.05 * MASS
    tiny = np.full(COUNT, 1e-6)
    distance = compute_metrics(ankle_moment=offset, reference_ankle_moment_sd=tiny).strides[0].moment_distance_sd
    assert distance.largest == pytest.approx(1.0)


def test_power_distance_is_per_kilogram() -> None:
    offset = channels()["ankle_power"] + 0.6 * MASS
    assert compute_metrics(ankle_power=offset).strides[0].power_distance_sd.largest == pytest.approx(2.0)


def test_tracking_error_is_against_the_reference() -> None:
    off = channels()["grf_vertical"] + 0.2 * WEIGHT
    assert compute_metrics(grf_vertical=off).strides[0].grf_vertical_tracking_rms_bw == pytest.approx(0.2)


def test_friction_offset_work_and_fade_are_computed() -> None:
    pressure = np.where(PHASE < 25, 3.0, 1.0)
    stride = compute_metrics(pressure=pressure, friction_power=np.full(COUNT, MASS * 0.5)).strides[0]
    assert stride.below_friction_fit_pct == pytest.approx(75.0)
    assert stride.friction_offset_work_j_per_kg == pytest.approx(0.5)


def test_peaks_work_and_range() -> None:
    stride = compute_metrics().strides[0]
    assert stride.ankle_moment_peak_nm_per_kg == pytest.approx(1.4, rel=1e-4)
    assert stride.ankle_moment_peak_pct == pytest.approx(30.0, abs=0.1)
    assert stride.ankle_range_deg == pytest.approx(20.0, rel=1e-3)
    angle, moment = np.radians(channels()["ankle_angle"]), channels()["ankle_moment"] / MASS
    loop = -np.trapezoid(moment, angle)
    assert stride.ankle_work_net_j_per_kg == pytest.approx(loop, rel=1e-3)
    assert stride.ankle_work_positive_j_per_kg > max(0.0, loop)


def test_power_peak_ignores_a_spike_of_one_sample() -> None:
    power = channels()["ankle_power"].copy()
    baseline = compute_metrics().strides[0].ankle_power_peak_w_per_kg
    power[700] = 100 * power.max()
    spiked = compute_metrics(ankle_power=power).strides[0].ankle_power_peak_w_per_kg
    assert spiked < 10 * baseline
    assert spiked == pytest.approx(power[700] / MASS / 15, rel=1e-6)


@pytest.mark.parametrize(("load_after_gap_bw", "is_lost"), [(0.0, False), (0.006, False), (0.03, True), (1.0, True)])
def test_contact_is_lost_between_loads_and_not_before_a_graze(load_after_gap_bw: float, is_lost: bool) -> None:
    """A toe that has left the ground and grazes it with some newtons is not a foot that leaves it in stance."""
    load = channels()["grf_vertical"].copy()
    load[PHASE >= 55] = 0.0
    load[(PHASE >= 55.2) & (PHASE < 56)] = load_after_gap_bw * WEIGHT
    assert compute_metrics(grf_vertical=load).strides[0].contact_lost_in_stance is is_lost


def test_contact_events_ignore_contacts_in_swing() -> None:
    stride = compute_metrics().strides[0]
    assert stride.first_contact_pct == pytest.approx(0.0, abs=0.1)
    assert stride.toe_off_pct == pytest.approx(60.0, abs=0.1)
    assert not stride.touches_in_swing
    load = channels()["grf_vertical"].copy()
    load[(PHASE > 75) & (PHASE < 78)] = WEIGHT
    scuffed = compute_metrics(grf_vertical=load).strides[0]
    assert scuffed.touches_in_swing
    assert scuffed.toe_off_pct == pytest.approx(60.0, abs=0.1)
    early = channels()["grf_vertical"].copy()
    early[PHASE > 97] = WEIGHT
    assert compute_metrics(grf_vertical=early).strides[0].first_contact_pct == pytest.approx(-2.9, abs=0.2)
    never = compute_metrics(grf_vertical=np.zeros(COUNT)).strides[0]
    assert never.first_contact_pct is None
    assert never.toe_off_pct is None


def test_rollover_radius_is_that_of_the_circle() -> None:
    assert compute_metrics().strides[0].rollover_radius_m == pytest.approx(CIRCLE, rel=1e-6)
    assert compute_metrics(cop_x=np.full(COUNT, np.nan)).strides[0].rollover_radius_m is None


def test_air_is_the_drawn_mass() -> None:
    assert compute_metrics().strides[0].air_g == pytest.approx(2.0, rel=1e-3)


def test_residuals_are_those_of_the_recording_and_do_not_cancel() -> None:
    clean = compute_metrics().strides[0]
    assert (clean.ledger_residual_pct, clean.force_residual_max_n) == (0.0, 0.0)
    power, nothing = channels()["delivered_power"], np.zeros(COUNT)
    stride = compute_metrics(residual_power=-0.1 * power, force_residual=nothing - 2.0).strides[0]
    assert (stride.ledger_residual_pct, stride.force_residual_max_n) == pytest.approx((10.0, 2.0))
    assert stride.ledger_j["residual"] == pytest.approx(-0.1 * stride.ledger_j["delivered"])
    assert compute_metrics(delivered_power=nothing).strides[0].ledger_residual_pct == 0.0


def test_mean_excludes_the_first_of_several_strides() -> None:
    assert len(compute_metrics().steady_strides) == 1
    outcome = compute_gait_metrics(recording(strides=3))
    assert len(outcome.steady_strides) == 2
    assert summarize_gait_run(recording(strides=3), outcome)["mean_over_strides"] == [2, 3]
    assert outcome.mean(lambda s: None) is None


def test_summary_lists_the_assumptions() -> None:
    summary = summarize_gait_run(recording(), compute_gait_metrics(recording()))
    assert {"damper.bore_mm", "air", "friction below 2 bar", "length stops", "prosthesis"} == set(
        summary["assumptions"]
    )
    assert all(text.startswith("assumed") for text in summary["assumptions"].values())
    summary["friction_offset_work_j_per_kg"] = -0.1
    remarks = " ".join(collect_remarks(summary))
    assert "tracked, not predicted" in remarks
    assert "5 assumptions" in remarks
    assert "for 100 % of the stride the pressure is below 2 bar, where the friction is extrapolated" in remarks
    assert "without a source" not in remarks
    one = " ".join(collect_remarks({**summary, "without_source": ["muscle.count"]}))
    assert "5 assumptions (see summary.json) and 1 number without a source: muscle.count; for 100 %" in one
    two = " ".join(collect_remarks({**summary, "without_source": ["muscle.count", "tendon.engagement_mm"]}))
    assert "and 2 numbers without a source: muscle.count, tendon.engagement_mm;" in two


def test_friction_remark_needs_friction_below_two_bar() -> None:
    summary = {
        **summarize_gait_run(recording(), compute_gait_metrics(recording())),
        "friction_offset_work_j_per_kg": -0.1,
    }
    assert "below 2 bar" in " ".join(collect_remarks(summary))
    for baseline in ({"friction_offset_work_j_per_kg": 0.0}, {"below_friction_fit_pct": 0.0}):
        assert "below 2 bar" not in " ".join(collect_remarks({**summary, **baseline}))


def test_table_shows_the_deviation_between_steady_strides() -> None:
    tiled = np.concatenate([channels()["ankle_angle"] * scale for scale in (9.0, 1.0, 1.0, 1.3)])
    run = recording(strides=4)
    run = Recording({**run.channels, "ankle_angle": tiled}, run.units, run.provenance)
    metrics = compute_gait_metrics(run)
    ranges = [20.0, 20.0, 26.0]
    assert metrics.standard_deviation(lambda s: s.ankle_range_deg) == pytest.approx(np.std(ranges, ddof=1), rel=1e-3)
    cells = [next(iter(column.cells)) for column in build_table(run, metrics).columns]
    assert cells == ["ankle range", "deg", "20.0", "22.0", "+10 %"]
    cells = [next(iter(column.cells)) for column in build_stride_table(run, metrics).columns]
    assert [*cells[:2], *cells[-4:]] == ["ankle range", "deg", "20.0", "20.0", "26.0", "3.5"]
    assert compute_metrics().standard_deviation(lambda s: s.ankle_range_deg) is None


def test_headline_states_the_main_results_beside_the_reference() -> None:
    run = recording(ankle_power=0.5 * channels()["ankle_power"])
    summary = summarize_gait_run(run, compute_gait_metrics(run))
    headline = format_headline(summary, compute_reference_metrics(run))
    assert f"ankle power peaks at {summary['ankle_power_peak_w_per_kg']:.2f} W/kg (50 % of the reference)" in headline
    assert f"peaks at {summary['ankle_moment_peak_nm_per_kg']:.2f} N·m/kg (100 %)" in headline
    assert "Caution" not in headline
    human = compute_reference_metrics(run)
    assert "Caution: the foot trips" in format_headline({**summary, "touches_in_swing": True}, human)
    untracked = format_headline({**summary, "grf_vertical_tracking_rms_bw": 0.3}, human)
    assert "Caution: the ankle did not carry the load" in untracked
    assert "on level ground" in format_headline({**summary, "slope_deg": 5.0}, human)


def test_remark_reports_an_untracked_load() -> None:
    summary = summarize_gait_run(recording(), compute_gait_metrics(recording()))
    for error, is_expected in ((0.09, False), (0.3, True)):
        remarks = " ".join(collect_remarks({**summary, "grf_vertical_tracking_rms_bw": error}))
        assert ("The load was not tracked (rms error 0.30 body weights)" in remarks) == is_expected


@pytest.mark.slow
def test_table_and_figure_accept_any_number_of_strides(tmp_path: Path) -> None:
    for strides, title in ((1, "test, stride 1"), (7, "test, mean of strides 2 to 7")):
        run = recording(strides=strides)
        table = build_table(run, compute_gait_metrics(run))
        assert str(table.title) == title
        for width in (60, 80):
            printed = Console(width=width, file=io.StringIO())
            printed.print(table)
            text = printed.file.getvalue()  # type: ignore[attr-defined]
            assert "…" not in text
            assert max(map(len, text.splitlines())) <= width
        assert "vertical load error, stance rms" in text  # at 80 columns, no label wraps
        figure.build_figure(run).savefig(tmp_path / f"{strides}.png")
        assert (tmp_path / f"{strides}.png").stat().st_size > 10_000
