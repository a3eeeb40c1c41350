"""Errors of a set-up, of the size that every laboratory has: wrong numbers, slow logs, a hum, trials begun in motion.

None of them is a missing effect. Numbers of the device are to be reported as wrong numbers; the others change nothing
that is missing in the model.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import butter, sosfiltfilt

Table = dict[str, np.ndarray]


class NumberError(NamedTuple):
    """Usual error of a number of the device: an absolute part and one in proportion to the value."""

    absolute: float = 0.0
    relative: float = 0.0


NUMBER_ERRORS = {
    "muscle.bladder_radius_mm": NumberError(absolute=0.1),
    "tendon.engagement_mm": NumberError(absolute=0.5),
    "muscle.braid_length_ratio": NumberError(relative=0.005),
    "supply.rate_bar_per_s": NumberError(relative=0.2),
    "muscle.turns_per_m": NumberError(relative=0.01),
    "muscle.resting_length_mm": NumberError(absolute=1.0),
    "supply.gas_temperature_c": NumberError(absolute=4.0),
    "muscle.bladder_thickness_mm": NumberError(absolute=0.1),
}
"""Number of the device file -> its usual error: calipers, tape, counted threads, a room over a day (assumed)."""
ERROR_MULTIPLES = (1.0, 3.0)
"""Smallest and largest error of a number, in usual errors (assumed)."""
LOGGINGS: tuple[dict[str, Any], ...] = (
    {"decimation": 4},
    {"start_s": 0.7},
    {"noisy_repeat": 3.0},
    {"decimation": 2},
    {"decimation": 8},
)
"""How the log differs (assumed): divisor of the sampling rate of 200 Hz, time that is cut from the start so that a
trial begins in motion, or noise of one repeat over that of the others."""
LATER_LOGGINGS: tuple[dict[str, Any], ...] = (
    {"hum": 1.0},
    {"cutoff_hz": 10.0},
    {"length_step_mm": 0.05},
    {"length_samples": 4},
    {"command_samples": 1},
)
"""How other logs differ (assumed): amplitude of a hum of 50 Hz over the noise of each measured channel; cut-off
frequency of a low-pass filter of second order, forward and backward, of these channels; resolution of the length;
samples for which the log repeats each reading of the length; or samples by which the log of the command is late."""
MAINS_FREQUENCY_HZ, SAMPLING_RATE_HZ = 50.0, 200.0
"""Frequency of a hum, and sampling rate of a log."""
REGISTRATIONS: tuple[dict[str, tuple[str, float]], ...] = (
    {"grf_vertical": ("gain", 0.01), "grf_forward": ("gain", 0.01)},
    {"cop_x": ("offset", 5e-3)},
    {"ankle_x": ("offset", 5e-3)},
    {"ankle_z": ("offset", 5e-3)},
    {"ankle_angle": ("offset", 1.0)},
)
"""Channel of a walk -> kind and size of the error of its registration, in the unit of the channel (assumed)."""


def draw_number_error(index: int, rng: np.random.Generator | None, device: Mapping[str, float]) -> dict[str, Any]:
    """Return the wrong number of dataset ``index``: its key and its change; the typical one without ``rng``."""
    key = list(NUMBER_ERRORS)[index % len(NUMBER_ERRORS)]
    usual = NUMBER_ERRORS[key].absolute + NUMBER_ERRORS[key].relative * abs(device[key])
    multiple = 2.0 if rng is None else float(rng.choice([-1.0, 1.0]) * rng.uniform(*ERROR_MULTIPLES))
    change = round(multiple * usual, 6)
    return {"name": "number_error", "form": "value", "number": key, "parameters": {key: device[key] + change}}


def draw_registration(index: int, rng: np.random.Generator | None) -> list[dict[str, Any]]:
    """Return the errors of the registration of walk ``index`` as errors of channels."""
    errors = REGISTRATIONS[index % len(REGISTRATIONS)]
    multiple = 1.0 if rng is None else float(rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.5))
    return [
        {
            "name": f"sensor_{kind}",
            "form": kind,
            "channel": channel,
            "parameters": {kind: round((1.0 if kind == "gain" else 0.0) + multiple * size, 6)},
        }
        for channel, (kind, size) in errors.items()
    ]


def change_log(
    rng: np.random.Generator, tables: Mapping[str, Table], noise: Mapping[str, float], logging: Mapping[str, Any]
) -> dict[str, Table]:
    """Return ``tables`` (file -> columns) as the ``logging`` stores them; ``noise`` is that of each channel."""
    changed = {file: {name: values.copy() for name, values in table.items()} for file, table in tables.items()}
    if "noisy_repeat" in logging:
        table = next(iter(changed.values()))
        factor = np.sqrt(logging["noisy_repeat"] ** 2 - 1.0)
        for name in table.keys() & noise.keys():
            table[name] = table[name] + factor * noise[name] * rng.normal(size=len(table[name]))
    for table in changed.values():
        _change_table(rng, table, noise, logging)
    for file, table in changed.items():
        start = round(SAMPLING_RATE_HZ * logging.get("start_s", 0.0))
        changed[file] = {name: values[start :: logging.get("decimation", 1)] for name, values in table.items()}
    return changed


def _change_table(
    rng: np.random.Generator, table: Table, noise: Mapping[str, float], logging: Mapping[str, Any]
) -> None:
    """Change ``table`` as one of :data:`LATER_LOGGINGS` stores it, in place."""
    measured = sorted(table.keys() & noise.keys())
    if "hum" in logging:
        wave = np.sin(2.0 * np.pi * (MAINS_FREQUENCY_HZ * table["time"] + rng.uniform()))
        for name in measured:
            table[name] = table[name] + logging["hum"] * noise[name] * wave
    if "cutoff_hz" in logging:
        sections = butter(2, logging["cutoff_hz"], fs=SAMPLING_RATE_HZ, output="sos")
        for name in measured:
            table[name] = sosfiltfilt(sections, table[name])
    if "length_step_mm" in logging:
        table["length"] = logging["length_step_mm"] * np.round(table["length"] / logging["length_step_mm"])
    if "length_samples" in logging:
        n_held = logging["length_samples"]
        table["length"] = table["length"][::n_held].repeat(n_held)[: len(table["length"])]
    if "command_samples" in logging:
        n_late, command = logging["command_samples"], table["pressure_command"]
        table["pressure_command"] = np.r_[np.full(n_late, command[0]), command[:-n_late]]


def list_numbers(errors: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Return ``section.key`` -> true value of each wrong number."""
    return {key: value for error in errors for key, value in error["parameters"].items()}
