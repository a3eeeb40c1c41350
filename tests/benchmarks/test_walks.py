"""Tests of the gait datasets of the benchmark."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from benchmarks.hidden_effects import catalogue as benchmark
from benchmarks.hidden_effects import plan, sizes, walk_models, walks

from klute_sim.controllers.pressure import load_default_profile
from klute_sim.datasets import dataset as datasets
from klute_sim.device.device import load_device
from klute_sim.effects import catalogue
from klute_sim.gait.body import read_foot
from klute_sim.gait.replay.foot import build_device_foot
from klute_sim.gait.rig.build import build_gait_model
from klute_sim.laws.foot import Foot

pytestmark = pytest.mark.slow

DEVICE = load_device(walks.DEVICE_PRESET)
FOOT = build_device_foot(DEVICE)
IDS = [f"{name}-{form}" for name, form in benchmark.BODY_EFFECTS]


def test_hidden_body_effects_equal_those_of_catalogue() -> None:
    every = [
        (e.name, form.name) for e in catalogue.get_named_effects().values() if e.kind == "body" for form in e.forms
    ]
    assert set(every) - set(benchmark.BODY_EFFECTS) == {("ankle_friction", "both")}  # made of the other two
    assert set(benchmark.BODY_EFFECTS) == set(walk_models.SPEC_EDITS)
    for (name, form), own in benchmark.BODY_EFFECTS.items():
        there = catalogue.find_form(name, form)[1].parameters
        assert {p.key: (p.neutral, p.lower, p.upper, p.typical) for p in there} == {
            key: (p.neutral, p.low, p.high, p.typical) for key, p in own.items()
        }


@pytest.mark.parametrize(("name", "form"), benchmark.BODY_EFFECTS, ids=IDS)
def test_mjcf_edits_agree_with_package(name: str, form: str) -> None:
    own = {key: p.typical for key, p in benchmark.BODY_EFFECTS[name, form].items()}
    edit = walk_models.compose_spec_edits([{"name": name, "form": form, "parameters": own}])
    model = build_gait_model(DEVICE, mass=75.0, stature=1.75, dt=walks.TIME_STEP, model_edit=edit)
    wanted = catalogue.apply_body_effects({(name, form): own}, FOOT)
    if name == "end_stop":
        (bumper,) = (k for k in range(model.ntendon) if model.tendon(k).name == "rubber")
        assert model.tendon_stiffness[bumper] == pytest.approx(wanted.bumper_stiffness)
        assert model.tendon_lengthspring[bumper, 1] == pytest.approx(wanted.bumper_onset_angle)
    elif name == "socket_pistoning":
        assert 1.0 / model.joint("stump").stiffness[0] == pytest.approx(wanted.socket_compliance)
        if form == "damped":
            damping = model.dof_damping[model.joint("stump").dofadr[0]]
            assert damping * wanted.socket_compliance == pytest.approx(wanted.socket_time_constant)
    elif name == "socket_tilt":
        joint, data = model.joint("rocking"), mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        assert 1.0 / joint.stiffness[0] == pytest.approx(wanted.tilt_compliance)
        height = data.xanchor[joint.id, 2] - data.joint("prosthesis_ankle").xanchor[2]
        assert height == pytest.approx(wanted.tilt_height)
        if form == "damped":
            assert model.dof_damping[joint.dofadr[0]] * wanted.tilt_compliance == pytest.approx(
                wanted.tilt_time_constant
            )
    elif name.startswith("foot_"):
        bends_like(model, wanted)
    else:
        assert read_foot(model) == pytest.approx(wanted, rel=1e-9)
        assert read_foot(model) != pytest.approx(FOOT, rel=1e-3)


def test_later_cases_change_no_earlier_walk() -> None:
    """The first walks hide what they did before the later cases existed."""
    specs = plan.plan_datasets("walk", plan.BLOCK_SIZES["walk"], 101)
    hidden = [(spec.get("effects") or spec["instruments"])[0] for spec in specs]
    names = [(effect["name"], effect["form"]) for effect in hidden]
    first = plan.FIRST_GAIT_DATASETS
    assert (first, len(specs)) == (54, 63)
    assert names[:first] == 3 * [case[:2] for case in plan.GAIT_CASES]
    assert names[first:] == 3 * [case[:2] for case in plan.LATER_GAIT_CASES]
    assert (hidden[0]["parameters"], hidden[0]["wanted"]) == ({"moment_n_m": 2.26909}, 2.0)


def bends_like(model: mujoco.MjModel, foot: Foot) -> None:
    """A spring between foot and rocker, all that was the ankle's between rocker and pylon; mass is as it was."""
    data, leaf, compliance = mujoco.MjData(model), model.joint("leaf"), foot.keel_compliance
    ankle, hinge = model.joint("prosthesis_ankle"), model.tendon("hinge").id
    assert 1.0 / leaf.stiffness[0] == pytest.approx(compliance)
    assert leaf.frictionloss[0] == pytest.approx(foot.keel_friction_angle / compliance)
    slow = float(leaf.damping[0]) * compliance
    assert slow == pytest.approx(
        foot.keel_time_constant if foot.keel_time_constant > 2e-3 else walk_models.FOOT_TIME_CONSTANT
    )
    data.qpos[[ankle.qposadr[0], leaf.qposadr[0]]] = 0.2, -0.05
    mujoco.mj_forward(model, data)
    assert data.ten_length[hinge] == pytest.approx(0.15)
    assert model.tendon_stiffness[hinge] == pytest.approx(FOOT.spring_stiffness)
    assert model.tendon_damping[hinge] == pytest.approx(FOOT.ankle_damping)
    assert model.tendon_lengthspring[hinge] == pytest.approx([FOOT.spring_rest_angle, FOOT.spring_rest_angle])
    assert model.tendon_range[hinge] == pytest.approx([FOOT.min_angle, FOOT.max_angle])
    assert model.tendon_solref_lim[hinge] == pytest.approx([FOOT.stop_time_constant, 1.0])
    assert not ankle.stiffness[0]
    whole = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, whole)
    assert whole[ankle.dofadr[0], ankle.dofadr[0]] == pytest.approx(FOOT.inertia)


