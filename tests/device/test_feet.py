"""Section [foot] of a device file: presets, changed numbers, shoes, and one sentence for every mistake."""

from pathlib import Path

import pytest

from klute_sim.datasets.format import compute_standard_deviations
from klute_sim.device.device import Device, load_device, parse_device
from klute_sim.device.schema.foot import HEEL_KEYS, KEEL_KEYS, SHOE_FOREFOOT, SHOE_HEEL, list_feet, read_foot_preset
from klute_sim.errors import InputError
from klute_sim.laws.loading_cycle import CyclicStiffness, in_series

PLAIN = load_device("klute-1-1-4-pair")
TEXT = PLAIN.content.decode()


def parse_foot(lines: str) -> Device:
    return parse_device(f"{TEXT}\n[foot]\n{lines}\n".encode(), "mine.toml")


def parse_error(lines: str) -> str:
    with pytest.raises(InputError) as caught:
        parse_foot(lines)
    assert "mine.toml" in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("name", list_feet())
def test_every_number_of_a_preset_has_a_source(name: str) -> None:
    preset = read_foot_preset(name)
    assert preset["description"].endswith(".")
    assert set(preset.get("sources", {})) == set(preset) - {"description", "sources"}
    assert set(PLAIN.with_foot(name).spec.collect_values()) == set(PLAIN.with_foot(name).spec.sources)


def test_presets_are_complete() -> None:
    categories = [f"dynamic-response-{category}" for category in ("low", "medium", "high")]
    assert set(list_feet()) == {"rigid", "sach", *categories}
    stiffness = [read_foot_preset(name)["forefoot_stiffness_n_per_mm"] for name in categories]
    loss = [read_foot_preset(name)["heel_loss_pct"] for name in categories]
    assert stiffness == sorted(stiffness)
    assert loss == sorted(loss, reverse=True)
    assert all(27.0 <= read_foot_preset(name)["heel_stiffness_n_per_mm"] <= 68.0 for name in (*categories, "sach"))


def test_rigid_foot_changes_no_byte() -> None:
    assert PLAIN.with_foot("rigid") is PLAIN
    assert PLAIN.with_foot("sach").with_foot("rigid").spec.foot is not None
    assert PLAIN.with_foot("sach").with_foot("rigid").spec.foot.is_rigid  # type: ignore[union-attr]


def test_file_of_a_foot_states_it(tmp_path: Path) -> None:
    PLAIN.with_foot("sach+shoe").save(tmp_path / "device.toml")
    foot = load_device(tmp_path / "device.toml").spec.foot
    assert foot is not None
    assert (foot.name, foot.preset, foot.shoe) == ("sach+shoe", "sach", True)


def test_numbers_of_the_section_replace_those_of_the_preset() -> None:
    device = parse_foot('preset = "sach"\nheel_stiffness_n_per_mm = 33')
    values = device.spec.collect_values()
    assert values["foot.heel_stiffness_n_per_mm"] == 33
    assert values["foot.keel_loss_pct"] == read_foot_preset("sach")["keel_loss_pct"]
    assert "foot.heel_stiffness_n_per_mm" in device.spec.list_unsourced_keys()
    assert device.spec.describe_foot()["name"] == "changed sach"
    changed = PLAIN.with_foot("sach").with_changes({"foot.keel_loss_pct": 20.0})
    assert changed.spec.collect_values()["foot.keel_loss_pct"] == 20.0
    assert changed.with_foot("sach").spec.describe_foot()["name"] == "sach"


def test_numbers_are_read_in_their_units() -> None:
    foot = PLAIN.with_foot("dynamic-response-low").spec.foot
    assert foot is not None
    assert foot.get_heel(CyclicStiffness(1.0, 0.0)) == pytest.approx(CyclicStiffness(27e3, 0.5))
    assert foot.get_forefoot() == pytest.approx(CyclicStiffness(28e3, 0.12))


def test_shoe_is_in_series() -> None:
    foot = PLAIN.with_foot("rigid+shoe").spec.foot
    assert foot is not None
    assert foot.get_heel(CyclicStiffness(40e3, 0.1)) == in_series(CyclicStiffness(40e3, 0.1), SHOE_HEEL)
    assert foot.get_forefoot() == SHOE_FOREFOOT
    # Klute, Berge and Segal 2004: a heel that loses 45.3 % loses 63.0 % in a walking shoe.
    assert in_series(CyclicStiffness(40e3, 0.453), SHOE_HEEL).loss == pytest.approx(0.63, abs=0.01)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ('preset = "sash"', "there is no foot 'sash'; did you mean 'sach'?"),
        ('preset = "sach"\ncolour = 1', "unknown key 'foot.colour'"),
        ('preset = "sach"\nshoe = "yes"', "foot.shoe"),
        ("preset = 3", "foot.preset"),
        ("heel_stiffness_n_per_mm = 40", "[foot] lacks heel_loss_pct; allowed: all of"),
        ("keel_lever_mm = 130", "lacks forefoot_stiffness_n_per_mm, keel_loss_pct"),
        ('preset = "sach"\nheel_stiffness_n_per_mm = 40000', "foot.heel_stiffness_n_per_mm = 40000"),
        ('preset = "sach"\nheel_loss_pct = 0.4', "foot.heel_loss_pct = 0.4"),
        ('preset = "sach"\nkeel_loss_pct = 95', "foot.keel_loss_pct = 95"),
        ('preset = "sach"\nkeel_lever_mm = 0.13', "foot.keel_lever_mm = 0.13"),
        ('preset = "sach"\nforefoot_stiffness_n_per_mm = nan', "foot.forefoot_stiffness_n_per_mm"),
    ],
)
def test_mistakes_end_in_one_sentence(lines: str, message: str) -> None:
    assert message in parse_error(lines)


def test_unknown_foot_is_refused() -> None:
    with pytest.raises(InputError, match=r"there is no foot 'sach\+boot'; did you mean 'sach'"):
        PLAIN.with_foot("sach+boot")


def test_feet_are_not_uncertain_numbers_of_a_dataset() -> None:
    values = PLAIN.with_foot("sach").spec.collect_values()
    with pytest.raises(InputError, match="foot_stiffness and foot_hysteresis"):
        compute_standard_deviations({"foot.heel_loss_pct": "10 %"}, values, "dataset.toml")


def test_keys_of_heel_and_keel_are_all_numbers() -> None:
    numbers = {key.removeprefix("foot.") for key in PLAIN.with_foot("sach").spec.collect_values() if "foot." in key}
    assert numbers == {*HEEL_KEYS, *KEEL_KEYS}
