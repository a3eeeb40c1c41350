"""Design variables of a state machine: pressures and timing of its states, and optionally numbers of the device."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from klute_sim.controllers.state_machine import StateMachine
from klute_sim.device.device import Device, check_accepts_pressure
from klute_sim.errors import InputError, suggest
from klute_sim.parameters import Parameter
from klute_sim.tuning.design_variables import build_device_variables, change_device, check_device_keys
from klute_sim.types import Array
from klute_sim.units import BAR

PRESSURE_KEYS = ("loading_bar", "rollover_bar", "rollover_end_bar", "push_off_bar", "swing_bar")
"""Pressures of the state machine."""
DEFAULT_MACHINE_KEYS = (*PRESSURE_KEYS, "lean_deg")
"""Numbers of the state machine that are tuned: all pressures, and the inclination at which push-off begins."""
ANGLE_KEYS = ("upright_deg", "lean_deg")
"""Inclinations of the shank at which states begin."""
PRESSURE_SCALE_BAR, ANGLE_SCALE_DEG = 0.2, 1.5
"""Search scale of a pressure [bar] and of an inclination [deg]: walkers that have not adapted bear no large steps."""
MAX_ANGLE_CHANGE_DEG = 12.0
"""Largest change of an inclination [deg]."""


@dataclass(frozen=True)
class MachineSpace:
    """A device, a state machine and the design variables that change them."""

    device: Device
    """Device at the start of the search."""
    machine: StateMachine
    """State machine at the start of the search."""
    machine_keys: tuple[str, ...] = DEFAULT_MACHINE_KEYS
    """Tuned numbers of the state machine."""
    device_keys: tuple[str, ...] = ()
    """Tuned numbers of the device (``section.key``)."""

    def __post_init__(self) -> None:
        """Raise InputError when a key cannot be tuned, or the device takes no pressures."""
        allowed = (*PRESSURE_KEYS, *ANGLE_KEYS)
        for key in self.machine_keys:
            if key not in allowed:
                listing = f"allowed: {', '.join(allowed)}"
                raise InputError(f"'{key}' of the state machine cannot be tuned; {suggest(key, allowed, listing)}")
        check_accepts_pressure(self.device, "the state machine")
        check_device_keys(self.device, self.device_keys)

    @property
    def variables(self) -> tuple[Parameter, ...]:
        """Design variables: numbers of the state machine, then those of the device."""
        supply = self.device.parameters.supply.max_pressure / BAR
        variables = []
        for key in self.machine_keys:
            initial = float(getattr(self.machine, key))
            if key in PRESSURE_KEYS:
                initial = min(initial, supply)
                scale, lower, upper = PRESSURE_SCALE_BAR, 0.0, supply
            else:
                scale, lower, upper = ANGLE_SCALE_DEG, initial - MAX_ANGLE_CHANGE_DEG, initial + MAX_ANGLE_CHANGE_DEG
            variables.append(Parameter(name=key, initial=initial, scale=scale, lower=lower, upper=upper))
        return (*variables, *build_device_variables(self.device, self.device_keys))

    def decode(self, x: Sequence[float] | Array) -> tuple[Device, StateMachine]:
        """Return the device and the state machine at the normalized point ``x``.

        Raises InputError when the numbers make no valid device or state machine.
        """
        values = [
            variable.denormalize(float(coordinate)) for variable, coordinate in zip(self.variables, x, strict=True)
        ]
        n_machine = len(self.machine_keys)
        changes: dict[str, Any] = {
            key: round(value, 6) for key, value in zip(self.machine_keys, values[:n_machine], strict=True)
        }
        return change_device(self.device, self.device_keys, values[n_machine:]), replace(self.machine, **changes)
