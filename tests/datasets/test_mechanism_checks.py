"""What is implausible in the trials of a mechanism, and what only seems so."""

from pathlib import Path

import numpy as np
import pytest

from klute_sim.datasets.dataset import Dataset, load_dataset
from klute_sim.datasets.write import write_trial
from klute_sim.device.device import load_device
from klute_sim.errors import InputError

HEAD = """format = "klute-sim-dataset/2"
rig = "mjcf"
model = "antagonist_joint"
device = "klute-3-4-pair"
prescribed = ["pressure_command_flexor", "pressure_command_extensor"]
measured = ["angle_joint", "pressure_flexor"]
"""
TIME = np.linspace(0.0, 2.0, 201)
FLEXOR = 2.0 + np.sin(3.0 * TIME)
EXTENSOR = 3.0 - np.sin(3.0 * TIME)
ANGLE = 30.0 + 10.0 * np.sin(3.0 * TIME)
COLUMNS = {
    "time [s]": TIME,
    "pressure_command_flexor [bar]": FLEXOR,
    "pressure_command_extensor [bar]": EXTENSOR,
    "angle_joint [deg]": ANGLE,
    "pressure_flexor [bar]": FLEXOR - 0.01,
}


def load(folder: Path, changes: dict[str, np.ndarray | None], extra: str = "") -> Dataset:
    """Load two trials of which the first is as it should be, and the second has the ``changes`` of its columns."""
    trials = "".join(f'\n[[trial]]\nfiles = ["{name}.csv"]\n' for name in "ab")
    (folder / "dataset.toml").write_text(HEAD + extra + trials)
    write_trial(folder / "a.csv", COLUMNS)
    changed = {**COLUMNS, **changes}
    write_trial(folder / "b.csv", {name: values for name, values in changed.items() if values is not None})
    return load_dataset(folder)


def load_one(folder: Path, changes: dict[str, np.ndarray | None], extra: str = "") -> Dataset:
    """Load a single trial with the ``changes``."""
    (folder / "dataset.toml").write_text(HEAD + extra + '\n[[trial]]\nfiles = ["a.csv"]\n')
    changed = {**COLUMNS, **changes}
    write_trial(folder / "a.csv", {name: values for name, values in changed.items() if values is not None})
    return load_dataset(folder)


def test_right_trials_are_accepted(tmp_path: Path) -> None:
    assert load(tmp_path, {}).remarks == ()


@pytest.mark.parametrize(
    ("changes", "name", "part"),
    [
        ({"pressure_command_flexor [bar]": 200.0 + TIME}, "pressure_command_flexor-unit", "trial 'b'"),
        ({"angle_joint [deg]": np.full(201, 30.0)}, "angle_joint-constant", "30 deg in all 201 samples"),
        ({"pressure_flexor [bar]": np.full(201, 2.0)}, "pressure_flexor-constant", "its command goes over 1"),
        (
            {"angle_joint [deg]": np.where(TIME > 1.9, -999.0, ANGLE)},
            "angle_joint-missing",
            "angle_joint is -999 deg in 11 samples",
        ),
        (
            {"angle_joint [deg]": np.where(np.arange(201) == 90, 0.0, ANGLE)},
            "angle_joint-spike",
            "angle_joint is 0 deg at 0.9 s, but 34.5 and 34 deg before and after it",
        ),
    ],
)
def test_mistake_of_one_trial_is_named(
    tmp_path: Path, changes: dict[str, np.ndarray | None], name: str, part: str
) -> None:
    with pytest.raises(InputError) as error:
        load(tmp_path, changes)
    assert part in str(error.value)
    assert f"accept it with --accept {name}" in str(error.value)
    assert load_dataset(tmp_path, accept=[name]).accepted[0].name == name


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        (
            {
                "pressure_command_flexor [bar]": None,
                "pressure_command_extensor [bar]": None,
                "pressure_command_flexor [kPa]": FLEXOR,
                "pressure_command_extensor [kPa]": EXTENSOR,
            },
            "supply pressure of this device is 500 kPa: is its unit bar?",
        ),
        (
            {"pressure_flexor [bar]": None, "pressure_flexor [kPa]": FLEXOR},
            "pressure_flexor is 1 to 3 kPa, but the supply pressure of this device is 500 kPa: is its unit bar?",
        ),
        ({"pressure_flexor [bar]": FLEXOR + 1.0}, "over all trials the pressure is 1 bar above its command"),
    ],
)
def test_mistake_in_all_pressures_is_named(tmp_path: Path, changes: dict[str, np.ndarray | None], part: str) -> None:
    with pytest.raises(InputError) as error:
        load_one(tmp_path, changes)
    assert part in str(error.value)


