"""Answers to a frozen release of the benchmark, and what is wrong with them; needs nothing but Python."""

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.hidden_effects.score import FLAGGED_VERDICTS, NAMING_VERDICTS

VERDICTS = ("nothing-missing", *sorted(NAMING_VERDICTS), *sorted(FLAGGED_VERDICTS))
"""Allowed values of ``verdict`` in an answer."""
WITHHELD_FILE = "withheld.json"
"""File of the release with the names that are not allowed on some datasets."""
CHANNELS = ("force", "pressure", "muscle_length")
"""Channels whose instruments may have a fault."""
UNKNOWN_TERMS = ("unknown_force", "unknown_tendon_force", "unknown_pressure")
"""Names in alternatives that stand for an effect without a name."""


class AnswerError(Exception):
    """Answers that cannot be scored: a line for each fault."""


class Allowed(NamedTuple):
    """What an answer to one dataset may name."""

    kinds: Mapping[str, str]
    """Kind of every name: ``device``, ``instrument`` or ``number``."""
    withheld: Collection[str]
    """Names that are not allowed on the dataset."""


def read_answer(path: Path, allowed: Allowed) -> dict[str, Any]:
    """Return the answer in ``path``; raises AnswerError with a sentence for each fault when it is not one."""
    try:
        content = json.loads(path.read_text("utf-8"))
    except FileNotFoundError:
        raise AnswerError(f"{path} is missing; every dataset needs an answer") from None
    except (OSError, ValueError) as error:
        raise AnswerError(f"{path} is not JSON: {error}") from None
    faults = list_faults(content, allowed)
    if faults:
        raise AnswerError("\n".join(f"{path}: {fault}" for fault in faults))
    return {**content, "effects": content.get("effects", []), "alternatives": content.get("alternatives", [])}


def list_faults(content: Any, allowed: Allowed) -> list[str]:
    """Return all faults of the answer ``content``, each as one sentence."""
    if not isinstance(content, dict):
        return [f"the answer is {content!r}; allowed: an object with 'verdict', 'effects' and 'alternatives'"]
    verdict, effects, alternatives = (
        content.get(key, default) for key, default in (("verdict", None), ("effects", []), ("alternatives", []))
    )
    faults = []
    if verdict not in VERDICTS:
        faults.append(f"'verdict' is {verdict!r}; allowed: {', '.join(VERDICTS)}")
        verdict = None
    if not isinstance(effects, list) or not all(
        isinstance(e, dict) and isinstance(e.get("name"), str) for e in effects
    ):
        faults.append(f"'effects' is {effects!r}; allowed: a list of objects with 'name'")
        effects = []
    elif verdict in NAMING_VERDICTS and not effects:
        faults.append(f"the verdict {verdict} needs at least one entry in 'effects'")
    if not isinstance(alternatives, list) or not all(
        isinstance(names, list) and all(isinstance(name, str) for name in names) for names in alternatives
    ):
        faults.append(f"'alternatives' is {alternatives!r}; allowed: a list of lists of names")
        alternatives = []
    return [*faults, *_iter_name_faults(effects, alternatives, allowed)]


def _iter_name_faults(
    effects: Sequence[Mapping[str, Any]], alternatives: Sequence[Sequence[str]], allowed: Allowed
) -> Iterator[str]:
    """Yield what is wrong with each name."""
    for effect in effects:
        fault = find_fault(effect["name"], effect.get("number") or effect.get("channel"), allowed)
        if fault:
            yield f"in 'effects', {fault}"
    for name in (name for names in alternatives for name in names if name not in UNKNOWN_TERMS):
        effect, separator, owner = name.partition("@")
        fault = find_fault(effect, owner if separator else None, allowed)
        if fault:
            yield f"in 'alternatives', {fault}"


def find_fault(name: str, owner: Any, allowed: Allowed) -> str:
    """Return what is wrong with ``name`` of the channel or number ``owner``; '' if nothing is."""
    kind = allowed.kinds.get(name)
    if kind is None:
        return f"'{name}' is no name of an effect; DATA_CARD.md lists them"
    if name in allowed.withheld:
        return f"'{name}' is withheld on this dataset, as {WITHHELD_FILE} says"
    if kind == "instrument" and owner not in CHANNELS:
        return f"'{name}' needs the channel of the instrument; allowed: {', '.join(CHANNELS)}"
    if kind == "number" and (not isinstance(owner, str) or owner.count(".") != 1):
        return f"'{name}' needs the number as section.key of the device file, such as muscle.bladder_radius_mm"
    if kind == "device" and owner is not None:
        return f"'{name}' belongs to the device and has no channel or number"
    return ""
