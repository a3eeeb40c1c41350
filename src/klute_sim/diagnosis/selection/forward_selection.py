"""Forward selection of the effects that a device lacks, one at a time, with a reason for each decision.

An effect is accepted if the BIC of independent samples prefers it *and* it improves validation trials. Forms compete
before effects do: the best form of each promising effect is fitted before another effect is added.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from klute_sim.diagnosis.command_delay import complete_with_command_delay
from klute_sim.diagnosis.data_quality import is_supply_only
from klute_sim.diagnosis.fitting.bic import format_bic_drop
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit, extend_jacobian, fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.misfit import Misfit, estimate_misfit, is_significant
from klute_sim.diagnosis.noise.repeats import estimate_noise_from_residuals
from klute_sim.diagnosis.selection.candidates import list_further_terms
from klute_sim.diagnosis.selection.naming import (
    IMPLAUSIBLE_REASON,
    find_implausible_instrument,
    find_infeasible_terms,
    find_unresolved_delays,
    get_min_bic_fall,
)
from klute_sim.diagnosis.selection.nested_forms import restart_nested_forms
from klute_sim.diagnosis.selection.refits import refit_with_replacement, refit_without_term
from klute_sim.diagnosis.selection.screening import Candidate, screen_candidates, select_shortlist
from klute_sim.diagnosis.selection.selection_step import SelectionStep
from klute_sim.diagnosis.selection.validation import (
    MAX_VALIDATION_LOSS,
    MIN_VALIDATION_GAIN,
    compute_validation_chi2,
    select_validation_data,
)
from klute_sim.types import Array

BIC_THRESHOLD = 6.0
"""Difference of BIC that decides between two models: strong evidence after Kass and Raftery (1995), J. Am. Stat. Assoc.
90, 773-795."""
MAX_EFFECTS = 3
"""Maximum number of added effects (assumed)."""
NO_MISFIT_GAIN_FACTOR = 2.0
"""Factor of the minimum validation gain where repeats show no misfit (assumed)."""
MIN_FAULT_CHI2_FALL = 12.0
"""Fall of chi squared in validation trials by which a fault of an instrument, which one channel shows, needs no such
factor (assumed: a likelihood ratio of 400)."""
MIN_FURTHER_GAIN_FRACTION = 1e-3
"""Fall of chi squared by a further effect, over that by the effects before it, which it must exceed where repeats show
no misfit without it (assumed: the simulation reproduces the trace of an effect to 3 %)."""
NO_REPEATS_BIC_FACTOR = 2.0
"""Factor of the BIC threshold where no trial has repeats and the noise is an assumption (assumed)."""
REFIT_MAX_NFEV = (3, 4, 25)
"""Maximum number of function evaluations in the three rounds of fitting the shortlist."""
START_FRACTIONS = (0.05, 0.2, 0.5, 1.0)
"""Fractions of the predicted parameters that are tried as starting points."""
START_SIZES = (0.01, 0.016, 0.025, 0.04, 0.063, 0.1, 0.16, 0.25, 0.4, 0.63, 1.0)
"""Typical sizes that are tried where the prediction fails. An effect with a threshold, such as an emptying tank, has no
influence at one size and too much at another, so linear extrapolation fails."""
MIN_START_GAIN_FRACTION = 0.3
"""Fraction of the predicted gain that a starting point must reach, else :data:`START_SIZES` are tried."""
MIN_PREDICTED_FRACTION = 0.02
"""Fraction of the largest predicted gain below which a candidate is not fitted (assumed)."""
MIN_RELEVANT_FRACTION = 0.005
"""Residual, over the range of its channel, up to which data without repeats show nothing (assumed: the accuracy of
usual instruments)."""
MAX_ACCEPTANCE_TESTS = 3
"""Number of candidates of the shortlist that are tested on validation trials."""
MAX_BIC_EXCESS_FRACTIONS = (0.3, 0.1)
"""Largest excess of BIC over the best candidate, as a fraction of its gain, for the later rounds of fitting."""
DIVERGENCE_REASON = "with it, a simulation diverges"
"""Reason for the rejection of an effect without a finite simulation."""


@dataclass(eq=False)
class ForwardSelection:
    """A forward selection; :attr:`history` holds its decisions."""

    data: WeightedData
    """Fitted trials."""
    validation_data: Sequence[WeightedData]
    """Validation trials, one entry per group."""
    candidate_terms: Sequence[EffectTerm]
    """Effects and errors of numbers that may be added."""
    report_stage: Callable[[str], None] = lambda stage: None
    """Receives a short description of the current stage."""
    has_repeats: bool = True
    """Whether noise was measured from repeats; otherwise residuals count as noise, re-estimated after each effect."""
    tolerance: Mapping[str, float] = field(default_factory=dict)
    """Channel -> misfit [SI] up to which the user does not care."""
    history: list[SelectionStep] = field(default_factory=list)
    """Steps so far."""

    @property
    def bic_threshold(self) -> float:
        """Difference of BIC that decides between two models."""
        return BIC_THRESHOLD if self.has_repeats else NO_REPEATS_BIC_FACTOR * BIC_THRESHOLD

    def run(self, base_fit: Fit) -> Fit:
        """Return the fit with the accepted effects, starting from ``base_fit`` without them."""
        current = base_fit
        while len(current.hypothesis.terms) - len(base_fit.hypothesis.terms) < MAX_EFFECTS:
            step = self._select_next(current)
            self.history.append(step)
            if step.added_term is None:
                return self.complete(current)
            current = self.simplify(self.prune(step.refits[0], base_fit), base_fit)
            if not self.has_repeats:
                current = self._reestimate_noise(current)
        return current

    def complete(self, current: Fit) -> Fit:
        """Return ``current`` with a delay of the command's log, where nothing is missing with it and its effects."""
        if not (current.hypothesis.terms and self.has_repeats and self.has_misfit(current)):
            return current
        completed = complete_with_command_delay(self.data, current)
        return current if completed is None or self.has_misfit(completed) else completed

    def _reestimate_noise(self, current: Fit) -> Fit:
        self.data = replace(self.data, noise=estimate_noise_from_residuals(self.data.experiments, current.residuals))
        self.validation_data = [replace(data, noise=self.data.noise) for data in self.validation_data]
        return fit_hypothesis(self.data, current.hypothesis, current.x)

    def has_misfit(self, current: Fit) -> bool:
        """Return whether all repeats of some channel share a significant misfit of the ``current`` fit."""
        return bool(self.find_relevant_misfits(current))

    def is_within_tolerance(self, current: Fit) -> bool:
        """Return whether the user tolerates what ``current`` leaves.

        Without repeats the misfit is unknown, so the whole residual of each channel must be within its tolerance.
        """
        if not self.tolerance:
            return False
        if self.has_repeats:
            return not self.has_misfit(current)
        return all(
            estimate.std <= self.tolerance.get(channel, 0.0)
            for channel, estimate in estimate_noise_from_residuals(self.data.experiments, current.residuals).items()
        )

    def has_relevant_residual(self, current: Fit) -> bool:
        """Return whether some channel of ``current`` is further off than usual instruments are."""
        for channel in self.data.noise:
            rows = [
                (residuals[channel], e.measured[channel].value)
                for e, residuals in zip(self.data.experiments, current.residuals, strict=True)
                if channel in residuals
            ]
            residual, reading = (np.concatenate(parts) for parts in zip(*rows, strict=True))
            if np.sqrt(np.mean(residual**2)) > MIN_RELEVANT_FRACTION * np.ptp(reading):
                return True
        return False

    def find_relevant_misfits(self, current: Fit) -> dict[str, Misfit]:
        """Return the misfit of each channel in which it is significant and above the tolerance."""
        return {
            channel: misfit
            for channel, misfit in self.compute_misfits(current).items()
            if is_significant(misfit) and misfit.rms > self.tolerance.get(channel, 0.0)
        }

    def compute_misfits(self, current: Fit) -> dict[str, Misfit]:
        """Return the misfit of each channel on the fitted trials."""
        return estimate_misfit(self.data.experiments, current.residuals, self.data.noise)

    def _select_next(self, current: Fit) -> SelectionStep:
        unused = list_further_terms(self.candidate_terms, current)
        self.report_stage(f"screening {len(unused)} candidates")
        rejections: dict[EffectTerm, str] = {}
        candidates = screen_candidates(
            self.data, current, unused, lambda term: rejections.update({term: f"{term}: {DIVERGENCE_REASON}"})
        )
        min_gain = self.bic_threshold + float(np.log(self.data.n_effective))
        best_gain = max((c.predicted_gain for c in candidates), default=0.0)
        promising = [
            c for c in candidates if c.predicted_gain > max(0.5 * min_gain, MIN_PREDICTED_FRACTION * best_gain)
        ]
        if not promising:
            reason = "no effect is predicted to explain more than noise would"
            return SelectionStep(current, tuple(candidates), (), None, {}, reason, rejections)
        refits = self.refit_candidates(current, select_shortlist(promising))
        for rank in range(len(refits[:MAX_ACCEPTANCE_TESTS])):
            fit = refits[rank]
            refit = refits[rank] = fit_hypothesis(self.data, fit.hypothesis, fit.x, max_nfev=REFIT_MAX_NFEV[1])
            gains = self.compute_validation_gains(current, refit)
            rejection = self.rejection_reason(current, refit, gains)
            if not rejection:
                bic_gain = self._bic(current) - self._bic(refit)
                ordered = (refit, *refits[:rank], *refits[rank + 1 :])
                reason = "; ".join([f"BIC {format_bic_drop(bic_gain)}", *rejections.values()])
                term = refit.hypothesis.terms[-1]
                return SelectionStep(current, tuple(candidates), ordered, term, gains, reason, rejections)
            rejections[refit.hypothesis.terms[-1]] = rejection
        reason = "; ".join(rejections.values())
        return SelectionStep(current, tuple(candidates), tuple(refits), None, {}, reason, rejections)

    def refit_candidates(
        self,
        current: Fit,
        candidates: Sequence[Candidate],
        bic_goal: float = np.inf,
        *,
        max_nfev_by_round: Sequence[int] = REFIT_MAX_NFEV,
    ) -> list[Fit]:
        """Return fits of ``current`` with each of ``candidates`` added, best first.

        The fits are preliminary. Candidates far above the BIC of the best one, or above ``bic_goal``, are not fitted
        to the end. ``max_nfev_by_round`` holds the maximum number of function evaluations of each round.
        """
        fits = []
        for index, candidate in enumerate(candidates):
            self.report_stage(f"fitting {candidate.term} ({index + 1} of {len(candidates)})")
            hypothesis = current.hypothesis.with_term(candidate.term)
            x0 = self._initial_guess(current, candidate)
            jacobian = extend_jacobian(self.data, hypothesis, x0, current.jacobian)
            fits.append(
                fit_hypothesis(self.data, hypothesis, x0, jacobian, max_nfev=max_nfev_by_round[0], reference=current)
            )
        dropped: list[Fit] = []
        last = len(max_nfev_by_round) - 1
        for index, excess_fraction in zip(range(1, last + 1), MAX_BIC_EXCESS_FRACTIONS, strict=False):
            if not fits:
                break
            best_bic = min([bic_goal, *map(self._bic, fits)])
            max_bic = best_bic + max(20.0 * BIC_THRESHOLD, excess_fraction * (self._bic(current) - best_bic))
            dropped += [fit for fit in fits if self._bic(fit) > max_bic]
            fits = [fit for fit in fits if self._bic(fit) <= max_bic]
            for k, fit in enumerate(fits):
                self.report_stage(f"fitting {fit.hypothesis.terms[-1]} further")
                fits[k] = fit_hypothesis(
                    self.data,
                    fit.hypothesis,
                    fit.x,
                    fit.jacobian if index < last else None,
                    max_nfev=max_nfev_by_round[index],
                    reference=fit,
                )
        return sorted(restart_nested_forms(self.data, [*fits, *dropped], max_nfev_by_round[-1]), key=self._bic)

    def _initial_guess(self, current: Fit, candidate: Candidate) -> Array:
        """Return the best starting point for ``candidate``.

        Starting points are fractions of the linear prediction, in which the other parameters follow. Many effects are
        nonlinear, so the full prediction may be far too large. If no fraction reaches the predicted gain, sizes of the
        effect are tried with the other parameters unchanged; those of an effect of the supply are always tried, because
        the best flow of a valve is in a narrow valley beside a plateau.
        """
        hypothesis, n_known = current.hypothesis.with_term(candidate.term), len(current.x)
        neutral = hypothesis.initial_point()
        neutral[:n_known] = candidate.x0
        direction = np.array([0.0 if p.is_logarithmic else 1.0 for p in hypothesis.parameters])
        direction[:n_known] = 0.0
        prediction = candidate.size * direction
        prediction[:n_known] = candidate.nuisance_shift
        starts = [neutral + fraction * prediction for fraction in START_FRACTIONS]
        start, chi2 = self.find_best_start(current, hypothesis, starts)
        has_plateau = candidate.term.effect_definition.acts_in_supply
        if not has_plateau and current.chi2 - chi2 > MIN_START_GAIN_FRACTION * candidate.predicted_gain:
            return start
        neutral[:n_known] = current.x
        direction *= np.sign(candidate.size)
        sizes = [neutral + size * direction for size in START_SIZES]
        other_start, other_chi2 = self.find_best_start(current, hypothesis, sizes)
        return other_start if other_chi2 < chi2 else start

    def find_best_start(self, current: Fit, hypothesis: Hypothesis, starts: Sequence[Array]) -> tuple[Array, float]:
        """Return the best of ``starts``, clipped to the bounds, and its chi squared.

        Coarse simulations predict how the residuals of ``current`` change.
        """
        clipped = [np.clip(start, *hypothesis.bounds()) for start in starts]
        experiments = self.data.experiments
        before = current.hypothesis.build_setups(current.x, experiments)
        after = [hypothesis.build_setups(x, experiments) for x in clipped]
        residual = self.data.weight_residuals(current.residuals)
        costs = []
        for x, changes in zip(clipped, self.data.compute_changes(before, after, coarse=True), strict=True):
            vector = residual + self.data.weight_residuals(changes)
            priors = self.data.compute_prior_residuals(hypothesis, x)
            costs.append(float(vector @ vector + priors @ priors))
        best = int(np.argmin(costs))
        return clipped[best], costs[best]

    def _bic(self, fit_result: Fit) -> float:
        return fit_result.bic(self.data.n_effective)

    def compute_validation_gains(self, before: Fit, after: Fit) -> dict[str, float]:
        """Return the relative fall of chi squared from ``before`` to ``after`` in each validation group.

        A group in which simulations of both diverge is left out: it tells nothing about the last term.
        """
        groups = self.compute_validation_chi2(before, after)
        return {
            group: 1.0 - chi2_after / chi2_before
            for group, (chi2_before, chi2_after) in groups.items()
            if np.isfinite([chi2_before, chi2_after]).any()
        }

    def compute_validation_chi2(self, *fits: Fit) -> dict[str, list[float]]:
        """Return chi squared of each of ``fits`` in each validation group, or fitted group that is left out."""
        return compute_validation_chi2(self.data, self.validation_data, fits)

    def rejection_reason(
        self, before: Fit, after: Fit, validation_gains: dict[str, float], max_required_gain: float = np.inf
    ) -> str:
        """Return why the last term of ``after`` is rejected; '' if it is accepted. ``before`` is without this term.

        Validation trials need not improve by more than ``max_required_gain``.
        """
        bic_gain = self._bic(before) - self._bic(after)
        term = after.hypothesis.terms[-1]
        if after.has_diverged or not np.isfinite(list(validation_gains.values())).all():
            return f"{term}: {DIVERGENCE_REASON}"
        flaw = find_infeasible_terms(after).get(term)
        if flaw:
            return f"{term} {flaw}"
        unresolved = find_unresolved_delays(self.data, after).get(term)
        if unresolved:
            return f"{term} {unresolved}"
        # A gauge that alone shows the supply must not stand in for it.
        if is_supply_only(self.data.experiments) and find_implausible_instrument(self.data, after) == term:
            return f"{term} {IMPLAUSIBLE_REASON}"
        min_gain = MIN_VALIDATION_GAIN if self.has_misfit(before) else NO_MISFIT_GAIN_FACTOR * MIN_VALIDATION_GAIN
        min_gain = min(min_gain, max_required_gain)
        min_fall = max(self.bic_threshold, get_min_bic_fall(self.data, after, term))
        if bic_gain <= min_fall:
            imitator = "noise would" if bic_gain <= self.bic_threshold else "errors between samples might"
            return (
                f"{term} explains no more than {imitator} (BIC {format_bic_drop(bic_gain, 1)}; a fall of more than "
                f"{min_fall:.0f} is required)"
            )
        known_gain = self._compute_gain_without_misfit(before)
        if before.chi2 - after.chi2 <= MIN_FURTHER_GAIN_FRACTION * known_gain:
            return (
                f"{term} explains less than {100.0 * MIN_FURTHER_GAIN_FRACTION:g} % of what the effects before it do, "
                "no more than errors of the simulation might"
            )
        has_trials = bool(select_validation_data(self.validation_data, before, after))
        trials = "validation trials" if has_trials else "the fitted groups, each left out in turn,"
        losses = [f"'{group}' by {-100 * g:.1f} %" for group, g in validation_gains.items() if g < -MAX_VALIDATION_LOSS]
        if losses:
            return f"{term} fits, but {trials} get worse: {', '.join(losses)}"
        gain = float(np.mean(list(validation_gains.values()))) if validation_gains else np.inf
        if gain <= min_gain and not (gain > MIN_VALIDATION_GAIN and self._is_confirmed_fault(before, after)):
            return f"{term} fits, but {trials} improve by no more than {100 * min_gain:.0f} %"
        return ""

    def _is_confirmed_fault(self, before: Fit, after: Fit) -> bool:
        """Return whether validation trials confirm a fault of an instrument, the last term of ``after``.

        The replay of a walk has errors of its own, which are like such faults.
        """
        if after.hypothesis.terms[-1].channel is None or self.data.experiments[0].has_body or not self.has_repeats:
            return False
        chi2 = self.compute_validation_chi2(before, after).values()
        return sum(of_before - of_after for of_before, of_after in chi2) > MIN_FAULT_CHI2_FALL

    def _compute_gain_without_misfit(self, current: Fit) -> float:
        """Return the fall of chi squared by the effects of ``current``.

        0 without repeats, and where they show a misfit.
        """
        if not self.history or not self.has_repeats or self.has_misfit(current):
            return 0.0
        return max(0.0, self.history[0].initial_fit.chi2 - current.chi2)

    def prune(self, current: Fit, base_fit: Fit) -> Fit:
        """Return ``current`` without the terms that later terms have made redundant."""
        added = current.hypothesis.terms[len(base_fit.hypothesis.terms) :]
        for term in added[:-1]:
            self.report_stage(f"trying without {term}")
            reduced = refit_without_term(self.data, current, term)
            if self._bic(reduced) <= self._bic(current) + self.bic_threshold:
                return self.prune(reduced, base_fit)
        return current

    def simplify(self, current: Fit, base_fit: Fit) -> Fit:
        """Return ``current`` with simpler forms of earlier effects where later ones have made their shapes redundant.

        A shape parameter may have fitted another effect; once that effect is added, the data do not determine it.
        """
        added = current.hypothesis.terms[len(base_fit.hypothesis.terms) :]
        for term in added[:-1]:
            for form in current.hypothesis.device.spec.list_candidate_forms(term.effect_definition):
                if len(form.parameters) >= len(term.parameters):
                    continue
                simpler = term._replace(form=form.name, parameter_keys=())
                if term.part and simpler not in self.candidate_terms:  # a number of the model is the same
                    continue
                self.report_stage(f"trying {simpler} in place of {term}")
                simplified = refit_with_replacement(self.data, current, term, simpler)
                if self._bic(simplified) <= self._bic(current):
                    return self.simplify(simplified, base_fit)
        return current
