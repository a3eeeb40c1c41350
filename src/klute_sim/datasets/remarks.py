"""Remarks about a dataset: its files, which share a sentence where they can, its scope, and accepted findings."""

import re
from collections.abc import Sequence

from klute_sim.datasets.channels import TENSION_CHANNELS, RigName
from klute_sim.datasets.trial import Trial
from klute_sim.plausibility.finding import Finding

MAX_LISTED_TRIALS = 5
"""Maximum number of trials that one remark lists."""
_FILE_REMARK = re.compile(r"trial file (?P<file>.+?): (?P<text>.+)")


def merge_file_remarks(remarks: Sequence[str]) -> list[str]:
    """Return ``remarks``, where several files with the same one share a sentence."""
    files: dict[str, list[str]] = {}
    for remark in remarks:
        match = _FILE_REMARK.fullmatch(remark)
        files.setdefault(match["text"] if match else remark, []).append(match["file"] if match else "")
    merged = []
    for text, names in files.items():
        others = f" and {len(names) - 1} more" if len(names) > 1 else ""
        merged.append(f"trial file {names[0]}{others}: {text}" if names[0] else text)
    return merged


def collect_file_remarks(trials: Sequence[Trial], file_remarks: Sequence[tuple[str, ...]]) -> list[str]:
    """Return the remarks about each file once, and the channels that a trial with remarks lacks and its repeats have.

    A misnamed column causes both.
    """
    remarks: dict[str, None] = {}
    for trial, trial_remarks in zip(trials, file_remarks, strict=True):
        if not trial_remarks:
            continue
        channels_of_repeats = {c: None for other in trials if other.group == trial.group for c in other.measured}
        missing = [channel for channel in channels_of_repeats if channel not in trial.measured]
        remarks |= dict.fromkeys(trial_remarks)
        if missing:
            remarks[f"trial '{trial.name}' has no {' and no '.join(missing)}, which its repeats have"] = None
    return merge_file_remarks(list(remarks))


def describe_scope(trials: Sequence[Trial], rig: RigName) -> list[str]:
    """Return a remark about bench trials that show the supply only, where others show the device."""
    limited = [trial for trial in trials if TENSION_CHANNELS.isdisjoint(trial.measured)]
    if rig != "bench" or len(limited) in (0, len(trials)):
        return []
    noun, verb = ("trials", "measure") if len(limited) > 1 else ("trial", "measures")
    return [f"{noun} {_list_names(limited)} {verb} neither force nor muscle_length, and can show the supply only"]


def describe_accepted(
    accepted: Sequence[Finding], names: Sequence[str], source: str, questioned: Sequence[Trial]
) -> list[str]:
    """Return a remark for each accepted finding and for each of ``names`` in the file that accepts nothing.

    One more remark names the ``questioned`` trials, which further checks leave out.
    """
    accepted_names = {finding.name for finding in accepted}
    scope = " in trials without accepted findings" if questioned else ""
    return [
        *(f"accepted: {finding.sentence}" for finding in accepted),
        *_describe_questioned(questioned),
        *(
            f"{source}: 'accept' names '{name}', which was not found{scope}"
            for name in names
            if name not in accepted_names
        ),
    ]


def _describe_questioned(trials: Sequence[Trial]) -> list[str]:
    if not trials:
        return []
    noun = "trials" if len(trials) > 1 else "trial"
    return [f"further checks left out {noun} {_list_names(trials)}, because findings there are accepted"]


def _list_names(trials: Sequence[Trial]) -> str:
    names = [f"'{trial.name}'" for trial in trials]
    return ", ".join(names[:MAX_LISTED_TRIALS]) + (" and others" if len(names) > MAX_LISTED_TRIALS else "")
