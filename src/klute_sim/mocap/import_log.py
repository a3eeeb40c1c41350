"""What an import found, decided and doubts: one place that every step tells."""

from dataclasses import dataclass, field
from typing import Any


@dataclass
class ImportLog:
    """Grows while files are imported; every sentence is for the user."""

    files: list[dict[str, Any]] = field(default_factory=list)
    """One entry per file."""
    channels: list[dict[str, Any]] = field(default_factory=list)
    """One entry per channel: from which column, in which unit, with which sign and zero, and why."""
    derived: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    exclusions: dict[str, list[str]] = field(default_factory=dict)
    """Side -> those of the suspicious ones that say why strides of that leg do not count."""

    def add_derived(self, sentence: str) -> None:
        """Note what no file holds and was computed; once, however many trials there are."""
        _append_once(self.derived, sentence)

    def add_missing(self, sentence: str) -> None:
        """Note what is not there."""
        _append_once(self.missing, sentence)

    def add_warning(self, sentence: str) -> None:
        """Note what a careful reader would ask about."""
        _append_once(self.warnings, sentence)

    def add_exclusion(self, side: str, sentence: str) -> None:
        """Note why strides of the leg of ``side`` do not count."""
        self.add_warning(sentence)
        _append_once(self.exclusions.setdefault(side, []), sentence)

    def add_channel(self, **entry: Any) -> None:
        """Note where a channel comes from."""
        if entry not in self.channels:
            self.channels.append(entry)

    def as_json(self) -> dict[str, Any]:
        """JSON types only."""
        return {
            "found": self.files,
            "mapped": self.channels,
            "derived": self.derived,
            "missing": self.missing,
            "suspicious": self.warnings,
        }


def _append_once(sentences: list[str], sentence: str) -> None:
    if sentence not in sentences:
        sentences.append(sentence)
