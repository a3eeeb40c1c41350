"""Controllers that see what a prosthesis can sense, and nothing else: no true phase, no reference."""

from typing import Any, NamedTuple, Protocol


class SensorReadings(NamedTuple):
    """What the instruments of a prosthesis tell, SI."""

    ankle_angle: float
    """Dorsiflexion positive [rad]."""
    ankle_rate: float
    """Dorsiflexion positive [rad/s]."""
    shank_angle: float
    """Inclination to gravity, forward positive [rad]."""
    shank_rate: float
    """Forward positive [rad/s]."""
    load: float
    """Along the pylon, compression positive [body weights]."""
    pressure: float
    """Gauge [Pa]."""
    phase: float
    """Estimated phase of the gait cycle (0-1): time since the last foot strike over the stride before."""


class FeedbackController(Protocol):
    """Anything that commands pressure from what is sensed, at its own ``interval`` [s]."""

    interval: float

    def reset(self) -> None:
        """A walk begins, at heel strike."""

    def command(self, readings: SensorReadings) -> float:
        """Gauge pressure [Pa] to ask for until the next call."""

    def describe(self) -> dict[str, Any]:
        """What this controller is, for a recording's provenance (JSON types)."""
