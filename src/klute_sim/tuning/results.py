"""Describe a tuning problem and tabulate the results of its search, in JSON types."""

import csv
import io
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from klute_sim.gait.metrics import AnkleMetrics, StrideMetrics, compute_gait_metrics, compute_reference_metrics
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.parameter_sweep.fingerprint import fingerprint_software
from klute_sim.parameter_sweep.store import ResultStore, open_store
from klute_sim.recording.recording import Recording
from klute_sim.tuning.design_variables import compute_violation
from klute_sim.tuning.objective import (
    CLEARANCE_COST_PER_MM2,
    LENGTH_STOP_COST,
    LOAD_TRACKING_COST,
    MAX_LOAD_TRACKING_ERROR_BW,
    MAX_MUSCLE_RATIO,
    MIN_TOE_CLEARANCE_MM,
    compute_terms,
)
from klute_sim.tuning.search import (
    FINE_DT,
    INITIAL_SIGMA,
    SEARCH_DT,
    SEARCH_STRIDES,
    Evaluation,
    TuningProblem,
)
from klute_sim.types import Array

MIN_SHOWN_VIOLATION = 1e-9
"""Smallest violation of the bounds that is no rounding error."""
REPORT_STRIDES = 5
"""Number of strides of the simulations before and after tuning that the report shows."""

PROSTHESIS_ROWS: tuple[tuple[str, Callable[[StrideMetrics], float | None]], ...] = (
    ("moment to human, stance rms [sd]", lambda s: s.moment_distance_sd.stance_rms),
    ("angle to human, stance rms [sd]", lambda s: s.angle_distance_sd.stance_rms),
    ("power to human, stance rms [sd]", lambda s: s.power_distance_sd.stance_rms),
    ("air per stride [g]", lambda s: s.air_g),
    ("maximum muscle L/L0 [1]", lambda s: s.muscle_ratio_max),
    ("toe clearance in mid-swing [mm]", lambda s: s.toe_clearance_mm),
    ("vertical load error, rms [body weights]", lambda s: s.grf_vertical_tracking_rms_bw),
)
"""Label and metric of the rows that exist only for the prosthesis."""
ANKLE_ROWS: tuple[tuple[str, Callable[[AnkleMetrics], float]], ...] = (
    ("peak net power [W/kg]", lambda s: s.ankle_power_peak_w_per_kg),
    ("net ankle work [J/kg]", lambda s: s.ankle_work_net_j_per_kg),
    ("peak net moment [N·m/kg]", lambda s: s.ankle_moment_peak_nm_per_kg),
    ("peak plantarflexion [deg]", lambda s: s.ankle_plantarflexion_deg),
)
"""Label and metric of the rows that exist for a human ankle, too."""


def open_tuning_store(folder: str | Path | None, problem: TuningProblem) -> ResultStore:
    """Open the store of ``problem`` in ``folder``, new or started earlier; None: in the next ``runs/tune-NNN``.

    Raises InputError when the folder holds something else or cannot be written.
    """
    return open_store(folder, describe_problem(problem), "tune")


def describe_problem(problem: TuningProblem) -> dict[str, Any]:
    """Return the problem in JSON types; the budget is left out, because it may grow."""
    space = problem.space
    return {
        "device": space.device.content.decode("utf-8-sig"),
        "profile": space.profile.describe(),
        "design_variables": [asdict(variable) for variable in space.variables],
        **problem.subject.describe(),
        "weights": asdict(problem.weights),
        "goals": asdict(problem.goals),
        "seed": problem.seed,
        "search": {
            "initial_sigma": INITIAL_SIGMA,
            "strides": SEARCH_STRIDES,
            "time_step_s": SEARCH_DT,
            "fine_time_step_s": FINE_DT,
            "length_stop_cost": LENGTH_STOP_COST,
            "max_muscle_ratio": MAX_MUSCLE_RATIO,
            "load_tracking_cost": LOAD_TRACKING_COST,
            "max_load_tracking_error_bw": MAX_LOAD_TRACKING_ERROR_BW,
            "clearance_cost_per_mm2": CLEARANCE_COST_PER_MM2,
            "min_toe_clearance_mm": MIN_TOE_CLEARANCE_MM,
        },
        "software": {**fingerprint_software(), "cma": version("cma")},
    }


def simulate_point(problem: TuningProblem, x: Array) -> Recording:
    """Simulate the gait at the normalized point ``x``, with the strides and the time step of a report."""
    case = problem.build_case(x, REPORT_STRIDES, FINE_DT)
    return simulate_gait(case.device, case.controller, case.build_options())


def get_front_point(evaluation: Evaluation) -> tuple[float, float]:
    """Return air per stride [g] and tracking error [sd2] of ``evaluation``."""
    return (math.nan if evaluation.metrics is None else evaluation.metrics.air_g, evaluation.tracking_error)


def build_metrics_table(before: Recording, after: Recording) -> list[dict[str, Any]]:
    """Return rows of the metrics before and after tuning, and of the human ankle where it has that metric."""
    initial, tuned = compute_gait_metrics(before), compute_gait_metrics(after)
    human = compute_reference_metrics(before)
    prosthesis_rows = [
        {"name": name, "before": initial.mean(get_value), "tuned": tuned.mean(get_value), "human": None}
        for name, get_value in PROSTHESIS_ROWS
    ]
    ankle_rows = [
        {"name": name, "before": initial.mean(get_value), "tuned": tuned.mean(get_value), "human": get_value(human)}
        for name, get_value in ANKLE_ROWS
    ]
    return [*prosthesis_rows, *ankle_rows]


def build_objective_rows(problem: TuningProblem, initial: Evaluation, best: Evaluation) -> list[dict[str, Any]]:
    """Return the summands of the objective at the initial and the best point, the tracking error first.

    A summand of a quantity has its value and the values without cost. Together they are the cost.
    """
    both = [
        [] if e.metrics is None else compute_terms(e.metrics, problem.weights, problem.goals) for e in (initial, best)
    ]
    rows = [
        {
            "name": before.name,
            "before": before.cost,
            "tuned": tuned.cost,
            "value_before": before.value,
            "value_tuned": tuned.value,
            "unit": tuned.unit,
            "allowed": tuned.allowed,
            "is_penalty": tuned.is_penalty,
        }
        for before, tuned in zip(*both, strict=True)
    ]
    violations = [compute_violation(problem.variables, e.x) for e in (initial, best)]
    if max(violations) > MIN_SHOWN_VIOLATION:
        row = {"name": "the penalty of the bounds", "before": violations[0], "tuned": violations[1]}
        rows.append({**row, "value_before": None, "value_tuned": None, "unit": "", "allowed": "", "is_penalty": True})
    return rows


def format_evaluations_csv(evaluations: Sequence[Evaluation], columns: Sequence[str]) -> str:
    """Return number, generation, cost, tracking error [sd2] and air [g] of each evaluation; ``columns`` is the header.

    A failed evaluation has neither tracking error nor air.
    """
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(columns)
    for number, evaluation in enumerate(evaluations):
        values = ["", ""] if evaluation.metrics is None else [evaluation.tracking_error, evaluation.metrics.air_g]
        writer.writerow([number, evaluation.generation, evaluation.cost, *values])
    return buffer.getvalue()
