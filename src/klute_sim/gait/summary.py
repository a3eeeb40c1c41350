"""Summary of a gait run: the mean metrics, all strides and the assumptions as one JSON object."""

from dataclasses import asdict
from typing import Any

from klute_sim.device.schema.foot import RIGID_FOOT
from klute_sim.gait.metrics import GaitMetrics, is_spring_foot
from klute_sim.gait.spring_foot import SPRING_FOOT_ASSUMPTIONS
from klute_sim.recording.recording import Recording

COMMON_ASSUMPTIONS = {
    "friction below 2 bar": "assumed: the printed fit is for 2-5 bar; below, it fades to zero at zero pressure",
    "length stops": "assumed: rigid at resting length (a stop of the dissertation) and at lock length",
    "prosthesis": "assumed: masses, inertias, return spring, joint damping, end stops (models/ankle.xml)",
}
"""Assumptions of every run besides the numbers of the device."""
REGULATOR_ASSUMPTIONS = {"air": "assumed: isothermal"}
"""Assumptions about an ideal regulator with unlimited flow."""
VALVE_ASSUMPTIONS = {
    "air": "assumed: leaves at the temperature of the muscle, throttled by ISO 6358; a check valve before the tank",
    "tube": "assumed: flow by an empirical fit for smooth tubes",
    "leak": "assumed: critical pressure ratio 0.5",
}
"""Assumptions about a supply with a valve."""

HIP_PATH_KEYS = (
    *("learning_strides", "max_learning_strides", "has_converged"),
    *("vertical_residual_bw", "forward_residual_bw"),
)
"""What the summary states on the learning of the path of the hip."""


def summarize_gait_run(recording: Recording, metrics: GaitMetrics) -> dict[str, Any]:
    """Return the run as one JSON object: means over the steady strides, then all strides."""
    options, mean = recording.provenance["options"], metrics.mean
    distances = {
        name: {
            "stance_rms": mean(lambda s, n=name: getattr(s, n).stance_rms),  # type: ignore[misc]
            "swing_rms": mean(lambda s, n=name: getattr(s, n).swing_rms),  # type: ignore[misc]
            "largest": mean(lambda s, n=name: getattr(s, n).largest),  # type: ignore[misc]
        }
        for name in ("angle_distance_sd", "moment_distance_sd", "power_distance_sd")
    }
    return {
        "device": recording.provenance["device"]["name"],
        "spring_foot_nm_per_deg": options.get("spring_foot_nm_per_deg"),
        "foot": recording.provenance.get("foot", {}).get("name", RIGID_FOOT),
        "controller": recording.provenance["controller"],
        "reference": recording.provenance["reference"]["name"],
        "reference_speed_m_per_s": recording.provenance["reference"].get("speed_m_per_s"),
        "mass_kg": options["mass_kg"],
        "stature_m": options["stature_m"],
        "speed_m_per_s": options["speed_m_per_s"],
        "stride_time_s": options["stride_time_s"],
        "slope_deg": options.get("slope_deg", 0.0),
        "strides": options["strides"],
        "mean_over_strides": [len(metrics.strides) - len(metrics.steady_strides) + 1, len(metrics.strides)],
        "ankle_range_deg": mean(lambda s: s.ankle_range_deg),
        "ankle_plantarflexion_deg": mean(lambda s: s.ankle_plantarflexion_deg),
        "ankle_moment_peak_nm_per_kg": mean(lambda s: s.ankle_moment_peak_nm_per_kg),
        "ankle_moment_peak_pct": mean(lambda s: s.ankle_moment_peak_pct),
        "ankle_power_peak_w_per_kg": mean(lambda s: s.ankle_power_peak_w_per_kg),
        "ankle_power_peak_pct": mean(lambda s: s.ankle_power_peak_pct),
        "ankle_work_net_j_per_kg": mean(lambda s: s.ankle_work_net_j_per_kg),
        "ankle_work_positive_j_per_kg": mean(lambda s: s.ankle_work_positive_j_per_kg),
        "energy_return": mean(lambda s: s.energy_return),
        "quasi_stiffness_nm_per_kg_deg": mean(lambda s: s.quasi_stiffness_nm_per_kg_deg),
        "actuator_moment_peak_nm_per_kg": mean(lambda s: s.actuator_moment_peak_nm_per_kg),
        "actuator_work_net_j_per_kg": mean(lambda s: s.actuator_work_net_j_per_kg),
        "muscle_ratio_max": mean(lambda s: s.muscle_ratio_max),
        "first_contact_pct": mean(lambda s: s.first_contact_pct),
        "toe_off_pct": mean(lambda s: s.toe_off_pct),
        "touches_in_swing": metrics.has_swing_contact,
        "grf_vertical_peaks_bw": [
            mean(lambda s: s.grf_vertical_peaks_bw[0]),
            mean(lambda s: s.grf_vertical_peaks_bw[1]),
        ],
        "grf_vertical_max_bw": mean(lambda s: s.grf_vertical_max_bw),
        "grf_vertical_tracking_rms_bw": mean(lambda s: s.grf_vertical_tracking_rms_bw),
        "grf_forward_tracking_rms_bw": mean(lambda s: s.grf_forward_tracking_rms_bw),
        "grf_note": "tracked, not predicted: the rig learns the path of the hip so that the foot carries the load "
        "of the reference",
        "hip_path": {key: recording.provenance["hip_path"][key] for key in HIP_PATH_KEYS},
        "alignment_deg": options["alignment_deg"],
        "loading_rate_max_bw_per_s": mean(lambda s: s.loading_rate_max_bw_per_s),
        "contact_lost_in_stance": any(s.contact_lost_in_stance for s in metrics.steady_strides),
        "grf_forward_bw": [mean(lambda s: s.grf_forward_min_bw), mean(lambda s: s.grf_forward_max_bw)],
        "sole_depth_max_mm": mean(lambda s: s.sole_depth_max_mm),
        "toe_clearance_mm": mean(lambda s: s.toe_clearance_mm),
        "rollover_radius_m": mean(lambda s: s.rollover_radius_m),
        "distance_to_reference": distances,
        "friction_offset_work_j_per_kg": mean(lambda s: s.friction_offset_work_j_per_kg),
        "below_friction_fit_pct": mean(lambda s: s.below_friction_fit_pct),
        "air_per_stride_g": mean(lambda s: s.air_g),
        "short_of_supply_pct": mean(lambda s: s.short_of_supply_pct),
        "air_leaked_per_stride_g": mean(lambda s: s.air_leaked_g),
        "ledger_j": {line: mean(lambda s, n=line: s.ledger_j[n]) for line in metrics.strides[0].ledger_j},  # type: ignore[misc]
        "ledger_residual_pct": mean(lambda s: s.ledger_residual_pct),
        "force_residual_max_n": mean(lambda s: s.force_residual_max_n),
        "assumptions": _collect_assumptions(recording),
        "without_source": recording.provenance["device"].get("without_source", []),
        "per_stride": [asdict(s) for s in metrics.strides],
    }


def _collect_assumptions(recording: Recording) -> dict[str, str]:
    """Return quantity -> assumption of the run; those of the device only if it was simulated."""
    foot_assumptions = recording.provenance.get("foot", {}).get("assumed", {})
    if is_spring_foot(recording):
        return {**SPRING_FOOT_ASSUMPTIONS, **foot_assumptions}
    device = recording.provenance["device"]
    return {
        **COMMON_ASSUMPTIONS,
        **(VALVE_ASSUMPTIONS if device["valve"] else REGULATOR_ASSUMPTIONS),
        **device["assumed"],
        **foot_assumptions,
    }
