"""Tests of the gait environment: rules of Gymnasium, observations, and agreement with the gait rig."""

import math
import subprocess
import sys
import warnings
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import klute_sim  # noqa: F401  (registers)
from klute_sim.controllers import pressure
from klute_sim.device.device import load_device, parse_device
from klute_sim.envs.ankle_gait import AnkleGaitEnv
from klute_sim.envs.ankle_gait_vector import AnkleGaitVectorEnv
from klute_sim.envs.tasks.gait_task import tabulate_reference_ankle
from klute_sim.envs.tasks.instruments import OBSERVATIONS
from klute_sim.envs.tasks.reward import DEFAULT_WEIGHTS, compute_terms
from klute_sim.errors import InputError
from klute_sim.gait.metrics import compute_gait_metrics
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.units import BAR
from tests.gait.reference_files import write_reference_folder

NAME = "klute_sim/AnkleGait-v2"


def make_action(pressure_bar: float) -> np.ndarray:
    return np.array([2.0 * pressure_bar / 5.0 - 1.0], dtype=np.float32)


def run_episode(env: AnkleGaitEnv, controller: pressure.PressureController) -> list[tuple]:
    """Return the steps of an episode under a controller of the gait phase."""
    steps, count = [], env._gait_rig.commands_per_stride
    env.reset(seed=3)
    for k in range(count * env._gait_rig.options.strides):
        steps.append(env.step(make_action(controller.pressure_at((k % count) / count) / BAR)))
        if steps[-1][2]:
            break
    return steps


@cache
def make_default_env() -> AnkleGaitEnv:
    return AnkleGaitEnv(reset_noise=0.0)


@pytest.fixture(scope="module")
def episode() -> list[tuple]:
    return run_episode(make_default_env(), pressure.load_default_profile())


def test_environment_passes_gymnasium_checker() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make(NAME)
        check_env(env.unwrapped, skip_render_check=True)


def test_environment_follows_gymnasium_conventions() -> None:
    env = gymnasium.make(NAME, strides=2)
    assert env.unwrapped.dt == 0.01
    assert env.unwrapped.model.opt.timestep == 5e-4
    first, info = env.reset(seed=7)
    assert first in env.observation_space
    assert info == {}
    again, _ = env.reset(seed=7)
    assert np.array_equal(first, again)
    changed_env, _ = env.reset(seed=8)
    assert not np.array_equal(first, changed_env)
    env.step(env.action_space.sample())
    assert env.unwrapped.data.time == pytest.approx(0.01)


def test_documented_tables_match_spaces_and_weights() -> None:
    text = AnkleGaitEnv.__doc__ or ""
    for number, (name, unit, low, high, noise) in enumerate(OBSERVATIONS):
        assert f"| {number} | {name} | {unit} | {low:g} | {high:g} | {noise:g} |" in text
    for name, weight in DEFAULT_WEIGHTS.items():
        (row,) = [line for line in text.splitlines() if f"``reward_{name}``" in line]
        assert f"{weight:g} " in row


class HeldProfile:
    """The default profile, each of whose commands is held for an action of the environment."""

    def pressure_at(self, phase: float) -> float:
        """Return the pressure [Pa] at the start of the interval; a stride has 110."""
        return pressure.load_default_profile().pressure_at(math.floor(110.0 * phase + 1e-6) / 110.0)

    def describe(self) -> dict[str, Any]:
        """Return the name."""
        return {"kind": "held profile"}


def test_episode_equals_gait_rig_simulation(episode: list[tuple]) -> None:
    # The options of the environment hold the alignment and the learned path of the hip.
    options = replace(make_default_env()._gait_rig.options, strides=3)
    recording = simulate_gait(load_device("klute-1-1-4-pair"), HeldProfile(), options)
    stride = compute_gait_metrics(recording).strides[2]
    infos = [info for *_, info in episode[220:330]]
    # The moment is read every 10 ms.
    peak = max(info["ankle_moment_nm_per_kg"] for info in infos)
    assert peak == pytest.approx(stride.ankle_moment_peak_nm_per_kg, rel=0.01)
    assert sum(info["air_g"] for info in infos) == pytest.approx(stride.air_g, rel=0.01)
    # Energy sampled once per interval is close to that of every step of the gait rig.
    recording = recording.select(recording["stride"] == 3)
    gas = 5e-4 * np.abs(recording["gas_power"]).sum()
    for name in ("gas", "friction", "damper", "delivered"):
        total = sum(info[f"work_{name}_j"] for info in infos)
        assert total == pytest.approx(5e-4 * recording[f"{name}_power"].sum(), abs=0.01 * gas), name
    assert abs(sum(info["work_unresolved_j"] for info in infos)) < 0.01 * gas


