"""Answers to a frozen release of the benchmark, and what is wrong with them; needs nothing but Python."""

import json
import tomllib
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.hidden_effects.score import FLAGGED_VERDICTS, NAMING_VERDICTS, format_effect, get_place

VERDICTS = ("nothing-missing", *sorted(NAMING_VERDICTS), *sorted(FLAGGED_VERDICTS))
"""Allowed values of ``verdict`` in an answer."""
WITHHELD_FILE = "withheld.json"
"""File of the release with the names that are not allowed on some datasets."""
UNKNOWN_TERMS = ("unknown_force", "unknown_tendon_force", "unknown_pressure")
"""Names in alternatives, or beside a verdict without a name, that stand for an effect without one."""


class AnswerError(Exception):
    """Answers that cannot be scored: a line for each fault."""


class Allowed(NamedTuple):
    """What an answer to one dataset may name."""

    kinds: Mapping[str, str]
    """Kind of every name: ``device``, ``instrument`` or ``number``."""
    withheld: Collection[str]
    """Names that are not allowed on the dataset."""
    channels: Collection[str]
    """Measured channels of the dataset."""
    numbers: set[str]
    """Numbers of its device as ``section.key``."""


def read_numbers(release: Path, dataset: str) -> set[str]:
    """Return the numbers of the device of ``dataset`` as ``section.key``."""
    folder = release / "datasets" / dataset
    device = tomllib.loads((folder / "dataset.toml").read_text("utf-8"))["device"]
    file = folder / device if device.endswith(".toml") else release / "devices" / f"{device}.toml"
    sections = tomllib.loads(file.read_text("utf-8")).items()
    tables = {name: section for name, section in sections if isinstance(section, dict)}
    return {f"{name}.{key}" for name, table in tables.items() for key, x in table.items() if type(x) in (int, float)}


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
    elif verdict == "nothing-missing" and effects:
        faults.append("the verdict nothing-missing goes with no 'effects'; remove them or choose another verdict")
    if not isinstance(alternatives, list) or not all(
        isinstance(names, list) and all(isinstance(name, str) for name in names) for names in alternatives
    ):
        faults.append(f"'alternatives' is {alternatives!r}; allowed: a list of lists of names")
        alternatives = []
    elif verdict == "indistinguishable" and not any(alternatives):
        faults.append("the verdict indistinguishable needs at least one set in 'alternatives'")
    elif verdict not in ("indistinguishable", *FLAGGED_VERDICTS, None) and alternatives:
        faults.append(f"the verdict {verdict} goes with no 'alternatives'; remove them or choose indistinguishable")
    if verdict in FLAGGED_VERDICTS:  # what stands beside it does not count, such as the data-driven terms of klute-sim
        effects = [effect for effect in effects if effect["name"] not in UNKNOWN_TERMS]
    else:
        faults += list_repetitions([[format_effect(effect) for effect in effects], *alternatives])
    return [*faults, *_iter_name_faults(effects, alternatives, allowed)]


def list_repetitions(effect_sets: Sequence[Sequence[str]]) -> list[str]:
    """Return a sentence for each name that a set has twice, and for each set that is listed twice."""
    sets = [tuple(sorted(effect_set)) for effect_set in effect_sets]
    faults = [
        f"'{name}' is named twice in one set" for names in sets for name in sorted(set(names)) if names.count(name) > 1
    ]
    return faults + [
        f"the set {' + '.join(names)} is listed twice" for names in sorted(set(sets)) if sets.count(names) > 1
    ]


def _iter_name_faults(
    effects: Sequence[Mapping[str, Any]], alternatives: Sequence[Sequence[str]], allowed: Allowed
) -> Iterator[str]:
    """Yield what is wrong with each name."""
    for effect in effects:
        fault = find_fault(effect["name"], get_place(effect), allowed)
        if fault:
            yield f"in 'effects', {fault}"
    for name in (name for names in alternatives for name in names if name not in UNKNOWN_TERMS):
        cause, separator, owner = name.partition("@")
        fault = find_fault(cause, owner if separator else None, allowed)
        if fault:
            yield f"in 'alternatives', {fault}"


def find_fault(name: str, owner: Any, allowed: Allowed) -> str:
    """Return what is wrong with ``name`` of the channel or number ``owner``; '' if nothing is."""
    kind = allowed.kinds.get(name)
    if kind is None:
        return f"'{name}' is no name of an effect; DATA_CARD.md lists them"
    if name in allowed.withheld:
        return f"'{name}' is withheld on this dataset, as {WITHHELD_FILE} says"
    if kind == "instrument" and (not isinstance(owner, str) or owner not in allowed.channels):
        return f"'{name}' needs a channel that the dataset has; allowed: {', '.join(sorted(allowed.channels))}"
    if kind == "number" and (not isinstance(owner, str) or owner not in allowed.numbers):
        return (
            f"'{name}' needs a number of the device file as section.key, such as muscle.bladder_radius_mm; {owner!r} "
            "is none"
        )
    if kind == "device" and owner is not None:
        return f"'{name}' belongs to the device and has no channel or number"
    return ""