@pytest.mark.parametrize(
    "changes",
    [
        {"angle_joint [deg]": np.full(201, -29.5)},  # at a stop
        {  # both muscles are stiffened alike
            "pressure_command_extensor [bar]": FLEXOR,
            "angle_joint [deg]": np.full(201, 30.0),
        },
        {"pressure_command_extensor [bar]": np.full(201, 0.05)},  # idle
        {"pressure_flexor [bar]": 1.4 * FLEXOR},  # a gain
        {"pressure_flexor [bar]": FLEXOR + 0.3},  # an offset
    ],
)
def test_unusual_trials_are_accepted(tmp_path: Path, changes: dict[str, np.ndarray | None]) -> None:
    assert load_one(tmp_path, changes).accepted == ()


def test_finding_on_a_prescribed_pressure_has_its_name(tmp_path: Path) -> None:
    head = HEAD.replace("pressure_command_flexor", "pressure_flexor").replace(', "pressure_flexor"]\n', "]\n")
    (tmp_path / "dataset.toml").write_text(head + '\n[[trial]]\nfiles = ["a.csv"]\n')
    columns = {name: values for name, values in COLUMNS.items() if "flexor" not in name}
    write_trial(tmp_path / "a.csv", {**columns, "pressure_flexor [bar]": 100.0 * FLEXOR})
    with pytest.raises(InputError, match="trial 'a': pressure_flexor is 1") as error:
        load_dataset(tmp_path)
    assert str(error.value).endswith("--accept pressure_flexor-unit")
    assert load_dataset(tmp_path, accept=["pressure_flexor-unit"]).accepted


def test_valve_openings_show_no_stuck_joint(tmp_path: Path) -> None:
    lines = load_device("klute-1-1-4-pair-valve").content.decode().splitlines()
    by_opening = [line.replace('command = "pressure"', 'command = "opening"') for line in lines if "gain" not in line]
    (tmp_path / "valve.toml").write_text("\n".join(by_opening))
    head = HEAD.replace("klute-3-4-pair", "valve.toml").replace(', "pressure_flexor"', "")
    (tmp_path / "dataset.toml").write_text(head + '\n[[trial]]\nfiles = ["a.csv"]\n')
    still = {"angle_joint [deg]": np.full(201, 30.0), "pressure_flexor [bar]": None}
    columns = {name: still.get(name, values) for name, values in COLUMNS.items()}
    write_trial(tmp_path / "a.csv", {name: values for name, values in columns.items() if values is not None})
    assert load_dataset(tmp_path).accepted == ()


def test_trial_without_a_measured_channel_is_remarked(tmp_path: Path) -> None:
    (remark,) = load(tmp_path, {"angle_joint [deg]": None}).remarks
    assert remark.startswith("trial 'b' has no column for the measured channel 'angle_joint'")


@pytest.mark.parametrize(
    ("number", "value", "part"),
    [
        ("model.site.flexor_origin.pos_z", "290", "is it in mm? Write 0.29"),
        ("model.geom.load.mass", "1000", "is it in g? Write 1"),
        ("model.option.gravity_z", "9.81", "opposite to (0, 0, -9.81) m/s2"),
        ("model.site.flexor_origin.pos_z", "3", "so the device cannot reach"),
    ],
)
def test_impossible_number_of_the_model_is_named(tmp_path: Path, number: str, value: str, part: str) -> None:
    with pytest.raises(InputError) as error:
        load(tmp_path, {}, f'[numbers]\n"{number}" = {value}\n')
    assert part in str(error.value)
