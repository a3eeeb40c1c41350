"""A search's folder: the question, every walk, and in the end what came of it."""

import csv
import io
import json
import math
from collections.abc import Callable
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from klute_sim.controllers.pressure import profile_to_csv
from klute_sim.gait.metrics import (
    AnkleMetrics,
    StrideMetrics,
    compute_gait_metrics,
    compute_reference_metrics,
    summarize_gait_run,
)
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.parameter_sweep.fingerprint import fingerprint_software
from klute_sim.parameter_sweep.store import ResultStore, open_store, write_atomically
from klute_sim.recording.recording import Recording
from klute_sim.report import tuning_figure
from klute_sim.report.gait import table
from klute_sim.tuning.design_variables import DesignVector
from klute_sim.tuning.objective import (
    CLEARANCE_COST_PER_MM2,
    LENGTH_STOP_COST,
    LOAD_TRACKING_COST,
    MAX_LOAD_TRACKING_ERROR_BW,
    MAX_MUSCLE_RATIO,
    MIN_TOE_CLEARANCE_MM,
)
from klute_sim.tuning.search import (
    FINE_DT,
    INITIAL_SIGMA,
    SEARCH_DT,
    SEARCH_STRIDES,
    Evaluation,
    TuningProblem,
    select_best,
    select_pareto_front,
)
from klute_sim.viewer.layouts.tuning import EVALUATION_COLUMNS, EVALUATIONS_FILE

REPORT_STRIDES = 5
"""Of the walks before and after that are shown."""


def open_tuning_store(folder: Path | None, problem: TuningProblem) -> ResultStore:
    """The store of ``question`` in the folder ``wanted``, new or begun before; None: in the next ``runs/tune-NNN``.

    Raises InputError if something else is there or nothing can be written there.
    """
    return open_store(folder, describe_problem(problem), "tune")


def describe_problem(problem: TuningProblem) -> dict[str, Any]:
    """The question in JSON types; not how long it is searched, which may grow."""
    tunable = problem.space
    penalties = {
        "rest": LENGTH_STOP_COST,
        "free": MAX_MUSCLE_RATIO,
        "unfollowed": LOAD_TRACKING_COST,
        "followed_bw": MAX_LOAD_TRACKING_ERROR_BW,
    }
    penalties |= {"low": CLEARANCE_COST_PER_MM2, "clearance_mm": MIN_TOE_CLEARANCE_MM}
    return {
        "device": tunable.device.content.decode("utf-8-sig"),
        "profile": tunable.profile.describe(),
        "knobs": [asdict(knob) for knob in tunable.variables],
        "mass_kg": problem.mass,
        "weights": asdict(problem.weights),
        "goals": asdict(problem.goals),
        "seed": problem.seed,
        "search": {
            "spread": INITIAL_SIGMA,
            "strides": SEARCH_STRIDES,
            "step_s": SEARCH_DT,
            "fine_step_s": FINE_DT,
            **penalties,
        },
        "software": {**fingerprint_software(), "cma": version("cma")},
    }


