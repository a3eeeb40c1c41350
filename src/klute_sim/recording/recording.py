"""A recording: named channels with units on one time base, and their provenance.

Outside the program a channel is called ``name [unit]`` (Parquet and CSV columns, plots, rerun). Sign conventions:
dorsiflexion, forward and up are positive; moments are net moments, plantarflexor positive.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from klute_sim.errors import InputError, MissingExtraError
from klute_sim.types import Array

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

_HEADING_PATTERN = re.compile(r"^(?P<name>[a-z][a-z0-9_]*) \[(?P<unit>[^\[\]]*)\]$")


def split_heading(heading: str) -> tuple[str, str]:
    """Split ``"force [N]"`` into ``("force", "N")``; raises InputError for another form."""
    match = _HEADING_PATTERN.match(heading)
    if match is None:
        raise InputError(f"column '{heading}' is not of the form 'name [unit]', such as 'force [N]'")
    return match["name"], match["unit"]


@dataclass(frozen=True, repr=False)
class Recording:
    """Channels of equal length, one of them ``time``."""

    channels: Mapping[str, Array]
    """Samples by name, in the order of the columns."""
    units: Mapping[str, str]
    """Unit by name, such as ``N*m`` or ``deg``; ``1`` for a dimensionless number."""
    provenance: Mapping[str, Any] = field(default_factory=dict)
    """Device file, reference, options, versions and seed (JSON types only). It holds no clock times, so that equal
    inputs give equal files."""

    def __post_init__(self) -> None:
        """Raise InputError when there is no time base, or a channel has another length or no unit."""
        if "time" not in self.channels:
            raise InputError("a recording needs a channel 'time [s]'")
        n_samples = len(self.channels["time"])
        for name, samples in self.channels.items():
            if samples.shape != (n_samples,):
                raise InputError(f"channel '{name}' has shape {samples.shape}, but 'time' has ({n_samples},)")
        if set(self.units) != set(self.channels):
            unmatched = sorted(set(self.units) ^ set(self.channels))
            raise InputError(f"channels and units do not match: {', '.join(unmatched)}; each channel needs one unit")

    def __getitem__(self, name: str) -> Array:
        """Return the samples of channel ``name``; raises InputError if there is no such channel."""
        try:
            return self.channels[name]
        except KeyError:
            raise InputError(f"no channel '{name}'; allowed: {', '.join(self.channels)}") from None

    def __contains__(self, name: object) -> bool:
        """Return whether there is a channel ``name``."""
        return name in self.channels

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.channels["time"])

    def format_heading(self, name: str) -> str:
        """Return the column heading of channel ``name``, such as ``force [N]``."""
        return f"{name} [{self.units[name]}]"

    def select(self, mask: NDArray[np.bool_] | slice) -> "Recording":
        """Return the samples that ``mask`` selects, of all channels."""
        return Recording({name: samples[mask] for name, samples in self.channels.items()}, self.units, self.provenance)

    @staticmethod
    def from_columns(
        columns: Iterable[tuple[str, NDArray[np.floating[Any]]]], provenance: Mapping[str, Any] | None = None
    ) -> "Recording":
        """Return the recording of ``("name [unit]", samples)`` pairs."""
        channels: dict[str, Array] = {}
        units: dict[str, str] = {}
        for heading, samples in columns:
            name, unit = split_heading(heading)
            if name in channels:
                raise InputError(f"channel '{name}' occurs twice")
            channels[name], units[name] = np.asarray(samples, dtype=np.float64), unit
        return Recording(channels, units, provenance or {})

    def to_pandas(self) -> "pd.DataFrame":
        """Return a pandas DataFrame with the channels as columns and the time [s] as index.

        ``attrs`` of the frame holds the units by channel and the provenance.

        Raises MissingExtraError without pandas.
        """
        try:
            import pandas as pd
        except ImportError:
            raise MissingExtraError("Recording.to_pandas", "tables") from None
        columns = {name: samples for name, samples in self.channels.items() if name != "time"}
        frame = pd.DataFrame(columns, index=pd.Index(self["time"], name="time"))
        frame.attrs.update(units=dict(self.units), provenance=dict(self.provenance))
        return frame

    def to_xarray(self) -> "xr.Dataset":
        """Return an xarray Dataset with one variable per channel over the coordinate ``time`` [s].

        ``attrs["units"]`` of a variable holds its unit, ``attrs`` of the dataset the provenance.

        Raises MissingExtraError without xarray.
        """
        try:
            import xarray as xr
        except ImportError:
            raise MissingExtraError("Recording.to_xarray", "tables") from None
        variables = {
            name: ("time", samples, {"units": self.units[name]})
            for name, samples in self.channels.items()
            if name != "time"
        }
        time = ("time", self["time"], {"units": self.units["time"]})
        return xr.Dataset(variables, coords={"time": time}, attrs={"provenance": dict(self.provenance)})

    def __repr__(self) -> str:
        """Return the number of channels, the number of samples and the duration."""
        duration = f", {self['time'][-1] - self['time'][0]:.3f} s" if len(self) else ""
        return f"<Recording of {len(self.channels)} channels, {len(self)} samples{duration}>"

    def _repr_html_(self) -> str:
        """Return a table of the channels with unit and range, for notebooks."""
        rows = "".join(
            f"<tr><td>{name}</td><td>{self.units[name]}</td><td>{_format_range(samples)}</td></tr>"
            for name, samples in self.channels.items()
        )
        heading = "<tr><th>channel</th><th>unit</th><th>range</th></tr>"
        return f"<p>{repr(self)[1:-1]}</p><table>{heading}{rows}</table>"


def _format_range(samples: Array) -> str:
    finite = samples[np.isfinite(samples)]
    return f"{finite.min():.4g} to {finite.max():.4g}" if len(finite) else ""
