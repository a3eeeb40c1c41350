"""Effects of joints, pulleys and gravity: neutral identity, equal backends, and the physics of each."""

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.datasets.mechanism_channels import parse_channel
from klute_sim.device.device import load_device
from klute_sim.effects import catalogue
from klute_sim.effects.effect import Effect, EffectForm
from klute_sim.effects.families.joint import apply_backlash, tilt_about_x, tilt_about_y
from klute_sim.errors import InputError
from klute_sim.laws.joint import BristleFriction, bristle_level, bristle_stiffness
from klute_sim.mechanism.assembly import Mechanism
from klute_sim.mechanism.simulate import simulate_mechanism
from klute_sim.plant.callbacks import compile_model, device_callbacks, step_model
from klute_sim.plant.joint_friction import compute_friction_force, compute_stretch_rate, pack_friction
from klute_sim.plant.mjcf.model_effects import ModelEffect, apply_model_effects, list_parts, read_joint
from klute_sim.plant.mjcf.model_file import load_model_file

EFFECTS = [effect for effect in catalogue.get_effects().values() if effect.kind == "mechanism"]
MODEL_FORMS = [(effect, form) for effect in EFFECTS if effect.part != "position channel" for form in effect.forms]
PAIR = load_device("klute-3-4-pair")
TIME = np.arange(500) * 1e-3
SWING = np.where(TIME < 0.1, 0.0, 6e4 * np.sin(12.0 * (TIME - 0.1)))
HINGED = {
    "model": "antagonist_joint",
    "channel": "angle_joint",
    "numbers": {f"model.site.{tendon}_origin.pos_z": 0.29 for tendon in ("flexor", "extensor")},
    "inputs": {"pressure_command_flexor": 2e5 + SWING, "pressure_command_extensor": 2e5 - SWING},
}
SLIDING = {
    "model": "hanging_mass",
    "channel": "position_guide",
    "numbers": {},
    "inputs": {"pressure_command_muscle": 2e5 + SWING},
}
HEAVY = 0.0
"""Inverse inertia [1/(kg m2)] of a joint that is so heavy that no bristle is too stiff for it."""
PARTS = {"hinge joint": "joint", "slide joint": "guide", "pulley": "pulley", "rig": None}


def simulate(part: str, *effects: ModelEffect, backend: str = "auto") -> np.ndarray:
    rig = SLIDING if part == "slide joint" else HINGED
    inputs: dict[str, np.ndarray] = rig["inputs"]  # type: ignore[assignment]
    names = [name.removeprefix("pressure_command_") for name in inputs]
    mechanism = Mechanism(load_model_file(str(rig["model"])), tuple(names), tuple(inputs))
    rollout = simulate_mechanism(
        mechanism,
        dict.fromkeys(names, PAIR.parameters),
        inputs,
        1e-3,
        numbers=rig["numbers"],  # type: ignore[arg-type]
        effects=effects,
        backend=backend,
    )
    return rollout.read_channel(mechanism.bind(parse_channel(str(rig["channel"]))))


def make_effect(effect: Effect, form: EffectForm, *, neutral: bool = False) -> ModelEffect:
    values = [p.neutral if neutral and p.neutral is not None else p.typical for p in form.parameters]
    keys = [p.key for p in form.parameters]
    return ModelEffect(effect.name, form.name, tuple(zip(keys, values, strict=True)), PARTS[effect.part])


@pytest.mark.parametrize(("effect", "form"), MODEL_FORMS, ids=lambda x: x.name)
def test_neutral_effect_changes_no_bit_and_backends_agree(effect: Effect, form: EffectForm) -> None:
    plain = simulate(effect.part)
    assert np.array_equal(simulate(effect.part, make_effect(effect, form, neutral=True)), plain)
    changed = simulate(effect.part, make_effect(effect, form))
    assert np.ptp(changed - plain) > 1e-6
    assert np.array_equal(simulate(effect.part, make_effect(effect, form), backend="python"), changed)


@pytest.mark.parametrize("form", ["coulomb", "stribeck", "presliding"])
def test_friction_is_never_more_than_its_level_and_damps(form: str) -> None:
    effect = catalogue.get_effects()["joint_friction"]
    weak, strong = (
        ModelEffect(name, form_name, ((parameters[0][0], moment), *parameters[1:]), part)
        for moment in (0.05, 0.4)
        for name, form_name, parameters, part in [make_effect(effect, effect.find_form(form))]  # type: ignore[arg-type]
    )
    plain, little, much = (np.ptp(simulate("hinge joint", *e)[200:]) for e in ((), (weak,), (strong,)))
    assert much < little < plain


