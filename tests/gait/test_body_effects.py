"""Effects of the body: equal numbers in the MJCF and in a replay, and no change at neutral parameters."""

import numpy as np
import pytest

from klute_sim.controllers import pressure
from klute_sim.device.device import Device, load_device, parse_device
from klute_sim.effects import catalogue
from klute_sim.effects.effect import Effect, EffectForm
from klute_sim.gait.replay.foot import build_device_foot
from klute_sim.gait.replay.rollout import ReplayInputs, simulate_replay
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.laws import foot as law
from klute_sim.laws.foot import Foot, FootInputs
from klute_sim.report.effects import text as words

PLAIN = load_device("klute-1-1-4-pair")
FOOT = build_device_foot(PLAIN)
FORMS = [(e, form) for e in catalogue.get_named_effects().values() if e.kind == "body" for form in e.forms]
IDS = [f"{effect.name}-{form.name}" for effect, form in FORMS]
ALL_FORMS = pytest.mark.parametrize(("effect", "form"), FORMS, ids=IDS)
REPLAYED_FORMS = pytest.mark.parametrize(
    ("effect", "form"),
    [
        pytest.param(*pair, id=name, marks=pytest.mark.slow if index % 5 else [])
        for index, (pair, name) in enumerate(zip(FORMS, IDS, strict=True))
    ],
)
"""All forms; four of five are slow."""
STEP = 5e-4


def create_device(effect: Effect, form: EffectForm) -> Device:
    """Return the default device with the effect at its typical parameters."""
    return parse_device(f"{PLAIN.content.decode()}\n{words.format_device_toml(effect, form)}\n".encode(), "with it")


def apply_effect(effect: Effect, form: EffectForm, fraction: float = 1.0) -> Foot:
    values = {}
    for p in form.parameters:
        values[p.key] = p.typical if p.neutral is None else p.neutral + fraction * (p.typical - p.neutral)
    return catalogue.apply_body_effects({(effect.name, form.name): values}, FOOT)


def create_inputs(seconds: float = 0.6) -> ReplayInputs:
    time = np.arange(0.0, seconds, STEP)
    wave = np.sin(2.0 * np.pi * 2.5 * time)
    ground, load = -60.0 * (1.0 - np.cos(8.0 * time)), 500.0 * (1.0 + wave)
    return ReplayInputs(0.3 * wave, -70.0 * wave, 5.0 * wave, 3.0 * wave, ground, load, 100.0 * wave, 3e5 + 0 * time)


@ALL_FORMS
def test_neutral_parameters_change_no_bit(effect: Effect, form: EffectForm) -> None:
    assert apply_effect(effect, form, 0.0)._replace(bumper_onset_angle=0.0) == FOOT
    original, edited_response = (
        simulate_replay(PLAIN.parameters, foot, create_inputs(), STEP)
        for foot in (FOOT, apply_effect(effect, form, 0.0))
    )
    for a, b in zip(original, edited_response, strict=True):
        assert np.array_equal(a, b)


@ALL_FORMS
def test_model_and_replay_have_the_same_foot(effect: Effect, form: EffectForm) -> None:
    """Apply the effect to the model, and read the numbers of the compiled model."""
    assert build_device_foot(create_device(effect, form)) == pytest.approx(apply_effect(effect, form), rel=1e-9)
    assert build_device_foot(create_device(effect, form)) != pytest.approx(FOOT, rel=1e-6)


def replay_gait_run(device: Device, feet: tuple[Foot, ...]) -> list[float]:
    """Return the deviation [deg] of the replay with each of ``feet`` from a gait run of ``device``, rms."""
    recording = simulate_gait(device, pressure.load_default_profile(), GaitOptions(strides=1, dt=STEP, alignment=0.0))

    def differentiate_twice(values: np.ndarray) -> np.ndarray:
        inside = (values[2:] - 2.0 * values[1:-1] + values[:-2]) / STEP**2
        return np.concatenate([inside[:1], inside, inside[-1:]])

    thigh, lean = np.radians(recording["thigh_angle"]), np.radians(recording["shank_angle"])
    # The ankle as markers on the limb see it, without the displacement in the socket of the effect.
    shank = 0.43 - recording["liner_displacement"]
    x = recording["carriage_x"] - 0.43 * np.sin(thigh) - shank * np.sin(lean)
    z = recording["carriage_z"] - 0.43 * np.cos(thigh) - shank * np.cos(lean)
    forward, up = recording["grf_forward"], recording["grf_vertical"]
    ground = -z * forward - np.nan_to_num(recording["cop_x"] - x) * up
    load = up * np.cos(lean) + forward * np.sin(lean), up * np.sin(lean) - forward * np.cos(lean)
    inputs = ReplayInputs(
        lean,
        differentiate_twice(lean),
        differentiate_twice(x),
        differentiate_twice(z),
        ground,
        *load,
        1e5 * recording["pressure_command"],
    )
    late = recording["time"] > 0.3
    return [
        float(
            np.sqrt(
                np.mean(
                    (
                        np.degrees(simulate_replay(PLAIN.parameters, foot, inputs, STEP).ankle_angle)
                        - recording["ankle_angle"]
                    )[late]
                    ** 2
                )
            )
        )
        for foot in feet
    ]


