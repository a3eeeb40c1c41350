"""Draft the description of bench recordings: :func:`draft_dataset`."""

import os
from pathlib import Path

from klute_sim.datasets.dataset import DATASET_FILE_NAME
from klute_sim.datasets.draft.draft import DatasetDraft, write_dataset_draft
from klute_sim.device.device import list_presets, load_device
from klute_sim.diagnosis.planning.measurement_plan import list_usual_uncertainties
from klute_sim.errors import InputError


def draft_dataset(folder: str | Path, device: str | Path | None = None) -> DatasetDraft:
    """Write a draft of dataset.toml for the bench recordings in ``folder``.

    ``device`` is a preset or a device file; without it, the only other TOML file in the folder. Columns are recognized
    by their words, units and samples, and repeats by equal inputs. What is assumed stands in the remarks of the draft
    and as comments in the file.

    Raises InputError when the folder has a dataset.toml already, when no file is a recording, or without a device.
    """
    folder = Path(folder)
    device = device or _find_device_file(folder)
    loaded = load_device(device)
    is_preset = str(device) in list_presets()
    reference = str(device) if is_preset else Path(os.path.relpath(device, folder)).as_posix()
    return write_dataset_draft(folder, loaded, reference, list_usual_uncertainties(loaded))


def _find_device_file(folder: Path) -> Path:
    """Return the only device file in ``folder``; raises InputError when there is none, or several."""
    files = sorted(path for path in folder.glob("*.toml") if path.name != DATASET_FILE_NAME)
    if len(files) != 1:
        listing = "no device file" if not files else f"{len(files)} TOML files"
        raise InputError(
            f"the folder {folder} contains {listing}; name the device with --device: a preset such as klute-3-4-pair, "
            "or a device file (klute-sim device klute-3-4-pair --toml > mine.toml writes one to edit)"
        )
    return files[0]
