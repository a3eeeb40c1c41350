"""A comparison as JSON, and as two tables: its numbers a row per channel, and the curves with their bands."""

import csv
import io
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from klute_sim.compare.comparison import Comparison, Part, Series
from klute_sim.compare.curve import Extent, extent
from klute_sim.compare.difference import Difference

FORMAT = "klute-sim-comparison/1"
AXIS_UNITS = {"phase": "%", "time": "s"}
BANDS = {
    "means": "95 % interval of the difference of the means, by Welch's t, point by point",
    "prediction": "95 % prediction interval of a single one, as the other's repeats scatter, point by point",
    "reference": "95 % of what the reference's people scatter by, point by point",
    "none": "none: there are no repeats that scatter",
}
"""What each kind of band is."""
COLUMNS = (
    "part", "channel", "unit", "first", "other", "bias", "rms", "sd_of", "rms_sd", "correlation", "largest", "at",
    "share_compared", "half_begin", "half_end", "band", "regions", "share_beyond",
)  # fmt: skip
"""Of the table of numbers; ``bias``, ``rms`` and ``largest`` in ``unit``, places in % or s, shares [1]."""
ALONE = ("part", "channel", "unit", "first", *Extent._fields)
"""Of the table of one series alone, likewise."""


def as_json(found: Comparison) -> dict[str, Any]:
    """Everything but the curves, in JSON types; places in % of the cycle or in s, shares between 0 and 1."""
    return {
        "format": FORMAT,
        "over": found.over,
        "axis_unit": AXIS_UNITS[found.over],
        "first": found.parts[0].series[0].label,
        "series": [_series(found, series) for series in found.parts[0].series],
        "parts": [_part(part) for part in found.parts],
        "bands": BANDS,
        "remarks": list(found.remarks),
    }


def numbers_csv(found: Comparison) -> str:
    """A row for every channel of every other series, with :data:`COLUMNS`; of one alone, with :data:`ALONE`.

    What is not known is empty.
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(ALONE if found.alone else COLUMNS)
    for part in found.parts if found.alone else ():
        for channel, curve in part.series[0].curves.items():
            reach = ["" if value is None else value for value in extent(curve, part.axis)]
            writer.writerow([part.name, channel, part.units[channel], part.series[0].label, *reach])
    for part in found.parts:
        for channel, others in part.differences.items():
            for label, d in others.items():
                told = _difference(part, channel, label, d)
                half = told["half"] or [None, None]
                regions = "; ".join(f"{r['begin']:.6g} to {r['end']:.6g}" for r in told["regions"])
                row = {
                    **told, "part": part.name, "channel": channel, "unit": part.units[channel],
                    "first": part.series[0].label, "other": label, "half_begin": half[0], "half_end": half[1],
                    "regions": regions, "share_beyond": math.fsum(r["share"] for r in told["regions"]),
                }  # fmt: skip
                writer.writerow(["" if row[name] is None else row[name] for name in COLUMNS])
    return out.getvalue()


def write_bands(found: Comparison, path: Path) -> None:
    """Write every curve to ``path`` (Parquet): a row per part, series, channel and point of the axis."""
    unit = AXIS_UNITS[found.over]
    axis = f"{'gait_phase' if found.over == 'phase' else 'time'} [{unit}]"
    columns: dict[str, list[Any]] = {
        name: [] for name in ("part", "series", "channel", "unit", axis, "mean", "sd", "count")
    }
    for part in found.parts:
        for series in part.series:
            for channel, curve in series.curves.items():
                points = len(part.axis)
                for name, word in (("part", part.name), ("series", series.label), ("channel", channel),
                                   ("unit", part.units[channel])):  # fmt: skip
                    columns[name].append(pa.array(np.full(points, word, dtype=object)).dictionary_encode())
                for name, values in ((axis, part.axis), ("mean", curve.mean), ("sd", curve.sd)):
                    columns[name].append(pa.array(values, from_pandas=True))  # what is missing is null
                columns["count"].append(pa.array(curve.count))
    pq.write_table(pa.table({name: pa.chunked_array(own) for name, own in columns.items()}), path, compression="zstd")


def _series(found: Comparison, series: Series) -> dict[str, Any]:
    runs = [run for run in found.runs if run.label == series.label and not series.reference]
    provenance = [recording.provenance for run in runs for recording in run.parts.values()]
    devices = dict.fromkeys((p.get("device") or {}).get("name") for p in provenance)
    controllers = dict.fromkeys(_controller(p.get("controller") or {}) for p in provenance)
    return {
        "label": series.label,
        "reference": series.reference,
        "runs": [str(run.path) for run in runs],
        "devices": [name for name in devices if name],
        "controllers": [name for name in controllers if name],
        "repeats": [_repeats(part, series.label) for part in found.parts],
    }


def _controller(told: Mapping[str, Any]) -> str:
    """A controller's file or kind, and the pressure of one that has a single one."""
    name, pressure = told.get("name") or told.get("kind") or "", told.get("pressure_bar")
    return f"{name} {pressure:g} bar" if isinstance(pressure, float | int) else str(name)


def _repeats(part: Part, label: str) -> int | None:
    return next(series.repeats for series in part.series if series.label == label) or None


def _part(part: Part) -> dict[str, Any]:
    return {
        "name": part.name,
        "begin": float(part.axis[0]),
        "end": float(part.axis[-1]),
        "points": len(part.axis),
        "channels": [
            {
                "channel": channel,
                "unit": part.units[channel],
                "curves": [
                    {"series": series.label, **extent(series.curves[channel], part.axis)._asdict()}
                    for series in part.series
                    if channel in series.curves
                ],
                "differences": [_difference(part, channel, label, d) for label, d in others.items()],
            }
            for channel, others in part.differences.items()
        ],
    }


def _difference(part: Part, channel: str, label: str, d: Difference) -> dict[str, Any]:
    """The numbers of one difference; the names of :data:`COLUMNS` where they are the same."""
    return {
        "series": label,
        "share_compared": d.share,
        "bias": d.bias,
        "rms": d.rms,
        "rms_sd": d.rms_sd,
        "sd_of": None if d.rms_sd is None else part.yardstick.label,
        "correlation": d.correlation,
        "largest": d.largest,
        "at": d.at,
        "half": None if d.half is None else list(d.half),
        "band": d.band,
        "regions": [
            {"begin": r.begin, "end": r.end, "largest": r.largest, "at": r.at, "share": r.share} for r in d.regions
        ],
    }
