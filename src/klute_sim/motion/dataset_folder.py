"""From files of walks with a prosthesis to a dataset that ``klute-sim diagnose`` reads: trials, repeats, the folder."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.dataset import dataset as datasets
from klute_sim.dataset import format as file_format
from klute_sim.dataset.channels import MEASURED
from klute_sim.dataset.split import Split
from klute_sim.dataset.write import write_trial
from klute_sim.device import files as device_files
from klute_sim.device.files import Device
from klute_sim.errors import InputError
from klute_sim.motion import importing, names, repeats, sources
from klute_sim.motion.clocks import Series
from klute_sim.motion.findings import Findings
from klute_sim.motion.folder import REPORT
from klute_sim.motion.moving import sides
from klute_sim.motion.names import Side
from klute_sim.motion.options import ImportOptions
from klute_sim.motion.walks import Walk, walk
from klute_sim.provenance import versions
from klute_sim.recording.recording import Samples
from klute_sim.rigs.replay.prescribed import prescribed

UNITS = {
    **{"shank_angle": "deg", "ankle_x": "m", "ankle_z": "m", "grf_vertical": "N", "grf_forward": "N", "cop_x": "m"},
    **{names.COMMAND: "bar", names.PRESSURE: "bar", names.FORCE: "N", names.LENGTH: "mm"},
    **{"ankle_angle": "deg", names.MOMENT: "N*m"},
}
"""Channel -> unit it is written in."""
PARTS = {"shank_angle": "motion", "grf_vertical": "load", names.COMMAND: "log", names.MOMENT: "moment"}
"""First channel on a clock -> what its file is called."""
DEVICE = "device.toml"


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """What a dataset says beside its trials."""

    device: str
    """That was walked on: a preset or a file."""
    uncertain: Mapping[str, str | float]
    """``section.key`` of the device -> standard deviation, as in dataset.toml: per cent, or a number in its unit."""
    repeats: int | None = None
    """So many trials on end are repeats; None: found out."""


@dataclass(frozen=True, eq=False)
class Gathered:
    """What came of the files."""

    findings: Findings
    side: Side
    device: Device
    wanted: Wanted
    walks: tuple[Walk, ...]
    groups: tuple[str, ...]
    """Of every walk."""


def gather(
    files: Sequence[str | Path],
    options: ImportOptions,
    wanted: Wanted,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Gathered:
    """The walks in ``files``; raises InputError in one sentence for what is wrong, or where none can be replayed."""
    device = device_files.load(wanted.device)
    if wanted.repeats is not None and wanted.repeats < 1:
        raise InputError(f"--repeats is {wanted.repeats}; allowed: 1 or more")
    parsed = file_format.parse(_toml(wanted, "any", [("-", ["x"], [])]).encode(), "--uncertain")
    file_format.standard_deviations(parsed.uncertain, device.spec.numbers(), "--uncertain")
    findings = Findings()
    read = importing.read_all(files, options, findings, lambda fraction: progress(0.5 * fraction))
    trials = sources.trials(read, options.chosen, prosthesis=True)
    side = _side(trials, options)
    found = []
    for number, trial in enumerate(trials):
        one = walk(trial, side, replace(options, side=side), findings)
        found += [one] if one is not None else []
        progress(0.5 + 0.5 * (number + 1) / len(trials))
    if not found:
        raise InputError(f"no walk can be replayed from these files: {'; '.join(findings.missing[:3])}")
    return Gathered(findings, side, device, wanted, tuple(found), _named(found, wanted, findings))


def _side(trials: Sequence[Sequence[sources.Source]], options: ImportOptions) -> Side:
    if options.side is not None:
        return options.side
    named = {side for trial in trials for side in sides(trial, options)}
    if len(named) == 2:
        raise InputError("these files tell of both legs: say which one wears the prosthesis (--side right or left)")
    return named.pop() if named else "right"


def _named(walks: Sequence[Walk], wanted: Wanted, findings: Findings) -> tuple[str, ...]:
    numbers = repeats.groups(walks, wanted.repeats)
    if wanted.repeats is None:
        findings.derive(
            f"Repeats: walks whose stride times differ by no more than {100 * repeats.PACE:g} % and whose commanded "
            f"pressures by no more than {100 * repeats.ALIKE:g} % of their peak (--repeats)"
        )
    if len(set(numbers)) == len(numbers):
        findings.miss(
            "Repeats: no walk is a second one under the same pressures at the same speed; without any, noise cannot be "
            "told from what is missing"
        )
    return tuple(f"condition_{number}" for number in numbers)


def write(gathered: Gathered, scratch: Path) -> dict[str, Any]:
    """Fill the new folder ``scratch``; the summary. Raises InputError for a walk that cannot be replayed after all."""
    entries, told = [], []
    for number, (one, group) in enumerate(zip(gathered.walks, gathered.groups, strict=True), 1):
        files = []
        for part, columns in _parts(one).items():
            files.append(f"walk_{number:02d}_{part}.csv")
            write_trial(scratch / files[-1], columns)
        entries.append((group, files, one.files))
        told.append(_told(one, group, files))
    device = gathered.wanted.device
    if device not in device_files.preset_names():
        device = DEVICE
        (scratch / DEVICE).write_bytes(gathered.device.content)
    (scratch / datasets.FILE).write_text(_toml(gathered.wanted, device, entries), "utf-8", newline="\n")
    written = datasets.read(scratch)
    for trial, one in zip(written.trials, gathered.walks, strict=True):
        prescribed(trial.prescribed, one.name)
    result = _summary(gathered, told, datasets.split(written))
    (scratch / REPORT).write_text(json.dumps(result, indent=2, allow_nan=False) + "\n", "utf-8")
    return result


def _parts(one: Walk) -> dict[str, dict[str, Samples]]:
    """The trial's files, one for each clock: heading -> samples."""
    clocks: list[tuple[Samples, dict[str, Series]]] = []
    for name in UNITS:
        if name in one.channels:
            series = one.channels[name]
            there = next((own for clock, own in clocks if np.array_equal(clock, series.time)), None)
            if there is None:
                clocks.append((series.time, {name: series}))
            else:
                there[name] = series
    return {
        PARTS.get(next(iter(own)), next(iter(own))): {
            "time [s]": clock,
            **{f"{name} [{UNITS[name]}]": series.value for name, series in own.items()},
        }
        for clock, own in clocks
    }


