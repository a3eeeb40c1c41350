"""Device files: presets are complete and have sources; invalid files are refused in one sentence."""

import re
from pathlib import Path

import pytest

from klute_sim.device.device import DEFAULT_DEVICE, Device, list_presets, load_device, parse_device
from klute_sim.errors import InputError
from klute_sim.laws import mckibben, pneumatic_step

TEXT = load_device("klute-3-4-pair").content.decode()


def parse_error(text: str) -> str:
    with pytest.raises(InputError) as caught:
        parse_device(text.encode(), "mine.toml")
    sentence = str(caught.value)
    assert "mine.toml" in sentence
    assert "\n" not in sentence
    return sentence


@pytest.mark.parametrize("name", list_presets())
def test_every_preset_number_has_a_source(name: str) -> None:
    device = load_device(name)
    assert device.name == name
    assert set(device.spec.collect_values()) == set(device.spec.sources)


def test_presets_are_complete() -> None:
    bare = {"klute-1-1-4", "klute-3-4", "klute-1-2"}
    assert set(list_presets()) == bare | {"klute-3-4-pair", "klute-1-1-4-pair", "klute-1-1-4-pair-valve"}
    assert DEFAULT_DEVICE in list_presets()
    assert all(load_device(n).parameters.tendon.is_rigid and not any(load_device(n).parameters.damper) for n in bare)


def test_assumed_numbers_are_marked() -> None:
    assumed = load_device("klute-1-1-4-pair").spec.collect_assumptions()
    assert {"damper.bore_mm", "tendon.stiffness_1_n_per_mm", "supply.rate_bar_per_s"} <= set(assumed)
    assert "muscle.c10_kpa" not in assumed


def test_units_of_the_keys_become_si() -> None:
    p = load_device("klute-3-4-pair").parameters
    assert p.muscle.resting_length == pytest.approx(0.25)
    assert p.muscle.c10 == pytest.approx(118.4e3)
    assert p.muscle.friction_slope == pytest.approx(28.0 / 1e5)
    assert p.tendon.stiffness_2 == pytest.approx(140e3)
    assert p.supply[:3] == pytest.approx((5e5, 100e5, 293.15))
    assert pneumatic_step.is_ideal(p.supply)
    assert p.damper.concentric_coefficient * 0.3**2 == pytest.approx(1472, rel=2e-3)
    assert p.damper.eccentric_coefficient * 0.15**2 == pytest.approx(400, rel=2e-3)


@pytest.mark.parametrize("radius", [3.0, 7.4, 10.0])
def test_proposed_turns_fit_the_bladder(radius: float) -> None:
    text = TEXT.replace("bladder_radius_mm = 6.4", f"bladder_radius_mm = {radius}")
    with pytest.raises(InputError) as caught:
        parse_device(text.encode(), "x")
    proposal = re.search(r"turns_per_m = [0-9.]+(?= fits the bladder)", str(caught.value))
    assert proposal is not None
    muscle = parse_device(re.sub("turns_per_m = .*", proposal[0], text).encode(), "x").parameters.muscle
    braid_radius = mckibben.compute_braid_radius(muscle.braid_length, muscle.resting_length, muscle.braid_turns)
    assert braid_radius == pytest.approx(1e-3 * radius, rel=1e-3)


def test_friction_slope_is_an_eighth_of_the_gas_force_of_both_actuators() -> None:
    """The documentation proposes this share for muscles of other diameters."""
    for name in ("klute-3-4", "klute-1-1-4"):
        muscle = load_device(name).parameters.muscle
        share = muscle.friction_slope / mckibben.gas_force(muscle, 1.0, muscle.resting_length)
        assert share == pytest.approx(0.125, abs=0.004)


