"""The tuning objective: distance of the ankle from the human reference, air consumption, and penalties.

The objective is the sum of

* the mean squared distances of net moment, angle and power from the reference in stance, in its standard deviations,
* 0.1 per gram of air consumed in a stride,
* penalties on a peak moment far from that of the reference, on a muscle at its rest-length stop, on a load that is not
  that of the reference (an ankle that does not carry it cannot be compared with it), on fast loading, on braking and on
  low toe clearance in swing,
* the shortfall from the goals, if there are any.

A toe that touches the ground in swing costs more than any gait without that; a run that fails costs more still.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields

from klute_sim.errors import InputError

TOE_CATCH_COST, FALL_COST = 1e9, 1e12
"""Cost of a toe that catches in swing, and of a run that fails: above the worst other cost at the largest weights.

The search uses only the ranks of the costs.
"""
MOMENT_PEAK_COST = 1e4
"""Cost per square of the relative error of the peak moment above :data:`MAX_MOMENT_PEAK_ERROR` (assumed)."""
MAX_MOMENT_PEAK_ERROR = 0.08
"""Relative error of the peak moment without cost [1]: a little less than the 0.1 that ``klute-sim assess`` allows
(assumed). A search that must come nearer pays with power and work that are too large."""
LENGTH_STOP_COST = 1e4
"""Cost per square of L/L0 above :data:`MAX_MUSCLE_RATIO`."""
MAX_MUSCLE_RATIO = 0.985
"""L/L0 above which the muscle nears its rest-length stop, which is not meant to carry load [1]."""
CLEARANCE_COST_PER_MM2 = 1.0
"""Cost per square of the toe clearance missing to :data:`MIN_TOE_CLEARANCE_MM` (assumed) [1/mm2]."""
MIN_TOE_CLEARANCE_MM = 3.0
"""Minimum toe clearance in mid-swing [mm], with a margin for longer runs at finer time steps (assumed)."""
LOAD_TRACKING_COST = 3e3
"""Cost per square of the rms load error above :data:`MAX_LOAD_TRACKING_ERROR_BW` [body weights] (assumed)."""
MAX_LOAD_TRACKING_ERROR_BW = 0.04
"""Rms error of the vertical load in stance without cost [body weights] (assumed)."""
LOADING_RATE_COST = 1e-2
"""Cost per square of the loading rate above :data:`MAX_LOADING_RATE_BW_PER_S` [body weights per s] (assumed)."""
MAX_LOADING_RATE_BW_PER_S = 25.0
"""Loading rate without cost [body weights per s] (assumed); people walk with 10 to 25."""
BRAKING_COST = 1e3
"""Cost per square of the braking above :data:`MAX_BRAKING_BW` [body weights] (assumed)."""
MAX_BRAKING_BW = 0.22
"""Largest braking without cost [body weights] (assumed); the default reference brakes with 0.16."""


@dataclass(frozen=True, kw_only=True)
class Goals:
    """Metrics to reach; each shortfall is divided by a tolerance of comparable importance (assumed)."""

    moment_sd: float | None = None
    """Maximum rms distance of the net moment in stance [sd]; tolerance 0.2. None: no goal."""
    power_w_per_kg: float | None = None
    """Minimum peak net power [W/kg]; tolerance 0.5. None: no goal."""
    work_j_per_kg: float | None = None
    """Minimum net ankle work per stride [J/kg]; tolerance 0.03. None: no goal."""
    plantarflexion_deg: float | None = None
    """Minimum peak plantarflexion [deg]; tolerance 1.5. None: no goal."""

    def compute_shortfall(self, metrics: "TuningMetrics") -> float:
        """Return the sum of the shortfalls over their tolerances; 0 when all goals are reached."""
        terms = (
            (self.moment_sd, metrics.moment_sd, 0.2, -1.0),
            (self.power_w_per_kg, metrics.power_w_per_kg, 0.5, 1.0),
            (self.work_j_per_kg, metrics.work_j_per_kg, 0.03, 1.0),
            (self.plantarflexion_deg, metrics.plantarflexion_deg, 1.5, 1.0),
        )
        return sum(
            max(0.0, sign * (goal - value)) / tolerance for goal, value, tolerance, sign in terms if goal is not None
        )


HUMAN_GOALS = Goals(moment_sd=0.39, power_w_per_kg=3.31, work_j_per_kg=0.218, plantarflexion_deg=15.0)
"""The human ankle within the differences between the reference's own groups (0.4 sd, 3.3 W/kg, 0.215 J/kg).

