"""Interface of controllers that use the sensors of a prosthesis, and neither the true gait phase nor the reference."""

from typing import Any, NamedTuple, Protocol


class SensorReadings(NamedTuple):
    """Readings of the sensors of a prosthesis; SI."""

    ankle_angle: float
    """Ankle angle, dorsiflexion positive [rad]."""
    ankle_rate: float
    """Angular velocity of the ankle, dorsiflexion positive [rad/s]."""
    shank_angle: float
    """Inclination of the shank to gravity, forward positive [rad]."""
    shank_rate: float
    """Angular velocity of the shank, forward positive [rad/s]."""
    load: float
    """Force along the pylon, compression positive [body weights]."""
    pressure: float
    """Gauge pressure in the muscle [Pa]."""
    phase: float
    """Estimated gait phase (0-1): time since the last foot strike over the duration of the previous stride."""


class FeedbackController(Protocol):
    """A controller that commands a pressure from sensor readings every ``interval`` seconds."""

    interval: float
    """Time between commands [s]."""

    def reset(self) -> None:
        """Prepare for a gait run that begins at heel strike."""

    def command(self, readings: SensorReadings) -> float:
        """Return the commanded gauge pressure [Pa] until the next call."""

    def describe(self) -> dict[str, Any]:
        """Return a description of the controller for the provenance of a recording (JSON types)."""
