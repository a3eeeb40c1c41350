"""Correction of the planned path of the hip over a stride, as a gait simulator learns it from stride to stride."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from klute_sim.errors import InputError
from klute_sim.types import Array, ComplexArray

AXES = ("forward", "height")
"""Names of the columns of a path."""
MAX_LEARNING_STRIDES = 100
"""Largest number of strides that a learning may be allowed."""
VERTICAL_TOLERANCE_BW, FORWARD_TOLERANCE_BW = 0.01, 0.015
"""Rms errors of the ground reaction in stance [body weights] at which the learning ends (assumed)."""


@dataclass(frozen=True)
class HipPath:
    """Fourier series of the displacement of the hip from its planned motion, forward and up."""

    coefficients: ComplexArray
    """(2, n) complex coefficients of the harmonics 0 to n - 1 [m], forward and height: ``u = Re sum c_k exp(2 pi i k
    phase)``."""
    learning_strides: int = 0
    """Number of strides up to the one of least error, whose path this is; 0: not learned."""
    vertical_residual_bw: float | None = None
    """Rms error of the vertical ground reaction in stance [body weights] in that stride."""
    forward_residual_bw: float | None = None
    """Rms error of the fore-aft ground reaction in stance [body weights] in that stride."""
    max_learning_strides: int = 0
    """Largest number of strides that the learning could take."""

    @property
    def has_converged(self) -> bool | None:
        """Whether both errors are below the tolerances; None if the path was not learned."""
        if self.vertical_residual_bw is None or self.forward_residual_bw is None:
            return None
        return self.vertical_residual_bw < VERTICAL_TOLERANCE_BW and self.forward_residual_bw < FORWARD_TOLERANCE_BW

    @classmethod
    def from_samples(cls, samples: Array, n_harmonics: int) -> "HipPath":
        """Return the path with the mean and ``n_harmonics`` of ``samples`` (n, 2) [m] over a stride."""
        spectrum = np.fft.rfft(samples, axis=0)[: n_harmonics + 1].T / len(samples)
        spectrum[:, 1:] *= 2.0
        return cls(spectrum)

    def evaluate(self, phase: Array, derivative: int = 0) -> Array:
        """Return the displacement (n, 2) [m] at ``phase`` (0-1), or its ``derivative``-th derivative by phase."""
        rate = 2j * math.pi * np.arange(self.coefficients.shape[1])
        waves = np.exp(np.outer(phase, rate)) * rate**derivative
        return np.asarray((waves @ self.coefficients.T).real, dtype=np.float64)

    def to_mapping(self) -> dict[str, Any]:
        """Return the content in JSON types."""
        return {
            "learning_strides": self.learning_strides,
            "max_learning_strides": self.max_learning_strides,
            "has_converged": self.has_converged,
            "vertical_residual_bw": self.vertical_residual_bw,
            "forward_residual_bw": self.forward_residual_bw,
            **{
                f"{name}_m": {"cosine": row.real.tolist(), "sine": (-row.imag).tolist()}
                for name, row in zip(AXES, self.coefficients, strict=True)
            },
        }

    @classmethod
    def from_mapping(cls, content: Any, source: str) -> "HipPath":
        """Return the path in the ``content`` of :meth:`to_mapping`; raises InputError, which names the ``source``."""
        try:
            rows = [
                np.array(content[f"{name}_m"]["cosine"], dtype=np.float64)
                - 1j * np.array(content[f"{name}_m"]["sine"], dtype=np.float64)
                for name in AXES
            ]
            coefficients = np.stack(rows)
            strides, max_strides = int(content["learning_strides"]), int(content["max_learning_strides"])
            vertical, forward = (
                None if content[f"{name}_residual_bw"] is None else float(content[f"{name}_residual_bw"])
                for name in ("vertical", "forward")
            )
        except (KeyError, TypeError, ValueError):
            raise InputError(f"{source} holds no path of the hip; give the folder of a gait run") from None
        if coefficients.ndim != 2 or not np.isfinite(coefficients).all() or np.abs(coefficients).sum() > 1.0:
            raise InputError(f"{source} holds a path of the hip that is not finite or moves the hip by more than 1 m")
        return cls(coefficients, strides, vertical, forward, max_strides)


PLANNED_PATH = HipPath(np.zeros((2, 1), dtype=np.complex128))
"""The planned motion of the hip without a correction."""
