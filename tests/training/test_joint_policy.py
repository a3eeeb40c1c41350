"""Tests of policies of the joint: configuration, comparison with PID, file, and the shipped learned baseline.

The tests of a training require the extra 'rl'.
"""

import json
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from klute_sim.cli.train import command
from klute_sim.controllers.policy import Policy, load_policy
from klute_sim.envs.antagonist_joint import AntagonistJointEnv
from klute_sim.envs.antagonist_joint_vector import AntagonistJointVectorEnv
from klute_sim.envs.joint_pid import PidController
from klute_sim.envs.joint_policy import load_joint_policy
from klute_sim.errors import InputError
from klute_sim.gait.code_digest import compute_code_digest, compute_policy_digest
from klute_sim.training import config, training
from klute_sim.training.environments import TRAINING_ENVIRONMENTS, Act
from klute_sim.training.evaluate import compare_with_baseline, run_episodes
from tests.command_line import run

JOINT = TRAINING_ENVIRONMENTS["joint"]
SHORT: dict[str, Any] = {"duration": 0.5, "time_step": 1e-3, "n_jobs": 1}


def make_policy(**metadata: Any) -> Policy:
    rng = np.random.default_rng(4)
    sizes = [(5, 6), (2, 5)]
    layers = [(rng.normal(size=s).astype(np.float32), rng.normal(size=s[0]).astype(np.float32)) for s in sizes]
    scale = np.array(JOINT.observation_scale, np.float32)
    metadata = {"environment": JOINT.id, "config": {"environment": {}}} | metadata
    return Policy(scale, layers, "tanh", tanh_output=False, metadata=metadata)


def test_command_offers_every_environment() -> None:
    (option,) = [parameter for parameter in command.params if parameter.name == "env"]
    assert list(option.type.choices) == list(TRAINING_ENVIRONMENTS)  # type: ignore[attr-defined]


def test_default_configuration_of_the_joint_is_valid() -> None:
    configuration, content = config.load_config(None, "joint")
    assert configuration.training_environment is JOINT
    assert run("train", "--env", "joint", "--show-config").stdout == content.decode()
    with pytest.raises(InputError, match="the environment 'joint' takes no 'action'; allowed: device, duration"):
        config.parse_config(content.replace(b"duration = 5.0", b'action = "residual"'), "mine")


@pytest.mark.parametrize(
    ("option", "keyword"),
    [("--mass", "mass"), ("--speed", "speed"), ("--slope", "slope"), ("--foot", "foot"), ("--reference", "reference")],
)
def test_joint_has_no_subject(option: str, keyword: str, tmp_path: Path) -> None:
    value = {"--foot": "sach", "--reference": "me", "--mass": "70"}.get(option, "1")
    refused = run("train", "--env", "joint", option, value, cwd=tmp_path)
    assert refused.returncode == 2
    assert f"the subject: the environment 'joint' takes no '{keyword}'; allowed: device, duration" in refused.stderr
    assert len(refused.stderr.splitlines()) == 1
    assert not (tmp_path / "runs").exists()


def test_pid_controller_equals_the_baseline() -> None:
    equal = compare_with_baseline(JOINT, PidController().act, SHORT, 3, 0)
    assert equal["baseline_name"] == "PID controller"
    assert equal["policy"] == equal["baseline"]
    assert equal["gain"] == equal["n_better_episodes"] == 0
    worse = compare_with_baseline(JOINT, lambda observed: np.ones((len(observed), 2), np.float32), SHORT, 3, 0)
    assert worse["baseline"] == equal["baseline"]
    assert worse["n_better_episodes"] == 0
    assert worse["policy"]["rms_angle_error_deg"] > 3.0 * worse["baseline"]["rms_angle_error_deg"]
    terms = sum(value for name, value in worse["policy"].items() if name.startswith("reward_"))
    assert terms == pytest.approx(worse["policy"]["return"])


def run_single_episode(policy: Policy, seed: int) -> tuple[float, float]:
    """Return the return and the root mean square error of the angle [deg] of an episode."""
    env = AntagonistJointEnv(duration=SHORT["duration"], time_step=SHORT["time_step"])
    observation, _ = env.reset(seed=seed)
    total, errors, ended = 0.0, [], False
    while not ended:
        observation, reward, terminated, truncated, info = env.step(policy(observation))
        total, ended = total + reward, terminated or truncated
        errors.append(info["angle_error_deg"])
    return total, float(np.sqrt(np.mean(np.square(errors))))


def test_policy_acts_on_one_joint_as_on_many(tmp_path: Path) -> None:
    make_policy().save(tmp_path / "policy.npz")
    policy = load_joint_policy(tmp_path / "policy.npz")
    assert policy(np.zeros(6)).shape == (2,)
    assert policy(np.zeros((3, 6))).shape == (3, 2)
    many = run_episodes(JOINT, policy, SHORT, 2, 0)
    for index in range(2):
        total, error = run_single_episode(policy, 10**12 + index)
        # A matrix product of several rows may round differently.
        assert many["return"][index] == pytest.approx(total, rel=1e-3)
        assert many["rms_angle_error_deg"][index] == pytest.approx(error, rel=1e-3)


