"""Isometric fillings of a muscle at several lengths with repeats: trials that share columns are judged together."""

import re
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from klute_sim.datasets.dataset import load_dataset
from klute_sim.datasets.write import write_trial
from klute_sim.device.device import parse_device
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.plausibility.finding import ImplausibleInputError
from klute_sim.types import Array
from tests.datasets.test_muscle_diameter import TEN_MM

ATMOSPHERE_BAR = 1.013
WEAKNESS = {1.0: 0.52, 0.95: 0.42, 0.9: 0.38, 0.85: 0.3}
"""Length relative to that at rest -> force of a weak muscle relative to the simulated one."""


class Filling(NamedTuple):
    """One recorded filling."""

    ratio: float
    """Length relative to that at rest."""
    repeat: int
    length: Array
    """[mm]"""
    pressure: Array
    """[bar]"""
    force: Array
    """[N]"""


Change = Callable[[Filling], Filling]


@cache
def simulate_filling(ratio: float, idle: float) -> Filling:
    """Return a filling from ``idle`` to 6 bar and back, of a muscle of 200 mm that is clamped."""
    time = np.arange(0.0, 8.0, 0.01)
    pressure = np.interp(time, [0.0, 0.8, 3.5, 4.0, 7.2, 8.0], [idle, idle, 6.0, 6.0, idle, idle])
    length = np.full(len(time), 200.0 * ratio)
    parameters = parse_device(TEN_MM.encode(), "muscle").parameters
    force = simulate_rollouts(parameters, 1e-3 * length, 1e5 * pressure, 0.01).tension
    return Filling(ratio, 0, length, pressure, np.maximum(force, 0.0))


def write_fillings(
    folder: Path,
    change: Change = lambda filling: filling,
    *,
    idle: float = 0.0,
    strength: Mapping[float, float] = WEAKNESS,
) -> Path:
    """Write a dataset of two fillings at each length of ``strength``; ``change`` falsifies each."""
    rng = np.random.default_rng(3)
    (folder / "muscle.toml").write_text(TEN_MM, "utf-8")
    lines = ['format = "klute-sim-dataset/2"', 'rig = "bench"', 'device = "muscle.toml"']
    for ratio, factor in strength.items():
        for repeat in (1, 2):
            filling = simulate_filling(ratio, idle)
            noise = rng.normal(0.0, 0.5, len(filling.force))
            filling = change(filling._replace(repeat=repeat, force=factor * filling.force + noise))
            name = f"{round(100 * ratio)}_{repeat}"
            columns = {
                "time [s]": 0.01 * np.arange(len(noise)),
                "length [mm]": filling.length,
                "pressure_command [bar]": filling.pressure,
                "force [N]": filling.force,
            }
            write_trial(folder / f"{name}.csv", columns)
            lines += ["[[trial]]", f'files = ["{name}.csv"]', f'group = "{ratio}"', 'specimen = "a"']
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", "utf-8")
    return folder


def find(folder: Path) -> dict[str, list[str]]:
    """Return name of finding -> trials; empty where the dataset is accepted."""
    try:
        load_dataset(folder)
    except ImplausibleInputError as error:
        names: dict[str, list[str]] = {}
        for finding in error.findings:
            names.setdefault(finding.name, []).append(re.findall("'(.+)'", finding.place)[0])
        return names
    return {}


ALL = [f"{length}_{repeat}" for length in (100, 95, 90, 85) for repeat in (1, 2)]


def change_where(is_changed: Callable[[Filling], bool], change: Change) -> Change:
    return lambda filling: change(filling) if is_changed(filling) else filling


def write_kilogram_force(filling: Filling) -> Filling:
    """Write kgf under [N]."""
    return filling._replace(force=filling.force / 9.80665)


def add_atmosphere(filling: Filling) -> Filling:
    return filling._replace(pressure=filling.pressure + ATMOSPHERE_BAR)


def exchange_length_and_force(filling: Filling) -> Filling:
    return filling._replace(length=filling.force, force=filling.length)


def test_weak_muscle_at_one_length_has_no_other_unit(tmp_path: Path) -> None:
    """Two of eight trials have less than a third of the simulated force, which another unit would explain."""
    assert find(write_fillings(tmp_path)) == {}


