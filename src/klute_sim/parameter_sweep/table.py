"""The table of a sweep, one row of inputs and metrics per case, as Parquet and CSV."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from klute_sim.parameter_sweep.evaluate import METRIC_COLUMNS, STATUS_COLUMNS, CaseResult
from klute_sim.parameter_sweep.plan import GaitCase, SweepPlan
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
METRIC_TYPES = {column: pa.bool_() if column in STATUS_COLUMNS else pa.float64() for column in METRIC_COLUMNS}
FAILURE_COLUMN = "failure"
COLUMN_TYPES = {**INPUT_TYPES, **METRIC_TYPES, FAILURE_COLUMN: pa.string()}
"""Arrow type by column; a numeric column is named ``name [unit]``, text and Boolean columns have no unit."""

KILLED_MESSAGE = "its process was killed in every attempt; the same command tries again"


def build_row(case: GaitCase, result: CaseResult | None) -> SweepRow:
    """Return the row of ``case``; ``result`` is None when its process was killed in every attempt."""
    inputs = {
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
    result = result or CaseResult({}, KILLED_MESSAGE)
    return {
        **inputs,
        **{column: result.metrics.get(column) for column in METRIC_COLUMNS},
        FAILURE_COLUMN: result.failure,
    }


def write_parquet(rows: Sequence[SweepRow], plan: SweepPlan, path: Path) -> None:
    """Write ``rows`` as Parquet: units in the metadata of the fields, the plan in the metadata of the schema."""
    fields = [pa.field(column, kind, metadata=_unit_metadata(column)) for column, kind in COLUMN_TYPES.items()]
    schema = pa.schema(fields, metadata={b"klute_sim": json.dumps(plan.describe(), sort_keys=True).encode()})
    pq.write_table(pa.Table.from_pylist(list(rows), schema=schema), path, compression="zstd")


def _unit_metadata(column: str) -> dict[str, str]:
    return {"unit": split_heading(column)[1]} if "[" in column else {}


def write_csv(rows: Sequence[SweepRow], path: Path) -> None:
    """Write ``rows`` as CSV with enough digits to read back the same numbers; missing values are empty."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(COLUMN_TYPES), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
