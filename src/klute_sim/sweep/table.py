"""The table of a sweep: a row per combination, what went in and what came out, as Parquet and CSV."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from klute_sim.recording.recording import split_heading
from klute_sim.sweep.plan import Combination, Plan
from klute_sim.sweep.walk import HEADINGS, TRIPS, Walked

Row = dict[str, Any]
"""Heading -> value; None where there is none."""

INPUTS = {
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
OUTCOMES = {heading: pa.bool_() if heading == TRIPS else pa.float64() for heading in HEADINGS}
FAILURE = "failure"
COLUMNS = {**INPUTS, **OUTCOMES, FAILURE: pa.string()}
"""Heading -> type. A number's heading is ``name [unit]``; words, and yes or no, have no unit."""

LOST = "its process was killed each time; the same command tries it again"


def row(combination: Combination, walked: Walked | None) -> Row:
    """The row of ``combination``; None: the process that walked it was killed every time."""
    inputs = {
        "device": combination.device_word,
        "device_sha256": combination.device.digest,
        "controller": combination.controller_word,
        "reference": combination.reference_word,
        "reference_sha256": combination.options().reference.digest,
        "speed_asked [m/s]": combination.speed,
        "slope [deg]": combination.slope_deg,
        "mass [kg]": combination.mass,
        "stature [m]": combination.stature,
        "strides [1]": combination.strides,
        "step [s]": combination.step,
    }
    walked = walked or Walked({}, LOST)
    return {**inputs, **{heading: walked.outcomes.get(heading) for heading in HEADINGS}, FAILURE: walked.failure}


def write_parquet(rows: Sequence[Row], plan: Plan, path: Path) -> None:
    """Write ``rows``; units are in the fields' metadata and the plan in the schema's, as in recordings."""
    fields = [pa.field(heading, kind, metadata=_unit(heading)) for heading, kind in COLUMNS.items()]
    schema = pa.schema(fields, metadata={b"klute_sim": json.dumps(plan.describe(), sort_keys=True).encode()})
    pq.write_table(pa.Table.from_pylist(list(rows), schema=schema), path, compression="zstd")


def _unit(heading: str) -> dict[str, str]:
    return {"unit": split_heading(heading)[1]} if "[" in heading else {}


def write_csv(rows: Sequence[Row], path: Path) -> None:
    """Write ``rows`` with the digits that read back to the same number; what is missing is empty."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(COLUMNS), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
