"""Remarks about a dataset: files that share one share its sentence, and accepted findings."""

import re
from collections.abc import Sequence

from klute_sim.plausibility.finding import Finding

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


def describe_accepted(accepted: Sequence[Finding], names: Sequence[str], source: str) -> list[str]:
    """Return a remark for each accepted finding and for each of ``names`` in the file that accepts nothing."""
    found = {finding.name for finding in accepted}
    unused = [f"{source}: 'accept' names '{name}', which was not found" for name in names if name not in found]
    return [*(f"accepted: {finding.sentence}" for finding in accepted), *unused]
