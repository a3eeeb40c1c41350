"""Comparison of actuator and damper with the design envelope (2.5)."""

from dataclasses import dataclass

import numpy as np

from klute_sim.laws import hill, mckibben
from klute_sim.laws.hill import ClosedInterval, ContractileElement
from klute_sim.laws.mckibben import MuscleParameters
from klute_sim.types import Array

FIT_LENGTH_RATIO_RANGE = (0.65, 1.0)
"""Range of L/L0 over which the parabola is fitted; that of Fig. 3.6."""
SATURATION_TOLERANCE = 0.005
"""Allowed distance of the saturation from the single value that (2.5) prints."""


@dataclass(frozen=True)
class EnvelopeBound:
    """One line of (2.5) with the fitted value."""

    name: str
    """Name of the constant."""
    low: float
    """Lower bound."""
    high: float
    """Upper bound."""
    value: float | None
    """Fitted value; None where the fitted curve has no such constant."""
    tolerance: float = 0.0
    """Amount by which the value may leave the bounds."""

    @property
    def is_met(self) -> bool:
        """Return whether the value is within the bounds."""
        interval = ClosedInterval(self.low - self.tolerance, self.high + self.tolerance)
        return self.value is not None and hill.is_in_interval(interval, self.value)


def fit_parabola(
    muscle: MuscleParameters, pressure: float, length_ratio_range: tuple[float, float] = FIT_LENGTH_RATIO_RANGE
) -> ContractileElement:
    """Fit (2.3) to the isometric force at gauge ``pressure`` [Pa], relative to the force at L0, by least squares.

    The constants, and even the sign of k7, depend on ``length_ratio_range``. The curve is convex: k5 > 0.
    """
    ratio = np.linspace(*length_ratio_range, 201)
    force = np.array([mckibben.force(muscle, pressure, float(x) * muscle.resting_length) for x in ratio])
    k5, k6, k7 = np.polyfit(ratio, force / mckibben.force(muscle, pressure, muscle.resting_length), 2)
    return ContractileElement(float(k5), float(k6), float(k7))


def fit_hyperbola(velocity: Array, force: Array) -> float | None:
    """Return a/F0 = b/Vmax of the hyperbola (2.4) through (0, 1) and (1, 0) nearest to ``force`` [F0] over V/Vmax.

    Return None for a straight or oppositely curved relation, which has no finite best constant.
    """
    shape = np.geomspace(0.01, 100.0, 2001)
    curves = 1.0 - (1.0 + shape[:, None]) * velocity / (velocity + shape[:, None])
    best_index = int(np.argmin(((curves - force) ** 2).sum(axis=1)))
    return float(shape[best_index]) if best_index < len(shape) - 1 else None


def compare_with_envelope(
    isometric: ContractileElement, hyperbola_shape: float | None, saturation: float
) -> list[EnvelopeBound]:
    """Compare a parabola, the shape of the concentric branch and the eccentric saturation with (2.5)."""
    envelope = hill.DESIGN_ENVELOPE
    return [
        EnvelopeBound("k5", *envelope.k5, isometric.k5),
        EnvelopeBound("k6", *envelope.k6, isometric.k6),
        EnvelopeBound("k7", *envelope.k7, isometric.k7),
        EnvelopeBound("a/F0", *envelope.a, hyperbola_shape),
        EnvelopeBound("b/Vmax", *envelope.b, hyperbola_shape),
        EnvelopeBound("saturation", *envelope.saturation, saturation, SATURATION_TOLERANCE),
    ]
