"""An evaluated point of a search whose objective is a mean over several simulations."""

from dataclasses import dataclass
from typing import Generic, TypeVar

from klute_sim.types import Array

INVALID_COST = 1e6
"""Cost of numbers that make no valid device or controller, or of a simulation that fails."""
M = TypeVar("M")


@dataclass(frozen=True)
class PointEvaluation(Generic[M]):
    """One evaluated point of the design space."""

    x: Array
    """Normalized point, one coordinate per design variable."""
    cost: float
    """Value of the objective, with the violation of the bounds."""
    metrics: M | None
    """Metrics over the simulations; None: the numbers are not valid, or a simulation failed."""
    failure: str | None = None
    """Reason of the failure; None: everything was simulated, though persons may have fallen."""
    generation: int = 0
    """Generation of the search that proposed the point; 0: the initial point."""
