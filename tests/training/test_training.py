"""Tests of the training: configuration, checkpoints, and learning (the last two require the extra 'rl')."""

import base64
import json
import os
import pickle
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from klute_sim.controllers.policy import load_policy
from klute_sim.errors import InputError
from klute_sim.gait.reference import load_reference
from klute_sim.training import config, training
from klute_sim.training.environments import TRAINING_ENVIRONMENTS
from klute_sim.training.evaluate import check_baseline, compare_with_baseline, run_episodes
from tests.command_line import run
from tests.envs.test_actions import make_opening_device
from tests.gait.reference_files import write_reference_folder

GAIT, WALK = TRAINING_ENVIRONMENTS["gait"], TRAINING_ENVIRONMENTS["walk"]
SMALL_CONFIG = b"""
algorithm = "ppo"
num_envs = 4
hidden = [8]
activation = "tanh"
checkpoint_minutes = 0.001
evaluation_episodes = 3
[environment]
action = "residual"
strides = 1
time_step = 1e-3
[ppo]
n_steps = 32
batch_size = 64
"""


def write_small_config(folder: Path, algorithm: str = "ppo") -> Path:
    file = folder / "small.toml"
    text = SMALL_CONFIG.decode().replace('"ppo"', f'"{algorithm}"')
    file.write_text(text + "[sac]\nlearning_starts = 100\ntrain_freq = 8\ngradient_steps = 1\n")
    return file


def test_default_configuration_is_valid() -> None:
    configuration, content = config.load_config(None)
    assert configuration.environment["action"] == "residual"
    assert run("train", "--show-config").stdout == content.decode()


def test_default_configuration_of_the_walk_is_valid(tmp_path: Path) -> None:
    configuration, content = config.load_config(None, "walk")
    assert (configuration.env, configuration.environment["base"]) == ("walk", "machine")
    assert configuration.training_environment is WALK
    assert run("train", "--env", "walk", "--show-config").stdout == content.decode()
    file = tmp_path / "mine.toml"
    file.write_bytes(content)
    assert config.load_config(file)[0] == config.load_config(file, "walk")[0] == configuration
    with pytest.raises(InputError, match="has env = 'walk', and 'gait' is asked for"):
        config.load_config(file, "gait")
    with pytest.raises(InputError, match="the subject: the environment 'walk' takes no 'mass'; allowed: device, foot"):
        config.load_subject_config(None, {"mass": 70.0}, "walk")
    assert config.load_subject_config(None, {"speed": 1.1}, "walk")[0].environment["speed"] == 1.1
    with pytest.raises(InputError, match="base is 'constant:2'; allowed: machine, profile"):
        config.parse_config(content.replace(b'"machine"', b'"constant:2"'), "mine")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (SMALL_CONFIG.replace(b'"ppo"', b'"dqn"'), "algorithm = 'dqn' is refused: input should be 'ppo' or 'sac'"),
        (SMALL_CONFIG + b"[extra]\n", "unknown key 'extra'"),
        (SMALL_CONFIG.replace(b"strides", b"stride"), "the environment 'gait' takes no 'stride'; allowed: device"),
        (SMALL_CONFIG.replace(b"num_envs = 4", b"num_envs = 0"), "num_envs"),
        (SMALL_CONFIG.replace(b"strides = 1", b"sensor_delay = 1.0"), "sensor_delay = 1.0 is refused; allowed: a wh"),
        (SMALL_CONFIG.replace(b"strides = 1", b'slope = "steep"'), "slope = 'steep' is refused; allowed: a number"),
        (SMALL_CONFIG.replace(b"strides = 1", b"device = 3"), "device = 3 is refused; allowed: a string"),
        (SMALL_CONFIG.replace(b"strides = 1", b"reward = 3"), "reward = 3 is refused; allowed: a table"),
        (SMALL_CONFIG.replace(b"strides = 1", b'profile = "a.csv"'), "the environment 'gait' takes no 'profile'"),
        (b"algorithm = ", "is not valid TOML"),
        (b"\xff\xfe", "not a UTF-8 text file"),
    ],
)
def test_invalid_configuration_is_refused(text: bytes, message: str) -> None:
    with pytest.raises(InputError, match=message):
        config.parse_config(text, "own.toml")


