"""Factors of specimens: muscles that were made alike pull by some per cent more or less."""

from collections.abc import Sequence

from klute_sim.device.dynamics import DeviceParameters

SPECIMEN_PREFIX = "specimen."
"""Beginning of the name of the factor of a specimen."""
SPECIMEN_DEVIATION = 0.05
"""Standard deviation of the factor of a specimen (assumed: hand-made muscles of one batch)."""


def compute_factors(specimens: Sequence[str], values: Sequence[float]) -> dict[str, float]:
    """Return specimen -> factor for the fitted ``values`` (one per specimen), relative to their mean.

    The mean belongs to the numbers of the device, which must predict a specimen that nobody has measured.
    """
    mean = sum(values) / len(values) if values else 1.0
    return {specimen: value / mean for specimen, value in zip(specimens, values, strict=True)}


def scale_muscle(parameters: DeviceParameters, factor: float) -> DeviceParameters:
    """Return ``parameters`` with ``factor`` times as much muscle in parallel, which pulls that much more."""
    muscle = parameters.muscle
    return parameters._replace(muscle=muscle._replace(n_actuators=factor * muscle.n_actuators))