@pytest.mark.slow
def test_power_of_an_elastic_foot_is_that_of_the_gait_rig() -> None:
    """Hinge and keel together are the ankle; the hinge, which the encoder reads, has less than two thirds of it."""
    env = AnkleGaitEnv(reset_noise=0.0, strides=2, time_step=1e-3, foot="dynamic-response-low")
    steps = run_episode(env, pressure.load_default_profile())[110:]
    device = load_device("klute-1-1-4-pair").with_foot("dynamic-response-low")
    recording = simulate_gait(device, HeldProfile(), replace(env._gait_rig.options, strides=2))
    peak = max(info["ankle_power_w_per_kg"] for *_, info in steps)
    assert peak == pytest.approx(recording["ankle_power"][1100:].max() / 75.0, rel=0.02)
    hinge_powers = [-info["ankle_moment_nm_per_kg"] * observed[1] for observed, *_, info in steps]
    assert max(hinge_powers) < 0.67 * peak


def test_observations_match_simulation_state() -> None:
    env = AnkleGaitEnv(reset_noise=0.0)
    env.reset(seed=0)
    model, data = env.model, env.data
    observations, states = [], []
    for k in range(110):
        observations.append(env.step(make_action(1.0 + 0.3 * np.sin(k / 9)))[0])
        ankle = model.joint("prosthesis_ankle")
        states.append(
            (
                -data.qpos[ankle.qposadr[0]],
                -data.qvel[ankle.dofadr[0]],
                data.joint("thigh").qpos[0] + data.joint("knee").qpos[0],
                data.joint("thigh").qvel[0] + data.joint("knee").qvel[0],
                data.act[-2],
            )
        )
    assert np.array(observations)[:, [0, 1, 2, 3, 5]] == pytest.approx(np.array(states), abs=1e-5)
    load_cell, step = np.array(observations)[:, 4], np.arange(1, 111)
    # The load cell carries the body in stance, and only weight and inertia of the foot in swing.
    assert load_cell[(step > 10) & (step < 40)].min() > 0.45
    assert load_cell.max() < 1.2
    assert np.abs(load_cell[(step > 75) & (step < 100)]).max() < 0.1


def test_phase_estimate_follows_strides(episode: list[tuple]) -> None:
    later_steps = [(o, info) for o, *_, info in episode[115:]]
    estimate = np.array([np.arctan2(o[6], o[7]) / (2 * np.pi) * 100 % 100 for o, _ in later_steps])
    true = np.array([info["gait_pct"] for _, info in later_steps])
    assert np.abs((estimate - true + 50) % 100 - 50).max() < 4.0  # first contact is 2 % into the stride


def test_reward_is_sum_of_terms_and_prefers_human_ankle(episode: list[tuple]) -> None:
    for _, reward, _, _, info in episode[::17]:
        assert reward == pytest.approx(sum(value for name, value in info.items() if name.startswith("reward_")))
        assert info["reward_moment"] <= DEFAULT_WEIGHTS["moment"]
        assert info["reward_air"] <= 0.0
        assert info["reward_smoothness"] <= 0.0
    returns = {
        name: sum(reward for _, reward, *_ in run_episode(AnkleGaitEnv(reset_noise=0.0), controller))
        for name, controller in (
            ("off", pressure.create_off_controller()),
            ("constant", pressure.ConstantPressure(3e5)),
        )
    }
    assert sum(reward for _, reward, *_ in episode) > 1.2 * returns["off"] > 1.2 * returns["constant"]


def test_reward_terms_match_their_definitions(episode: list[tuple]) -> None:
    reference = GaitOptions().reference
    for observed, _, _, _, info in episode[30:500:47]:
        phase = np.array([info["gait_pct"] / 100])
        human_moment = reference("ankle_plantarflexor_moment_nm_per_kg", phase)[0]
        moment_error = (info["ankle_moment_nm_per_kg"] - human_moment) / 0.2
        assert info["reward_moment"] == pytest.approx(0.4 * np.exp(-(moment_error**2) / 2))
        # The encoder measures the hinge; the angle to the limb contains the alignment.
        angle = np.degrees(observed[0] + make_default_env()._gait_rig.options.alignment)
        angle_error = (angle - reference("ankle_dorsiflexion_deg", phase)[0]) / 5.0
        assert info["reward_angle"] == pytest.approx(0.3 * np.exp(-(angle_error**2) / 2), abs=1e-4)
        power_error = (info["ankle_power_w_per_kg"] - reference("ankle_power_w_per_kg", phase)[0]) / 0.5
        assert info["reward_power"] == pytest.approx(0.3 * np.exp(-(power_error**2) / 2))
        assert info["ankle_power_w_per_kg"] == pytest.approx(-info["ankle_moment_nm_per_kg"] * observed[1], abs=1e-4)
        assert info["reward_air"] == pytest.approx(-0.1 * info["air_g"] * 10)
        human_power = reference("ankle_power_w_per_kg", np.arange(0.0, 1.0, 1 / 110))
        push_power = max(min(info["ankle_power_w_per_kg"], reference("ankle_power_w_per_kg", phase)[0]), 0.0)
        assert info["reward_work"] == pytest.approx(0.1 * push_power / np.maximum(human_power, 0.0).mean(), rel=1e-6)


