"""A recording: named channels with units on one time base, and where they come from.

A channel is written ``name [unit]`` wherever it leaves the program (Parquet and CSV columns, plots, rerun).
Conventions: dorsiflexion, forward and up are positive; moments are net and plantarflexor positive.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from klute_sim.errors import InputError

Array = NDArray[np.float64]

_HEADING_PATTERN = re.compile(r"^(?P<name>[a-z][a-z0-9_]*) \[(?P<unit>[^\[\]]*)\]$")


def split_heading(heading: str) -> tuple[str, str]:
    """``"force [N]"`` -> ``("force", "N")``; raises InputError for anything else."""
    match = _HEADING_PATTERN.match(heading)
    if match is None:
        raise InputError(f"column '{heading}' is not of the form 'name [unit]', such as 'force [N]'")
    return match["name"], match["unit"]


@dataclass(frozen=True)
class Recording:
    """Channels of equal length; the first is ``time``."""

    channels: Mapping[str, Array]
    """Name -> samples, in the order of the columns."""
    units: Mapping[str, str]
    """Name -> unit, such as ``N*m`` or ``deg``; ``1`` for a pure number."""
    provenance: Mapping[str, Any] = field(default_factory=dict)
    """What made it (JSON types only): device file, reference, options, versions, seed. No clock times, so
    that equal inputs give equal files."""

    def __post_init__(self) -> None:
        """Raise InputError unless there is a time base and all channels have its length."""
        if "time" not in self.channels:
            raise InputError("a recording needs a channel 'time [s]'")
        count = len(self.channels["time"])
        for name, samples in self.channels.items():
            if samples.shape != (count,):
                raise InputError(f"channel '{name}' has shape {samples.shape}, but 'time' has ({count},)")
        if set(self.units) != set(self.channels):
            raise InputError("every channel needs a unit, and every unit a channel")

    def __getitem__(self, name: str) -> Array:
        """Samples of channel ``name``; raises InputError naming the channels there are."""
        try:
            return self.channels[name]
        except KeyError:
            raise InputError(f"no channel '{name}'; there are {', '.join(self.channels)}") from None

    def __contains__(self, name: object) -> bool:
        """Whether there is a channel ``name``."""
        return name in self.channels

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.channels["time"])

    def format_heading(self, name: str) -> str:
        """Column heading of channel ``name``, such as ``force [N]``."""
        return f"{name} [{self.units[name]}]"

    def select(self, mask: NDArray[np.bool_] | slice) -> "Recording":
        """The samples that ``keep`` picks, all channels."""
        return Recording({n: s[mask] for n, s in self.channels.items()}, self.units, self.provenance)

    @staticmethod
    def from_columns(
        columns: Iterable[tuple[str, NDArray[np.floating[Any]]]], provenance: Mapping[str, Any] | None = None
    ) -> "Recording":
        """From ``("name [unit]", samples)`` pairs."""
        channels: dict[str, Array] = {}
        units: dict[str, str] = {}
        for heading, samples in columns:
            name, unit = split_heading(heading)
            if name in channels:
                raise InputError(f"channel '{name}' occurs twice")
            channels[name], units[name] = np.asarray(samples, dtype=np.float64), unit
        return Recording(channels, units, provenance or {})
