"""Log of an import: files, channels, and sentences about derived, missing and suspicious data."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from typing import Any

from klute_sim.plausibility import finding
from klute_sim.plausibility.finding import Finding


@dataclass
class ImportLog:
    """Record that every step of an import extends; every sentence is addressed to the user."""

    files: list[dict[str, Any]] = field(default_factory=list)
    """Description of each file, see :meth:`klute_sim.mocap.parsing.sources.SourceFile.describe`."""
    channels: list[dict[str, Any]] = field(default_factory=list)
    """Origin of each channel: file, column, unit, sign, zero, and the reason for these."""
    derived: list[str] = field(default_factory=list)
    """Sentences on quantities that were computed because no file contains them."""
    missing: list[str] = field(default_factory=list)
    """Sentences on missing data."""
    warnings: list[str] = field(default_factory=list)
    """Sentences on suspicious data."""
    accepted: list[str] = field(default_factory=list)
    """Names of implausible properties that the user accepted."""
    exclusions: dict[str, list[str]] = field(default_factory=dict)
    """Side -> warnings that explain why strides of that leg were excluded."""

    def add_derived(self, sentence: str) -> None:
        """Add a sentence on a computed quantity; repetitions are ignored."""
        _append_once(self.derived, sentence)

    def add_missing(self, sentence: str) -> None:
        """Add a sentence on missing data; repetitions are ignored."""
        _append_once(self.missing, sentence)

    def add_warning(self, sentence: str) -> None:
        """Add a sentence on suspicious data; repetitions are ignored."""
        _append_once(self.warnings, sentence)

    def add_exclusion(self, side: str, sentence: str) -> None:
        """Add a warning that explains why strides of the leg of ``side`` were excluded."""
        self.add_warning(sentence)
        _append_once(self.exclusions.setdefault(side, []), sentence)

    def require_accepted(self, findings: Iterable[Finding], accept: Collection[str]) -> None:
        """Add a warning for each of ``findings`` that ``accept`` names; raise ImplausibleInputError for the others."""
        for accepted in finding.require_accepted(findings, accept):
            self.add_warning(f"accepted: {accepted.sentence}")
            _append_once(self.accepted, accepted.name)

    def add_channel(self, **entry: Any) -> None:
        """Add the origin of a channel; repetitions are ignored."""
        if entry not in self.channels:
            self.channels.append(entry)

    def add_sign(self, sign: int, reason: str, *, channel: str, side: str, file: str, unit: str) -> None:
        """Add the detected ``sign`` of a channel to its origin, or the origin if the load of a force plate has none."""
        entries = [e for e in self.channels if (e["channel"], e["side"], e["file"]) == (channel, side, file)]
        reason = f"sign: {reason}"
        if not entries:
            place = {"channel": channel, "side": side, "file": file, "column": "force plates"}
            self.add_channel(**place, unit=unit, sign=sign, zero=0.0, reason=reason)
        for entry in entries:
            if not entry["reason"].endswith(reason):
                entry.update(sign=sign, reason=f"{entry['reason']}; {reason}")

    def as_json(self) -> dict[str, Any]:
        """Return the log as JSON types."""
        return {
            "files": self.files,
            "channels": self.channels,
            "derived": self.derived,
            "missing": self.missing,
            "warnings": self.warnings,
            "accepted": self.accepted,
        }


def _append_once(sentences: list[str], sentence: str) -> None:
    if sentence not in sentences:
        sentences.append(sentence)
