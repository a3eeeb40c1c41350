"""Metrics of one predicted walk of a sweep."""

from collections.abc import Callable

from klute_sim.parameter_sweep.walk_plan import WalkCase
from klute_sim.walker.outcomes import LegOutcomes, WalkOutcomes, compute_outcomes
from klute_sim.walker.person.body import SIDES
from klute_sim.walker.simulation.simulate import simulate_walk

FELL_COLUMN = "fell"
"""Whether the person fell."""
ACUTE_COLUMN = "acute"
"""Whether the person has not adapted to the condition."""
WALK_STATUS_COLUMNS = (FELL_COLUMN, ACUTE_COLUMN)
OUTCOMES: dict[str, Callable[[WalkOutcomes], float | None]] = {
    "duration [s]": lambda o: o.duration_s,
    "speed [m/s]": lambda o: o.speed_m_per_s,
    "cost_minetti [J/kg/m]": lambda o: o.cost_minetti_j_per_kg_m,
    "cost_bhargava [J/kg/m]": lambda o: o.cost_bhargava_j_per_kg_m,
    "step_asymmetry [1]": lambda o: o.step_asymmetry,
    "device_work_net [J]": lambda o: o.device_work_net_j,
    "device_work_positive [J]": lambda o: o.device_work_positive_j,
}
"""Function that reads a metric from the outcomes, by column."""
LEG_OUTCOMES: dict[str, Callable[[LegOutcomes], float]] = {
    "stride_time_{} [s]": lambda leg: leg.stride_time,
    "stance_share_{} [1]": lambda leg: leg.stance_share,
    "step_length_{} [m]": lambda leg: leg.step_length,
    "load_peak_{} [1]": lambda leg: leg.peak_load_bw,
}
"""Function that reads a metric of a leg, by column with the side left open."""
WALK_METRIC_COLUMNS = (
    *OUTCOMES,
    *(column.format(side) for column in LEG_OUTCOMES for side in SIDES),
    *WALK_STATUS_COLUMNS,
)
"""All metrics of a walk, in the order of the table."""


def compute_walk_metrics(case: WalkCase) -> dict[str, float | bool | None]:
    """Simulate the walk of ``case`` and return its metrics; a walk that ends early lacks some.

    A fall is a metric. Raises InputError when the walker does not fit.
    """
    recording = simulate_walk(case.walker, case.prosthesis, case.active_controller, case.build_options())
    outcomes = compute_outcomes(recording)
    values: dict[str, float | bool | None] = {column: read(outcomes) for column, read in OUTCOMES.items()}
    for column, read in LEG_OUTCOMES.items():
        for side in SIDES:
            leg = outcomes.legs.get(side)
            values[column.format(side)] = None if leg is None else read(leg)
    return {**values, FELL_COLUMN: outcomes.has_fallen, ACUTE_COLUMN: case.is_acute}
