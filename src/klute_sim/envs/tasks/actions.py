"""Conversion of actions to device commands: pressures, valve openings, or changes of a base profile; with dead time."""

from collections.abc import Mapping
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from klute_sim.controllers.pressure import PressureProfile
from klute_sim.device.dynamics import DeviceParameters, get_dead_time
from klute_sim.errors import InputError
from klute_sim.types import Array, Mask
from klute_sim.units import BAR

ACTION_KINDS: Mapping[str, str] = MappingProxyType(
    {
        "pressure": "gauge pressure, from 0 (-1) to the supply pressure (1)",
        "valve": "opening of the valve, from exhaust (-1) to fill (1)",
        "residual": "change of the pressure of a base profile, from -residual_bar (-1) to residual_bar (1)",
    }
)
"""Kinds of actions with their meaning."""


def select_action_kind(requested: str | None, command_is_opening: bool, device_name: str) -> str:
    """Return the kind of action; None requests the default of the device.

    ``command_is_opening`` states whether the device takes valve openings instead of pressures. Raises InputError when
    the device cannot take the requested kind.
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
    """Decoder of the actions of ``n_devices`` devices."""

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
        """Set up the decoder for one action every ``steps_per_action`` steps of ``dt`` [s].

        ``parameters`` are those of the nominal device.
        """
        self.kind = kind
        self._profile, self._residual_bar = profile, residual_bar
        self._steps_per_action, self._dt = steps_per_action, dt
        self._max_pressure_bar = parameters.supply.max_pressure / BAR
        self._delay_steps = np.zeros(n_devices, dtype=np.int64)
        self._command_history = np.zeros((n_devices, 2))
        for index in range(n_devices):
            self.set_parameters(index, parameters)

    def set_parameters(self, index: int, parameters: DeviceParameters) -> None:
        """Set the dead time of device ``index`` to that of ``parameters``, rounded to whole time steps.

        Commands are held between actions; :class:`klute_sim.device.delay.DelayLine` interpolates them instead.
        """
        self._delay_steps[index] = round(get_dead_time(parameters) / self._dt)
        n_missing = 2 + int(self._delay_steps[index]) // self._steps_per_action - self._command_history.shape[1]
        if n_missing > 0:
            self._command_history = np.pad(self._command_history, ((0, 0), (n_missing, 0)), "edge")

    def decode(self, action: Array, phase: Array) -> Array:
        """Return the gauge pressure [bar] or opening [1], shape (n,), of ``action`` in [-1, 1] at the estimated
        ``phase``.
        """
        if self.kind == "valve":
            return action
        if self.kind == "pressure":
            return np.asarray(0.5 * (action + 1.0) * self._max_pressure_bar)
        base = self._profile.pressures_at(phase) / BAR
        return np.asarray(np.clip(base + self._residual_bar * action, 0.0, self._max_pressure_bar))

    def reset(self, mask: Mask, pressure: Array) -> Array:
        """Clear the command history and return the action (n,) that holds the gauge ``pressure`` (n,) [bar]."""
        self._command_history[mask] = 0.0 if self.kind == "valve" else pressure[mask, None]
        if self.kind == "pressure":
            return np.asarray(2.0 * pressure / self._max_pressure_bar - 1.0)
        return np.zeros(len(pressure))

    def schedule_commands(self, command: Array, mask: Mask) -> list[tuple[int, Array]]:
        """Return the commands (n,) that reach the devices in the next interval, each with its number of steps.

        The devices in ``mask`` receive ``command`` now. The interval is divided where the dead time of a device ends in
        it.
        """
        if not self._delay_steps.any():
            return [(self._steps_per_action, command)]
        self._command_history[mask] = np.column_stack([self._command_history[mask, 1:], command[mask]])
        delay_intervals, delay_remainder = np.divmod(self._delay_steps, self._steps_per_action)
        indices = np.arange(len(delay_remainder))
        newer = self._command_history[indices, -1 - delay_intervals]
        older = self._command_history[indices, -2 - delay_intervals]
        edges = np.unique([0, *delay_remainder[mask], self._steps_per_action]).tolist()
        return [(end - start, np.where(start < delay_remainder, older, newer)) for start, end in pairwise(edges)]