def _toml(wanted: Wanted, device: str, trials: Sequence[tuple[str, Sequence[str], Sequence[str]]]) -> str:
    """``dataset.toml``; JSON strings are TOML's basic strings."""

    def quoted(text: str) -> str:
        return json.dumps(text, ensure_ascii=False)

    lines = [f'format = "{file_format.FORMAT}"', 'rig = "gait"', f"device = {quoted(device)}"]
    if wanted.uncertain:
        lines += ["", "[uncertain]"]
        lines += [f"{quoted(k)} = {quoted(v) if isinstance(v, str) else repr(v)}" for k, v in wanted.uncertain.items()]
    for group, files, origin in trials:
        lines += ["", f"# {', '.join(map(quoted, origin))}"] if origin else [""]
        lines += ["[[trial]]", f"files = [{', '.join(map(quoted, files))}]", f"group = {quoted(group)}"]
    return "\n".join(lines) + "\n"


def _told(one: Walk, group: str, files: Sequence[str]) -> dict[str, Any]:
    return {
        "files": list(files),
        "of": list(one.files),
        "group": group,
        "strides": len(one.strikes) - 1,
        "stride_time_s": one.stride_time,
        "command_peak_bar": float(one.command(repeats.PHASE).max()),
        "measured": [name for name in one.channels if name in MEASURED["gait"]],
    }


def _summary(gathered: Gathered, trials: list[dict[str, Any]], split: Split) -> dict[str, Any]:
    """Everything that was found and decided; JSON types only."""
    return {
        "format": "klute-sim-import-dataset/1",
        "side": gathered.side,
        "device": gathered.device.name,
        "trials": trials,
        "split": {"fit": split.fit, "select": split.select, "show": split.show, "how": split.how},
        **gathered.findings.as_json(),
        "versions": versions(),
    }
