"""Whether a verdict is right, given the sealed truth."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

Truth = Mapping[str, Any]
Verdict = Mapping[str, Any]

FLAGGED_VERDICTS = {"unexplained", "insufficient-data"}
NAMING_VERDICTS = {"named", "ambiguous"}
MAX_ABSORBED_RESIDUAL = 0.6
"""What is left after refitting, in units of the noise, below which nothing is left that could be found."""
WRONG_OUTCOMES = {"wrong", "false-alarm"}
"""Outcomes with a name that is not true."""


def format_effect(effect: Mapping[str, Any]) -> str:
    """An effect's name; with its channel if it is an instrument's."""
    return f"{effect['name']}@{effect['channel']}" if effect.get("channel") else str(effect["name"])


def list_hidden_effects(truth: Truth) -> list[str]:
    """What is hidden, sorted."""
    kinds = ("effects", "instruments", "strangers")
    return sorted(format_effect(each) for kind in kinds for each in truth.get(kind, ()))


def is_out_of_catalogue(truth: Truth) -> bool:
    """Whether what is hidden is in no catalogue that was used."""
    return bool(truth.get("strangers") or truth.get("deleted"))


def list_named_effects(verdict: Verdict) -> list[str]:
    """What was named, sorted; proxies are not named."""
    return sorted(format_effect(each) for each in verdict["effects"]) if verdict["verdict"] in NAMING_VERDICTS else []


def list_effect_sets(verdict: Verdict) -> list[list[str]]:
    """All sets of effects that the verdict lists, what was named first."""
    others = verdict["alternatives"] if verdict["verdict"] == "ambiguous" else []
    return [list_named_effects(verdict), *(sorted(each) for each in others)]


def residual_over_noise(verdict: Verdict) -> float:
    """What a refitted device leaves on trials that no fit saw, rms over the noise, in the worst channel."""
    return _gap_over_noise(verdict, "before")


def _gap_over_noise(verdict: Verdict, stage: str) -> float:
    """Rms over the noise, ``before`` or ``after`` effects were added; 0 where the noise is not known."""
    gaps = [gap for gap in verdict.get("gap", {}).values() if gap["floor"]]
    return math.sqrt(max([0.0, *((gap[stage] / gap["floor"]) ** 2 - 1.0 for gap in gaps)]))


def near_twins(name: str, verdict: Verdict) -> set[str]:
    """Effects that, by the program's own account, these data hardly tell from ``name``."""
    return {other for pair in verdict.get("alike", ()) if name in pair for other in pair} - {name}


def score_verdict(truth: Truth, verdict: Verdict) -> str:
    """One word for what became of it.

    ``right``, ``twin``, ``loose``, ``part``, ``absorbed``, ``missed``, ``flagged``, ``wrong`` or ``false-alarm``.

    *right*: exactly what is hidden was named, or an ambiguous verdict lists it among no more sets than there are near
    twins (*loose*: among more); for clean data, that nothing is missing; for defective data, that the program did not
    answer with a name. What is in no catalogue that was used is to be *flagged*. *twin*: a near twin was named in its
    place. *part*: some of several, and nothing else. *absorbed*: nothing or only some was named, and nothing is left to
    name, because the device's uncertain numbers, within what they may be, imitate the rest. *wrong*: a name that is
    none of these.
    """
    true, found, kind = list_hidden_effects(truth), list_named_effects(verdict), verdict["verdict"]
    nothing_left = kind == "nothing-missing" and residual_over_noise(verdict) < MAX_ABSORBED_RESIDUAL
    if truth.get("defect"):
        return "false-alarm" if found else "right"
    if not true:
        return "right" if kind == "nothing-missing" else ("false-alarm" if found else "flagged")
    if is_out_of_catalogue(truth):
        quiet = "absorbed" if nothing_left else "missed"
        return "wrong" if found else quiet if kind == "nothing-missing" else "flagged"
    if true in list_effect_sets(verdict):
        most = 1 + sum(len(near_twins(name, verdict)) for name in true)
        return "right" if len(list_effect_sets(verdict)) <= max(2, most) else "loose"
    if nothing_left:
        return "absorbed"
    if not found:
        return "flagged" if kind in FLAGGED_VERDICTS else "missed"
    if set(found) < set(true):
        return "absorbed" if _gap_over_noise(verdict, "after") < MAX_ABSORBED_RESIDUAL else "part"
    return "twin" if _is_near_twin(true, found, verdict) else "wrong"


def score_follow_up(truth: Truth, second_verdict: Verdict) -> str:
    """One word for what became of an ambiguous verdict with the data it asked for: :func:`score`'s, or *open*.

    *open*: the truth is still one of several.
    """
    word = score_verdict(truth, second_verdict)
    return "open" if word == "right" and second_verdict["verdict"] == "ambiguous" else word


def _is_near_twin(true: Sequence[str], reported: Sequence[str], verdict: Verdict) -> bool:
    """Whether ``found`` is ``true`` or some of it, with near twins in places."""
    open_ = [name for name in true if name not in reported]
    for name in (name for name in reported if name not in true):
        taken = next((each for each in open_ if name in near_twins(each, verdict)), None)
        if taken is None:
            return False
        open_.remove(taken)
    return True


def is_first_right(truth: Truth, verdict: Verdict) -> bool:
    """Whether the first effect that was named is one that is hidden, or a rival of it is."""
    if verdict["verdict"] not in NAMING_VERDICTS:
        return False
    return format_effect(verdict["effects"][0]) in list_hidden_effects(truth) or list_hidden_effects(
        truth
    ) in list_effect_sets(verdict)


def are_kinds_confused(truth: Truth, verdict: Verdict) -> bool:
    """Whether a fault of an instrument was taken for physics, or the other way round."""
    found = list_named_effects(verdict)
    if list_hidden_effects(truth) in list_effect_sets(verdict):
        return False
    physics, faults = any("@" not in name for name in found), any("@" in name for name in found)
    return bool((faults and not truth["instruments"]) or (physics and not truth["effects"]))
