"""Selection of effects where the law is imperfect: by the prediction of conditions that a fit has not seen.

Where the best model stays above the noise between repeats, that noise no longer says what is significant: every
flexible effect takes a part of the error of the law, and any model fails on the last newton of another specimen. Then
three things change:

- *Weights*: the residual that the law leaves counts as noise, correlated over a whole condition. Repeats of a condition
  share it, so they add no information.
- *Search*: effects are screened in pairs, because two effects that do little alone may do much together; the best pairs
  are extended by a third effect.
- *Decision*: each condition is left out once, or each specimen where there are three or more, or contiguous parts of
  the trials where there are fewer than three conditions (blocked cross-validation: Roberts et al. 2017, Ecography
  40:913). The simplest model whose error of prediction is within one standard error of the smallest is chosen (Breiman
  et al. 1984, *Classification and Regression Trees*, section 3.4.3). Names that are
  not chosen again without one fold or another are left out.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import lsq_linear

from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit, complete_fit, fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.selection.bounds import restore_declared_numbers, simplify_at_bound
from klute_sim.diagnosis.selection.candidates import is_same_cause
from klute_sim.diagnosis.selection.forward_selection import DIVERGENCE_REASON, ForwardSelection
from klute_sim.diagnosis.selection.naming import find_naming_obstacle, find_numbers_at_limit
from klute_sim.diagnosis.selection.nested_forms import refit_with_containing_forms, select_best_fits
from klute_sim.diagnosis.selection.pair_screening import screen_pairs
from klute_sim.diagnosis.selection.predictive_model import (
    FoldPart,
    PredictiveModel,
    PredictiveResult,
    are_proxies,
    choose_stable_model,
    compute_rival_margin,
    compute_share,
    divide_into_folds,
    is_as_good,
    list_certain_models,
    list_nameable_models,
    list_reduced_models,
    rank_model,
    refuse_redundant_terms,
)
from klute_sim.diagnosis.selection.robustness import check_convergence
from klute_sim.diagnosis.selection.screening import (
    Candidate,
    predict_gains,
    screen_candidates,
    select_best_causes,
    select_best_effects,
)
from klute_sim.types import Array, Mask

MAX_SINGLES, MAX_PAIRS, MAX_TRIPLES = 6, 6, 4
"""Largest number of single causes (and of effects, whatever their owner), of pairs and of triples that are fitted."""
COMPARISON_MAX_NFEV = (5,)
"""Maximum number of function evaluations of the fits that are compared first."""
MAX_LEADING, MAX_FINISHED = 4, 8
"""Number of leading models that are fitted to the end before the decision, and largest number of such fits and of
simplified models."""
MIN_LEADING_GAIN_FRACTION = 0.9
"""Fall of chi squared with a single effect, over the largest one, from which on it is fitted in every form that
contains its own (assumed: a Coulomb friction of a joint that is a Stribeck friction took 0.96 of what others took)."""
N_EXTENDED_SINGLES = 3
"""Number of single effects, those that fit best, that are extended by a second term."""
N_SECOND_TERMS = 2
"""Number of second terms of each of them."""
N_EXTENDED_PAIRS = 2
"""Number of pairs that are extended by a third term."""
MAX_SCREENED_CAUSES = 12
"""Number of causes that are screened beside a model: the most promising ones; the supply's come on top (assumed)."""
MIN_SHARE = 0.6
"""Share of the explainable error of prediction that names must take (assumed: a proxy for an effect outside the
catalogue takes less, named effects of measured muscles and seals take 0.78 to 1)."""
MAX_NUMBER_SHARE = 0.05
"""Share of what names gain that may need numbers at the limit of their uncertainty (assumed: the error of the law moves
numbers as well; a true name beside a law that was wrong by 2 to 5 % of the range needed 4 %)."""
FOLD_STEP_DEVIATION = 2.0
"""Scale of the quadratic penalty on the step of each normalized parameter when a fold is left out (assumed). With it,
the errors of converged models of a measured seal agree with refits within about 1 %; without it they are up to four
times as large."""


