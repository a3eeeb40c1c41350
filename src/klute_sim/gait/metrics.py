"""What a gait recording amounts to: one set of outcomes per stride, and their mean.

Ankle moment, power and work are those of the *net joint moment* (tendon, return spring, joint damping, stop),
plantarflexor positive: what inverse dynamics would measure. The actuator's own work stands beside it.

The first stride starts from the reference's posture and is left out of the mean when there is another one.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from klute_sim.device.energy.ledger import POWER_TERMS, SOLVER_TERM, format_effect_channel
from klute_sim.effects import catalogue
from klute_sim.gait.reference import GRAVITY, STANCE_LOAD_BW
from klute_sim.laws.mckibben import FRICTION_FADE_PRESSURE
from klute_sim.recording.recording import Array, Recording
from klute_sim.units import BAR

SMOOTHING_WINDOW_S = 0.015
"""Moving average [s] under which peak power and vertical humps are read: the raw power spikes as the last sole sphere
lifts off, and the raw load jumps as the forefoot comes down at 8 % of the cycle."""
MID_STANCE_PCT = 30.0
"""Phase [%] that stance is looked for around."""
MAX_CONTACT_GAP_PCT = 5.0
"""Longest loss of contact [%] that does not end stance."""
GRF_PEAK_WINDOWS_PCT = ((4.0, 33.0), (33.0, 65.0))
"""Phases [%] between which the two humps of the vertical ground reaction are looked for."""
FLAT_FOOT_WINDOW_PCT = (2.0, 25.0)
"""Phases [%] in which the least dorsiflexion of stance, and with it flat foot, is looked for."""
SWING_CLEARANCE_WINDOW_PCT = (65.0, 97.0)
"""Phases [%] in which nothing may touch the ground."""
MID_SWING_WINDOW_PCT = (75.0, 92.0)
"""Phases [%] in which the toe swings past the ground at its lowest."""
MIN_REFERENCE_SD = {"angle_deg": 2.0, "moment_nm_per_kg": 0.05, "power_w_per_kg": 0.1}
"""Least standard deviation that a distance is measured in: those of swing are tiny."""
COMMON_ASSUMPTIONS = {
    "friction below 2 bar": "assumed: the printed fit is for 2-5 bar; below, it is faded to zero at zero pressure",
    "length stops": "assumed: rigid at resting length (the stop itself is the source's) and at lock length",
    "prosthesis": "assumed: masses, inertias, return spring, joint damping, end stops (models/ankle.xml)",
}
"""What was assumed in every run, besides the device's own numbers."""
REGULATOR_ASSUMPTIONS = {"air": "assumed: isothermal, no dead volume"}
VALVE_ASSUMPTIONS = {
    "air": "assumed: leaves at the muscle's own temperature, throttled by ISO 6358; a check valve before the tank",
    "tube": "assumed: flow by an empirical fit for smooth tubes",
    "leak": "assumed: critical pressure ratio 0.5",
}
"""Likewise, where air comes from a regulator that gives any flow, or through a valve."""
ROLLOVER_END_PCT = 50.0
"""Phase [%] of the opposite heel strike: the roll-over shape is taken up to it (Hansen & Meier 2010)."""


@dataclass(frozen=True, kw_only=True)
class ReferenceDistance:
    """Distance to the reference in its standard deviations; None where the reference has none."""

    stance_rms: float | None
    swing_rms: float | None
    largest: float | None
    """Anywhere in the cycle."""


@dataclass(frozen=True, kw_only=True)
class AnkleMetrics:
    """One stride of an ankle, human or not; phases in % of the cycle, work and power per kg of body mass."""

    ankle_range_deg: float
    ankle_plantarflexion_deg: float
    """The most of it; negative if it is dorsiflexed throughout."""
    ankle_moment_peak_nm_per_kg: float
    ankle_moment_peak_pct: float
    ankle_power_peak_w_per_kg: float
    """Of power averaged over :data:`SHORT`."""
    ankle_power_peak_pct: float
    ankle_work_net_j_per_kg: float
    ankle_work_positive_j_per_kg: float
    energy_return: float | None
    """Positive over negative work in stance [1]: above 1 only with power. None: none was put in."""
    quasi_stiffness_nm_per_kg_deg: float | None
    """Slope of moment over angle in the middle of stance, from flat foot to most dorsiflexion (Shamaei et al. 2013)."""
    first_contact_pct: float | None
    """Negative: before the reference's heel strike. None: never touched."""
    toe_off_pct: float | None
    grf_vertical_peaks_bw: tuple[float, float]
    """Averaged over :data:`SHORT`; the prosthesis': tracked, not predicted."""
    grf_vertical_max_bw: float
    grf_forward_min_bw: float
    grf_forward_max_bw: float


