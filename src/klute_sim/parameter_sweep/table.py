"""The table of a sweep: a row per combination, what went in and what came out, as Parquet and CSV."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from klute_sim.parameter_sweep.evaluate import METRIC_COLUMNS, TRIPS_COLUMN, CaseResult
from klute_sim.parameter_sweep.plan import GaitCase, SweepPlan
from klute_sim.recording.recording import split_heading

SweepRow = dict[str, Any]
"""Heading -> value; None where there is none."""

INPUT_TYPES = {
    "device": pa.string(),
    "device_sha256": pa.string(),
    "controller": pa.string(),
    "reference": pa.string(),
    "reference_sha256": pa.string(),
    "speed_asked [m/s]": pa.float64(),
    "slope [deg]": pa.float64(),
    "mass [kg]": pa.float64(),
    "stature [m]": pa.float64(),
    "strides [1]": pa.int64(),
    "step [s]": pa.float64(),
}
METRIC_TYPES = {heading: pa.bool_() if heading == TRIPS_COLUMN else pa.float64() for heading in METRIC_COLUMNS}
FAILURE_COLUMN = "failure"
COLUMN_TYPES = {**INPUT_TYPES, **METRIC_TYPES, FAILURE_COLUMN: pa.string()}
"""Heading -> type. A number's heading is ``name [unit]``; words, and yes or no, have no unit."""

KILLED_MESSAGE = "its process was killed each time; the same command tries it again"


def build_row(case: GaitCase, result: CaseResult | None) -> SweepRow:
    """The row of ``combination``; None: the process that walked it was killed every time."""
    inputs = {
        "device": case.device_name,
        "device_sha256": case.device.digest,
        "controller": case.controller_name,
        "reference": case.reference_name,
        "reference_sha256": case.build_options().reference.digest,
        "speed_asked [m/s]": case.speed,
        "slope [deg]": case.slope_deg,
        "mass [kg]": case.mass,
        "stature [m]": case.stature,
        "strides [1]": case.strides,
        "step [s]": case.dt,
    }
    result = result or CaseResult({}, KILLED_MESSAGE)
    return {
        **inputs,
        **{heading: result.metrics.get(heading) for heading in METRIC_COLUMNS},
        FAILURE_COLUMN: result.failure,
    }


def write_parquet(rows: Sequence[SweepRow], plan: SweepPlan, path: Path) -> None:
    """Write ``rows``; units are in the fields' metadata and the plan in the schema's, as in recordings."""
    fields = [pa.field(heading, kind, metadata=_unit_metadata(heading)) for heading, kind in COLUMN_TYPES.items()]
    schema = pa.schema(fields, metadata={b"klute_sim": json.dumps(plan.describe(), sort_keys=True).encode()})
    pq.write_table(pa.Table.from_pylist(list(rows), schema=schema), path, compression="zstd")


def _unit_metadata(column: str) -> dict[str, str]:
    return {"unit": split_heading(column)[1]} if "[" in column else {}


def write_csv(rows: Sequence[SweepRow], path: Path) -> None:
    """Write ``rows`` with the digits that read back to the same number; what is missing is empty."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(COLUMN_TYPES), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