def test_load_and_braking_are_costed_up_to_a_limit() -> None:
    """Four samples under a reference load of one body weight: right, light, a slam with braking, and far off."""
    zeros, ones = np.zeros(4), np.ones(4)
    ankle = np.zeros((4, 3))
    reaction = np.array([[0.1, 1.0], [-0.2, 0.8], [-0.3, 1.5], [-9.0, 9.0]])
    terms = compute_terms(ankle, ankle, ones, zeros, zeros, reaction, ones)
    assert terms[:, 6] == pytest.approx([0.0, 0.04, 0.25, 1.0])
    assert terms[:, 7] == pytest.approx([0.0, 0.0, 0.01, 0.04])


def test_reward_option_replaces_weights() -> None:
    default_env, changed_env = AnkleGaitEnv(strides=1), AnkleGaitEnv(strides=1, reward={"air": -1.0, "work": 0.0})
    default_env.reset(seed=1)
    changed_env.reset(seed=1)
    for k in range(110):
        default_info, changed_info = (env.step(make_action(k % 9 * 0.5))[4] for env in (default_env, changed_env))
        assert changed_info["reward_air"] == pytest.approx(10.0 * default_info["reward_air"])
        assert changed_info["reward_work"] == 0.0
        assert changed_info["reward_moment"] == default_info["reward_moment"]
    assert default_info["air_g"] >= 0.0
    with pytest.raises(InputError, match="reward has no term 'speed'; allowed: moment, angle, power, work, air"):
        AnkleGaitEnv(reward={"speed": 1.0})
    with pytest.raises(InputError, match="weight of air is nan"):
        AnkleGaitEnv(reward={"air": np.nan})


@pytest.mark.parametrize("action_value", [-7.0, 1.5, 1e30, -1e300])
def test_action_out_of_range_is_clipped(action_value: float) -> None:
    env = AnkleGaitEnv()
    env.reset(seed=0)
    info = env.step(np.array([action_value]))[4]
    assert info["pressure_command_bar"] == (5.0 if action_value > 0 else 0.0)


def test_invalid_input_raises_one_sentence() -> None:
    env = AnkleGaitEnv()
    env.reset(seed=0)
    before = env.data.qpos.copy()
    for invalid_action, message in ((np.array([np.nan]), "contains nan"), (np.zeros(2), "shape")):
        with pytest.raises(InputError, match=message):
            env.step(invalid_action)
    assert np.array_equal(env.data.qpos, before)
    for options, message in (
        ({"time_step": 3e-4}, "divisors of 10 ms"),
        ({"mass": 500.0}, "mass is 500"),
        ({"render_mode": "ansi"}, "render_mode is 'ansi'"),
        ({"device": "nothing"}, "no device 'nothing'"),
        ({"backend": "fast"}, "backend is 'fast'"),
    ):
        with pytest.raises(InputError, match=message):
            AnkleGaitEnv(**options)


@pytest.mark.parametrize("backend", ["compiled", "python"])
def test_failed_device_ends_episode(backend: str) -> None:
    env = AnkleGaitEnv(backend=backend, strides=1)
    env.reset(seed=0)
    env.data.act[env._gait_rig.actuator.act_address] = np.nan
    observed, reward, terminated, truncated, _ = env.step(make_action(1.0))
    assert terminated
    assert not truncated
    assert reward == 0.0
    assert observed in env.observation_space
    env.reset()
    assert not env.step(make_action(1.0))[2]


def test_leaving_the_path_ends_episode() -> None:
    env = AnkleGaitEnv()
    env.reset(seed=0)
    env.data.qpos[1] += 0.5
    assert env.step(make_action(1.0))[2]


def test_backends_are_bit_identical() -> None:
    observations = []
    for backend in ("compiled", "python"):
        env = AnkleGaitEnv(backend=backend, strides=1)
        env.reset(seed=4)
        observations.append(np.array([env.step(make_action(k % 7 * 0.8))[0] for k in range(110)]))
    assert np.array_equal(*observations)