def write_results(
    store: ResultStore, problem: TuningProblem, evaluations: list[Evaluation], reevaluated: list[Evaluation]
) -> dict[str, Any]:
    """Write what came of it into the folder; the summary. The result is the best of what was walked ``again``."""
    start, found = reevaluated[0], select_best(reevaluated)
    walks = _simulate(problem, start.x), _simulate(problem, found.x)
    device, profile = problem.space.decode(found.x)
    files = [EVALUATIONS_FILE, "tuned.csv", "tuning.json", "tuning.png"]
    remarks = table.collect_remarks(summarize_gait_run(walks[1], compute_gait_metrics(walks[1])))
    with store.translate_write_errors():
        if problem.space.device_keys:
            write_atomically(store.folder / "device.toml", device.content.decode("utf-8-sig"))
            files.append("device.toml")
        points = [_get_front_point(each) for each in evaluations if each.metrics is not None and not each.metrics.trips]
        tuning_figure.save_figure(
            points,
            [_get_front_point(e) for e in select_pareto_front(evaluations)],
            _get_front_point(start),
            _get_front_point(found),
            walks,
            store.folder / "tuning.png",
        )
        write_atomically(store.folder / "tuned.csv", profile_to_csv(profile))
        write_atomically(store.folder / EVALUATIONS_FILE, format_evaluations_csv(evaluations))
        result = {
            "folder": str(store.folder),
            "files": sorted(files),
            "walks": len(evaluations),
            "seed": problem.seed,
            "cost": {"before": start.cost, "tuned": found.cost},
            "table": _build_table(*walks),
            "remarks": remarks,
            "knobs": {
                knob.name: {"before": knob.initial, "tuned": knob.decode(float(place))}
                for knob, place in zip(problem.space.variables, found.x, strict=True)
            },
            "front": [
                {"air_g": air, "tracking_sd2": apart}
                for air, apart in map(_get_front_point, select_pareto_front(evaluations))
            ],
        }
        write_atomically(store.folder / "tuning.json", json.dumps(result, indent=2, allow_nan=False) + "\n")
    return result


def format_evaluations_csv(evaluations: list[Evaluation]) -> str:
    """:data:`COLUMNS` of every walk; a walk that failed has no air, and no distance."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(EVALUATION_COLUMNS)
    for number, each in enumerate(evaluations):
        parts = ["", ""] if each.metrics is None else [each.tracking_error, each.metrics.air_g]
        writer.writerow([number, each.generation, each.cost, *parts])
    return out.getvalue()


def _simulate(problem: TuningProblem, x: DesignVector) -> Recording:
    combination = problem.build_case(x, REPORT_STRIDES, FINE_DT)
    return simulate_gait(combination.device, combination.controller, combination.build_options())


def _get_front_point(evaluation: Evaluation) -> tuple[float, float]:
    return (math.nan if evaluation.metrics is None else evaluation.metrics.air_g, evaluation.tracking_error)


PROSTHESIS_ROWS: tuple[tuple[str, Callable[[StrideMetrics], float | None]], ...] = (
    ("moment to human, stance rms [sd]", lambda s: s.moment_distance_sd.stance_rms),
    ("angle to human, stance rms [sd]", lambda s: s.angle_distance_sd.stance_rms),
    ("power to human, stance rms [sd]", lambda s: s.power_distance_sd.stance_rms),
    ("air in a stride [g]", lambda s: s.air_g),
    ("most L/L0 of the muscle [1]", lambda s: s.muscle_ratio_max),
    ("toe clearance in mid-swing [mm]", lambda s: s.toe_clearance_mm),
    ("load to human, rms [body weights]", lambda s: s.grf_vertical_tracking_rms_bw),
)
ANKLE_ROWS: tuple[tuple[str, Callable[[AnkleMetrics], float]], ...] = (
    ("peak net power [W/kg]", lambda s: s.ankle_power_peak_w_per_kg),
    ("net ankle work [J/kg]", lambda s: s.ankle_work_net_j_per_kg),
    ("peak net moment [N·m/kg]", lambda s: s.ankle_moment_peak_nm_per_kg),
    ("most plantarflexion [deg]", lambda s: s.ankle_plantarflexion_deg),
)
"""Rows of the table: what only the prosthesis has, and what a human ankle has, too."""


def _build_table(before: Recording, after: Recording) -> list[dict[str, Any]]:
    """Rows of the walks before and after, and of the human ankle where it has such a number."""
    first, last, human = compute_gait_metrics(before), compute_gait_metrics(after), compute_reference_metrics(before)
    rig = [
        {"name": n, "before": first.mean(read), "tuned": last.mean(read), "human": None} for n, read in PROSTHESIS_ROWS
    ]
    ankle = [
        {"name": n, "before": first.mean(read), "tuned": last.mean(read), "human": read(human)}
        for n, read in ANKLE_ROWS
    ]
    return [*rig, *ankle]
