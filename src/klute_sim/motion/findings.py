"""What an import found, decided and doubts: one place that every step tells."""

from dataclasses import dataclass, field
from typing import Any


@dataclass
class Findings:
    """Grows while files are imported; every sentence is for the user."""

    found: list[dict[str, Any]] = field(default_factory=list)
    """One entry per file."""
    mapped: list[dict[str, Any]] = field(default_factory=list)
    """One entry per channel: from which column, in which unit, with which sign and zero, and why."""
    derived: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    suspicious: list[str] = field(default_factory=list)
    left_out: dict[str, list[str]] = field(default_factory=dict)
    """Side -> those of the suspicious ones that say why strides of that leg do not count."""

    def derive(self, sentence: str) -> None:
        """Note what no file holds and was computed; once, however many trials there are."""
        _once(self.derived, sentence)

    def miss(self, sentence: str) -> None:
        """Note what is not there."""
        _once(self.missing, sentence)

    def suspect(self, sentence: str) -> None:
        """Note what a careful reader would ask about."""
        _once(self.suspicious, sentence)

    def leave_out(self, side: str, sentence: str) -> None:
        """Note why strides of the leg of ``side`` do not count."""
        self.suspect(sentence)
        _once(self.left_out.setdefault(side, []), sentence)

    def map(self, **entry: Any) -> None:
        """Note where a channel comes from."""
        if entry not in self.mapped:
            self.mapped.append(entry)

    def as_json(self) -> dict[str, Any]:
        """JSON types only."""
        return {
            "found": self.found,
            "mapped": self.mapped,
            "derived": self.derived,
            "missing": self.missing,
            "suspicious": self.suspicious,
        }


def _once(sentences: list[str], sentence: str) -> None:
    if sentence not in sentences:
        sentences.append(sentence)