@REPLAYED_FORMS
def test_replay_agrees_with_mujoco(effect: Effect, form: EffectForm) -> None:
    """Replay a gait run: the effect in the equation reproduces the effect in the MJCF."""
    off, without = replay_gait_run(create_device(effect, form), (apply_effect(effect, form), FOOT))
    # The heel spring, which the replay does not have, causes up to 0.03 degrees. The angle at which friction holds the
    # foot in swing, within 0.15 degrees, depends on the last spikes of the load.
    assert off < (0.1 if form.name == "coulomb" and effect.name == "foot_hysteresis" else 0.04)
    assert without > 3.0 * off


@pytest.mark.parametrize("name", [pytest.param("dynamic-response-low", marks=pytest.mark.slow), "sach+shoe"])
def test_replay_agrees_with_mujoco_on_a_prosthetic_foot(name: str) -> None:
    device = PLAIN.with_foot(name)
    off, without = replay_gait_run(device, (build_device_foot(device), FOOT))
    assert off < 0.15
    assert without > 10.0 * off


def simulate_constant_load(foot: Foot, ground_moment: float) -> float:
    """Return the dorsiflexion [rad] of ``foot`` that has rested under 800 N along the pylon and 100 N across it."""
    still = np.zeros(3000)
    inputs = ReplayInputs(still, still, still, still, still + ground_moment, still + 800.0, still + 100.0, still)
    return float(simulate_replay(PLAIN.parameters, foot, inputs, STEP).ankle_angle[-1])


def test_effects_have_the_expected_signs() -> None:
    """Each effect changes the dorsiflexion under a load in the expected direction."""

    def equilibrium_angle(foot: Foot) -> float:
        return simulate_constant_load(foot, -60.0)

    forms = {f"{effect.name} {form.name}": apply_effect(effect, form) for effect, form in FORMS}
    plain = equilibrium_angle(FOOT)
    assert plain > np.radians(10.0)
    assert equilibrium_angle(forms["return_spring_error stiffness"]) < plain
    assert equilibrium_angle(forms["return_spring_error rest"]) > plain
    assert equilibrium_angle(forms["end_stop bumper"]) < plain
    assert equilibrium_angle(forms["moment_arm_error insertion"]) != plain
    assert law.moment_arm(forms["moment_arm_error insertion"], 0.0) == pytest.approx(
        1.05 * law.moment_arm(FOOT, 0.0), rel=1e-3
    )
    assert equilibrium_angle(forms["ankle_friction viscous"]) == pytest.approx(plain, abs=1e-6)
    stuck = equilibrium_angle(forms["ankle_friction coulomb"]) - plain  # within the range that friction can hold
    assert 0.0 < abs(stuck) < 2.0 / FOOT.spring_stiffness
    # The keel bends under the load, and a yielding socket reduces the moment of the load.
    assert equilibrium_angle(forms["foot_stiffness linear"]) - plain == pytest.approx(np.radians(0.05 * 60.0), rel=0.02)
    assert equilibrium_angle(forms["foot_hysteresis viscous"]) == pytest.approx(
        equilibrium_angle(forms["foot_stiffness linear"]), abs=1e-6
    )
    assert equilibrium_angle(forms["foot_hysteresis coulomb"]) == pytest.approx(
        plain + np.radians(0.05 * 57.0), rel=0.02
    )
    assert equilibrium_angle(forms["socket_pistoning axial"]) < plain
    assert equilibrium_angle(forms["socket_pistoning damped"]) == pytest.approx(
        equilibrium_angle(forms["socket_pistoning axial"]), abs=1e-6
    )
    # The pylon leans back by the compliance times the moment, and the load is nearer to the ankle then.
    backward = np.radians(0.03) * (60.0 - 0.33 * 100.0)
    reduced = equilibrium_angle(FOOT) - simulate_constant_load(FOOT, -60.0 + 0.33 * backward * 800.0)
    for form in ("elastic", "damped"):
        assert plain - equilibrium_angle(forms[f"socket_tilt {form}"]) == pytest.approx(reduced, rel=0.01)
    assert forms["inertia_error mass"].inertia == pytest.approx(1.4 * FOOT.inertia)


@ALL_FORMS
def test_body_effects_are_passive(effect: Effect, form: EffectForm) -> None:
    """The energy of a freely swinging foot never increases."""
    foot = apply_effect(effect, form)
    angle, rate, step, still = -0.3, 0.0, 2e-5, FootInputs(0.0, 0.0, 0.0, 0.0, 0.0)
    before = np.inf
    for k in range(10000):
        turned = law.step_ankle(foot, angle, rate, 0.0, still, step)
        angle, rate = turned.angle, turned.velocity
        lift = foot.com_z * np.cos(angle) - foot.com_x * np.sin(angle)
        energy = 0.5 * foot.inertia * rate * rate + 0.5 * foot.spring_stiffness * (angle - foot.spring_rest_angle) ** 2
        energy += (
            foot.mass * law.GRAVITY * lift
            + 0.5 * foot.bumper_stiffness * max(0.0, -angle - foot.bumper_onset_angle) ** 2
        )
        if k % 500 == 0:
            assert energy < before + 1e-3
            before = energy


