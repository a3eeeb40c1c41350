"""Evaluate one case: simulate it and compute the metrics, or report why there are none."""

import math
import platform
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from klute_sim.errors import KluteSimError
from klute_sim.gait.metrics import GaitMetrics, StrideMetrics, compute_gait_metrics
from klute_sim.gait.reference import DEVIATION_COLUMNS, MAX_GRF_TRACKING_RMS_BW
from klute_sim.gait.rig import rig
from klute_sim.parameter_sweep.fingerprint import (
    describe_difference,
    fingerprint_joint_software,
    fingerprint_software,
    fingerprint_walk_software,
)
from klute_sim.parameter_sweep.joint_metrics import compute_joint_metrics
from klute_sim.parameter_sweep.joint_plan import JointCase
from klute_sim.parameter_sweep.plan import GaitCase
from klute_sim.parameter_sweep.walk_metrics import compute_walk_metrics
from klute_sim.parameter_sweep.walk_plan import WalkCase
from klute_sim.recording.recording import Recording

MetricValue = float | bool | None
Case = GaitCase | WalkCase | JointCase
UNEXPECTED_ERROR_PREFIX = "unexpected"
"""First word of a failure that is a bug of this package."""

STRIDE_METRICS: dict[str, Callable[[StrideMetrics], float | None]] = {
    "ankle_power_peak [W/kg]": lambda s: s.ankle_power_peak_w_per_kg,
    "ankle_work_net [J/kg]": lambda s: s.ankle_work_net_j_per_kg,
    "ankle_work_positive [J/kg]": lambda s: s.ankle_work_positive_j_per_kg,
    "ankle_moment_peak [N*m/kg]": lambda s: s.ankle_moment_peak_nm_per_kg,
    "ankle_range [deg]": lambda s: s.ankle_range_deg,
    "ankle_plantarflexion [deg]": lambda s: s.ankle_plantarflexion_deg,
    "energy_return [1]": lambda s: s.energy_return,
    "quasi_stiffness [N*m/kg/deg]": lambda s: s.quasi_stiffness_nm_per_kg_deg,
    "muscle_ratio_max [1]": lambda s: s.muscle_ratio_max,
    "toe_off [%]": lambda s: s.toe_off_pct,
    "toe_clearance [mm]": lambda s: s.toe_clearance_mm,
    "rollover_radius [m]": lambda s: s.rollover_radius_m,
    "grf_vertical_tracking_rms [1]": lambda s: s.grf_vertical_tracking_rms_bw,
    "grf_vertical_peak_1 [1]": lambda s: s.grf_vertical_peaks_bw[0],
    "grf_vertical_peak_2 [1]": lambda s: s.grf_vertical_peaks_bw[1],
    "grf_vertical_max [1]": lambda s: s.grf_vertical_max_bw,
    "grf_forward_min [1]": lambda s: s.grf_forward_min_bw,
    "loading_rate_max [1/s]": lambda s: s.loading_rate_max_bw_per_s,
    "air_per_stride [g]": lambda s: s.air_g,
    "short_of_supply [%]": lambda s: s.short_of_supply_pct,
}
"""Function that reads a metric from one stride, by column; the table holds the mean over the steady strides."""
REFERENCE_DISTANCES: dict[str, Callable[[StrideMetrics], float | None]] = {
    "angle_distance [sd]": lambda s: s.angle_distance_sd.stance_rms,
    "moment_distance [sd]": lambda s: s.moment_distance_sd.stance_rms,
    "power_distance [sd]": lambda s: s.power_distance_sd.stance_rms,
}
"""Distances to the reference in stance, by column; only where the speed and the slope are those of the reference."""
SPATIOTEMPORAL_COLUMNS = ("speed [m/s]", "stride_time [s]")
TRIPS_COLUMN = "trips"
"""Whether the foot touches the ground in swing."""
UNTRACKED_COLUMN = "load_not_tracked"
"""Whether the ankle does not carry the load of the reference: its rms error is above the largest allowed."""
CONTACT_LOST_COLUMN = "contact_lost"
"""Whether the foot leaves the ground for an instant in stance."""
STATUS_COLUMNS = (TRIPS_COLUMN, UNTRACKED_COLUMN, CONTACT_LOST_COLUMN)
"""Columns that say whether a gait is usable."""
METRIC_COLUMNS = (*SPATIOTEMPORAL_COLUMNS, *REFERENCE_DISTANCES, *STRIDE_METRICS, *STATUS_COLUMNS)
"""All metrics of a case, in the order of the table."""


