"""Where no effect explains the data: a data-driven term at the equation that lacks something.

The equation is known by then (:mod:`klute_sim.diagnose.equations`). What it lacks is written as a combination of
functions of what acts there (:mod:`klute_sim.effects.unknown`). A little of each is put into the equation and
simulated, less what the fitted numbers could do instead; sparse regression (PySINDy) finds the few functions that what
is left of the data asks for. Regressing what the *device* would then show, instead of the force at the equation itself,
needs no derivative of measured data and weighs every channel by its noise. The combinations are then fitted together
with all other unknowns, and the term has to pass the gates of a named effect.
"""

import warnings
from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from klute_sim.diagnose.equations import Equation, lacking
from klute_sim.diagnose.experiment import Array
from klute_sim.diagnose.fit import Fit, fit
from klute_sim.diagnose.hypothesis import Term
from klute_sim.diagnose.screen import Candidate, screen
from klute_sim.diagnose.search import DECISIVE, PATIENCE, Search
from klute_sim.effects import unknown
from klute_sim.effects.effect import Effect
from klute_sim.errors import MissingExtraError

MOST_FUNCTIONS = 4
"""In a term: more are no longer read."""
RIDGE = 1e-3
"""Of the regression, over the length of each function's signature: only keeps twins from cancelling each other."""
AT = {
    "supply": unknown.PRESSURE,
    "muscle and damper": unknown.FORCE,
    "muscle, damper or tendon": unknown.FORCE,
    "tendon": unknown.TENDON,
}
"""Equation -> the effect that is a term of it."""


class Support(NamedTuple):
    """Some functions of one equation, together."""

    term: Term
    steps: Array
    """Their coefficients, in steps of their sizes."""
    change: Array
    """What these do to the weighted residuals."""
    promise: float
    """By how much BIC would fall if everything were linear."""


class Fallback(NamedTuple):
    """What became of the attempt."""

    fit: Fit | None
    """With the term; None: none was kept."""
    why: str
    """In plain words."""


def fallback(
    search: Search, current: Fit, base: Fit, equations: Sequence[Equation], exclude: Collection[str] = ()
) -> Fallback:
    """The best term that can be added to ``current``; effects of it that ``base`` lacks and that become idle go.

    The ``equations`` that lack something are tried, and the one that promises most is fitted. ``exclude`` names effects
    that are not looked for.
    """
    there = {*exclude, *current.hypothesis.device.spec.effects}
    open_ = {each.name: AT[each.name] for each in lacking(equations) if AT[each.name].name not in there}
    if not open_:
        return Fallback(None, "No data-driven term was looked for: it is not known which equation lacks something.")
    try:
        found = {name: supports(search, current, effect) for name, effect in open_.items()}
    except MissingExtraError as missing:
        return Fallback(None, f"No data-driven term was looked for: {missing}.")
    where = max(found, key=lambda name: max((each.promise for each in found[name]), default=-np.inf))
    tried = f"A data-driven term at the equation of {where} was tried"
    promising = [each for each in found[where] if each.promise > 0.5 * search.decisive]
    if not promising:
        return Fallback(None, f"{tried}, but none of its functions promises to explain more than noise would.")
    best = _fitted(search, current, promising)
    objection = search.objection(current, best, search.gains(current, best))
    if objection:
        return Fallback(None, f"{tried} and not kept: {objection}.")
    fall = current.criterion(search.evidence.effective) - best.criterion(search.evidence.effective)
    return Fallback(
        search.without_idle(best, base),
        f"A data-driven term at the equation of {where} stands in for what has no name (BIC falls by {fall:.0f}).",
    )


def supports(search: Search, current: Fit, effect: Effect) -> list[Support]:
    """Combinations of the functions of ``effect``, the smallest first, none larger than :data:`MOST_FUNCTIONS`.

    Raises MissingExtraError without PySINDy.
    """
    form = effect.forms[0]
    singles = [Term(effect.name, form.name, None, (p.key,)) for p in form.parameters]
    signed = {p.key: p.low < 0.0 for p in form.parameters}
    tried = screen(search.evidence, current, singles)
    open_ = sorted(tried, key=lambda one: singles.index(one.term))  # in the order of the effect's parameters
    while open_:
        found = [_support(search, current, few) for few in _fewer(open_, current) if len(few) <= MOST_FUNCTIONS]
        pairs = [pair for each in found for pair in zip(each.term.keys, each.steps, strict=True)]
        impossible = {key for key, steps in pairs if steps < 0.0 and not signed[key]}
        if not impossible:
            return sorted(found, key=lambda each: len(each.steps))
        open_ = [one for one in open_ if one.term.keys[0] not in impossible]
    return []


def _fewer(candidates: Sequence[Candidate], current: Fit) -> list[list[Candidate]]:
    """``candidates``, then ever fewer of them: the one that is missed least goes first."""
    try:
        from pysindy.optimizers import SSR
    except ModuleNotFoundError:
        raise MissingExtraError("a data-driven term", "sparse") from None
    if len(candidates) == 1:
        return [list(candidates)]
    regression = SSR(criteria="model_residual", alpha=RIDGE, max_iter=len(candidates))
    signatures = np.stack([one.signature for one in candidates], axis=1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of coefficients that are nearly none
        regression.fit(signatures, -current.vector[:, np.newaxis])
    # The first entry is overwritten by the next: it was that of all of them.
    kept = [np.flatnonzero(row[0]) for row in regression.history_[1:]]
    return [list(candidates), *([candidates[k] for k in row] for row in kept)]


def _support(search: Search, current: Fit, few: Sequence[Candidate]) -> Support:
    lengths = np.array([one.kept * np.linalg.norm(one.change) for one in few])
    columns = lengths * np.stack([one.signature for one in few], axis=1)
    steps = np.linalg.lstsq(columns, -current.vector)[0]
    left = current.vector + columns @ steps
    fall = current.cost - float(left @ left) - len(few) * float(np.log(search.evidence.effective))
    change = np.stack([one.change for one in few], axis=1) @ steps
    first = few[0].term
    return Support(Term(first.effect, first.form, None, tuple(one.term.keys[0] for one in few)), steps, change, fall)


def _fitted(search: Search, current: Fit, promising: Sequence[Support]) -> Fit:
    """The smallest of ``promising`` whose BIC is no worse than the best by what decides."""
    fits = []
    for each in promising:
        search.told(f"fitting a data-driven term of {len(each.term.keys)}")
        begin = search.begin(current, each.term, each.steps, each.change)
        fits.append(fit(search.evidence, current.hypothesis.plus(each.term), begin, rounds=PATIENCE[0]))
    criteria = [one.criterion(search.evidence.effective) for one in fits]
    best = next(one for one, own in zip(fits, criteria, strict=True) if own < min(criteria) + DECISIVE)
    return fit(search.evidence, best.hypothesis, best.steps, best.jacobian, rounds=PATIENCE[-1])
