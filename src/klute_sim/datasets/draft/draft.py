"""Draft of ``dataset.toml`` for a folder of bench recordings."""

import json
import textwrap
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, count
from pathlib import Path

from klute_sim.datasets.channels import get_measured_units, get_prescribed_units
from klute_sim.datasets.dataset import DATASET_FILE_NAME
from klute_sim.datasets.draft.columns import ColumnChoice, RecognizedFile, format_column, recognize_file
from klute_sim.datasets.draft.headings import find_gait_words
from klute_sim.datasets.draft.joining import join_files
from klute_sim.datasets.draft.lengths import interpret_lengths
from klute_sim.datasets.draft.repeats import group_repeats
from klute_sim.datasets.draft.specimens import RestingLength, find_resting_lengths, question_specimens
from klute_sim.datasets.draft.units import assume_units
from klute_sim.datasets.format import FORMAT_NAME
from klute_sim.datasets.remarks import merge_file_remarks
from klute_sim.datasets.trial import MIN_SAMPLES
from klute_sim.datasets.trial_files.column_assignment import format_columns
from klute_sim.datasets.trial_files.sources import MAT_SUFFIXES, PARQUET_SUFFIXES
from klute_sim.device.device import Device
from klute_sim.errors import InputError
from klute_sim.recording.atomic_file import write_atomically

TRIAL_SUFFIXES = (".csv", ".txt", ".tsv", ".dat", ".lvm", *PARQUET_SUFFIXES, *MAT_SUFFIXES)
"""Endings of files that can be trials."""
ASSUMED_PRESSURE_NOISE = "20 mbar"
"""Noise of a measured pressure that stands for the command (assumed)."""
MAX_COMMENT_LENGTH = 120
"""Longest line of a comment [letters]."""
_COMMAND, _PRESSURE = "pressure_command", "pressure"
_EXAMPLES = {
    "time": "row / 1000 [s]",
    "length": "340 [mm]",
    _COMMAND: "3 [bar]",
}
"""Time or prescribed channel -> how ``[columns]`` states it where no column holds it."""


@dataclass(frozen=True)
class DatasetDraft:
    """A draft that :func:`write_dataset_draft` wrote."""

    path: Path
    """The file."""
    text: str
    """Its content."""
    remarks: tuple[str, ...]
    """What the user has to check or to complete, one sentence each."""
    n_trials: int
    """Number of trials."""
    n_groups: int
    """Number of groups of repeats."""

    @property
    def is_complete(self) -> bool:
        """Whether nothing is left to the user but to check what is assumed."""
        return not any(remark.startswith("to do") for remark in self.remarks)


