"""Training: its configuration, what it keeps, and that it learns (the last two with the extra 'rl' alone)."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from klute_sim.controllers.policy import load_policy
from klute_sim.errors import InputError
from klute_sim.training import config, training
from klute_sim.training.evaluate import compare_with_profile, run_episodes
from tests.command_line import run

SMALL = b"""
algorithm = "ppo"
num_envs = 4
hidden = [8]
activation = "tanh"
checkpoint_minutes = 0.001
evaluation_episodes = 3
[environment]
action = "residual"
strides = 1
step = 1e-3
[ppo]
n_steps = 32
batch_size = 64
"""


def small(folder: Path, algorithm: str = "ppo") -> Path:
    file = folder / "small.toml"
    text = SMALL.decode().replace('"ppo"', f'"{algorithm}"')
    file.write_text(text + "[sac]\nlearning_starts = 100\ntrain_freq = 8\ngradient_steps = 1\n")
    return file


def test_the_shipped_configuration_is_one() -> None:
    found, content = config.load_config(None)
    assert found.environment["action"] == "residual"
    assert run("train", "--show-config").stdout == content.decode()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (SMALL.replace(b'"ppo"', b'"dqn"'), "algorithm: input should be 'ppo' or 'sac'"),
        (SMALL + b"[extra]\n", "extra: extra inputs are not permitted"),
        (SMALL.replace(b"strides", b"stride"), "the environment has no 'stride'; allowed: device, mass"),
        (SMALL.replace(b"num_envs = 4", b"num_envs = 0"), "num_envs"),
        (b"algorithm = ", "is not valid TOML"),
        (b"\xff\xfe", "not a UTF-8 text file"),
    ],
)
def test_a_configuration_that_cannot_be_is_refused(text: bytes, words: str) -> None:
    with pytest.raises(InputError, match=words):
        config.parse_config(text, "own.toml")


def test_without_the_extra_there_is_a_sentence_and_no_folder(tmp_path: Path) -> None:
    code = (
        "import sys; sys.modules['stable_baselines3'] = None\n"
        "from klute_sim.cli import main; main(['train', '--steps', '100', '--out', 'walker'])"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == (
        "klute-sim: klute-sim train needs the optional extra 'rl': pip install '.[rl]' in the project's folder\n"
    )
    assert not (tmp_path / "walker").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--minutes", "1", "--steps", "5"), "--minutes and --steps exclude each other"),
        (("--resume",), "--resume needs --out FOLDER"),
        (("--resume", "--out", "x", "--seed", "1"), "--resume keeps seed and configuration"),
        (("--resume", "--out", "x"), "there is no training to resume in x"),
        (("--config", "nowhere.toml"), "configuration nowhere.toml cannot be read"),
        (("--minutes", "0"), "--minutes"),
    ],
)
def test_what_cannot_be_asked_for_is_refused(arguments: tuple[str, ...], words: str, tmp_path: Path) -> None:
    done = run("train", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert words in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_the_evaluation_is_of_the_same_draws_and_knows_the_profile() -> None:
    options = {"action": "residual", "strides": 1, "step": 1e-3, "randomise": {"mass_share": 0.2}, "sensor_noise": 1.0}
    still = compare_with_profile(lambda observed: np.zeros((len(observed), 1), dtype=np.float32), options, 4, 0)
    assert still["policy"] == still["profile"]
    assert still["gain"] == still["better_in"] == 0
    worse = compare_with_profile(lambda observed: np.ones((len(observed), 1), dtype=np.float32), options, 4, 0)
    assert worse["profile"] == still["profile"]
    assert worse["gain"] < -5.0
    assert worse["policy"]["return"] - worse["profile"]["return"] == pytest.approx(worse["gain"])
    terms = sum(value for name, value in worse["policy"].items() if name.startswith("reward_"))
    assert terms == pytest.approx(worse["policy"]["return"])


def test_an_episode_s_sums_end_with_it() -> None:
    options = {"action": "residual", "strides": 1, "step": 1e-3, "randomise": {"speed_m_per_s": (0.9, 1.5)}}
    found = run_episodes(lambda observed: np.zeros((len(observed), 1), dtype=np.float32), options, 3, 0)
    for place in range(3):
        env = gymnasium.make("klute_sim/AnkleGait-v1", **options)
        env.reset(seed=10**12 + place)
        total, steps, ended = 0.0, 0, False
        while not ended:
            _, reward, terminated, truncated, _ = env.step(np.zeros(1, dtype=np.float32))
            total, steps, ended = total + reward, steps + 1, terminated or truncated
        assert found["steps"][place] == steps
        assert found["return"][place] == pytest.approx(total)
    assert len(set(found["steps"])) > 1


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_a_training_can_be_resumed_and_its_policy_is_the_network(algorithm: str, tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    file = small(tmp_path, algorithm)
    first = run("train", "--config", str(file), "--steps", "500", "--seed", "3", "--out", "walker", cwd=tmp_path)
    assert first.returncode == 0, first.stderr
    assert "The policy is better in" in first.stdout
    folder = tmp_path / "walker"
    before = json.loads((folder / "summary.json").read_text())
    assert before["seed"] == 3
    assert 500 <= before["steps"] < 500 + 128
    again = run("train", "--resume", "--steps", "1050", "--out", "walker", "--json", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    told = json.loads(again.stdout)
    assert 1050 <= told["steps"] < 1050 + 128
    assert told["seed"] == 3
    curve = np.genfromtxt(folder / "learning_curve.csv", delimiter=",", names=True)
    assert np.all(np.diff(curve["steps"]) > 0)
    assert curve["episode_steps"].max() == 110
    assert {"checkpoint.zip", "config.toml", "learning_curve.png", "policy.npz"} <= {f.name for f in folder.iterdir()}

    import stable_baselines3
    from stable_baselines3.common.utils import set_random_seed

    set_random_seed(0)
    model = getattr(stable_baselines3, algorithm.upper()).load(folder / "checkpoint.zip", device="cpu")
    policy = load_policy(folder / "policy.npz")
    kept = training.resume_training(folder).export_policy()
    for (weights, biases), (own, its) in zip(policy.layers, kept.layers, strict=True):
        assert np.array_equal(weights, own)
        assert np.array_equal(biases, its)
    assert policy.metadata["steps"] == told["steps"]
    assert policy.metadata["config"]["algorithm"] == algorithm
    space = gymnasium.make("klute_sim/AnkleGait-v1").observation_space
    space.seed(0)
    observations = np.array([space.sample() for _ in range(200)]) * 0.2
    theirs, _ = model.predict(observations / policy.observation_scale, deterministic=True)
    assert np.abs(policy(observations) - theirs).max() < 1e-5
    assert np.abs(theirs).max() > 0.0


def test_a_run_of_so_many_steps_can_be_repeated(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    file, seen = small(tmp_path), []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        done = run("train", "--config", str(file), "--steps", "300", "--seed", str(seed), "--out", name, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        seen.append(load_policy(tmp_path / name / "policy.npz").layers[-1][0])
    assert np.array_equal(seen[0], seen[1])
    assert not np.array_equal(seen[0], seen[2])
    first = [training.resume_training(tmp_path / name).model.seed for name in "abc"]
    assert first == [1, 1, 2]


def test_stable_baselines3_has_nothing_to_say_about_the_environments(recwarn: pytest.WarningsRecorder) -> None:
    pytest.importorskip("stable_baselines3")
    from stable_baselines3.common.env_checker import check_env

    asked = {"AnkleGait-v1": {"randomise": {"mass_share": 0.1}, "sensor_noise": 1.0}, "AnkleBench-v0": {"task": "work"}}
    for name, options in asked.items():
        recwarn.clear()
        check_env(gymnasium.make(f"klute_sim/{name}", **options).unwrapped, skip_render_check=True)
        assert [str(each.message) for each in recwarn] == []


@pytest.mark.long
def test_ctrl_c_keeps_what_was_learned(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    command = [sys.executable, "-m", "klute_sim", "train", "--config", str(small(tmp_path)), "--out", "walker"]
    begun = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True, env=dict(os.environ))
    deadline = time.monotonic() + 120.0
    while not (tmp_path / "walker" / "checkpoint.zip").exists() and time.monotonic() < deadline:
        time.sleep(0.2)
    begun.send_signal(signal.SIGINT)
    _, err = begun.communicate(timeout=60)
    assert begun.returncode == 130
    assert "go on with: klute-sim train --resume --out walker" in err
    kept = json.loads((tmp_path / "walker" / "progress.json").read_text())["steps"]
    assert kept > 0
    done = run("train", "--resume", "--steps", str(kept + 200), "--out", "walker", "--json", cwd=tmp_path)
    assert json.loads(done.stdout)["steps"] >= kept + 200


@pytest.mark.long
def test_the_shipped_configuration_beats_the_hand_tuned_profile_in_minutes(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    done = run("train", "--minutes", "2", "--out", "walker", "--json", cwd=tmp_path)
    told = json.loads(done.stdout)
    assert told["gain"] > 4.0 * told["gain_standard_error"]
