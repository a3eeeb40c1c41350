"""A folder of measured trials, read and checked."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath

from klute_sim.datasets import format as file_format
from klute_sim.datasets import plausibility
from klute_sim.datasets import split as splitting
from klute_sim.datasets import trial as trials
from klute_sim.datasets.channels import Rig
from klute_sim.datasets.format import DatasetFile
from klute_sim.datasets.split import Split, SplitEntry
from klute_sim.datasets.trial import Series, Trial
from klute_sim.device import device as device_files
from klute_sim.device.changes import apply_changes
from klute_sim.device.device import Device
from klute_sim.errors import InputError

DATASET_FILE_NAME = "dataset.toml"


@dataclass(frozen=True, eq=False, kw_only=True)
class Dataset:
    """Trials with one device on one rig."""

    folder: Path
    rig: Rig
    device: Device
    """Its numbers are nominal values; a trial may have others."""
    uncertainties: Mapping[str, float]
    """``section.key`` of the device -> standard deviation in the key's own unit."""
    trials: tuple[Trial, ...]
    digest: str
    """SHA-256 of ``dataset.toml``, the device file and every trial file."""
    remarks: tuple[str, ...]
    """What the user should know about the files, one sentence each."""


def load_dataset(folder: str | Path, device: Device | None = None) -> Dataset:
    """Read the dataset in ``folder``; raises InputError with one sentence when anything is wrong with it.

    ``device`` takes the place of the one that the dataset names.
    """
    folder = Path(folder)
    content = _read_content(folder)
    where = str(folder / DATASET_FILE_NAME)
    file = file_format.parse_dataset_file(content, where)
    device = device or _load_device(file.device, folder)
    uncertain = file_format.compute_standard_deviations(file.uncertain, device.spec.collect_values(), where)
    names = _name_trials(file, where)
    entries = [SplitEntry(name, entry.group or name, entry.use) for name, entry in zip(names, file.trial, strict=True)]
    splitting.assign_uses(entries, where)  # refuses what cannot be split before large files are read
    devices = [
        apply_changes(device, entry.device, f"{where}, trial '{name}'")
        for name, entry in zip(names, file.trial, strict=True)
    ]

    digest = hashlib.sha256(hashlib.sha256(content).digest() + bytes.fromhex(device.digest))
    said: list[tuple[str, ...]] = []
    units: dict[str, str] = {}
    found = []
    for entry, use, own in zip(file.trial, entries, devices, strict=True):
        files = tuple(folder / name for name in entry.files)
        channels = trials.read_trial(files, file.rig)
        said.append(channels.remarks)
        for each in channels.digests:
            digest.update(bytes.fromhex(each))
        found.append(
            Trial(
                name=use.name,
                group=use.group,
                use=use.use,
                device=own,
                files=files,
                prescribed=channels.prescribed,
                measured=channels.measured,
                trusted=_validate_trusted(entry.checked, channels.measured, f"{where}, trial '{use.name}'"),
            )
        )
        plausibility.check_plausibility(found[-1], channels.units)
        units = {**channels.units, **units}
    doubt = plausibility.describe_implausible_commands(found, units)
    return Dataset(
        folder=folder,
        rig=file.rig,
        device=device,
        uncertainties=uncertain,
        trials=tuple(found),
        digest=digest.hexdigest(),
        remarks=(*_collect_remarks(found, said), *filter(None, [doubt])),
    )


def split_dataset(dataset: Dataset) -> Split:
    """Which trials to fit, to select by and to show; the same dataset is always split the same way."""
    return splitting.assign_uses(
        (SplitEntry(t.name, t.group, t.use) for t in dataset.trials), str(dataset.folder / DATASET_FILE_NAME)
    )


def _validate_trusted(names: Sequence[str], measured: Mapping[str, Series], where: str) -> frozenset[str]:
    for channel in names:
        if channel not in measured:
            raise InputError(
                f"{where}: 'checked' names '{channel}', which it did not measure; allowed: {', '.join(measured)}"
            )
    return frozenset(names)


def _collect_remarks(all_trials: Sequence[Trial], file_remarks: Sequence[tuple[str, ...]]) -> list[str]:
    """What was ``said`` of each trial's files, each once (trials may share a file), and what a trial lacks by that."""
    result: dict[str, None] = {}
    for trial, own in zip(all_trials, file_remarks, strict=True):
        lacks = {c: None for other in all_trials if other.group == trial.group for c in other.measured} if own else {}
        missing = [channel for channel in lacks if channel not in trial.measured]
        result |= dict.fromkeys(own)
        if missing:
            result[f"trial '{trial.name}' has no {' and no '.join(missing)}, which its repeats have"] = None
    return list(result)


def _read_content(folder: Path) -> bytes:
    try:
        return (folder / DATASET_FILE_NAME).read_bytes()
    except FileNotFoundError:
        if not folder.exists():
            raise InputError(
                f"there is no folder {folder}; a dataset is a folder with a file {DATASET_FILE_NAME} in it"
            ) from None
        files = sorted(file.name for file in folder.glob("*") if file.suffix.lower() in (".csv", ".parquet"))
        mend = f"; docs/datasets.md shows how to write one, and it names {files[0]} and so on" if files else ""
        raise InputError(
            f"no dataset in {folder}: a dataset is a folder with a file {DATASET_FILE_NAME} in it{mend}"
        ) from None
    except NotADirectoryError:
        raise InputError(f"{folder} is a file; give the folder that holds {DATASET_FILE_NAME}") from None
    except OSError as error:
        raise InputError(f"{folder / DATASET_FILE_NAME} cannot be read: {error.strerror}") from None


def _load_device(name: str, folder: Path) -> Device:
    return device_files.load_device(name if name in device_files.list_presets() else folder / name)


def _name_trials(file: DatasetFile, where: str) -> list[str]:
    names: list[str] = []
    for number, entry in enumerate(file.trial, 1):
        name = "+".join(PurePath(path).with_suffix("").as_posix() for path in entry.files)
        if name in names:
            raise InputError(
                f"{where}: trials {names.index(name) + 1} and {number} are both '{name}'; every trial needs files of "
                "its own, and names that differ in more than their endings"
            )
        names.append(name)
    return names