FINGERPRINTS: dict[type, Callable[[], dict[str, str]]] = {
    **{GaitCase: fingerprint_software, WalkCase: fingerprint_walk_software},
    JointCase: fingerprint_joint_software,
}
"""Kind of a case -> function that returns the fingerprint of its software."""


@dataclass(frozen=True)
class CaseResult:
    """Metrics of a case, or one sentence on why there are none."""

    metrics: Mapping[str, MetricValue]
    """Value by column, for all metrics of the rig; empty after a failure."""
    failure: str | None = None
    """Reason of the failure; None: the simulation succeeded."""


def evaluate_case(case: Case) -> CaseResult:
    """Simulate ``case`` and return its metrics; an error in the simulation is a result and does not end the sweep.

    Raises KluteSimError when this process runs other software than the process that planned the case, and MemoryError,
    which depends on the machine and not on the case.
    """
    software = FINGERPRINTS[type(case)]()
    if difference := describe_difference(software, case.software):
        raise KluteSimError(
            f"a worker process on '{platform.node()}' runs other software than the process that planned the sweep "
            f"({difference}): install the same klute-sim on every machine and start in a new folder"
        )
    try:
        if isinstance(case, WalkCase):
            return CaseResult(compute_walk_metrics(case))
        if isinstance(case, JointCase):
            return CaseResult(compute_joint_metrics(case))
        recording = rig.simulate_gait(case.device, case.controller, case.build_options())
        return CaseResult(_extract_metrics(recording, case))
    except KluteSimError as error:
        return CaseResult({}, str(error))
    except MemoryError:
        raise
    except Exception as error:  # a bug that one case triggers must not cost the results of a whole night
        return CaseResult({}, f"{UNEXPECTED_ERROR_PREFIX} {type(error).__name__}: {error}")


def _extract_metrics(recording: Recording, case: GaitCase) -> dict[str, MetricValue]:
    metrics, options = compute_gait_metrics(recording), recording.provenance["options"]
    # On a slope the metrics themselves hold no distance, unless the standard deviations are assumed.
    is_assumed = set(DEVIATION_COLUMNS) <= set(case.subject.reference.assumed_deviations)
    is_comparable = is_assumed or _has_reference_stride_time(options["stride_time_s"], case)
    values: dict[str, MetricValue] = {
        "speed [m/s]": options["speed_m_per_s"],
        "stride_time [s]": options["stride_time_s"],
    }
    values |= {
        column: _finite_mean(metrics, get_value) if is_comparable else None
        for column, get_value in REFERENCE_DISTANCES.items()
    }
    values |= {column: _finite_mean(metrics, get_value) for column, get_value in STRIDE_METRICS.items()}
    tracking_error = values["grf_vertical_tracking_rms [1]"]
    is_untracked = tracking_error is None or tracking_error > MAX_GRF_TRACKING_RMS_BW
    return {
        **values,
        TRIPS_COLUMN: metrics.has_swing_contact,
        UNTRACKED_COLUMN: is_untracked,
        CONTACT_LOST_COLUMN: any(stride.contact_lost_in_stance for stride in metrics.steady_strides),
    }


def _has_reference_stride_time(stride_time: float, case: GaitCase) -> bool:
    """Return whether ``stride_time`` [s] is that of the reference; it is rounded to a whole number of time steps."""
    return abs(stride_time - case.subject.reference.stride_time) <= 0.5 * case.dt


def _finite_mean(metrics: GaitMetrics, get_value: Callable[[StrideMetrics], float | None]) -> float | None:
    value = metrics.mean(get_value)
    return value if value is not None and math.isfinite(value) else None
