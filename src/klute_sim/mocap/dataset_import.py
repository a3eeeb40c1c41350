"""From files of walks with a prosthesis to a dataset that ``klute-sim diagnose`` reads: trials, repeats, the folder."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.datasets import dataset as datasets
from klute_sim.datasets import format as file_format
from klute_sim.datasets.channels import MEASURED_CHANNELS
from klute_sim.datasets.split import Split
from klute_sim.datasets.write import write_trial
from klute_sim.device import device as device_files
from klute_sim.device.device import Device
from klute_sim.errors import InputError
from klute_sim.gait.replay.prescribed import prepare_prescribed_motion
from klute_sim.mocap import reference_import
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics.prosthesis_kinematics import find_named_sides
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import channel_names, sources
from klute_sim.mocap.parsing.channel_names import Side
from klute_sim.mocap.parsing.time_sync import Signal
from klute_sim.mocap.prosthesis_trials import ProsthesisTrial, extract_prosthesis_trial
from klute_sim.mocap.reference_folder import REPORT_FILE
from klute_sim.mocap.strides import repeats
from klute_sim.provenance import collect_versions
from klute_sim.recording.recording import Array

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
"""Channel -> unit it is written in."""
FILE_SUFFIXES = {
    "shank_angle": "motion",
    "grf_vertical": "load",
    channel_names.PRESSURE_COMMAND: "log",
    channel_names.ANKLE_MOMENT: "moment",
}
"""First channel on a clock -> what its file is called."""
DEVICE_FILE = "device.toml"


@dataclass(frozen=True, kw_only=True)
class DatasetOptions:
    """What a dataset says beside its trials."""

    device: str
    """That was walked on: a preset or a file."""
    uncertainties: Mapping[str, str | float]
    """``section.key`` of the device -> standard deviation, as in dataset.toml: per cent, or a number in its unit."""
    trials_per_group: int | None = None
    """So many trials on end are repeats; None: found out."""


@dataclass(frozen=True, eq=False)
class ImportedDataset:
    """What came of the files."""

    log: ImportLog
    side: Side
    device: Device
    options: DatasetOptions
    trials: tuple[ProsthesisTrial, ...]
    groups: tuple[str, ...]
    """Of every walk."""


def import_dataset(
    files: Sequence[str | Path],
    import_options: ImportOptions,
    dataset_options: DatasetOptions,
    progress: Callable[[float], None] = lambda fraction: None,
) -> ImportedDataset:
    """The walks in ``files``; raises InputError in one sentence for what is wrong, or where none can be replayed."""
    device = device_files.load_device(dataset_options.device)
    if dataset_options.trials_per_group is not None and dataset_options.trials_per_group < 1:
        raise InputError(f"--repeats is {dataset_options.trials_per_group}; allowed: 1 or more")
    parsed = file_format.parse_dataset_file(
        _format_toml(dataset_options, "any", [("-", ["x"], [])]).encode(), "--uncertain"
    )
    file_format.compute_standard_deviations(parsed.uncertain, device.spec.collect_values(), "--uncertain")
    findings = ImportLog()
    read = reference_import.read_files(files, import_options, findings, lambda fraction: progress(0.5 * fraction))
    trials = sources.group_into_trials(read, import_options.mapping, prosthesis=True)
    side = _select_side(trials, import_options)
    found = []
    for number, trial in enumerate(trials):
        one = extract_prosthesis_trial(trial, side, replace(import_options, side=side), findings)
        found += [one] if one is not None else []
        progress(0.5 + 0.5 * (number + 1) / len(trials))
    if not found:
        raise InputError(f"no walk can be replayed from these files: {'; '.join(findings.missing[:3])}")
    return ImportedDataset(
        findings, side, device, dataset_options, tuple(found), _name_groups(found, dataset_options, findings)
    )


def _select_side(trials: Sequence[Sequence[sources.SourceFile]], import_options: ImportOptions) -> Side:
    if import_options.side is not None:
        return import_options.side
    named = {side for trial in trials for side in find_named_sides(trial, import_options)}
    if len(named) == 2:
        raise InputError("these files tell of both legs: say which one wears the prosthesis (--side right or left)")
    return named.pop() if named else "right"


def _name_groups(trials: Sequence[ProsthesisTrial], options: DatasetOptions, log: ImportLog) -> tuple[str, ...]:
    numbers = repeats.group_repeats(trials, options.trials_per_group)
    if options.trials_per_group is None:
        log.add_derived(
            f"Repeats: walks whose stride times differ by no more than {100 * repeats.STRIDE_TIME_TOLERANCE:g} % and whose commanded "
            f"pressures by no more than {100 * repeats.COMMAND_TOLERANCE:g} % of their peak (--repeats)"
        )
    if len(set(numbers)) == len(numbers):
        log.add_missing(
            "Repeats: no walk is a second one under the same pressures at the same speed; without any, noise cannot be "
            "told from what is missing"
        )
    return tuple(f"condition_{number}" for number in numbers)


def write_dataset(imported: ImportedDataset, folder: Path) -> dict[str, Any]:
    """Fill the new folder ``scratch``; the summary. Raises InputError for a walk that cannot be replayed after all."""
    entries, told = [], []
    for number, (one, group) in enumerate(zip(imported.trials, imported.groups, strict=True), 1):
        files = []
        for part, columns in _split_by_clock(one).items():
            files.append(f"walk_{number:02d}_{part}.csv")
            write_trial(folder / files[-1], columns)
        entries.append((group, files, one.files))
        told.append(_describe_trial(one, group, files))
    device = imported.options.device
    if device not in device_files.list_presets():
        device = DEVICE_FILE
        (folder / DEVICE_FILE).write_bytes(imported.device.content)
    (folder / datasets.DATASET_FILE_NAME).write_text(
        _format_toml(imported.options, device, entries), "utf-8", newline="\n"
    )
    written = datasets.load_dataset(folder)
    for trial, one in zip(written.trials, imported.trials, strict=True):
        prepare_prescribed_motion(trial.prescribed, one.name)
    result = _summarize(imported, told, datasets.split_dataset(written))
    (folder / REPORT_FILE).write_text(json.dumps(result, indent=2, allow_nan=False) + "\n", "utf-8")
    return result


def _split_by_clock(trial: ProsthesisTrial) -> dict[str, dict[str, Array]]:
    """The trial's files, one for each clock: heading -> samples."""
    clocks: list[tuple[Array, dict[str, Signal]]] = []
    for name in DATASET_UNITS:
        if name in trial.channels:
            series = trial.channels[name]
            there = next((own for clock, own in clocks if np.array_equal(clock, series.time)), None)
            if there is None:
                clocks.append((series.time, {name: series}))
            else:
                there[name] = series
    return {
        FILE_SUFFIXES.get(next(iter(own)), next(iter(own))): {
            "time [s]": clock,
            **{f"{name} [{DATASET_UNITS[name]}]": series.value for name, series in own.items()},
        }
        for clock, own in clocks
    }


