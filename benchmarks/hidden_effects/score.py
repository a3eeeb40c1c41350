"""Whether a verdict is right, given the sealed truth."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

Truth = Mapping[str, Any]
Verdict = Mapping[str, Any]

FLAGGED = {"unexplained", "insufficient-data"}
ABSORBED = 0.6
"""Size after refitting, in units of the noise, below which nothing is left that could be found."""


def label(effect: Mapping[str, Any]) -> str:
    """An effect's name; with its channel if it is an instrument's."""
    return f"{effect['name']}@{effect['channel']}" if effect.get("channel") else str(effect["name"])


def hidden(truth: Truth) -> list[str]:
    """What is hidden, sorted."""
    return sorted(label(each) for each in [*truth["effects"], *truth["instruments"]])


def named(verdict: Verdict) -> list[str]:
    """What was named, sorted; proxies are not named."""
    if verdict["verdict"] not in ("named", "ambiguous"):
        return []
    return sorted(label(each) for each in verdict["effects"])


def size(verdict: Verdict) -> float:
    """What a refitted device leaves on trials that no fit saw, rms over the noise, in the worst channel."""
    return _above(verdict, "before")


def _above(verdict: Verdict, when: str) -> float:
    """Rms over the noise, ``before`` or ``after`` effects were added; 0 where the noise is not known."""
    gaps = [gap for gap in verdict.get("gap", {}).values() if gap["floor"]]
    return math.sqrt(max([0.0, *((gap[when] / gap["floor"]) ** 2 - 1.0 for gap in gaps)]))


def score(truth: Truth, verdict: Verdict, deleted: Sequence[str] = ()) -> str:
    """One word for what became of it.

    ``right``, ``wrong`` (a name that is not true), ``missed``, ``absorbed``, ``part``, ``flagged`` or ``false-alarm``.

    *right*: exactly what is hidden was named, or it is among the sets that an ambiguous verdict lists; for clean data,
    that nothing is missing; for defective data and effects that were ``deleted`` from the catalogue, that the program
    did not answer with a name. *part*: some of several, and nothing else. *absorbed*: nothing or only some was named,
    and nothing is left to name, because the device's uncertain numbers, within what they may be, imitate the rest.
    """
    true, found, kind = hidden(truth), named(verdict), verdict["verdict"]
    if truth.get("defect"):
        return "right" if not found else "false-alarm"
    if deleted:
        quiet = "absorbed" if size(verdict) < ABSORBED else "missed"
        return "flagged" if kind == "unexplained" else (quiet if kind == "nothing-missing" else "wrong")
    if not true:
        return "right" if kind == "nothing-missing" else ("false-alarm" if found else "flagged")
    if found == true:
        return "right"
    if kind == "ambiguous" and true in [sorted(each) for each in verdict["alternatives"]]:
        return "right"
    if kind == "nothing-missing" and size(verdict) < ABSORBED:
        return "absorbed"
    if not found:
        return "flagged" if kind in FLAGGED else "missed"
    if set(found) < set(true):
        return "absorbed" if _above(verdict, "after") < ABSORBED else "part"
    return "wrong"


def kinds_confused(truth: Truth, verdict: Verdict) -> bool:
    """Whether a fault of an instrument was taken for physics, or the other way round."""
    found = named(verdict)
    physics, faults = any("@" not in name for name in found), any("@" in name for name in found)
    return bool((faults and not truth["instruments"]) or (physics and not truth["effects"]))