@pytest.mark.parametrize(
    ("effect", "scale", "unit", "joint_type"),
    [("unknown_joint_moment", 1.0, "n_m", "hinge"), ("unknown_guide_force", 0.1, "n", "slide")],
)
def test_data_driven_term_is_its_formula(effect: str, scale: float, unit: str, joint_type: str) -> None:
    """Constant, polynomial from the rest of the spring, and drag oppose the motion as the equation states."""
    position = "angle" if joint_type == "hinge" else "position"
    names = ("constant", position, f"{position}_squared", f"{position}_cubed", "speed", "speed_squared")
    coefficients = (0.4, -0.3, 0.7, 0.2, 0.5, 0.6)
    parameters = tuple((f"{name}_{unit}", value) for name, value in zip(names, coefficients, strict=True))
    spec = mujoco.MjSpec.from_string(
        f"""<mujoco><option gravity="0 0 0"/><worldbody><body><joint name="joint" type="{joint_type}" axis="1 0 0"
        stiffness="2" damping="0.3" springref="0.1" armature="1"/><geom size="0.1" mass="1"/></body></worldbody>
        <compiler angle="radian"/></mujoco>"""
    )
    plain = spec.compile()
    apply_model_effects(spec, [ModelEffect(effect, "sparse", parameters, "joint")])
    changed = compile_model(spec)
    for q, w in [(0.5, 1.5), (-0.4, 1.5), (0.5, -2.0), (-0.4, -2.0), (0.1, 0.0)]:
        moments = []
        for model in (plain, changed):
            data = mujoco.MjData(model)
            data.qpos[0], data.qvel[0] = q, w
            mujoco.mj_forward(model, data)
            moments.append(float(data.qfrc_passive[0] + data.qfrc_actuator[0]))
        x = (q - 0.1) / scale
        expected = sum(c * f for c, f in zip(coefficients, (1.0, x, x**2, x**3, w, w * abs(w)), strict=True))
        assert moments[0] - moments[1] == pytest.approx(expected, abs=1e-9)


@given(
    st.lists(st.floats(-20.0, 20.0), min_size=2, max_size=60),
    st.floats(1e-3, 5.0),
    st.floats(0.0, 3.0),
    st.floats(1e-3, 5.0),
    st.floats(1e-4, 0.3),
)
def test_bristle_is_passive(velocities: list[float], moment: float, excess: float, stribeck: float, d: float) -> None:
    friction = BristleFriction(moment, excess, stribeck, d)
    row, stiffness = pack_friction(friction), bristle_stiffness(friction)
    dt, stretch, work = 1e-5, 0.0, 0.0
    for velocity in velocities:
        for _ in range(20):
            rate = compute_stretch_rate(row, stretch, velocity, HEAVY, dt)
            force = compute_friction_force(row, stretch, rate, velocity, HEAVY, dt)
            assert abs(force) <= 3.0 * bristle_level(friction, 0.0) * (1.0 + 1e-9)
            work -= force * velocity * dt
            stretch += rate * dt
    largest = moment * (1.0 + excess)
    assert work >= 0.5 * stiffness * stretch**2 - 1e-9 * max(1.0, largest)


def test_bristle_is_a_spring_first_and_slides_at_its_level() -> None:
    friction = BristleFriction(0.5, 1.0, 0.1, math.radians(2.0))
    row = pack_friction(friction)

    def push(velocity: float, distance: float) -> float:
        stretch, force, dt = 0.0, 0.0, distance / velocity / 1000.0
        for _ in range(1000):
            rate = compute_stretch_rate(row, stretch, velocity, HEAVY, dt)
            force = compute_friction_force(row, stretch, rate, velocity, HEAVY, dt)
            stretch += rate * dt
        return -force

    small = math.radians(0.02)
    assert push(1e-3, small) == pytest.approx(bristle_stiffness(friction) * small, rel=0.03)
    assert push(0.01, 1.0) == pytest.approx(0.5 * (1.0 + math.exp(-0.01)), rel=1e-3)  # slow: nearly twice as much
    assert push(1.0, 2.0) == pytest.approx(0.5, rel=1e-3)


@pytest.mark.parametrize("form", ["presliding", "stribeck"])
@pytest.mark.parametrize(("force", "presliding", "mass", "dt"), [(200.0, 0.1, 2.0, 2e-3), (1000.0, 0.05, 5.0, 5e-4)])
@pytest.mark.parametrize("backend", ["compiled", "python"])
def test_friction_holds_a_smaller_load_at_any_stiffness(
    force: float, presliding: float, mass: float, dt: float, form: str, backend: str
) -> None:
    spec = mujoco.MjSpec.from_string(
        f"""<mujoco><option gravity="0 0 -9.81" timestep="{dt}"/><worldbody><body><joint name="guide" type="slide"
        axis="1 0 0"/><geom size="0.1" mass="{mass}"/></body></worldbody></mujoco>"""
    )
    shape = {
        "presliding": (("presliding_mm", presliding),),
        "stribeck": (("static_excess", 0.5), ("stribeck_velocity_mm_per_s", 10.0)),
    }[form]
    apply_model_effects(spec, [ModelEffect("guide_friction", form, (("force_n", force), *shape), "guide")])
    model = compile_model(spec)
    data = mujoco.MjData(model)
    data.qfrc_applied[0] = 0.1 * force
    with device_callbacks(backend):
        step_model(model, data, round(2.0 / dt))
    yielding = force * (dt * dt + 2e-3 * dt) / mass  # m, more than the presliding displacement
    assert 0.1 * yielding < data.qpos[0] < 0.3 * yielding
    assert abs(data.qvel[0]) < 1e-4