The goals are slightly stricter, because the short and coarse runs of the search flatter by about as much.
"""


@dataclass(frozen=True, kw_only=True)
class Weights:
    """Weights of the terms of the objective; validated when made."""

    moment: float = 1.0
    """Weight of the squared moment distance [1/sd2]."""
    angle: float = 1.0
    """Weight of the squared angle distance [1/sd2]."""
    power: float = 1.0
    """Weight of the squared power distance [1/sd2]."""
    air: float = 0.1
    """Weight of the air consumed in a stride [1/g]."""

    def __post_init__(self) -> None:
        """Raise InputError when a weight is out of range or all are zero."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        for name, value in values.items():
            if not 0.0 <= value <= 1e3:  # also refuses NaN
                raise InputError(f"weight of {name} is {value:g}; allowed: 0 to 1000")
        if not any(values.values()):
            raise InputError("all weights are 0; allowed: at least one above 0")


@dataclass(frozen=True, kw_only=True)
class TuningMetrics:
    """Metrics of a gait simulation that enter the objective."""

    moment_sd: float
    """Rms distance of the net moment from the reference in stance [sd]."""
    angle_sd: float
    """Rms distance of the angle from the reference in stance [sd]."""
    power_sd: float
    """Rms distance of the net power from the reference in stance [sd]."""
    air_g: float
    """Air consumed in a stride [g]."""
    moment_peak_ratio: float
    """Peak net moment over that of the reference [1]."""
    power_w_per_kg: float
    """Peak net power [W/kg]."""
    work_j_per_kg: float
    """Net ankle work in a stride [J/kg]."""
    plantarflexion_deg: float
    """Peak plantarflexion [deg]."""
    muscle_ratio_max: float
    """Maximum L/L0 of the muscle [1]."""
    toe_clearance_mm: float
    """Minimum height of the sole in mid-swing [mm]."""
    load_tracking_rms_bw: float
    """Rms error of the vertical load against the reference in stance [body weights]."""
    loading_rate_bw_per_s: float
    """Maximum loading rate [body weights per s]."""
    braking_bw: float
    """Minimum fore-aft ground reaction, negative in braking [body weights]."""
    trips: bool
    """Whether the foot touches the ground in swing."""


def compute_tracking_error(metrics: TuningMetrics, weights: Weights) -> float:
    """Return the weighted squared distance to the reference [sd2], summed over moment, angle and power."""
    squares = metrics.moment_sd**2, metrics.angle_sd**2, metrics.power_sd**2
    return math.fsum(w * s for w, s in zip((weights.moment, weights.angle, weights.power), squares, strict=True))


@dataclass(frozen=True, kw_only=True)
class ObjectiveTerm:
    """One summand of the objective, with the quantity that it depends on."""

    name: str
    """Name with article, for a sentence."""
    cost: float
    """Summand of the objective [1]."""
    value: float | None = None
    """Value of the quantity in its unit; None: several quantities, or none that is a number."""
    unit: str = ""
    """Unit of the quantity in words; empty for a pure number."""
    allowed: str = ""
    """Values of the quantity without cost; empty where every value costs."""
    is_penalty: bool = False
    """Whether the term is 0 for every gait that the objective accepts."""


def compute_terms(metrics: TuningMetrics, weights: Weights, goals: Goals) -> tuple[ObjectiveTerm, ...]:
    """Return the summands of the objective: tracking error, air, each penalty, and the goals if there are any."""
    terms = (
        ObjectiveTerm(
            name="the tracking error", cost=compute_tracking_error(metrics, weights), unit="weighted sum [sd²]"
        ),
        ObjectiveTerm(
            name="the air", cost=weights.air * metrics.air_g, value=metrics.air_g, unit=f"g, times {weights.air:g}"
        ),
        *compute_penalties(metrics),
    )
    if goals == Goals():
        return terms
    return (*terms, ObjectiveTerm(name="the shortfall from the goals", cost=goals.compute_shortfall(metrics)))


