"""One combination walked: what a field user wants of it, or why there is nothing."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from klute_sim.errors import KluteSimError
from klute_sim.recording.recording import Recording
from klute_sim.report.outcomes import GaitOutcome, StrideOutcome, outcomes
from klute_sim.rigs.gait import rig
from klute_sim.sweep.plan import Combination
from klute_sim.sweep.software import software

Value = float | bool | None
UNEXPECTED = "unexpected"
"""First word of a failure that is a mistake of ours."""

MEANS: dict[str, Callable[[StrideOutcome], float | None]] = {
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
DISTANCES: dict[str, Callable[[StrideOutcome], float | None]] = {
    "angle_distance [sd]": lambda s: s.angle_distance_sd.stance_rms,
    "moment_distance [sd]": lambda s: s.moment_distance_sd.stance_rms,
    "power_distance [sd]": lambda s: s.power_distance_sd.stance_rms,
}
"""To the reference in stance: likewise, where the reference's people walked as this one did."""
WALKED = ("speed [m/s]", "stride_time [s]")
TRIPS = "trips"
HEADINGS = (*WALKED, *DISTANCES, *MEANS, TRIPS)
"""Everything there is of a walk, in the order of the table."""


@dataclass(frozen=True)
class Walked:
    """What became of a combination: outcomes, or one sentence on why there are none."""

    outcomes: Mapping[str, Value]
    """Heading -> value, for all of :data:`HEADINGS`; empty after a failure."""
    failure: str | None = None


def walk(combination: Combination) -> Walked:
    """Walk ``combination``; what goes wrong in it is its result, and no end of the sweep.

    Raises KluteSimError where other software runs than where the sweep was planned, and MemoryError, which says
    nothing about the combination.
    """
    if combination.software != software():
        different = sorted(name for name, version in software().items() if combination.software.get(name) != version)
        raise KluteSimError(
            f"a process of the sweep runs other software than the one that planned it (other {', '.join(different)}): "
            "install the same klute-sim everywhere and begin in a new folder"
        )
    try:
        recording = rig.walk(combination.device, combination.controller, combination.options())
        return Walked(_outcomes(recording, combination))
    except KluteSimError as error:
        return Walked({}, str(error))
    except MemoryError:
        raise
    except Exception as error:  # one combination that trips over a mistake of ours must not cost a night's sweep
        return Walked({}, f"{UNEXPECTED} {type(error).__name__}: {error}")


def _outcomes(recording: Recording, combination: Combination) -> dict[str, Value]:
    outcome, options = outcomes(recording), recording.provenance["options"]
    compared = _in_time(options["stride_time_s"], combination)  # on a slope there is no distance anyway
    found: dict[str, Value] = {"speed [m/s]": options["speed_m_per_s"], "stride_time [s]": options["stride_time_s"]}
    found |= {heading: _mean(outcome, read) if compared else None for heading, read in DISTANCES.items()}
    found |= {heading: _mean(outcome, read) for heading, read in MEANS.items()}
    return {**found, TRIPS: outcome.trips}


def _in_time(stride_time: float, combination: Combination) -> bool:
    """Whether this walk is at the reference's own stride time [s], to the step that strides are a whole number of."""
    return abs(stride_time - combination.options().reference.stride_time) <= 0.5 * combination.step


def _mean(outcome: GaitOutcome, read: Callable[[StrideOutcome], float | None]) -> float | None:
    value = outcome.mean(read)
    return value if value is not None and math.isfinite(value) else None
