"""Looks of the MJCF files: what is there to be seen changes no mass, no contact and no bit of a simulation."""

import mujoco
import numpy as np
import pytest

from klute_sim.plant import models

NAMES = ("ankle", "antagonist_joint", "bench", "gait_rig", "hanging_mass", "knee_jig", "walker")
CONTACT_GROUP = 3
N_STEPS = 300


def load(name: str) -> mujoco.MjSpec:
    return mujoco.MjSpec.from_file(str(models.get_models_folder() / f"{name}.xml"))


def list_looks(spec: mujoco.MjSpec) -> list[mujoco.MjsGeom]:
    """Return the geoms without mass and contact."""
    return [geom for geom in spec.geoms if geom.mass == 0.0 and geom.contype == 0 and geom.conaffinity == 0]


def strip(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Return the model without anything that is only to be seen."""
    looks = [*list_looks(spec), *spec.cameras, *spec.lights]
    for element in looks:
        spec.delete(element)
    for geom in spec.geoms:
        geom.material, geom.group = "", 0
    for element in [*spec.materials, *spec.textures]:
        spec.delete(element)
    return spec.compile()


def simulate(model: mujoco.MjModel) -> list[np.ndarray]:
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    data.ctrl[:] = 0.1
    for _ in range(N_STEPS):
        mujoco.mj_step(model, data)
    return [data.qpos.copy(), data.qvel.copy(), data.qacc.copy(), data.sensordata.copy()]


@pytest.mark.parametrize("name", NAMES)
def test_looks_change_neither_masses_nor_one_bit_of_a_simulation(name: str) -> None:
    shown, stripped = load(name).compile(), strip(load(name))
    assert shown.ngeom > stripped.ngeom
    for field in ("body_mass", "body_inertia", "body_ipos", "body_iquat", "dof_invweight0", "body_invweight0"):
        assert np.array_equal(getattr(shown, field), getattr(stripped, field)), field
    for one, other in zip(simulate(shown), simulate(stripped), strict=True):
        assert one.tobytes() == other.tobytes()


@pytest.mark.parametrize("name", NAMES)
def test_contact_is_hidden_and_only_contact(name: str) -> None:
    model = load(name).compile()
    is_plane = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    touches = ((model.geom_contype | model.geom_conaffinity) != 0) & ~is_plane
    assert np.array_equal(touches, model.geom_group == CONTACT_GROUP)
    assert CONTACT_GROUP >= models.N_VISIBLE_GROUPS


@pytest.mark.parametrize("name", NAMES)
def test_models_open_at_their_size_with_a_camera_from_the_side(name: str) -> None:
    spec = load(name)
    model = spec.compile()
    assert model.camera("side").id >= 0
    assert any(texture.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX for texture in spec.textures)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    seen = (model.geom_group < models.N_VISIBLE_GROUPS) & (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE)
    size = np.ptp(data.geom_xpos[seen], axis=0).max()
    assert size < model.stat.extent < 3.0 * size
    assert np.abs(data.geom_xpos[seen] - model.stat.center).max() < model.stat.extent


def test_a_muscle_at_rest_moves_with_the_origin_of_the_device() -> None:
    from klute_sim.device.device import load_device
    from klute_sim.gait.rig.build import build_gait_model

    for stature in (1.6, 1.9):
        model = build_gait_model(load_device("klute-1-1-4-pair"), mass=70.0, stature=stature, dt=1e-3)
        at_rest = [g for g in range(model.ngeom) if model.geom_group[g] == models.REST_GROUP]
        origin = model.site("prosthesis_achilles_origin").pos
        assert len(at_rest) == 3
        assert all(origin[2] - 0.3 < model.geom_pos[g][2] < origin[2] for g in at_rest)
        assert model.geom("prosthesis_forefoot").pos[2] == pytest.approx(-0.035 * stature / 1.75)


def test_built_models_have_no_keyframes_that_would_not_fit() -> None:
    assert [key.name for key in load("gait_rig").keys] == ["heel_strike", "mid_stance", "push_off", "swing"]
    assert list(models.load_spec("gait_rig").keys) == []


def test_rig_stands_when_a_viewer_opens_its_file_and_its_floor_is_at_0_in_built_models() -> None:
    from klute_sim.device.device import load_device
    from klute_sim.gait.rig.build import build_gait_model

    model = load("gait_rig").compile()
    data = mujoco.MjData(model)
    for n_steps in (0, 1000):
        mujoco.mj_step(model, data, nstep=n_steps)
        mujoco.mj_forward(model, data)
        assert data.ncon > 0
        assert -0.005 < min(contact.dist for contact in data.contact) < 0.0
        assert np.abs(data.qpos[:4]).max() < 0.005  # hip and knee
    assert data.sensor("ground").data[2] > 10.0
    floor = build_gait_model(load_device("klute-1-1-4-pair"), mass=75.0, stature=1.75, dt=1e-3).geom("floor")
    assert floor.pos.tolist() == [0.0, 0.0, 0.0]
    assert floor.sameframe[0] == mujoco.mjtSameFrame.mjSAMEFRAME_BODY


def test_person_stands_when_a_viewer_opens_its_file_and_the_floor_is_at_0_in_built_models() -> None:
    from klute_sim.walker.person.body import load_body
    from klute_sim.walker.person.build import build_walker_model

    model = load("walker").compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert {model.geom(contact.geom2).name.split("_")[1] for contact in data.contact} == {"left", "right"}
    assert -0.005 < min(contact.dist for contact in data.contact) < 0.0
    assert data.sensor("load_left").data[2] == pytest.approx(data.sensor("load_right").data[2])
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert data.ncon > 0
    assert min(contact.dist for contact in data.contact) > -0.015
    floor = build_walker_model(load_body(), None).geom("floor")
    assert floor.pos.tolist() == [0.0, 0.0, 0.0]
    assert floor.sameframe[0] == mujoco.mjtSameFrame.mjSAMEFRAME_BODY


def test_keyframes_of_the_rig_stand_on_the_floor() -> None:
    model = load("gait_rig").compile()
    data = mujoco.MjData(model)
    for index, name in enumerate(("heel_strike", "mid_stance", "push_off", "swing")):
        mujoco.mj_resetDataKeyframe(model, data, index)
        mujoco.mj_forward(model, data)
        depth = min((contact.dist for contact in data.contact), default=1.0)
        assert (depth < 0.0) == (name != "swing"), name
        assert depth > -0.015
