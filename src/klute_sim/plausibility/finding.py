"""A finding: something implausible in a user's file, its likely cause, and the name with which the user accepts it."""

from collections.abc import Callable, Collection, Iterable, Sequence
from typing import NamedTuple

from klute_sim.errors import InputError, suggest

KINDS = frozenset(
    {"absolute", "axis", "constant", "delay", "exchanged", "gap", "geometry", "length", "missing", "origin", "reversed"}
    | {"scale", "sign", "spike", "start", "unit", "wrapped", "zero"}
)
"""Last words of the names of findings in trials; the words before them are channels or :data:`SUBJECTS`."""
SUBJECTS = frozenset({"forward", "log", "marker", "mass", "plate", "side", "stature", "stride", "time"})
"""What else the findings in trials concern."""
MAX_LISTED_FINDINGS = 4
"""Maximum number of findings that one error lists."""


class Finding(NamedTuple):
    """One implausible property of a file."""

    name: str
    """What the user accepts, such as ``force-unit``: a channel and the kind of the mistake."""
    place: str
    """File, trial or section, such as ``trial 'a'``."""
    statement: str
    """What was found, what is expected, the likely mistake and its correction; without place and full stop."""

    @property
    def sentence(self) -> str:
        """Place and statement, without full stop."""
        return f"{self.place}: {self.statement}"


class TrialFindings(NamedTuple):
    """What is implausible in the trials of a dataset."""

    findings: list[Finding]
    """Findings in the order of the checks."""
    questioned_places: frozenset[str]
    """Places of the findings about the channels of single trials. Further checks leave these trials out: accepted
    channels may be unusual."""


class ImplausibleInputError(InputError):
    """A file is readable, but holds something implausible that the user has not accepted."""

    def __init__(self, message: str, findings: Sequence[Finding]) -> None:
        """Report ``findings`` with the sentence ``message``."""
        super().__init__(message)
        self.findings = tuple(findings)


def are_accepted(findings: Iterable[Finding], accepted: Collection[str]) -> bool:
    """Return whether all ``findings`` are among the names that the user accepts; further checks need this."""
    return all(finding.name in accepted for finding in findings)


def format_options(names: Sequence[str]) -> str:
    """Return the options of the command line that accept findings with ``names``."""
    return " ".join(f"--accept {name}" for name in names)


def check_accepted_names(
    names: Iterable[str],
    findings: Iterable[Finding],
    channels: Collection[str],
    others: Collection[str] = (),
    place: str = "",
) -> None:
    """Raise InputError for one of ``names`` to accept that no finding in trials with ``channels`` can have.

    ``others`` are further possible names. The sentence begins with ``place`` and lists the names of the ``findings``; a
    possible one that is not among them is allowed, because the same names may be accepted for several datasets.
    """
    finding_names = list(dict.fromkeys(finding.name for finding in findings))
    for name in names:
        *subjects, kind = name.split("-")
        is_possible = bool(subjects) and kind in KINDS and {*subjects} <= {*channels, *SUBJECTS}
        if not is_possible and name not in (*finding_names, *others):
            listing = (
                f"found in these data: {', '.join(finding_names)}"
                if finding_names
                else "these data have none to accept"
            )
            raise InputError(f"{place}there is no finding '{name}'; {suggest(name, finding_names, listing)}")


def require_accepted(
    findings: Iterable[Finding],
    accepted: Collection[str] = (),
    format_instructions: Callable[[Sequence[str]], str] = format_options,
) -> tuple[Finding, ...]:
    """Return the accepted ``findings``; raise ImplausibleInputError when there are others.

    ``accepted`` holds names of findings. ``format_instructions`` tells the user how to accept findings with given
    names. Findings of one name are reported once, with the number of the others.
    """
    all_findings = tuple(findings)
    refused = [finding for finding in all_findings if finding.name not in accepted]
    if not refused:
        return all_findings
    by_name: dict[str, list[Finding]] = {}
    for finding in refused:
        by_name.setdefault(finding.name, []).append(finding)
    sentences = []
    for group in list(by_name.values())[:MAX_LISTED_FINDINGS]:
        n_others = len({finding.place for finding in group} - {group[0].place})
        others = f" (and in {n_others} more {_get_noun(group[0].place, n_others)})" if n_others else ""
        sentences.append(f"{group[0].sentence}{others}")
    if len(by_name) > MAX_LISTED_FINDINGS:
        sentences.append(f"and {len(by_name) - MAX_LISTED_FINDINGS} more findings")
    instructions = format_instructions(list(by_name)[:MAX_LISTED_FINDINGS])
    raise ImplausibleInputError(
        f"{'; '.join(sentences)}. If this is no mistake, accept it with {instructions}", refused
    )


def _get_noun(place: str, number: int) -> str:
    """Return the first word of ``place``, such as 'trial', in the number that fits."""
    word = place.split(" ", 1)[0]
    noun = word if word.isalpha() else "place"
    return noun if number == 1 else f"{noun}s"
