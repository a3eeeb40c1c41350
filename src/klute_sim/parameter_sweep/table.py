"""The table of a sweep, one row of inputs and metrics per case, as Parquet and CSV."""

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from klute_sim.controllers.state_machine import StateMachine
from klute_sim.parameter_sweep.evaluate import METRIC_COLUMNS, STATUS_COLUMNS, Case, CaseResult
from klute_sim.parameter_sweep.joint_metrics import JOINT_METRIC_COLUMNS
from klute_sim.parameter_sweep.joint_plan import JointCase, JointSweepPlan
from klute_sim.parameter_sweep.plan import GaitCase, SweepPlan
from klute_sim.parameter_sweep.walk_metrics import WALK_METRIC_COLUMNS, WALK_STATUS_COLUMNS
from klute_sim.parameter_sweep.walk_plan import WalkCase, WalkSweepPlan
from klute_sim.recording.recording import split_heading

SweepRow = dict[str, Any]
"""Value by column; None where there is no value."""

INPUT_TYPES = {
    "device": pa.string(),
    "device_sha256": pa.string(),
    "controller": pa.string(),
    "reference": pa.string(),
    "reference_sha256": pa.string(),
    "reference_stride_time [s]": pa.float64(),
    "speed_requested [m/s]": pa.float64(),
    "slope [deg]": pa.float64(),
    "mass [kg]": pa.float64(),
    "stature [m]": pa.float64(),
    "strides [1]": pa.int64(),
    "time_step [s]": pa.float64(),
}
WALK_INPUT_TYPES = {
    "device": pa.string(),
    "device_sha256": pa.string(),
    "controller": pa.string(),
    "push_off_pressure [bar]": pa.float64(),
    "push_off_lean [deg]": pa.float64(),
    "foot_stiffness [N*m/deg]": pa.float64(),
    "walker": pa.string(),
    "walker_sha256": pa.string(),
    "slope [deg]": pa.float64(),
    "unevenness [mm]": pa.float64(),
    "push [N*s]": pa.float64(),
    "push_phase [%]": pa.float64(),
    "seed [1]": pa.int64(),
    "duration_requested [s]": pa.float64(),
    "time_step [s]": pa.float64(),
}
JOINT_INPUT_TYPES = {
    "device": pa.string(),
    "device_sha256": pa.string(),
    "proportional [1/rad]": pa.float64(),
    "integral [1/(rad*s)]": pa.float64(),
    "derivative [s/rad]": pa.float64(),
    "mean_action [1]": pa.float64(),
    "load [kg]": pa.float64(),
    "episodes [1]": pa.int64(),
    "seed [1]": pa.int64(),
    "duration_requested [s]": pa.float64(),
    "time_step [s]": pa.float64(),
}
FAILURE_COLUMN = "failure"


def _list_types(inputs: Mapping[str, Any], metrics: Sequence[str], status: Sequence[str]) -> dict[str, Any]:
    metric_types = {column: pa.bool_() if column in status else pa.float64() for column in metrics}
    return {**inputs, **metric_types, FAILURE_COLUMN: pa.string()}


COLUMN_TYPES = _list_types(INPUT_TYPES, METRIC_COLUMNS, STATUS_COLUMNS)
"""Arrow type by column of a sweep of gait runs.

A numeric column is named ``name [unit]``, text and Boolean columns have no unit.
"""
WALK_COLUMN_TYPES = _list_types(WALK_INPUT_TYPES, WALK_METRIC_COLUMNS, WALK_STATUS_COLUMNS)
"""Arrow type by column of a sweep of walks."""
JOINT_COLUMN_TYPES = _list_types(JOINT_INPUT_TYPES, JOINT_METRIC_COLUMNS, ())
"""Arrow type by column of a sweep of the controlled joint."""
AnyPlan = SweepPlan | WalkSweepPlan | JointSweepPlan