def test_subject_replaces_that_of_the_configuration_and_keeps_its_digest(tmp_path: Path) -> None:
    folder = write_reference_folder(tmp_path / "me", mass=62.0, stature=1.66)
    assert config.load_subject_config(None, {}) == config.load_config(None)
    subject = {"reference": str(folder), "mass": 70.0}
    configuration, content = config.load_subject_config(None, subject)
    assert configuration.environment["mass"] == 70.0
    assert configuration.environment["reference"] == str(folder.absolute())
    assert configuration.environment["domain_randomization"]["speed_fraction"] == [0.8, 1.25]
    assert configuration.reference_sha256 == load_reference(folder).digest
    assert config.parse_config(content, "stored") == configuration
    training.check_same_subject(tmp_path, configuration, {})
    training.check_same_subject(tmp_path, configuration, subject)
    with pytest.raises(InputError, match=r"holds a training of another subject \(other mass, speed\)"):
        training.check_same_subject(tmp_path, configuration, {**subject, "mass": 71.0, "speed": 1.2})
    curves = folder / "reference.csv"
    curves.write_text(curves.read_text() + "\n")
    with pytest.raises(InputError, match="has changed since the training"):
        training.check_same_subject(tmp_path, configuration, subject)


def test_missing_extra_raises_one_sentence(tmp_path: Path) -> None:
    code = (
        "import sys; sys.modules['stable_baselines3'] = None\n"
        "from klute_sim.cli import main; main(['train', '--steps', '100', '--out', 'walker'])"
    )
    completed = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert completed.returncode == 2
    assert completed.stderr == (
        "klute-sim: klute-sim train needs the optional extra 'rl': pip install '.[rl]' in the project's folder; "
        "without a graphics card, first pip install torch --index-url https://download.pytorch.org/whl/cpu; "
        "without torch: python examples/cross_entropy.py (docs/training.md)\n"
    )
    assert not (tmp_path / "walker").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--minutes", "1", "--steps", "5"), "--minutes and --steps exclude each other"),
        (("--config", "nowhere.toml"), "configuration nowhere.toml cannot be read"),
        (("--minutes", "0"), "--minutes"),
        (("--reference", "nobody"), "reference nobody cannot be read"),
        (("--mass", "7"), "mass is 7; allowed: 20 to 250 kg"),
        (("--slope", "30"), "slope is 30; allowed: -10 to 10 degrees"),
    ],
)
def test_invalid_options_are_refused(arguments: tuple[str, ...], message: str, tmp_path: Path) -> None:
    completed = run("train", *arguments, cwd=tmp_path)
    assert completed.returncode == 2
    assert message in completed.stderr
    assert len(completed.stderr.splitlines()) == 1


@pytest.mark.slow
def test_evaluation_uses_equal_random_numbers() -> None:
    options = {
        "action": "residual",
        "strides": 1,
        "time_step": 1e-3,
        "domain_randomization": {"mass_fraction": 0.2},
        "sensor_noise": 1.0,
    }
    equal = compare_with_baseline(GAIT, lambda observed: np.zeros((len(observed), 1), dtype=np.float32), options, 4, 0)
    assert equal["policy"] == equal["baseline"]
    assert equal["gain"] == equal["n_better_episodes"] == 0
    worse = compare_with_baseline(GAIT, lambda observed: np.ones((len(observed), 1), dtype=np.float32), options, 4, 0)
    assert worse["baseline"] == equal["baseline"]
    assert worse["gain"] < -5.0
    assert worse["policy"]["return"] - worse["baseline"]["return"] == pytest.approx(worse["gain"])
    terms = sum(value for name, value in worse["policy"].items() if name.startswith("reward_"))
    assert terms == pytest.approx(worse["policy"]["return"])


def test_walks_are_compared_with_the_base_controller() -> None:
    """A policy that lowers the pressure by 1.5 bar makes the same persons lose what it costs them."""
    options = {"action": "residual", "residual_bar": 1.5, "duration": 2.0, "gain_noise": 0.02}
    result = compare_with_baseline(
        WALK, lambda observed: np.full((len(observed), 1), -1.0, dtype=np.float32), options, 3, 0
    )
    assert result["baseline_name"] == "base controller"
    assert result["baseline"]["steps"] == 200.0
    assert result["gain"] < -1.0
    terms = sum(value for name, value in result["policy"].items() if name.startswith("reward_"))
    assert terms == pytest.approx(result["policy"]["return"])
    assert set(result["policy"]) == {"return", "steps", *WALK.totals}