@pytest.mark.parametrize(("context", "count"), [("fork", 2), pytest.param("spawn", 1, marks=pytest.mark.slow)])
def test_environment_runs_in_worker_processes(context: str, count: int) -> None:
    if sys.platform == "win32" and context == "fork":
        pytest.skip("needs fork")
    async_envs = gymnasium.make_vec(NAME, count, "async", vector_kwargs={"context": context}, strides=1, time_step=1e-3)
    vector_env = gymnasium.make_vec(NAME, count, "vector_entry_point", strides=1, time_step=1e-3)
    assert np.array_equal(async_envs.reset(seed=2)[0], vector_env.reset(seed=2)[0])
    for k in range(20):
        actions = np.full((count, 1), k / 20, dtype=np.float32)
        assert np.array_equal(async_envs.step(actions)[0], vector_env.step(actions)[0])
    async_envs.close()


@pytest.mark.parametrize(
    "order",
    [
        "import gymnasium, klute_sim",
        "import klute_sim; import gymnasium",
        "import importlib.util as u, klute_sim; assert u.find_spec('gymnasium'); import gymnasium",
    ],
)
def test_registration_is_independent_of_import_order(order: str) -> None:
    code = f"{order}; print(gymnasium.spec({NAME!r}).id)"
    completed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert completed.stdout.strip() == NAME
    assert completed.stderr == ""


def test_package_import_is_light() -> None:
    code = (
        "import sys, klute_sim, klute_sim.cli\n"
        "print([m for m in ('gymnasium', 'mujoco', 'numba', 'numpy', 'scipy') if m in sys.modules])"
    )
    completed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert completed.stdout.strip() == "[]"


def test_opening_device_takes_openings() -> None:
    text = load_device("klute-1-1-4-pair-valve").content.decode()
    text = text.replace('command = "pressure"\ngain_per_bar = 5.0\n', 'command = "opening"\n')
    device = parse_device(text.replace('"valve.gain_per_bar" =', "#").encode(), "opens")
    env = AnkleGaitEnv(device=device, reset_noise=0.0)
    env.reset(seed=0)
    pressures = []
    for opening in (1.0, 0.0, -1.0):
        for _ in range(5):
            _, _, _, _, info = env.step(np.array([opening], dtype=np.float32))
            assert info["valve_command"] == opening
            assert "pressure_command_bar" not in info
            assert (info["air_g"] > 0.0) == (opening > 0.0)
        pressures.append(float(env.data.act[env._gait_rig.actuator.act_address]))
    assert pressures[0] > 1.5
    assert pressures[1] == pytest.approx(pressures[0], rel=0.3)  # closed: only motion and cooling move it
    assert pressures[2] < 0.8 * pressures[1]


@pytest.mark.slow
def test_imported_subject_gives_stride_time_mass_and_the_human_ankle_of_the_reward(tmp_path: Path) -> None:
    folder = write_reference_folder(tmp_path / "me", mass=62.0, stature=1.66, stride_time=1.2, load_ratio=1.2)
    single = AnkleGaitEnv(reference=folder, strides=1, time_step=1e-3)
    vector = AnkleGaitVectorEnv(2, reference=folder, strides=1, time_step=1e-3)
    assert single.spec is None or single.spec.max_episode_steps == 120
    options = single._gait_rig.options
    assert (options.mass, options.stature, options.reference.stride_time) == (62.0, 1.66, 1.2)
    human = tabulate_reference_ankle(single._gait_rig)
    default = tabulate_reference_ankle(AnkleGaitEnv(stride_time=None, time_step=1e-3)._gait_rig)
    assert human[:, 0].max() == pytest.approx(1.2 * default[:, 0].max(), rel=1e-3)
    observation, _ = single.reset(seed=3)
    observations, _ = vector.reset(seed=3)
    assert np.array_equal(observations[0], observation)
    for _ in range(20):
        step, steps = single.step(np.zeros(1, dtype=np.float32)), vector.step(np.zeros((2, 1), dtype=np.float32))
        assert np.array_equal(steps[0][0], step[0])
        assert steps[1][0] == step[1]
    given = AnkleGaitEnv(reference=folder, mass=70.0, stature=1.7, stride_time=1.0, time_step=1e-3)._gait_rig.options
    assert (given.mass, given.stature, given.reference.stride_time) == (70.0, 1.7, 1.0)
    with pytest.raises(InputError, match="a stride time requires a reference file"):
        AnkleGaitEnv(stride_time=1.0)
