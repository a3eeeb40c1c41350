"""Score of a verdict against the ground truth."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.hidden_effects.catalogue import EFFECTS, EXACT_TWINS, JOINT_EFFECTS, TENDONS, TWIN_NUMBERS

Truth = Mapping[str, Any]
Verdict = Mapping[str, Any]

FLAGGED_VERDICTS = {"unexplained", "insufficient-data"}
FAILED_VERDICT = "failed"
"""In place of the verdict of a program that ended without one."""
NAMING_VERDICTS = {"identified", "identified-in-part", "indistinguishable"}
MAX_ABSORBED_SIZE = 0.6
"""Size over the noise below which the uncertain numbers imitate what is hidden, so that nothing is left to identify."""
REGISTRATION_EFFECTS = {"sensor_offset@ankle_angle": "registration.ankle_zero_deg"}
"""Fault of an instrument -> number of the registration of a walk that it is, in the same unit."""
PHYSICAL_NAMES = {name for name, _ in EFFECTS}
"""Names of effects of devices, of which one device of a joint may have one alone."""
JOINT_NAMES = {name for name, _ in JOINT_EFFECTS}
"""Names of effects of joints."""
NUMBER_NAME = "number_error"
"""Name of a wrong number of the device."""
WRONG_OUTCOMES = {"wrong", "false-alarm"}
"""Outcomes with a false effect."""


def get_place(effect: Mapping[str, Any]) -> Any:
    """Return the channel, number or tendon that alone has the effect; None without any."""
    return effect.get("channel") or effect.get("number") or effect.get("tendon")


def format_effect(effect: Mapping[str, Any]) -> str:
    """Return the name of an effect, with its channel, key or tendon where only this one has it."""
    place = get_place(effect)
    return f"{effect['name']}@{place}" if place else str(effect["name"])


def list_hidden_effects(truth: Truth) -> list[str]:
    """Return the hidden effects, sorted."""
    kinds = ("effects", "instruments", "strangers", "numbers")
    return sorted(format_effect(effect) for kind in kinds for effect in truth.get(kind, ()))


def is_out_of_catalogue(truth: Truth) -> bool:
    """Return whether a hidden effect is missing from the catalogue of the diagnosis."""
    return bool(truth.get("strangers") or truth.get("deleted"))


def list_named_effects(verdict: Verdict) -> list[str]:
    """Return the identified effects, sorted; data-driven terms do not count."""
    return (
        sorted(format_effect(effect) for effect in verdict["effects"]) if verdict["verdict"] in NAMING_VERDICTS else []
    )


def list_effect_sets(verdict: Verdict) -> list[list[str]]:
    """Return all sets of effects of the verdict, the identified set first."""
    others = verdict["alternatives"] if verdict["verdict"] == "indistinguishable" else []
    return [list_named_effects(verdict), *(sorted(map(remove_joint, effect_set)) for effect_set in others)]


def remove_joint(name: str) -> str:
    """Return ``name`` without the joint that has the effect: there is only one."""
    effect = name.partition("@")[0]
    return effect if effect in JOINT_NAMES else name


def residual_over_noise(verdict: Verdict) -> float:
    """Return the residual of the refitted device on test trials, RMS over the noise, in the worst channel."""
    gaps = [gap for gap in verdict.get("gap", {}).values() if gap["noise_floor"]]
    return math.sqrt(max([0.0, *((gap["refitted"] / gap["noise_floor"]) ** 2 - 1.0 for gap in gaps)]))


def is_absorbed(truth: Truth) -> bool:
    """Return whether the uncertain numbers imitate all that is hidden: the data show nothing of it.

    This follows from the ground truth alone, so it is the same for all methods.
    """
    return bool(list_hidden_effects(truth)) and float(truth["size"]) < MAX_ABSORBED_SIZE


def list_exact_twins(name: str) -> set[str]:
    """Return the effects with a form that contains the hidden effect ``name``, with the numbers that equal it.

    The effect need not contain a form of its twin. What a method itself calls indistinguishable does not count.
    """
    return {
        f"{twin}@{number}" if number else twin
        for twin in EXACT_TWINS.get(name, ())
        for number in (TWIN_NUMBERS[name] if twin == NUMBER_NAME else (None,))
    }


def score_verdict(truth: Truth, verdict: Verdict) -> str:
    """Return the outcome as one word.

    ``right``, ``twin``, ``loose``, ``part``, ``absorbed``, ``missed``, ``flagged``, ``wrong``, ``false-alarm`` or
    ``failed`` (the program ended without a verdict).

    *right*: exactly the hidden effects were identified, or an `indistinguishable` verdict lists them among at most two
    sets, or among one more than there are exact twins (*loose*: among more); for clean data, nothing is missing; for
    defective data and for an imperfect law without an effect, no effect was identified. Also right: the verdict is
    `nothing-missing`, and the interval of the registration number that equals the hidden fault contains its size.
    Effects outside of the catalogue have to be *flagged*: no effect was identified, or a data-driven term is one of
    several sets. *twin*: an exact twin was identified instead. *part*: only some of several effects were identified.
    *absorbed*: nothing, or only some of them, was identified, and the uncertain numbers imitate what is hidden
    (:func:`is_absorbed`). *wrong*: any other identified effect, whatever its size.

    Where the truth lists what is ``present`` beside the hidden effects, these names count neither for nor against a
    verdict; without a hidden effect one of its sets has to consist of them alone, or nothing is identified.
    """
    hidden, kind = list_hidden_effects(truth), verdict["verdict"]
    effect_sets = _list_sets_beside_present(truth, verdict)
    identified = effect_sets[0]
    if kind == FAILED_VERDICT:
        return "failed"
    if truth.get("defect"):
        return "false-alarm" if identified else "right"
    if not hidden and truth.get("law_error"):
        return "false-alarm" if identified else ("flagged" if kind == "insufficient-data" else "right")
    if not hidden and "present" in truth:
        return "right" if [] in effect_sets else "false-alarm"
    if not hidden:
        return "right" if kind == "nothing-missing" else ("false-alarm" if identified else "flagged")
    if is_out_of_catalogue(truth):
        silent_outcome = "absorbed" if is_absorbed(truth) else "missed"
        if identified and not _lists_unknown_effect(verdict):
            return "wrong"
        return silent_outcome if kind == "nothing-missing" else "flagged"
    if kind == "nothing-missing" and _is_corrected_by_registration(truth, verdict):
        return "right"
    if hidden in effect_sets:
        max_sets = 1 + sum(len(list_exact_twins(name)) for name in hidden)
        return "right" if len(effect_sets) <= max(2, max_sets) else "loose"
    if kind == "nothing-missing" and is_absorbed(truth):
        return "absorbed"
    if not identified:
        return "flagged" if kind in FLAGGED_VERDICTS else "missed"
    if set(identified) < set(hidden):
        return "absorbed" if is_absorbed(truth) else "part"
    return "twin" if _is_twin(hidden, identified) else "wrong"


def _list_sets_beside_present(truth: Truth, verdict: Verdict) -> list[list[str]]:
    """Return all sets of effects of the verdict without the names that are present beside the hidden effects."""
    hidden = list_hidden_effects(truth)
    present = set(truth.get("present", ())) - set(hidden)
    return [
        [name for name in join_tendons(effect_set, hidden) if name not in present]
        for effect_set in list_effect_sets(verdict)
    ]


def join_tendons(effect_set: Sequence[str], hidden: Sequence[str]) -> list[str]:
    """Return ``effect_set`` in which an effect of both devices, each with its own size, is a hidden one of all."""
    names = set(effect_set)
    for name in hidden:
        both = {f"{name}@{tendon}" for tendon in TENDONS}
        if both <= names:
            names = names - both | {name}
    return sorted(names)


def _is_corrected_by_registration(truth: Truth, verdict: Verdict) -> bool:
    """Return whether the hidden effect is an error of the registration that was corrected by its size."""
    hidden = list_hidden_effects(truth)
    number = REGISTRATION_EFFECTS.get(hidden[0]) if len(hidden) == 1 else None
    if number is None or number not in verdict.get("numbers", {}):
        return False
    (size,) = truth["instruments"][0]["parameters"].values()
    return bool(verdict["numbers"][number]["low"] <= size <= verdict["numbers"][number]["high"])


def _lists_unknown_effect(verdict: Verdict) -> bool:
    """Return whether an effect outside of the catalogue, as a data-driven term, is one of several sets of effects."""
    return any(name.startswith("unknown_") for effect_set in list_effect_sets(verdict)[1:] for name in effect_set)


def score_follow_up(truth: Truth, second_verdict: Verdict) -> str:
    """Return the outcome of an `indistinguishable` verdict after its proposed experiment: that of
    :func:`score_verdict`, or *open*.

    *open*: the hidden effects are still one of several sets.
    """
    outcome = score_verdict(truth, second_verdict)
    return "open" if outcome == "right" and second_verdict["verdict"] == "indistinguishable" else outcome


def _is_twin(true: Sequence[str], reported: Sequence[str]) -> bool:
    """Return whether ``reported`` equals ``true`` or a part of it, with exact twins in places."""
    remaining = [name for name in true if name not in reported]
    for name in (name for name in reported if name not in true):
        twin = next((candidate for candidate in remaining if name in list_exact_twins(candidate)), None)
        if twin is None:
            return False
        remaining.remove(twin)
    return True


def is_first_right(truth: Truth, verdict: Verdict) -> bool:
    """Return whether the first named effect is hidden, or the registration corrected it.

    Alternatives do not count: a verdict that lists many would be right whatever it names first.
    """
    if verdict["verdict"] not in NAMING_VERDICTS:
        return verdict["verdict"] == "nothing-missing" and _is_corrected_by_registration(truth, verdict)
    return format_effect(verdict["effects"][0]) in list_hidden_effects(truth)


def is_wrong_alone(outcome: str) -> bool:
    """Return whether a verdict with this ``outcome`` gives names, and none of its sets is the hidden one."""
    return outcome in WRONG_OUTCOMES or outcome == "twin"


def are_kinds_confused(truth: Truth, verdict: Verdict) -> bool:
    """Return whether an instrument fault was identified as physics or vice versa.

    A wrong number of the device is physics. A name where nothing is hidden is a false alarm and confuses no kinds.
    """
    hidden = list_hidden_effects(truth)
    if not hidden or hidden in list_effect_sets(verdict):
        return False
    is_fault = [_is_instrument_fault(name) for name in list_named_effects(verdict)]
    hides_physics = len(truth["instruments"]) < len(hidden)
    return bool((any(is_fault) and not truth["instruments"]) or (not all(is_fault) and not hides_physics))


def _is_instrument_fault(name: str) -> bool:
    effect, _, place = name.partition("@")
    return bool(place) and effect != NUMBER_NAME and effect not in PHYSICAL_NAMES
