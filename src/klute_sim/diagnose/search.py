"""From a device that does not fit to the effects that it lacks, one at a time, with a reason for each.

An effect is accepted if the evidence asks for it (BIC counted in independent samples) *and* trials that were not
fitted improve. Forms compete before effects do: the best form of every promising effect is found before anything is
added to it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from klute_sim.diagnose.experiment import Array
from klute_sim.diagnose.fit import Evidence, Fit, fit
from klute_sim.diagnose.hypothesis import Hypothesis, Term
from klute_sim.diagnose.noise import Misfit, groups, misfit, significant, supposed
from klute_sim.diagnose.screen import Candidate, screen

DECISIVE = 6.0
"""Difference of BIC that decides between two hypotheses."""
MOST_EFFECTS = 3
SHORTLIST = 8
"""Candidates that are refitted."""
LEAST_GAIN = 0.05
"""Mean fall of chi squared on selection trials, relative: about what an effect of a quarter of the noise brings."""
MOST_LOSS = 0.02
"""Rise of chi squared that one group of selection trials may have, relative."""
UNASKED = 2.0
"""What the mean fall is multiplied by where repeats do not show that anything is missing."""
WIDER = 2.0
"""What the difference of BIC is multiplied by where nothing was repeated and noise is only supposed."""
PATIENCE = (3, 4, 25)
"""Rounds of fitting that the shortlist gets, then who is left of it, then who is left of those."""
PARTS = (0.05, 0.2, 0.5, 1.0)
"""Of what screening promised, that are tried to begin a fit with."""
LADDER = (0.01, 0.016, 0.025, 0.04, 0.063, 0.1, 0.16, 0.25, 0.4, 0.63, 1.0)
"""Typical sizes that are tried where the promise is not kept: an effect with a threshold, such as a tank that runs low,
does nothing at all in one size and far too much in another, and no straight line leads from there."""
KEPT = 0.3
"""Share of what screening promised that a fit has to begin with, for the ladder not to be tried."""
SECOND_CHANCES = 3
"""How many of the shortlist may be accepted, should the better ones not help trials that were not fitted."""
BEHIND = 0.3
"""Of the best one's fall of BIC, by which a candidate may be behind to get more rounds."""


@dataclass(frozen=True, eq=False)
class Step:
    """What was found when something was to be added."""

    before: Fit
    candidates: tuple[Candidate, ...]
    refits: tuple[Fit, ...]
    """Of the shortlist; the accepted one first, then by BIC."""
    added: Term | None
    gains: dict[str, float]
    """Of the accepted one: selection group -> relative fall of chi squared."""
    why: str


