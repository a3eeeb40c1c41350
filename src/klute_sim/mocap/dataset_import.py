"""Import of gait trials with a prosthesis as a dataset that ``klute-sim diagnose`` reads."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.datasets import dataset as datasets
from klute_sim.datasets import format as file_format
from klute_sim.datasets.channels import MEASURED_CHANNELS
from klute_sim.datasets.split import Split
from klute_sim.datasets.trial import TimeSeries
from klute_sim.datasets.write import write_trial
from klute_sim.device import device as device_files
from klute_sim.device.device import Device
from klute_sim.errors import InputError
from klute_sim.gait.replay.prescribed import prepare_prescribed_motion
from klute_sim.gait.replay.recording_mistakes import find_recording_mistakes
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics.prosthesis_kinematics import find_named_sides
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import channel_names, sources
from klute_sim.mocap.parsing.channel_names import Side
from klute_sim.mocap.prosthesis_trials import ProsthesisTrial, extract_prosthesis_trial
from klute_sim.mocap.reference_folder import REPORT_FILE
from klute_sim.mocap.reference_import import read_files
from klute_sim.mocap.strides import repeats
from klute_sim.mocap.strides.strides import PHASE_GRID
from klute_sim.provenance import collect_versions
from klute_sim.types import Array, ProgressCallback

DATASET_UNITS = {
    **{"shank_angle": "deg", "ankle_x": "m", "ankle_z": "m", "grf_vertical": "N", "grf_forward": "N", "cop_x": "m"},
    **{
        channel_names.PRESSURE_COMMAND: "bar",
        channel_names.MUSCLE_PRESSURE: "bar",
        channel_names.MUSCLE_FORCE: "N",
        channel_names.MUSCLE_LENGTH: "mm",
    },
    **{"ankle_angle": "deg", channel_names.ANKLE_MOMENT: "N*m"},
}
"""Channel -> unit in the dataset."""
FILE_SUFFIXES = {
    "shank_angle": "motion",
    "grf_vertical": "load",
    channel_names.PRESSURE_COMMAND: "log",
    channel_names.ANKLE_MOMENT: "moment",
}
"""First channel with common times -> suffix of the file name."""
DEVICE_FILE = "device.toml"
"""Name of the copied device file."""


@dataclass(frozen=True, kw_only=True)
class DatasetOptions:
    """Metadata of a dataset."""

    device: str
    """Device of the prosthesis: a preset name or a file."""
    uncertainties: Mapping[str, str | float]
    """``section.key`` of the device -> standard deviation, in per cent or in the key's unit, as in dataset.toml."""
    trials_per_group: int | None = None
    """Number of consecutive trials that are repeats; None detects repeats."""


@dataclass(frozen=True, eq=False)
class ImportedDataset:
    """Trials of a dataset before writing."""

    log: ImportLog
    """Log of the import."""
    side: Side
    """Side of the prosthesis."""
    device: Device
    """Device of the prosthesis."""
    options: DatasetOptions
    """Metadata of the dataset."""
    trials: tuple[ProsthesisTrial, ...]
    """Trials that can be replayed."""
    groups: tuple[str, ...]
    """Group of each trial; trials of one group are repeats."""
    accept: frozenset[str] = frozenset()
    """Names of findings that are right although they look implausible."""


def import_dataset(
    files: Sequence[str | Path],
    import_options: ImportOptions,
    dataset_options: DatasetOptions,
    progress: ProgressCallback | None = None,
) -> ImportedDataset:
    """Import the trials in ``files`` as a dataset.

    Raises InputError for invalid options and files, and if no trial can be replayed.
    """
    device = device_files.load_device(dataset_options.device)
    if dataset_options.trials_per_group is not None and dataset_options.trials_per_group < 1:
        raise InputError(f"--repeats is {dataset_options.trials_per_group}; allowed: 1 or more")
    placeholder_trials = [("-", ["x"], list[str]())]
    parsed = file_format.parse_dataset_file(
        _format_toml(dataset_options, "any", placeholder_trials).encode(), "--uncertain"
    )
    file_format.compute_standard_deviations(parsed.uncertain, device.spec.collect_values(), "--uncertain")
    log = ImportLog()
    source_files = read_files(files, import_options, log, progress, last_fraction=0.5)
    groups = sources.group_into_trials(source_files, import_options.mapping, prosthesis=True)
    side = _select_side(groups, import_options)
    trials = []
    for number, group in enumerate(groups):
        trial = extract_prosthesis_trial(group, side, replace(import_options, side=side), log)
        trials += [trial] if trial is not None else []
        if progress is not None:
            progress(0.5 + 0.5 * (number + 1) / len(groups), "extracting trials")
    if not trials:
        raise InputError(f"no trial of these files can be replayed: {'; '.join(log.missing[:3])}")
    names = _name_groups(trials, dataset_options, log)
    return ImportedDataset(log, side, device, dataset_options, tuple(trials), names, import_options.accept)


def _select_side(trials: Sequence[Sequence[sources.SourceFile]], import_options: ImportOptions) -> Side:
    if import_options.side is not None:
        return import_options.side
    sides = {side for trial in trials for side in find_named_sides(trial, import_options)}
    if len(sides) == 2:
        raise InputError("these files contain both legs; pass the side of the prosthesis (--side right or left)")
    return sides.pop() if sides else "right"


