"""A learned policy as plain numbers: a small network that runs on NumPy alone, in a file that contains no code."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from klute_sim.errors import InputError
from klute_sim.files.json import parse_json
from klute_sim.files.limits import POLICY
from klute_sim.files.npz import read_npz

Float32Array = NDArray[np.float32]

ACTIVATIONS = ("tanh", "relu")
"""Allowed activation functions."""


@dataclass(frozen=True)
class Policy:
    """A multilayer perceptron that maps observations to the mean action."""

    observation_scale: Float32Array
    """Scale (observations,) by which each observation is divided."""
    layers: Sequence[tuple[Float32Array, Float32Array]]
    """Weights (outputs, inputs) and biases (outputs,) of each layer; the last layer has no activation."""
    activation: str
    """Activation between layers, one of :data:`ACTIVATIONS`."""
    tanh_output: bool
    """Whether the output is the hyperbolic tangent of the last layer; otherwise it is clipped to -1 ... 1."""
    metadata: Mapping[str, Any]
    """Training configuration and software versions (JSON types)."""

    def __post_init__(self) -> None:
        """Raise InputError when the shapes of the layers do not match or a number is not finite."""
        if self.activation not in ACTIVATIONS:
            raise InputError(f"the policy's activation is '{self.activation}'; allowed: {', '.join(ACTIVATIONS)}")
        has_wrong_shapes = any(weights.ndim != 2 or biases.ndim != 1 for weights, biases in self.layers)
        if self.observation_scale.ndim != 1 or has_wrong_shapes:
            raise InputError(
                "the policy has arrays of wrong shapes; allowed: one-dimensional scale and biases, two-dimensional "
                "weights"
            )
        n_inputs = len(self.observation_scale)
        for number, (weights, biases) in enumerate(self.layers, start=1):
            is_finite = np.isfinite(weights).all() and np.isfinite(biases).all()
            if weights.shape != (len(biases), n_inputs) or not is_finite:
                raise InputError(
                    f"layer {number} of the policy has weights of shape {weights.shape} and {len(biases)} biases; "
                    f"allowed: finite numbers for {n_inputs} inputs"
                )
            n_inputs = len(biases)
        is_valid_scale = np.isfinite(self.observation_scale).all() and np.all(self.observation_scale > 0.0)
        if not self.layers or not is_valid_scale:
            raise InputError("the policy needs at least one layer and scales above 0")

    def __call__(self, observation: ArrayLike) -> Float32Array:
        """Return actions in -1 ... 1 for observations (observations,) or (n, observations)."""
        value = np.asarray(observation, dtype=np.float32) / self.observation_scale
        for weights, biases in self.layers[:-1]:
            value = value @ weights.T + biases
            value = np.tanh(value) if self.activation == "tanh" else np.maximum(value, 0.0)
        weights, biases = self.layers[-1]
        value = value @ weights.T + biases
        return np.asarray(np.tanh(value) if self.tanh_output else np.clip(value, -1.0, 1.0), dtype=np.float32)

    def save(self, path: str | Path) -> None:
        """Write the policy to ``path`` (.npz): its arrays, and a JSON text under ``metadata``."""
        arrays: dict[str, Any] = {
            "observation_scale": self.observation_scale,
            "metadata": np.array(self._format_metadata()),
        }
        for number, (weights, biases) in enumerate(self.layers):
            arrays[f"weights_{number}"], arrays[f"biases_{number}"] = weights, biases
        with Path(path).open("wb") as file:
            np.savez(file, **arrays)

    def _format_metadata(self) -> str:
        network = {"activation": self.activation, "tanh_output": self.tanh_output}
        return json.dumps({**self.metadata, **network}, allow_nan=False)


def load_policy(path: str | Path) -> Policy:
    """Return the policy in a file of :meth:`Policy.save`; no code in the file is run.

    Raises InputError when the file cannot be read or is not a policy.
    """
    arrays = read_npz(path, POLICY)
    try:
        metadata = parse_json(str(arrays["metadata"]), f"metadata of policy {path}")
        n_layers = sum(name.startswith("weights_") for name in arrays)
        layers = [
            (np.asarray(arrays[f"weights_{k}"], np.float32), np.asarray(arrays[f"biases_{k}"], np.float32))
            for k in range(n_layers)
        ]
        observation_scale = np.asarray(arrays["observation_scale"], np.float32)
        activation, tanh_output = metadata["activation"], metadata["tanh_output"]
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(f"{path} is not a policy file: {error}") from None
    return Policy(observation_scale, layers, str(activation), bool(tanh_output), metadata)
