"""From a device that does not fit to the effects that it lacks, one at a time, with a reason for each.

An effect is accepted if the evidence asks for it (BIC counted in independent samples) *and* trials that were not
fitted improve. Forms compete before effects do: the best form of every promising effect is found before anything is
added to it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from klute_sim.diagnosis.experiments.base import Array
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit, WeightedData, fit_hypothesis
from klute_sim.diagnosis.noise.repeats import (
    Misfit,
    estimate_misfit,
    estimate_noise_from_residuals,
    group_repeats,
    is_significant,
)
from klute_sim.diagnosis.selection.screening import Candidate, screen_candidates

BIC_THRESHOLD = 6.0
"""Difference of BIC that decides between two hypotheses."""
MAX_EFFECTS = 3
SHORTLIST_SIZE = 8
"""Candidates that are refitted."""
MIN_VALIDATION_GAIN = 0.05
"""Mean fall of chi squared on selection trials, relative: about what an effect of a quarter of the noise brings."""
MAX_VALIDATION_LOSS = 0.02
"""Rise of chi squared that one group of selection trials may have, relative."""
NO_MISFIT_GAIN_FACTOR = 2.0
"""What the mean fall is multiplied by where repeats do not show that anything is missing."""
NO_REPEATS_BIC_FACTOR = 2.0
"""What the difference of BIC is multiplied by where nothing was repeated and noise is only supposed."""
REFIT_MAX_NFEV = (3, 4, 25)
"""Rounds of fitting that the shortlist gets, then who is left of it, then who is left of those."""
START_FRACTIONS = (0.05, 0.2, 0.5, 1.0)
"""Of what screening promised, that are tried to begin a fit with."""
START_SIZES = (0.01, 0.016, 0.025, 0.04, 0.063, 0.1, 0.16, 0.25, 0.4, 0.63, 1.0)
"""Typical sizes that are tried where the promise is not kept: an effect with a threshold, such as a tank that runs low,
does nothing at all in one size and far too much in another, and no straight line leads from there."""
MIN_START_GAIN_FRACTION = 0.3
"""Share of what screening promised that a fit has to begin with, for the ladder not to be tried."""
MAX_ACCEPTANCE_TESTS = 3
"""How many of the shortlist may be accepted, should the better ones not help trials that were not fitted."""
MAX_BIC_LAG_FRACTION = 0.3
"""Of the best one's fall of BIC, by which a candidate may be behind to get more rounds."""


@dataclass(frozen=True, eq=False)
class SelectionStep:
    """What was found when something was to be added."""

    initial_fit: Fit
    candidates: tuple[Candidate, ...]
    refits: tuple[Fit, ...]
    """Of the shortlist; the accepted one first, then by BIC."""
    added_term: EffectTerm | None
    validation_gains: dict[str, float]
    """Of the accepted one: selection group -> relative fall of chi squared."""
    reason: str