def test_environment_that_does_not_take_the_baseline_is_refused() -> None:
    """Its training would end without a result."""
    check_baseline(GAIT, {"strides": 1, "time_step": 1e-3})
    message = r"its baseline, the hand-tuned profile: action is 'residual', and .* takes openings"
    with pytest.raises(InputError, match=message):
        check_baseline(GAIT, {"device": make_opening_device(), "strides": 1, "time_step": 1e-3})


@pytest.mark.slow
def test_episode_totals_end_with_episode() -> None:
    options = {
        "action": "residual",
        "strides": 1,
        "time_step": 1e-3,
        "domain_randomization": {"speed_m_per_s": (0.9, 1.5)},
    }
    configuration = run_episodes(GAIT, lambda observed: np.zeros((len(observed), 1), dtype=np.float32), options, 3, 0)
    for index in range(3):
        env = gymnasium.make("klute_sim/AnkleGait-v2", **options)
        env.reset(seed=10**12 + index)
        total, steps, ended = 0.0, 0, False
        while not ended:
            _, reward, terminated, truncated, _ = env.step(np.zeros(1, dtype=np.float32))
            total, steps, ended = total + reward, steps + 1, terminated or truncated
        assert configuration["steps"][index] == steps
        assert configuration["return"][index] == pytest.approx(total)
    assert len(set(configuration["steps"])) > 1


