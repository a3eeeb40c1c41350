"""Names of compared channels: axes, references, defaults, and channels that accumulate from stride to stride."""

from collections.abc import Collection, Iterable, Sequence

from klute_sim.comparison.alignment.resample import PHASE_CHANNEL, STRIDE_CHANNEL, TIME_CHANNEL

REFERENCE_PREFIX, SD_SUFFIX = "reference_", "_sd"
"""Prefix of the human reference of a channel, and suffix of its standard deviation."""
AXIS_CHANNELS = frozenset({TIME_CHANNEL, PHASE_CHANNEL, STRIDE_CHANNEL, "start"})
"""Channels that define the axis and are not compared; ``start`` is the start time of a stride in its original file."""
MAIN_CHANNELS = (
    "ankle_angle", "ankle_moment", "ankle_power", "grf_vertical", "grf_forward", "cop_x",
    "length", "force", "load_cell", "pressure", "muscle_length", "body_load",
)  # fmt: skip
"""Channels compared by default if there are more than :data:`MAX_DEFAULT_CHANNELS`."""
MAX_DEFAULT_CHANNELS = 12
"""Largest number of channels that are all compared by default."""
STRIDE_ORIGINS = {
    "carriage_x": "carriage_x",
    "ankle_x": "ankle_x",
    "cop_x": "ankle_x",
    "air_drawn": "air_drawn",
    "air_leaked": "air_leaked",
}
"""Accumulating channel -> channel whose value at heel strike is its origin over phase.

Without an origin per stride, their mean over strides would be meaningless.
"""
ALL_CHANNELS = "all"
"""Name that requests all channels."""


def select_measured(names: Iterable[str]) -> list[str]:
    """Return the channels in ``names`` that are neither axes nor references."""
    return [name for name in names if name not in AXIS_CHANNELS and not name.startswith(REFERENCE_PREFIX)]


def parse_reference_name(name: str) -> str:
    """Return the channel that the reference column ``name`` belongs to; '' for other columns."""
    return name.removeprefix(REFERENCE_PREFIX).removesuffix(SD_SUFFIX) if name.startswith(REFERENCE_PREFIX) else ""


def find_reference_channels(names: Collection[str]) -> list[str]:
    """Return the channels with a human reference among ``names``."""
    references = [n.removeprefix(REFERENCE_PREFIX) for n in names if n.startswith(REFERENCE_PREFIX)]
    deviations = {n + SD_SUFFIX for n in references}
    return [n for n in references if n not in deviations]


def select_defaults(common: Sequence[str]) -> list[str]:
    """Return the ``common`` channels that are compared by default: all, or the main ones if there are many."""
    if len(common) <= MAX_DEFAULT_CHANNELS:
        return list(common)
    return [name for name in MAIN_CHANNELS if name in common] or list(common)