@dataclass(frozen=True, kw_only=True)
class StrideMetrics(AnkleMetrics):
    """One stride of the prosthesis on the rig."""

    actuator_moment_peak_nm_per_kg: float
    actuator_work_net_j_per_kg: float
    touches_in_swing: bool
    grf_vertical_tracking_rms_bw: float
    sole_depth_max_mm: float
    toe_clearance_mm: float
    """Least height of the sole above the ground in :data:`MID_SWING`; negative: it is in the ground."""
    rollover_radius_m: float | None
    """Of the centre of pressure in the shank's frame; None if it does not describe an arc."""
    angle_distance_sd: ReferenceDistance
    moment_distance_sd: ReferenceDistance
    power_distance_sd: ReferenceDistance
    friction_offset_work_j_per_kg: float
    """What the printed friction gave the device; either sign, because it is an offset."""
    below_friction_fit_pct: float
    """Share of the stride below :data:`FRICTION_ONSET`, where the friction offset is an assumed fade."""
    muscle_ratio_max: float | None
    """Most L/L0 of the muscle: 1 is its rest-length stop. None: the recording does not tell L0."""
    air_g: float
    """Air taken from the supply; of an ideal regulator's isothermal and without dead volume (assumed)."""
    air_leaked_g: float
    short_of_supply_pct: float
    """Share of the stride in which more pressure was commanded than the supply had: its tank ran low."""
    ledger_j: Mapping[str, float]
    """Energy that each line of the device's ledger gave in the stride [J], each effect by itself; and ``delivered``."""
    ledger_residual_pct: float
    """What its elements do not account for, over the work the device did both ways: the time step's error."""


@dataclass(frozen=True)
class GaitMetrics:
    """All strides of a recording."""

    strides: tuple[StrideMetrics, ...]

    @property
    def steady_strides(self) -> tuple[StrideMetrics, ...]:
        """The strides that the mean is over: all but the first, if there is another."""
        return self.strides[1:] or self.strides

    @property
    def has_swing_contact(self) -> bool:
        """Whether the foot touches the ground in the swing of a settled stride."""
        return any(s.touches_in_swing for s in self.steady_strides)

    def mean(self, metric: Callable[[StrideMetrics], float | None]) -> float | None:
        """Mean of ``value`` over the settled strides; None if any of them has none."""
        values = [metric(s) for s in self.steady_strides]
        known = [v for v in values if v is not None]
        return float(np.mean(known)) if len(known) == len(values) else None


def compute_gait_metrics(recording: Recording) -> GaitMetrics:
    """Outcomes of every stride of a gait ``recording``."""
    mass = float(recording.provenance["options"]["mass_kg"])
    first, last = int(recording["stride"][0]), int(recording["stride"][-1])
    return GaitMetrics(
        tuple(_compute_stride_metrics(recording.select(recording["stride"] == k), mass) for k in range(first, last + 1))
    )


def is_level_ground(recording: Recording) -> bool:
    """Whether the ground was level; on a slope nobody's gait was measured, and there is nothing to compare with."""
    return bool(recording.provenance["options"].get("slope_deg", 0.0) == 0.0)


def compute_reference_metrics(recording: Recording) -> AnkleMetrics:
    """The same outcomes of the human reference that ``recording`` was compared with, or that it followed on a slope."""
    mass = float(recording.provenance["options"]["mass_kg"])
    return AnkleMetrics(
        **_compute_ankle_metrics(recording.select(recording["stride"] == recording["stride"][0]), "reference_", mass)
    )


def _compute_ankle_metrics(stride: Recording, prefix: str, mass: float) -> dict[str, Any]:
    """Fields of :class:`AnkleOutcome` from one stride's channels that begin with ``prefix``."""
    phase, step, weight = stride["gait_phase"], _get_time_step(stride), mass * GRAVITY
    moment, power = stride[f"{prefix}ankle_moment"] / mass, stride[f"{prefix}ankle_power"] / mass
    smooth = _smooth(power, SMOOTHING_WINDOW_S / step)
    vertical, forward = stride[f"{prefix}grf_vertical"] / weight, stride[f"{prefix}grf_forward"] / weight
    carried = _smooth(vertical, SMOOTHING_WINDOW_S / step)
    first, lift = _find_contact_events(phase, vertical > STANCE_LOAD_BW)
    # Over the angle, not over time: a reference has no stride time of its own.
    angle = stride[f"{prefix}ankle_angle"]
    work = -moment * np.gradient(np.radians(angle))
    absorbed = float(np.minimum(work[vertical > STANCE_LOAD_BW], 0.0).sum())
    return {
        "ankle_range_deg": float(np.ptp(angle)),
        "ankle_plantarflexion_deg": float(-angle.min()),
        "ankle_moment_peak_nm_per_kg": float(moment.max()),
        "ankle_moment_peak_pct": float(phase[moment.argmax()]),
        "ankle_power_peak_w_per_kg": float(smooth.max()),
        "ankle_power_peak_pct": float(phase[smooth.argmax()]),
        "ankle_work_net_j_per_kg": float(work.sum()),
        "ankle_work_positive_j_per_kg": float(np.maximum(work, 0.0).sum()),
        "energy_return": float(np.maximum(work[vertical > STANCE_LOAD_BW], 0.0).sum()) / -absorbed
        if absorbed < 0.0
        else None,
        "quasi_stiffness_nm_per_kg_deg": _fit_quasi_stiffness(phase, angle, moment),
        "first_contact_pct": first,
        "toe_off_pct": lift,
        "grf_vertical_peaks_bw": (
            float(carried[_mask_between(phase, *GRF_PEAK_WINDOWS_PCT[0])].max()),
            float(carried[_mask_between(phase, *GRF_PEAK_WINDOWS_PCT[1])].max()),
        ),
        "grf_vertical_max_bw": float(vertical.max()),
        "grf_forward_min_bw": float(forward.min()),
        "grf_forward_max_bw": float(forward.max()),
    }


