"""MJCF files of mechanisms: what is read, what is refused in one sentence, and numbers by name."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from klute_sim.errors import InputError
from klute_sim.plant.mjcf.model_file import MODEL_NAMES, load_model_file
from klute_sim.plant.mjcf.model_numbers import collect_model_numbers, get_number_unit, set_model_numbers, suggest_number

SLIDER = """<mujoco>{extra}<worldbody><site name="top" pos="0 0 0.4"/>
<body name="mass"><inertial mass="2" pos="0 0 0" diaginertia="0.1 0.1 0.1"/><joint name="guide" type="slide"/>
<site name="hook"/></body></worldbody>
<tendon><spatial name="muscle"><site site="top"/><site site="hook"/></spatial></tendon></mujoco>"""


@pytest.mark.parametrize("name", MODEL_NAMES)
def test_shipped_models_compile_and_hold_still_without_devices(name: str) -> None:
    model = load_model_file(name).make_spec().compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert model.ntendon in (1, 2)
    assert np.isfinite(data.qacc).all()


@pytest.mark.parametrize(
    ("name", "joint", "tendon", "arm"),
    [
        ("antagonist_joint", "joint", "flexor", -0.025),
        ("antagonist_joint", "joint", "extensor", 0.025),
        ("knee_jig", "knee", "extensor", -0.03),
    ],
)
def test_pulleys_keep_their_arm_over_the_whole_range(name: str, joint: str, tendon: str, arm: float) -> None:
    model = load_model_file(name).make_spec().compile()
    data = mujoco.MjData(model)
    angles = np.linspace(*model.joint(joint).range, 40)
    lengths = []
    for angle in angles:
        data.joint(joint).qpos[0] = angle
        mujoco.mj_forward(model, data)
        lengths.append(data.ten_length[model.tendon(tendon).id])
    assert np.diff(lengths) / np.diff(angles) == pytest.approx(np.full(39, arm), rel=1e-6)


def test_numbers_are_read_and_changed_by_name() -> None:
    spec = load_model_file("antagonist_joint").make_spec()
    numbers = collect_model_numbers(spec)
    assert numbers["model.geom.load.mass"] == 1.0
    assert numbers["model.joint.joint.damping"] == 0.05
    assert numbers["model.geom.pulley.size_1"] == 0.025
    assert numbers["model.option.gravity_z"] == -9.81
    changes = {"model.geom.load.mass": 2.5, "model.option.gravity_x": 1.5, "model.site.tip.pos_z": -0.2}
    set_model_numbers(spec, changes)
    assert {name: collect_model_numbers(spec)[name] for name in changes} == changes
    model = spec.compile()
    assert model.body("lever").mass[0] == pytest.approx(0.1 + 0.5 + 2.5)
    assert model.opt.gravity.tolist() == [1.5, 0.0, -9.81]


def test_end_of_a_cable_stays_on_the_rim_of_a_larger_pulley() -> None:
    """MuJoCo would not wrap the cable around a pulley that its end lies in."""
    file, sizes = load_model_file("antagonist_joint"), {"model.geom.pulley.size_1": 0.03}
    spec = file.make_spec()
    set_model_numbers(spec, sizes)
    model = spec.compile()
    data = mujoco.MjData(model)
    lengths = []
    for angle in (-0.4, 1.6):
        data.joint("joint").qpos[0] = angle
        mujoco.mj_forward(model, data)
        lengths.append(data.ten_length.copy())
    assert (lengths[1] - lengths[0]) / 2.0 == pytest.approx([-0.03, 0.03], rel=1e-6)
    spec = file.make_spec()
    set_model_numbers(spec, {"model.site.flexor_insertion.pos_x": -0.02, **sizes})  # a stated position is kept
    assert spec.site("flexor_insertion").pos[0] == -0.02


def test_every_number_can_be_set_alone() -> None:
    file = load_model_file("knee_jig")
    for name, value in collect_model_numbers(file.make_spec()).items():
        spec = file.make_spec()
        set_model_numbers(spec, {name: value + 0.01})
        assert collect_model_numbers(spec)[name] == pytest.approx(value + 0.01), name


def test_masses_that_follow_from_geoms_are_no_numbers_of_the_body(tmp_path: Path) -> None:
    (tmp_path / "slider.xml").write_text(SLIDER.format(extra=""))
    numbers = collect_model_numbers(load_model_file(tmp_path / "slider.xml").make_spec())
    assert numbers["model.body.mass.mass"] == 2.0
    assert "model.body.lever.mass" not in collect_model_numbers(load_model_file("antagonist_joint").make_spec())


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        ('<include file="../other.xml"/>', "'../other.xml', which is outside its folder"),
        ('<include file="/etc/passwd"/>', "'/etc/passwd', which is outside its folder"),
        ('<asset><mesh file="../../a.obj"/></asset>', "outside its folder"),
        ('<compiler meshdir="../meshes"/>', "outside its folder"),
        ('<option integrator="RK4"/>', "allowed: Euler, implicit, implicitfast"),
        ("<nonsense/>", "is no model"),
        ("<worldbody>", "is no XML"),
        ('<include file="model.xml"/>', "included twice"),
    ],
)
def test_files_are_refused_in_one_sentence(tmp_path: Path, extra: str, message: str) -> None:
    path = tmp_path / "model.xml"
    path.write_text(SLIDER.format(extra=extra))
    with pytest.raises(InputError) as error:
        load_model_file(path)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_entities_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.xml"
    path.write_text('<!DOCTYPE m [<!ENTITY a "aaaa">]>' + SLIDER.format(extra=""))
    with pytest.raises(InputError, match="document type or entities"):
        load_model_file(path)


def test_includes_inside_the_folder_change_the_digest(tmp_path: Path) -> None:
    path = tmp_path / "model.xml"
    path.write_text(SLIDER.format(extra='<include file="option.xml"/>'))
    (tmp_path / "option.xml").write_text('<mujocoinclude><option gravity="0 0 -1"/></mujocoinclude>')
    first = load_model_file(path)
    assert collect_model_numbers(first.make_spec())["model.option.gravity_z"] == -1.0
    (tmp_path / "option.xml").write_text('<mujocoinclude><option gravity="0 0 -2"/></mujocoinclude>')
    assert load_model_file(path).digest != first.digest


def test_unknown_models_and_numbers_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="did you mean 'knee_jig'"):
        load_model_file("knee_jog")
    spec = load_model_file("knee_jig").make_spec()
    with pytest.raises(InputError, match=r"did you mean 'model\.joint\.knee\.damping'"):
        set_model_numbers(spec, {"model.joint.knee.dampign": 1.0})
    with pytest.raises(InputError, match="finite"):
        set_model_numbers(spec, {"model.joint.knee.damping": float("nan")})


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("model.geom.load.mass", "kg"),
        ("model.body.arm.inertia_x", "kg*m2"),
        ("model.site.tip.pos_z", "m"),
        ("model.geom.pulley.size_1", "m"),
        ("model.option.gravity_z", "m/s2"),
        ("model.tendon.cable.stiffness", "N/m"),
        ("model.joint.elbow.damping", ""),  # of a hinge or a slide
    ],
)
def test_numbers_have_units(name: str, unit: str) -> None:
    assert get_number_unit(name) == unit


def test_unknown_number_is_answered_with_the_nearest() -> None:
    known = collect_model_numbers(load_model_file("antagonist_joint").make_spec())
    answer = suggest_number("model.geom.laod.mass", known)
    assert answer.startswith("did you mean 'model.geom.load.mass', ")
    assert answer.count("model.") == 3
    assert suggest_number("weight", known).startswith(f"allowed: {len(known)} names such as ")
    assert suggest_number("mass of the load", ["a", "b"]) == "allowed: a, b"
    assert suggest_number("xyz.mass", known).count(".mass'") == 3