def compute_mean_squared_error(policy: Act, **options: Any) -> float:
    envs = AntagonistJointVectorEnv(4, **{**SHORT, "duration": 2.0, **options})
    observations, _ = envs.reset(seed=7)
    errors = []
    for _ in range(200):
        observations, *_, info = envs.step(policy(observations))
        errors.append(info["angle_error_deg"])
    envs.close()
    return float(np.mean(np.square(errors)))


@pytest.mark.slow
def test_learned_baseline_follows_the_target_better_than_pid() -> None:
    policy = load_joint_policy()
    assert compute_mean_squared_error(policy) < 0.2 * compute_mean_squared_error(PidController().act)
    heavier = compute_mean_squared_error(policy, load=2.0)
    assert heavier > 2.0 * compute_mean_squared_error(policy)  # it was trained with 1 kg and has no integral part
    assert heavier < compute_mean_squared_error(PidController().act, load=2.0)


def test_learned_baseline_states_its_training() -> None:
    metadata = load_joint_policy().metadata
    configuration = config.load_config(None, "joint")[0].model_dump()
    assert metadata["environment"] == JOINT.id
    for name in ("env", "algorithm", "num_envs", "hidden", "activation", "environment", "ppo"):
        assert metadata["config"][name] == configuration[name]


def test_policy_of_a_prosthesis_is_refused_for_the_joint(tmp_path: Path) -> None:
    message = "was trained for klute_sim/AnkleGait-v2 and has 8 inputs and 1 outputs; allowed: policies of"
    trained = resources.as_file(resources.files("klute_sim.baselines") / "policy.npz")
    with trained as path, pytest.raises(InputError, match=message):
        load_joint_policy(path)
    replace(make_policy(), metadata={}).save(tmp_path / "unknown.npz")
    with pytest.raises(InputError, match="was trained for an unknown environment"):
        load_joint_policy(tmp_path / "unknown.npz")


@pytest.mark.parametrize("arguments", [("gait", "--strides", "1"), ("walk", "--seconds", "1")])
def test_policy_of_the_joint_is_refused_for_a_prosthesis(arguments: tuple[str, ...], tmp_path: Path) -> None:
    make_policy().save(tmp_path / "joint.npz")
    refused = run(*arguments, "--controller", "joint.npz", cwd=tmp_path)
    assert refused.returncode == 2
    assert refused.stderr == (
        "klute-sim: policy joint.npz was trained for klute_sim/AntagonistJoint-v0 and controls no prosthesis; train "
        "one that does with: klute-sim train --env gait\n"
    )


def test_digest_of_the_joint_holds_its_mechanism() -> None:
    digest = compute_policy_digest(JOINT.id)
    assert digest == compute_code_digest("mechanism")
    assert digest not in (compute_policy_digest(TRAINING_ENVIRONMENTS[name].id) for name in ("gait", "walk"))


@pytest.mark.long
@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_training_in_the_joint_exports_its_network(algorithm: str, tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    text = config.read_default_config("joint").decode().replace('"ppo"', f'"{algorithm}"')
    for name, value in (("num_envs", 2), ("evaluation_episodes", 2), ("duration", 0.5), ("n_steps", 64)):
        text = "\n".join(f"{name} = {value}" if line.startswith(f"{name} =") else line for line in text.splitlines())
    (tmp_path / "small.toml").write_text(text.replace("batch_size = 512", "batch_size = 64"))
    arguments = ("--config", "small.toml", "--steps", "400", "--out", "joint", "--json")
    completed = run("train", "--env", "joint", *arguments, cwd=tmp_path)
    assert completed.returncode == 0, completed.stderr
    summary = json.loads(completed.stdout)
    assert (summary["env"], summary["baseline_name"]) == ("joint", "PID controller")
    assert set(summary["policy"]) == {"return", "steps", *JOINT.totals, "rms_angle_error_deg"}
    assert "rms angle error deg" in (tmp_path / "joint" / "index.html").read_text()
    policy = load_joint_policy(tmp_path / "joint" / "policy.npz")
    model = training.open_training(tmp_path / "joint", None, None).model
    observations = np.random.default_rng(0).normal(size=(50, 6)) * policy.observation_scale
    expected, _ = model.predict(observations / policy.observation_scale, deterministic=True)
    assert np.abs(policy(observations) - expected).max() < 1e-5
    assert np.ptp(expected, axis=0).min() > 0.0
    resumed = run("train", "--steps", "700", "--out", "joint", "--json", cwd=tmp_path)
    assert json.loads(resumed.stdout)["steps"] >= 700


@pytest.mark.long
def test_short_training_in_the_joint_beats_constant_pressures(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    completed = run("train", "--env", "joint", "--steps", "60000", "--out", "joint", "--json", cwd=tmp_path)
    assert completed.returncode == 0, completed.stderr
    policy = load_policy(tmp_path / "joint" / "policy.npz")
    constant = compute_mean_squared_error(lambda observed: np.zeros((len(observed), 2), np.float32))
    assert compute_mean_squared_error(policy) < 0.1 * constant
