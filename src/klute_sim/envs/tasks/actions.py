"""From actions to what the device is told: pressures, openings, or a change of a base profile; late by a dead time."""

from collections.abc import Mapping
from itertools import pairwise
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from klute_sim.controllers.pressure import PressureProfile
from klute_sim.device.dynamics import DeviceParameters, get_dead_time
from klute_sim.errors import InputError
from klute_sim.units import BAR

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ACTION_KINDS: Mapping[str, str] = MappingProxyType(
    {
        "pressure": "gauge pressure, from none (-1) to all that the supply has (1)",
        "valve": "opening of the valve, from exhaust (-1) to fill (1)",
        "residual": "change of a base profile's pressure, from -residual_bar (-1) to residual_bar (1)",
    }
)
"""Kinds of actions."""


def select_action_kind(requested: str | None, command_is_opening: bool, device_name: str) -> str:
    """The kind of action for a device that ``opens`` its valve, or takes pressures; None: the one that fits.

    Raises InputError for one that does not fit.
    """
    if requested is None:
        return "valve" if command_is_opening else "pressure"
    if requested not in ACTION_KINDS:
        raise InputError(f"action is '{requested}'; allowed: {', '.join(ACTION_KINDS)}")
    if command_is_opening and requested != "valve":
        raise InputError(f"action is '{requested}', and '{device_name}' takes openings of its valve; allowed: valve")
    if requested == "valve" and not command_is_opening:
        raise InputError(f"action is 'valve', and '{device_name}' takes pressures; allowed: pressure, residual")
    return requested


class ActionDecoder:
    """Of ``count`` devices."""

    def __init__(
        self,
        kind: str,
        parameters: DeviceParameters,
        profile: PressureProfile,
        residual_bar: float,
        n_devices: int,
        steps_per_action: int,
        dt: float,
    ) -> None:
        """Given every ``each`` steps of ``step`` [s]; ``parameters`` are the usual device's."""
        self.kind = kind
        self._profile, self._residual_bar, self._steps_per_action, self._dt = (
            profile,
            residual_bar,
            steps_per_action,
            dt,
        )
        self._max_pressure_bar = parameters.supply.max_pressure / BAR
        self._delay_steps = np.zeros(n_devices, dtype=np.int64)
        self._command_history = np.zeros((n_devices, 2))
        for place in range(n_devices):
            self.set_parameters(place, parameters)

    def set_parameters(self, index: int, parameters: DeviceParameters) -> None:
        """Device ``place`` hears its commands as late as these ``parameters`` have it."""
        self._delay_steps[index] = round(get_dead_time(parameters) / self._dt)
        missing = 2 + int(self._delay_steps[index]) // self._steps_per_action - self._command_history.shape[1]
        if missing > 0:
            self._command_history = np.pad(self._command_history, ((0, 0), (missing, 0)), "edge")

    def decode(self, action: Array, phase: Array) -> Array:
        """(n,) gauge pressure [bar], or opening [1], that ``action`` in [-1, 1] asks for at the estimated ``phase``."""
        if self.kind == "valve":
            return action
        if self.kind == "pressure":
            return np.asarray(0.5 * (action + 1.0) * self._max_pressure_bar)
        base = self._profile.pressures_at(phase) / BAR
        return np.asarray(np.clip(base + self._residual_bar * action, 0.0, self._max_pressure_bar))

    def reset(self, mask: Mask, pressure: Array) -> Array:
        """Forget what was told before; the action (n,) that changes nothing at this gauge ``pressure`` (n,) [bar]."""
        self._command_history[mask] = 0.0 if self.kind == "valve" else pressure[mask, None]
        if self.kind == "pressure":
            return np.asarray(2.0 * pressure / self._max_pressure_bar - 1.0)
        return np.zeros(len(pressure))

    def schedule_commands(self, command: Array, mask: Mask) -> list[tuple[int, Array]]:
        """What reaches the devices in the next interval, if ``which`` are now told ``command``: steps, (n,) commands.

        One piece, or more where a dead time of one of them ends within the interval.
        """
        if not self._delay_steps.any():
            return [(self._steps_per_action, command)]
        self._command_history[mask] = np.column_stack([self._command_history[mask, 1:], command[mask]])
        whole, part = np.divmod(self._delay_steps, self._steps_per_action)
        places = np.arange(len(part))
        newer, older = self._command_history[places, -1 - whole], self._command_history[places, -2 - whole]
        edges = np.unique([0, *part[mask], self._steps_per_action]).tolist()
        return [(end - begin, np.where(begin < part, older, newer)) for begin, end in pairwise(edges)]
