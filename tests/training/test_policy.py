"""A policy as plain numbers: what it computes, and what its file may be."""

import json
from pathlib import Path

import numpy as np
import pytest

from klute_sim.controllers.policy import Policy, load_policy
from klute_sim.errors import InputError


def policy(activation: str = "tanh", squashed: bool = False) -> Policy:
    random = np.random.default_rng(0)
    sizes = [(5, 8), (4, 5), (1, 4)]
    layers = [(random.normal(size=s).astype(np.float32), random.normal(size=s[0]).astype(np.float32)) for s in sizes]
    return Policy(np.arange(1.0, 9.0, dtype=np.float32), layers, activation, squashed, {"seed": 3})


@pytest.mark.parametrize("squashed", [False, True])
@pytest.mark.parametrize("activation", ["tanh", "relu"])
def test_the_network_is_the_one_of_the_textbook(activation: str, squashed: bool) -> None:
    own, observation = policy(activation, squashed), np.linspace(-2.0, 3.0, 8, dtype=np.float32)
    function = {"tanh": np.tanh, "relu": lambda x: max(x, 0.0)}[activation]
    value = [o / s for o, s in zip(observation, own.observation_scale, strict=True)]
    for number, (weights, biases) in enumerate(own.layers):
        value = [
            sum(w * v for w, v in zip(row, value, strict=True)) + b for row, b in zip(weights, biases, strict=True)
        ]
        if number < 2:
            value = [function(v) for v in value]
    wanted = np.tanh(value[0]) if squashed else min(max(value[0], -1.0), 1.0)
    assert own(observation)[0] == pytest.approx(wanted, abs=1e-6)
    assert own(np.stack([observation, 0 * observation])).shape == (2, 1)


def test_a_file_holds_the_policy_and_how_it_was_made(tmp_path: Path) -> None:
    own = policy()
    own.save(tmp_path / "policy.npz")
    found = load_policy(tmp_path / "policy.npz")
    observations = np.random.default_rng(1).normal(size=(20, 8))
    assert np.array_equal(found(observations), own(observations))
    assert found.metadata["seed"] == 3
    with np.load(tmp_path / "policy.npz", allow_pickle=False) as file:
        assert json.loads(str(file["made"]))["activation"] == "tanh"


def test_a_file_that_could_run_code_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "policy.npz", scale=np.array([print], dtype=object), made=np.array("{}"))
    with pytest.raises(InputError, match="is none"):
        load_policy(tmp_path / "policy.npz")


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04broken", b"no archive at all"])
def test_what_is_no_policy_is_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "policy.npz").write_bytes(content)
    with pytest.raises(InputError, match="is none"):
        load_policy(tmp_path / "policy.npz")
    with pytest.raises(InputError, match="cannot be read"):
        load_policy(tmp_path / "nowhere.npz")


def test_layers_that_do_not_fit_are_refused() -> None:
    own = policy()
    for layers in ([], own.layers[1:], [(own.layers[0][0] * np.nan, own.layers[0][1])]):
        with pytest.raises(InputError):
            Policy(own.observation_scale, layers, "tanh", False, {})
    with pytest.raises(InputError, match="activation is 'sine'"):
        Policy(own.observation_scale, own.layers, "sine", False, {})