def compute_penalties(metrics: TuningMetrics) -> tuple[ObjectiveTerm, ...]:
    """Return the penalties of the objective, whose cost is 0 within their limits."""
    peak_error = max(0.0, abs(metrics.moment_peak_ratio - 1.0) - MAX_MOMENT_PEAK_ERROR)
    load_error = max(0.0, metrics.load_tracking_rms_bw - MAX_LOAD_TRACKING_ERROR_BW)
    rate_excess = max(0.0, metrics.loading_rate_bw_per_s - MAX_LOADING_RATE_BW_PER_S)
    low, high = 100.0 * (1.0 - MAX_MOMENT_PEAK_ERROR), 100.0 * (1.0 + MAX_MOMENT_PEAK_ERROR)
    return (
        ObjectiveTerm(
            name="the penalty of the peak moment",
            cost=MOMENT_PEAK_COST * peak_error**2,
            value=100.0 * metrics.moment_peak_ratio,
            unit="% of that of the reference",
            allowed=f"{low:g} to {high:g} %",
            is_penalty=True,
        ),
        ObjectiveTerm(
            name="the penalty of the muscle length",
            cost=LENGTH_STOP_COST * max(0.0, metrics.muscle_ratio_max - MAX_MUSCLE_RATIO) ** 2,
            value=metrics.muscle_ratio_max,
            unit="of the resting length",
            allowed=f"at most {MAX_MUSCLE_RATIO:g}",
            is_penalty=True,
        ),
        ObjectiveTerm(
            name="the penalty of the load error",
            cost=LOAD_TRACKING_COST * load_error**2,
            value=metrics.load_tracking_rms_bw,
            unit="body weights (rms)",
            allowed=f"at most {MAX_LOAD_TRACKING_ERROR_BW:g}",
            is_penalty=True,
        ),
        ObjectiveTerm(
            name="the penalty of the loading rate",
            cost=LOADING_RATE_COST * rate_excess**2,
            value=metrics.loading_rate_bw_per_s,
            unit="body weights per second",
            allowed=f"at most {MAX_LOADING_RATE_BW_PER_S:g}",
            is_penalty=True,
        ),
        ObjectiveTerm(
            name="the penalty of the braking",
            cost=BRAKING_COST * max(0.0, -metrics.braking_bw - MAX_BRAKING_BW) ** 2,
            value=-metrics.braking_bw,
            unit="body weights",
            allowed=f"at most {MAX_BRAKING_BW:g}",
            is_penalty=True,
        ),
        ObjectiveTerm(
            name="the penalty of the toe clearance",
            cost=CLEARANCE_COST_PER_MM2 * max(0.0, MIN_TOE_CLEARANCE_MM - metrics.toe_clearance_mm) ** 2,
            value=metrics.toe_clearance_mm,
            unit="mm",
            allowed=f"at least {MIN_TOE_CLEARANCE_MM:g}",
            is_penalty=True,
        ),
        ObjectiveTerm(
            name="the penalty of a contact in swing",
            cost=TOE_CATCH_COST if metrics.trips else 0.0,
            allowed="none",
            is_penalty=True,
        ),
    )


def compute_cost(metrics: TuningMetrics, weights: Weights, goals: Goals) -> float:
    """Return the objective; smaller is better."""
    return sum(term.cost for term in compute_terms(metrics, weights, goals))


def make_weights(values: Mapping[str, float]) -> Weights:
    """Return the default weights with ``values`` in place of some; raises InputError when a name is unknown."""
    names = [field.name for field in fields(Weights)]
    for name in values:
        if name not in names:
            raise InputError(f"the objective has no term '{name}' to weight; allowed: {', '.join(names)}")
    return Weights(**dict(values))
