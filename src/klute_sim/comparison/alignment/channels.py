"""Which channels are compared, and how those are read that go on from stride to stride."""

from collections.abc import Collection, Iterable, Sequence

from klute_sim.comparison.alignment.resample import PHASE_CHANNEL, STRIDE_CHANNEL, TIME_CHANNEL

REFERENCE_PREFIX, SD_SUFFIX = "reference_", "_sd"
"""Around the name of a channel: the human reference's, and its standard deviation."""
AXIS_CHANNELS = frozenset({TIME_CHANNEL, PHASE_CHANNEL, STRIDE_CHANNEL, "start"})
"""What is compared along, not compared; ``start`` is where a stride of ``klute-sim import`` began in its own file."""
MAIN_CHANNELS = (
    "ankle_angle", "ankle_moment", "ankle_power", "grf_vertical", "grf_forward", "cop_x",
    "length", "force", "load_cell", "pressure", "muscle_length", "body_load",
)  # fmt: skip
"""Compared where nothing is named and there are more than :data:`MOST`."""
MAX_DEFAULT_CHANNELS = 12
STRIDE_ORIGINS = {
    "carriage_x": "carriage_x",
    "ankle_x": "ankle_x",
    "cop_x": "ankle_x",
    "air_drawn": "air_drawn",
    "air_leaked": "air_leaked",
}
"""Channel -> the channel whose value at heel strike it is counted from over phase.

These grow from stride to stride, so that their mean over strides would mean nothing.
"""
ALL_CHANNELS = "all"
"""In place of names: every one."""


def select_measured(names: Iterable[str]) -> list[str]:
    """Those of ``names`` that are channels of the recording's own: no axis, no reference."""
    return [name for name in names if name not in AXIS_CHANNELS and not name.startswith(REFERENCE_PREFIX)]


def parse_reference_name(name: str) -> str:
    """The channel that the column ``name`` of a reference is held against; '' of any other column."""
    return name.removeprefix(REFERENCE_PREFIX).removesuffix(SD_SUFFIX) if name.startswith(REFERENCE_PREFIX) else ""


def find_reference_channels(names: Collection[str]) -> list[str]:
    """The channels that there is a human reference for among ``names``."""
    plain = [n.removeprefix(REFERENCE_PREFIX) for n in names if n.startswith(REFERENCE_PREFIX)]
    deviations = {n + SD_SUFFIX for n in plain}
    return [n for n in plain if n not in deviations]


def select_defaults(common: Sequence[str]) -> list[str]:
    """What to compare of the ``common`` channels where nothing was named: all, or the main ones if they are many."""
    if len(common) <= MAX_DEFAULT_CHANNELS:
        return list(common)
    return [name for name in MAIN_CHANNELS if name in common] or list(common)
