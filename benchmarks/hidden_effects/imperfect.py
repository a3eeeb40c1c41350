"""An imperfect law: specimens that differ, and an error of the force that is smooth in pressure and length.

No form of the catalogue has this error. Real muscles have both: 3 % between specimens, 2 to 5 % of the range from any
law.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from benchmarks.hidden_effects.inputs import InputProgram

Floats = np.ndarray
SPECIMEN_SCATTER = 0.03
"""Standard deviation of the force of a specimen, relative."""
ERROR_FRACTIONS = (0.02, 0.05)
"""Smallest and largest error of the law, root mean square over the range of the force (:func:`measure_range`)."""
SEEN_SPECIMENS = ("A", "B", "C")
"""Specimens of fitted and validation trials, in turn; test trials have another one."""
ORDERS = ((2, 0), (0, 2), (1, 1), (3, 0), (2, 1), (1, 2), (0, 3))
"""Orders of the Chebyshev polynomials in pressure and length: a gain or an offset could imitate lower ones."""


def draw_law_error(rng: np.random.Generator | None) -> dict[str, Any]:
    """Return an error of the law; with None the typical one."""
    generator = rng or np.random.default_rng(0)
    low, high = ERROR_FRACTIONS
    return {
        "fraction": float(generator.uniform(low, high)) if rng is not None else 0.5 * (low + high),
        "coefficients": generator.normal(size=len(ORDERS)).round(6).tolist(),
        "gains": {
            name: round(float(1.0 + SPECIMEN_SCATTER * generator.normal()), 6) for name in (*SEEN_SPECIMENS, "D")
        },
    }


def assign_specimens(programs: Sequence[InputProgram]) -> dict[str, str]:
    """Return the specimen of each program by its name."""
    seen = [program.name for program in programs if program.use != "test"]
    specimens = {name: SEEN_SPECIMENS[k % len(SEEN_SPECIMENS)] for k, name in enumerate(seen)}
    return {program.name: specimens.get(program.name, "D") for program in programs}


def scale_law_error(
    error: Mapping[str, Any], programs: Sequence[InputProgram], signals: Sequence[Mapping[str, Floats]]
) -> dict[str, Any]:
    """Return ``error`` with its root mean square ``rms_n`` and the ``amplitude_n`` of its surface [N] in ``programs``.

    ``signals`` are those of each program without an error. The root mean square, where there is a force, is the
    fraction of the range of their forces.
    """
    forces = np.concatenate([row["force"] for row in signals])
    surface = np.concatenate(
        [_compute_surface(row, program, error) for row, program in zip(signals, programs, strict=True)]
    )
    rms = error["fraction"] * measure_range(forces)
    surface_rms = float(np.sqrt(np.mean(surface[forces > 0.0] ** 2)))
    return {**error, "rms_n": rms, "amplitude_n": rms / surface_rms}


def measure_range(forces: Floats) -> float:
    """Return the range of ``forces`` [N] without the largest and the smallest per cent, peaks of quick releases."""
    low, high = np.percentile(forces, [1.0, 99.0])
    return float(high - low)


def add_law_error(
    signals: Mapping[str, Floats], program: InputProgram, error: Mapping[str, Any], specimen: str
) -> dict[str, Floats]:
    """Return ``signals`` (force [N], pressure [bar] and others on the trace grid) with the scaled ``error``."""
    surface = _compute_surface(signals, program, error)
    force = error["gains"][specimen] * signals["force"] + error["amplitude_n"] * surface
    # A tendon cannot push: where there is no force, there is no error.
    return {**signals, "force": np.where(signals["force"] > 0.0, np.maximum(force, 0.0), signals["force"])}


def _compute_surface(signals: Mapping[str, Floats], program: InputProgram, error: Mapping[str, Any]) -> Floats:
    pressure = np.clip(signals["pressure"] / 2.5 - 1.0, -1.0, 1.0)
    length = np.clip((program.length[: len(pressure)] - 0.335) / 0.02, -1.0, 1.0)
    surface = np.zeros(len(pressure))
    for (i, k), coefficient in zip(ORDERS, error["coefficients"], strict=True):
        surface += coefficient * np.cos(i * np.arccos(pressure)) * np.cos(k * np.arccos(length))
    return surface