@dataclass(eq=False)
class Search:
    """A search under way; what it has decided is in :attr:`steps`."""

    evidence: Evidence
    selection: Sequence[Evidence]
    """One per selection group."""
    candidates: Sequence[Term]
    told: Callable[[str], None] = lambda sentence: None
    repeated: bool = True
    """Whether noise was measured from repeats; else it is supposed to be all that is left, anew after every effect."""
    steps: list[Step] = field(default_factory=list)

    @property
    def decisive(self) -> float:
        """Difference of BIC that decides."""
        return DECISIVE if self.repeated else WIDER * DECISIVE

    def run(self, base: Fit) -> Fit:
        """The accepted hypothesis, from the fit without effects."""
        current = base
        while len(current.hypothesis.terms) - len(base.hypothesis.terms) < MOST_EFFECTS:
            step = self._next(current)
            self.steps.append(step)
            if step.added is None:
                break
            current = self.simpler(self.without_idle(step.refits[0], base), base)
            if not self.repeated:
                current = self._weighed_anew(current)
        return current

    def _weighed_anew(self, current: Fit) -> Fit:
        self.evidence = replace(self.evidence, noise=supposed(self.evidence.experiments, current.residuals))
        self.selection = [replace(one, noise=self.evidence.noise) for one in self.selection]
        return fit(self.evidence, current.hypothesis, current.steps)

    def lacks(self, current: Fit) -> bool:
        """Whether all repeats of some channel show what the fit does not."""
        return any(significant(m) for m in self.misfits(current).values())

    def misfits(self, current: Fit) -> dict[str, Misfit]:
        """Of every channel, on the fitted trials."""
        return misfit(self.evidence.experiments, current.residuals, self.evidence.noise)

    def _next(self, current: Fit) -> Step:
        taken = {(t.effect, t.channel) for t in current.hypothesis.terms}
        open_ = [t for t in self.candidates if (t.effect, t.channel) not in taken]
        self.told(f"screening {len(open_)} candidates")
        found = screen(self.evidence, current, open_)
        needed = self.decisive + float(np.log(self.evidence.effective))
        promising = [c for c in found if c.gain > 0.5 * needed]
        if not promising:
            return Step(current, tuple(found), (), None, {}, "no effect promises to explain more than noise would")
        refits = self.refit(current, shortlist(promising))
        objections: list[str] = []
        for number, best in enumerate(refits[:SECOND_CHANCES]):
            gains = self.gains(current, best)
            objection = self.objection(current, best, gains)
            if not objection:
                gain = self._criterion(current) - self._criterion(best)
                ordered = [best, *refits[:number], *refits[number + 1 :]]
                why = "; ".join([f"BIC falls by {gain:.0f}", *objections])
                return Step(current, tuple(found), tuple(ordered), best.hypothesis.terms[-1], gains, why)
            objections.append(objection)
        return Step(current, tuple(found), tuple(refits), None, {}, "; ".join(objections))

    def refit(self, current: Fit, chosen: Sequence[Candidate], goal: float = np.inf) -> list[Fit]:
        """``chosen`` refitted, best first; who falls behind the best, or a ``goal`` of BIC, drops out half-way."""
        fits = []
        for number, candidate in enumerate(chosen):
            self.told(f"fitting {candidate.term} ({number + 1} of {len(chosen)})")
            hypothesis = current.hypothesis.plus(candidate.term)
            fits.append(fit(self.evidence, hypothesis, self._begin(current, candidate), rounds=PATIENCE[0]))
        dropped: list[Fit] = []
        for rounds in PATIENCE[1:]:
            if not fits:
                break
            best = min([goal, *map(self._criterion, fits)])
            limit = best + max(20.0 * DECISIVE, BEHIND * (self._criterion(current) - best))
            dropped += [f for f in fits if self._criterion(f) > limit]
            fits = [f for f in fits if self._criterion(f) <= limit]
            for k, each in enumerate(fits):
                if not each.converged:
                    self.told(f"fitting {each.hypothesis.terms[-1]} further")
                    fits[k] = fit(self.evidence, each.hypothesis, each.steps, each.jacobian, rounds=rounds)
        return sorted([*fits, *dropped], key=self._criterion)

    def _begin(self, current: Fit, candidate: Candidate) -> Array:
        """Where to fit ``candidate`` from: some part of what screening promised, the other unknowns following.

        Many effects are anything but linear in their size, so the whole of it may be far too much. If no part keeps
        the promise, sizes are tried one by one, with the other unknowns where they are.
        """
        hypothesis, known = current.hypothesis.plus(candidate.term), len(current.steps)
        neutral = hypothesis.start()
        neutral[:known] = candidate.origin
        own = np.array([0.0 if u.logarithmic else 1.0 for u in hypothesis.unknowns])
        own[:known] = 0.0
        whole = candidate.steps * own
        whole[:known] = candidate.follow
        row, cost = self._cheapest(hypothesis, [neutral + part * whole for part in PARTS])
        if current.cost - cost > KEPT * candidate.gain:
            return row
        neutral[:known] = current.steps
        own *= np.sign(candidate.steps)
        other, less = self._cheapest(hypothesis, [neutral + size * own for size in LADDER])
        return other if less < cost else row

    def _cheapest(self, hypothesis: Hypothesis, rows: Sequence[Array]) -> tuple[Array, float]:
        """The best of ``rows`` of unknowns, kept within their bounds, and its chi squared, both by long steps."""
        within = [np.clip(row, *hypothesis.bounds()) for row in rows]
        costs = []
        for row, found in zip(within, self.evidence.residuals(hypothesis, within, coarse=True), strict=True):
            vector = self.evidence.weighted(found)
            costs.append(float(vector @ vector + row[: hypothesis.base] @ row[: hypothesis.base]))
        best = int(np.argmin(costs))
        return within[best], costs[best]

    def _criterion(self, one: Fit) -> float:
        return one.criterion(self.evidence.effective)

    def gains(self, before: Fit, after: Fit) -> dict[str, float]:
        """Selection group -> relative fall of chi squared from one fit to another, neither of which saw it.

        Without selection trials, each fitted group in turn is left out and both are fitted to the others.
        """
        if not self.selection:
            return self._left_out(before, after)
        found = {}
        for evidence in self.selection:
            sizes = []
            for each in (before, after):
                vector = evidence.weighted(evidence.residuals(each.hypothesis, [each.steps])[0])
                sizes.append(float(vector @ vector))
            found[evidence.experiments[0].group] = 1.0 - sizes[1] / sizes[0]
        return found

    def _left_out(self, before: Fit, after: Fit) -> dict[str, float]:
        members = groups(self.evidence.experiments)
        if len(members) < 2:
            return {}
        found = {}
        for group in members:
            rest = self.evidence.on([e for e in self.evidence.experiments if e.group != group])
            alone = self.evidence.on([e for e in self.evidence.experiments if e.group == group])
            sizes = []
            for each in (before, after):
                refitted = fit(rest, each.hypothesis, each.steps, rounds=PATIENCE[1])
                vector = alone.weighted(alone.residuals(refitted.hypothesis, [refitted.steps])[0])
                sizes.append(float(vector @ vector))
            found[group] = 1.0 - sizes[1] / sizes[0]
        return found

    def objection(self, before: Fit, best: Fit, gains: dict[str, float]) -> str:
        """Why ``best`` is not accepted in place of ``before``, which is without its last term; '' if it is."""
        gain = self._criterion(before) - self._criterion(best)
        term = best.hypothesis.terms[-1]
        least = LEAST_GAIN if self.lacks(before) else UNASKED * LEAST_GAIN
        if gain <= self.decisive:
            return f"{term} explains no more than noise would (BIC falls by {gain:.1f}, {self.decisive:.0f} are needed)"
        losses = [f"'{group}' by {-100 * g:.1f} %" for group, g in gains.items() if g < -MOST_LOSS]
        if losses:
            return f"{term} fits, but trials that were not fitted get worse: {', '.join(losses)}"
        if gains and float(np.mean(list(gains.values()))) <= least:
            return f"{term} fits, but trials that were not fitted gain no more than {100 * least:.0f} %"
        return ""

    def without_idle(self, current: Fit, base: Fit) -> Fit:
        """``current`` less the terms that later ones have made idle."""
        own = current.hypothesis.terms[len(base.hypothesis.terms) :]
        for term in own[:-1]:
            self.told(f"trying without {term}")
            less = drop(self.evidence, current, term)
            if self._criterion(less) <= self._criterion(current) + self.decisive:
                return self.without_idle(less, base)
        return current

    def simpler(self, current: Fit, base: Fit) -> Fit:
        """``current`` with simpler forms of earlier effects, where later ones have made the others' shapes idle.

        A shape that fits what another effect has been found to do is held by nothing once that one is there.
        """
        own = current.hypothesis.terms[len(base.hypothesis.terms) :]
        for term in own[:-1]:
            for form in term.entry.forms:
                if len(form.parameters) >= len(term.parameters):
                    continue
                plain = Term(term.effect, form.name, term.channel)
                self.told(f"trying {plain} in place of {term}")
                less = exchange(self.evidence, current, term, plain)
                if self._criterion(less) <= self._criterion(current):
                    return self.simpler(less, base)
        return current


def shortlist(promising: Sequence[Candidate]) -> list[Candidate]:
    """The best, and the other forms of the best three effects."""
    leaders = {(c.term.effect, c.term.channel) for c in promising[:3]}
    return [c for k, c in enumerate(promising) if k < SHORTLIST or (c.term.effect, c.term.channel) in leaders]


def drop(evidence: Evidence, current: Fit, term: Term) -> Fit:
    """``current`` fitted again without ``term``."""
    number = current.hypothesis.terms.index(term)
    keep = [u.term != number for u in current.hypothesis.unknowns]
    return fit(evidence, current.hypothesis.minus(term), current.steps[keep], current.jacobian[:, keep])


def exchange(evidence: Evidence, current: Fit, term: Term, other: Term) -> Fit:
    """``current`` fitted again with ``other``, neutral at first, in place of ``term``."""
    number, old = current.hypothesis.terms.index(term), current.hypothesis.unknowns
    terms = tuple(other if t == term else t for t in current.hypothesis.terms)
    hypothesis = replace(current.hypothesis, terms=terms)
    start = hypothesis.start()
    start[[u.term != number for u in hypothesis.unknowns]] = current.steps[[u.term != number for u in old]]
    return fit(evidence, hypothesis, start)
