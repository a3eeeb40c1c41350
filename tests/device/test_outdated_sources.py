"""A number that was changed in a copy of a preset keeps no source that belongs to the old value."""

from pathlib import Path

import pytest

from klute_sim.api.device import describe_device, format_description
from klute_sim.device.device import list_presets, load_device
from klute_sim.device.outdated_sources import find_outdated_sources
from tests.command_line import run


@pytest.mark.parametrize("name", list_presets())
def test_presets_have_sources_of_their_own(name: str) -> None:
    assert load_device(name).spec.find_outdated_sources() == {}


def write_copy(folder: Path, old: str, new: str) -> Path:
    content = load_device("klute-3-4-pair").content.decode()
    assert content.count(old) == 1
    path = folder / "mine.toml"
    path.write_text(content.replace(old, new), "utf-8")
    return path


def test_source_of_another_value_is_found(tmp_path: Path) -> None:
    path = write_copy(tmp_path, "friction_slope_n_per_bar = 28.0", "friction_slope_n_per_bar = 20.0")
    assert load_device(path).spec.find_outdated_sources() == {"muscle.friction_slope_n_per_bar": 28.0}


@pytest.mark.parametrize("name", list_presets())
def test_every_changed_number_of_a_copy_loses_its_source(name: str) -> None:
    preset = load_device(name).spec
    sources, values = preset.sources, preset.collect_values()
    assert values.keys() == sources.keys()
    for key, value in values.items():
        assert find_outdated_sources(sources, {**values, key: 1.1 * value}) == {key: value}
    assert find_outdated_sources(sources, {key: 1.1 * value for key, value in values.items()}) == values


def test_source_copied_from_another_preset_than_the_rest_belongs_to_its_value() -> None:
    pair, other = load_device("klute-1-1-4-pair").spec, load_device("klute-3-4-pair").spec
    key = "damper.orifice_concentric_mm"
    sources, values = {**pair.sources, key: other.sources[key]}, pair.collect_values()
    original = other.collect_values()[key]
    assert find_outdated_sources(sources, {**values, key: original}) == {}
    assert find_outdated_sources(sources, {**values, key: 2.0}) == {key: original}


def test_source_of_the_user_is_kept() -> None:
    preset = load_device("klute-1-1-4-pair").spec
    key = "damper.orifice_concentric_mm"
    sources = {**preset.sources, key: "assumed: drilled with a 2 mm bit"}
    assert find_outdated_sources(sources, {**preset.collect_values(), key: 2.0}) == {}


def test_reason_of_another_value_is_no_assumption(tmp_path: Path) -> None:
    spec = load_device(write_copy(tmp_path, "gas_temperature_c = 20.0", "gas_temperature_c = 23.0")).spec
    assert "supply.gas_temperature_c" in spec.list_unsourced_keys()
    assert "supply.gas_temperature_c" not in spec.collect_assumptions()
    assert "supply.dead_volume_cm3" in spec.collect_assumptions()


def test_description_of_a_changed_copy_is_said_to_be_that_of_the_preset(tmp_path: Path) -> None:
    assert describe_device("klute-3-4-pair")["description_of"] is None
    description = describe_device(write_copy(tmp_path, "gas_temperature_c = 20.0", "gas_temperature_c = 23.0"))
    assert description["description_of"] == {"name": "klute-3-4-pair", "changed_numbers": ["supply.gas_temperature_c"]}
    sentence = list(format_description(description))[1]
    assert "the description of preset klute-3-4-pair, but other numbers apply here: supply.gas_temp" in str(sentence)
    own = write_copy(tmp_path, load_device("klute-3-4-pair").spec.description, "Mine.")
    assert describe_device(own)["description_of"] is None


def test_command_says_which_sources_are_those_of_other_values(tmp_path: Path) -> None:
    path = write_copy(tmp_path, "friction_slope_n_per_bar = 28.0", "friction_slope_n_per_bar = 20.0")
    result = run("device", str(path))
    assert result.returncode == 0, result.stderr
    assert "muscle.friction_slope_n_per_bar (for 28)" in result.stdout
    assert "no source given" in result.stdout
    assert "Isometric force of 2 muscles" in result.stdout


def test_published_forces_of_another_muscle_are_not_compared(tmp_path: Path) -> None:
    assert describe_device("klute-3-4")["published"]
    changed = load_device("klute-3-4").with_changes({"muscle.bladder_thickness_mm": 1.5})
    path = tmp_path / "mine.toml"
    path.write_bytes(
        load_device("klute-3-4").content.replace(b"bladder_thickness_mm = 1.6", b"bladder_thickness_mm = 1.5")
    )
    assert load_device(path).spec.collect_values() == changed.spec.collect_values()
    assert describe_device(path)["published"] == []
