"""Tables with one stride in % of the gait cycle, the usual form of published gait, as recordings over time."""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from klute_sim.errors import InputError
from klute_sim.mocap.formats.c3d import GaitEvent
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.parsing.channel_names import split_unit
from klute_sim.mocap.parsing.sources import SourceFile
from klute_sim.types import Array

N_COPIES = 4
"""Number of copies of the stride in the recording; the inner ones are complete."""
MAX_CLOSURE_FRACTION = 0.15
"""Maximum difference of the two ends of a column, over its range, for a whole stride."""
MAX_END_GAP_PCT = 5.0
"""Largest distance of the first and last row from 0 and 100 % (published tables may end at 98 %)."""
MIN_ROWS = 20
"""Smallest number of rows of a stride."""
N_FINE_ROWS = 200
"""Number of rows to which a coarser stride is interpolated (assumed)."""
_PERCENT_WORDS = {"percent", "percentage", "pct", "%"}
_CYCLE_WORDS = {"cycle", "phase", "stride"}
_OTHER_WORDS = {"gait", "of", "time", "normalized", "normalised", "the"}


def unroll_single_strides(sources: Sequence[SourceFile], stride_time: float | None, log: ImportLog) -> list[SourceFile]:
    """Return ``sources``, in which each file with a stride in % is a recording of equal strides of ``stride_time`` [s].

    Raises InputError if the duration is missing or superfluous, and if a stride is incomplete.
    """
    unrolled = []
    for source in sources:
        label = find_percent_label(source)
        if label is None:
            unrolled.append(source)
        elif stride_time is None:
            raise InputError(
                f"{source.path} has no time, but '{label}' in % of the gait cycle: pass the duration of the stride "
                "(--stride-duration S, or --cadence STEPS/MIN)"
            )
        else:
            unrolled.append(_unroll(source, label, stride_time))
            log.add_derived(
                f"{source.name}: one stride over '{label}', {stride_time:.4g} s long as specified; it is not filtered, "
                "and there is no standard deviation between strides"
            )
    if stride_time is not None and not any(source.is_single_stride for source in unrolled):
        raise InputError(
            "a stride duration or cadence is for tables with one stride in % of the gait cycle; these files have times"
        )
    return unrolled


def find_percent_label(source: SourceFile) -> str | None:
    """Return the label of the column in % of the gait cycle of a file without times; None if there is none."""
    if source.time_label is not None and source.units.get(source.time_label) != "%":
        return None
    return next((label for label in source.labels if _names_percent_of_cycle(label)), None)


def _names_percent_of_cycle(label: str) -> bool:
    name, unit = split_unit(label)
    words = {*re.findall(r"[a-z]+|%", name.lower()), *(("%",) if unit == "%" else ())}
    is_relevant = bool(words & _PERCENT_WORDS) or {"gait", "cycle"} <= words or {"gait", "phase"} <= words
    return is_relevant and words <= _PERCENT_WORDS | _CYCLE_WORDS | _OTHER_WORDS


def _unroll(source: SourceFile, percent_label: str, stride_time: float) -> SourceFile:
    percent = source.get_column(percent_label)
    if np.isfinite(percent).all() and len(percent) and percent.max() <= 1.0:
        percent = 100.0 * percent
    is_stride = (
        len(percent) >= MIN_ROWS
        and bool(np.isfinite(percent).all())
        and bool(np.all(np.diff(percent) > 0.0))
        and 0.0 <= percent[0] <= MAX_END_GAP_PCT
        and 100.0 - MAX_END_GAP_PCT <= percent[-1] <= 100.0
    )
    if not is_stride:
        raise InputError(
            f"{source.path}: '{percent_label}' must increase from 0 to 100 % in {MIN_ROWS} rows or more; it has "
            f"{len(percent)} rows from {percent[0] if len(percent) else 0:g} to {percent[-1] if len(percent) else 0:g}"
        )
    inside = percent < 100.0  # the row at 100 % is the next heel strike
    rows = percent[inside]
    fine_rows = rows if len(rows) >= N_FINE_ROWS else np.linspace(0.0, 100.0, N_FINE_ROWS, endpoint=False)
    starts = stride_time * np.arange(N_COPIES)
    time = (starts[:, None] + stride_time * fine_rows / 100.0).ravel()

    def read_column(label: str) -> Array:
        if label == "time":
            return time
        values = source.get_column(label)
        _check_ends(values, f"{source.path}: column '{label}'")
        return np.tile(interpolate_cycle(rows, values[inside], fine_rows), N_COPIES)

    labels = tuple(label for label in source.labels if label not in (percent_label, source.time_label))
    return replace(
        source,
        labels=("time", *labels),
        units={**{label: unit for label, unit in source.units.items() if label in labels}, "time": "s"},
        read_column=read_column,
        events=tuple(GaitEvent(float(start), "", is_foot_strike=True) for start in starts),
        is_single_stride=True,
    )


def interpolate_cycle(percent: Array, values: Array, fine_percent: Array) -> Array:
    """Return ``values`` (n,) of a cycle at ``percent`` (n,), at ``fine_percent`` (m,), both in [0, 100) and increasing.

    By a periodic cubic spline: straight lines between the rows of a published table would shake the rig. Between
    two equal values, as without load in swing, nothing changes. A column with gaps keeps them, and is interpolated
    linearly.
    """
    if len(percent) == len(fine_percent) and np.array_equal(percent, fine_percent):
        return values
    knots, closed = np.append(percent, percent[0] + 100.0), np.append(values, values[0])
    at: Array = np.where(fine_percent < percent[0], fine_percent + 100.0, fine_percent)
    if not np.isfinite(closed).all():
        return np.asarray(np.interp(at, knots, closed))
    fine = np.asarray(CubicSpline(knots, closed, bc_type="periodic")(at))
    before = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(percent) - 1)
    return np.where(closed[before] == closed[before + 1], closed[before], fine)


def _check_ends(values: Array, name: str) -> None:
    known = values[np.isfinite(values)]
    if not len(known):
        return
    span = float(np.ptp(known))
    if abs(values[-1] - values[0]) > MAX_CLOSURE_FRACTION * span > 0.0:
        raise InputError(
            f"{name} is {values[0]:.4g} in the first row and {values[-1]:.4g} in the last: a whole stride, from heel "
            "strike to heel strike of the same foot, ends as it begins"
        )
