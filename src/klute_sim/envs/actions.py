"""From actions to what the device is told: pressures, openings, or a change of a base profile; late by a dead time."""

from collections.abc import Mapping
from itertools import pairwise
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from klute_sim.control.pressure import Profile
from klute_sim.device.step import Parameters, dead_time
from klute_sim.errors import InputError
from klute_sim.units import BAR

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ACTIONS: Mapping[str, str] = MappingProxyType(
    {
        "pressure": "gauge pressure, from none (-1) to all that the supply has (1)",
        "valve": "opening of the valve, from exhaust (-1) to fill (1)",
        "residual": "change of a base profile's pressure, from -residual_bar (-1) to residual_bar (1)",
    }
)
"""Kinds of actions."""


def kind_for(asked: str | None, opens: bool, device: str) -> str:
    """The kind of action for a device that ``opens`` its valve, or takes pressures; None: the one that fits.

    Raises InputError for one that does not fit.
    """
    if asked is None:
        return "valve" if opens else "pressure"
    if asked not in ACTIONS:
        raise InputError(f"action is '{asked}'; allowed: {', '.join(ACTIONS)}")
    if opens and asked != "valve":
        raise InputError(f"action is '{asked}', and '{device}' takes openings of its valve; allowed: valve")
    if asked == "valve" and not opens:
        raise InputError(f"action is 'valve', and '{device}' takes pressures; allowed: pressure, residual")
    return asked


class Actions:
    """Of ``count`` devices."""

    def __init__(
        self,
        kind: str,
        parameters: Parameters,
        profile: Profile,
        residual_bar: float,
        count: int,
        each: int,
        step: float,
    ) -> None:
        """Given every ``each`` steps of ``step`` [s]; ``parameters`` are the usual device's."""
        self.kind = kind
        self._profile, self._residual, self._each, self._step = profile, residual_bar, each, step
        self._most = parameters.supply.pressure / BAR
        self._late = np.zeros(count, dtype=np.int64)
        self._told = np.zeros((count, 2))
        for place in range(count):
            self.give(place, parameters)

    def give(self, place: int, parameters: Parameters) -> None:
        """Device ``place`` hears its commands as late as these ``parameters`` have it."""
        self._late[place] = round(dead_time(parameters) / self._step)
        missing = 2 + int(self._late[place]) // self._each - self._told.shape[1]
        if missing > 0:
            self._told = np.pad(self._told, ((0, 0), (missing, 0)), "edge")

    def asked(self, action: Array, phase: Array) -> Array:
        """(n,) gauge pressure [bar], or opening [1], that ``action`` in [-1, 1] asks for at the estimated ``phase``."""
        if self.kind == "valve":
            return action
        if self.kind == "pressure":
            return np.asarray(0.5 * (action + 1.0) * self._most)
        base = self._profile.pressures(phase) / BAR
        return np.asarray(np.clip(base + self._residual * action, 0.0, self._most))

    def begin(self, which: Mask, pressure: Array) -> Array:
        """Forget what was told before; the action (n,) that changes nothing at this gauge ``pressure`` (n,) [bar]."""
        self._told[which] = 0.0 if self.kind == "valve" else pressure[which, None]
        if self.kind == "pressure":
            return np.asarray(2.0 * pressure / self._most - 1.0)
        return np.zeros(len(pressure))

    def due(self, command: Array, which: Mask) -> list[tuple[int, Array]]:
        """What reaches the devices in the next interval, if ``which`` are now told ``command``: steps, (n,) commands.

        One piece, or more where a dead time of one of them ends within the interval.
        """
        if not self._late.any():
            return [(self._each, command)]
        self._told[which] = np.column_stack([self._told[which, 1:], command[which]])
        whole, part = np.divmod(self._late, self._each)
        places = np.arange(len(part))
        newer, older = self._told[places, -1 - whole], self._told[places, -2 - whole]
        edges = np.unique([0, *part[which], self._each]).tolist()
        return [(end - begin, np.where(begin < part, older, newer)) for begin, end in pairwise(edges)]
