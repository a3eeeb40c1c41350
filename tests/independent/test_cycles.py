"""Cycles of four seconds of three devices, checked with formulas and quadratures of this file alone.

The program supplies traces of pressure, length and tension. Forces and energies are computed here from the numbers of
the device files and the equations of the dissertation: gas by virtual work on the helix of a thread, rubber by (3.3),
friction by Table 3.1, damper by Bernoulli's equation (4.6), tendon by its two springs.
"""

import tomllib
from collections.abc import Callable
from functools import cache
from importlib import resources
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from klute_sim.device.device import load_device
from klute_sim.device.recorded_rollout import record_rollout

Series = NDArray[np.float64]
PRESETS = ("klute-3-4-pair", "klute-1-1-4-pair", "klute-1-1-4-pair-valve")
STEPS = (1e-3, 5e-4, 2.5e-4, 1.25e-4)
DURATION = 4.0


class Cycle(NamedTuple):
    """Traces of one simulation in SI units, and the numbers of the device file."""

    numbers: dict[str, Any]
    time: Series
    unit_length: Series
    length: Series
    pressure: Series
    tension: Series
    residual_power: Series


@cache
def read_numbers(preset: str) -> dict[str, Any]:
    return tomllib.loads((resources.files("klute_sim") / f"device/presets/{preset}.toml").read_text("utf-8"))


@cache
def simulate(preset: str, step: float) -> Cycle:
    """Return a cycle of 1 s that is repeated for four seconds, with a pressure that leads the length."""
    numbers = read_numbers(preset)
    rest, slack = 1e-3 * numbers["muscle"]["resting_length_mm"], 1e-3 * numbers["tendon"]["slack_length_mm"]
    time = np.arange(round(DURATION / step) + 1) * step
    unit_length = slack + rest * (0.92 + 0.05 * np.sin(2 * np.pi * time))
    record = record_rollout(
        load_device(preset).parameters, unit_length, 2.5e5 + 1.5e5 * np.sin(2 * np.pi * time + 0.7), step
    )
    residual = record.energy_balance.residual_power
    return Cycle(numbers, time, unit_length, record.length, record.pressure, record.tension, residual)


def volume_in_braids(numbers: dict[str, Any], length: Series) -> Series:
    """A thread of length B on a cylinder of radius r: ``B^2 = L^2 + (2 pi N r)^2``."""
    muscle = numbers["muscle"]
    rest = 1e-3 * muscle["resting_length_mm"]
    thread, turns = muscle["braid_length_ratio"] * rest, muscle["turns_per_m"] * rest
    radius_squared = (thread**2 - length**2) / (2 * np.pi * turns) ** 2
    return np.asarray(muscle["count"] * np.pi * radius_squared * length)


def energy_of_rubber(numbers: dict[str, Any], length: Series) -> Series:
    """Mooney-Rivlin energy of tubes whose wall keeps its distance from the braid (3.3)."""
    muscle = numbers["muscle"]
    rest, outer = 1e-3 * muscle["resting_length_mm"], 1e-3 * muscle["bladder_radius_mm"]
    inner, turns = outer - 1e-3 * muscle["bladder_thickness_mm"], muscle["turns_per_m"] * rest
    axial = length / rest
    hoop_squared = 1 + (rest**2 - length**2) / (2 * np.pi * turns * outer) ** 2
    principal = [axial**2, hoop_squared, 1 / (axial**2 * hoop_squared)]
    first = sum(principal) - 3
    second = sum(1 / stretch for stretch in principal) - 3
    rubber = muscle["count"] * np.pi * (outer**2 - inner**2) * rest
    return np.asarray(rubber * 1e3 * (muscle["c10_kpa"] * first + muscle["c01_kpa"] * second))


def friction_tension(numbers: dict[str, Any], pressure: Series) -> Series:
    muscle, bar = numbers["muscle"], pressure / 1e5
    line = muscle["friction_slope_n_per_bar"] * bar + muscle["friction_offset_n"]
    return np.asarray(-muscle["count"] * line * np.clip(bar / 2.0, None, 1.0))


def damper_tension(numbers: dict[str, Any], speed: Series) -> Series:
    """Bernoulli: the oil of the bore leaves through the orifice, ``p = rho/2 (jet^2 - v^2)``."""
    damper = numbers["damper"]
    bore = 1e-3 * damper["bore_mm"]
    orifice = 1e-3 * np.where(speed > 0, damper["orifice_eccentric_mm"], damper["orifice_concentric_mm"])
    jet = speed * (bore / orifice) ** 2
    drop = 0.5 * damper["oil_density_kg_m3"] * (jet**2 - speed**2)
    return np.asarray(np.sign(speed) * drop * np.pi * bore**2 / 4)


