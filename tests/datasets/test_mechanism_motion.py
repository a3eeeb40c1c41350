"""Motion of a joint in the trials of a mechanism, compared with the model at rest and with the other trials."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from klute_sim.datasets.dataset import Dataset, load_dataset
from klute_sim.datasets.mechanism_statics import Statics, compute_statics
from klute_sim.datasets.write import write_trial
from klute_sim.errors import InputError
from klute_sim.types import Array

HEAD = """format = "klute-sim-dataset/2"
rig = "mjcf"
model = "antagonist_joint"
device = "klute-3-4-pair"
prescribed = ["pressure_command_flexor", "pressure_command_extensor"]
measured = ["angle_joint", "pressure_flexor", "pressure_extensor"]

[numbers]
"model.site.flexor_origin.pos_z" = 0.29
"model.site.extensor_origin.pos_z" = 0.285
"""
TIME = np.linspace(0.0, 8.0, 401)
WAVEFORM = np.sin(1.5 * np.maximum(TIME - 0.5, 0.0))
FLEXOR, EXTENSOR = 3.0 + 0.5 * WAVEFORM, 3.0 - 0.5 * WAVEFORM


def write(folder: Path, names: Iterable[str], numbers: str = "") -> None:
    trials = "".join(f'\n[[trial]]\nfiles = ["{name}.csv"]\n' for name in names)
    (folder / "dataset.toml").write_text(HEAD + numbers + trials)
    for name in names:
        pressures = {"flexor": FLEXOR, "extensor": EXTENSOR}
        columns = {
            "time [s]": TIME,
            **{f"pressure_command_{tendon} [bar]": values for tendon, values in pressures.items()},
            "angle_joint [deg]": 33.0 + 20.0 * WAVEFORM,
            **{f"pressure_{tendon} [bar]": values for tendon, values in pressures.items()},
        }
        write_trial(folder / f"{name}.csv", columns)


def edit(folder: Path, name: str, old: str, new: str) -> None:
    path = folder / f"{name}.csv"
    path.write_text(path.read_text().replace(old, "?").replace(new, old).replace("?", new))


def load(folder: Path) -> Dataset:
    return load_dataset(folder)


def compute(folder: Path) -> Statics:
    dataset = load(folder)
    assert dataset.mechanism is not None
    statics = compute_statics(dataset.mechanism, dataset.mechanism.devices, dataset.trials[0].model_numbers)
    assert statics is not None
    return statics


def test_model_rests_where_a_simulation_ends(tmp_path: Path) -> None:
    from klute_sim.mechanism.assembly import Mechanism
    from klute_sim.mechanism.simulate import simulate_mechanism

    write(tmp_path, "a")
    dataset, statics = load(tmp_path), compute(tmp_path)
    declared = dataset.mechanism
    assert declared is not None
    mechanism = Mechanism(declared.file, tuple(declared.devices), declared.channels.prescribed)
    devices = {name: device.parameters for name, device in declared.devices.items()}
    for flexor, extensor in [(3e5, 3e5), (3.4e5, 2.5e5), (2e5, 2.2e5)]:
        inputs = {f"pressure_command_{n}": np.full(10, p) for n, p in [("flexor", flexor), ("extensor", extensor)]}
        rollout = simulate_mechanism(mechanism, devices, inputs, 5e-4, numbers=declared.numbers)
        rest: Array = statics.find_rest({"flexor": np.array([flexor]), "extensor": np.array([extensor])})
        assert np.degrees(rest[0]) == pytest.approx(np.degrees(rollout.initial_qpos[0]), abs=1.0)
    period = statics.compute_natural_period({"flexor": np.array([3e5]), "extensor": np.array([3e5])})
    assert 0.2 < period < 1.0


def test_right_trials_are_accepted(tmp_path: Path) -> None:
    write(tmp_path, "abcd")
    assert load(tmp_path).remarks == ()


@pytest.mark.parametrize(
    ("old", "new", "name"),
    [
        ("angle_joint [deg]", "angle_joint [rad]", "angle_joint-unit"),
        ("pressure_command_flexor", "pressure_command_extensor", "pressure_command_extensor-pressure_command_flexor"),
        (",pressure_flexor", ",pressure_extensor", "pressure_extensor-pressure_flexor-exchanged"),
    ],
)
def test_exchanged_headings_are_named(tmp_path: Path, old: str, new: str, name: str) -> None:
    write(tmp_path, "a")
    edit(tmp_path, "a", old, new)
    with pytest.raises(InputError, match=f"accept it with --accept {name}"):
        load(tmp_path)


def test_exchanged_headings_are_located_by_the_whole_name_of_the_trial(tmp_path: Path) -> None:
    write(tmp_path, ["run, fast"])
    edit(tmp_path, "run, fast", ",pressure_flexor", ",pressure_extensor")
    with pytest.raises(InputError, match="trial 'run, fast': the pressure of each"):
        load(tmp_path)


def test_exchanged_muscles_are_named(tmp_path: Path) -> None:
    write(tmp_path, "a")
    edit(tmp_path, "a", "flexor", "extensor")
    with pytest.raises(InputError, match="two antagonists are exchanged") as error:
        load(tmp_path)
    assert "--accept angle_joint-sign" in str(error.value)
    assert load_dataset(tmp_path, accept=["angle_joint-sign"]).accepted[0].name == "angle_joint-sign"


@pytest.mark.parametrize(
    "number",
    [
        '"model.geom.pulley.size_1" = 0.03',
        '"model.geom.load.mass" = 2.0',
        '"model.joint.joint.stiffness" = 20.0',
        '"model.geom.load.mass" = -1.0',  # the preparation reports it
    ],
)
def test_model_whose_numbers_are_off_is_accepted(tmp_path: Path, number: str) -> None:
    write(tmp_path, "a", f"{number}\n")
    assert load(tmp_path).accepted == ()


def test_trial_with_another_zero_is_remarked(tmp_path: Path) -> None:
    write(tmp_path, "abcd")
    lines = (tmp_path / "c.csv").read_text().splitlines()
    rows = [line.split(",") for line in lines[1:]]
    shifted = [",".join([*row[:3], str(float(row[3]) + 5.0), *row[4:]]) for row in rows]
    (tmp_path / "c.csv").write_text("\n".join([lines[0], *shifted]))
    (remark,) = load(tmp_path).remarks
    assert "trial 'c' begins at angle_joint = 38" in remark
    assert "its zero may differ by 5 deg" in remark