def test_bladder_and_friction_can_be_disabled() -> None:
    text = TEXT.replace("count = 2", "count = 2\nbladder = false\nfriction = false")
    bare = parse_device(text.encode(), "x").parameters.muscle
    assert (bare.c10, bare.c01, bare.friction_slope, bare.friction_offset) == (0, 0, 0, 0)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("bore_mm = 20.0", "bore_mm = 20.0\ncolour = 3", "unknown key 'damper.colour'; allowed here: bore_mm"),
        ("[tendon]", "[tendons]", "unknown key 'tendons'"),
        ("braid_length_ratio = 1.053039", "braid_length_ratio = 1.0", "greater than or equal to 1.001"),
        ("braid_length_ratio = 1.053039", "braid_length_ratio = 0.9", "muscle.braid_length_ratio = 0.9"),
        ("braid_length_ratio = 1.053039", "braid_length_ratio = nan", "muscle.braid_length_ratio"),
        ("bladder_radius_mm = 6.4", "bladder_radius_mm = 7.4", "6.34 mm; the two must agree within 5 %"),
        ("bladder_thickness_mm = 1.6", "bladder_thickness_mm = 6.5", "less than bladder_radius_mm"),
        (
            "bladder_thickness_mm = 1.6",
            "bladder_thickness_mm = 6.3",
            "leaves no room for air; allowed: at most 5.304 mm",
        ),
        ("resting_length_mm = 250.0", "resting_length_mm = -250.0", "greater than or equal to 20"),
        ("resting_length_mm = 250.0", "resting_length_mm = 0.25", "muscle.resting_length_mm = 0.25 is refused"),
        ("pressure_bar = 5.0", "pressure_bar = 60.0", "less than or equal to 20"),
        ("engagement_mm = ", "engagement_mm = 100", "tendon.engagement_mm"),
        ("[muscle]", "[muskel]", "unknown key 'muskel'; did you mean 'muscle'? Allowed here: name"),
        ("[supply]", "[suply]", "unknown key 'suply'; did you mean 'supply'? Allowed here: name"),
        ("resting_length_mm = 250.0", 'resting_length_mm = "long"', "muscle.resting_length_mm = 'long'"),
        ("resting_length_mm = 250.0", "", "key 'muscle.resting_length_mm' is missing"),
        ("count = 2", "count = 0", "greater than or equal to 1"),
        ("count = 2", "count = 1.5", "muscle.count = 1.5"),
        ("orifice_concentric_mm = 1.084", "orifice_concentric_mm = 21.0", "between bore_mm / 1000 and bore_mm, 20"),
        ("pressure_bar = 5.0", "pressure_bar = inf", "'supply.pressure_bar' is inf; allowed: finite numbers"),
        ('"damper.bore_mm" =', '"damper.boar_mm" =', "'damper.boar_mm', which is not a numeric key"),
        ("orifice_eccentric_mm = 1.062", "orifice_eccentric_mm = 1e-9", "between bore_mm / 1000 and bore_mm, 20"),
        ("count = 2", "count = 101", "less than or equal to 100"),
        ("[muscle]", "[muscle", "not valid TOML"),
    ],
)
def test_invalid_file_is_refused_with_key_and_allowed_values(old: str, new: str, message: str) -> None:
    assert old in TEXT
    assert message in parse_error(TEXT.replace(old, new, 1))


def test_thickest_bladder_that_the_error_allows_leaves_a_hundredth_of_the_braid_to_the_air() -> None:
    device = load_device("klute-3-4-pair")
    with pytest.raises(InputError, match="leaves no room for air") as refused:
        device.with_changes({"muscle.bladder_thickness_mm": 6.3})
    largest = float(re.findall(r"at most ([0-9.]+) mm", str(refused.value))[0])
    muscle = device.with_changes({"muscle.bladder_thickness_mm": largest}).parameters.muscle
    at_rest = muscle.resting_length
    share = mckibben.gas_volume(muscle, at_rest) / mckibben.braid_volume(muscle, at_rest)
    assert share == pytest.approx(0.01, abs=2e-4)
    with pytest.raises(InputError, match="leaves no room for air"):
        device.with_changes({"muscle.bladder_thickness_mm": largest + 0.01})


