"""A number that was changed in a copy of a preset keeps no source that belongs to the old value."""

from pathlib import Path

import pytest

from klute_sim.api.device import describe_device
from klute_sim.device.device import list_presets, load_device
from klute_sim.device.outdated_sources import find_outdated_sources
from tests.command_line import run


@pytest.mark.parametrize("name", list_presets())
def test_presets_have_sources_of_their_own(name: str) -> None:
    assert find_outdated_sources(load_device(name).spec) == {}


def write_copy(folder: Path, old: str, new: str) -> Path:
    content = load_device("klute-3-4-pair").content.decode()
    assert content.count(old) == 1
    path = folder / "mine.toml"
    path.write_text(content.replace(old, new), "utf-8")
    return path


def test_source_of_another_value_is_found(tmp_path: Path) -> None:
    path = write_copy(tmp_path, "friction_slope_n_per_bar = 28.0", "friction_slope_n_per_bar = 20.0")
    assert find_outdated_sources(load_device(path).spec) == {"muscle.friction_slope_n_per_bar": 28.0}


def test_assumed_number_stays_assumed(tmp_path: Path) -> None:
    path = write_copy(tmp_path, "gas_temperature_c = 20.0", "gas_temperature_c = 23.0")
    assert find_outdated_sources(load_device(path).spec) == {}


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