def _fit_quasi_stiffness(phase: Array, angle: Array, moment: Array) -> float | None:
    early = np.flatnonzero(_mask_between(phase, *FLAT_FOOT_WINDOW_PCT))
    begin = int(early[angle[early].argmin()])
    late = np.flatnonzero(_mask_between(phase, phase[begin], 65.0))
    end = int(late[angle[late].argmax()])
    if end - begin < 3 or np.ptp(angle[begin:end]) < 1.0:
        return None
    return float(np.polyfit(angle[begin:end], moment[begin:end], 1)[0])


def _compute_stride_metrics(stride: Recording, mass: float) -> StrideMetrics:
    phase, step, weight = stride["gait_phase"], _get_time_step(stride), mass * GRAVITY
    contact = stride["grf_vertical"] > STANCE_LOAD_BW * weight
    stance = stride["reference_grf_vertical"] > STANCE_LOAD_BW * weight
    return StrideMetrics(
        **_compute_ankle_metrics(stride, "", mass),
        actuator_moment_peak_nm_per_kg=float(stride["actuator_moment"].max() / mass),
        actuator_work_net_j_per_kg=float(stride["actuator_power"].sum() * step / mass),
        touches_in_swing=bool((stride["grf_vertical"][_mask_between(phase, *SWING_CLEARANCE_WINDOW_PCT)] > 0.0).any()),
        grf_vertical_tracking_rms_bw=_compute_rms((stride["grf_vertical"] - stride["reference_grf_vertical"]) / weight),
        sole_depth_max_mm=float(-1e3 * min(0.0, stride["sole_height"].min())),
        toe_clearance_mm=float(1e3 * stride["sole_height"][_mask_between(phase, *MID_SWING_WINDOW_PCT)].min()),
        rollover_radius_m=_fit_rollover_radius(stride, contact & (phase < ROLLOVER_END_PCT)),
        angle_distance_sd=_compute_distance(stride, "ankle_angle", 1.0, MIN_REFERENCE_SD["angle_deg"], stance),
        moment_distance_sd=_compute_distance(
            stride, "ankle_moment", mass, MIN_REFERENCE_SD["moment_nm_per_kg"], stance
        ),
        power_distance_sd=_compute_distance(stride, "ankle_power", mass, MIN_REFERENCE_SD["power_w_per_kg"], stance),
        friction_offset_work_j_per_kg=float(stride["friction_power"].sum() * step / mass),
        below_friction_fit_pct=float(100.0 * np.mean(stride["pressure"] < FRICTION_FADE_PRESSURE / BAR)),
        muscle_ratio_max=_compute_max_muscle_ratio(stride),
        air_g=float(1e3 * (stride["air_drawn"][-1] - stride["air_drawn"][0])),
        air_leaked_g=float(1e3 * (stride["air_leaked"][-1] - stride["air_leaked"][0])),
        short_of_supply_pct=float(100.0 * np.mean(stride["pressure_command"] > stride["supply_pressure"])),
        ledger_j=_compute_energy_ledger(stride, step),
        ledger_residual_pct=_compute_ledger_residual(stride, step),
    )


def _compute_max_muscle_ratio(stride: Recording) -> float | None:
    resting = stride.provenance["device"].get("resting_length_m")
    passive = stride.provenance["options"].get("spring_foot_nm_per_deg") is not None
    return None if resting is None or passive else float(stride["muscle_length"].max() / resting)


def _get_time_step(stride: Recording) -> float:
    return float(stride["time"][1] - stride["time"][0])


def _mask_between(phase: Array, lower: float, upper: float) -> np.ndarray:
    return np.asarray((phase >= lower) & (phase <= upper))


def _compute_rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values * values)))