def _format_toml(
    options: DatasetOptions, device: str, trials: Sequence[tuple[str, Sequence[str], Sequence[str]]]
) -> str:
    """``dataset.toml``; JSON strings are TOML's basic strings."""

    def quoted(text: str) -> str:
        return json.dumps(text, ensure_ascii=False)

    lines = [f'format = "{file_format.FORMAT_NAME}"', 'rig = "gait"', f"device = {quoted(device)}"]
    if options.uncertainties:
        lines += ["", "[uncertain]"]
        lines += [
            f"{quoted(k)} = {quoted(v) if isinstance(v, str) else repr(v)}" for k, v in options.uncertainties.items()
        ]
    for group, files, origin in trials:
        lines += ["", f"# {', '.join(map(quoted, origin))}"] if origin else [""]
        lines += ["[[trial]]", f"files = [{', '.join(map(quoted, files))}]", f"group = {quoted(group)}"]
    return "\n".join(lines) + "\n"


def _describe_trial(trial: ProsthesisTrial, group: str, files: Sequence[str]) -> dict[str, Any]:
    return {
        "files": list(files),
        "of": list(trial.files),
        "group": group,
        "strides": len(trial.foot_strikes) - 1,
        "stride_time_s": trial.stride_time,
        "command_peak_bar": float(trial.mean_command(repeats.PHASE_GRID).max()),
        "measured": [name for name in trial.channels if name in MEASURED_CHANNELS["gait"]],
    }


def _summarize(imported: ImportedDataset, trials: list[dict[str, Any]], split: Split) -> dict[str, Any]:
    """Everything that was found and decided; JSON types only."""
    return {
        "format": "klute-sim-import-dataset/1",
        "side": imported.side,
        "device": imported.device.name,
        "trials": trials,
        "split": {"fit": split.fit, "select": split.validation, "show": split.test, "how": split.description},
        **imported.log.as_json(),
        "versions": collect_versions(),
    }
