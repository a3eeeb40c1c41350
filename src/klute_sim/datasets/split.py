"""Split of a dataset's trials into those for the fit, for validation and for the final test.

Repeats of one input are nearly identical, so a group of repeats is never divided; otherwise a fit would be
tested on a repeat of its own data.
"""

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from klute_sim.datasets.trial import Trial, Use
from klute_sim.errors import InputError

MIN_GROUPS_FOR_TEST, MIN_GROUPS_FOR_VALIDATION = 3, 4
"""Smallest numbers of groups with which groups are held out for the test and for validation."""
GROUPS_PER_HELD_OUT = 5
"""One of this many groups is held out for the test, and one for validation."""
MIN_RANGE_FRACTION = 0.1
"""Range with which a prescribed channel counts as varied in a trial, as a fraction of its largest range in any trial
(assumed)."""


class SplitEntry(NamedTuple):
    """The properties of a trial that determine the split."""

    name: str
    """Name of the trial."""
    group: str
    """Group of repeats."""
    use: Use | None
    """Use that the dataset specifies; None if the split decides."""
    varied: frozenset[str] = frozenset()
    """Prescribed channels that the trial varies."""


class Split(NamedTuple):
    """Names of trials by use."""

    fit: tuple[str, ...]
    """Trials to which parameters are fitted."""
    validation: tuple[str, ...]
    """Trials by which effects are selected."""
    test: tuple[str, ...]
    """Trials that are evaluated after all fits and selections."""
    description: str
    """Explanation of the split in one sentence."""


def split_trials(trials: Sequence[Trial], source: str) -> Split:
    """Return the split of ``trials`` into those for fit, validation and test (:func:`assign_uses`)."""
    ranges = [{channel: float(np.ptp(s.value)) for channel, s in trial.prescribed.items()} for trial in trials]
    largest = {channel: max(r.get(channel, 0.0) for r in ranges) for trial_ranges in ranges for channel in trial_ranges}
    return assign_uses(
        (
            SplitEntry(
                trial.name,
                trial.group,
                trial.use,
                frozenset(
                    c for c, value in trial_ranges.items() if value > 0.0 and value >= MIN_RANGE_FRACTION * largest[c]
                ),
            )
            for trial, trial_ranges in zip(trials, ranges, strict=True)
        ),
        source,
    )


def assign_uses(trials: Iterable[SplitEntry], source: str) -> Split:
    """Split ``trials`` as they specify; groups without a use are drawn in an order that depends on their names only.

    A group that alone varies a channel is drawn last: without it, nothing about that channel could be fitted. Raises
    InputError where trials of one group have different uses, or none is left to fit; ``source`` names the dataset in
    errors.
    """
    trials = tuple(trials)
    group_uses = _collect_group_uses(trials, source)
    varied: dict[str, frozenset[str]] = {}
    for trial in trials:
        varied[trial.group] = varied.get(trial.group, frozenset()) | trial.varied
    unassigned = sorted((group for group, use in group_uses.items() if use is None), key=_hash_group)
    assigned: dict[str, Use] = {group: use for group, use in group_uses.items() if use is not None}
    draws: list[str] = []
    n_held_out = max(1, len(unassigned) // GROUPS_PER_HELD_OUT)
    held_out: tuple[tuple[Use, int], ...] = (
        ("test", MIN_GROUPS_FOR_TEST),
        ("validation", MIN_GROUPS_FOR_VALIDATION),
    )
    for use, min_groups in held_out:
        n_reserved = 0 if "fit" in assigned.values() else 1
        if use in assigned.values() or len(group_uses) < min_groups:
            continue
        for _ in range(min(n_held_out, len(unassigned) - n_reserved)):
            fitted = [group for group, other in assigned.items() if other == "fit"]
            group = next(_iterate_dispensable(unassigned, fitted, varied), unassigned[0])
            unassigned.remove(group)
            assigned[group] = use
            draws.append(f"'{group}' for {use}")
    assigned.update(dict.fromkeys(unassigned, "fit"))
    if "fit" not in assigned.values():
        raise InputError(f"{source}: no trial is left to fit; set use = 'fit' for at least one group")
    fit, validation, test = (
        tuple(trial.name for trial in trials if assigned[trial.group] == use) for use in ("fit", "validation", "test")
    )
    return Split(fit, validation, test, _describe_split(group_uses, draws))


def _iterate_dispensable(
    unassigned: Sequence[str], fitted: Sequence[str], varied: dict[str, frozenset[str]]
) -> Iterator[str]:
    """Yield the groups of ``unassigned`` whose ``varied`` channels other groups vary that are or may be ``fitted``."""
    for group in unassigned:
        others = (varied[other] for other in (*unassigned, *fitted) if other != group)
        if varied[group] <= frozenset().union(*others):
            yield group


def _collect_group_uses(trials: tuple[SplitEntry, ...], source: str) -> dict[str, Use | None]:
    group_uses: dict[str, Use | None] = {}
    for trial in trials:
        use = group_uses.setdefault(trial.group, trial.use)
        if use != trial.use:
            both = " and ".join(f"use = '{u}'" if u else "no use" for u in (use, trial.use))
            raise InputError(f"{source}: group '{trial.group}' has trials with {both}; give all repeats the same use")
    return group_uses


def _hash_group(group: str) -> str:
    """Return a sort key that is neither alphabetical nor in file order: both often follow the varied condition."""
    return hashlib.sha256(group.encode()).hexdigest()


def _describe_split(group_uses: dict[str, Use | None], draws: list[str]) -> str:
    count = f"{len(group_uses)} group" + ("s" if len(group_uses) > 1 else "")
    if None not in group_uses.values():
        return f"the dataset specifies the use of all {count}"
    prefix = "the dataset specifies the use of some groups; " if any(group_uses.values()) else ""
    if draws:
        return f"{prefix}of {count}, chosen by a fixed rule from their names: {', '.join(draws)}; the others are fitted"
    if len(group_uses) < MIN_GROUPS_FOR_TEST:
        return f"{prefix}{count}: too few to hold one out, so all groups without a use are fitted"
    return f"{prefix}{count}: those without a use are fitted"
