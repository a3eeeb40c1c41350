"""A learned policy as plain numbers: a small network that runs on NumPy alone, in a file that runs no code."""

import json
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from klute_sim.errors import InputError

Float32Array = NDArray[np.float32]

ACTIVATIONS = ("tanh", "relu")


@dataclass(frozen=True)
class Policy:
    """Observations in, the action that it thinks best out."""

    observation_scale: Float32Array
    """(observations,) by which each observation is divided first."""
    layers: Sequence[tuple[Float32Array, Float32Array]]
    """Weights (outputs, inputs) and biases (outputs,) of each layer, the last one without activation."""
    activation: str
    """Between layers, one of :data:`ACTIVATIONS`."""
    tanh_output: bool
    """Whether actions are the last layer's hyperbolic tangent; otherwise they are clipped to -1 ... 1."""
    metadata: Mapping[str, Any]
    """How it was made (JSON types)."""

    def __post_init__(self) -> None:
        """Raise InputError for layers that do not fit together."""
        if self.activation not in ACTIVATIONS:
            raise InputError(f"the policy's activation is '{self.activation}'; allowed: {', '.join(ACTIVATIONS)}")
        if self.observation_scale.ndim != 1 or any(
            weights.ndim != 2 or biases.ndim != 1 for weights, biases in self.layers
        ):
            raise InputError("the policy's scale and biases are no rows, or its weights no tables, of numbers")
        inputs = len(self.observation_scale)
        for number, (weights, biases) in enumerate(self.layers, start=1):
            if (
                weights.shape != (len(biases), inputs)
                or not np.isfinite(weights).all()
                or not np.isfinite(biases).all()
            ):
                raise InputError(
                    f"layer {number} of the policy has weights of shape {weights.shape} and {len(biases)} biases; "
                    f"allowed: finite numbers for {inputs} inputs"
                )
            inputs = len(biases)
        if not self.layers or not (np.isfinite(self.observation_scale).all() and np.all(self.observation_scale > 0.0)):
            raise InputError("the policy needs at least one layer and scales above 0")

    def __call__(self, observation: ArrayLike) -> Float32Array:
        """Actions in -1 ... 1 for observations (observations,) or (n, observations)."""
        value = np.asarray(observation, dtype=np.float32) / self.observation_scale
        for weights, biases in self.layers[:-1]:
            value = value @ weights.T + biases
            value = np.tanh(value) if self.activation == "tanh" else np.maximum(value, 0.0)
        weights, biases = self.layers[-1]
        value = value @ weights.T + biases
        return np.asarray(np.tanh(value) if self.tanh_output else np.clip(value, -1.0, 1.0), dtype=np.float32)

    def save(self, path: str | Path) -> None:
        """Write it to ``path`` (.npz): arrays, and a JSON text under ``made``."""
        arrays: dict[str, Any] = {"scale": self.observation_scale, "made": np.array(self._format_metadata())}
        for number, (weights, biases) in enumerate(self.layers):
            arrays[f"weights_{number}"], arrays[f"biases_{number}"] = weights, biases
        with Path(path).open("wb") as file:
            np.savez(file, **arrays)

    def _format_metadata(self) -> str:
        return json.dumps(
            {"activation": self.activation, "squashed": self.tanh_output, **self.metadata}, allow_nan=False
        )


def load_policy(path: str | Path) -> Policy:
    """The policy in a file of :meth:`Policy.save`; nothing in it is run. Raises InputError if it is none."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        made = json.loads(str(arrays["made"]))
        count = sum(name.startswith("weights_") for name in arrays)
        layers = [
            (np.asarray(arrays[f"weights_{k}"], np.float32), np.asarray(arrays[f"biases_{k}"], np.float32))
            for k in range(count)
        ]
        scale, activation, squashed = np.asarray(arrays["scale"], np.float32), made["activation"], made["squashed"]
    except OSError as error:
        raise InputError(f"policy {path} cannot be read: {error.strerror or error}") from None
    except (EOFError, KeyError, ValueError, TypeError, NotImplementedError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(f"policy {path} is none: {error}") from None
    return Policy(scale, layers, str(activation), bool(squashed), made)
