"""Outcomes of a recorded walk: speed, steps, ground reaction, cost, device work, and likeness to people's gait.

Strides run from foot strike to foot strike of the same leg. Everything is averaged over whole strides after a
transient. A walk that ends in a fall keeps its last strides out.
"""

import itertools
from dataclasses import dataclass

import numpy as np

from klute_sim.constants import GRAVITY
from klute_sim.gait.reference import Reference, load_default_reference
from klute_sim.recording.recording import Recording
from klute_sim.types import Array
from klute_sim.walker.person.body import SIDES

TRANSIENT = 3.0
"""Time at the start that does not count [s]."""
STRIKE_LOAD_BW = 0.05
"""Load [body weights] above which a foot is on the ground."""
MIN_SWING, MIN_STRIDE = 0.15, 0.4
"""Shortest swing before a foot strike and shortest stride [s]; anything shorter is a bounce."""
PEAK_WINDOW = 0.015
"""Window of the moving average for the peak load [s], as for the gait rig."""
SEGMENT_LENGTH = 0.43
"""Length of thigh and shank [m], as in models/walker.xml."""
N_PHASES = 101
"""Number of points of a mean curve over the cycle."""

CURVES = {
    "hip": ("hip_angle", "hip_flexion_deg"),
    "knee": ("knee_angle", "knee_flexion_deg"),
    "ankle": ("ankle_angle", "ankle_dorsiflexion_deg"),
    "grf_vertical": ("grf_vertical", "grf_vertical_n_per_kg"),
    "grf_forward": ("grf_forward", "grf_forward_n_per_kg"),
}
"""Channel and column of the reference by name of the curve; angles in deg, ground reactions in body weights."""


@dataclass(frozen=True, kw_only=True)
class Likeness:
    """Agreement of a mean curve with the reference."""

    correlation: float
    """Pearson correlation over the cycle [1]."""
    rms: float
    """Root mean square of the difference [deg], or [body weights] for a ground reaction."""


@dataclass(frozen=True, kw_only=True)
class LegOutcomes:
    """Outcomes of one leg."""

    curves: dict[str, Array]
    """Mean curves over the cycle (:data:`N_PHASES`,) by the names of :data:`CURVES`."""
    deviations: dict[str, Array]
    """Standard deviations between strides, likewise."""
    likeness: dict[str, Likeness]
    """Agreement with the reference by curve."""
    stride_time: float
    """Mean stride time [s]."""
    stride_time_sd: float
    """Standard deviation of the stride time [s]."""
    stance_share: float
    """Share of the stride with load on the foot [1]."""
    step_length: float
    """Distance by which this foot strikes ahead of the other one [m]."""
    peak_load_bw: float
    """Mean over the strides of the largest vertical ground reaction, as a moving average of 15 ms [body weights]."""


@dataclass(frozen=True, kw_only=True)
class WalkOutcomes:
    """Outcomes of a walk."""

    duration_s: float
    """Time walked [s]."""
    has_fallen: bool
    """Whether the walk ended in a fall."""
    distance_m: float
    """Distance walked [m]."""
    n_steps: int
    """Number of foot strikes of both legs after the transient."""
    speed_m_per_s: float | None
    """Mean speed after the transient; None: the walk ended before."""
    cost_minetti_j_per_kg_m: float | None
    """Metabolic cost after Minetti and Alexander, without the basal rate."""
    cost_bhargava_j_per_kg_m: float | None
    """Metabolic cost after Bhargava et al., without the basal rate."""
    step_asymmetry: float | None
    """(left - right)/(left + right) of the step lengths; the right leg carries the prosthesis."""
    device_work_net_j: float | None
    """Net work of the device per stride; None without a device."""
    device_work_positive_j: float | None
    """Positive work of the device per stride."""
    legs: dict[str, LegOutcomes]
    """Outcomes by side; a leg with fewer than two strides is left out."""


