"""Where no effect explains the data: a data-driven term at the equation that lacks something.

The equation is known by then (:mod:`klute_sim.diagnose.equations`). What it lacks is written as a combination of
functions of what acts there (:mod:`klute_sim.effects.unknown`). All of them together are fitted in simulation; from
there everything is nearly linear, and sparse regression (PySINDy) takes away one after the other that is missed least.
Nothing measured has to be derived for this, and every channel weighs as its noise lets it. The few that are left are
fitted again together with all other unknowns, and the term has to pass the gates of a named effect.
"""

import warnings
from collections.abc import Collection, Sequence
from typing import Any, NamedTuple

import numpy as np

from klute_sim.diagnose.equations import Equation, lacking
from klute_sim.diagnose.experiment import Array
from klute_sim.diagnose.fit import Evidence, Fit, fit
from klute_sim.diagnose.hypothesis import Term
from klute_sim.diagnose.search import DECISIVE, PATIENCE, Search
from klute_sim.effects import unknown
from klute_sim.effects.effect import Effect
from klute_sim.errors import MissingExtraError

MOST_FUNCTIONS = 4
"""In a term: more are no longer read."""
ALL = 8
"""Rounds of fitting all functions together: it only has to get near."""
RIDGE = 1e-3
"""Of the regression, over the length of each function's signature: only keeps twins from cancelling each other."""
ROUNDS = 50
"""Of the regression: more than there are functions in a library."""
LEAST = 1e-6
"""Length of a function's change, over the longest, below which it has none."""
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
    start: Array
    """All unknowns with it, in steps, if everything were linear."""
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
    may_lack = current.hypothesis.device.spec.may_lack
    suspected = {each.name: AT[each.name] for each in lacking(equations)}
    open_ = {name: effect for name, effect in suspected.items() if effect.name not in exclude and may_lack(effect)}
    if not open_:
        return Fallback(None, "No data-driven term was looked for: it is not known which equation lacks something.")
    try:
        found = {name: supports(search.evidence, current, effect) for name, effect in open_.items()}
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


def formula(found: Fit) -> str:
    """The data-driven term of ``found`` with its coefficients, in a line; '' if there is none."""
    for number, term in enumerate(found.hypothesis.terms):
        if term.entry.data_driven:
            rows = zip(found.hypothesis.unknowns, found.values, strict=True)
            return unknown.formula(term.entry, {u.key: value for u, value in rows if u.term == number})
    return ""


def supports(evidence: Evidence, current: Fit, effect: Effect) -> list[Support]:
    """Combinations of the functions of ``effect``, the smallest first, none larger than :data:`MOST_FUNCTIONS`.

    Raises MissingExtraError without PySINDy.
    """
    regression = _regression()
    known, form = len(current.steps), effect.forms[0]
    hypothesis = current.hypothesis.plus(Term(effect.name, form.name))
    begin = np.concatenate([current.steps, np.zeros(len(form.parameters))])
    whole = fit(evidence, hypothesis, begin, rounds=ALL)
    # What the weighted data ask of all unknowns, as if everything were linear from here.
    asked = whole.jacobian @ whole.steps - whole.vector
    basis, _ = np.linalg.qr(whole.jacobian[:, :known])
    functions = whole.jacobian[:, known:] - basis @ (basis.T @ whole.jacobian[:, known:])
    left = asked - basis @ (basis.T @ asked)
    lengths = np.linalg.norm(functions, axis=0)
    open_ = [k for k, length in enumerate(lengths) if length > LEAST * max(1.0, lengths.max())]
    while open_:
        rows = [[open_[k] for k in few] for few in _fewer(regression, functions[:, open_] / lengths[open_], left)]
        found = [_support(evidence, current, whole, asked, row) for row in rows if len(row) <= MOST_FUNCTIONS]
        pairs = [pair for each in found for pair in zip(each.term.parameters, each.start[known:], strict=True)]
        impossible = {parameter.key for parameter, steps in pairs if steps < 0.0 and parameter.low == 0.0}
        if not impossible:
            return sorted(found, key=lambda each: len(each.term.keys))
        open_ = [k for k in open_ if form.parameters[k].key not in impossible]
    return []


def _regression() -> Any:
    try:
        from pysindy.optimizers import SSR
    except ModuleNotFoundError:
        raise MissingExtraError("a data-driven term", "sparse") from None
    return SSR(criteria="model_residual", alpha=RIDGE, max_iter=ROUNDS)


def _fewer(regression: Any, functions: Array, left: Array) -> list[list[int]]:
    """Columns of ``functions``: all, then ever fewer; the one that ``left`` is explained without best goes first."""
    every = list(range(functions.shape[1]))
    if len(every) == 1:
        return [every]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of coefficients that are nearly none
        regression.fit(functions, left[:, np.newaxis])
    # The first entry is overwritten by the next: it was that of all of them.
    return [every, *(np.flatnonzero(row[0]).tolist() for row in regression.history_[1:])]


def _support(evidence: Evidence, current: Fit, whole: Fit, asked: Array, few: Sequence[int]) -> Support:
    known, term = len(current.steps), whole.hypothesis.terms[-1]
    columns = whole.jacobian[:, [*range(known), *(known + k for k in few)]]
    start = np.linalg.lstsq(columns, asked)[0].astype(np.float64)
    left = asked - columns @ start
    fall = current.cost - float(left @ left) - len(few) * float(np.log(evidence.effective))
    keys = tuple(term.law.parameters[k].key for k in few)
    return Support(Term(term.effect, term.form, None, keys), start, fall)


def _fitted(search: Search, current: Fit, promising: Sequence[Support]) -> Fit:
    """The smallest of ``promising`` whose BIC is no worse than the best by what decides."""
    fits = []
    for each in promising:
        search.told(f"fitting a data-driven term of {len(each.term.keys)}")
        fits.append(fit(search.evidence, current.hypothesis.plus(each.term), each.start, rounds=PATIENCE[0]))
    criteria = [one.criterion(search.evidence.effective) for one in fits]
    best = next(one for one, own in zip(fits, criteria, strict=True) if own < min(criteria) + DECISIVE)
    return fit(search.evidence, best.hypothesis, best.steps, best.jacobian, rounds=PATIENCE[-1])