def write_dataset_draft(
    folder: Path, device: Device, device_reference: str, uncertain: Mapping[str, str]
) -> DatasetDraft:
    """Write dataset.toml for the bench recordings in ``folder``.

    ``device_reference`` is the preset or the path that the file names, ``uncertain`` the standard deviations of
    uncertain numbers. Columns are recognized by their words and units, repeats by equal inputs and outputs; each
    assumption is a comment in the file and a remark. Raises InputError when the folder has a dataset.toml, or no file
    that can be read.
    """
    path = folder / DATASET_FILE_NAME
    if path.exists():
        raise InputError(f"{path} exists already; remove it to write a draft, or leave out --draft")
    resting = _get_resting_length(device)
    files, remarks = _recognize_files(folder, resting.unit)
    files = interpret_lengths(files, resting.unit)
    files, noise = _replace_missing_command(files)
    named_lengths = find_resting_lengths(files, resting)
    question = question_specimens(files, resting, named_lengths)
    groups = group_repeats(files, named_lengths)
    shared = _find_shared_choices([file.choices for file in files])
    raw = _find_shared_choices([file.raw_choices for file in files])
    shared_raw = {channel: choice for channel, choice in raw.items() if channel not in shared}
    missing = _list_missing(files, needs_command=device.spec.supply is not None)
    n_read = sum(1 + len(file.companions) for file in files)
    n_files = f"{n_read} {'file' if n_read == 1 else 'files'}"
    lines = [
        f"# Draft from the headings and samples of {n_files}. Check every line, and correct what is wrong.",
        f'format = "{FORMAT_NAME}"',
        'rig = "bench"',
        f"device = {json.dumps(device_reference)}",
        "",
        "# Standard deviations of numbers that are rarely known exactly. The diagnosis refits these before it names",
        "# anything. Delete those that you know, and add others.",
        "[uncertain]",
        *(f'"{key}" = "{deviation}"' for key, deviation in uncertain.items()),
        *_format_columns("[columns]", shared, shared_raw, [c for c in missing if not _is_known(c, files)]),
        *noise,
        *(["", *_format_comment(f"to do: {question.remark}")] if question else []),
    ]
    for index, (file, group) in enumerate(zip(files, _name_groups(files, groups), strict=True)):
        lines += ["", "[[trial]]", f"files = {json.dumps(_list_names(file))}"]
        lines += [f"group = {json.dumps(group)}"] if group else []
        lines += question.format_name(index) if question else []
        trial_choices = {channel: choice for channel, choice in file.choices.items() if shared.get(channel) != choice}
        trial_raw_choices = {
            name: choice for name, choice in file.raw_choices.items() if shared_raw.get(name) != choice
        }
        lacking = [c for c in missing if _is_known(c, files) and not _is_known(c, [file])]
        columns = _format_columns("[trial.columns]", trial_choices, trial_raw_choices, lacking)
        lines += [*columns, *(question.format_tables(index, file, has_columns=bool(columns)) if question else [])]
    remarks += [f"to do: {question.remark}"] if question else []
    remarks += [
        *_describe_joined(files),
        *_describe_choices(files),
        *missing.values(),
        *_describe_repeats(files, groups, missing),
    ]
    text = "\n".join(lines) + "\n"
    try:
        write_atomically(path, text)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}") from None
    return DatasetDraft(path, text, tuple(dict.fromkeys(remarks)), len(files), len(set(groups)))


def _get_resting_length(device: Device) -> RestingLength:
    """Return the length of muscle and tendon of ``device`` at rest; 0 for what it has not."""
    values = device.spec.collect_values()
    muscle, tendon = values.get("muscle.resting_length_mm", 0.0), values.get("tendon.slack_length_mm", 0.0)
    return RestingLength(1e-3 * muscle, 1e-3 * tendon)


def _recognize_files(folder: Path, resting_length: float) -> tuple[list[RecognizedFile], list[str]]:
    """Return the trials in ``folder`` that hold channels of the bench, and a remark for each other file.

    ``resting_length`` [m] is that of the unit.
    """
    try:
        paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in TRIAL_SUFFIXES and path.is_file())
    except OSError as error:
        raise InputError(f"the folder {folder} cannot be read: {error.strerror or error}") from None
    endings = ", ".join(TRIAL_SUFFIXES)
    if not paths:
        raise InputError(f"the folder {folder} contains no recording; allowed are files that end in {endings}")
    recognized, files, left_out = [], [], []
    for path in paths:
        try:
            recognized.append(recognize_file(path))
        except InputError as error:
            left_out.append(str(error))
    _check_rig(folder, recognized)
    units = assume_units(
        [file for file in recognized if len(file.samples) > 1], resting_length
    )  # others hold no channel
    recognized = [recognize_file(file.path, units) for file in recognized] if units else recognized
    for file in join_files(recognized):
        outputs = [file.get_output(channel) for channel in get_measured_units("bench")]
        if any(output is not None and len(output) >= MIN_SAMPLES for output in outputs):
            files.append(file)
        else:
            columns = format_columns(file.unused) or "none"
            left_out.append(
                f"trial file {file.path}: no column with {MIN_SAMPLES} samples was recognized as force, pressure or "
                f"muscle length; its other columns are {columns}"
            )
    if any("time" in file.choices for file in files):
        left_out += [f"trial file {file.path}: it has no time" for file in files if "time" not in file.choices]
        files = [file for file in files if "time" in file.choices]
    remarks = [f"left out: {remark}" for remark in merge_file_remarks(left_out)]
    if not files:
        raise InputError(f"no file of {folder} was recognized as a recording of the bench; {'; '.join(remarks)}")
    return files, remarks


