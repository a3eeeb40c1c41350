"""Files of a comparison: JSON summary, CSV table with a row per channel, and Parquet table of the curves."""

import csv
import io
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from klute_sim.comparison.comparison import Comparison, ComparisonPart, ComparisonSeries
from klute_sim.comparison.curve import CurveSummary, summarize_curve
from klute_sim.comparison.difference import Difference

FORMAT = "klute-sim-comparison/2"
"""Name and version of the JSON format."""
AXIS_UNITS = {"phase": "%", "time": "s"}
"""Axis -> unit."""
BAND_DESCRIPTIONS = {
    "means": "pointwise 95 % interval of the difference of the means, by Welch's t",
    "prediction": "pointwise 95 % prediction interval of a single repeat, from the variation of the other's repeats",
    "reference": "pointwise 95 % interval of the variation between the people of the reference",
    "none": "none: no repeats with variation",
}
"""Kind of a band -> description."""
DIFFERENCE_COLUMNS = (
    "part", "channel", "unit", "baseline", "other", "bias", "rms", "sd_series", "rms_sd", "correlation",
    "max_difference", "max_position", "compared_fraction", "half_begin", "half_end", "band", "regions",
    "beyond_fraction",
)  # fmt: skip
"""Columns of the table of differences; bias, rms and max_difference in ``unit``, positions in % or s, fractions [1]."""
SUMMARY_COLUMNS = ("part", "channel", "unit", "series", *CurveSummary._fields)
"""Columns of the table of a single series; values in ``unit``, positions in % or s."""


def as_json(comparison: Comparison) -> dict[str, Any]:
    """Return all numbers except the curves in JSON types; positions in % or s, fractions between 0 and 1."""
    return {
        "format": FORMAT,
        "domain": comparison.domain,
        "axis_unit": AXIS_UNITS[comparison.domain],
        "baseline": comparison.parts[0].series[0].label,
        "series": [_describe_series(comparison, series) for series in comparison.parts[0].series],
        "parts": [_describe_part(part) for part in comparison.parts],
        "bands": BAND_DESCRIPTIONS,
        "remarks": list(comparison.remarks),
    }


def iter_rows(comparison: Comparison) -> Iterator[dict[str, Any]]:
    """Yield the rows of the table: :data:`SUMMARY_COLUMNS` of a single series, otherwise :data:`DIFFERENCE_COLUMNS`."""
    for part in comparison.parts:
        first = part.series[0]
        if comparison.is_single:
            for channel, curve in first.curves.items():
                keys = {"part": part.name, "channel": channel, "unit": part.units[channel], "series": first.label}
                yield {**keys, **summarize_curve(curve, part.axis)._asdict()}
        for channel, differences in part.differences.items():
            for label, difference in differences.items():
                summary = _describe_difference(part, label, difference)
                half_interval = summary["half_interval"] or [None, None]
                row = {
                    **summary,
                    **{"part": part.name, "channel": channel, "unit": part.units[channel]},
                    **{"baseline": first.label, "other": label},
                    **{"half_begin": half_interval[0], "half_end": half_interval[1]},
                    "regions": "; ".join(f"{r['begin']:.6g} to {r['end']:.6g}" for r in summary["regions"]),
                    "beyond_fraction": math.fsum(r["fraction"] for r in summary["regions"]),
                }
                yield {name: row[name] for name in DIFFERENCE_COLUMNS}


def format_csv(comparison: Comparison) -> str:
    """Return the table of :func:`iter_rows` as CSV; unknown values are empty."""
    output = io.StringIO()
    writer = csv.writer(output, lineterminator="\n")
    writer.writerow(SUMMARY_COLUMNS if comparison.is_single else DIFFERENCE_COLUMNS)
    for row in iter_rows(comparison):
        writer.writerow(["" if value is None else value for value in row.values()])
    return output.getvalue()


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
                n_points = len(part.axis)
                texts = {"part": part.name, "series": series.label, "channel": channel, "unit": part.units[channel]}
                for name, text in texts.items():
                    columns[name].append(pa.array(np.full(n_points, text, dtype=object)).dictionary_encode())
                for name, values in ((axis, part.axis), ("mean", curve.mean), ("sd", curve.sd)):
                    columns[name].append(pa.array(values, from_pandas=True))  # NaN becomes null
                columns["count"].append(pa.array(curve.n_repeats))
    pq.write_table(
        pa.table({name: pa.chunked_array(chunks) for name, chunks in columns.items()}), path, compression="zstd"
    )


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
    """Return the file or kind of a controller, with its pressure if it is constant."""
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
                "differences": [_describe_difference(part, label, d) for label, d in differences.items()],
            }
            for channel, differences in part.differences.items()
        ],
    }


def _describe_difference(part: ComparisonPart, label: str, difference: Difference) -> dict[str, Any]:
    """Return the numbers of one difference; names as in :data:`DIFFERENCE_COLUMNS`."""
    return {
        "series": label,
        "compared_fraction": difference.compared_fraction,
        "bias": difference.bias,
        "rms": difference.rms,
        "rms_sd": difference.rms_sd,
        "sd_series": None if difference.rms_sd is None else part.normalization_series.label,
        "correlation": difference.correlation,
        "max_difference": difference.max_difference,
        "max_position": difference.max_position,
        "half_interval": None if difference.half_interval is None else list(difference.half_interval),
        "band": difference.band,
        "regions": [asdict(region) for region in difference.regions],
    }
