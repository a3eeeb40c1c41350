"""What tuning turns: pressures and timing of a profile, and numbers of the device if asked for."""

import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from klute_sim.controllers.pressure import PressureProfile
from klute_sim.device.changes import apply_changes, to_toml
from klute_sim.device.device import Device, parse_device
from klute_sim.errors import InputError
from klute_sim.units import BAR

DesignVector = NDArray[np.float64]
TUNED_SOURCE = "assumed: found by klute-sim tune, nobody has built it"
PRESSURE_SCALE_BAR, TIMING_SCALE_PCT = 0.4, 2.0
"""First spread of a pressure [bar], and of the profile's timing [% of the cycle]."""
MAX_TIMING_SHIFT_PCT = 10.0
"""Most that a profile is moved either way [% of the cycle]."""
DEFAULT_RELATIVE_SCALE, DEFAULT_MAX_RATIO = 0.2, 6.0
"""First spread of a device's number, over itself, and how far from nominal it may go, times or divided by."""
RELATIVE_SCALES_AND_BOUNDS = {
    "muscle.resting_length_mm": (0.03, 0.8, 1.2),
    "mounting.neutral_muscle_ratio": (0.01, 0.92, 1.02),
    "supply.pressure_bar": (0.05, 0.5, 1.0),
}
"""Numbers that have less room: first spread, least and most, over nominal; a supply is never made stronger."""
DEFAULT_DEVICE_KEYS = (
    "damper.orifice_concentric_mm",
    "damper.orifice_eccentric_mm",
    "tendon.stiffness_1_n_per_mm",
    "tendon.stiffness_2_n_per_mm",
    "tendon.engagement_mm",
    "muscle.resting_length_mm",
    "mounting.neutral_muscle_ratio",
)
"""What is turned of a device that is tuned together with its controller, where nothing else is said."""


def _rename_tuned_device(device: Device) -> Device:
    """Under a name of its own, if it is another one."""
    keys = tomllib.loads(device.content.decode("utf-8-sig"))
    if TUNED_SOURCE not in keys.get("sources", {}).values():
        return device
    plain = keys["name"].removesuffix("-tuned")  # of what is tuned further, the name stays
    keys |= {"name": f"{plain}-tuned", "description": f"{plain} with numbers found by klute-sim tune."}
    return parse_device(to_toml(keys).encode(), keys["name"])


@dataclass(frozen=True)
class DesignVariable:
    """One number; the search sees it in spreads from where it starts."""

    name: str
    initial: float
    scale: float
    lower: float
    upper: float
    logarithmic: bool = False

    def decode(self, x: float) -> float:
        """In its own unit, within its bounds, for a ``place`` in spreads."""
        found = self.initial * math.exp(x * self.scale) if self.logarithmic else self.initial + x * self.scale
        return min(max(found, self.lower), self.upper)

    def compute_violation(self, x: float) -> float:
        """How far a ``place`` is outside of the bounds, in spreads."""
        return abs(x - self.normalize(self.decode(x)))

    def normalize(self, value: float) -> float:
        """The inverse of :meth:`value`."""
        return math.log(value / self.initial) / self.scale if self.logarithmic else (value - self.initial) / self.scale


@dataclass(frozen=True)
class DesignSpace:
    """A device and a profile with the knobs that are turned on them."""

    device: Device
    profile: PressureProfile
    device_keys: tuple[str, ...] = ()
    """Numbers of the device (``section.key``)."""

    def __post_init__(self) -> None:
        """Raise InputError for a key that is no number of the device or cannot be scaled, or for too much pressure."""
        most = self.device.parameters.supply.max_pressure / BAR
        if max(self.profile.pressure_bar) > most:
            raise InputError(
                f"pressure profile {self.profile.name} asks for {max(self.profile.pressure_bar):g} bar; the supply of "
                f"'{self.device.name}' has {most:g} bar"
            )
        numbers = self.device.spec.collect_values()
        for key in self.device_keys:
            if key not in numbers:
                raise InputError(f"device '{self.device.name}' has no number '{key}'; klute-sim device shows them")
            if key == "muscle.count":
                raise InputError(f"'{key}' is a whole number; only what can be any number is tuned")
            if not numbers[key] > 0.0:
                raise InputError(
                    f"'{key}' of device '{self.device.name}' is {numbers[key]:g}; only what is positive is tuned"
                )

    @property
    def variables(self) -> tuple[DesignVariable, ...]:
        """Pressures in the profile's order, its timing, the device's numbers."""
        most = self.device.parameters.supply.max_pressure / BAR
        found = [
            DesignVariable(f"pressure at {phase:g} % [bar]", min(bar, most), PRESSURE_SCALE_BAR, 0.0, most)
            for phase, bar in zip(self.profile.gait_pct, self.profile.pressure_bar, strict=True)
        ]
        found.append(DesignVariable("timing [%]", 0.0, TIMING_SCALE_PCT, -MAX_TIMING_SHIFT_PCT, MAX_TIMING_SHIFT_PCT))
        numbers = self.device.spec.collect_values()
        for key in self.device_keys:
            spread, least, most = RELATIVE_SCALES_AND_BOUNDS.get(
                key, (DEFAULT_RELATIVE_SCALE, 1.0 / DEFAULT_MAX_RATIO, DEFAULT_MAX_RATIO)
            )
            nominal = numbers[key]
            found.append(DesignVariable(key, nominal, spread, least * nominal, most * nominal, logarithmic=True))
        return tuple(found)

    def decode(self, x: Sequence[float] | DesignVector) -> tuple[Device, PressureProfile]:
        """Device and profile with the knobs at ``places``; raises InputError for a device that cannot be."""
        values = [knob.decode(float(place)) for knob, place in zip(self.variables, x, strict=True)]
        count = len(self.profile.gait_pct)
        pressures, late, numbers = values[:count], values[count], values[count + 1 :]
        moved = sorted(
            (round((phase + late) % 100.0, 6), round(bar, 6))
            for phase, bar in zip(self.profile.gait_pct, pressures, strict=True)
        )
        profile = PressureProfile(f"tuned from {self.profile.name}", *map(tuple, zip(*moved, strict=True)))
        changes = {key: float(f"{value:.6g}") for key, value in zip(self.device_keys, numbers, strict=True)}
        return _rename_tuned_device(apply_changes(self.device, changes, TUNED_SOURCE)), profile

    def compute_violation(self, x: Sequence[float] | DesignVector) -> float:
        """Sum of squares of how far ``places`` are outside of the bounds, in spreads."""
        return math.fsum(
            knob.compute_violation(float(place)) ** 2 for knob, place in zip(self.variables, x, strict=True)
        )
