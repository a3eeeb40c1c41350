"""Devices without a muscle: a cylinder, a tendon, and a foot alone."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import klute_sim as ks
from klute_sim.bench.device_only import simulate_device_only
from klute_sim.bench.tester import simulate_tester
from klute_sim.datasets.dataset import load_dataset
from klute_sim.datasets.write import write_trial
from klute_sim.device.backend.packing import pack_parameters, unpack_parameters
from klute_sim.device.device import Device, load_device, parse_device
from klute_sim.device.schema.muscle import Muscle
from klute_sim.diagnosis.fitting.number_error import list_error_candidates
from klute_sim.effects import catalogue
from klute_sim.errors import InputError
from klute_sim.gait.foot_bench import press_foot
from klute_sim.laws import damper, mckibben, tendon
from klute_sim.types import Array
from tests import command_line

CYLINDER = """
[cylinder]
extended_length_mm = 200.0
stroke_mm = 60.0
"""
DAMPER = """
[damper]
bore_mm = 20.0
orifice_concentric_mm = 1.5
orifice_eccentric_mm = 2.0
oil_density_kg_m3 = 850.0
"""
TENDON = """
[tendon]
slack_length_mm = 100.0
stiffness_1_n_per_mm = 50.0
stiffness_2_n_per_mm = 20.0
engagement_mm = 2.0
"""
SUPPLY = """
[supply]
pressure_bar = 8.0
rate_bar_per_s = 1000.0
gas_temperature_c = 20.0
"""
SEAL = """
[effects.seal_friction]
force_n = 12.0
"""
FOOT = """
[foot]
preset = "dynamic-response-medium"
"""
TIME_STEP = 1e-3


def parse(*sections: str) -> Device:
    return parse_device(('name = "part"\n' + "".join(sections)).encode(), "part.toml")


def move(middle: float, amplitude: float) -> Array:
    """Return unit lengths [m] of a sine of 1 Hz, one second at :data:`TIME_STEP`."""
    return np.asarray(middle + amplitude * np.sin(2.0 * np.pi * np.arange(0.0, 1.0, TIME_STEP)))


def pull(device: Device, length: Array, backend: str = "auto") -> Array:
    return simulate_device_only(device, length, np.zeros(len(length)), TIME_STEP, backend=backend)["force"]


DEVICES = {
    "cylinder": ((CYLINDER, SEAL), move(0.17, 0.02)),
    "damper": ((CYLINDER, DAMPER), move(0.17, 0.02)),
    "tendon": ((TENDON,), move(0.102, 0.003)),
    "damper and tendon": ((CYLINDER, DAMPER, TENDON), move(0.27, 0.02)),
    "cylinder and tendon": ((CYLINDER, SEAL, TENDON), move(0.27, 0.02)),
}


@pytest.mark.parametrize("name", DEVICES)
def test_backends_are_bit_identical(name: str) -> None:
    sections, length = DEVICES[name]
    device = parse(*sections)
    assert np.array_equal(pull(device, length, "python"), pull(device, length, "compiled"))
    assert unpack_parameters(pack_parameters(device.parameters)) == device.parameters


@pytest.mark.parametrize("name", DEVICES)
def test_energy_of_the_parts_balances(name: str) -> None:
    sections, length = DEVICES[name]
    fine = np.interp(np.arange(0.0, 1.0, 1e-4), np.arange(0.0, 1.0, TIME_STEP), length)
    recording = simulate_device_only(parse(*sections), fine, np.zeros(len(fine)), 1e-4)
    work = np.trapezoid(np.abs(recording["force"]), dx=1.0) * np.ptp(fine) / len(fine)
    residual = np.cumsum(recording["residual_power"]) * 1e-4
    assert np.abs(residual).max() < 0.01 * work
    assert recording["gas_power"].tolist() == [0.0] * len(fine)


def test_damper_alone_has_the_force_of_its_orifices() -> None:
    device, length = parse(CYLINDER, DAMPER), move(0.17, 0.02)
    speed = np.diff(length, prepend=length[0]) / TIME_STEP
    expected = [damper.force(device.parameters.damper, v) for v in speed.tolist()]
    assert pull(device, length) == pytest.approx(np.array(expected), abs=1e-9)


def test_tendon_alone_has_the_force_of_its_springs() -> None:
    device, length = parse(TENDON), move(0.102, 0.003)
    expected = [tendon.force(device.parameters.tendon, x - 0.1) for x in length.tolist()]
    assert pull(device, length) == pytest.approx(np.array(expected), abs=1e-9)
    assert min(expected) == 0.0


def test_cylinder_without_friction_has_no_force() -> None:
    device = parse(CYLINDER)
    assert np.abs(pull(device, move(0.17, 0.02))).max() == 0.0
    assert mckibben.force(device.parameters.muscle, 5e5, 0.17) == 0.0
    assert mckibben.gas_volume(device.parameters.muscle, 0.17) == 0.0
    assert mckibben.bladder_energy(device.parameters.muscle, 0.17) == 0.0


@settings(max_examples=30, deadline=None)
@given(st.floats(6.0, 5000.0), st.floats(0.01, 0.99))
def test_stops_of_a_cylinder_are_its_stroke_apart(length: float, fraction: float) -> None:
    stroke = max(1.0, min(fraction * length, 2000.0, length - 1.0))
    parameters = parse(f"[cylinder]\nextended_length_mm = {length!r}\nstroke_mm = {stroke!r}\n").parameters
    assert parameters.muscle.resting_length == pytest.approx(1e-3 * length, rel=1e-12)
    assert parameters.muscle.resting_length - mckibben.lock_length(parameters.muscle) == pytest.approx(
        1e-3 * stroke, abs=1e-12
    )


def test_pressure_of_the_supply_reaches_the_seal() -> None:
    seal = (
        "[effects.seal_friction]\nform = 'pressure'\nforce_n = 5.0\ngrowth_per_bar = 0.2\nstiffness_n_per_mm = 50.0\n"
    )
    device, length = parse(CYLINDER, SUPPLY, seal), move(0.17, 0.02)
    vented, pressed = (
        np.ptp(simulate_device_only(device, length, np.full(len(length), pressure), TIME_STEP)["force"])
        for pressure in (0.0, 5e5)
    )
    assert pressed == pytest.approx(2.0 * vented, rel=0.01)


def test_tester_in_mujoco_agrees_with_the_device_alone() -> None:
    device = parse(CYLINDER, DAMPER, TENDON)
    measured = simulate_tester(device, move(0.27, 0.02), np.zeros(1000), TIME_STEP)
    reference = simulate_device_only(device, 1e-3 * measured["length"], np.zeros(1000), TIME_STEP)
    assert measured["force"] == pytest.approx(reference["force"], abs=1e-3)


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        ((SUPPLY,), "no part; add [muscle], or one of [cylinder], [tendon] and [foot]"),
        ((DAMPER, TENDON), "[damper] needs a [muscle] or a [cylinder]; add it, or remove [damper]"),
        ((TENDON, SUPPLY), "[supply] needs a [muscle] or a [cylinder]"),
        ((CYLINDER, "[mounting]\nneutral_muscle_ratio = 0.9\n"), "[mounting] needs a [muscle]"),
        ((CYLINDER, SUPPLY, "[leak]\nconductance_dm3_per_s_bar = 0.1\n"), "[leak] needs a [muscle]"),
        ((CYLINDER.replace("60.0", "200.0"),), "stroke_mm is 200.0 but must be less than extended_length_mm, 200.0"),
        ((TENDON, SEAL), "[effects.seal_friction] acts on the cylinder, but this device has no [cylinder]"),
        ((CYLINDER, "[effects.tendon_slack]\nslack_mm = 1.0\n"), "acts on the tendon"),
        ((CYLINDER, "[effects.laminar_orifice]\ntransition_speed_mm_per_s = 5.0\n"), "acts on the damper"),
        ((CYLINDER, "[effects.pressure_delay]\ndead_time_ms = 5.0\n"), "acts on the muscle"),
    ],
)
def test_parts_that_do_not_fit_together_end_in_one_sentence(sections: tuple[str, ...], message: str) -> None:
    with pytest.raises(InputError) as caught:
        parse(*sections)
    assert message in str(caught.value)


def test_muscle_needs_a_supply_and_no_cylinder() -> None:
    text = load_device("klute-3-4-pair").content.decode()
    supply = text[text.index("[supply]") : text.index("[", text.index("[supply]") + 1)]
    without_supply = text.replace(supply, "")
    with pytest.raises(InputError, match=r"section \[supply\] is missing; a \[muscle\] needs it"):
        parse_device(without_supply.encode(), "file")
    with pytest.raises(InputError, match=r"\[cylinder\] stands in place of \[muscle\]; remove one of them"):
        parse_device((text + CYLINDER).encode(), "file")


@pytest.mark.parametrize(
    ("sections", "expected"),
    [
        ((CYLINDER,), {"seal_friction", "unknown_force"}),
        ((TENDON,), {"tendon_slack", "tendon_stiffening", "tendon_hysteresis", "unknown_tendon_force"}),
        ((FOOT,), set()),
    ],
)
def test_effects_and_numbers_of_absent_parts_are_no_candidates(sections: tuple[str, ...], expected: set[str]) -> None:
    spec = parse(*sections).spec
    candidates = {e.name for e in catalogue.get_effects().values() if e.kind == "device" and spec.can_add_effect(e)}
    assert candidates == expected
    numbers = {key.partition(".")[0] for key in list_error_candidates(spec)}
    assert numbers == ({"tendon"} if sections == (TENDON,) else set())
    with_oil = parse(CYLINDER, DAMPER).spec
    assert with_oil.can_add_effect(catalogue.get_effects()["trapped_air"])


def test_muscle_keeps_all_candidates() -> None:
    spec = load_device("klute-1-2").spec
    assert all(spec.can_add_effect(catalogue.get_effects()[name]) for name in ("hose", "tendon_slack", "trapped_air"))


def test_foot_alone_is_pressed_as_in_a_prosthesis() -> None:
    alone = press_foot(parse(FOOT), "heel")
    mounted = press_foot(load_device("klute-1-1-4-pair").with_foot("dynamic-response-medium"), "heel")
    assert alone.stiffness == mounted.stiffness
    assert alone.loss == mounted.loss
    with pytest.raises(InputError, match=r"nothing that a tester can pull.*describe a foot alone as a \[tendon\]"):
        pull(parse(FOOT), move(0.1, 0.01))
    with pytest.raises(InputError, match="nothing that a tester can pull"):
        ks.simulate_bench(parse(FOOT), "isometric")


def test_bench_dataset_of_a_foot_is_refused_with_the_way_to_describe_it(tmp_path: Path) -> None:
    parse(FOOT).save(tmp_path / "foot.toml")
    header = 'format = "klute-sim-dataset/2"\nrig = "bench"\ndevice = "foot.toml"\n[[trial]]\nfiles = ["a.csv"]\n'
    (tmp_path / "dataset.toml").write_text(header, "utf-8")
    columns = {"time [s]": TIME_STEP * np.arange(1000), "length [mm]": 1e3 * move(0.1, 0.01)}
    write_trial(tmp_path / "a.csv", {**columns, "force [N]": np.sin(np.arange(1000.0))})
    with pytest.raises(InputError) as caught:
        load_dataset(tmp_path, accept=["length-unit"])
    assert f"{tmp_path / 'dataset.toml'}: device 'part' has nothing that a tester can pull" in str(caught.value)
    assert "describe a foot alone as a [tendon]" in str(caught.value)


def test_device_is_built_from_sections_and_saved(tmp_path: Path) -> None:
    device = ks.Device(cylinder=ks.Cylinder(extended_length_mm=200, stroke_mm=60), name="part")
    device.with_effect("seal_friction", force_n=12.0).save(tmp_path / "cylinder.toml")
    loaded = load_device(tmp_path / "cylinder.toml")
    assert loaded.parameters == parse(CYLINDER, SEAL).parameters
    result = command_line.run("device", str(tmp_path / "cylinder.toml"))
    assert "cylinder.stroke_mm" in result.stdout
    assert "Isometric force" not in result.stdout


def test_protocols_run_where_they_apply(tmp_path: Path) -> None:
    parse(TENDON).save(tmp_path / "tendon.toml")
    changes = {"pressures_bar": [0], "unit_lengths_mm": [103], "approach_mm": 2, "concentric_mm_per_s": [5]}
    test = ks.simulate_bench(tmp_path / "tendon.toml", "isokinetic-unit", **{**changes, "eccentric_mm_per_s": []})
    assert test.table[0]["force_n"] == pytest.approx(50.0 * 3.0 + 20.0 * 1.0, rel=1e-3)
    test.plot()
    with pytest.raises(InputError, match=r"has no \[supply\]; allowed: pressures_bar = \[0\]"):
        ks.simulate_bench(tmp_path / "tendon.toml", "isokinetic-unit")
    with pytest.raises(InputError, match="has neither; allowed: a protocol with unit_lengths_mm"):
        ks.simulate_bench(tmp_path / "tendon.toml", "isometric", pressures_bar=[0])
    held = ks.simulate_bench(parse(CYLINDER), "isometric", pressures_bar=[0], muscle_ratios=[0.8, 0.9])
    assert [row["force_n"] for row in held.table] == [0.0, 0.0]


def test_documented_foot_alone_is_a_valid_dataset(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "devices.md").read_text("utf-8")
    blocks = re.findall(r"^```toml\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    (foot,), (dataset,) = ([b for b in blocks if word in b] for word in ("foot on a press", 'device = "foot.toml"'))
    (tmp_path / "foot.toml").write_text(foot, "utf-8")
    (tmp_path / "dataset.toml").write_text(dataset, "utf-8")
    compression = 1e3 * move(0.005, 0.005)
    for name, stiffness in (("forefoot", 60.0), ("heel", 45.0)):
        columns = {"time [s]": TIME_STEP * np.arange(1000), "compression [mm]": compression}
        write_trial(tmp_path / f"{name}_a.csv", {**columns, "force [N]": stiffness * compression})
    for trial in load_dataset(tmp_path).trials:
        length, force = trial.prescribed["length"].value, trial.measured["force"].value
        assert pull(trial.device, length) == pytest.approx(force, abs=1e-6)


def test_documented_cylinder_alone_is_a_valid_dataset(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "devices.md").read_text("utf-8")
    blocks = re.findall(r"^```toml\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    words = ("cylinder on a tester", 'device = "cylinder.toml"')
    (cylinder,), (dataset,) = ([b for b in blocks if word in b] for word in words)
    (tmp_path / "cylinder.toml").write_text(cylinder, "utf-8")
    (tmp_path / "dataset.toml").write_text(dataset, "utf-8")
    time, friction = TIME_STEP * np.arange(1000), 12.0
    stroke = 20.0 - 15.0 * np.cos(2.0 * np.pi * time / time[-1])  # inward at first: the press works against friction
    pressure = 3.0 + 0.1 * np.sin(time)
    load = 51.9 * pressure + friction * np.sign(np.gradient(stroke))
    columns = {"time [s]": time, "stroke [mm]": stroke, "pressure [bar]": pressure, "load [N]": load}
    for number in (1, 2):
        write_trial(tmp_path / f"strokes_{number}.csv", columns)
    for trial in load_dataset(tmp_path).trials:
        length, force = trial.prescribed["length"].value, trial.measured["force"].value
        is_moving = np.abs(np.gradient(length)) > 5e-6
        assert force[is_moving] == pytest.approx(pull(trial.device, length)[is_moving], abs=0.5)
        assert trial.prescribed["pressure_command"].value == pytest.approx(1e5 * pressure, rel=1e-6)


@pytest.mark.parametrize(("sections", "part"), [((CYLINDER, DAMPER), "damper"), ((CYLINDER, SEAL), "cylinder")])
def test_negative_force_without_a_muscle_is_called_that_of_the_part(sections: tuple[str, ...], part: str) -> None:
    velocities = {"concentric_mm_per_s": [20], "eccentric_mm_per_s": [20]}
    lengths = {"muscle_ratios": [], "unit_lengths_mm": [170.0], "approach_mm": 5.0}
    test = ks.simulate_bench(parse(*sections), "isokinetic", pressures_bar=[0], **velocities, **lengths)
    (remark,) = (line for line in test.summary["remarks"] if "negative" in line)
    assert remark.startswith("In 1 of 2 trials a force is negative (minimum -")
    assert remark.endswith(f"the {part} resists a motion that shortens it. Tension is positive.")


def test_trials_without_a_supply_need_no_pressures(tmp_path: Path) -> None:
    parse(CYLINDER).save(tmp_path / "cylinder.toml")
    header = 'format = "klute-sim-dataset/2"\nrig = "bench"\ndevice = "cylinder.toml"\n[[trial]]\nfiles = ["a.csv"]\n'
    (tmp_path / "dataset.toml").write_text(header, "utf-8")
    length = move(0.17, 0.02)
    columns = {
        "time [s]": TIME_STEP * np.arange(1000),
        "length [mm]": 1e3 * length,
        "force [N]": 500.0 * (length - 0.17),
    }
    write_trial(tmp_path / "a.csv", columns)
    assert not load_dataset(tmp_path).trials[0].prescribed["pressure_command"].value.any()
    write_trial(tmp_path / "a.csv", {**columns, "pressure_command [bar]": np.full(1000, 2.0)})
    with pytest.raises(InputError, match=r"there are pressures, but device 'part' has no \[supply\]"):
        load_dataset(tmp_path)


def test_pressure_that_is_not_simulated_is_remarked(tmp_path: Path) -> None:
    """Where the gas pressure is only subtracted, an effect that depends on it cannot be found."""
    parse(CYLINDER).save(tmp_path / "cylinder.toml")
    header = 'format = "klute-sim-dataset/2"\nrig = "bench"\ndevice = "cylinder.toml"\n[columns]\n'
    mapping = 'force = "51.9 * pressure - load [N]"\n[[trial]]\nfiles = ["a.csv"]\n'
    (tmp_path / "dataset.toml").write_text(header + mapping, "utf-8")
    pressure = np.full(1000, 2.0)
    columns = {"time [s]": TIME_STEP * np.arange(1000), "length [mm]": 1e3 * move(0.17, 0.02)}
    write_trial(tmp_path / "a.csv", {**columns, "pressure [bar]": pressure, "load [N]": 51.9 * pressure - 3.0})
    (remark,) = load_dataset(tmp_path).remarks
    assert "the pressure in column 'pressure [bar]' is not simulated" in remark
    parse(CYLINDER, SUPPLY).save(tmp_path / "cylinder.toml")
    mapping = f'pressure_command = "pressure"\n{mapping}'
    (tmp_path / "dataset.toml").write_text(header + mapping, "utf-8")
    assert load_dataset(tmp_path).remarks == ()


def test_muscle_without_actuators_is_no_muscle() -> None:
    """A muscle of the schema has at least one actuator, so that the neutral laws belong to absent muscles only."""
    assert Muscle.model_fields["count"].metadata[0].ge == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sections", "effect", "value"),
    [
        ((CYLINDER, SEAL), "seal_friction", 12.0),
        ((TENDON, "[effects.tendon_hysteresis]\nloss_fraction = 0.2\n"), "tendon_hysteresis", 0.2),
    ],
)
def test_plan_and_diagnosis_find_what_a_part_lacks(
    sections: tuple[str, ...], effect: str, value: float, tmp_path: Path
) -> None:
    parse(*sections).save(tmp_path / "true.toml")
    command_line.run("plan", str(tmp_path / "true.toml"), "--simulate", "--out", str(tmp_path / "data"))
    assert "pressure_command [bar]" not in (tmp_path / "data" / "README.txt").read_text("utf-8")
    parse(*sections[:-1]).save(tmp_path / "data" / "device.toml")
    result = ks.diagnose(tmp_path / "data")
    assert result.verdict == "identified"
    assert [term.name for term in result.effects] == [effect]
    assert next(iter(result.effects[0].parameters.values())).value == pytest.approx(value, rel=0.03)


def test_seal_friction_grows_with_the_speed_of_a_cylinder_and_the_pressure_of_its_supply() -> None:
    """Without a supply there is no pressure in a simulation; beside a muscle, laminar flow of the oil is viscous."""
    seal = catalogue.get_effects()["seal_friction"]
    shapes = ["stribeck", "presliding"]
    forms = {
        "pressed": parse(CYLINDER, SUPPLY).spec.list_candidate_forms(seal),
        "alone": parse(CYLINDER).spec.list_candidate_forms(seal),
        "muscle": load_device("klute-3-4-pair").spec.list_candidate_forms(seal),
    }
    names = {case: [form.name for form in listed] for case, listed in forms.items()}
    assert names == {
        "pressed": ["coulomb", "viscous", *shapes, "pressure"],
        "alone": ["coulomb", "viscous", *shapes],
        "muscle": ["coulomb", *shapes],
    }
