"""One row of the table: the size that a parameter states, and how to measure it.

A measurement simulates the whole device with the effect and reads the recorded tension. It uses no law of the effect
and its own quadrature.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from klute_sim.device.device import load_device
from klute_sim.device.dynamics import DeviceParameters, DeviceState
from klute_sim.device.rollout import RolloutTrace, simulate_rollouts
from klute_sim.effects import catalogue
from klute_sim.types import Array

PRESET = "klute-3-4-pair"
"""Device of all measurements."""
MAX_PRESSURE = 8e5
"""Supply pressure of a clamped muscle [Pa]: above all measurements (the preset has 5 bar)."""


@dataclass(frozen=True, kw_only=True)
class EffectSize:
    """A quantity that follows from the parameters of an effect, and its measurement."""

    effect: str
    """Name of the effect."""
    form: str
    """Name of its form."""
    parameters: Mapping[str, float]
    """Parameters by key, in the units of the keys."""
    quantity: str
    """What is stated and measured, with its unit."""
    stated: float
    """Value that the equation of the form states."""
    measure: Callable[[], float]
    """Simulate the device and return the value that it shows."""
    tolerance: float = 0.02
    """Largest allowed deviation, relative to the stated value."""

    @property
    def name(self) -> str:
        """Effect, form, values and quantity in one line."""
        values = ", ".join(f"{value:g}" for value in self.parameters.values())
        return f"{self.effect}/{self.form} ({values}): {self.quantity}"


def make_device(
    effect: str, form: str, parameters: Mapping[str, float], base: DeviceParameters | None = None
) -> DeviceParameters:
    """Return the preset, or ``base``, with one effect."""
    base = load_device(PRESET).parameters if base is None else base
    return base._replace(effects=catalogue.pack_effects({(effect, form): parameters}))


def make_clamped_muscle(*, damper: bool = False) -> DeviceParameters:
    """Return the preset's muscle on a rigid tie, which prescribes its length, with or without its damper."""
    preset = load_device(PRESET).parameters
    tie = preset.tendon._replace(slack_length=0.0, is_rigid=True)
    oil = preset.damper if damper else preset.damper._replace(concentric_coefficient=0.0, eccentric_coefficient=0.0)
    supply = preset.supply._replace(max_pressure=MAX_PRESSURE)
    return preset._replace(tendon=tie, damper=oil, supply=supply)


def simulate(
    device: DeviceParameters,
    unit_length: Array,
    pressure: Array | float,
    dt: float,
    initial_state: DeviceState | None = None,
) -> RolloutTrace:
    """Return the response of ``device`` to lengths [m] and commanded gauge pressure [Pa]."""
    command = np.broadcast_to(np.asarray(pressure, dtype=float), unit_length.shape)
    return simulate_rollouts(device, unit_length, command, dt, initial_state=initial_state, backend="python")


def triangle(low: float, high: float, speed: float, dt: float, n_cycles: int = 2) -> Array:
    """Return positions [m] that move from ``low`` to ``high`` and back at constant ``speed`` [m/s]."""
    n = round((high - low) / (speed * dt))
    cycle = np.concatenate([np.linspace(low, high, n + 1)[1:], np.linspace(high, low, n + 1)[1:]])
    return np.concatenate([[low], *[cycle] * n_cycles])


def compute_work(position: Array, tension: Array) -> float:
    """Return the work [J] that ``tension`` [N] takes along ``position`` [m] (trapezoidal rule)."""
    return float(np.sum(0.5 * (tension[1:] + tension[:-1]) * np.diff(position)))


def select_last_cycle(values: Array, n_cycles: int = 2) -> Array:
    """Return the last of ``n_cycles`` equal cycles with its first and last point."""
    n = (len(values) - 1) // n_cycles
    return values[-n - 1 :]
