"""Device files with implausible numbers are named, unusual but right ones are accepted."""

import re
from pathlib import Path

import pytest
from benchmarks.robustness.plausibility import device_files
from benchmarks.robustness.plausibility.device_files import DeviceVariant, find_names, write_device

from klute_sim.device.device import list_presets, load_device
from klute_sim.errors import InputError
from klute_sim.plausibility.device_numbers import FACTORS, RANGES, check_device_numbers
from klute_sim.plausibility.finding import ImplausibleInputError

WRONG, RIGHT = list(device_files.list_wrong()), list(device_files.list_right())
ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("variant", WRONG, ids=lambda variant: variant.name)
def test_implausible_numbers_are_named(variant: DeviceVariant, tmp_path: Path) -> None:
    names, message = find_names(variant, tmp_path / "device")
    assert variant.expected in names
    assert f"{variant.expected} = " in message
    unit = re.search(r"\((.+)\)$", variant.name)
    if unit and unit[1] not in ("nothing", "cm", "MPa"):  # several units explain these
        assert re.search(rf"(is it|=.*) in .*{re.escape(unit[1])} \(", message)


@pytest.mark.parametrize("variant", RIGHT, ids=lambda variant: variant.name)
def test_unusual_but_right_numbers_are_accepted(variant: DeviceVariant, tmp_path: Path) -> None:
    assert find_names(variant, tmp_path / "device") == ((), "")


def test_message_names_value_range_reason_unit_and_how_to_accept(tmp_path: Path) -> None:
    variant = DeviceVariant("c10 in 10 Pa", "muscle.c10_kpa", {"muscle.c10_kpa": 11840.0})
    file = write_device(variant, tmp_path / "mine.toml")
    with pytest.raises(ImplausibleInputError) as error:
        load_device(file)
    assert str(error.value) == (
        f"device file {file}: muscle.c10_kpa = 11840, but 5 to 5000 kPa is plausible (soft silicone has 5 kPa, hard "
        "rubber and woven hoses a few thousand (assumed)): is it in Pa (11.8 kPa)? Convert it into kPa. If this is "
        "no mistake, accept it with the line accept = ['muscle.c10_kpa'] above the first section of the file"
    )
    file.write_text("accept = ['muscle.c10_kpa']\n" + file.read_text("utf-8"), "utf-8")
    assert load_device(file).spec.muscle.c10_kpa == 11840.0


def test_numbers_beyond_the_format_get_a_guess_too(tmp_path: Path) -> None:
    file = write_device(WRONG[0], tmp_path / "mine.toml")
    with pytest.raises(
        InputError, match=r"c10_kpa = 118400.* is refused: .*; is muscle\.c10_kpa = 118400 in Pa \(118 kPa\)\?"
    ):
        load_device(file)


def test_accept_names_a_key_of_the_file(tmp_path: Path) -> None:
    file = write_device(RIGHT[0], tmp_path / "mine.toml")
    file.write_text("accept = ['muscle.c10']\n" + file.read_text("utf-8"), "utf-8")
    with pytest.raises(InputError, match=r"'accept' names 'muscle\.c10', which is not a numeric key"):
        load_device(file)


def test_parameter_studies_are_not_checked() -> None:
    device = load_device("klute-3-4-pair").with_changes({"muscle.c10_kpa": 11840.0})
    assert device.spec.muscle.c10_kpa == 11840.0


@pytest.mark.parametrize("name", list_presets())
def test_presets_are_plausible(name: str) -> None:
    assert check_device_numbers(load_device(name).spec.collect_values(), name) == []


def test_every_number_has_a_range() -> None:
    values = load_device("klute-1-1-4-pair-valve").spec.collect_values()
    assert values.keys() - RANGES.keys() == {
        # limited by their schema: counts, ratios and the exponent of air
        *("muscle.count", "muscle.braid_length_ratio", "chamber.exponent", "mounting.neutral_muscle_ratio"),
    }
    assert all(any(key.endswith(end) for end in FACTORS) for key in RANGES if not key.endswith(("_c", "_ratio")))