KILLED_MESSAGE = "its process was killed in every attempt; the same command tries again"


def get_column_types(plan: AnyPlan) -> dict[str, Any]:
    """Return the Arrow type by column of the sweep of ``plan``."""
    if isinstance(plan, JointSweepPlan):
        return JOINT_COLUMN_TYPES
    return WALK_COLUMN_TYPES if isinstance(plan, WalkSweepPlan) else COLUMN_TYPES


def build_row(case: Case, result: CaseResult | None) -> SweepRow:
    """Return the row of ``case``; ``result`` is None when its process was killed in every attempt."""
    columns: Sequence[str]
    if isinstance(case, WalkCase):
        inputs, columns = _collect_walk_inputs(case), WALK_METRIC_COLUMNS
    elif isinstance(case, JointCase):
        inputs, columns = _collect_joint_inputs(case), JOINT_METRIC_COLUMNS
    else:
        inputs, columns = _collect_inputs(case), METRIC_COLUMNS
    result = result or CaseResult({}, KILLED_MESSAGE)
    return {**inputs, **{column: result.metrics.get(column) for column in columns}, FAILURE_COLUMN: result.failure}


def _collect_inputs(case: GaitCase) -> dict[str, Any]:
    return {
        "device": case.device_name,
        "device_sha256": case.device.digest,
        "controller": case.controller_name,
        "reference": case.reference_name,
        "reference_sha256": case.subject.reference.digest,
        "reference_stride_time [s]": case.subject.reference.stride_time,
        "speed_requested [m/s]": case.subject.speed,
        "slope [deg]": case.subject.slope_deg,
        "mass [kg]": case.subject.mass,
        "stature [m]": case.subject.stature,
        "strides [1]": case.strides,
        "time_step [s]": case.dt,
    }


def _collect_walk_inputs(case: WalkCase) -> dict[str, Any]:
    machine = case.active_controller if isinstance(case.active_controller, StateMachine) else None
    impulse, phase = case.push
    return {
        "device": case.device_name,
        "device_sha256": case.device.digest,
        "controller": case.controller_name,
        "push_off_pressure [bar]": None if machine is None else machine.push_off_bar,
        "push_off_lean [deg]": None if machine is None else machine.lean_deg,
        "foot_stiffness [N*m/deg]": case.foot_stiffness,
        "walker": case.walker.name,
        "walker_sha256": case.walker.digest,
        "slope [deg]": case.slope_deg,
        "unevenness [mm]": case.unevenness_mm,
        "push [N*s]": impulse,
        "push_phase [%]": phase if impulse else None,
        "seed [1]": case.seed,
        "duration_requested [s]": case.seconds,
        "time_step [s]": case.dt,
    }


def _collect_joint_inputs(case: JointCase) -> dict[str, Any]:
    values = (
        *(case.device_name, case.device.digest, *case.gains.values(), case.load_kg),
        *(case.episodes, case.seed, case.seconds, case.dt),
    )
    return dict(zip(JOINT_INPUT_TYPES, values, strict=True))


def write_parquet(rows: Sequence[SweepRow], plan: AnyPlan, path: Path) -> None:
    """Write ``rows`` as Parquet: units in the metadata of the fields, the plan in the metadata of the schema."""
    fields = [
        pa.field(column, kind, metadata=_unit_metadata(column)) for column, kind in get_column_types(plan).items()
    ]
    schema = pa.schema(fields, metadata={b"klute_sim": json.dumps(plan.describe(), sort_keys=True).encode()})
    pq.write_table(pa.Table.from_pylist(list(rows), schema=schema), path, compression="zstd")


def _unit_metadata(column: str) -> dict[str, str]:
    return {"unit": split_heading(column)[1]} if "[" in column else {}


def write_csv(rows: Sequence[SweepRow], path: Path) -> None:
    """Write ``rows`` as CSV with enough digits to read back the same numbers; missing values are empty."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
