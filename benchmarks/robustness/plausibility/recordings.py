"""Simulated bench recordings on many devices, as tables that variants change before they are written as a dataset."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from klute_sim.bench.protocols.library import load_identification_protocols
from klute_sim.datasets import dataset as datasets
from klute_sim.datasets.unit_conversion import get_si_factor
from klute_sim.datasets.write import write_trial
from klute_sim.device.device import Device, load_device
from klute_sim.device.equilibrium import compute_equilibrium_state
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.plausibility.finding import ImplausibleInputError
from klute_sim.types import Array

SI_UNITS = {
    **{"time": "s", "length": "m", "pressure_command": "Pa", "force": "N", "pressure": "Pa", "muscle_length": "m"},
}
"""Channel -> SI unit."""
NOISE = {"force": 2.0, "pressure": 800.0, "muscle_length": 2e-5}
"""Standard deviation of the noise of each sensor, in SI units."""


class Column(NamedTuple):
    """A column of a trial file."""

    unit: str
    """Unit in the heading."""
    value: Array
    """Samples in that unit."""


Table = dict[str, Column]
"""Channel -> column of one trial."""


@dataclass(frozen=True)
class Base:
    """How a dataset is recorded."""

    device: str = "klute-3-4-pair"
    """Preset that the dataset names."""
    protocols: tuple[str, ...] = ("steps", "mixed")
    """Identification protocols; or names of :data:`PROGRAMS`."""
    interval: float = 0.005
    """Sampling interval [s]."""
    units: tuple[tuple[str, str], ...] = (
        *(("length", "mm"), ("pressure_command", "bar"), ("force", "N"), ("pressure", "bar"), ("muscle_length", "mm")),
    )
    """Units of the channels that are recorded."""
    changes: tuple[tuple[str, float], ...] = ()
    """Numbers of the real device that differ from the preset."""
    effects: tuple[tuple[str, tuple[tuple[str, float], ...]], ...] = ()
    """Effects of the real device."""
    noise: float = 1.0
    """Factor of the noise."""


@dataclass(frozen=True)
class Variant:
    """A dataset with a change."""

    name: str
    """Description of the change."""
    expected: str
    """Name of the finding that must be reported; '' for a right dataset."""
    change: Callable[[Table], Table] = field(default=lambda table: table)
    """Changes one trial."""
    base: Base = field(default_factory=Base)
    """Dataset before the change."""
    first_trial_only: bool = False
    """Whether only the first trial is changed."""


def make_slow_program(device: Device) -> tuple[Array, Array, Array]:
    """Return time, length and command of a quasi-static test of 20 min with one sample per second."""
    time = np.arange(0.0, 1200.0, 1.0)
    low, high = _get_length_limits(device)
    length = high - (high - low) * 0.5 * (1.0 - np.cos(2.0 * np.pi * time / 400.0))
    levels = 0.2 + 0.6 * np.floor(time / 400.0) / 2.0
    return time, length, levels * device.parameters.supply.max_pressure


def make_creep_program(device: Device) -> tuple[Array, Array, Array]:
    """Return a hold of 50 min at constant length and pressure after one step, sampled once per second."""
    time = np.arange(0.0, 3000.0, 1.0)
    length = np.full(len(time), _get_length_limits(device)[1])
    return time, length, np.where(time < 20.0, 0.1, 0.7) * device.parameters.supply.max_pressure


def make_isometric_program(device: Device) -> tuple[Array, Array, Array]:
    """Return slow pressure ramps from zero to the supply pressure at constant length."""
    time = np.arange(0.0, 8.0, 0.002)
    length = np.full(len(time), _get_length_limits(device)[1])
    return time, length, (0.5 - 0.5 * np.cos(2.0 * np.pi * time / 4.0)) * 0.9 * device.parameters.supply.max_pressure


def make_isobaric_program(device: Device) -> tuple[Array, Array, Array]:
    """Return length ramps at constant pressure."""
    time = np.arange(0.0, 6.0, 0.002)
    low, high = _get_length_limits(device)
    length = high - (high - low) * np.abs((time / 1.5) % 2.0 - 1.0)
    return time, length, np.full(len(time), 0.6 * device.parameters.supply.max_pressure)


def make_low_pressure_program(device: Device) -> tuple[Array, Array, Array]:
    """Return pressure steps up to a tenth of the supply pressure."""
    time = np.arange(0.0, 4.0, 0.002)
    length = np.full(len(time), _get_length_limits(device)[1])
    return time, length, 0.1 * np.floor(time % 2.0 * 2.0) / 3.0 * device.parameters.supply.max_pressure


def make_rest_program(device: Device) -> tuple[Array, Array, Array]:
    """Return steps from and to rest at zero pressure, with pauses."""
    time = np.arange(0.0, 6.0, 0.002)
    length = _get_length_limits(device)[1] - 0.01 * (0.5 - 0.5 * np.cos(2.0 * np.pi * time / 3.0))
    levels = np.array([0.0, 0.5, 0.0, 0.8, 0.3, 0.0])
    return time, length, levels[(time % 6.0).astype(int)] * device.parameters.supply.max_pressure


def make_burst_program(device: Device) -> tuple[Array, Array, Array]:
    """Return one fast pressure step of 0.6 s, sampled at 5 kHz."""
    time = np.arange(0.0, 0.6, 2e-4)
    length = np.full(len(time), _get_length_limits(device)[1])
    return time, length, np.where((time > 0.1) & (time < 0.4), 0.8, 0.2) * device.parameters.supply.max_pressure


PROGRAMS: Mapping[str, Callable[[Device], tuple[Array, Array, Array]]] = {
    "slow": make_slow_program,
    "creep": make_creep_program,
    "isometric": make_isometric_program,
    "isobaric": make_isobaric_program,
    "low-pressure": make_low_pressure_program,
    "rest": make_rest_program,
    "burst": make_burst_program,
}
"""Programs that are not identification protocols."""


def _get_length_limits(device: Device) -> tuple[float, float]:
    parameters = device.parameters
    high = parameters.tendon.slack_length + 0.995 * parameters.muscle.resting_length
    return high - 0.12 * parameters.muscle.resting_length, high


@cache
def simulate_base(base: Base) -> dict[str, Table]:
    """Return trial -> table of the recordings of ``base``."""
    nominal = load_device(base.device)
    device = nominal.with_changes(dict(base.changes))
    for effect, parameters in base.effects:
        device = device.with_effect(effect, **dict(parameters))
    tables = {}
    for index, name in enumerate(base.protocols):
        if name in PROGRAMS:
            time, length, command = PROGRAMS[name](nominal)
        else:
            program = load_identification_protocols()[name].build_program(nominal)
            time = np.arange(0.0, float(program.time[-1]), base.interval)
            length = np.interp(time, program.time, program.unit_length)
            command = np.interp(time, program.time, program.command)
        tables[name] = _record(device, base, (time, length, command), np.random.default_rng([index, 7]))
    return tables


def _record(
    device: Device, base: Base, program: tuple[Array, Array, Array], rng: np.random.Generator
) -> dict[str, Column]:
    time, length, command = program
    dt = min(5e-4 if time[-1] < 100.0 else 0.01, float(time[1] - time[0]))
    grid = dt * np.arange(1, int(time[-1] / dt) + 1)
    parameters = device.parameters
    state = compute_equilibrium_state(parameters, float(length[0]), float(command[0]))
    inputs = np.interp(grid, time, length), np.interp(grid, time, command)
    trace = simulate_rollouts(parameters, *inputs, dt, initial_state=state, n_jobs=1)
    values = {"time": time, "length": length, "pressure_command": command}
    outputs = {"force": trace.tension, "pressure": trace.pressure, "muscle_length": trace.length}
    for name, output in outputs.items():
        noise = rng.normal(0.0, base.noise * NOISE[name], len(time))
        values[name] = np.interp(time, grid, output) + noise
    units = {"time": "s", **dict(base.units)}
    return {
        name: Column(unit, values[name] / (get_si_factor(unit, SI_UNITS[name]) or 1.0)) for name, unit in units.items()
    }


def write_variant(variant: Variant, folder: Path) -> None:
    """Write the dataset of ``variant`` into the new ``folder``."""
    folder.mkdir(parents=True)
    lines = ['format = "klute-sim-dataset/2"', 'rig = "bench"', f'device = "{variant.base.device}"']
    for index, (name, table) in enumerate(simulate_base(variant.base).items()):
        is_changed = index == 0 or not variant.first_trial_only
        columns = variant.change(dict(table)) if is_changed else table
        write_trial(
            folder / f"{name}.csv", {f"{channel} [{column.unit}]": column.value for channel, column in columns.items()}
        )
        lines += ["[[trial]]", f'files = ["{name}.csv"]']
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")


def find_names(variant: Variant, folder: Path) -> tuple[tuple[str, ...], str]:
    """Return the names of what is found in ``variant``, and the message; both are empty where it is accepted."""
    write_variant(variant, folder)
    try:
        datasets.load_dataset(folder)
    except ImplausibleInputError as error:
        return tuple(dict.fromkeys(finding.name for finding in error.findings)), str(error)
    return (), ""
