"""Tests of the policy file: computed actions and accepted content."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from klute_sim.controllers.policy import Policy, load_policy
from klute_sim.errors import InputError


def make_policy(activation: str = "tanh", tanh_output: bool = False) -> Policy:
    rng = np.random.default_rng(0)
    sizes = [(5, 8), (4, 5), (1, 4)]
    layers = [(rng.normal(size=s).astype(np.float32), rng.normal(size=s[0]).astype(np.float32)) for s in sizes]
    return Policy(np.arange(1.0, 9.0, dtype=np.float32), layers, activation, tanh_output, {"seed": 3})


@pytest.mark.parametrize("tanh_output", [False, True])
@pytest.mark.parametrize("activation", ["tanh", "relu"])
def test_network_equals_explicit_formula(activation: str, tanh_output: bool) -> None:
    made_policy, observation = make_policy(activation, tanh_output), np.linspace(-2.0, 3.0, 8, dtype=np.float32)
    function = {"tanh": np.tanh, "relu": lambda x: max(x, 0.0)}[activation]
    value = [o / s for o, s in zip(observation, made_policy.observation_scale, strict=True)]
    for number, (weights, biases) in enumerate(made_policy.layers):
        value = [
            sum(w * v for w, v in zip(row, value, strict=True)) + b for row, b in zip(weights, biases, strict=True)
        ]
        if number < 2:
            value = [function(v) for v in value]
    expected = np.tanh(value[0]) if tanh_output else min(max(value[0], -1.0), 1.0)
    assert made_policy(observation)[0] == pytest.approx(expected, abs=1e-6)
    assert made_policy(np.stack([observation, 0 * observation])).shape == (2, 1)


def test_file_holds_policy_and_metadata(tmp_path: Path) -> None:
    made_policy = make_policy()
    made_policy.save(tmp_path / "policy.npz")
    loaded = load_policy(tmp_path / "policy.npz")
    observations = np.random.default_rng(1).normal(size=(20, 8))
    assert np.array_equal(loaded(observations), made_policy(observations))
    assert loaded.metadata["seed"] == 3
    with np.load(tmp_path / "policy.npz", allow_pickle=False) as file:
        assert json.loads(str(file["metadata"]))["activation"] == "tanh"


def test_changed_copy_of_a_loaded_policy_is_saved_as_changed(tmp_path: Path) -> None:
    make_policy().save(tmp_path / "policy.npz")
    changed = replace(load_policy(tmp_path / "policy.npz"), activation="relu", tanh_output=True)
    changed.save(tmp_path / "changed.npz")
    observations = np.random.default_rng(1).normal(size=(20, 8))
    assert np.array_equal(load_policy(tmp_path / "changed.npz")(observations), changed(observations))


def test_pickled_content_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "policy.npz", scale=np.array([print], dtype=object), made=np.array("{}"))
    with pytest.raises(InputError, match=r"policy\.npz is not an archive of NumPy arrays"):
        load_policy(tmp_path / "policy.npz")


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04broken", b"no archive at all"])
def test_invalid_file_is_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "policy.npz").write_bytes(content)
    with pytest.raises(InputError, match=r"policy\.npz is not an archive of NumPy arrays"):
        load_policy(tmp_path / "policy.npz")
    with pytest.raises(InputError, match="cannot be read"):
        load_policy(tmp_path / "nowhere.npz")


def test_incompatible_layers_are_refused() -> None:
    made_policy = make_policy()
    for layers in ([], made_policy.layers[1:], [(made_policy.layers[0][0] * np.nan, made_policy.layers[0][1])]):
        with pytest.raises(InputError):
            Policy(made_policy.observation_scale, layers, "tanh", False, {})
    with pytest.raises(InputError, match="activation is 'sine'"):
        Policy(made_policy.observation_scale, made_policy.layers, "sine", False, {})