def test_unknown_device_lists_the_presets(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="klute-1-1-4-pair"):
        load_device("klute-9")
    with pytest.raises(InputError, match="cannot be read: Is a directory"):
        load_device(tmp_path)
    with pytest.raises(InputError, match="cannot be read: File name too long"):
        load_device("x" * 300)
    (tmp_path / "x.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="cannot be read"):
        load_device(tmp_path / "x.toml")


def test_byte_order_mark_and_line_ends_are_preserved() -> None:
    content = b"\xef\xbb\xbf" + TEXT.replace("\n", "\r\n").encode()
    device = parse_device(content, "x")
    assert device.parameters == load_device("klute-3-4-pair").parameters
    assert device.content == content


def test_digest_depends_on_the_content() -> None:
    assert load_device("klute-3-4").digest != load_device("klute-1-2").digest
    assert parse_device(TEXT.encode(), "a").digest == parse_device(TEXT.encode(), "b").digest


def test_file_of_the_first_format_names_the_keys_to_rename() -> None:
    text = load_device("klute-1-1-4-pair-valve").content.decode()
    text = text.replace('command = "pressure"', 'takes = "pressure"')
    text = text.replace("thermal_time_constant_s = 0.3", "warming_s = 0.3")
    message = parse_error(text)
    assert "has the first format; rename valve.takes to valve.command, chamber.warming_s to" in message


def test_changes_and_effects_give_a_new_device_with_sources(tmp_path: Path) -> None:
    device = load_device("klute-1-1-4-pair")
    assert device.with_changes({}) is device
    other = device.with_changes({"muscle.resting_length_mm": 150.0}, name="mine")
    assert (other.name, other.spec.description, other.spec.published) == ("mine", "", [])
    assert other.spec.muscle.resting_length_mm == 150.0
    assert device.with_changes({"muscle.resting_length_mm": 150.0}).spec.published == device.spec.published
    changed = device.with_changes({"tendon.stiffness_1_n_per_mm": 80}, source="a test")
    assert changed.parameters.tendon.stiffness_1 == 80e3
    assert changed.spec.sources["tendon.stiffness_1_n_per_mm"] == "a test"
    with pytest.raises(InputError, match=r"'tendon.stiffness' is not a number of device 'klute-1-1-4-pair'; did you"):
        device.with_changes({"tendon.stiffness": 80.0})
    with pytest.raises(InputError, match=r"a test: device file .* muscle.count = 0 is refused"):
        device.with_changes({"muscle.count": 0}, source="a test")
    effect = changed.with_effect("braid_hysteresis", slope_n_per_bar=8.0, stiffness_n_per_mm=40.0)
    assert effect.spec.effects["braid_hysteresis"] == {"slope_n_per_bar": 8.0, "stiffness_n_per_mm": 40.0}
    with pytest.raises(InputError, match="unknown key 'slope'"):
        device.with_effect("braid_hysteresis", slope=8.0)
    effect.save(tmp_path / "mine.toml")
    assert load_device(tmp_path / "mine.toml") == effect
    assert repr(effect) == "<Device 'klute-1-1-4-pair', effects: braid_hysteresis>"
    assert "<td>tendon.stiffness_1_n_per_mm</td><td>80</td><td>a test</td>" in effect._repr_html_()


def test_device_is_built_from_sections() -> None:
    preset = load_device("klute-1-1-4-pair")
    spec = preset.spec
    device = Device(
        name="mine",
        muscle=spec.muscle,
        damper=spec.damper,
        tendon=spec.tendon,
        supply=spec.supply,
        mounting=spec.mounting,
    )
    assert device.parameters == preset.parameters
    assert parse_device(device.content, "mine") == device
    with pytest.raises(InputError, match=r"\[sources\] refers to 'muscle.colour'"):
        Device(muscle=spec.muscle, supply=spec.supply, sources={"muscle.colour": "red"})