@pytest.mark.long
@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_training_resumes_and_exports_its_network(algorithm: str, tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    file = write_small_config(tmp_path, algorithm)
    first_run = run("train", "--config", str(file), "--steps", "500", "--seed", "3", "--out", "walker", cwd=tmp_path)
    assert first_run.returncode == 0, first_run.stderr
    assert "The policy is better in" in first_run.stdout
    folder = tmp_path / "walker"
    before = json.loads((folder / "summary.json").read_text())
    assert before["seed"] == 3
    assert 500 <= before["steps"] < 500 + 128
    resumed = run("train", "--steps", "1050", "--out", "walker", "--json", cwd=tmp_path)
    assert resumed.returncode == 0, resumed.stderr
    summary = json.loads(resumed.stdout)
    assert 1050 <= summary["steps"] < 1050 + 128
    assert summary["seed"] == 3
    curve = np.genfromtxt(folder / "learning_curve.csv", delimiter=",", names=True)
    assert np.all(np.diff(curve["steps"]) > 0)
    assert curve["episode_steps"].max() == 110
    assert {"checkpoint.zip", "config.toml", "figure.png", "index.html", "policy.npz"} <= {
        f.name for f in folder.iterdir()
    }

    import stable_baselines3
    from stable_baselines3.common.utils import set_random_seed

    set_random_seed(0)
    model = getattr(stable_baselines3, algorithm.upper()).load(folder / "checkpoint.zip", device="cpu")
    policy = load_policy(folder / "policy.npz")
    loaded = training.open_training(folder, None, None).export_policy()
    for (weights, biases), (expected_weights, expected_biases) in zip(policy.layers, loaded.layers, strict=True):
        assert np.array_equal(weights, expected_weights)
        assert np.array_equal(biases, expected_biases)
    assert policy.metadata["steps"] == summary["steps"]
    assert policy.metadata["config"]["algorithm"] == algorithm
    space = gymnasium.make("klute_sim/AnkleGait-v2").observation_space
    space.seed(0)
    observations = np.array([space.sample() for _ in range(200)]) * 0.2
    expected_actions, _ = model.predict(observations / policy.observation_scale, deterministic=True)
    assert np.abs(policy(observations) - expected_actions).max() < 1e-5
    assert np.abs(expected_actions).max() > 0.0


@pytest.mark.long
def test_squashed_policy_of_ppo_is_exported_as_such(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    options = b"use_sde = true\n[ppo.policy_kwargs]\nsquash_output = true\northo_init = false\n"
    configuration = config.parse_config(SMALL_CONFIG + options, "squashed.toml")
    trained = training.Training(tmp_path, configuration, training.TrainingProgress(seed=0))
    policy = trained.export_policy()
    observations = np.random.default_rng(0).normal(size=(50, 8)) * 20.0
    expected, _ = trained.model.predict(observations / policy.observation_scale, deterministic=True)
    assert np.abs(expected).max() > 0.3
    assert np.abs(policy(observations) - expected).max() < 1e-5


@pytest.mark.long
def test_option_that_the_algorithm_refuses_is_named(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    configuration = config.parse_config(SMALL_CONFIG.replace(b"batch_size = 64", b"batch_size = 1"), "mine.toml")
    with pytest.raises(InputError, match=r"configuration: \[ppo\] `batch_size` must be greater than 1"):
        training.Training(tmp_path, configuration, training.TrainingProgress(seed=0))


@pytest.mark.long
def test_algorithm_gets_scaled_rewards_and_reports_returns_unscaled() -> None:
    pytest.importorskip("stable_baselines3")
    from klute_sim.training.vec_env import REWARD_SCALE, TrainingVecEnv

    options = {"action": "residual", "strides": 1, "time_step": 1e-3}
    envs, rewards, returns = TrainingVecEnv(GAIT, 2, 0, options), [], []
    envs.reset()
    while not returns:
        envs.step_async(np.zeros((2, 1), dtype=np.float32))
        _, reward, _, infos = envs.step_wait()
        rewards.append(reward[0])
        returns += [info["episode"]["r"] for info in infos[:1] if "episode" in info]
    assert sum(rewards) == pytest.approx(REWARD_SCALE * returns[0], rel=1e-4)
    assert returns[0] > 50.0


@pytest.mark.long
def test_policy_of_a_walk_is_a_controller_of_walks(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    text = config.read_default_config("walk").decode().replace("num_envs = 16", "num_envs = 2")
    text = text.replace("evaluation_episodes = 32", "evaluation_episodes = 2").replace(
        "duration = 10.0", "duration = 1.0"
    )
    (tmp_path / "walk.toml").write_text(text.replace("n_steps = 512", "n_steps = 64"))
    arguments = ("--config", "walk.toml", "--steps", "200", "--out", "walker", "--json")
    completed = run("train", "--env", "walk", *arguments, cwd=tmp_path)
    assert completed.returncode == 0, completed.stderr
    summary = json.loads(completed.stdout)
    assert (summary["env"], summary["baseline_name"]) == ("walk", "base controller")
    walked = run("walk", "--controller", "walker/policy.npz", "--seconds", "2", "--out", "w", "--json", cwd=tmp_path)
    assert walked.returncode == 0, walked.stderr
    assert json.loads(walked.stdout)["controller"]["base"]["kind"] == "machine"
    resumed = run("train", "--steps", "400", "--out", "walker", "--json", cwd=tmp_path)
    assert json.loads(resumed.stdout)["steps"] >= 400


@pytest.mark.long
def test_training_is_repeatable(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    file, weights = write_small_config(tmp_path), []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        completed = run(
            "train", "--config", str(file), "--steps", "300", "--seed", str(seed), "--out", name, cwd=tmp_path
        )
        assert completed.returncode == 0, completed.stderr
        weights.append(load_policy(tmp_path / name / "policy.npz").layers[-1][0])
    assert np.array_equal(weights[0], weights[1])
    assert not np.array_equal(weights[0], weights[2])
    first_run = [training.open_training(tmp_path / name, None, None).model.seed for name in "abc"]
    assert first_run == [1, 1, 2]


@pytest.mark.long
def test_pickles_of_a_checkpoint_are_never_loaded(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    file = write_small_config(tmp_path)
    arguments = ("train", "--config", str(file), "--seed", "5", "--out", "walker", "--json")
    assert run(*arguments, "--steps", "200", cwd=tmp_path).returncode == 0
    checkpoint, trace = tmp_path / "walker" / "checkpoint.zip", tmp_path / "executed"
    attack = base64.b64encode(b"cposix\nsystem\n(S'touch " + str(trace).encode() + b"'\ntR.").decode()
    with zipfile.ZipFile(checkpoint) as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
    data = json.loads(entries["data"])
    names = [name for name, value in data.items() if isinstance(value, dict) and ":serialized:" in value]
    assert names
    for name in names:
        data[name][":serialized:"] = attack
    with zipfile.ZipFile(checkpoint, "w") as archive:
        for name, content in (entries | {"data": json.dumps(data).encode()}).items():
            archive.writestr(name, content)
    resumed = run(*arguments, "--steps", "400", cwd=tmp_path)
    assert resumed.returncode == 0, resumed.stderr
    assert json.loads(resumed.stdout)["steps"] >= 400
    assert not trace.exists()
    with zipfile.ZipFile(checkpoint) as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(checkpoint, "w") as archive:
        for name, content in entries.items():
            archive.writestr(name, pickle.dumps(_Attack(trace)) if name.endswith(".pth") else content)
    refused = run(*arguments, "--steps", "600", cwd=tmp_path)
    assert refused.returncode == 2
    assert "checkpoint walker/checkpoint.zip holds objects that are not numbers" in refused.stderr
    assert len(refused.stderr.splitlines()) == 1
    assert not trace.exists()


class _Attack:
    """An object whose pickle creates a file when it is loaded."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.system, (f"touch {self.path}",)


@pytest.mark.long
def test_training_resumes_only_with_its_own_configuration_and_seed(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    file = write_small_config(tmp_path)
    arguments = ("train", "--config", str(file), "--steps", "200", "--out", "walker", "--json")
    first = run(*arguments, "--seed", "5", cwd=tmp_path)
    assert first.returncode == 0, first.stderr
    again = run(*arguments, "--seed", "5", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    steps = json.loads(first.stdout)["steps"]
    assert json.loads(again.stdout)["steps"] == steps
    assert f"resumed after {steps} steps" in again.stderr
    other_seed = run(*arguments, "--seed", "6", cwd=tmp_path)
    assert other_seed.returncode == 2
    assert "holds a training with the seed 5" in other_seed.stderr
    file.write_text(file.read_text().replace("hidden = [8]", "hidden = [9]"))
    other_config = run(*arguments, cwd=tmp_path)
    assert other_config.returncode == 2
    assert "holds a training with another configuration" in other_config.stderr


@pytest.mark.long
def test_environments_pass_stable_baselines3_checker(recwarn: pytest.WarningsRecorder) -> None:
    pytest.importorskip("stable_baselines3")
    from stable_baselines3.common.env_checker import check_env

    env_options = {
        "AnkleGait-v2": {"domain_randomization": {"mass_fraction": 0.1}, "sensor_noise": 1.0},
        "AnkleBench-v0": {"task": "work"},
        "AnkleWalk-v0": {"action": "residual", "gain_noise": 0.02},
        "AntagonistJoint-v0": {"load": 2.0},
    }
    for name, options in env_options.items():
        recwarn.clear()
        check_env(gymnasium.make(f"klute_sim/{name}", **options).unwrapped, skip_render_check=True)
        assert [str(warning.message) for warning in recwarn] == []


@pytest.mark.long
def test_interrupt_saves_model(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    command = [
        sys.executable,
        "-m",
        "klute_sim",
        "train",
        "--config",
        str(write_small_config(tmp_path)),
        "--out",
        "walker",
    ]
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True, env=dict(os.environ))
    deadline = time.monotonic() + 120.0
    while not (tmp_path / "walker" / "checkpoint.zip").exists() and time.monotonic() < deadline:
        time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "resume with: klute-sim train --out walker" in err
    loaded = json.loads((tmp_path / "walker" / "progress.json").read_text())["steps"]
    assert loaded > 0
    completed = run("train", "--steps", str(loaded + 200), "--out", "walker", "--json", cwd=tmp_path)
    assert json.loads(completed.stdout)["steps"] >= loaded + 200


@pytest.mark.long
def test_default_configuration_beats_tuned_profile(tmp_path: Path) -> None:
    """A minute of training, given in steps, so that the result does not depend on the speed of the machine."""
    pytest.importorskip("stable_baselines3")
    completed = run("train", "--steps", "80000", "--out", "walker", "--json", cwd=tmp_path)
    summary = json.loads(completed.stdout)
    assert summary["gain"] > 4.0 * summary["gain_standard_error"]
