"""The parameter of a search: a number between bounds that an algorithm sees in normalized coordinates.

Fits (:mod:`klute_sim.diagnosis.fitting`) and tuning (:mod:`klute_sim.tuning`) share it.
"""

import math
from dataclasses import dataclass

MAX_EXPONENT = 700.0
"""Largest argument of the exponential; larger ones overflow and lie beyond every bound."""


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A number between bounds; its normalized coordinate ``x`` is 0 at the initial value and 1 one scale above it."""

    name: str
    """Name of the parameter, such as the key in a device file."""
    initial: float
    """Value at ``x = 0``, in the parameter's unit."""
    scale: float
    """Change of the value per unit of ``x``; for a logarithmic parameter, change of the natural logarithm."""
    lower: float
    """Smallest allowed value."""
    upper: float
    """Largest allowed value."""
    is_logarithmic: bool = False
    """Whether ``x`` is proportional to the logarithm of the value instead of the value."""
    unit: str = ""
    """Unit of the value; empty where the name carries it or the value is a pure number."""

    @property
    def label(self) -> str:
        """Name with the unit in square brackets."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    @property
    def bounds(self) -> tuple[float, float]:
        """Lower and upper bound of the normalized coordinate."""
        first, second = self.normalize(self.lower), self.normalize(self.upper)
        return (first, second) if first < second else (second, first)

    def normalize(self, value: float) -> float:
        """Return the normalized coordinate of ``value``."""
        if self.is_logarithmic:
            return math.log(value / self.initial) / self.scale
        return (value - self.initial) / self.scale

    def denormalize(self, x: float) -> float:
        """Return the value at the normalized coordinate ``x``, clipped to the bounds."""
        if self.is_logarithmic:
            value = self.initial * math.exp(min(x * self.scale, MAX_EXPONENT))
        else:
            value = self.initial + x * self.scale
        return min(max(value, self.lower), self.upper)

    def compute_violation(self, x: float) -> float:
        """Return the distance of ``x`` from the bounds, in normalized units; 0 inside them."""
        return abs(x - self.normalize(self.denormalize(x)))