def test_dataset_is_readable_with_separate_ground_truth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(walks, "GROUP_SPEEDS", {"fit_1": 1.2})
    monkeypatch.setattr(walks, "N_STRIDES", 3)
    monkeypatch.setattr(walks, "TIME_STEP", 1e-3)  # quickly
    given = {"offset": 2.0}
    fault = {"name": "sensor_offset", "form": "offset", "parameters": given, "channel": "ankle_angle", "wanted": 2.0}
    for name, faults in (("plain", []), ("faulty", [fault])):
        walks.make_dataset(tmp_path / name, 5, instruments=faults, truth=tmp_path / f"{name}.truth.json")
    plain, faulty = (datasets.load_dataset(tmp_path / name) for name in ("plain", "faulty"))
    assert plain.rig == "gait"
    assert [trial.group for trial in plain.trials] == ["fit_1", "fit_1"]
    truth = json.loads((tmp_path / "faulty.truth.json").read_text("utf-8"))
    offset = truth["instruments"][0]["parameters"]["offset"]
    assert 2.0 * benchmark.GAIT_CHANNELS["ankle_angle"].noise < offset < 0.4  # the device's numbers follow a part of it
    assert truth["size"] < 0.1  # an error of the registration is the same
    one, other = (each.trials[0].measured["ankle_angle"].value for each in (plain, faulty))
    assert other - one == pytest.approx(np.radians(offset), abs=1e-6)
    assert len({len(trial.prescribed["cop_x"].time) for trial in plain.trials}) == 2  # repeats differ in pace
    assert not list((tmp_path / "faulty").glob("*truth*"))


@pytest.mark.parametrize("has_pistoning", [False, True])
def test_computed_ankle_lacks_the_hidden_pistoning_only(has_pistoning: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(walks, "N_STRIDES", 1)
    monkeypatch.setattr(walks, "TIME_STEP", 1e-3)  # quickly
    compliance = 10.0
    effect = {"name": "socket_pistoning", "form": "axial", "parameters": {"compliance_mm_per_kn": compliance}}
    recording = walks._simulate_gait_trial(DEVICE, load_default_profile(), 1.2, [effect] if has_pistoning else [])
    columns = walks.measure_channels(recording, dict.fromkeys(walks.CHANNEL_NOISE, 0.0), (), np.random.default_rng(0))
    (part,) = (each for each in columns.values() if recording.format_heading("ankle_z") in each)
    time = part["time [s]"]
    deviation = 1e3 * (
        np.interp(time, recording["time"], recording["ankle_z"]) - part[recording.format_heading("ankle_z")]
    )
    load = 1e-3 * np.interp(time, recording["time"], recording["grf_vertical"])
    is_loaded = load > 0.3
    if has_pistoning:  # along the pylon, which is inclined by up to 25 degrees under load
        ratio = deviation[is_loaded] / (compliance * load[is_loaded])
        assert ratio.min() > 0.6
        assert ratio.max() < 1.1
    else:
        assert deviation == pytest.approx(0.0, abs=0.05)


def test_gait_sizes_are_scaled_to_target() -> None:
    own = benchmark.BODY_EFFECTS["end_stop", "bumper"]
    effect = {"name": "end_stop", "parameters": {"stiffness_n_m_per_deg": 4.0, "begin_deg": 6.0}, "wanted": 2.0}
    found = sizes.scale_to_target(effect, own, lambda one: 0.25 * one["parameters"]["stiffness_n_m_per_deg"])
    assert found["parameters"] == {"stiffness_n_m_per_deg": pytest.approx(8.0), "begin_deg": 6.0}
    assert found["size"] == pytest.approx(2.0)


def test_plan_covers_all_cases_and_sizes() -> None:
    specs = plan.plan_datasets("walk", plan.BLOCK_SIZES["walk"], 7)
    every = [(e["name"], e["form"], e.get("channel"), e["wanted"]) for s in specs for e in contents(s)]
    assert sorted(every, key=str) == sorted(
        ((*one, size) for one in (*plan.GAIT_CASES, *plan.LATER_GAIT_CASES) for size in plan.TARGET_SIZES), key=str
    )
    assert not any(contents(spec) for spec in plan.plan_datasets("walk_clean", 3, 7))


def contents(spec: plan.DatasetSpec) -> list[dict[str, object]]:
    return [*spec.get("effects", []), *spec.get("instruments", [])]


def test_lag_agrees_with_catalogue() -> None:
    time = walks.TIME_STEP * np.arange(4000)
    values = np.sin(9.0 * time)
    fault = {"name": "sensor_lag", "parameters": {"time_constant_s": 0.02}}
    form = catalogue.get_effects()["sensor_lag"].forms[0]
    expected = form.laws["reading"](form.parameter_type(0.02), time, values)
    assert walks.apply_fault(values, fault) == pytest.approx(expected, abs=3e-3)
