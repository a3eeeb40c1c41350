"""Position of a mass that hangs from a muscle: its unit, its sign and its zero, by where the model rests."""

from pathlib import Path

import numpy as np
import pytest

from klute_sim.datasets.dataset import Dataset, load_dataset
from klute_sim.datasets.mechanism_statics import Statics, compute_static_tension, compute_statics
from klute_sim.datasets.write import write_trial
from klute_sim.errors import InputError
from klute_sim.types import Array

MASS = 20.0
"""Mass [kg]."""
HEAD = f"""format = "klute-sim-dataset/2"
rig = "mjcf"
model = "hanging_mass"
device = "klute-3-4-pair"
prescribed = ["pressure_command_muscle"]
measured = ["position_guide"]

[numbers]
"model.geom.mass.mass" = {MASS}
"model.site.muscle_origin.pos_z" = 0.29

[[trial]]
files = ["a.csv"]
"""
TIME = np.linspace(0.0, 8.0, 401)
PRESSURE = 2.0 + np.sin(1.5 * TIME)
"""Command [bar]."""


def load(folder: Path, position: Array) -> Dataset:
    """Load a trial with ``position`` [mm]."""
    (folder / "dataset.toml").write_text(HEAD)
    columns = {"time [s]": TIME, "pressure_command_muscle [bar]": PRESSURE, "position_guide [mm]": position}
    write_trial(folder / "a.csv", columns)
    return load_dataset(folder)


def compute(folder: Path) -> Statics:
    dataset = load(folder, 0.1 * TIME)
    assert dataset.mechanism is not None
    statics = compute_statics(dataset.mechanism, dataset.mechanism.devices, dataset.trials[0].model_numbers)
    assert statics is not None
    return statics


def test_mass_oscillates_on_the_stiffness_of_the_muscle_at_rest(tmp_path: Path) -> None:
    statics, pressure = compute(tmp_path), {"muscle": np.array([2e5])}
    rest = float(statics.find_rest(pressure)[0])
    device = load(tmp_path, 0.1 * TIME).trials[0].devices["muscle"]
    high, low, weight = (compute_static_tension(device, 2e5, 0.29 - rest + step) for step in (1e-3, -1e-3, 0.0))
    assert weight == pytest.approx(MASS * 9.81, rel=0.02)
    stiffness = (high - low) / 2e-3
    assert statics.compute_natural_period(pressure) == pytest.approx(2.0 * np.pi * (MASS / stiffness) ** 0.5, rel=0.1)
    assert 0.01 < statics.compute_reach() < 0.2


def test_imperfect_motion_is_accepted(tmp_path: Path) -> None:
    rest = 1e3 * compute(tmp_path).find_rest({"muscle": 1e5 * PRESSURE})
    for position in (
        rest,
        0.7 * rest + 8.0,
        np.interp(TIME - 0.15, TIME, rest),
        0.2 * rest,
        np.full(401, 10.0) + 0.1 * TIME,
    ):
        assert load(tmp_path, position).accepted == ()


@pytest.mark.parametrize(
    ("factor", "offset", "name"),
    [(1e-3, 0.0, "position_guide-unit"), (-1.0, 0.0, "position_guide-sign"), (1.0, 300.0, "position_guide-zero")],
)
def test_mistake_is_named(tmp_path: Path, factor: float, offset: float, name: str) -> None:
    rest = 1e3 * compute(tmp_path).find_rest({"muscle": 1e5 * PRESSURE})
    with pytest.raises(InputError, match=f"accept it with --accept {name}"):
        load(tmp_path, factor * rest + offset)


def test_position_far_beyond_the_stops_is_named(tmp_path: Path) -> None:
    rest = 1e3 * compute(tmp_path).find_rest({"muscle": 1e5 * PRESSURE})
    with pytest.raises(InputError, match="stops of its joint are at -150 mm and 250 mm: is its unit um"):
        load(tmp_path, 1e3 * rest)
