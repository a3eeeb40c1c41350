"""Forces and moments of a driven joint between two muscles, mistakes in them, and mistakes in the model."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest

from klute_sim.datasets.checks import build_simulation
from klute_sim.datasets.dataset import Dataset, load_dataset
from klute_sim.datasets.write import write_trial
from klute_sim.device.device import load_device
from klute_sim.errors import InputError
from klute_sim.plant.mjcf.model_file import load_model_file
from klute_sim.plant.mjcf.model_numbers import set_model_numbers
from klute_sim.types import Array

HEAD = """format = "klute-sim-dataset/2"
rig = "mjcf"
model = "joint.xml"
device = "klute-3-4-pair"
prescribed = ["angle_joint", "pressure_flexor", "pressure_extensor"]
measured = ["force_flexor", "force_extensor", "moment_joint"]

[numbers]
"model.site.flexor_origin.pos_z" = 0.29
"model.site.extensor_origin.pos_z" = 0.285
"""
NUMBERS = {"model.site.flexor_origin.pos_z": 0.29, "model.site.extensor_origin.pos_z": 0.285}
PULLEY_RADIUS = 0.025
"""Moment arm of both muscles of the model [m]."""
TIME = np.linspace(0.0, 6.0, 601)
ANGLES = {"moving": 30.0 + 25.0 * np.sin(1.2 * TIME), "isometric": np.full(601, 40.0)}
FLEXOR_PRESSURES = {"moving": np.full(601, 3.5), "isometric": 3.0 + np.sin(1.2 * TIME)}
EXTENSOR_PRESSURE = np.full(601, 2.0)
Columns = dict[str, Array]


@cache
def simulate(trial: str) -> Columns:
    """Return the columns of a trial; both muscles are simulated alone, as on a bench."""
    spec = load_model_file("antagonist_joint").make_spec()
    set_model_numbers(spec, NUMBERS)
    model = spec.compile()
    data = mujoco.MjData(model)
    lengths = []
    for angle in np.radians(ANGLES[trial]):
        data.joint("joint").qpos[0] = angle
        mujoco.mj_fwdPosition(model, data)
        lengths.append(data.ten_length.copy())
    columns = {"time [s]": TIME, "angle_joint [deg]": ANGLES[trial]}
    forces = []
    for index, (name, pressure) in enumerate((("flexor", FLEXOR_PRESSURES[trial]), ("extensor", EXTENSOR_PRESSURE))):
        response = build_simulation(load_device("klute-3-4-pair"))(0.01, np.array(lengths)[:, index], 1e5 * pressure)
        assert response is not None
        columns |= {f"pressure_{name} [bar]": response.pressure / 1e5, f"force_{name} [N]": response.force}
        forces.append(response.force)
    return {**columns, "moment_joint [N*m]": PULLEY_RADIUS * (forces[0] - forces[1])}


def load(folder: Path, edit: Callable[[Columns], Columns] = dict, model: tuple[str, str] = ("", "")) -> Dataset:
    """Load both trials with ``edit`` of their columns; ``model`` is a replacement in the file of the model."""
    text = load_model_file("antagonist_joint").path.read_text("utf-8")
    (folder / "joint.xml").write_text(text.replace(*model) if model[0] else text)
    (folder / "dataset.toml").write_text(HEAD + "".join(f'\n[[trial]]\nfiles = ["{name}.csv"]\n' for name in ANGLES))
    for name in ANGLES:
        write_trial(folder / f"{name}.csv", edit(simulate(name)))
    return load_dataset(folder)


def scale(name: str, factor: float, offset: float = 0.0) -> Callable[[Columns], Columns]:
    return lambda columns: {**columns, name: factor * columns[name] + offset}


def exchange_forces(columns: Columns) -> Columns:
    first, second = "force_flexor [N]", "force_extensor [N]"
    return {**columns, first: columns[second], second: columns[first]}


@pytest.mark.parametrize(
    "edit",
    [
        dict,
        scale("force_flexor [N]", 1.2, 15.0),
        scale("force_flexor [N]", 0.6),
        scale("moment_joint [N*m]", 2.0),
        scale("moment_joint [N*m]", 0.7376),  # foot-pounds, or a wrong moment arm
        scale("angle_joint [deg]", 1.0, 8.0),
        scale("pressure_flexor [bar]", 1.15),
    ],
)
def test_right_and_imperfect_loads_are_accepted(tmp_path: Path, edit: Callable[[Columns], Columns]) -> None:
    assert load(tmp_path, edit).accepted == ()


@pytest.mark.parametrize(
    ("edit", "name", "part"),
    [
        (scale("moment_joint [N*m]", -1.0), "moment_joint-sign", "its sign seems reversed"),
        (scale("moment_joint [N*m]", 100.0), "moment_joint-unit", "is its unit N*cm?"),
        (scale("force_flexor [N]", 1.0 / 4.448), "force_flexor-unit", "is its unit lbf?"),
        (scale("force_extensor [N]", 1e-3), "force_extensor-unit", "is its unit kN?"),
        (scale("force_extensor [N]", -1.0), "force_extensor-sign", "tension is positive"),
        (scale("angle_joint [deg]", -1.0), "angle_joint-sign", "only at the opposite position"),
        (exchange_forces, "force_extensor-force_flexor-exchanged", "their columns are exchanged"),
    ],
)
def test_mistake_is_named(tmp_path: Path, edit: Callable[[Columns], Columns], name: str, part: str) -> None:
    with pytest.raises(InputError, match="trial 'moving'") as error:
        load(tmp_path, edit)
    assert part in str(error.value)
    assert f"accept it with --accept {name}" in str(error.value)
    assert {finding.name for finding in load_dataset(tmp_path, accept=[name]).accepted} == {name}


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ('size="0.025 0.01"', 'size="25 10"', "is the radius in mm? Write 0.025 m"),
        ("-0.01275 0 -0.02208", "-0.0125 0 -0.02165", "site 'flexor_insertion' of tendon 'flexor' is 25 mm from"),
        ('angle="degree"', 'angle="radian"', 'Write angle="degree" under compiler'),
    ],
)
def test_mistake_in_the_model_is_named(tmp_path: Path, old: str, new: str, part: str) -> None:
    with pytest.raises(InputError) as error:
        load(tmp_path, model=(old, new))
    assert part in str(error.value)
