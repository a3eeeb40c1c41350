"""Checkpoints of a training: archives of Stable-Baselines3, of which only numbers are read.

An archive also holds pickles, which could execute code. They are never loaded: the configuration of the training
determines the model, and the archive only its parameters, the state of its optimisers and the number of steps.
"""

import io
import json
import pickle
import warnings
import zipfile
from pathlib import Path
from typing import Any

from klute_sim.errors import InputError
from klute_sim.files.limits import CHECKPOINT, MAX_DECODED_BYTES
from klute_sim.files.reading import read_bytes


def load_checkpoint(model: Any, path: Path) -> None:
    """Set parameters, optimisers and number of steps of the ``model`` to those of the checkpoint ``path``.

    Raises InputError when the file is damaged or belongs to another model.
    """
    from stable_baselines3.common.save_util import load_from_zip_file, recursive_setattr

    content = read_bytes(path, CHECKPOINT)
    try:
        steps = _read_steps(content)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # torch warns of files that it has not written, and then refuses them
            _, parameters, variables = load_from_zip_file(io.BytesIO(content), load_data=False, device="cpu")
        model.set_parameters(parameters, device="cpu")
        for name, value in (variables or {}).items():  # such as the entropy coefficient of SAC
            recursive_setattr(model, f"{name}.data", value.data)
    except pickle.UnpicklingError:  # torch proposes to load it nevertheless
        raise InputError(
            f"{CHECKPOINT.describe(path)} holds objects that are not numbers; they are not loaded"
        ) from None
    except (
        zipfile.BadZipFile,
        AttributeError,
        EOFError,
        KeyError,
        NotImplementedError,
        OSError,
        RuntimeError,
        TypeError,
        ValueError,
    ) as error:
        reason = " ".join(str(error).split())[:200]
        raise InputError(f"{CHECKPOINT.describe(path)} cannot be read: {type(error).__name__}: {reason}") from None
    model.num_timesteps = steps


def _read_steps(content: bytes) -> int:
    """Return the number of steps, which the archive stores as a number of JSON."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        size = sum(entry.file_size for entry in archive.infolist())
        if size > MAX_DECODED_BYTES:
            raise ValueError(f"it holds {size} bytes; at most {MAX_DECODED_BYTES} are read")
        steps = json.loads(archive.read("data"))["num_timesteps"]
    if not isinstance(steps, int) or steps < 0:
        raise ValueError("its number of steps is no number")
    return steps