def test_tilted_pendulum_hangs_along_gravity() -> None:
    spec = load_model_file("antagonist_joint").make_spec()
    apply_model_effects(spec, [ModelEffect("gravity_tilt", "about_y", (("tilt_deg", 5.0),))])
    model = compile_model(spec)
    data = mujoco.MjData(model)
    data.qpos[0] = math.radians(5.0)  # the rig leans towards +x, so the lever hangs in front of it
    mujoco.mj_forward(model, data)
    assert abs(float(data.qfrc_bias[0])) < 1e-9
    gravity = (0.3, -0.2, -9.8)
    p = catalogue.get_effects()["gravity_tilt"].forms[0].pack({"tilt_deg": 30.0})
    for tilt in (tilt_about_x, tilt_about_y):
        assert np.linalg.norm(tilt(p, gravity)) == pytest.approx(np.linalg.norm(gravity))


@pytest.mark.parametrize(
    ("name", "pulley", "joint"), [("antagonist_joint", "pulley", "joint"), ("knee_jig", "knee", "knee")]
)
def test_larger_pulley_has_a_larger_arm_at_every_angle(name: str, pulley: str, joint: str) -> None:
    spec = load_model_file(name).make_spec()
    radius = spec.geom(pulley).size[0]
    apply_model_effects(spec, [ModelEffect("pulley_error", "radius", (("gain", 1.1),), pulley)])
    model = compile_model(spec)
    data = mujoco.MjData(model)
    angles = np.linspace(*model.joint(joint).range, 30)
    lengths = []
    for angle in angles:
        data.qpos[0] = angle
        mujoco.mj_forward(model, data)
        lengths.append(data.ten_length[0])
    assert np.abs(np.diff(lengths) / np.diff(angles)) == pytest.approx(np.full(29, 1.1 * radius), rel=1e-6)


def test_play_follows_late_and_its_loop_is_as_wide_as_the_play() -> None:
    form = catalogue.get_effects()["sensor_backlash"].forms[0]
    time = np.linspace(0.0, 2.0, 4001)
    angle = np.sin(2.0 * np.pi * time)
    reading = apply_backlash(form.pack({"play": 0.4}), time, angle)
    assert np.abs(reading - angle).max() == pytest.approx(0.2, abs=1e-12)
    assert np.ptp(reading[2000:]) == pytest.approx(1.6, abs=1e-5)
    zero_crossings = [3000, 2000]  # of the angle: falling and rising
    assert (reading - angle)[zero_crossings] == pytest.approx([0.2, -0.2], abs=2e-3)
    assert apply_backlash(form.pack({"play": 0.0}), time, angle) is angle


def test_parts_are_listed_and_others_are_refused_in_one_sentence() -> None:
    spec = load_model_file("antagonist_joint").make_spec()
    assert list_parts(spec) == {
        **{"hinge joint": ("joint",), "slide joint": (), "pulley": ("pulley",)},
        "rig": ("",),
    }
    with pytest.raises(InputError, match="'elbow' is no hinge joint of the model; there are: joint"):
        apply_model_effects(spec, [ModelEffect("joint_friction", "coulomb", (("moment_n_m", 1.0),), "elbow")])
    with pytest.raises(InputError, match="'seal_friction' is none of joints, pulleys or gravity"):
        apply_model_effects(spec, [ModelEffect("seal_friction", "coulomb", ())])


def test_written_model_keeps_the_friction(tmp_path: Path) -> None:
    effect = catalogue.get_effects()["joint_friction"]
    spec = load_model_file("antagonist_joint").make_spec()
    friction = make_effect(effect, effect.find_form("presliding"))  # type: ignore[arg-type]
    apply_model_effects(spec, [friction])
    compile_model(spec)
    (tmp_path / "model.xml").write_text(spec.to_xml())
    written = load_model_file(tmp_path / "model.xml").make_spec()
    expected = BristleFriction(0.1, 0.0, 1.0, math.radians(1.0))
    assert read_joint(written, written.joint("joint")).bristle == pytest.approx(expected, rel=1e-5)