def compute_outcomes(recording: Recording, reference: Reference | None = None) -> WalkOutcomes:
    """Return the outcomes of ``recording`` beside ``reference`` (None: able-bodied adults)."""
    reference = reference or load_default_reference()
    time, x = recording["time"], recording["hip_x"]
    mass = float(recording.provenance["options"]["mass_kg"])
    begin = int(np.searchsorted(time, TRANSIENT))
    legs, strikes = {}, {}
    for name in SIDES:
        strikes[name] = find_strikes(recording, name, mass)
        strikes[name] = strikes[name][strikes[name] >= begin]
        if len(strikes[name]) >= 3:
            legs[name] = _compute_leg(recording, name, strikes[name], mass, reference)
    speed = minetti = bhargava = None
    if begin < len(time) - 1:
        distance = float(x[-1] - x[begin])
        speed = distance / float(time[-1] - time[begin])
        if distance > 0.5:
            minetti, bhargava = (
                float(recording[f"metabolic_energy_{law}"][-1] - recording[f"metabolic_energy_{law}"][begin])
                / (mass * distance)
                for law in ("minetti", "bhargava")
            )
    asymmetry = None
    if len(legs) == len(SIDES):
        left, right = (legs[name].step_length for name in SIDES)
        asymmetry = (left - right) / (left + right)
    net, positive = _compute_device_work(recording, strikes["right"])
    return WalkOutcomes(
        duration_s=float(time[-1] + time[1]) if len(time) > 1 else 0.0,
        has_fallen=bool(recording.provenance["has_fallen"]),
        distance_m=float(x[-1] - x[0]) if len(x) else 0.0,
        n_steps=sum(len(strike_times) for strike_times in strikes.values()),
        speed_m_per_s=speed,
        cost_minetti_j_per_kg_m=minetti,
        cost_bhargava_j_per_kg_m=bhargava,
        step_asymmetry=asymmetry,
        device_work_net_j=net,
        device_work_positive_j=positive,
        legs=legs,
    )


def find_strikes(recording: Recording, side: str, mass: float) -> np.ndarray:
    """Return the samples of the foot strikes of a leg: its load rises after a swing."""
    time = recording["time"]
    loaded = recording[f"grf_vertical_{side}"] > STRIKE_LOAD_BW * mass * GRAVITY
    if len(time) < 2:
        return np.array([], dtype=np.int64)
    n_swing = round(MIN_SWING / float(time[1] - time[0]))
    strikes: list[int] = []
    for k in np.flatnonzero(loaded[1:] & ~loaded[:-1]) + 1:
        is_after_swing = k >= n_swing and not loaded[k - n_swing : k].any()
        if is_after_swing and (not strikes or time[k] - time[strikes[-1]] > MIN_STRIDE):
            strikes.append(int(k))
    return np.array(strikes, dtype=np.int64)


def _compute_leg(
    recording: Recording, side: str, strikes: np.ndarray, mass: float, reference: Reference
) -> LegOutcomes:
    phase = np.linspace(0.0, 1.0, N_PHASES)
    weight = mass * GRAVITY
    curves, deviations, likeness = {}, {}, {}
    pairs = list(itertools.pairwise(strikes))
    for name, (channel, column) in CURVES.items():
        scale = weight if name.startswith("grf") else 1.0
        samples, index = recording[f"{channel}_{side}"] / scale, np.arange(len(recording))
        cycles = np.array([np.interp(np.linspace(a, b, N_PHASES), index, samples) for a, b in pairs])
        curves[name], deviations[name] = cycles.mean(axis=0), cycles.std(axis=0)
        human = reference(column, phase % 1.0) / (GRAVITY if name.startswith("grf") else 1.0)
        likeness[name] = Likeness(
            correlation=float(np.corrcoef(curves[name], human)[0, 1]),
            rms=float(np.sqrt(np.mean((curves[name] - human) ** 2))),
        )
    load, time = recording[f"grf_vertical_{side}"] / weight, recording["time"]
    n_window = max(1, round(PEAK_WINDOW / float(time[1] - time[0])))
    smooth_load = np.convolve(load, np.full(n_window, 1.0 / n_window), mode="same")
    times = np.diff(time[strikes])
    other = SIDES[1 - SIDES.index(side)]
    ahead = _compute_ankle_position(recording, side) - _compute_ankle_position(recording, other)
    return LegOutcomes(
        curves=curves,
        deviations=deviations,
        likeness=likeness,
        stride_time=float(times.mean()),
        stride_time_sd=float(times.std()),
        stance_share=float(np.mean([np.mean(load[a:b] > STRIKE_LOAD_BW) for a, b in pairs])),
        step_length=float(ahead[strikes].mean()),
        peak_load_bw=float(np.mean([smooth_load[a:b].max() for a, b in pairs])),
    )


def _compute_ankle_position(recording: Recording, side: str) -> Array:
    """Return the position of an ankle ahead of the hip [m], along the ground."""
    slope = np.radians(recording.provenance["options"]["slope_deg"])
    thigh = np.radians(recording[f"hip_angle_{side}"] - recording["trunk_lean"]) - slope
    shank = thigh - np.radians(recording[f"knee_angle_{side}"])
    return np.asarray(SEGMENT_LENGTH * (np.sin(thigh) + np.sin(shank)))


def _compute_device_work(recording: Recording, strikes: np.ndarray) -> tuple[float | None, float | None]:
    if "device_power" not in recording or len(strikes) < 2:
        return None, None
    power = recording["device_power"][strikes[0] : strikes[-1]]
    dt, n_strides = float(recording["time"][1] - recording["time"][0]), len(strikes) - 1
    return float(power.sum()) * dt / n_strides, float(np.maximum(power, 0.0).sum()) * dt / n_strides
