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
"""Smallest and largest error of the law, root mean square over the range of the force."""
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


def add_law_error(
    signals: Mapping[str, Floats],
    program: InputProgram,
    error: Mapping[str, Any],
    specimen: str,
    force_range: float,
) -> dict[str, Floats]:
    """Return ``signals`` (force [N], pressure [bar] and others on the trace grid) with the ``error`` of the law."""
    pressure = np.clip(signals["pressure"] / 2.5 - 1.0, -1.0, 1.0)
    length = np.clip((program.length[: len(pressure)] - 0.335) / 0.02, -1.0, 1.0)
    surface = np.zeros(len(pressure))
    for (i, k), coefficient in zip(ORDERS, error["coefficients"], strict=True):
        surface += coefficient * np.cos(i * np.arccos(pressure)) * np.cos(k * np.arccos(length))
    size = np.sqrt(np.sum(np.square(error["coefficients"])) * 0.4)  # root mean square over the square, about
    force = error["gains"][specimen] * signals["force"] + error["fraction"] * force_range * surface / size
    # A tendon cannot push: where there is no force, there is no error.
    return {**signals, "force": np.where(signals["force"] > 0.0, np.maximum(force, 0.0), signals["force"])}
