"""How muscle-like the actuator and its damper are: the design envelope (2.5) against what they do."""

from dataclasses import dataclass

import numpy as np

from klute_sim.laws import hill, mckibben
from klute_sim.laws.hill import ClosedInterval, ContractileElement
from klute_sim.laws.mckibben import Muscle
from klute_sim.recording.recording import Array

FIT_LENGTH_RATIO_RANGE = (0.65, 1.0)
"""L/L0 over which the parabola is fitted: the source's Fig. 3.6."""
SATURATION_TOLERANCE = 0.005
"""How far the saturation may be from the single value that (2.5) prints."""


@dataclass(frozen=True)
class EnvelopeBound:
    """One line of (2.5)."""

    name: str
    low: float
    high: float
    value: float | None
    """None: what was fitted has no such constant."""
    tolerance: float = 0.0

    @property
    def is_met(self) -> bool:
        """Whether what was found is inside."""
        span = ClosedInterval(self.low - self.tolerance, self.high + self.tolerance)
        return self.value is not None and hill.is_in_interval(span, self.value)


def fit_parabola(
    muscle: Muscle, pressure: float, length_ratio_range: tuple[float, float] = FIT_LENGTH_RATIO_RANGE
) -> ContractileElement:
    """Least-squares fit of (2.3) to the isometric force at gauge ``pressure`` [Pa], over that at L0, by L/L0.

    The constants depend on the span of L/L0, ``ratios``, and so does the sign of k7. The curve is convex: k5 > 0.
    """
    ratio = np.linspace(*length_ratio_range, 201)
    force = np.array([mckibben.force(muscle, pressure, float(x) * muscle.resting_length) for x in ratio])
    k5, k6, k7 = np.polyfit(ratio, force / mckibben.force(muscle, pressure, muscle.resting_length), 2)
    return ContractileElement(float(k5), float(k6), float(k7))


def fit_hyperbola(velocity: Array, force: Array) -> float | None:
    """a/F0 = b/Vmax of the hyperbola (2.4) through (0, 1) and (1, 0) nearest to ``force`` [F0] over V/Vmax.

    None where none is near: a curve that is straight, or bends the other way, has no finite best constant.
    """
    shape = np.geomspace(0.01, 100.0, 2001)
    fitted = 1.0 - (1.0 + shape[:, None]) * velocity / (velocity + shape[:, None])
    best = int(np.argmin(((fitted - force) ** 2).sum(axis=1)))
    return float(shape[best]) if best < len(shape) - 1 else None


def compare_with_envelope(
    isometric: ContractileElement, hyperbola_shape: float | None, saturation: float
) -> list[EnvelopeBound]:
    """(2.5) against a parabola, the shape of the concentric branch and the eccentric force over F0."""
    box = hill.DESIGN_ENVELOPE
    return [
        EnvelopeBound("k5", *box.k5, isometric.k5),
        EnvelopeBound("k6", *box.k6, isometric.k6),
        EnvelopeBound("k7", *box.k7, isometric.k7),
        EnvelopeBound("a/F0", *box.a, hyperbola_shape),
        EnvelopeBound("b/Vmax", *box.b, hyperbola_shape),
        EnvelopeBound("saturation", *box.saturation, saturation, SATURATION_TOLERANCE),
    ]
