"""Lengths and masses of a model that its size and its devices rule out."""

import pytest

from klute_sim.plausibility.model_numbers import ModelSize, check_model_sizes, check_reach

SIZE = ModelSize(extent=0.8, mass=1.6)


@pytest.mark.parametrize(
    ("name", "value", "part"),
    [
        ("model.site.flexor_origin.pos_z", 290.0, "allowed: up to 8 m (assumed); is it in mm? Write 0.29"),
        ("model.geom.pulley.size_1", 25.0, "is it in mm? Write 0.025"),
        ("model.geom.load.mass", 1000.0, "all bodies of the model together have 1.6 kg"),
        ("model.geom.load.mass", 1e9, "correct it"),
    ],
)
def test_number_in_another_unit_is_found(name: str, value: float, part: str) -> None:
    (finding,) = check_model_sizes({name: value}, SIZE, "trial 'a'")
    assert finding.name == name
    assert part in finding.statement


def test_possible_numbers_are_accepted() -> None:
    numbers = {
        "model.site.flexor_origin.pos_z": -0.29,
        "model.geom.load.mass": 20.0,
        "model.joint.joint.stiffness": 1e4,
        "model.option.gravity_z": -9.81,
    }
    assert check_model_sizes(numbers, SIZE, "trial 'a'") == []
    assert check_model_sizes({"model.geom.load.mass": 5.0}, ModelSize(0.8, 0.0), "trial 'a'") == []


@pytest.mark.parametrize(
    ("path", "effect"), [((300.0, 310.0), "the device cannot reach"), ((0.1, 0.12), "the device never gets taut")]
)
def test_tendon_that_no_device_fits_is_found(path: tuple[float, float], effect: str) -> None:
    (finding,) = check_reach("flexor", path, 0.35, "trial 'a'")
    assert finding.name == "length-geometry"
    assert effect in finding.statement
    assert check_reach("flexor", (0.3, 0.4), 0.35, "trial 'a'") == []
