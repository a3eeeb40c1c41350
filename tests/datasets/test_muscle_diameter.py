"""Devices for muscles of another nominal diameter: geometry, similarity, and what published muscles say."""

from pathlib import Path

import numpy as np
import pytest

from klute_sim.datasets.dataset import load_dataset
from klute_sim.datasets.format import DiameterEntry
from klute_sim.datasets.muscle_diameter import scale_muscle
from klute_sim.device.device import Device, load_device, parse_device
from klute_sim.errors import InputError
from klute_sim.laws import mckibben

TEN_MM = """
name = "10 mm muscle"
[muscle]
resting_length_mm = 200.0
braid_length_ratio = 1.10
turns_per_m = 13.26
bladder_radius_mm = 5.5
bladder_thickness_mm = 1.5
c10_kpa = 400.0
c01_kpa = 400.0
friction_slope_n_per_bar = 2.0
friction_offset_n = 3.0
[supply]
pressure_bar = 7.0
rate_bar_per_s = 1000.0
gas_temperature_c = 20.0
"""


def scale(device: Device, own: str, other: str) -> Device:
    return scale_muscle(device, DiameterEntry(device=own, trials=other), "dataset.toml")[0]


@pytest.fixture
def ten() -> Device:
    return parse_device(TEN_MM.encode(), "10 mm muscle")


@pytest.mark.parametrize(("diameter", "ratio"), [("10 mm", 1.0), ("20 mm", 23.0 / 13.0), ("4 cm", 43.0 / 13.0)])
def test_tension_of_the_gas_grows_with_the_square_of_the_outer_diameter(
    ten: Device, diameter: str, ratio: float
) -> None:
    muscles = ten.parameters.muscle, scale(ten, "10 mm", diameter).parameters.muscle
    for length in (0.2, 0.17):
        small, large = (mckibben.gas_force(muscle, 6e5, length) for muscle in muscles)
        assert large == pytest.approx(ratio**2 * small, rel=1e-9)
    assert muscles[1].bladder_radius == pytest.approx(ratio * muscles[0].bladder_radius, rel=1e-9)
    assert muscles[1].bladder_thickness == muscles[0].bladder_thickness
    assert muscles[1].friction_slope == pytest.approx(ratio**2 * muscles[0].friction_slope, rel=1e-9)
    assert muscles[1].friction_offset == pytest.approx(ratio * muscles[0].friction_offset, rel=1e-9)


def test_there_and_back_is_the_same_muscle(ten: Device) -> None:
    back = scale(scale(ten, "10 mm", "40 mm"), "40 mm", "10 mm")
    assert back.spec.collect_values() == pytest.approx(ten.spec.collect_values(), rel=1e-12)


def test_effects_of_the_device_follow_their_diameter_exponent(ten: Device) -> None:
    device = ten.with_effect("braid_hysteresis", form="coulomb", slope_n_per_bar=4.0).with_effect(
        "passive_tension", form="power", rise_n=500.0, offset_n=30.0
    )
    effects = scale(device, "10 mm", "20 mm").spec.effects
    assert effects["braid_hysteresis"]["slope_n_per_bar"] == pytest.approx(4.0 * (23.0 / 13.0) ** 2)
    assert effects["passive_tension"]["rise_n"] == 500.0  # its law contains the diameter


def test_published_muscles_of_two_diameters(ten: Device) -> None:
    """The tension per pressure of straight muscles of 20 mm over that of muscles of 10 mm of the same source.

    Martens and Boblan (Actuators 6:33, 2017, appendix): 54.9 to 1653.5 N from 0.65 to 6.75 bar, and 32.2 to 542.5 N
    from 0.6875 to 6.5 bar, of 296 and 250 mm. The tool of the maker (as listed in
    Agile-and-Adaptive-Robotics/Bipedal_Robot, FestoLookup_v2.m): 253 to 1515 N and 81.7 to 473.3 N from 1 to 6 bar.
    """
    sources = [
        ((1653.5 - 54.9) / (6.75 - 0.65), (542.5 - 32.2) / (6.5 - 0.6875)),
        ((1515.0 - 253.0) / 5.0, (473.3 - 81.7) / 5.0),
    ]
    muscles = scale(ten, "10 mm", "20 mm").parameters.muscle, ten.parameters.muscle
    large, small = (mckibben.gas_force(muscle, 1e5, 0.2) for muscle in muscles)
    for large_slope, small_slope in sources:
        assert large / small == pytest.approx(large_slope / small_slope, rel=0.06)


@pytest.mark.parametrize(
    ("own", "other", "match"),
    [
        ("10", "20 mm", "not a finite number with a unit"),
        ("10 bar", "20 mm", "unit of the wrong kind"),
        ("10 mm", "20 m", "1 to 300 mm"),
        ("10 mm", "-20 mm", "1 to 300 mm"),
    ],
)
def test_impossible_diameters_are_refused(ten: Device, own: str, other: str, match: str) -> None:
    with pytest.raises(InputError, match=match):
        scale(ten, own, other)


def test_device_without_a_muscle_has_no_diameter() -> None:
    tendon = parse_device(b'name = "t"\n[tendon]\nslack_length_mm = 100\nstiffness_1_n_per_mm = 10\n'
                          b"stiffness_2_n_per_mm = 20\nengagement_mm = 5\n", "t")  # fmt: skip
    with pytest.raises(InputError, match="has none"):
        scale(tendon, "10 mm", "20 mm")


def test_dataset_states_what_it_scales(ten: Device, tmp_path: Path) -> None:
    (tmp_path / "muscle.toml").write_text(TEN_MM, "utf-8")
    time = np.linspace(0.0, 5.0, 100)
    rows = np.column_stack([time, np.full(100, 300.0), np.clip(time - 1.0, 0.0, 3.0), 100.0 * np.clip(time, 0.0, 3.0)])
    np.savetxt(
        tmp_path / "a.csv",
        rows,
        delimiter=",",
        header="time [s],length [mm],pressure_command [bar],force [N]",
        comments="",
    )
    (tmp_path / "dataset.toml").write_text(
        'format = "klute-sim-dataset/2"\nrig = "bench"\ndevice = "muscle.toml"\n'
        '[diameter]\ndevice = "10 mm"\ntrials = "20 mm"\n[[trial]]\nfiles = ["a.csv"]\n'
        '[trial.device]\n"muscle.resting_length_mm" = 300\n',
        "utf-8",
    )
    dataset = load_dataset(tmp_path)
    assert dataset.device.spec.collect_values() == scale(ten, "10 mm", "20 mm").spec.collect_values()
    assert "muscle.bladder_radius_mm 5.5 -> 9.731" in dataset.remarks[0]
    assert "all other numbers are unchanged" in dataset.remarks[0]
    muscle = dataset.trials[0].device.parameters.muscle
    assert (muscle.resting_length, muscle.bladder_radius) == pytest.approx((0.3, 9.7308e-3), rel=1e-4)
    given = load_dataset(tmp_path, dataset.device)  # a device that was found for these trials
    assert given.device.spec.collect_values() == dataset.device.spec.collect_values()
    assert not any("times as wide" in remark for remark in given.remarks)
    assert "is not scaled by [diameter]: it must have the diameter of the muscles in the trials" in given.remarks[0]


def test_presets_without_the_table_are_unchanged() -> None:
    device = load_device("klute-3-4-pair")
    assert scale_muscle(device, None, "dataset.toml") == (device, [])
