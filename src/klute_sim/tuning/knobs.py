"""What tuning turns: pressures and timing of a profile, and numbers of the device if asked for."""

import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from klute_sim.control.pressure import Profile
from klute_sim.dataset.override import overridden, to_toml
from klute_sim.device.files import Device, read
from klute_sim.errors import InputError
from klute_sim.units import BAR

Point = NDArray[np.float64]
TUNED = "assumed: found by klute-sim tune, nobody has built it"
PRESSURE, TIMING = 0.4, 2.0
"""First spread of a pressure [bar], and of the profile's timing [% of the cycle]."""
LATEST = 10.0
"""Most that a profile is moved either way [% of the cycle]."""
SHARE, FOLD = 0.2, 6.0
"""First spread of a device's number, over itself, and how far from nominal it may go, times or divided by."""
WAYS = {
    "muscle.resting_length_mm": (0.03, 0.8, 1.2),
    "mounting.neutral_muscle_ratio": (0.01, 0.92, 1.02),
    "supply.pressure_bar": (0.05, 0.5, 1.0),
}
"""Numbers that have less room: first spread, least and most, over nominal; a supply is never made stronger."""
DEVICE = (
    "damper.orifice_concentric_mm",
    "damper.orifice_eccentric_mm",
    "tendon.stiffness_1_n_per_mm",
    "tendon.stiffness_2_n_per_mm",
    "tendon.engagement_mm",
    "muscle.resting_length_mm",
    "mounting.neutral_muscle_ratio",
)
"""What is turned of a device that is tuned together with its controller, where nothing else is said."""


def _renamed(device: Device) -> Device:
    """Under a name of its own, if it is another one."""
    keys = tomllib.loads(device.content.decode("utf-8-sig"))
    if TUNED not in keys.get("sources", {}).values():
        return device
    plain = keys["name"].removesuffix("-tuned")  # of what is tuned further, the name stays
    keys |= {"name": f"{plain}-tuned", "description": f"{plain} with numbers found by klute-sim tune."}
    return read(to_toml(keys).encode(), keys["name"])


@dataclass(frozen=True)
class Knob:
    """One number; the search sees it in spreads from where it starts."""

    name: str
    start: float
    spread: float
    low: float
    high: float
    logarithmic: bool = False

    def value(self, place: float) -> float:
        """In its own unit, within its bounds, for a ``place`` in spreads."""
        found = self.start * math.exp(place * self.spread) if self.logarithmic else self.start + place * self.spread
        return min(max(found, self.low), self.high)

    def beyond(self, place: float) -> float:
        """How far a ``place`` is outside of the bounds, in spreads."""
        return abs(place - self.place(self.value(place)))

    def place(self, value: float) -> float:
        """The inverse of :meth:`value`."""
        return math.log(value / self.start) / self.spread if self.logarithmic else (value - self.start) / self.spread


@dataclass(frozen=True)
class Tunable:
    """A device and a profile with the knobs that are turned on them."""

    device: Device
    profile: Profile
    keys: tuple[str, ...] = ()
    """Numbers of the device (``section.key``)."""

    def __post_init__(self) -> None:
        """Raise InputError for a key that is no number of the device or cannot be scaled, or for too much pressure."""
        most = self.device.parameters.supply.pressure / BAR
        if max(self.profile.pressure_bar) > most:
            raise InputError(
                f"pressure profile {self.profile.name} asks for {max(self.profile.pressure_bar):g} bar; the supply of "
                f"'{self.device.name}' has {most:g} bar"
            )
        numbers = self.device.spec.numbers()
        for key in self.keys:
            if key not in numbers:
                raise InputError(f"device '{self.device.name}' has no number '{key}'; klute-sim device shows them")
            if key == "muscle.count":
                raise InputError(f"'{key}' is a whole number; only what can be any number is tuned")
            if not numbers[key] > 0.0:
                raise InputError(
                    f"'{key}' of device '{self.device.name}' is {numbers[key]:g}; only what is positive is tuned"
                )

    @property
    def knobs(self) -> tuple[Knob, ...]:
        """Pressures in the profile's order, its timing, the device's numbers."""
        most = self.device.parameters.supply.pressure / BAR
        found = [
            Knob(f"pressure at {phase:g} % [bar]", min(bar, most), PRESSURE, 0.0, most)
            for phase, bar in zip(self.profile.gait_pct, self.profile.pressure_bar, strict=True)
        ]
        found.append(Knob("timing [%]", 0.0, TIMING, -LATEST, LATEST))
        numbers = self.device.spec.numbers()
        for key in self.keys:
            spread, least, most = WAYS.get(key, (SHARE, 1.0 / FOLD, FOLD))
            nominal = numbers[key]
            found.append(Knob(key, nominal, spread, least * nominal, most * nominal, logarithmic=True))
        return tuple(found)

    def made(self, places: Sequence[float] | Point) -> tuple[Device, Profile]:
        """Device and profile with the knobs at ``places``; raises InputError for a device that cannot be."""
        values = [knob.value(float(place)) for knob, place in zip(self.knobs, places, strict=True)]
        count = len(self.profile.gait_pct)
        pressures, late, numbers = values[:count], values[count], values[count + 1 :]
        moved = sorted(
            (round((phase + late) % 100.0, 6), round(bar, 6))
            for phase, bar in zip(self.profile.gait_pct, pressures, strict=True)
        )
        profile = Profile(f"tuned from {self.profile.name}", *map(tuple, zip(*moved, strict=True)))
        changes = {key: float(f"{value:.6g}") for key, value in zip(self.keys, numbers, strict=True)}
        return _renamed(overridden(self.device, changes, TUNED)), profile

    def beyond(self, places: Sequence[float] | Point) -> float:
        """Sum of squares of how far ``places`` are outside of the bounds, in spreads."""
        return math.fsum(knob.beyond(float(place)) ** 2 for knob, place in zip(self.knobs, places, strict=True))
