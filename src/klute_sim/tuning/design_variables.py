"""Design variables of a tuning problem: pressures and timing of a profile, and optionally numbers of the device."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from klute_sim.controllers.pressure import PressureProfile
from klute_sim.device.device import Device, parse_device
from klute_sim.errors import InputError
from klute_sim.files.toml import format_toml, parse_toml
from klute_sim.parameters import Parameter
from klute_sim.types import Array
from klute_sim.units import BAR

TUNED_SOURCE = "assumed: found by klute-sim tune, never built"
"""Source that a device file states for a tuned number."""
PRESSURE_SCALE_BAR, TIMING_SCALE_PCT = 0.4, 2.0
"""Search scale of a pressure [bar] and of the timing of the profile [% of the gait cycle]."""
MAX_TIMING_SHIFT_PCT = 10.0
"""Maximum shift of the profile in either direction [% of the gait cycle]."""
DEFAULT_RELATIVE_SCALE, DEFAULT_MAX_RATIO = 0.2, 6.0
"""Search scale of a device number relative to its nominal value, and the maximum ratio between the two."""
RELATIVE_SCALES_AND_BOUNDS = {
    "muscle.resting_length_mm": (0.03, 0.8, 1.2),
    "mounting.neutral_muscle_ratio": (0.01, 0.92, 1.02),
    "supply.pressure_bar": (0.05, 0.5, 1.0),
}
"""Scale, lower and upper bound relative to the nominal value, where they are narrower than the default.

The supply pressure has no room above its nominal value: a stronger supply is another device.
"""
DEFAULT_DEVICE_KEYS = (
    "damper.orifice_concentric_mm",
    "damper.orifice_eccentric_mm",
    "tendon.stiffness_1_n_per_mm",
    "tendon.stiffness_2_n_per_mm",
    "tendon.engagement_mm",
    "muscle.resting_length_mm",
    "mounting.neutral_muscle_ratio",
)
"""Device numbers that ``--with-device`` tunes together with the profile."""


@dataclass(frozen=True)
class DesignSpace:
    """A device, a pressure profile and the design variables that change them."""

    device: Device
    """Device at the start of the search."""
    profile: PressureProfile
    """Pressure profile at the start of the search."""
    device_keys: tuple[str, ...] = ()
    """Tuned numbers of the device (``section.key``)."""

    def __post_init__(self) -> None:
        """Raise InputError when a key cannot be tuned or the profile exceeds the supply pressure."""
        supply = self.device.parameters.supply.max_pressure / BAR
        if max(self.profile.pressure_bar) > supply:
            raise InputError(
                f"pressure profile {self.profile.name} commands {max(self.profile.pressure_bar):g} bar; the supply of "
                f"'{self.device.name}' has {supply:g} bar"
            )
        check_device_keys(self.device, self.device_keys)

    @property
    def variables(self) -> tuple[Parameter, ...]:
        """Design variables: the pressures in the order of the profile, its timing, the numbers of the device."""
        supply = self.device.parameters.supply.max_pressure / BAR
        variables = [
            Parameter(
                name=f"pressure at {phase:g} % [bar]",
                initial=min(pressure, supply),
                scale=PRESSURE_SCALE_BAR,
                lower=0.0,
                upper=supply,
            )
            for phase, pressure in zip(self.profile.gait_pct, self.profile.pressure_bar, strict=True)
        ]
        variables.append(
            Parameter(
                name="timing [%]",
                initial=0.0,
                scale=TIMING_SCALE_PCT,
                lower=-MAX_TIMING_SHIFT_PCT,
                upper=MAX_TIMING_SHIFT_PCT,
            )
        )
        variables += build_device_variables(self.device, self.device_keys)
        return tuple(variables)

    def decode(self, x: Sequence[float] | Array) -> tuple[Device, PressureProfile]:
        """Return the device and the profile at the normalized point ``x``, one coordinate per design variable.

        Raises InputError when the numbers do not make a valid device.
        """
        values = [
            variable.denormalize(float(coordinate)) for variable, coordinate in zip(self.variables, x, strict=True)
        ]
        n_pressures = len(self.profile.gait_pct)
        pressures, shift, numbers = values[:n_pressures], values[n_pressures], values[n_pressures + 1 :]
        knots = sorted(
            (round((phase + shift) % 100.0, 6), round(pressure, 6))
            for phase, pressure in zip(self.profile.gait_pct, pressures, strict=True)
        )
        profile = PressureProfile(f"tuned from {self.profile.name}", *map(tuple, zip(*knots, strict=True)))
        return change_device(self.device, self.device_keys, numbers), profile


def compute_violation(variables: Sequence[Parameter], x: Sequence[float] | Array) -> float:
    """Return the sum of the squared distances of ``x`` from the bounds of ``variables``, in normalized units."""
    return math.fsum(
        variable.compute_violation(float(coordinate)) ** 2 for variable, coordinate in zip(variables, x, strict=True)
    )


def check_device_keys(device: Device, keys: Sequence[str]) -> None:
    """Raise InputError unless all ``keys`` (``section.key``) of ``device`` can be tuned."""
    values = device.spec.collect_values()
    for key in keys:
        if key not in values:
            raise InputError(f"device '{device.name}' has no number '{key}'; klute-sim device {device.name} lists them")
        if key == "muscle.count":
            raise InputError(f"'{key}' is an integer; only continuous numbers can be tuned")
        if not values[key] > 0.0:
            raise InputError(
                f"'{key}' of device '{device.name}' is {values[key]:g}; only positive numbers can be tuned"
            )


def build_device_variables(device: Device, keys: Sequence[str]) -> list[Parameter]:
    """Return the design variables of the numbers ``keys`` of ``device``."""
    values, default = device.spec.collect_values(), (DEFAULT_RELATIVE_SCALE, 1.0 / DEFAULT_MAX_RATIO, DEFAULT_MAX_RATIO)
    variables = []
    for key in keys:
        scale, lower, upper = RELATIVE_SCALES_AND_BOUNDS.get(key, default)
        nominal = values[key]
        variables.append(
            Parameter(
                name=key,
                initial=nominal,
                scale=scale,
                lower=lower * nominal,
                upper=upper * nominal,
                is_logarithmic=True,
            )
        )
    return variables


def change_device(device: Device, keys: Sequence[str], numbers: Sequence[float]) -> Device:
    """Return ``device`` with ``numbers`` at ``keys``, and ``-tuned`` after its name if any of its numbers is tuned.

    Raises InputError when the numbers do not make a valid device.
    """
    changes = {key: float(f"{value:.6g}") for key, value in zip(keys, numbers, strict=True)}
    changed = device.with_changes(changes, TUNED_SOURCE)
    content = parse_toml(changed.content, f"device {changed.name}")
    if TUNED_SOURCE not in content.get("sources", {}).values():
        return changed
    base_name = content["name"].removesuffix("-tuned")  # a device that is tuned again keeps its name
    content |= {"name": f"{base_name}-tuned", "description": f"{base_name} with numbers found by klute-sim tune."}
    return parse_device(format_toml(content).encode(), content["name"])
