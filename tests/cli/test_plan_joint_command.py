"""``klute-sim plan --model`` as a user types it: trials of a joint that are datasets as soon as they are recorded."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

from klute_sim.api.joint_plan import plan_joint_measurements
from klute_sim.datasets.dataset import load_dataset, split_dataset
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.base import SimulationSetup
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import observe, simulate_extrapolated
from klute_sim.errors import InputError
from klute_sim.plant.mjcf.model_file import load_model_file
from tests import command_line as command


def run(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return command.run("plan", "klute-3-4-pair", *arguments, cwd=cwd)


def test_simulated_plan_is_a_dataset_that_the_device_explains(tmp_path: Path) -> None:
    options = ("--model", "antagonist_joint", "--only", "quick-release", "--load", "-2", "--simulate", "--json")
    done = run(*options, "--out", "joint", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert [trial["name"] for trial in told["trials"]] == ["release_50pct", "release_100pct"]
    assert set(told["files"]) == {
        *("README.txt", "dataset.toml", "device.toml"),
        *(f"{trial['name']}{end}.csv" for trial in told["trials"] for end in ("", "_a", "_b")),
    }
    dataset = load_dataset(tmp_path / "joint")
    assert "extensor/tendon.slack_length_mm" in dataset.uncertainties
    assert "model.geom.load.mass" in dataset.uncertainties
    experiment = prepare_experiments(dataset, split_dataset(dataset))[0]
    setup = SimulationSetup(dataset.device.parameters)
    simulated = observe(setup, experiment, simulate_extrapolated(setup, experiment))
    residual = np.degrees(experiment.measured["angle_joint"].value - simulated["angle_joint"])
    assert np.std(residual) == pytest.approx(0.05, rel=0.2)
    readme = (tmp_path / "joint" / "README.txt").read_text()
    assert "apply its external load" in readme
    assert "angle_joint [deg]" in readme


def test_plan_of_a_free_load_has_one_device_and_a_position(tmp_path: Path) -> None:
    plan = plan_joint_measurements("klute-3-4-pair", model="hanging_mass", only=["sines"])
    assert plan.plan.measured == ("position_guide", "pressure_muscle")
    assert {trial["use"] for trial in plan.to_dict()["trials"]} == {None}
    folder = plan.save(tmp_path / "plan")
    assert 'prescribed = ["pressure_command_muscle"]' in (folder / "dataset.toml").read_text()
    heading = (folder / "sine_1Hz.csv").read_text().splitlines()[0]
    assert heading == "time [s],pressure_command_muscle [bar]"


def test_own_model_and_different_devices_get_their_files(tmp_path: Path) -> None:
    path = tmp_path / "elbow.xml"
    path.write_bytes(load_model_file("antagonist_joint").content)
    stronger = load_device("klute-3-4-pair").with_changes({"muscle.count": 3})
    plan = plan_joint_measurements({"flexor": stronger, "extensor": "klute-3-4-pair"}, model=path, only=["multisine"])
    folder = plan.save(tmp_path / "plan")
    text = (folder / "dataset.toml").read_text()
    assert 'model = "model.xml"' in text
    assert '[devices.extensor]\ndevice = "device-extensor.toml"' in text
    assert load_device(folder / "device-flexor.toml").spec.collect_values()["muscle.count"] == 3
    assert load_model_file(folder / "model.xml").make_spec().joint("joint") is not None
    assert "use" not in text.partition("[[trial]]")[2]  # without a trial to fit, the split decides


def test_test_that_is_named_twice_is_planned_once() -> None:
    plan = plan_joint_measurements(only=["steps", "sines", "steps"])
    names = [trial["name"] for trial in plan.to_dict()["trials"]]
    assert len(set(names)) == len(names) == 9


def test_mistakes_are_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="'quick-release' needs a load"):
        plan_joint_measurements(only=["quick-release"])
    with pytest.raises(InputError, match="there is no test 'step'; did you mean 'steps'"):
        plan_joint_measurements(only=["step"])
    with pytest.raises(InputError, match="the supply of 'klute-3-4-pair' has"):
        plan_joint_measurements(mean_pressure_bar=5.0, difference_bar=2.0)
    done = run("--load", "-2", "--out", "plan", cwd=tmp_path)
    assert done.returncode == 2
    assert "--load belongs to a joint; name its model with --model" in done.stderr


@pytest.mark.parametrize(
    ("tests", "uses"), [(["steps"], {None}), (["steps", "sines"], {None}), (["steps", "multisine"], {"fit", "test"})]
)
def test_plan_reserves_trials_for_the_test(tests: list[str], uses: set[str | None], tmp_path: Path) -> None:
    plan = plan_joint_measurements(only=tests, simulate=tests == ["steps"])
    assert {trial["use"] for trial in plan.to_dict()["trials"]} == uses
    if plan.simulate:
        split = split_dataset(load_dataset(plan.save(tmp_path / "plan")))
        assert (len(split.fit), len(split.validation), len(split.test)) == (4, 2, 2)
