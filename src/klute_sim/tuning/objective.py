"""What tuning makes small: how far the ankle is from the human one, and the air that takes.

In words: the mean squared distance of net moment, angle and power from the reference in stance, in its standard
deviations, each counted once; plus 0.1 for every gram of air in a stride; plus what keeps a muscle off its rest-length
stop, the rig's load on the foot (an ankle that does not carry what the human one does cannot be compared with it) and
the toe off the ground in swing.
Goals add what they are missed by. A foot that catches the ground in swing comes after every walk that does not, and a
rig that leaves its path after those.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields

from klute_sim.errors import InputError

TOE_CATCH_COST, FALL_COST = 1e9, 1e12
"""What a foot that catches in swing costs, and a walk that ends early: more than the worst walk at the largest weights.
The search goes by ranks alone."""
LENGTH_STOP_COST = 1e4
"""Cost of a muscle at its rest-length stop: times the square of L/L0 above :data:`FREE`; the stop is no spring."""
MAX_MUSCLE_RATIO = 0.985
"""L/L0 below which a muscle is clear of its stop."""
CLEARANCE_COST_PER_MM2 = 1.0
"""Cost of a toe that swings low: times the square of what is missing to :data:`CLEARANCE` [mm] (assumed)."""
MIN_TOE_CLEARANCE_MM = 3.0
"""Least height of the toe in mid-swing [mm], so that a longer and finer walk does not catch either (assumed)."""
LOAD_TRACKING_COST = 3e3
"""Cost of load that is not followed: times the square of its rms [body weights] above :data:`FOLLOWED` (assumed)."""
MAX_LOAD_TRACKING_ERROR_BW = 0.14
"""Rms distance of the load [body weights] that may be (assumed); reports warn from 0.15 on."""


@dataclass(frozen=True, kw_only=True)
class Goals:
    """Numbers to reach, if any; what is missing is counted in units that matter about alike (assumed)."""

    moment_sd: float | None = None
    """At most: net moment's distance in stance, rms [sd]; 0.2 counts as 1."""
    power_w_per_kg: float | None = None
    """At least: peak net power [W/kg]; 0.5 counts as 1."""
    work_j_per_kg: float | None = None
    """At least: net work of the ankle in a stride [J/kg]; 0.03 counts as 1."""
    plantarflexion_deg: float | None = None
    """At least: most plantarflexion [deg]; 1.5 counts as 1."""

    def compute_shortfall(self, metrics: "TuningMetrics") -> float:
        """What is missing in all, 0 if all is reached."""
        shares = (
            (self.moment_sd, metrics.moment_sd, 0.2, -1.0),
            (self.power_w_per_kg, metrics.power_w_per_kg, 0.5, 1.0),
            (self.work_j_per_kg, metrics.work_j_per_kg, 0.03, 1.0),
            (self.plantarflexion_deg, metrics.plantarflexion_deg, 1.5, 1.0),
        )
        return sum(max(0.0, sign * (goal - found)) / unit for goal, found, unit, sign in shares if goal is not None)


HUMAN_GOALS = Goals(moment_sd=0.39, power_w_per_kg=3.31, work_j_per_kg=0.218, plantarflexion_deg=15.0)
"""The human ankle, as near as the reference's own groups are to each other (0.4 sd, 3.3 W/kg, 0.215 J/kg), and a little
more: so much do a search's short and coarse walks flatter."""


@dataclass(frozen=True, kw_only=True)
class Weights:
    """Of the objective's parts; InputError for one that is negative or no number."""

    moment: float = 1.0
    angle: float = 1.0
    power: float = 1.0
    air: float = 0.1
    """Per gram in a stride."""

    def __post_init__(self) -> None:
        """See the class."""
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        for name, value in values.items():
            if not 0.0 <= value <= 1e3:  # also refuses NaN
                raise InputError(f"weight of {name} is {value:g}; allowed: 0 to 1000")
        if not any(values.values()):
            raise InputError("all weights are 0: nothing would be better than anything else")


@dataclass(frozen=True, kw_only=True)
class TuningMetrics:
    """What the objective needs to know of a walk."""

    moment_sd: float
    """Rms distance to the reference in stance [sd]; of the next two likewise."""
    angle_sd: float
    power_sd: float
    air_g: float
    """In a stride."""
    power_w_per_kg: float
    """Peak net power."""
    work_j_per_kg: float
    """Net work of a stride."""
    plantarflexion_deg: float
    """The most of it."""
    muscle_ratio_max: float
    """Most L/L0 of the muscle [1]."""
    toe_clearance_mm: float
    """Least height of the sole in mid-swing [mm]."""
    load_tracking_rms_bw: float
    """Rms distance of the vertical load from the reference's [body weights]."""
    trips: bool
    """Whether the foot touches the ground in swing."""


def compute_tracking_error(metrics: TuningMetrics, weights: Weights) -> float:
    """Weighted mean squared distance to the reference [sd^2], summed over moment, angle and power."""
    squares = metrics.moment_sd**2, metrics.angle_sd**2, metrics.power_sd**2
    return math.fsum(w * s for w, s in zip((weights.moment, weights.angle, weights.power), squares, strict=True))


def compute_cost(metrics: TuningMetrics, weights: Weights, goals: Goals) -> float:
    """The objective; smaller is better."""
    stop = LENGTH_STOP_COST * max(0.0, metrics.muscle_ratio_max - MAX_MUSCLE_RATIO) ** 2
    load = LOAD_TRACKING_COST * max(0.0, metrics.load_tracking_rms_bw - MAX_LOAD_TRACKING_ERROR_BW) ** 2
    low = CLEARANCE_COST_PER_MM2 * max(0.0, MIN_TOE_CLEARANCE_MM - metrics.toe_clearance_mm) ** 2
    caught = TOE_CATCH_COST if metrics.trips else 0.0
    kept = stop + load + low + caught
    return (
        compute_tracking_error(metrics, weights) + weights.air * metrics.air_g + kept + goals.compute_shortfall(metrics)
    )


def make_weights(values: Mapping[str, float]) -> Weights:
    """Weights with some of them changed; raises InputError for a name that there is not."""
    known = [each.name for each in fields(Weights)]
    for name in values:
        if name not in known:
            raise InputError(f"there is no weight of '{name}'; there are: {', '.join(known)}")
    return Weights(**dict(values))