def _smooth(values: Array, width: float) -> Array:
    """Centred periodic moving average over about ``width`` samples."""
    half = max(0, round((width - 1.0) / 2.0))
    padded = np.concatenate([values[len(values) - half :], values, values[:half]])
    return np.convolve(padded, np.full(2 * half + 1, 1.0 / (2 * half + 1)), "valid")


def _find_contact_events(phase: Array, contact: np.ndarray) -> tuple[float | None, float | None]:
    """First and last contact [%] of the stance around :data:`MID_STANCE`, over gaps up to :data:`GAP`.

    A scuff in swing is no stance: it is told apart by the gap before it.
    """
    if not contact.any():
        return None, None
    cycle = np.sort(phase[contact] - MID_STANCE_PCT)
    cycle = np.concatenate([cycle[cycle >= 50.0] - 100.0, cycle[cycle < 50.0]])  # mid-stance in the middle
    before, after = cycle[cycle <= 0.0][::-1], cycle[cycle >= 0.0]
    return MID_STANCE_PCT - _measure_unbroken_extent(-before), MID_STANCE_PCT + _measure_unbroken_extent(after)


def _measure_unbroken_extent(distances: Array) -> float:
    """How far rising ``distances`` go from 0 before the first gap."""
    steps = np.diff(distances, prepend=0.0)
    gaps = np.flatnonzero(steps > MAX_CONTACT_GAP_PCT)
    unbroken = distances[: gaps[0]] if len(gaps) else distances
    return float(unbroken[-1]) if len(unbroken) else 0.0


def _compute_distance(
    stride: Recording, channel: str, scale: float, min_sd: float, stance: np.ndarray
) -> ReferenceDistance:
    if f"reference_{channel}_sd" not in stride:
        return ReferenceDistance(stance_rms=None, swing_rms=None, largest=None)
    deviation = np.maximum(stride[f"reference_{channel}_sd"] / scale, min_sd)
    z = (stride[channel] - stride[f"reference_{channel}"]) / scale / deviation
    return ReferenceDistance(
        stance_rms=_compute_rms(z[stance]), swing_rms=_compute_rms(z[~stance]), largest=float(np.abs(z).max())
    )


def _fit_rollover_radius(stride: Recording, loaded: np.ndarray) -> float | None:
    """Radius [m] of the circle that fits the centre of pressure in the shank's frame best (Kasa's fit)."""
    use = loaded & np.isfinite(stride["cop_x"])
    if use.sum() < 10:
        return None
    tilt = np.radians(stride["shank_angle"][use])
    x, z = stride["cop_x"][use] - stride["ankle_x"][use], -stride["ankle_z"][use]
    along, up = np.cos(tilt) * x - np.sin(tilt) * z, np.sin(tilt) * x + np.cos(tilt) * z
    matrix = np.column_stack([along, up, np.ones_like(along)])
    (a, b, c), _, rank, _ = np.linalg.lstsq(matrix, along * along + up * up, rcond=None)
    square = c + 0.25 * (a * a + b * b)
    return float(np.sqrt(square)) if rank == 3 and square > 0.0 else None


def _compute_energy_ledger(stride: Recording, dt: float) -> dict[str, float]:
    own = [name for name in map(format_effect_channel, catalogue.get_effects()) if name in stride]
    return {
        name.removesuffix("_power"): float(stride[name].sum() * dt) for name in (*POWER_TERMS, *own, "delivered_power")
    }


def _compute_ledger_residual(stride: Recording, dt: float) -> float:
    """Percent of the device's work, both ways, that its elements do not account for."""
    # A sample's power holds for the step that ends there: the first one only tells where the count begins.
    given = sum(stride[line][1:] for line in POWER_TERMS if line != SOLVER_TERM)
    delivered = stride["delivered_power"][1:]
    residual, exchanged = float((given - delivered).sum()) * dt, float(np.abs(delivered).sum()) * dt
    return 100.0 * residual / exchanged if exchanged > 0.0 else 0.0


def summarize_gait_run(recording: Recording, metrics: GaitMetrics) -> dict[str, Any]:
    """The run as one JSON object: means over the settled strides, then every stride."""
    options, mean = recording.provenance["options"], metrics.mean
    air = VALVE_ASSUMPTIONS if recording.provenance["device"]["valve"] else REGULATOR_ASSUMPTIONS
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
        "grf_vertical_note": "tracked, not predicted: the reference's load is fed to the carriage",
        "grf_forward_note": "partly prescribed: the reference's fore-aft load is fed to the carriage, too; push-off is "
        "mostly the device's, braking is not",
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
        "assumptions": {**COMMON_ASSUMPTIONS, **air, **recording.provenance["device"]["assumed"]},
        "without_source": recording.provenance["device"]["without_source"],
        "per_stride": [asdict(s) for s in metrics.strides],
    }
