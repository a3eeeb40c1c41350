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

from klute_sim.comparison.comparison import Comparison, ComparisonPart, ComparisonSeries
from klute_sim.comparison.curve import CurveSummary, summarize_curve
from klute_sim.comparison.difference import Difference

FORMAT = "klute-sim-comparison/1"
AXIS_UNITS = {"phase": "%", "time": "s"}
BAND_DESCRIPTIONS = {
    "means": "95 % interval of the difference of the means, by Welch's t, point by point",
    "prediction": "95 % prediction interval of a single one, as the other's repeats scatter, point by point",
    "reference": "95 % of what the reference's people scatter by, point by point",
    "none": "none: there are no repeats that scatter",
}
"""What each kind of band is."""
DIFFERENCE_COLUMNS = (
    "part", "channel", "unit", "first", "other", "bias", "rms", "sd_of", "rms_sd", "correlation", "largest", "at",
    "share_compared", "half_begin", "half_end", "band", "regions", "share_beyond",
)  # fmt: skip
"""Of the table of numbers; ``bias``, ``rms`` and ``largest`` in ``unit``, places in % or s, shares [1]."""
SUMMARY_COLUMNS = ("part", "channel", "unit", "first", *CurveSummary._fields)
"""Of the table of one series alone, likewise."""


def as_json(comparison: Comparison) -> dict[str, Any]:
    """Everything but the curves, in JSON types; places in % of the cycle or in s, shares between 0 and 1."""
    return {
        "format": FORMAT,
        "over": comparison.domain,
        "axis_unit": AXIS_UNITS[comparison.domain],
        "first": comparison.parts[0].series[0].label,
        "series": [_describe_series(comparison, series) for series in comparison.parts[0].series],
        "parts": [_describe_part(part) for part in comparison.parts],
        "bands": BAND_DESCRIPTIONS,
        "remarks": list(comparison.remarks),
    }


def format_csv(comparison: Comparison) -> str:
    """A row for every channel of every other series, with :data:`COLUMNS`; of one alone, with :data:`ALONE`.

    What is not known is empty.
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(SUMMARY_COLUMNS if comparison.is_single else DIFFERENCE_COLUMNS)
    for part in comparison.parts if comparison.is_single else ():
        for channel, curve in part.series[0].curves.items():
            reach = ["" if value is None else value for value in summarize_curve(curve, part.axis)]
            writer.writerow([part.name, channel, part.units[channel], part.series[0].label, *reach])
    for part in comparison.parts:
        for channel, others in part.differences.items():
            for label, d in others.items():
                told = _describe_difference(part, channel, label, d)
                half = told["half"] or [None, None]
                regions = "; ".join(f"{r['begin']:.6g} to {r['end']:.6g}" for r in told["regions"])
                row = {
                    **told, "part": part.name, "channel": channel, "unit": part.units[channel],
                    "first": part.series[0].label, "other": label, "half_begin": half[0], "half_end": half[1],
                    "regions": regions, "share_beyond": math.fsum(r["share"] for r in told["regions"]),
                }  # fmt: skip
                writer.writerow(["" if row[name] is None else row[name] for name in DIFFERENCE_COLUMNS])
    return out.getvalue()


def write_curves(comparison: Comparison, path: Path) -> None:
    """Write every curve to ``path`` (Parquet): a row per part, series, channel and point of the axis."""
    unit = AXIS_UNITS[comparison.domain]
    axis = f"{'gait_phase' if comparison.domain == 'phase' else 'time'} [{unit}]"
    columns: dict[str, list[Any]] = {
        name: [] for name in ("part", "series", "channel", "unit", axis, "mean", "sd", "count")
    }
    for part in comparison.parts:
        for series in part.series:
            for channel, curve in series.curves.items():
                points = len(part.axis)
                for name, word in (("part", part.name), ("series", series.label), ("channel", channel),
                                   ("unit", part.units[channel])):  # fmt: skip
                    columns[name].append(pa.array(np.full(points, word, dtype=object)).dictionary_encode())
                for name, values in ((axis, part.axis), ("mean", curve.mean), ("sd", curve.sd)):
                    columns[name].append(pa.array(values, from_pandas=True))  # what is missing is null
                columns["count"].append(pa.array(curve.n_repeats))
    pq.write_table(pa.table({name: pa.chunked_array(own) for name, own in columns.items()}), path, compression="zstd")


def _describe_series(comparison: Comparison, series: ComparisonSeries) -> dict[str, Any]:
    runs = [run for run in comparison.runs if run.label == series.label and not series.is_reference]
    provenance = [recording.provenance for run in runs for recording in run.parts.values()]
    devices = dict.fromkeys((p.get("device") or {}).get("name") for p in provenance)
    controllers = dict.fromkeys(_format_controller(p.get("controller") or {}) for p in provenance)
    return {
        "label": series.label,
        "reference": series.is_reference,
        "runs": [str(run.path) for run in runs],
        "devices": [name for name in devices if name],
        "controllers": [name for name in controllers if name],
        "repeats": [_count_repeats(part, series.label) for part in comparison.parts],
    }


def _format_controller(provenance: Mapping[str, Any]) -> str:
    """A controller's file or kind, and the pressure of one that has a single one."""
    name, pressure = provenance.get("name") or provenance.get("kind") or "", provenance.get("pressure_bar")
    return f"{name} {pressure:g} bar" if isinstance(pressure, float | int) else str(name)


def _count_repeats(part: ComparisonPart, label: str) -> int | None:
    return next(series.n_repeats for series in part.series if series.label == label) or None


def _describe_part(part: ComparisonPart) -> dict[str, Any]:
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
                    {"series": series.label, **summarize_curve(series.curves[channel], part.axis)._asdict()}
                    for series in part.series
                    if channel in series.curves
                ],
                "differences": [_describe_difference(part, channel, label, d) for label, d in others.items()],
            }
            for channel, others in part.differences.items()
        ],
    }


def _describe_difference(part: ComparisonPart, channel: str, label: str, difference: Difference) -> dict[str, Any]:
    """The numbers of one difference; the names of :data:`COLUMNS` where they are the same."""
    return {
        "series": label,
        "share_compared": difference.compared_fraction,
        "bias": difference.bias,
        "rms": difference.rms,
        "rms_sd": difference.rms_sd,
        "sd_of": None if difference.rms_sd is None else part.normalization_series.label,
        "correlation": difference.correlation,
        "largest": difference.max_difference,
        "at": difference.max_position,
        "half": None if difference.half_interval is None else list(difference.half_interval),
        "band": difference.band,
        "regions": [
            {"begin": r.begin, "end": r.end, "largest": r.max_difference, "at": r.max_position, "share": r.fraction}
            for r in difference.regions
        ],
    }