@dataclass(eq=False)
class PredictiveSelection:
    """A selection by predictions of left-out conditions."""

    data: WeightedData
    """All trials but the test trials, weighted by the error of the law
    (:mod:`klute_sim.diagnosis.fitting.law_error_weights`)."""
    noise_std: Mapping[str, float]
    """Channel -> standard deviation of its noise [SI]: between repeats, or without them the fast part of it."""
    candidate_terms: Sequence[EffectTerm]
    """Terms that may be added."""
    report_stage: Callable[[str], None] = lambda stage: None
    """Receives a short description of the current stage."""
    seed: int = 0
    """Random seed of the restarts."""
    folds: list[list[FoldPart]] = field(init=False)
    """What each fold leaves out."""
    fold_kind: str = field(init=False)
    """What a fold is: 'condition', 'specimen' or 'part'."""
    search: ForwardSelection = field(init=False)
    """Search that fits candidates to :attr:`data`."""

    def __post_init__(self) -> None:
        """Divide the trials into folds."""
        self.folds, self.fold_kind = divide_into_folds(self.data.experiments)
        self.search = ForwardSelection(self.data, (), self.candidate_terms, self.report_stage)

    def run(self, base_fit: Fit, known_models: Sequence[tuple[EffectTerm, ...]] = ()) -> PredictiveResult:
        """Return the selection that starts from ``base_fit`` without added effects.

        ``known_models`` are sets of terms that another selection has found; they compete as well.
        """
        self.report_stage("refitting with the error of the law as noise")
        base_fit = fit_hypothesis(self.data, base_fit.hypothesis, base_fit.x)
        base = self._assess_base(base_fit)
        candidates = screen_candidates(self.data, base_fit, self.candidate_terms)
        best = [*select_best_causes(candidates, MAX_SINGLES), *select_best_effects(candidates, MAX_SINGLES)]
        fitted = self._refit(base_fit, list({candidate.term: candidate for candidate in best}.values()))
        singles = {fit.hypothesis.terms[-1]: fit for fit in [*fitted, *self._refit_leading_forms(base_fit, fitted)]}
        fits: dict[frozenset[EffectTerm], Fit] = {frozenset([term]): fit for term, fit in singles.items()}
        for first, second, _ in screen_pairs(base_fit, candidates)[:MAX_PAIRS]:
            if first.term not in singles:
                fits[frozenset([first.term])] = singles[first.term] = self._refit(base_fit, [first])[0]
            self._extend(singles[first.term], [second.term], fits)
        # Where an effect is far from linear, its pairs are predicted only after it has been fitted.
        for single in select_best_fits(singles.values())[:N_EXTENDED_SINGLES]:
            self._extend_best(single, candidates, N_SECOND_TERMS, fits)
        pairs = sorted((fit for terms, fit in fits.items() if len(terms) == 2), key=lambda fit: fit.chi2)
        for pair in pairs[:N_EXTENDED_PAIRS]:
            self._extend_best(pair, candidates, MAX_TRIPLES // N_EXTENDED_PAIRS, fits)
        for terms in known_models:
            self._add_known(base_fit, terms, fits)
        self.report_stage("predicting conditions that are left out")
        models = sorted([base, *map(self.assess, fits.values())], key=rank_model)
        for model in models[:MAX_FINISHED]:
            models = self._add_simplified(base, model, models)
        # A single name that is refused refuses the sets that contain it, too.
        models = [
            self._admit_numbers(base, model) if rank < MAX_FINISHED or len(model.terms) == 1 else model
            for rank, model in enumerate(models)
        ]
        n_finished = 0
        while True:  # a model that is fitted to the end may reach a bound, or fall behind another one
            leading = list_nameable_models(models, len(self.folds))[:MAX_LEADING]
            unfinished = [model for model in leading if not (model.fit.converged or model.has_full_fit)]
            if not unfinished or n_finished >= MAX_FINISHED:
                break
            n_finished += 1
            fit = unfinished[0].fit
            full_fit = fit_hypothesis(self.data, fit.hypothesis, fit.x, fit.jacobian)
            finished = replace(self._admit_numbers(base, self.assess(full_fit)), has_full_fit=True)
            models = sorted([finished if model is unfinished[0] else model for model in models], key=rank_model)
            models = self._add_simplified(base, finished, models)
        return self._decide_refined(base, models)

    def _assess_base(self, base_fit: Fit) -> PredictiveModel:
        """Return the errors of ``base_fit`` without added effects; folds in which it diverges are left out from now on.

        With an infinite error, no gain and no share of it could be compared.
        """
        base = self.assess(base_fit)
        is_predicted = np.isfinite(base.errors)
        if is_predicted.all() or np.count_nonzero(is_predicted) < 2:  # intervals need two folds
            return base
        self.folds = [fold for fold, is_kept in zip(self.folds, is_predicted, strict=True) if is_kept]
        return self.assess(base_fit)

    def _refit(self, current: Fit, candidates: Sequence[Candidate]) -> list[Fit]:
        fits = self.search.refit_candidates(current, candidates, max_nfev_by_round=COMPARISON_MAX_NFEV)
        return [complete_fit(self.data, fit) for fit in fits]

    def _refit_leading_forms(self, base_fit: Fit, singles: Sequence[Fit]) -> list[Fit]:
        """Return fits of the forms that contain those of the leading ``singles``, and have a lower BIC.

        Causes may differ by less than the forms of one.
        """
        n, best_gain = self.data.n_effective, max((base_fit.chi2 - fit.chi2 for fit in singles), default=np.inf)
        leading = [fit for fit in singles if base_fit.chi2 - fit.chi2 >= MIN_LEADING_GAIN_FRACTION * best_gain]
        return [
            refit
            for fit in leading
            for refit in refit_with_containing_forms(self.data, fit, fit.hypothesis.terms[-1], is_fine=False)
            if refit.bic(n) < fit.bic(n)
        ]

    def _extend(self, current: Fit, terms: Sequence[EffectTerm], fits: dict[frozenset[EffectTerm], Fit]) -> None:
        """Add to ``fits`` the refits of ``current`` with each of ``terms``."""
        known = frozenset(current.hypothesis.terms)
        new = [term for term in terms if known | {term} not in fits]
        for candidate in screen_candidates(self.data, current, new) if new else ():
            fits[known | {candidate.term}] = self._refit(current, [candidate])[0]

    def _extend_best(
        self, current: Fit, candidates: Sequence[Candidate], count: int, fits: dict[frozenset[EffectTerm], Fit]
    ) -> None:
        """Add to ``fits`` the refits of ``current`` with each of the ``count`` terms that promise most beside it.

        ``candidates`` are those without added effects. They tell which causes are screened beside ``current``. Effects
        of the supply always are, because they are far from linear, and so are those without influence on their own.
        """
        used = current.hypothesis.terms
        unused = [term for term in self.candidate_terms if not any(is_same_cause(term, other) for other in used)]
        known = [candidate for candidate in candidates if candidate.term in unused]
        promising = select_best_causes(predict_gains(current, known), MAX_SCREENED_CAUSES)
        causes = {candidate.term.identity for candidate in promising}
        unpromising = {c.term for c in known if c.term.identity not in causes}
        terms = [t for t in unused if t not in unpromising or t.effect_definition.acts_in_supply]
        best = select_best_causes(screen_candidates(self.data, current, terms), count)
        self._extend(current, [candidate.term for candidate in best], fits)

    def _add_known(self, base_fit: Fit, terms: Sequence[EffectTerm], fits: dict[frozenset[EffectTerm], Fit]) -> None:
        current = base_fit
        for term in terms:
            key = frozenset([*current.hypothesis.terms, term])
            if key not in fits:
                self._extend(current, [term], fits)
            if key not in fits:  # the term has no influence
                return
            current = fits[key]

    def _add_simplified(
        self, base: PredictiveModel, model: PredictiveModel, models: Sequence[PredictiveModel]
    ) -> list[PredictiveModel]:
        """Return ``models``, best first, with the simpler forms of ``model`` where one of its forms is at a bound."""
        simpler = simplify_at_bound(self.data, model.fit)
        known = {frozenset(other.terms) for other in models}
        is_known = frozenset(simpler.hypothesis.terms) in known
        added = [] if is_known else [self._admit_numbers(base, self.assess(simpler))]
        return sorted([*models, *added], key=rank_model)

    def _admit_numbers(self, base: PredictiveModel, model: PredictiveModel) -> PredictiveModel:
        """Return ``model``; it may be named with numbers at the limit of their uncertainty if its terms need no limit.

        The error of the law moves numbers, too. The terms need no limit if all but :data:`MAX_NUMBER_SHARE` of their
        gain over ``base`` remains with these numbers as declared. A model that takes less than :data:`MIN_SHARE` of the
        error of ``base`` is not worth a name.
        """
        obstacle = find_naming_obstacle(self.data, model.fit, accepts_numbers_at_limit=True)
        gain = base.error - model.error
        if obstacle == model.obstacle or not MIN_SHARE * base.error <= gain < np.inf:
            return model
        declared = restore_declared_numbers(self.data, model.fit)
        if find_numbers_at_limit(declared):  # the registration of a walk
            return model
        lost = self.assess(declared).error - model.error
        return replace(model, obstacle=obstacle) if lost <= MAX_NUMBER_SHARE * gain else model

    def assess(self, fit: Fit) -> PredictiveModel:
        """Return the errors of prediction of ``fit``.

        The parameters without a fold follow from one bounded Gauss-Newton step from those of all conditions; the
        prediction of the fold is simulated.
        """
        if fit.has_diverged:
            n_folds = len(self.folds)
            return PredictiveModel(fit, np.full(n_folds, np.inf), np.tile(fit.x, (n_folds, 1)), DIVERGENCE_REASON)
        points = np.array([self._leave_out(fit, fold) for fold in self.folds]).reshape(len(self.folds), -1)
        experiments = self.data.experiments
        errors = []
        for x, fold in zip(points, self.folds, strict=True):
            left_out = [experiments[part.trial] for part in fold]
            setups = fit.hypothesis.build_setups(x, left_out)
            (readings,) = self.data.simulator.simulate([setups], left_out, may_diverge=True)
            residuals = {
                part.trial: {channel: series.value - simulated[channel] for channel, series in e.measured.items()}
                for part, e, simulated in zip(fold, left_out, readings, strict=True)
            }
            errors.append(self.compute_fold_error(fold, residuals))
        all_errors = np.array(errors)
        obstacle = find_naming_obstacle(self.data, fit) if np.isfinite(all_errors).all() else DIVERGENCE_REASON
        return PredictiveModel(fit, all_errors, points, obstacle)

    def compute_fold_error(self, fold: Sequence[FoldPart], residuals: Mapping[int, Mapping[str, Array]]) -> float:
        """Return the mean squared error of prediction of ``fold``, over that of the law.

        ``residuals`` are measured minus predicted [SI], by trial and channel.
        """
        squares = [
            float(np.mean(residual[selected] ** 2)) / self.data.noise[channel].std ** 2
            for part in fold
            for channel, residual in residuals[part.trial].items()
            if channel in self.data.noise
            and (selected := part.select(self.data.experiments[part.trial], channel)).any()
        ]
        return float(np.mean(squares)) if squares else 0.0

    def compute_fold_noise(self, fold: Sequence[FoldPart]) -> float:
        """Return what noise alone gives in :meth:`compute_fold_error`; a channel of unknown noise counts as exact."""
        fractions = [
            self.noise_std.get(channel, 0.0) ** 2 / self.data.noise[channel].std ** 2
            for part in fold
            for channel in self.data.experiments[part.trial].measured
            if channel in self.data.noise and part.select(self.data.experiments[part.trial], channel).any()
        ]
        return float(np.mean(fractions)) if fractions else 0.0

    def find_retained_rows(self, fold: Sequence[FoldPart], hypothesis: Hypothesis) -> Mask:
        """Return which weighted residuals of ``hypothesis``, priors among them, do not belong to ``fold``."""
        parts = {part.trial: part for part in fold}
        rows = [
            ~parts[index].select(e, channel)
            if index in parts
            else np.ones(len(e.measured[channel].time), dtype=np.bool_)
            for index, (e, weights) in enumerate(zip(self.data.experiments, self.data.weights, strict=True))
            for channel in weights
        ]
        return np.concatenate([*rows, np.ones(hypothesis.n_prior_parameters, dtype=np.bool_)])

    def _leave_out(self, fit: Fit, fold: Sequence[FoldPart]) -> Array:
        """Return the normalized parameters of ``fit`` without ``fold``, by one linear step in bounds.

        Without a penalty of its length, the step would move a parameter that the data do not determine to a bound,
        where the linear model does not hold and the prediction differs from that of a refit.
        """
        if not len(fit.x):
            return fit.x
        retained = self.find_retained_rows(fold, fit.hypothesis)
        lower, upper = fit.hypothesis.bounds()
        margin = 1e-9
        penalty = np.eye(len(fit.x)) / FOLD_STEP_DEVIATION
        step = lsq_linear(
            np.vstack([fit.jacobian[retained], penalty]),
            np.concatenate([-fit.weighted_residuals[retained], np.zeros(len(fit.x))]),
            (np.minimum(lower - fit.x, 0.0) - margin, np.maximum(upper - fit.x, 0.0) + margin),
        )
        return np.asarray(np.clip(fit.x + step.x, lower, upper))

    def _decide_refined(self, base: PredictiveModel, models: Sequence[PredictiveModel]) -> PredictiveResult:
        """Return the decision in which the chosen model is refined and, where it is named, each of its rivals is.

        A refined fit may reach a bound, so the choice is made again after each of them. Models are compared by their
        errors before that, because those of coarse and of refined fits differ where the data do not determine a shape.
        """
        while True:
            result = self._decide(base, models)
            compared = [result.chosen, *(result.rivals if result.share >= MIN_SHARE else ())]
            coarse = next((model for model in compared if model.terms and model.is_reproducible is None), None)
            if coarse is None:
                return result
            self.report_stage(f"refining {' and '.join(map(str, coarse.terms))}")
            fit, is_reproducible = check_convergence(self.data, coarse.fit, np.random.default_rng(self.seed))
            assessed = self._admit_numbers(base, self.assess(fit))
            refined = replace(assessed, errors=coarse.errors, is_reproducible=is_reproducible)
            models = [refined if model.fit is coarse.fit else model for model in models]
            models = self._add_simplified(base, refined, models)

    def _decide(self, base: PredictiveModel, models: Sequence[PredictiveModel]) -> PredictiveResult:
        noise = float(np.mean([self.compute_fold_noise(fold) for fold in self.folds]))
        models = refuse_redundant_terms(base, models, len(self.folds), noise)
        nameable = list_nameable_models(models, len(self.folds))
        chosen, stability = choose_stable_model(nameable, len(self.folds), noise) if nameable else (base, {})
        has_proxies = are_proxies(chosen, models, noise)
        while not has_proxies and (reduced := list_reduced_models(chosen, nameable, models, noise)):
            reduced_choice, reduced_stability = choose_stable_model(reduced, len(self.folds), noise)
            if compute_share(base, reduced_choice, noise) < MIN_SHARE:
                break
            chosen, stability = reduced_choice, reduced_stability
        max_error = chosen.error + compute_rival_margin(chosen.error, models, noise)
        rivals = [
            model
            for model in nameable
            if len(model.terms) == len(chosen.terms)
            and model.identities != chosen.identities
            and (is_as_good(model, chosen) or model.error <= max_error)
        ]
        distinct = {model.identities: model for model in reversed(rivals)}
        # Further names take numbers away from their limits, but so would what replaces these names.
        certain = (
            model
            for model in list_certain_models(chosen, models, noise)
            if not find_naming_obstacle(self.data, model.fit, accepts_numbers_at_limit=True)
            and compute_share(base, model, noise) >= MIN_SHARE
        )
        return PredictiveResult(
            base,
            chosen,
            sorted(distinct.values(), key=lambda model: model.error) if chosen.terms else [],
            models,
            stability,
            compute_share(base, chosen, noise),
            noise,
            self.fold_kind,
            len(self.folds),
            has_proxies,
            next(certain, None),
        )