def _check_rig(folder: Path, files: Sequence[RecognizedFile]) -> None:
    """Raise InputError where the headings of ``files`` have words of gait; one such word may be that of a bench."""
    headings: dict[str, str] = {}
    for file in files:
        for heading in (*file.unused, *(choice.heading for choice in file.choices.values())):
            for word in find_gait_words(heading):
                headings.setdefault(word, heading)
    if len(headings) > 1:
        columns = format_columns([*dict.fromkeys(headings.values())][:2])
        raise InputError(
            f"the folder {folder} holds recordings of gait (columns {columns}), and a draft describes those of a "
            "bench; write the dataset with 'klute-sim import FILES --dataset --device DEVICE --out OTHER-FOLDER', with "
            "the files trial by trial (docs/import.md)"
        )


def _replace_missing_command(files: list[RecognizedFile]) -> tuple[list[RecognizedFile], list[str]]:
    """Let the measured pressure stand for the command where no file has a command; also return ``[noise]``."""
    if any(_COMMAND in file.choices for file in files) or not all(_PRESSURE in file.choices for file in files):
        return files, []
    changed = []
    for file in files:
        choice = file.choices[_PRESSURE]
        expression = choice.expression or format_column(choice.heading)
        reason = "no command was recognized; the measured pressure stands for it"
        choices = {name: channel_choice for name, channel_choice in file.choices.items() if name != _PRESSURE}
        choices[_COMMAND] = replace(
            choice, expression=expression, remark="; ".join(filter(None, (choice.remark, reason)))
        )
        samples = {name: channel_samples for name, channel_samples in file.samples.items() if name != _PRESSURE}
        samples[_COMMAND] = file.samples[_PRESSURE]
        changed.append(replace(file, choices=choices, samples=samples))
    lines = ["", "[noise]", f'{_COMMAND} = "{ASSUMED_PRESSURE_NOISE}"  # assumed; state that of your gauge']
    return changed, lines


def _find_shared_choices(choices_of_files: Sequence[Mapping[str, ColumnChoice]]) -> dict[str, ColumnChoice]:
    """Return the commonest choice of each channel: those of ``[columns]``."""
    counts: dict[str, Counter[ColumnChoice]] = {}
    for choices in choices_of_files:
        for channel, choice in choices.items():
            counts.setdefault(channel, Counter())[choice] += 1
    return {channel: counter.most_common(1)[0][0] for channel, counter in counts.items()}


def _list_missing(files: Sequence[RecognizedFile], *, needs_command: bool) -> dict[str, str]:
    """Return time and prescribed channels that a file lacks, with a sentence about the files."""
    missing = {}
    for channel in ("time", *get_prescribed_units("bench")):
        if channel == _COMMAND and not needs_command:
            continue
        lacking = [file for file in files if not _is_known(channel, [file])]
        if lacking:
            table = "[trial.columns]" if _is_known(channel, files) else "[columns]"
            others = f" and {len(lacking) - 1} more files" if len(lacking) > 1 else ""
            columns = format_columns(lacking[0].unused)
            missing[channel] = (
                f"to do: no column of {lacking[0].path.name}{others} was recognized as {channel}; state it under "
                f'{table}, for example {channel} = "{_EXAMPLES[channel]}"'
                + (f"; columns that are not used: {columns}" if columns else "")
            )
    return missing


def _is_known(channel: str, files: Sequence[RecognizedFile]) -> bool:
    """Return whether any of ``files`` has ``channel`` or its raw reading."""
    return any(channel in file.choices or channel in file.raw_choices for file in files)


def _format_columns(
    table: str, choices: Mapping[str, ColumnChoice], raw: Mapping[str, ColumnChoice], missing: Sequence[str]
) -> list[str]:
    """Return the lines of ``[columns]`` or ``[trial.columns]``; ``raw`` and ``missing`` channels become comments."""
    lines = []
    for channel, choice in choices.items():
        if choice.list_expressions():
            lines += _format_comment(f"{channel}: {choice.remark}; check this") if choice.remark else []
            lines.append(_format_assignment(channel, choice))
    for channel, choice in raw.items():
        lines += _format_comment(f"{channel}: {choice.remark}")
        lines.append(f"# {_format_assignment(channel, choice)}   # to do")
    lines += [f'# {channel} = "{_EXAMPLES[channel]}"   # to do: no column was recognized' for channel in missing]
    return [*([""] if table == "[columns]" else []), table, *lines] if lines else []


