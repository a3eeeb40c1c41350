"""Specimens of several resting lengths among bench recordings: doubts about the lengths, and lengths in file names."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from klute_sim.datasets.draft.columns import RecognizedFile
from klute_sim.datasets.draft.headings import RELATIVE_UNITS

MIN_SHORTENED_RATIO = 0.65
"""Shortest length of a unit, relative to its resting length (assumed): braided muscles shorten by up to a third."""
MAX_STRETCHED_RATIO = 1.05
"""Longest length of a unit, relative to its resting length (assumed)."""
MIN_RESTING_RATIO = 0.1
"""Shortest resting length in a file name that is believed, relative to that of the device (assumed)."""
MIN_DIFFERENCE = 0.01
"""Smallest difference between resting lengths, relative to that of the device (assumed)."""

_LENGTH_IN_NAME = re.compile(r"(?<![\d.,])(\d+(?:[.,]\d+)?)[ _-]?(mm|cm)(?![^\W\d_])", re.IGNORECASE)


@dataclass(frozen=True)
class RestingLength:
    """Length [m] of a device at rest."""

    muscle: float
    """Length of its muscle; 0 for a device without one."""
    tendon: float
    """Slack length of its tendon; 0 without one."""

    @property
    def unit(self) -> float:
        """Length of muscle and tendon [m]."""
        return self.muscle + self.tendon


@dataclass(frozen=True)
class SpecimenQuestion:
    """Doubt whether one resting length fits all recordings, and lengths that the user may accept."""

    doubt: str
    """Why the resting length of the device does not fit."""
    resting: RestingLength
    """Resting length of the device."""
    proposed: Sequence[float]
    """Resting length [m] of the muscle of each file; empty where their names do not tell."""

    @property
    def remark(self) -> str:
        """What the user has to state."""
        sentence = f"{self.doubt}; state the resting length of each specimen under its [[trial]]"
        if self.proposed:
            return f"{sentence}: the file names tell those that stand there as comments"
        length = f"{1e3 * self.resting.muscle:.6g}"
        return f'{sentence}: specimen = "A", and "muscle.resting_length_mm" = {length} under [trial.device]'

    def format_name(self, index: int) -> list[str]:
        """Return the comment with the name of the specimen of the file ``index``, where there are several."""
        is_needed = len(set(self.proposed)) > 1
        return [f'# specimen = "{1e3 * self.proposed[index]:.6g} mm"'] if is_needed else []

    def format_tables(self, index: int, file: RecognizedFile, *, has_columns: bool) -> list[str]:
        """Return the comments with the numbers of the file ``index``, below its columns if it ``has_columns``."""
        if not self.proposed:
            return []
        muscle_length = self.proposed[index]
        lines = []
        if file.displacement:
            length = file.displacement.format_length(muscle_length + self.resting.tendon)
            lines += [] if has_columns else ["# [trial.columns]"]
            lines.append(f"# length = {json.dumps(length, ensure_ascii=False)}")
        return [*lines, "# [trial.device]", f'# "muscle.resting_length_mm" = {1e3 * muscle_length:.6g}']


def question_specimens(
    files: Sequence[RecognizedFile], resting: RestingLength, named: Sequence[float]
) -> SpecimenQuestion | None:
    """Return the doubt about the resting length of ``files``; None without one.

    ``named`` holds the resting lengths [m] that the file names state, or nothing.
    """
    doubt = _doubt_lengths(files, resting)
    if not doubt and any(file.displacement for file in files):
        doubt = _doubt_names(named, resting)
    return SpecimenQuestion(doubt, resting, named) if doubt else None


def _doubt_lengths(files: Sequence[RecognizedFile], resting: RestingLength) -> str:
    """Return why the lengths of ``files`` do not belong to one unit with the ``resting`` length; '' where they may."""
    lengths = [file.samples["length"] for file in files if "length" in file.choices and file.displacement is None]
    if not lengths or not resting.muscle:
        return ""
    shortest, longest = float(np.nanmin(np.concatenate(lengths))), float(np.nanmax(np.concatenate(lengths)))
    span = f"lengths of {1e3 * shortest:.4g} to {1e3 * longest:.4g} mm"
    if shortest < MIN_SHORTENED_RATIO / MAX_STRETCHED_RATIO * longest:
        return f"{span} are those of muscles with several resting lengths"
    if longest < MIN_SHORTENED_RATIO * resting.unit or shortest > resting.unit / MIN_SHORTENED_RATIO:
        return f"{span} are not those of the device, which has {1e3 * resting.unit:.4g} mm at rest"
    return ""


def _doubt_names(named: Sequence[float], resting: RestingLength) -> str:
    """Return that the resting lengths in file names are not that of the device; '' where they are."""
    if all(abs(length - resting.muscle) <= MIN_DIFFERENCE * resting.muscle for length in named):
        return ""
    shortest, longest = 1e3 * min(named), 1e3 * max(named)
    span = f"a muscle of {shortest:.4g} mm" if shortest == longest else f"muscles of {shortest:.4g} to {longest:.4g} mm"
    return f"the file names state {span}, and that of the device has {1e3 * resting.muscle:.4g} mm"


def find_resting_lengths(files: Sequence[RecognizedFile], resting: RestingLength) -> list[float]:
    """Return the resting length [m] of the muscle that the name of each file states; nothing unless all names do.

    A length that all names share beside another, such as a diameter, is none, and neither is one from which the
    lengths or displacements of the file could not come.
    """
    candidate_lengths = [
        {length for length in _read_lengths(file.path.stem) if _may_rest_at(file, length, resting)} for file in files
    ]
    common = set.intersection(*candidate_lengths) if candidate_lengths else set()
    if all(lengths - common for lengths in candidate_lengths):
        candidate_lengths = [lengths - common for lengths in candidate_lengths]
    if not resting.muscle or any(len(lengths) != 1 for lengths in candidate_lengths):
        return []
    return [next(iter(lengths)) for lengths in candidate_lengths]


def _read_lengths(name: str) -> set[float]:
    return {
        float(number.replace(",", ".")) * (1e-3 if unit.lower() == "mm" else 1e-2)
        for number, unit in _LENGTH_IN_NAME.findall(name)
    }


def _may_rest_at(file: RecognizedFile, muscle_length: float, resting: RestingLength) -> bool:
    """Return whether the unit of ``file`` may have a muscle with this resting length [m]."""
    if muscle_length < MIN_RESTING_RATIO * resting.muscle or "length" not in file.samples:
        return False
    unit_length = muscle_length + resting.tendon
    ratios = file.samples["length"] / unit_length
    if file.displacement:
        is_relative = file.displacement.unit in RELATIVE_UNITS
        ratios = 1.0 + (file.samples["length"] - resting.unit) / (resting.unit if is_relative else unit_length)
    return bool(np.nanmin(ratios) >= MIN_SHORTENED_RATIO and np.nanmax(ratios) <= MAX_STRETCHED_RATIO)
