"""One combination walked: what a field user wants of it, or why there is nothing."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from klute_sim.errors import KluteSimError
from klute_sim.gait.metrics import GaitMetrics, StrideMetrics, compute_gait_metrics
from klute_sim.gait.rig import rig
from klute_sim.parameter_sweep.fingerprint import fingerprint_software
from klute_sim.parameter_sweep.plan import GaitCase
from klute_sim.recording.recording import Recording

MetricValue = float | bool | None
UNEXPECTED_ERROR_PREFIX = "unexpected"
"""First word of a failure that is a mistake of ours."""

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
    "air_per_stride [g]": lambda s: s.air_g,
    "short_of_supply [%]": lambda s: s.short_of_supply_pct,
}
"""Heading -> of one stride; the mean over the settled strides is kept."""
REFERENCE_DISTANCES: dict[str, Callable[[StrideMetrics], float | None]] = {
    "angle_distance [sd]": lambda s: s.angle_distance_sd.stance_rms,
    "moment_distance [sd]": lambda s: s.moment_distance_sd.stance_rms,
    "power_distance [sd]": lambda s: s.power_distance_sd.stance_rms,
}
"""To the reference in stance: likewise, where the reference's people walked as this one did."""
SPATIOTEMPORAL_COLUMNS = ("speed [m/s]", "stride_time [s]")
TRIPS_COLUMN = "trips"
METRIC_COLUMNS = (*SPATIOTEMPORAL_COLUMNS, *REFERENCE_DISTANCES, *STRIDE_METRICS, TRIPS_COLUMN)
"""Everything there is of a walk, in the order of the table."""


@dataclass(frozen=True)
class CaseResult:
    """What became of a combination: outcomes, or one sentence on why there are none."""

    metrics: Mapping[str, MetricValue]
    """Heading -> value, for all of :data:`HEADINGS`; empty after a failure."""
    failure: str | None = None


def evaluate_case(case: GaitCase) -> CaseResult:
    """Walk ``combination``; what goes wrong in it is its result, and no end of the sweep.

    Raises KluteSimError where other software runs than where the sweep was planned, and MemoryError, which says
    nothing about the combination.
    """
    if case.software != fingerprint_software():
        different = sorted(
            name for name, version in fingerprint_software().items() if case.software.get(name) != version
        )
        raise KluteSimError(
            f"a process of the sweep runs other software than the one that planned it (other {', '.join(different)}): "
            "install the same klute-sim everywhere and begin in a new folder"
        )
    try:
        recording = rig.simulate_gait(case.device, case.controller, case.build_options())
        return CaseResult(_extract_metrics(recording, case))
    except KluteSimError as error:
        return CaseResult({}, str(error))
    except MemoryError:
        raise
    except Exception as error:  # one combination that trips over a mistake of ours must not cost a night's sweep
        return CaseResult({}, f"{UNEXPECTED_ERROR_PREFIX} {type(error).__name__}: {error}")


def _extract_metrics(recording: Recording, case: GaitCase) -> dict[str, MetricValue]:
    outcome, options = compute_gait_metrics(recording), recording.provenance["options"]
    compared = _has_reference_stride_time(options["stride_time_s"], case)  # on a slope there is no distance anyway
    found: dict[str, MetricValue] = {
        "speed [m/s]": options["speed_m_per_s"],
        "stride_time [s]": options["stride_time_s"],
    }
    found |= {
        heading: _finite_mean(outcome, read) if compared else None for heading, read in REFERENCE_DISTANCES.items()
    }
    found |= {heading: _finite_mean(outcome, read) for heading, read in STRIDE_METRICS.items()}
    return {**found, TRIPS_COLUMN: outcome.has_swing_contact}


def _has_reference_stride_time(stride_time: float, case: GaitCase) -> bool:
    """Whether this walk is at the reference's own stride time [s], to the step that strides are a whole number of."""
    return abs(stride_time - case.build_options().reference.stride_time) <= 0.5 * case.dt


def _finite_mean(metrics: GaitMetrics, get_value: Callable[[StrideMetrics], float | None]) -> float | None:
    value = metrics.mean(get_value)
    return value if value is not None and math.isfinite(value) else None
