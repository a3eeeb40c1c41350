"""Whether a verdict is right, given the sealed truth."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

Truth = Mapping[str, Any]
Verdict = Mapping[str, Any]

FLAGGED = {"unexplained", "insufficient-data"}
TOLD = {"named", "ambiguous"}
ABSORBED = 0.6
"""What is left after refitting, in units of the noise, below which nothing is left that could be found."""
BAD = {"wrong", "false-alarm"}
"""Outcomes with a name that is not true."""


def label(effect: Mapping[str, Any]) -> str:
    """An effect's name; with its channel if it is an instrument's."""
    return f"{effect['name']}@{effect['channel']}" if effect.get("channel") else str(effect["name"])


def hidden(truth: Truth) -> list[str]:
    """What is hidden, sorted."""
    kinds = ("effects", "instruments", "strangers")
    return sorted(label(each) for kind in kinds for each in truth.get(kind, ()))


def outside(truth: Truth) -> bool:
    """Whether what is hidden is in no catalogue that was used."""
    return bool(truth.get("strangers") or truth.get("deleted"))


def named(verdict: Verdict) -> list[str]:
    """What was named, sorted; proxies are not named."""
    return sorted(label(each) for each in verdict["effects"]) if verdict["verdict"] in TOLD else []


def sets(verdict: Verdict) -> list[list[str]]:
    """All sets of effects that the verdict lists, what was named first."""
    others = verdict["alternatives"] if verdict["verdict"] == "ambiguous" else []
    return [named(verdict), *(sorted(each) for each in others)]


def left(verdict: Verdict) -> float:
    """What a refitted device leaves on trials that no fit saw, rms over the noise, in the worst channel."""
    return _above(verdict, "before")


def _above(verdict: Verdict, when: str) -> float:
    """Rms over the noise, ``before`` or ``after`` effects were added; 0 where the noise is not known."""
    gaps = [gap for gap in verdict.get("gap", {}).values() if gap["floor"]]
    return math.sqrt(max([0.0, *((gap[when] / gap["floor"]) ** 2 - 1.0 for gap in gaps)]))


def twins(name: str, verdict: Verdict) -> set[str]:
    """Effects that, by the program's own account, these data hardly tell from ``name``."""
    return {other for pair in verdict.get("alike", ()) if name in pair for other in pair} - {name}


def score(truth: Truth, verdict: Verdict) -> str:
    """One word for what became of it.

    ``right``, ``twin``, ``loose``, ``part``, ``absorbed``, ``missed``, ``flagged``, ``wrong`` or ``false-alarm``.

    *right*: exactly what is hidden was named, or an ambiguous verdict lists it among no more sets than there are near
    twins (*loose*: among more); for clean data, that nothing is missing; for defective data, that the program did not
    answer with a name. What is in no catalogue that was used is to be *flagged*. *twin*: a near twin was named in its
    place. *part*: some of several, and nothing else. *absorbed*: nothing or only some was named, and nothing is left to
    name, because the device's uncertain numbers, within what they may be, imitate the rest. *wrong*: a name that is
    none of these.
    """
    true, found, kind = hidden(truth), named(verdict), verdict["verdict"]
    nothing_left = kind == "nothing-missing" and left(verdict) < ABSORBED
    if truth.get("defect"):
        return "false-alarm" if found else "right"
    if not true:
        return "right" if kind == "nothing-missing" else ("false-alarm" if found else "flagged")
    if outside(truth):
        quiet = "absorbed" if nothing_left else "missed"
        return "wrong" if found else quiet if kind == "nothing-missing" else "flagged"
    if true in sets(verdict):
        most = 1 + sum(len(twins(name, verdict)) for name in true)
        return "right" if len(sets(verdict)) <= max(2, most) else "loose"
    if nothing_left:
        return "absorbed"
    if not found:
        return "flagged" if kind in FLAGGED else "missed"
    if set(found) < set(true):
        return "absorbed" if _above(verdict, "after") < ABSORBED else "part"
    return "twin" if _twin(true, found, verdict) else "wrong"


def resolved(truth: Truth, again: Verdict) -> str:
    """One word for what became of an ambiguous verdict with the data it asked for: :func:`score`'s, or *open*.

    *open*: the truth is still one of several.
    """
    word = score(truth, again)
    return "open" if word == "right" and again["verdict"] == "ambiguous" else word


def _twin(true: Sequence[str], found: Sequence[str], verdict: Verdict) -> bool:
    """Whether ``found`` is ``true`` or some of it, with near twins in places."""
    open_ = [name for name in true if name not in found]
    for name in (name for name in found if name not in true):
        taken = next((each for each in open_ if name in twins(each, verdict)), None)
        if taken is None:
            return False
        open_.remove(taken)
    return True


def first_right(truth: Truth, verdict: Verdict) -> bool:
    """Whether the first effect that was named is one that is hidden, or a rival of it is."""
    if verdict["verdict"] not in TOLD:
        return False
    return label(verdict["effects"][0]) in hidden(truth) or hidden(truth) in sets(verdict)


def kinds_confused(truth: Truth, verdict: Verdict) -> bool:
    """Whether a fault of an instrument was taken for physics, or the other way round."""
    found = named(verdict)
    if hidden(truth) in sets(verdict):
        return False
    physics, faults = any("@" not in name for name in found), any("@" in name for name in found)
    return bool((faults and not truth["instruments"]) or (physics and not truth["effects"]))