@dataclass(eq=False)
class ForwardSelection:
    """A search under way; what it has decided is in :attr:`steps`."""

    data: WeightedData
    validation_data: Sequence[WeightedData]
    """One per selection group."""
    candidate_terms: Sequence[EffectTerm]
    progress: Callable[[str], None] = lambda sentence: None
    has_repeats: bool = True
    """Whether noise was measured from repeats; else it is supposed to be all that is left, anew after every effect."""
    history: list[SelectionStep] = field(default_factory=list)

    @property
    def bic_threshold(self) -> float:
        """Difference of BIC that decides."""
        return BIC_THRESHOLD if self.has_repeats else NO_REPEATS_BIC_FACTOR * BIC_THRESHOLD

    def run(self, base_fit: Fit) -> Fit:
        """The accepted hypothesis, from the fit without effects."""
        current = base_fit
        while len(current.hypothesis.terms) - len(base_fit.hypothesis.terms) < MAX_EFFECTS:
            step = self._select_next(current)
            self.history.append(step)
            if step.added_term is None:
                break
            current = self.simplify(self.prune(step.refits[0], base_fit), base_fit)
            if not self.has_repeats:
                current = self._reestimate_noise(current)
        return current

    def _reestimate_noise(self, current: Fit) -> Fit:
        self.data = replace(self.data, noise=estimate_noise_from_residuals(self.data.experiments, current.residuals))
        self.validation_data = [replace(one, noise=self.data.noise) for one in self.validation_data]
        return fit_hypothesis(self.data, current.hypothesis, current.x)

    def has_misfit(self, current: Fit) -> bool:
        """Whether all repeats of some channel show what the fit does not."""
        return any(is_significant(m) for m in self.compute_misfits(current).values())

    def compute_misfits(self, current: Fit) -> dict[str, Misfit]:
        """Of every channel, on the fitted trials."""
        return estimate_misfit(self.data.experiments, current.residuals, self.data.noise)

    def _select_next(self, current: Fit) -> SelectionStep:
        taken = {(t.effect, t.channel) for t in current.hypothesis.terms}
        open_ = [t for t in self.candidate_terms if (t.effect, t.channel) not in taken]
        self.progress(f"screening {len(open_)} candidates")
        found = screen_candidates(self.data, current, open_)
        needed = self.bic_threshold + float(np.log(self.data.n_effective))
        promising = [c for c in found if c.predicted_gain > 0.5 * needed]
        if not promising:
            return SelectionStep(
                current, tuple(found), (), None, {}, "no effect promises to explain more than noise would"
            )
        refits = self.refit_candidates(current, select_shortlist(promising))
        objections: list[str] = []
        for number, best in enumerate(refits[:MAX_ACCEPTANCE_TESTS]):
            gains = self.compute_validation_gains(current, best)
            objection = self.rejection_reason(current, best, gains)
            if not objection:
                gain = self._bic(current) - self._bic(best)
                ordered = [best, *refits[:number], *refits[number + 1 :]]
                why = "; ".join([f"BIC falls by {gain:.0f}", *objections])
                return SelectionStep(current, tuple(found), tuple(ordered), best.hypothesis.terms[-1], gains, why)
            objections.append(objection)
        return SelectionStep(current, tuple(found), tuple(refits), None, {}, "; ".join(objections))

    def refit_candidates(self, current: Fit, candidates: Sequence[Candidate], bic_goal: float = np.inf) -> list[Fit]:
        """``chosen`` refitted, best first; who falls behind the best, or a ``goal`` of BIC, drops out half-way."""
        fits = []
        for number, candidate in enumerate(candidates):
            self.progress(f"fitting {candidate.term} ({number + 1} of {len(candidates)})")
            hypothesis = current.hypothesis.with_term(candidate.term)
            fits.append(
                fit_hypothesis(
                    self.data, hypothesis, self._initial_guess(current, candidate), max_nfev=REFIT_MAX_NFEV[0]
                )
            )
        dropped: list[Fit] = []
        for rounds in REFIT_MAX_NFEV[1:]:
            if not fits:
                break
            best = min([bic_goal, *map(self._bic, fits)])
            limit = best + max(20.0 * BIC_THRESHOLD, MAX_BIC_LAG_FRACTION * (self._bic(current) - best))
            dropped += [f for f in fits if self._bic(f) > limit]
            fits = [f for f in fits if self._bic(f) <= limit]
            for k, each in enumerate(fits):
                if not each.converged:
                    self.progress(f"fitting {each.hypothesis.terms[-1]} further")
                    fits[k] = fit_hypothesis(self.data, each.hypothesis, each.x, each.jacobian, max_nfev=rounds)
        return sorted([*fits, *dropped], key=self._bic)

    def _initial_guess(self, current: Fit, candidate: Candidate) -> Array:
        """Where to fit ``candidate`` from: some part of what screening promised, the other unknowns following.

        Many effects are anything but linear in their size, so the whole of it may be far too much. If no part keeps
        the promise, sizes are tried one by one, with the other unknowns where they are.
        """
        hypothesis, known = current.hypothesis.with_term(candidate.term), len(current.x)
        neutral = hypothesis.initial_point()
        neutral[:known] = candidate.x0
        own = np.array([0.0 if u.is_logarithmic else 1.0 for u in hypothesis.parameters])
        own[:known] = 0.0
        whole = candidate.size * own
        whole[:known] = candidate.nuisance_shift
        row, cost = self._best_start(hypothesis, [neutral + part * whole for part in START_FRACTIONS])
        if current.chi2 - cost > MIN_START_GAIN_FRACTION * candidate.predicted_gain:
            return row
        neutral[:known] = current.x
        own *= np.sign(candidate.size)
        other, less = self._best_start(hypothesis, [neutral + size * own for size in START_SIZES])
        return other if less < cost else row

    def _best_start(self, hypothesis: Hypothesis, starts: Sequence[Array]) -> tuple[Array, float]:
        """The best of ``rows`` of unknowns, kept within their bounds, and its chi squared, both by long steps."""
        within = [np.clip(row, *hypothesis.bounds()) for row in starts]
        costs = []
        for row, found in zip(within, self.data.compute_residuals(hypothesis, within, coarse=True), strict=True):
            vector = self.data.weight_residuals(found)
            costs.append(
                float(vector @ vector + row[: hypothesis.n_device_parameters] @ row[: hypothesis.n_device_parameters])
            )
        best = int(np.argmin(costs))
        return within[best], costs[best]

    def _bic(self, fit_result: Fit) -> float:
        return fit_result.bic(self.data.n_effective)

    def compute_validation_gains(self, before: Fit, after: Fit) -> dict[str, float]:
        """Selection group -> relative fall of chi squared from one fit to another, neither of which saw it.

        Without selection trials, each fitted group in turn is left out and both are fitted to the others.
        """
        if not self.validation_data:
            return self._compute_cross_validation_gains(before, after)
        found = {}
        for evidence in self.validation_data:
            sizes = []
            for each in (before, after):
                vector = evidence.weight_residuals(evidence.compute_residuals(each.hypothesis, [each.x])[0])
                sizes.append(float(vector @ vector))
            found[evidence.experiments[0].group] = 1.0 - sizes[1] / sizes[0]
        return found

    def _compute_cross_validation_gains(self, before: Fit, after: Fit) -> dict[str, float]:
        members = group_repeats(self.data.experiments)
        if len(members) < 2:
            return {}
        found = {}
        for group in members:
            rest = self.data.with_experiments([e for e in self.data.experiments if e.group != group])
            alone = self.data.with_experiments([e for e in self.data.experiments if e.group == group])
            sizes = []
            for each in (before, after):
                refitted = fit_hypothesis(rest, each.hypothesis, each.x, max_nfev=REFIT_MAX_NFEV[1])
                vector = alone.weight_residuals(alone.compute_residuals(refitted.hypothesis, [refitted.x])[0])
                sizes.append(float(vector @ vector))
            found[group] = 1.0 - sizes[1] / sizes[0]
        return found

    def rejection_reason(self, before: Fit, after: Fit, validation_gains: dict[str, float]) -> str:
        """Why ``best`` is not accepted in place of ``before``, which is without its last term; '' if it is."""
        gain = self._bic(before) - self._bic(after)
        term = after.hypothesis.terms[-1]
        least = MIN_VALIDATION_GAIN if self.has_misfit(before) else NO_MISFIT_GAIN_FACTOR * MIN_VALIDATION_GAIN
        if gain <= self.bic_threshold:
            return f"{term} explains no more than noise would (BIC falls by {gain:.1f}, {self.bic_threshold:.0f} are needed)"
        losses = [f"'{group}' by {-100 * g:.1f} %" for group, g in validation_gains.items() if g < -MAX_VALIDATION_LOSS]
        if losses:
            return f"{term} fits, but trials that were not fitted get worse: {', '.join(losses)}"
        if validation_gains and float(np.mean(list(validation_gains.values()))) <= least:
            return f"{term} fits, but trials that were not fitted gain no more than {100 * least:.0f} %"
        return ""

    def prune(self, current: Fit, base_fit: Fit) -> Fit:
        """``current`` less the terms that later ones have made idle."""
        own = current.hypothesis.terms[len(base_fit.hypothesis.terms) :]
        for term in own[:-1]:
            self.progress(f"trying without {term}")
            less = refit_without_term(self.data, current, term)
            if self._bic(less) <= self._bic(current) + self.bic_threshold:
                return self.prune(less, base_fit)
        return current

    def simplify(self, current: Fit, base_fit: Fit) -> Fit:
        """``current`` with simpler forms of earlier effects, where later ones have made the others' shapes idle.

        A shape that fits what another effect has been found to do is held by nothing once that one is there.
        """
        own = current.hypothesis.terms[len(base_fit.hypothesis.terms) :]
        for term in own[:-1]:
            for form in term.effect_definition.forms:
                if len(form.parameters) >= len(term.parameters):
                    continue
                plain = EffectTerm(term.effect, form.name, term.channel)
                self.progress(f"trying {plain} in place of {term}")
                less = refit_with_replacement(self.data, current, term, plain)
                if self._bic(less) <= self._bic(current):
                    return self.simplify(less, base_fit)
        return current