@pytest.mark.parametrize("form", ["linear", "viscous", "coulomb"])
def test_elastic_foot_is_passive(form: str) -> None:
    """Loops under a moment of 60 N.m at 1 Hz agree with their closed forms."""
    effect, values = next(pair for pair in FORMS if pair[1].name == form and pair[0].name.startswith("foot_"))
    foot, compliance, amplitude, step = apply_effect(effect, values), np.radians(0.05), 60.0, 1e-4
    bent = work = 0.0
    for k in range(30000):
        moment = amplitude * np.sin(2.0 * np.pi * k * step)
        after = law.step_keel_angle(foot, bent, moment, step)
        work += moment * (after - bent) if k >= 20000 else 0.0
        bent = after
    late = 2.0 * np.pi * foot.keel_time_constant
    lost = np.pi * amplitude**2 * late / (1.0 + late * late)
    if form == "coulomb":
        lost += 4.0 * 3.0 * (amplitude - 3.0)
    assert work == pytest.approx(compliance * lost, abs=0.05)
    assert work > (0.0 if form == "linear" else 0.5)


@pytest.mark.parametrize("name", ["socket_pistoning", "socket_tilt"])
def test_damped_socket_is_passive(name: str) -> None:
    """Its loop under a load at 1 Hz has the area of a spring in parallel with a dashpot."""
    effect, form = next(pair for pair in FORMS if pair[0].name == name and pair[1].name == "damped")
    foot, step, still = apply_effect(effect, form), 1e-4, FootInputs(0.0, 0.0, 0.0, 0.0, 0.0)
    compliance, late, amplitude, arm = foot.socket_compliance, foot.socket_time_constant, 800.0, 1.0
    if name == "socket_tilt":
        compliance, late, arm = foot.tilt_compliance, foot.tilt_time_constant, foot.tilt_height
    yielded = work = 0.0
    for k in range(30000):
        load = amplitude * np.sin(2.0 * np.pi * k * step)
        if name == "socket_tilt":
            after = law.step_socket_tilt(foot, yielded, still, load, step)
        else:
            after = law.step_socket_displacement(foot, yielded, still, load, step)
        work += arm * load * (after - yielded) if k >= 20000 else 0.0
        yielded = after
    late *= 2.0 * np.pi
    assert work == pytest.approx(np.pi * compliance * (arm * amplitude) ** 2 * late / (1.0 + late * late), rel=0.01)
    assert work > 0.1


def test_unknown_moment_is_the_stated_sum() -> None:
    """Each function at a dorsiflexion of 7.5 degrees, 50 N.m, 500 N and 2.5 bar, where each input is one half."""
    (form,) = catalogue.get_effects()["unknown_ankle_moment"].forms
    at = -np.radians(7.5), -50.0, 500.0, 2.5e5
    expected = {"offset_n_m": 1.0, "angle_n_m": 0.5, "load_n_m": 0.5, "force_n_m": 0.5, "pressure_n_m": 0.5}
    products = ("angle_squared", "load_squared", "load_angle", "load_force", "pressure_angle")
    expected |= {f"{name}_n_m": 0.25 for name in products}
    assert {p.key for p in form.parameters} == {*expected, "friction_n_m", "damping_n_m_s"}
    for key, factor in expected.items():
        foot = catalogue.apply_body_effects({("unknown_ankle_moment", "sparse"): {key: 8.0}}, FOOT)
        assert law.unknown_moment(foot, *at) == pytest.approx(8.0 * factor), key
        beyond = law.unknown_moment(foot, *(1e6 * value for value in at))
        assert abs(beyond) <= 8.0 * 4.0 + 1e-9
    assert catalogue.apply_body_effects({("unknown_ankle_moment", "sparse"): {}}, FOOT) == FOOT
    rubbing = {"friction_n_m": 2.0, "damping_n_m_s": 3.0}
    foot = catalogue.apply_body_effects({("unknown_ankle_moment", "sparse"): rubbing}, FOOT)
    assert (foot.ankle_friction, foot.ankle_damping) == (2.0 + FOOT.ankle_friction, 3.0 + FOOT.ankle_damping)


def test_unknown_moment_turns_the_ankle_as_a_ground_reaction_does() -> None:
    """A constant one is a part of the load's moment, and of the ankle's own moment."""
    foot = catalogue.apply_body_effects({("unknown_ankle_moment", "sparse"): {"offset_n_m": 8.0}}, FOOT)
    inputs = create_inputs()
    shifted = simulate_replay(PLAIN.parameters, foot, inputs, STEP)
    pushed = simulate_replay(PLAIN.parameters, FOOT, inputs._replace(ground_moment=inputs.ground_moment + 8.0), STEP)
    assert shifted.ankle_angle == pytest.approx(pushed.ankle_angle, abs=1e-12)
    assert shifted.ankle_moment == pytest.approx(pushed.ankle_moment + 8.0)
