"""Files of one trial among bench recordings: names that share a stem, and other channels with another clock."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from klute_sim.datasets.draft.columns import ColumnChoice, RecognizedFile
from klute_sim.types import Array

SEPARATORS = "_-. "
"""Letters between the stem of a trial and what the name of another of its files adds."""


def join_files(files: Sequence[RecognizedFile]) -> list[RecognizedFile]:
    """Return the trials of ``files``, each in the place of its first file.

    ``NAME.*`` and ``NAME_suffix.*`` are files of one trial if their times overlap and no channel is in both.
    """
    trials: dict[int, RecognizedFile] = {}
    for index in sorted(range(len(files)), key=lambda k: len(files[k].path.stem)):
        file = files[index]
        hosts = (k for k, trial in trials.items() if _may_join(trial, file))
        host = max(hosts, key=lambda k: len(trials[k].path.stem), default=None)
        if host is None:
            trials[index] = file
        else:
            trials[host] = _join(trials[host], file)
    return [trials[index] for index in sorted(trials)]


def _may_join(trial: RecognizedFile, file: RecognizedFile) -> bool:
    stem, other = trial.path.stem, file.path.stem
    is_named_alike = other == stem or (other.startswith(stem) and other[len(stem)] in SEPARATORS)
    channels = [{*recognized_file.choices, *recognized_file.raw_choices} for recognized_file in (trial, file)]
    if not is_named_alike or channels[0] & channels[1] != {"time"}:
        return False
    times = [recognized_file.samples["time"] for recognized_file in (trial, file)]
    return bool(max(np.nanmin(time) for time in times) < min(np.nanmax(time) for time in times))


def _join(trial: RecognizedFile, file: RecognizedFile) -> RecognizedFile:
    """Return ``trial`` with the channels of ``file``, which are interpolated at the times of the trial."""
    samples = {name: _interpolate(values, file, trial) for name, values in file.samples.items() if name != "time"}
    readings = {name: _interpolate(values, file, trial) for name, values in file.readings.items()}
    time = _join_times(trial.choices["time"], file.choices["time"])
    return replace(
        trial,
        companions=(*trial.companions, file.path),
        choices={**file.choices, **trial.choices, "time": time},
        unused=(*trial.unused, *file.unused),
        samples={**samples, **trial.samples},
        raw_choices={**trial.raw_choices, **file.raw_choices},
        readings={**trial.readings, **readings},
    )


def _interpolate(values: Array, file: RecognizedFile, trial: RecognizedFile) -> Array:
    """Return ``values`` of ``file`` at the times of ``trial``, NaN outside of its own."""
    is_known = np.isfinite(values) & np.isfinite(file.samples["time"])
    times = file.samples["time"][is_known]
    return np.interp(trial.samples["time"], times, values[is_known], left=np.nan, right=np.nan)


def _join_times(first: ColumnChoice, other: ColumnChoice) -> ColumnChoice:
    """Return the ``first`` choice with the expression of the ``other`` behind it, if it has one of its own."""
    known = (first.expression, *first.other_expressions)
    others = (other.expression,) if other.expression and other.expression not in known else ()
    remarks = dict.fromkeys(filter(None, (first.remark, other.remark)))
    return replace(first, other_expressions=(*first.other_expressions, *others), remark="; ".join(remarks))
