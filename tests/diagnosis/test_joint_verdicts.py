"""Verdicts on joints with two devices: true names, wrong numbers, and nothing where nothing is missing."""

import json
from pathlib import Path

import pytest

from klute_sim.api.diagnosis import diagnose
from klute_sim.device.device import load_device
from klute_sim.plant.mjcf.model_effects import ModelEffect, read_joint
from klute_sim.plant.mjcf.model_file import load_model_file
from klute_sim.plant.mjcf.model_numbers import collect_model_numbers
from tests.diagnosis import synthetic_joint_dataset as joint
from tests.diagnosis.test_mechanism_diagnosis import PAIR, TRUE_NUMBERS, UNCERTAIN

pytestmark = pytest.mark.slow


def test_friction_of_the_joint_is_named_and_the_model_has_it(tmp_path: Path) -> None:
    truth = ModelEffect("joint_friction", "presliding", (("moment_n_m", 0.15), ("presliding_deg", 2.0)), "joint")
    folder = joint.write_dataset(tmp_path / "data", effects=[truth], true_numbers=TRUE_NUMBERS, uncertain=UNCERTAIN)
    result = diagnose(
        folder, only=["joint_friction", "gravity_tilt", "pulley_error", "sensor_backlash", "braid_hysteresis"]
    )
    assert result.verdict == "identified"
    (effect,) = result.effects
    assert (effect.name, effect.form) == ("joint_friction", "presliding")
    assert effect.parameters["moment_n_m"].value == pytest.approx(0.15, rel=0.1)
    assert "The simulated mechanism lacks joint friction (presliding) of joint." in str(result)
    output = result.save(tmp_path / "out", report=False)
    assert json.loads((output / "verdict.json").read_text())["effects"][0]["part"] == "joint"
    spec = load_model_file(output / "model.xml").make_spec()
    assert read_joint(spec, spec.joint("joint")).bristle.sliding_moment == pytest.approx(0.15, rel=0.1)


def test_bearing_and_seals_that_deform_are_not_told_apart(tmp_path: Path) -> None:
    """Both muscles pull on one pulley, so friction of their seals acts on the joint as that of its bearing does."""
    truth = ModelEffect("joint_friction", "presliding", (("moment_n_m", 0.15), ("presliding_deg", 2.0)), "joint")
    folder = joint.write_dataset(tmp_path / "data", effects=[truth], true_numbers=TRUE_NUMBERS, uncertain=UNCERTAIN)
    result = diagnose(folder, only=["joint_friction", "seal_friction"])
    assert result.verdict == "indistinguishable"
    output = result.save(tmp_path / "out", report=False)
    verdict = json.loads((output / "verdict.json").read_text())
    named = {effect["name"] for effect in verdict["effects"]}
    others = {name.partition("@")[0] for effect_set in verdict["alternatives"] for name in effect_set}
    assert named | others == {"joint_friction", "seal_friction"}


def test_wrong_number_of_the_model_is_named(tmp_path: Path) -> None:
    folder = joint.write_dataset(tmp_path / "data", true_numbers={"model.joint.joint.damping": 0.12})
    result = diagnose(folder, only=["number_error", "pressure_lag", "seal_friction"])
    assert result.verdict == "identified"
    assert [effect.number for effect in result.effects] == ["model.joint.joint.damping"]
    assert "A number of the model is wrong: damping of the joint 'joint'." in str(result)
    output = result.save(tmp_path / "out", report=False)
    numbers = collect_model_numbers(load_model_file(output / "model.xml").make_spec())
    assert numbers["model.joint.joint.damping"] == pytest.approx(0.12, rel=0.15)


def test_effect_of_one_device_is_named_and_files_come_out(tmp_path: Path) -> None:
    truth = {"flexor": PAIR.with_effect("pressure_lag", time_constant_s=0.06)}
    folder = joint.write_dataset(tmp_path / "data", truth=truth, true_numbers=TRUE_NUMBERS, uncertain=UNCERTAIN)
    result = diagnose(folder, only=["pressure_lag", "leak", "regulator_error", "braid_hysteresis", "sensor_lag"])
    assert result.verdict == "identified"
    (effect,) = result.effects
    assert effect.name == "pressure_lag"
    assert effect.parameters["time_constant_s"].value == pytest.approx(0.06, rel=0.03)
    output = result.save(tmp_path / "out")
    verdict = json.loads((output / "verdict.json").read_text())
    assert verdict["effects"][0]["tendon"] == effect.tendon == "flexor"
    assert verdict["gap"]["angle_joint"]["with_effects"] < 1.15 * verdict["gap"]["angle_joint"]["noise_floor"]
    assert "pressure_lag" in load_device(output / "device-flexor.toml").spec.effects
    assert not load_device(output / "device-extensor.toml").spec.effects
    numbers = collect_model_numbers(load_model_file(output / "model.xml").make_spec())
    assert numbers["model.geom.load.mass"] == pytest.approx(1.15, rel=0.02)


def test_nothing_is_missing_where_only_numbers_are_uncertain(tmp_path: Path) -> None:
    folder = joint.write_dataset(tmp_path, true_numbers=TRUE_NUMBERS, uncertain=UNCERTAIN)
    assert diagnose(folder, only=["pressure_lag", "leak", "sensor_gain"]).verdict == "nothing-missing"