def test_unit_of_all_trials_is_found(tmp_path: Path) -> None:
    (trials,) = find(write_fillings(tmp_path, write_kilogram_force)).values()
    assert set(trials) >= {"100_1", "100_2", "95_1", "95_2"}


@pytest.mark.parametrize("change", [write_kilogram_force, lambda f: f._replace(force=-f.force)])
def test_one_file_that_differs_from_its_repeat_is_found(change: Change, tmp_path: Path) -> None:
    found = find(write_fillings(tmp_path, change_where(lambda f: (f.ratio, f.repeat) == (1.0, 1), change)))
    assert list(found.values()) == [["100_1"]]


def test_one_file_without_a_repeat_is_found_by_its_scale(tmp_path: Path) -> None:
    """Both repeats of one length are in another unit; all others have other scales."""
    strength = dict.fromkeys(WEAKNESS, 1.0)
    change = change_where(lambda f: f.ratio == 0.95, write_kilogram_force)
    assert find(write_fillings(tmp_path, change, strength=strength)) == {"force-unit": ["95_1", "95_2"]}


def test_exchanged_columns_of_all_trials_are_found(tmp_path: Path) -> None:
    found = find(write_fillings(tmp_path, exchange_length_and_force))
    assert found["force-length-exchanged"] == ALL[:4]


def test_absolute_pressures_are_found_by_the_force_at_rest(tmp_path: Path) -> None:
    folder = write_fillings(tmp_path, add_atmosphere)
    assert find(folder) == {"pressure_command-absolute": ALL}
    with pytest.raises(
        ImplausibleInputError, match=r"at which force is .* where a simulation of this device under gauge"
    ):
        load_dataset(folder)
    assert len(load_dataset(folder, accept=["pressure_command-absolute"]).accepted) == len(ALL)


@pytest.mark.parametrize("idle", [0.9, 1.0, 1.05])
def test_gauge_that_idles_at_a_residual_pressure_is_accepted(idle: float, tmp_path: Path) -> None:
    """The muscle pulls at that pressure."""
    assert find(write_fillings(tmp_path, idle=idle)) == {}


@pytest.mark.parametrize(
    "change",
    [
        change_where(lambda f: f.ratio != 1.0, add_atmosphere),  # others begin at zero: the gauge shows gauge pressure
        lambda f: f._replace(pressure=f.pressure + 0.5),
        lambda f: f._replace(pressure=f.pressure + ATMOSPHERE_BAR, force=np.full(len(f.force), 300.0)),
    ],
)
def test_other_pressures_are_not_absolute(change: Change, tmp_path: Path) -> None:
    assert not [name for name in find(write_fillings(tmp_path, change)) if name.endswith("-absolute")]


@pytest.mark.parametrize("strength", [2.7, 5.0, 0.25])
def test_force_that_no_unit_explains_contradicts_the_geometry(strength: float, tmp_path: Path) -> None:
    folder = write_fillings(tmp_path, strength=dict.fromkeys(WEAKNESS, strength))
    found = find(folder)
    assert list(found) == (["force-geometry"] if strength > 1.0 else ["force-unit"])


def test_message_about_geometry_states_factor_and_what_to_check(tmp_path: Path) -> None:
    folder = write_fillings(tmp_path, strength=dict.fromkeys(WEAKNESS, 2.8))
    pattern = r"2\.8 times that of .* \(.* to .* times in the 8 trials of specimen 'a'\).*check the diameter"
    with pytest.raises(ImplausibleInputError, match=pattern):
        load_dataset(folder)
    assert find(folder) == {"force-geometry": ALL}


def test_forgotten_tare_is_left_to_the_diagnosis(tmp_path: Path) -> None:
    change: Change = lambda f: f._replace(force=f.force + 60.0)  # noqa: E731
    assert find(write_fillings(tmp_path, change)) == {}


def test_clamped_muscle_cannot_be_longer_than_its_braid(tmp_path: Path) -> None:
    """The threads of the braid are 10 % longer than the muscle at rest; 5 % are possible."""
    stretch: Change = lambda f: f._replace(length=400.0 - f.length)  # noqa: E731
    folder = write_fillings(tmp_path, stretch)
    assert find(folder) == {"length-geometry": ["85_1", "85_2"]}
    with pytest.raises(
        ImplausibleInputError, match="length is 230 mm, but the resting length of this muscle is 200 mm"
    ):
        load_dataset(folder)
