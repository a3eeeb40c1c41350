"""A bench trial as the checks see it: channels, limits of its device, and a simulation of the device."""

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from klute_sim.plausibility.samples import Samples
from klute_sim.plausibility.units import Range, format_range, format_value
from klute_sim.types import Array

PRESCRIBED = ("length", "pressure_command")
"""Channels that the tester and the regulator follow."""
MEASURED = ("force", "pressure", "muscle_length")
"""Channels that sensors measure."""
SI_UNITS = {"length": "m", "muscle_length": "m", "force": "N", "pressure_command": "Pa", "pressure": "Pa"}
"""Channel -> SI unit."""
MIN_FORCE = 5.0
"""Largest force [N] of a device that is no muscle but a tendon or a cylinder, whose force has no known limit."""


class DeviceLimits(NamedTuple):
    """Limits of a device, in SI units."""

    muscle_length: float
    """Resting length of the muscle."""
    lock_length: float
    """Length at which the braid of the muscle locks."""
    tendon_length: float
    """Slack length of the tendon; 0 for a rigid tie."""
    supply_pressure: float
    """Gauge pressure of the supply."""
    max_force: float
    """Force of the muscle at resting length under the pressure of the supply."""

    @property
    def unit_length(self) -> float:
        """Resting length of muscle and tendon together."""
        return self.muscle_length + self.tendon_length

    @property
    def braid_length(self) -> float:
        """Length of a thread of the braid, which no muscle exceeds."""
        return math.sqrt(3.0) * self.lock_length

    @property
    def possible_length(self) -> Range:
        """Range beyond which no length of the unit is (assumed)."""
        return Range(0.5 * (self.tendon_length + self.lock_length), 1.5 * self.unit_length, self.unit_length)

    @property
    def pulls(self) -> bool:
        """Whether the muscle pulls with a noticeable force."""
        return self.max_force > MIN_FORCE

    def get_range(self, channel: str) -> Range:
        """Return the range in which the median magnitude of ``channel`` usually lies."""
        if channel == "length":
            return Range(0.9 * (self.tendon_length + self.lock_length), 1.1 * self.unit_length, self.unit_length)
        if channel == "muscle_length":
            return Range(0.9 * self.lock_length, 1.1 * self.muscle_length, self.muscle_length)
        if channel == "force":
            return Range(0.002 * self.max_force, 2.0 * self.max_force, 0.3 * self.max_force)
        return Range(0.01 * self.supply_pressure, 1.2 * self.supply_pressure, 0.5 * self.supply_pressure)

    def get_span(self, channel: str) -> float:
        """Return the range of the measured ``channel`` on the device; infinite where it is unknown."""
        spans = {
            "force": self.max_force if self.pulls else math.inf,
            "pressure": self.supply_pressure,
            "muscle_length": self.muscle_length - self.lock_length,
        }
        return spans[channel] if spans[channel] > 0.0 else math.inf


class Response(NamedTuple):
    """Simulated response of the device, one value per time."""

    time: Array
    """Time [s]."""
    force: Array
    """Tension of the unit [N]."""
    pressure: Array
    """Gauge pressure in the muscle [Pa]."""
    muscle_length: Array
    """Length of the muscle [m]."""


Simulate = Callable[[float, Array, Array], Response | None]
"""Simulates the device with one unit length [m] and one command [Pa] per time step [s]; None where it fails."""


class Channel(NamedTuple):
    """Samples of a channel and their times."""

    time: Array
    """Time of each sample [s]."""
    samples: Samples
    """Samples as read."""

    def with_value(self, value: Array) -> "Channel":
        """Return the channel with other samples."""
        return self._replace(samples=self.samples._replace(value=value))


@dataclass(frozen=True)
class RecordedTrial:
    """One trial."""

    name: str
    """Name of the trial."""
    channels: Mapping[str, Channel]
    """Channels by their names on a bench."""
    limits: DeviceLimits
    """Limits of the device."""
    simulate: Simulate
    """Simulation of the device."""
    time_unit: tuple[str, float] = ("s", 1.0)
    """Unit of time in the heading, and its factor to SI."""
    group: str = ""
    """Group of repeats."""
    specimen: str = ""
    """Specimen of the device; '' where none is named."""
    scale_supply: Callable[[float], Simulate] | None = None
    """Builds the simulation of the device with its supply faster by a factor; None without a supply."""
    sources: Mapping[str, str] = field(default_factory=dict)
    """Channel -> columns that it is read from, and its unit: a mistake in these concerns all trials that share them."""

    @property
    def place(self) -> str:
        """Name of the trial in messages."""
        return f"trial '{self.name}'"

    def get_samples(self, channel: str) -> Samples:
        """Return the samples of ``channel``."""
        return self.channels[channel].samples

    def get_name(self, channel: str) -> str:
        """Return the name of ``channel`` in the dataset, such as ``pressure_flexor`` in that of a mechanism."""
        return self.channels[channel].samples.channel

    def shares_sources(self, other: "RecordedTrial", channels: Collection[str]) -> bool:
        """Return whether ``channels`` of both trials are read from the same columns with the same units."""
        return all(
            name in self.channels and name in other.channels and self.sources.get(name) == other.sources.get(name)
            for name in channels
        )

    def with_values(self, **values: Array) -> "RecordedTrial":
        """Return the trial with other samples [SI] of some channels."""
        changed = {name: self.channels[name].with_value(value) for name, value in values.items()}
        return replace(self, channels={**self.channels, **changed})

    def with_time_scale(self, factor: float) -> "RecordedTrial":
        """Return the trial with all times multiplied by ``factor``."""
        channels = {name: channel._replace(time=channel.time * factor) for name, channel in self.channels.items()}
        return replace(self, channels=channels)

    def with_supply_speed(self, factor: float) -> "RecordedTrial | None":
        """Return the trial of a device whose supply is ``factor`` times as fast; None without a supply."""
        return replace(self, simulate=self.scale_supply(factor)) if self.scale_supply else None

    def format_channel(self, channel: str) -> str:
        """Return the range of the samples of ``channel`` in the unit of its heading, without its outermost percent."""
        samples = self.get_samples(channel)
        low, high = np.percentile(samples.finite, [1.0, 99.0])
        return format_range(np.array([low, high]), samples.unit, samples.factor)

    def format_limit(self, channel: str, value: float) -> str:
        """Return ``value`` (SI) in the unit of the heading of ``channel``."""
        samples = self.get_samples(channel)
        return format_value(value, samples.unit, samples.factor)