def tendon_tension(numbers: dict[str, Any], stretch: Series) -> Series:
    tendon = numbers["tendon"]
    first, second = 1e3 * tendon["stiffness_1_n_per_mm"], 1e3 * tendon["stiffness_2_n_per_mm"]
    return np.asarray(
        first * np.clip(stretch, 0, None) + second * np.clip(stretch - 1e-3 * tendon["engagement_mm"], 0, None)
    )


def slope(function: Callable[[dict[str, Any], Series], Series], numbers: dict[str, Any], length: Series) -> Series:
    """Central difference of fourth order."""
    h = 1e-4
    values = [function(numbers, length + k * h) for k in (-2, -1, 1, 2)]
    return np.asarray((values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * h))


def stretch_of_tendon(cycle: Cycle) -> Series:
    return np.asarray(cycle.unit_length - cycle.length - 1e-3 * cycle.numbers["tendon"]["slack_length_mm"])


@pytest.mark.parametrize("preset", PRESETS)
def test_forces_balance_at_every_sample(preset: str) -> None:
    cycle = simulate(preset, 5e-4)
    numbers, step = cycle.numbers, 5e-4
    assert np.max(cycle.length) < 1e-3 * numbers["muscle"]["resting_length_mm"] - 1e-4  # off the stops
    speed = np.diff(cycle.length) / step
    pressure, length = cycle.pressure[1:], cycle.length[1:]
    muscle = (
        -pressure * slope(volume_in_braids, numbers, length)
        + slope(energy_of_rubber, numbers, length)
        + friction_tension(numbers, pressure)
        + damper_tension(numbers, speed)
    )
    tendon = tendon_tension(numbers, stretch_of_tendon(cycle)[1:])
    assert np.ptp(tendon) > 500.0
    assert np.abs(tendon - cycle.tension[1:]).max() < 1e-6
    assert np.abs(muscle - cycle.tension[1:]).max() < 1e-4


def energy_residual(preset: str, step: float, begin: float, end: float) -> tuple[float, float]:
    """Return delivered work minus that of all elements between two times, and the exchanged energy [J]."""
    cycle = simulate(preset, step)
    inside = slice(round(begin / step), round(end / step) + 1)
    numbers, length, pressure = cycle.numbers, cycle.length[inside], cycle.pressure[inside]
    stretch, unit_length = stretch_of_tendon(cycle)[inside], cycle.unit_length[inside]
    elongations = np.linspace(0, 1, 401)

    def tendon_energy(final: float) -> float:
        return float(np.trapezoid(tendon_tension(numbers, final * elongations), final * elongations))

    speed = np.gradient(cycle.length, step)[inside]  # central differences: not those of the program
    work = {
        "gas": np.trapezoid(pressure, volume_in_braids(numbers, length)),
        "rubber": -np.diff(energy_of_rubber(numbers, length[[0, -1]]))[0],
        "friction": -np.trapezoid(friction_tension(numbers, pressure), length),
        "damper": -np.trapezoid(damper_tension(numbers, speed) * speed, dx=step),
        "tendon": tendon_energy(stretch[0]) - tendon_energy(stretch[-1]),
    }
    delivered = -np.trapezoid(cycle.tension[inside], unit_length)
    return float(delivered - sum(work.values())), float(sum(abs(value) for value in work.values()))


@pytest.mark.parametrize("preset", PRESETS)
def test_energy_balance_closes_in_proportion_to_the_step(preset: str) -> None:
    """Within a cycle, where the damper's lag by half a step does not cancel: first order over three halvings."""
    residuals = [energy_residual(preset, step, 2.0, 2.6) for step in STEPS]
    values = np.array([residual for residual, _ in residuals])
    assert np.abs(values[:-1] / values[1:]).min() > 1.8
    assert np.abs(values[:-1] / values[1:]).max() < 2.2
    assert abs(values[1]) < 1e-3 * residuals[1][1]


@pytest.mark.parametrize("preset", PRESETS)
def test_energy_balance_of_whole_cycles_closes(preset: str) -> None:
    residual, exchanged = energy_residual(preset, 5e-4, 1.0, 4.0)
    assert exchanged > 30.0
    assert abs(residual) < 2e-4 * exchanged


@pytest.mark.parametrize("preset", PRESETS)
def test_residual_of_the_ledger_is_proportional_to_the_step(preset: str) -> None:
    sums = np.array([step * np.abs(simulate(preset, step).residual_power).sum() for step in STEPS])
    assert np.all((sums[:-1] / sums[1:] > 1.9) & (sums[:-1] / sums[1:] < 2.1))