def _name_groups(trials: Sequence[ProsthesisTrial], options: DatasetOptions, log: ImportLog) -> tuple[str, ...]:
    numbers = repeats.group_repeats(trials, options.trials_per_group)
    if options.trials_per_group is None:
        log.add_derived(
            "Repeats: trials whose stride times differ by up to "
            f"{100 * repeats.STRIDE_TIME_TOLERANCE:g} % and whose commanded pressures differ by up to "
            f"{100 * repeats.COMMAND_TOLERANCE:g} % of their peak (--repeats)"
        )
    if len(set(numbers)) == len(numbers):
        log.add_missing(
            "Repeats: no two trials have the same pressures and speed; without repeats, noise cannot be separated from "
            "model errors"
        )
    return tuple(f"condition_{number}" for number in numbers)


def write_dataset(imported: ImportedDataset, folder: Path) -> dict[str, Any]:
    """Write ``imported`` into the empty ``folder``; return the summary.

    Raises InputError for a trial that cannot be replayed.
    """
    entries = []
    for number, (trial, group) in enumerate(zip(imported.trials, imported.groups, strict=True), 1):
        files = []
        for suffix, columns in _split_by_clock(trial).items():
            files.append(f"walk_{number:02d}_{suffix}.csv")
            write_trial(folder / files[-1], columns)
        entries.append((group, files, trial.files))
    device = imported.options.device
    if device not in device_files.list_presets():
        device = DEVICE_FILE
        (folder / DEVICE_FILE).write_bytes(imported.device.content)
    dataset_file = folder / datasets.DATASET_FILE_NAME
    dataset_file.write_text(_format_toml(imported.options, device, entries), "utf-8", newline="\n")
    dataset = datasets.load_dataset(folder, accept=imported.accept, find_in_walks=find_recording_mistakes)
    imported.log.require_accepted(dataset.accepted, imported.accept)
    if dataset.accepted:
        accept = sorted({finding.name for finding in dataset.accepted})
        content = _format_toml(imported.options, device, entries, accept)
        dataset_file.write_text(content, "utf-8", newline="\n")
    for dataset_trial, trial in zip(dataset.trials, imported.trials, strict=True):
        prepare_prescribed_motion(dataset_trial.prescribed, trial.name)
    summary = {**summarize(imported), "split": _describe_split(datasets.split_dataset(dataset))}
    for entry, (_, files, _) in zip(summary["trials"], entries, strict=True):
        entry["files"] = files
    (folder / REPORT_FILE).write_text(json.dumps(summary, indent=2, allow_nan=False) + "\n", "utf-8")
    return summary


def _split_by_clock(trial: ProsthesisTrial) -> dict[str, dict[str, Array]]:
    """Return suffix of a file -> heading -> samples, with one file for each set of common times."""
    clocks: list[tuple[Array, dict[str, TimeSeries]]] = []
    for name in DATASET_UNITS:
        if name in trial.channels:
            signal = trial.channels[name]
            same_clock = next((channels for time, channels in clocks if np.array_equal(time, signal.time)), None)
            if same_clock is None:
                clocks.append((signal.time, {name: signal}))
            else:
                same_clock[name] = signal
    return {
        FILE_SUFFIXES.get(next(iter(channels)), next(iter(channels))): {
            "time [s]": time,
            **{f"{name} [{DATASET_UNITS[name]}]": signal.value for name, signal in channels.items()},
        }
        for time, channels in clocks
    }


def _format_toml(
    options: DatasetOptions,
    device: str,
    trials: Sequence[tuple[str, Sequence[str], Sequence[str]]],
    accept: Sequence[str] = (),
) -> str:
    """Return ``dataset.toml``; JSON strings are valid TOML basic strings."""

    def quote(text: str) -> str:
        return json.dumps(text, ensure_ascii=False)

    lines = [f'format = "{file_format.FORMAT_NAME}"', 'rig = "gait"', f"device = {quote(device)}"]
    if accept:
        lines.append(f"accept = [{', '.join(map(quote, accept))}]")
    if options.uncertainties:
        lines += ["", "[uncertain]"]
        lines += [
            f"{quote(k)} = {quote(v) if isinstance(v, str) else repr(v)}" for k, v in options.uncertainties.items()
        ]
    for group, files, source_names in trials:
        lines += ["", f"# {', '.join(map(quote, source_names))}"] if source_names else [""]
        lines += ["[[trial]]", f"files = [{', '.join(map(quote, files))}]", f"group = {quote(group)}"]
    return "\n".join(lines) + "\n"


def summarize(imported: ImportedDataset) -> dict[str, Any]:
    """Return the trials and the log of an import; JSON types only."""
    return {
        "format": "klute-sim-import-dataset/2",
        "side": imported.side,
        "device": imported.device.name,
        "trials": [
            _describe_trial(trial, group) for trial, group in zip(imported.trials, imported.groups, strict=True)
        ],
        **imported.log.as_json(),
        "versions": collect_versions(),
    }


def _describe_trial(trial: ProsthesisTrial, group: str) -> dict[str, Any]:
    return {
        "sources": list(trial.files),
        "group": group,
        "strides": len(trial.foot_strikes) - 1,
        "stride_time_s": trial.stride_time,
        "peak_command_bar": float(trial.compute_mean_command(PHASE_GRID).max()),
        "measured": [name for name in trial.channels if name in MEASURED_CHANNELS["gait"]],
    }


def _describe_split(split: Split) -> dict[str, Any]:
    return {
        "fit": split.fit,
        "validation": split.validation,
        "test": split.test,
        "description": split.description,
    }
