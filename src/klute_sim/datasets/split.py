"""Which trials are fitted, which choose among effects, which are kept back for the end.

Repeats of one experiment are alike, so whole groups are assigned: a trial beside its own repeat tests nothing.
"""

import hashlib
from collections.abc import Iterable
from typing import NamedTuple

from klute_sim.datasets.trial import Use
from klute_sim.errors import InputError

MIN_GROUPS_FOR_TEST, MIN_GROUPS_FOR_VALIDATION = 3, 4
"""Fewest groups from which one is kept back to show, and one more to select."""
GROUPS_PER_HELD_OUT = 5
"""One group in so many is drawn for show, and one for select."""


class SplitEntry(NamedTuple):
    """A trial as far as splitting looks at it."""

    name: str
    group: str
    use: Use | None


class Split(NamedTuple):
    """Names of trials by their use."""

    fit: tuple[str, ...]
    validation: tuple[str, ...]
    test: tuple[str, ...]
    description: str
    """How it came about, in one sentence."""


def assign_uses(trials: Iterable[SplitEntry], where: str) -> Split:
    """Split ``trials`` as they say; whole groups that do not say are drawn in an order that their names decide.

    Raises InputError where trials of one group are used differently, or none is left to fit.
    """
    trials = tuple(trials)
    given = _collect_group_uses(trials, where)
    free = sorted((group for group, use in given.items() if use is None), key=_hash_group)
    assigned: dict[str, Use] = {group: use for group, use in given.items() if use is not None}
    drawn: list[str] = []
    share = max(1, len(free) // GROUPS_PER_HELD_OUT)
    uses: tuple[tuple[Use, int], ...] = (("show", MIN_GROUPS_FOR_TEST), ("select", MIN_GROUPS_FOR_VALIDATION))
    for use, fewest in uses:
        to_keep = 0 if "fit" in assigned.values() else 1
        if use in assigned.values() or len(given) < fewest:
            continue
        for group in free[: min(share, len(free) - to_keep)]:
            assigned[group] = use
            drawn.append(f"'{group}' for {use}")
        free = [group for group in free if group not in assigned]
    assigned.update(dict.fromkeys(free, "fit"))
    if "fit" not in assigned.values():
        raise InputError(f"{where}: no trial is left to fit; allowed: use = 'fit' for at least one group")
    names = {use: tuple(t.name for t in trials if assigned[t.group] == use) for use in ("fit", "select", "show")}
    return Split(**names, description=_describe_split(given, drawn))


def _collect_group_uses(trials: tuple[SplitEntry, ...], where: str) -> dict[str, Use | None]:
    given: dict[str, Use | None] = {}
    for trial in trials:
        use = given.setdefault(trial.group, trial.use)
        if use != trial.use:
            told = " and ".join(f"use = '{u}'" if u else "no use" for u in (use, trial.use))
            raise InputError(f"{where}: group '{trial.group}' has trials with {told}; give repeats the same use")
    return given


def _hash_group(group: str) -> str:
    """By name, but neither alphabetical nor in the file's order: both often follow what was varied."""
    return hashlib.sha256(group.encode()).hexdigest()


def _describe_split(group_uses: dict[str, Use | None], drawn: list[str]) -> str:
    count = f"{len(group_uses)} group" + ("s" if len(group_uses) > 1 else "")
    if None not in group_uses.values():
        return f"the dataset says the use of all {count}"
    some = "the dataset says the use of some groups; " if any(group_uses.values()) else ""
    if drawn:
        return f"{some}of {count}, drawn by their names: {', '.join(drawn)}; the others are fitted"
    if len(group_uses) < MIN_GROUPS_FOR_TEST:
        return f"{some}{count}: too few to keep one back, so everything without a use is fitted"
    return f"{some}{count}: those without a use are fitted"