def select_shortlist(candidates: Sequence[Candidate]) -> list[Candidate]:
    """The best, and the other forms of the best three effects."""
    leaders = {(c.term.effect, c.term.channel) for c in candidates[:3]}
    return [c for k, c in enumerate(candidates) if k < SHORTLIST_SIZE or (c.term.effect, c.term.channel) in leaders]


def refit_without_term(data: WeightedData, current: Fit, term: EffectTerm) -> Fit:
    """``current`` fitted again without ``term``."""
    number = current.hypothesis.terms.index(term)
    keep = [u.term_index != number for u in current.hypothesis.parameters]
    return fit_hypothesis(data, current.hypothesis.without_term(term), current.x[keep], current.jacobian[:, keep])


def refit_with_replacement(data: WeightedData, current: Fit, term: EffectTerm, replacement: EffectTerm) -> Fit:
    """``current`` fitted again with ``other``, neutral at first, in place of ``term``."""
    number, old = current.hypothesis.terms.index(term), current.hypothesis.parameters
    terms = tuple(replacement if t == term else t for t in current.hypothesis.terms)
    hypothesis = replace(current.hypothesis, terms=terms)
    start = hypothesis.initial_point()
    start[[u.term_index != number for u in hypothesis.parameters]] = current.x[[u.term_index != number for u in old]]
    return fit_hypothesis(data, hypothesis, start)
