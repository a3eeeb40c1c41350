"""True rig of a dataset, and what each of its departures contributes to the measured channels."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from benchmarks.hidden_effects.adversary.cases import DEPARTURES, VALVE_NAMES
from benchmarks.hidden_effects.adversary.protocol import InputProgram
from benchmarks.hidden_effects.adversary.rig import Rig, build_rig
from benchmarks.hidden_effects.adversary.sensors import (
    SAMPLE_RATE,
    SensorFault,
    list_signals,
    noise_level,
    read_channel,
)
from benchmarks.hidden_effects.adversary.simulate import STEP, simulate

DECLARED: Mapping[str, float] = {
    "muscle.c10_kpa": 0.10,
    "muscle.friction_slope_n_per_bar": 0.10,
    "tendon.stiffness_1_n_per_mm": 0.10,
    "tendon.stiffness_2_n_per_mm": 0.10,
    "tendon.slack_length_mm": 0.01,
    "damper.orifice_concentric_mm": 0.03,
    "damper.orifice_eccentric_mm": 0.03,
}
"""Key of the device file -> relative standard deviation that the dataset declares, as in the other blocks."""
MIN_PRESENT_SIZE = 0.1
"""Contribution over the noise from which a departure is there to be named: the 10 000 readings of a dataset, if one in
five is independent (assumed), show it with four and a half standard errors."""
REGISTRATION_M = 0.5e-3
"""Standard deviation of the zero of the logged length [m]."""
DIFFERENCE = 0.3
"""Step of a declared number, in its standard deviations, for the linear refit."""


class SetUp(NamedTuple):
    """A rig with its sensors as they are."""

    numbers: dict[str, float]
    """Numbers of the device as they are, by key of the device file."""
    fields: dict[str, float]
    """Departures of the rig."""
    faults: dict[str, SensorFault]

    def without(self, fields: Sequence[str]) -> "SetUp":
        """Return the set-up without the departures ``fields``."""
        return self._replace(fields={key: value for key, value in self.fields.items() if key not in fields})

    def build(self) -> Rig:
        """Return the rig."""
        return build_rig(self.numbers)._replace(**self.fields)


def draw_declared(rng: np.random.Generator, nominal: Mapping[str, float]) -> dict[str, float]:
    """Return the numbers of the device; those that are declared uncertain lie within two standard deviations."""
    numbers = dict(nominal)
    for key, share in DECLARED.items():
        numbers[key] *= 1.0 + share * float(np.clip(rng.normal(), -2.0, 2.0))
    return numbers


def make_set_up(
    numbers: Mapping[str, float],
    departures: Mapping[str, Mapping[str, float]],
    number_errors: Mapping[str, float],
    hidden: Mapping[str, Any] | None,
) -> SetUp:
    """Return the rig as it is, with all of its departures and the hidden effect."""
    set_up = SetUp(dict(numbers), {k: v for fields in departures.values() for k, v in fields.items()}, {})
    for key, error in number_errors.items():
        set_up.numbers[key] *= 1.0 + error
    if hidden is not None:
        entry = hidden["entry"]
        if hidden["kind"] == "instruments":
            set_up.faults[entry["channel"]] = SensorFault(**entry["parameters"])
        elif hidden["kind"] == "numbers":
            set_up.numbers[entry["number"]] *= 1.0 + entry["parameters"][entry["number"]]
        else:
            set_up.fields.update(entry["parameters"])
    return set_up


def remove_hidden(set_up: SetUp, hidden: Mapping[str, Any]) -> SetUp:
    """Return ``set_up`` without the strong effect."""
    entry = hidden["entry"]
    if hidden["kind"] == "instruments":
        return set_up._replace(faults={})
    if hidden["kind"] == "numbers":
        key = entry["number"]
        return set_up._replace(numbers={**set_up.numbers, key: set_up.numbers[key] / (1.0 + entry["parameters"][key])})
    return set_up.without(list(entry["parameters"]))


def observe(set_up: SetUp, programs: Sequence[InputProgram], channels: Sequence[str]) -> dict[str, np.ndarray]:
    """Return all programs' readings without noise over the noise of their channel, one after another."""
    rig, stride = set_up.build(), round(1.0 / (SAMPLE_RATE * STEP))
    shown: dict[str, list[np.ndarray]] = {channel: [] for channel in channels}
    for program in programs:
        signals = list_signals(simulate(program.length, program.command, rig))
        for channel in channels:
            reading = read_channel(channel, signals[channel], set_up.faults.get(channel, SensorFault()))
            shown[channel].append(reading[::stride] / noise_level(channel))
    return {channel: np.concatenate(values) for channel, values in shown.items()}


class Sizes:
    """Sizes of changes of one set-up over the noise, raw and after a linear refit of the declared numbers."""

    def __init__(
        self, set_up: SetUp, nominal: Mapping[str, float], programs: Sequence[InputProgram], channels: Sequence[str]
    ) -> None:
        """Simulate the set-up, and with each declared number changed."""
        self._programs, self._channels = programs, channels
        self.true = observe(set_up, programs, channels)
        columns = []
        for key, share in DECLARED.items():
            step = DIFFERENCE * share * nominal[key]
            moved = observe(
                set_up._replace(numbers={**set_up.numbers, key: set_up.numbers[key] + step}), programs, channels
            )
            columns.append((self._stack(moved) - self._stack(self.true)) / DIFFERENCE)
        self._jacobian = np.column_stack(columns)

    def measure(self, other: SetUp) -> dict[str, float]:
        """Return the rms of the difference to ``other`` over the noise by channel."""
        shown = observe(other, self._programs, self._channels)
        return {channel: _rms(self.true[channel] - shown[channel]) for channel in self._channels}

    def measure_refitted(self, other: SetUp) -> float:
        """Return the rms that is left of it after the refit, in the worst channel.

        Linear least squares with the declared standard deviations as priors; samples count as independent.
        """
        difference = self._stack(self.true) - self._stack(observe(other, self._programs, self._channels))
        n = self._jacobian.shape[1]
        system = np.vstack([self._jacobian, np.eye(n)])
        shift = np.linalg.lstsq(system, np.concatenate([difference, np.zeros(n)]), rcond=None)[0]
        rest = np.split(difference - self._jacobian @ shift, len(self._channels))
        return max(_rms(values) for values in rest)

    def _stack(self, shown: Mapping[str, np.ndarray]) -> np.ndarray:
        return np.concatenate([shown[channel] for channel in self._channels])


def measure_departures(
    set_up: SetUp,
    sizes: Sizes,
    departures: Mapping[str, Mapping[str, float]],
    number_errors: Mapping[str, float],
) -> dict[str, float]:
    """Return the contribution of each departure and each wrong number over the noise, in its worst channel."""
    contributions = {key: set_up.without(list(fields)) for key, fields in departures.items()}
    for key, error in number_errors.items():
        contributions[f"number_error@{key}"] = set_up._replace(
            numbers={**set_up.numbers, key: set_up.numbers[key] / (1.0 + error)}
        )
    return {key: max(sizes.measure(other).values()) for key, other in contributions.items()}


def list_present(contributions: Mapping[str, float], has_valve: bool) -> list[str]:
    """Return the names that describe something that is there, beside the hidden effect."""
    names = {name for name in VALVE_NAMES if has_valve}
    for key, size in contributions.items():
        if size >= MIN_PRESENT_SIZE:
            names |= set(DEPARTURES[key].names) if key in DEPARTURES else {key}
    return sorted(names)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