def _format_comment(text: str) -> list[str]:
    return textwrap.wrap(
        text,
        MAX_COMMENT_LENGTH,
        initial_indent="# ",
        subsequent_indent="# ",
        break_long_words=False,
        break_on_hyphens=False,
    )


def _format_assignment(channel: str, choice: ColumnChoice) -> str:
    expressions = choice.list_expressions()
    return f"{channel} = {json.dumps(expressions if len(expressions) > 1 else expressions[0], ensure_ascii=False)}"


def _name_groups(files: Sequence[RecognizedFile], groups: Sequence[int]) -> list[str]:
    """Return the name of the group of each file, which is that of no trial; '' for a file without repeats."""
    members: dict[int, list[str]] = {}
    for file, group in zip(files, groups, strict=True):
        members.setdefault(group, []).append(file.path.stem)
    taken = {"+".join(Path(name).stem for name in _list_names(file)) for file in files}
    names: dict[int, str] = {}
    for group, stems in members.items():
        if len(stems) > 1:
            name = _find_common_beginning(stems).rstrip("_-. ") or stems[0]
            numbered = (f"{name}_repeats_{number}" for number in count(2))
            names[group] = next(
                candidate for candidate in chain((name, f"{name}_repeats"), numbered) if candidate not in taken
            )
            taken.add(names[group])
    return [names.get(group, "") for group in groups]


def _find_common_beginning(texts: Sequence[str]) -> str:
    n_common = next((k for k, letters in enumerate(zip(*texts, strict=False)) if len(set(letters)) > 1), None)
    return min(texts, key=len)[:n_common]


def _list_names(file: RecognizedFile) -> list[str]:
    """Return the names of the files of a trial."""
    return [path.name for path in (file.path, *file.companions)]


def _describe_joined(files: Sequence[RecognizedFile]) -> list[str]:
    joined = [file for file in files if file.companions]
    if not joined:
        return []
    others = f", and {len(joined) - 1} more trials" if len(joined) > 1 else ""
    names = " and ".join(_list_names(joined[0]))
    return [
        f"check the files: by their names, {names} are files of one trial{others}; all of them count from one instant"
    ]


def _describe_choices(files: Sequence[RecognizedFile]) -> list[str]:
    """Return a remark for each choice that assumes something, and for the columns that are not used."""
    remarks = []
    for file in files:
        for channel, choice in file.choices.items():
            if choice.remark:
                remarks.append(f"check {_format_assignment(channel, choice)}: {choice.remark}")
        for channel, choice in file.raw_choices.items():
            remarks.append(f'to do: {channel} = "{choice.expression}": {choice.remark}')
    unused = dict.fromkeys(heading for file in files for heading in file.unused)
    if unused:
        remarks.append(f"not used: the columns {format_columns([*unused])}")
    return remarks


def _describe_repeats(files: Sequence[RecognizedFile], groups: Sequence[int], missing: Mapping[str, str]) -> list[str]:
    """Return remarks about files without repeats, and about inputs that could not be compared."""
    advice = "if some are repeats, give them one group"
    sizes = Counter(groups)
    alone = [file.path.name for file, group in zip(files, groups, strict=True) if sizes[group] == 1]
    unknown = [channel for channel in get_prescribed_units("bench") if channel in missing]
    if not any(_is_known(channel, files) for channel in get_prescribed_units("bench")):
        return [f"repeats are not recognized without {' and '.join(unknown)}; {advice}"]
    if len(alone) == len(files):
        return [f"no two files have equal inputs, so no repeats measure the noise; {advice}"]
    remarks = [f"check the groups: repeats are recognized without {' and '.join(unknown)}"] if unknown else []
    remarks += [f"check the groups: no other file has the inputs of {format_columns(alone)}; {advice}"] if alone else []
    return remarks
