"""Metrics of a gait recording: one set per stride, and their mean.

Ankle moment, power and work are those of the *net joint moment* (tendon, return spring, joint damping, stop),
plantarflexor positive, as inverse dynamics would measure them. The work of the actuator is a separate metric.

The first stride starts in the posture of the reference. The mean excludes it when there are more strides.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from klute_sim.constants import GRAVITY
from klute_sim.device.energy.ledger import POWER_TERMS, format_effect_channel
from klute_sim.effects import catalogue
from klute_sim.gait.contact_events import find_contact_events
from klute_sim.gait.reference import STANCE_LOAD_BW
from klute_sim.gait.roll_over import ROLLOVER_END_PCT, fit_rollover_radius
from klute_sim.laws.mckibben import FRICTION_FADE_PRESSURE
from klute_sim.recording.recording import Recording
from klute_sim.types import Array
from klute_sim.units import BAR

SMOOTHING_WINDOW_S = 0.015
"""Window [s] of the moving average for peak power and vertical load peaks."""
GRF_PEAK_WINDOWS_PCT = ((4.0, 33.0), (33.0, 65.0))
"""Gait phases [%] of the two peaks of the vertical ground reaction."""
FLAT_FOOT_WINDOW_PCT = (2.0, 25.0)
"""Gait phases [%] of the minimum dorsiflexion in stance, which is flat foot."""
SWING_MARGIN_PCT = 3.0
"""Margin [%] after the toe-off and before the heel strike of the reference, between which the foot must not touch the
ground."""
LOADING_INTERVAL_S = 5e-3
"""Interval [s] of the loading rate."""
MID_SWING_WINDOW_PCT = (75.0, 92.0)
"""Gait phases [%] of the minimum toe clearance in swing."""
MIN_REFERENCE_SD = {"angle_deg": 2.0, "moment_nm_per_kg": 0.05, "power_w_per_kg": 0.1}
"""Minimum standard deviations for distances to the reference; those of swing are tiny."""


@dataclass(frozen=True, kw_only=True)
class ReferenceDistance:
    """Distance to the reference in standard deviations of the reference; None where it has none."""

    stance_rms: float | None
    """Root mean square in stance [1]."""
    swing_rms: float | None
    """Root mean square in swing [1]."""
    largest: float | None
    """Maximum over the cycle [1]."""


@dataclass(frozen=True, kw_only=True)
class AnkleMetrics:
    """One stride of an ankle, human or prosthetic; phases in % of the cycle, work and power per kg of body mass."""

    ankle_range_deg: float
    """Range of the ankle angle."""
    ankle_plantarflexion_deg: float
    """Maximum plantarflexion; negative if the ankle is dorsiflexed throughout."""
    ankle_moment_peak_nm_per_kg: float
    """Maximum net ankle moment."""
    ankle_moment_peak_pct: float
    """Gait phase of the maximum moment."""
    ankle_power_peak_w_per_kg: float
    """Maximum ankle power, smoothed over :data:`SMOOTHING_WINDOW_S`."""
    ankle_power_peak_pct: float
    """Gait phase of the maximum power."""
    ankle_work_net_j_per_kg: float
    """Net work of the ankle."""
    ankle_work_positive_j_per_kg: float
    """Positive work of the ankle."""
    energy_return: float | None
    """Positive over negative work in stance [1]; above 1 only with a powered ankle. None: no negative work."""
    quasi_stiffness_nm_per_kg_deg: float | None
    """Slope of moment over angle in mid-stance, from flat foot to maximum dorsiflexion (Shamaei et al. 2013)."""
    first_contact_pct: float | None
    """Gait phase of first contact; negative: before the heel strike of the reference. None: no contact."""
    toe_off_pct: float | None
    """Gait phase of toe-off; None: no contact."""
    grf_vertical_peaks_bw: tuple[float, float]
    """Two peaks of the vertical ground reaction, smoothed; tracked by the rig, not predicted."""
    grf_vertical_max_bw: float
    """Maximum vertical ground reaction."""
    grf_forward_min_bw: float
    """Minimum fore-aft ground reaction (braking)."""
    grf_forward_max_bw: float
    """Maximum fore-aft ground reaction (push-off)."""


@dataclass(frozen=True, kw_only=True)
class StrideMetrics(AnkleMetrics):
    """One stride of the prosthesis on the rig."""

    actuator_moment_peak_nm_per_kg: float
    """Maximum moment of the actuator."""
    actuator_work_net_j_per_kg: float
    """Net work of the actuator."""
    touches_in_swing: bool
    """Whether the foot touches the ground in swing."""
    grf_vertical_tracking_rms_bw: float
    """Root-mean-square tracking error of the vertical ground reaction in stance."""
    grf_forward_tracking_rms_bw: float
    """Root-mean-square tracking error of the fore-aft ground reaction in stance."""
    loading_rate_max_bw_per_s: float
    """Largest increase of the vertical ground reaction within :data:`LOADING_INTERVAL_S`, per second."""
    contact_lost_in_stance: bool
    """Whether the foot leaves the ground between its first contact and its toe-off."""
    sole_depth_max_mm: float
    """Maximum penetration of the sole into the ground."""
    toe_clearance_mm: float
    """Minimum height of the sole above the ground in mid-swing; negative: penetration."""
    rollover_radius_m: float | None
    """Radius of the centre of pressure in the frame of the shank; None if it does not describe an arc."""
    angle_distance_sd: ReferenceDistance
    """Distance of the ankle angle to the reference."""
    moment_distance_sd: ReferenceDistance
    """Distance of the ankle moment to the reference."""
    power_distance_sd: ReferenceDistance
    """Distance of the ankle power to the reference."""
    friction_offset_work_j_per_kg: float
    """Work of the printed friction offset; of either sign, because it is an offset."""
    below_friction_fit_pct: float
    """Percentage of the stride below 2 bar, where the fade of the friction offset is assumed."""
    muscle_ratio_max: float | None
    """Maximum muscle length over resting length; 1 is the stop. None: the resting length is unknown, or no muscle."""
    air_g: float
    """Air drawn from the supply; isothermal for an ideal regulator (assumed)."""
    air_leaked_g: float
    """Air lost through a leak."""
    short_of_supply_pct: float
    """Percentage of the stride in which the command exceeds the supply pressure, as with an empty tank."""
    ledger_j: Mapping[str, float]
    """Energy of each term of the energy balance in the stride, of each effect, ``delivered`` and ``residual``."""
    ledger_residual_pct: float
    """Residual of the energy balance over the delivered work, absolute values of both; proportional to the step."""
    force_residual_max_n: float
    """Maximum residual of the force balance at the junction of muscle and tendon."""


@dataclass(frozen=True)
class GaitMetrics:
    """Metrics of all strides of a recording."""

    strides: tuple[StrideMetrics, ...]
    """Metrics of each stride."""

    @property
    def steady_strides(self) -> tuple[StrideMetrics, ...]:
        """Strides of the mean: all except the first, if there are more."""
        return self.strides[1:] or self.strides

    @property
    def has_swing_contact(self) -> bool:
        """Whether the foot touches the ground in the swing of a steady stride."""
        return any(stride.touches_in_swing for stride in self.steady_strides)

    def mean(self, metric: Callable[[StrideMetrics], float | None]) -> float | None:
        """Return the mean of ``metric`` over the steady strides; None if a stride has no value."""
        values = [metric(stride) for stride in self.steady_strides]
        known = [value for value in values if value is not None]
        return float(np.mean(known)) if len(known) == len(values) else None

    def standard_deviation(self, metric: Callable[[StrideMetrics], float | None]) -> float | None:
        """Return the standard deviation of ``metric`` (n - 1) between the steady strides.

        None with fewer than two steady strides, or if a stride has no value.
        """
        values = [metric(stride) for stride in self.steady_strides]
        known = [value for value in values if value is not None]
        return float(np.std(known, ddof=1)) if len(known) == len(values) > 1 else None


def is_spring_foot(recording: Recording) -> bool:
    """Return whether a passive foot replaced the device."""
    return recording.provenance["options"].get("spring_foot_nm_per_deg") is not None


def compute_gait_metrics(recording: Recording) -> GaitMetrics:
    """Return the metrics of all strides of a gait ``recording``."""
    mass = float(recording.provenance["options"]["mass_kg"])
    first, last = int(recording["stride"][0]), int(recording["stride"][-1])
    return GaitMetrics(
        tuple(_compute_stride_metrics(recording.select(recording["stride"] == k), mass) for k in range(first, last + 1))
    )


def is_level_ground(recording: Recording) -> bool:
    """Return whether the ground was level; there is no measured reference for a slope."""
    return bool(recording.provenance["options"].get("slope_deg", 0.0) == 0.0)


def compute_reference_metrics(recording: Recording) -> AnkleMetrics:
    """Return the same metrics of the human reference that ``recording`` followed."""
    mass = float(recording.provenance["options"]["mass_kg"])
    return AnkleMetrics(
        **_compute_ankle_metrics(recording.select(recording["stride"] == recording["stride"][0]), "reference_", mass)
    )


def _compute_ankle_metrics(stride: Recording, prefix: str, mass: float) -> dict[str, Any]:
    """Return the fields of :class:`AnkleMetrics` from the channels of one stride that begin with ``prefix``."""
    phase, dt, weight = stride["gait_phase"], _get_time_step(stride), mass * GRAVITY
    moment, power = stride[f"{prefix}ankle_moment"] / mass, stride[f"{prefix}ankle_power"] / mass
    smooth_power = _smooth(power, SMOOTHING_WINDOW_S / dt)
    vertical, forward = stride[f"{prefix}grf_vertical"] / weight, stride[f"{prefix}grf_forward"] / weight
    smooth_load = _smooth(vertical, SMOOTHING_WINDOW_S / dt)
    first, toe_off = find_contact_events(phase, vertical > STANCE_LOAD_BW)
    # Integrated over the angle and not over time, because a reference has no time.
    angle = stride[f"{prefix}ankle_angle"]
    work = -moment * np.gradient(np.radians(angle))
    negative_work = float(np.minimum(work[vertical > STANCE_LOAD_BW], 0.0).sum())
    return {
        "ankle_range_deg": float(np.ptp(angle)),
        "ankle_plantarflexion_deg": float(-angle.min()),
        "ankle_moment_peak_nm_per_kg": float(moment.max()),
        "ankle_moment_peak_pct": float(phase[moment.argmax()]),
        "ankle_power_peak_w_per_kg": float(smooth_power.max()),
        "ankle_power_peak_pct": float(phase[smooth_power.argmax()]),
        "ankle_work_net_j_per_kg": float(work.sum()),
        "ankle_work_positive_j_per_kg": float(np.maximum(work, 0.0).sum()),
        "energy_return": float(np.maximum(work[vertical > STANCE_LOAD_BW], 0.0).sum()) / -negative_work
        if negative_work < 0.0
        else None,
        "quasi_stiffness_nm_per_kg_deg": _fit_quasi_stiffness(phase, angle, moment),
        "first_contact_pct": first,
        "toe_off_pct": toe_off,
        "grf_vertical_peaks_bw": (
            float(smooth_load[_mask_between(phase, *GRF_PEAK_WINDOWS_PCT[0])].max()),
            float(smooth_load[_mask_between(phase, *GRF_PEAK_WINDOWS_PCT[1])].max()),
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
    phase, dt, weight = stride["gait_phase"], _get_time_step(stride), mass * GRAVITY
    contact = stride["grf_vertical"] > STANCE_LOAD_BW * weight
    stance = stride["reference_grf_vertical"] > STANCE_LOAD_BW * weight
    load_error = (stride["grf_vertical"] - stride["reference_grf_vertical"]) / weight
    # The reference may be loaded in the last samples of the stride, too.
    toe_off = find_contact_events(phase, stance)[1] or 0.0
    swing = _mask_between(phase, toe_off + SWING_MARGIN_PCT, 100.0 - SWING_MARGIN_PCT)
    return StrideMetrics(
        **_compute_ankle_metrics(stride, "", mass),
        actuator_moment_peak_nm_per_kg=float(stride["actuator_moment"].max() / mass),
        actuator_work_net_j_per_kg=float(stride["actuator_power"].sum() * dt / mass),
        touches_in_swing=bool((stride["grf_vertical"][swing] > 0.0).any()),
        grf_vertical_tracking_rms_bw=_compute_rms(load_error[stance]),
        grf_forward_tracking_rms_bw=_compute_rms(
            (stride["grf_forward"] - stride["reference_grf_forward"])[stance] / weight
        ),
        loading_rate_max_bw_per_s=_compute_max_loading_rate(stride["grf_vertical"] / weight, dt),
        contact_lost_in_stance=_loses_contact(phase, stride["grf_vertical"] / weight),
        sole_depth_max_mm=float(-1e3 * min(0.0, stride["sole_height"].min())),
        toe_clearance_mm=float(1e3 * stride["sole_height"][_mask_between(phase, *MID_SWING_WINDOW_PCT)].min()),
        rollover_radius_m=fit_rollover_radius(stride, contact & (phase < ROLLOVER_END_PCT)),
        angle_distance_sd=_compute_distance(stride, "ankle_angle", 1.0, MIN_REFERENCE_SD["angle_deg"], stance),
        moment_distance_sd=_compute_distance(
            stride, "ankle_moment", mass, MIN_REFERENCE_SD["moment_nm_per_kg"], stance
        ),
        power_distance_sd=_compute_distance(stride, "ankle_power", mass, MIN_REFERENCE_SD["power_w_per_kg"], stance),
        friction_offset_work_j_per_kg=float(stride["friction_power"].sum() * dt / mass),
        below_friction_fit_pct=float(100.0 * np.mean(stride["pressure"] < FRICTION_FADE_PRESSURE / BAR)),
        muscle_ratio_max=_compute_max_muscle_ratio(stride),
        air_g=float(1e3 * (stride["air_drawn"][-1] - stride["air_drawn"][0])),
        air_leaked_g=float(1e3 * (stride["air_leaked"][-1] - stride["air_leaked"][0])),
        short_of_supply_pct=float(100.0 * np.mean(stride["pressure_command"] > stride["supply_pressure"])),
        ledger_j=_compute_energy_ledger(stride, dt),
        ledger_residual_pct=_compute_ledger_residual(stride, dt),
        force_residual_max_n=float(np.abs(stride["force_residual"]).max()),
    )


def _compute_max_muscle_ratio(stride: Recording) -> float | None:
    resting_length = stride.provenance["device"].get("resting_length_m")
    return None if resting_length is None else float(stride["muscle_length"].max() / resting_length)


def _compute_max_loading_rate(load: Array, dt: float) -> float:
    """Return the largest increase [1/s] of ``load`` over :data:`LOADING_INTERVAL_S`."""
    n_steps = max(1, round(LOADING_INTERVAL_S / dt))
    return float((load[n_steps:] - load[:-n_steps]).max() / (n_steps * dt))


def _loses_contact(phase: Array, load: Array) -> bool:
    """Return whether the ``load`` [body weights] vanishes between two loaded samples before 97 % of the cycle.

    A toe that has left the ground may still graze it as it swings away, with less load than a loaded foot has.
    """
    loaded = np.flatnonzero((load > STANCE_LOAD_BW) & (phase < 100.0 - SWING_MARGIN_PCT))
    return bool(len(loaded) and (load[loaded[0] : loaded[-1] + 1] <= 0.0).any())


def _get_time_step(stride: Recording) -> float:
    return float(stride["time"][1] - stride["time"][0])


def _mask_between(phase: Array, lower: float, upper: float) -> np.ndarray:
    return np.asarray((phase >= lower) & (phase <= upper))


def _compute_rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values * values)))


def _smooth(values: Array, width: float) -> Array:
    """Return the centred periodic moving average over about ``width`` samples."""
    half = max(0, round((width - 1.0) / 2.0))
    padded = np.concatenate([values[len(values) - half :], values, values[:half]])
    return np.convolve(padded, np.full(2 * half + 1, 1.0 / (2 * half + 1)), "valid")


def _compute_distance(
    stride: Recording, channel: str, scale: float, min_sd: float, stance: np.ndarray
) -> ReferenceDistance:
    if f"reference_{channel}_sd" not in stride:
        return ReferenceDistance(stance_rms=None, swing_rms=None, largest=None)
    standard_deviation = np.maximum(stride[f"reference_{channel}_sd"] / scale, min_sd)
    z = (stride[channel] - stride[f"reference_{channel}"]) / scale / standard_deviation
    return ReferenceDistance(
        stance_rms=_compute_rms(z[stance]), swing_rms=_compute_rms(z[~stance]), largest=float(np.abs(z).max())
    )


def _compute_energy_ledger(stride: Recording, dt: float) -> dict[str, float]:
    effect_channels = [name for name in map(format_effect_channel, catalogue.get_effects()) if name in stride]
    return {
        name.removesuffix("_power"): float(stride[name].sum() * dt)
        for name in (*POWER_TERMS, *effect_channels, "delivered_power", "residual_power")
    }


def _compute_ledger_residual(stride: Recording, dt: float) -> float:
    """Return the absolute residual of the energy balance [% of the absolute delivered work]; nothing cancels in it."""
    # The power of a sample belongs to the time step that ends there, so the first sample does not count.
    residual, delivered = stride["residual_power"][1:], stride["delivered_power"][1:]
    exchanged = float(np.abs(delivered).sum())
    return 100.0 * float(np.abs(residual).sum()) / exchanged if exchanged > 0.0 else 0.0
