"""Tests of the joint datasets of the benchmark: their laws agree with the package, and their sizes are as required."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from benchmarks.hidden_effects import catalogue as benchmark
from benchmarks.hidden_effects import joint_follow_up, joints, plan, run
from benchmarks.hidden_effects.joint_sizes import JointEffectSizer

from klute_sim.datasets.dataset import load_dataset, split_dataset
from klute_sim.datasets.mechanism_channels import parse_channel
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.planning.joint_proposals import list_rig_changes
from klute_sim.effects import catalogue
from klute_sim.mechanism.assembly import Mechanism
from klute_sim.mechanism.simulate import simulate_mechanism
from klute_sim.plant.mjcf.model_effects import ModelEffect
from klute_sim.plant.mjcf.model_file import load_model_file

pytestmark = pytest.mark.slow

COMMANDS = joints.draw_commands(np.random.default_rng(1))
STEP = 1e-4  # s
PARTS = {"pulley_error": "pulley", "gravity_tilt": None}
MAX_DEVIATION_DEG = 0.02
"""Largest rms deviation of the angle [deg]: less than half the noise, and a thirtieth of what an effect changes."""


def make_typical(name: str, form: str) -> dict:
    return plan.draw_effect(benchmark.JOINT_EFFECTS, (name, form), None)


@cache
def simulate_truth(*keys: tuple[str, str]) -> np.ndarray:
    numbers = joints.build_joint(joints.load_nominal(), [make_typical(*key) for key in keys])
    return joints.simulate_channels(numbers, COMMANDS)["angle_joint"]


def simulate_package(*keys: tuple[str, str]) -> np.ndarray:
    time = STEP * np.arange(1, round(joints.DURATION / STEP) + 1)
    samples = np.arange(COMMANDS.shape[1]) * joints.SAMPLE_INTERVAL
    names = [f"pressure_command_{tendon}" for tendon in joints.TENDONS]
    inputs = {name: np.interp(time, samples, row) for name, row in zip(names, COMMANDS, strict=True)}
    mechanism = Mechanism(load_model_file("antagonist_joint"), joints.TENDONS, tuple(inputs))
    heights = {f"model.site.{tendon}_origin.pos_z": joints.ORIGIN_HEIGHT for tendon in joints.TENDONS}
    device = load_device("klute-3-4-pair").parameters
    effects = [
        ModelEffect(name, form, tuple(make_typical(name, form)["parameters"].items()), PARTS.get(name, "joint"))
        for name, form in keys
    ]
    rollout = simulate_mechanism(
        mechanism, dict.fromkeys(joints.TENDONS, device), inputs, STEP, numbers=heights, effects=effects
    )
    angle = np.degrees(rollout.read_channel(mechanism.bind(parse_channel("angle_joint"))))
    return np.interp(np.arange(len(simulate_truth())) * 1e-3, [0.0, *time], [angle[0], *angle])


@pytest.mark.parametrize(
    "key", [None, *benchmark.JOINT_EFFECTS], ids=lambda key: "none" if key is None else "-".join(key)
)
def test_joint_agrees_with_package(key: tuple[str, str] | None) -> None:
    keys = () if key is None else (key,)
    truth = simulate_truth(*keys)
    assert np.sqrt(np.mean((simulate_package(*keys) - truth) ** 2)) < MAX_DEVIATION_DEG
    if key is not None:
        assert np.sqrt(np.mean((truth - simulate_truth()) ** 2)) > 10.0 * MAX_DEVIATION_DEG


def test_shorter_steps_change_nothing_that_shows() -> None:
    numbers = joints.build_joint(joints.load_nominal(), [make_typical("joint_friction", "coulomb")])
    usual, fine = (joints.simulate_channels(numbers, COMMANDS, steps=n)["angle_joint"] for n in (4, 16))
    assert np.abs(usual - fine).max() < 0.01


def test_hidden_joint_effects_equal_those_of_catalogue() -> None:
    effects = [e for e in catalogue.get_named_effects().values() if e.kind == "mechanism" and e.part != "slide joint"]
    forms = {(e.name, form.name): form for e in effects for form in e.forms}
    omitted = {("joint_friction", "viscous"), ("gravity_tilt", "about_x"), ("sensor_backlash", "play")}
    assert set(forms) - set(benchmark.JOINT_EFFECTS) == omitted
    for key, own in benchmark.JOINT_EFFECTS.items():
        assert {p.key: (p.neutral, p.lower, p.upper, p.typical) for p in forms[key].parameters} == {
            name: (p.neutral, p.low, p.high, p.typical) for name, p in own.items()
        }
    assert "sensor_backlash" in {name for name, _ in benchmark.instrument_forms("angle_joint")}


def test_sensor_with_play_agrees_with_package() -> None:
    form = catalogue.get_effects()["sensor_backlash"].forms[0]
    angle = simulate_truth()
    expected = form.laws["reading"](form.pack({"play": 0.7}), np.arange(len(angle)) * 1e-3, angle)
    assert joints._drag(angle, 0.7) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("block", plan.JOINT_BLOCKS)
def test_every_planned_dataset_names_known_causes(block: str) -> None:
    assert run.get_rig(block) == "joint"
    for spec in plan.plan_datasets(block, plan.BLOCK_SIZES[block], 5):
        for effect in (*spec.get("effects", ()), *spec.get("instruments", ()), *spec.get("strangers", ())):
            assert set(effect["parameters"]) == set(joints.list_forms(effect, benchmark.EFFECTS))


def test_dataset_is_readable_and_its_effect_has_the_required_size(tmp_path: Path) -> None:
    effect = {**make_typical("joint_friction", "presliding"), "wanted": 3.0}
    sealed = joints.make_dataset(tmp_path / "data", 11, truth=tmp_path / "truth.json", effects=[effect])
    assert sealed["size"] == pytest.approx(3.0, rel=0.15)
    assert json.loads((tmp_path / "truth.json").read_text())["effects"] == sealed["effects"]
    dataset = load_dataset(tmp_path / "data")
    assert set(dataset.uncertainties) == set(joints.UNCERTAINTIES)
    experiments = prepare_experiments(dataset, split_dataset(dataset))
    assert len(experiments) == 8
    angles = np.concatenate([e.measured["angle_joint"].value for e in experiments])
    assert np.degrees(angles.min()) > -29.0
    assert np.degrees(angles.max()) < 95.0


def test_law_error_changes_the_force_by_its_fraction() -> None:
    error = plan.plan_datasets("joint_imperfect", 3, 5)[2]["law_error"]
    nominal = joints.load_nominal()
    numbers = joints.build_joint(nominal, ())
    errors = joints.make_errors(error, "A")
    bent = joints.simulate_channels(numbers, COMMANDS, errors=errors)["angle_joint"]
    assert 0.2 < np.sqrt(np.mean((bent - simulate_truth()) ** 2)) < 10.0
    sizer = JointEffectSizer(nominal, nominal, [COMMANDS])
    assert sizer.measure_size((), ()) == pytest.approx(0.0, abs=1e-9)


def test_follow_up_records_the_proposed_trial_on_the_hidden_joint(tmp_path: Path) -> None:
    fault = {"name": "sensor_offset", "form": "offset", "channel": "angle_joint", "parameters": {"offset": 3.0}}
    sealed = joints.make_dataset(tmp_path / "first", 5, truth=tmp_path / "truth.json", instruments=[fault])
    changes = {
        change.description: change for change in list_rig_changes(list(benchmark.JOINT_CHANNELS), joints.TENDONS)
    }
    encoder = next(name for name, change in changes.items() if "angle_joint" in change.reference_channels)
    load_cell = next(name for name, change in changes.items() if "force_extensor" in change.added_channels)
    rest_angles = {}
    for description in (None, encoder, load_cell):
        requested = {"protocol": "sine_4Hz", "mean_bar": 2.1, "difference_bar": 0.5, "rig_change": description}
        joint_follow_up.make_follow_up(tmp_path / "first", sealed, requested, tmp_path / "second")
        trials = {trial.name: trial for trial in load_dataset(tmp_path / "second").trials}
        trial = trials["follow_up_b"]
        assert trial.group == trials["follow_up_a"].group == "follow_up"
        assert trial.trusted == ({"angle_joint"} if description == encoder else set())
        assert ("force_extensor" in trial.measured) == (description == load_cell)
        assert "force_extensor" not in trials["fit_1_a"].measured
        commands = [trial.prescribed[f"pressure_command_{tendon}"].value / 1e5 for tendon in joints.TENDONS]
        assert commands[0] + commands[1] == pytest.approx(np.full(len(commands[0]), 4.2), abs=0.02)
        assert np.abs(commands[0] - commands[1]).max() / 2 == pytest.approx(0.5, abs=0.01)
        rest_angles[description] = np.degrees(trial.measured["angle_joint"].value[:80].mean())
    assert rest_angles[None] - rest_angles[encoder] == pytest.approx(3.0, abs=0.1)
    assert set(run.FOLLOW_UP_MAKERS) == set(run.MAKERS) - {"gait"}


def test_follow_up_reduces_a_difference_that_reaches_the_stops() -> None:
    numbers = joints.build_joint(joints.load_nominal(), ())
    requested = {"protocol": "step_up_100pct", "mean_bar": 2.1, "difference_bar": 2.1}
    commands = joint_follow_up._build_commands(requested, numbers)
    assert joints.stays_off_stops(numbers, commands)
    assert 0.1e5 < np.ptp(commands[0]) < 2.0e5
