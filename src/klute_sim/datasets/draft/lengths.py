"""Whether the lengths of bench recordings are lengths or displacements, and which way a displacement counts."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from klute_sim.datasets.draft.columns import Displacement, RecognizedFile
from klute_sim.datasets.draft.headings import RELATIVE_UNITS, HeadingMeaning, interpret_heading
from klute_sim.types import Array

MAX_DISPLACEMENT_RATIO = 0.5
"""Largest value of a column of displacements, relative to the resting length of the unit (assumed)."""
MIN_LENGTH_RATIO = 0.05
"""Shortest specimen, relative to the resting length of the unit (assumed); what is called a length and comes nearer to
0 is a displacement."""
MIN_CORRELATION = 0.3
"""Smallest correlation from which a direction is concluded (assumed)."""
N_PRESSURE_INTERVALS = 10
"""Number of intervals of pressure within which force and displacement are compared."""
N_INSTANTS = 400
"""Number of samples of each file that are compared."""


def interpret_lengths(files: Sequence[RecognizedFile], resting_length: float) -> list[RecognizedFile]:
    """Return ``files`` with a length where a column holds displacements from the ``resting_length`` [m] of the unit.

    A column with the same heading means the same in all files.
    """
    members: dict[str, list[RecognizedFile]] = {}
    for file in files:
        if "length" in file.choices:
            members.setdefault(file.choices["length"].heading, []).append(file)
    directions = {}
    for heading, group in members.items():
        meaning = interpret_heading(heading)
        lengths = np.concatenate([file.samples["length"] for file in group])
        if meaning is not None and (
            group[0].choices["length"].unit in RELATIVE_UNITS or _is_displacement(lengths, meaning, resting_length)
        ):
            directions[heading] = _find_direction(group, meaning)
    return [
        _add_resting_length(file, *directions[file.choices["length"].heading], resting_length)
        if "length" in file.choices and file.choices["length"].heading in directions
        else file
        for file in files
    ]


def _is_displacement(lengths: Array, meaning: HeadingMeaning, resting_length: float) -> bool:
    if meaning.is_length and np.nanmin(lengths) > MIN_LENGTH_RATIO * resting_length:
        return False
    return bool(np.nanmax(lengths) < MAX_DISPLACEMENT_RATIO * resting_length)


def _add_resting_length(file: RecognizedFile, direction: int, reason: str, resting_length: float) -> RecognizedFile:
    choice = file.choices["length"]
    displacement = Displacement(choice.heading, choice.unit, direction)
    remark = f"this is a displacement, and the resting length of the device is taken for its zero; {reason}"
    changed = replace(
        choice,
        expression=displacement.format_length(resting_length),
        remark="; ".join(filter(None, (choice.remark, remark))),
    )
    scale = resting_length if choice.unit in RELATIVE_UNITS else 1.0
    lengths = resting_length + direction * scale * file.samples["length"]
    return replace(
        file,
        choices={**file.choices, "length": changed},
        samples={**file.samples, "length": lengths},
        displacement=displacement,
    )


def _find_direction(files: Sequence[RecognizedFile], meaning: HeadingMeaning) -> tuple[int, str]:
    """Return 1 where the displacements of ``files`` lengthen the muscle and -1 where they shorten it, and why."""
    measured = _compare_force(files)
    verb = {1: "rises", -1: "falls"}.get(measured, "")
    if meaning.direction:
        what = "lengthening" if meaning.direction > 0 else "shortening"
        is_contradicted = measured == -meaning.direction
        doubt = f", although at equal pressure the force {verb} with it" if is_contradicted else ""
        return meaning.direction, f"by its heading it counts {what} as positive{doubt}"
    if measured:
        what = "lengthening" if measured > 0 else "shortening"
        return measured, f"it counts {what} as positive, because at equal pressure the force {verb} with it"
    return 1, "whether it lengthens or shortens the muscle does not show; lengthening is assumed (else write - for +)"


def _compare_force(files: Sequence[RecognizedFile]) -> int:
    """Return the sign of the change of force with displacement at equal pressure; 0 where the files do not show it.

    A muscle pulls less where it is shorter. A raw reading of the force has the sign with which it rises with pressure.
    """
    pressure, displacement, force = np.concatenate([_collect_rows(file) for file in files], axis=1)
    if not len(pressure):
        return 0
    is_raw = any("force" in file.readings for file in files)
    orientation = _get_sign([(pressure, force)]) if is_raw else 1
    edges = np.linspace(pressure.min(), pressure.max(), N_PRESSURE_INTERVALS + 1)
    pairs = []
    for low, high in pairwise(edges):
        is_inside = (pressure >= low) & (pressure <= high)
        if is_inside.sum() > 3:
            inside = pressure[is_inside]
            pairs.append((_remove_line(inside, displacement[is_inside]), _remove_line(inside, force[is_inside])))
    return orientation * _get_sign(pairs)


def _collect_rows(file: RecognizedFile) -> Array:
    """Return pressure, displacement and force of ``file`` (3, n), without missing samples; n = 0 if it lacks one."""
    pressure = file.samples.get("pressure", file.samples.get("pressure_command"))
    force = file.get_output("force")
    if pressure is None or force is None:
        return np.empty((3, 0))
    rows = np.array([pressure, file.samples["length"], force])
    rows = rows[:, np.isfinite(rows).all(axis=0)]
    return rows[:, :: max(1, rows.shape[1] // N_INSTANTS)]


def _remove_line(x: Array, y: Array) -> Array:
    """Return ``y`` without its mean and its regression on ``x``."""
    x, y = x - x.mean(), y - y.mean()
    square = float(x @ x)
    return y - x * (float(x @ y) / square) if square > 0.0 else y


def _get_sign(pairs: Sequence[tuple[Array, Array]]) -> int:
    """Return the sign of the pooled correlation of the ``pairs``; 0 where it is below :data:`MIN_CORRELATION`."""
    centred = [(x - x.mean(), y - y.mean()) for x, y in pairs]
    covariance = sum(float(x @ y) for x, y in centred)
    scale = np.sqrt(sum(float(x @ x) for x, _ in centred) * sum(float(y @ y) for _, y in centred))
    return int(np.sign(covariance)) if abs(covariance) > MIN_CORRELATION * scale else 0
