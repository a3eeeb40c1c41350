"""Selection of effects where the law is imperfect: by the prediction of conditions that a fit has not seen.

Where the best model stays above the noise between repeats, that noise no longer says what is significant: every
flexible effect takes a part of the error of the law, and any model fails on the last newton of another specimen. Then
three things change:

- *Weights*: the residual that the law leaves counts as noise, correlated over a whole condition. Repeats of a condition
  share it, so they add no information.
- *Search*: effects are screened in pairs, because two effects that do little alone may do much together; the best pairs
  are extended by a third effect.
- *Decision*: each condition is left out once, or each specimen where there are three or more. The simplest model whose
  error of prediction is within one standard error of the smallest is chosen (Breiman et al. 1984, *Classification and
  Regression Trees*, section 3.4.3).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit, WeightedData, fit_hypothesis
from klute_sim.diagnosis.noise.autocorrelation import Autocorrelation
from klute_sim.diagnosis.noise.repeats import Noise, Residuals, estimate_noise_from_residuals, group_repeats
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.naming import find_naming_obstacle
from klute_sim.diagnosis.selection.screening import Candidate, screen_candidates
from klute_sim.types import Array

MAX_SINGLES, MAX_PAIRS, MAX_TRIPLES = 6, 8, 4
"""Largest number of models with one, two and three terms that are fitted."""
N_EXTENDED_PAIRS = 2
"""Number of pairs that are extended by a third term."""
MIN_FOLDS = 3
"""Smallest number of conditions or specimens; of two, none can be left out and judged."""
MIN_SPECIMENS = 3
"""Number of specimens from which on specimens are left out instead of conditions."""
MIN_STABILITY = 0.8
"""Fraction of the refits in which a name must be chosen again."""
MIN_SHARE = 0.25
"""Share of the explainable error of prediction that names must take (assumed; less is not worth a name)."""
MIN_DETERMINANT = 0.05
"""Smallest determinant of a pair's cosines; below, the two effects are one to these data."""


@dataclass(frozen=True, eq=False)
class PredictiveModel:
    """A model and its errors of prediction."""

    fit: Fit
    """Fit to all conditions."""
    errors: Array
    """Mean squared error of prediction of each fold that is left out, over that of the law, (folds,)."""
    leave_one_out: Array
    """Normalized parameters of the fit without each fold, (folds, parameters)."""
    obstacle: str = ""
    """Why the model may not be named; '' if it may."""

    @property
    def terms(self) -> tuple[EffectTerm, ...]:
        """Added terms."""
        return self.fit.hypothesis.terms

    @property
    def identities(self) -> frozenset[tuple[str, str | None, str | None]]:
        """What the terms stand for."""
        return frozenset(term.identity for term in self.terms)

    @property
    def error(self) -> float:
        """Mean error of prediction."""
        return float(self.errors.mean())


@dataclass(frozen=True, eq=False)
class PredictiveResult:
    """Result of the selection."""

    base: PredictiveModel
    """Model without added effects."""
    chosen: PredictiveModel
    """Chosen model; :attr:`base` if no effect predicts better."""
    rivals: Sequence[PredictiveModel]
    """Models with other terms, as simple as the chosen one, that predict as well."""
    models: Sequence[PredictiveModel]
    """All models, best first."""
    stability: dict[EffectTerm, float]
    """Fraction of the refits in which each term of the chosen model is chosen again."""
    share: float
    """Share of the explainable error of prediction that the chosen model takes; noise cannot be explained."""
    fold_kind: str
    """What is left out: 'condition' or 'specimen'."""
    n_folds: int
    """Number of conditions or specimens."""

    @property
    def is_stable(self) -> bool:
        """Whether every name is chosen again in most refits."""
        return min(self.stability.values(), default=0.0) >= MIN_STABILITY


@dataclass(eq=False)
class PredictiveSelection:
    """A selection by predictions of left-out conditions."""

    data: WeightedData
    """All trials but the test trials, weighted by the error of the law (:func:`weight_by_law_error`)."""
    repeat_noise: dict[str, Noise]
    """Noise between repeats of each channel."""
    candidate_terms: Sequence[EffectTerm]
    """Terms that may be added."""
    report_stage: Callable[[str], None] = lambda stage: None
    """Receives a short description of the current stage."""
    folds: list[list[int]] = field(init=False)
    """Indices of the experiments of each fold."""
    fold_kind: str = field(init=False)
    """What a fold is: 'condition' or 'specimen'."""
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
        base = self.assess(base_fit)
        candidates = screen_candidates(self.data, base_fit, self.candidate_terms)
        singles = {
            fit.hypothesis.terms[-1]: fit
            for fit in self.search.refit_candidates(base_fit, _select_best(candidates, MAX_SINGLES))
        }
        fits: dict[frozenset[EffectTerm], Fit] = {frozenset([term]): fit for term, fit in singles.items()}
        for first, second in screen_pairs(base_fit, candidates)[:MAX_PAIRS]:
            if first.term not in singles:
                singles[first.term] = self.search.refit_candidates(base_fit, [first])[0]
            self._extend(singles[first.term], [second.term], fits)
        pairs = sorted((fit for terms, fit in fits.items() if len(terms) == 2), key=lambda fit: fit.chi2)
        for pair in pairs[:N_EXTENDED_PAIRS]:
            used = {term.identity for term in pair.hypothesis.terms}
            unused = [term for term in self.candidate_terms if term.identity not in used]
            third = _select_best(screen_candidates(self.data, pair, unused), MAX_TRIPLES // N_EXTENDED_PAIRS)
            self._extend(pair, [candidate.term for candidate in third], fits)
        for terms in known_models:
            self._add_known(base_fit, terms, fits)
        self.report_stage("predicting conditions that are left out")
        models = sorted([base, *map(self.assess, fits.values())], key=lambda model: (model.error, str(model.terms)))
        return self._decide(base, models)

    def _extend(self, current: Fit, terms: Sequence[EffectTerm], fits: dict[frozenset[EffectTerm], Fit]) -> None:
        """Add to ``fits`` the refits of ``current`` with each of ``terms``."""
        known = frozenset(current.hypothesis.terms)
        new = [term for term in terms if known | {term} not in fits]
        for candidate in screen_candidates(self.data, current, new) if new else ():
            fits[known | {candidate.term}] = self.search.refit_candidates(current, [candidate])[0]

    def _add_known(self, base_fit: Fit, terms: Sequence[EffectTerm], fits: dict[frozenset[EffectTerm], Fit]) -> None:
        current = base_fit
        for term in terms:
            key = frozenset([*current.hypothesis.terms, term])
            if key not in fits:
                self._extend(current, [term], fits)
            if key not in fits:  # the term has no influence
                return
            current = fits[key]

    def assess(self, fit: Fit) -> PredictiveModel:
        """Return the errors of prediction of ``fit``.

        The parameters without a fold follow from one bounded Gauss-Newton step from those of all conditions; the
        prediction of the fold is simulated.
        """
        points = np.array([self._leave_out(fit, fold) for fold in self.folds]).reshape(len(self.folds), -1)
        point_of_trial = {index: x for fold, x in zip(self.folds, points, strict=True) for index in fold}
        setups = [fit.hypothesis.build_setups(point_of_trial[k], [e])[0] for k, e in enumerate(self.data.experiments)]
        (readings,) = self.data.simulator.simulate([setups], self.data.experiments)
        squares = [
            [
                float(np.mean((e.measured[c].value - simulated[c]) ** 2)) / self.data.noise[c].std ** 2
                for c in e.measured
                if c in self.data.noise
            ]
            for e, simulated in zip(self.data.experiments, readings, strict=True)
        ]
        errors = np.array([np.mean([v for k in fold for v in squares[k]]) for fold in self.folds])
        return PredictiveModel(fit, errors, points, find_naming_obstacle(self.data, fit))

    def _leave_out(self, fit: Fit, fold: Sequence[int]) -> Array:
        """Return the normalized parameters of ``fit`` without the trials ``fold``, by one linear step in bounds."""
        if not len(fit.x):
            return fit.x
        retained = np.ones(len(fit.weighted_residuals), dtype=np.bool_)
        start = 0
        for index, weights in enumerate(self.data.weights):
            count = sum(len(self.data.experiments[index].measured[channel].time) for channel in weights)
            if index in fold:
                retained[start : start + count] = False
            start += count
        lower, upper = fit.hypothesis.bounds()
        margin = 1e-9
        step = lsq_linear(
            fit.jacobian[retained],
            -fit.weighted_residuals[retained],
            (np.minimum(lower - fit.x, 0.0) - margin, np.maximum(upper - fit.x, 0.0) + margin),
        )
        return np.asarray(np.clip(fit.x + step.x, lower, upper))

    def _decide(self, base: PredictiveModel, models: Sequence[PredictiveModel]) -> PredictiveResult:
        nameable = [model for model in models if not model.obstacle]
        chosen = choose_model(nameable, np.arange(len(self.folds)))
        again = [choose_model(nameable, np.delete(np.arange(len(self.folds)), k)) for k in range(len(self.folds))]
        stability = {
            term: float(np.mean([term.identity in model.identities for model in again])) for term in chosen.terms
        }
        rivals = [
            model
            for model in nameable
            if len(model.terms) == len(chosen.terms)
            and model.identities != chosen.identities
            and _is_as_good(model, chosen)
        ]
        distinct = {model.identities: model for model in reversed(rivals)}
        noise_fractions = [
            self.repeat_noise[channel].std ** 2 / law_error.std**2
            for channel, law_error in self.data.noise.items()
            if channel in self.repeat_noise
        ]
        noise = float(np.mean(noise_fractions)) if noise_fractions else 0.0
        explainable = base.error - noise
        share = (base.error - chosen.error) / explainable if explainable > 0.0 else 0.0
        return PredictiveResult(
            base,
            chosen,
            sorted(distinct.values(), key=lambda model: model.error) if chosen.terms else [],
            models,
            stability,
            share,
            self.fold_kind,
            len(self.folds),
        )


def divide_into_folds(experiments: Sequence[Experiment]) -> tuple[list[list[int]], str]:
    """Return the indices of the ``experiments`` of each fold, and what a fold is.

    Specimens are left out where there are :data:`MIN_SPECIMENS` or more, conditions (groups of repeats) otherwise.
    """
    specimens: dict[str, list[int]] = {}
    for index, e in enumerate(experiments):
        specimens.setdefault(e.specimen, []).append(index)
    if len(specimens) >= MIN_SPECIMENS:
        return list(specimens.values()), "specimen"
    return list(group_repeats(experiments).values()), "condition"


def weight_by_law_error(data: WeightedData, experiments: Sequence[Experiment], residuals: Residuals) -> WeightedData:
    """Return ``experiments`` with the ``residuals`` of the best model as noise.

    Repeats of a condition share the error of the law, so a condition counts once, however often it was repeated.
    Channels without noise in ``data`` do not count.
    """
    plain = [replace(e, noise_scale={}, input_error_scale={}) for e in experiments]
    noise = {}
    for channel, estimate in estimate_noise_from_residuals(plain, residuals).items():
        if channel not in data.noise:
            continue
        members = group_repeats([e for e in plain if channel in e.measured]).values()
        n_repeats = float(np.mean([len(group) for group in members]))
        noise[channel] = Noise(
            max(estimate.std, data.noise[channel].std),
            tuple(
                Autocorrelation(a.sampling_interval, a.correlation_time * n_repeats, a.n_samples)
                for a in estimate.autocorrelations
            ),
        )
    return WeightedData(data.simulator, plain, noise, data.cache)


def screen_pairs(base_fit: Fit, candidates: Sequence[Candidate]) -> list[tuple[Candidate, Candidate]]:
    """Return pairs of ``candidates``, largest predicted fall of chi squared first, the better one of each pair first.

    By linearisation at ``base_fit``: the sensitivities orthogonal to the fitted parameters are projected together. A
    pair of equal effects, and one in which a size would leave its bounds, is omitted.
    """
    directions = np.array([c.direction for c in candidates]).reshape(len(candidates), -1)
    cosines = directions @ directions.T
    projections = -directions @ base_fit.weighted_residuals
    best: dict[frozenset[tuple[str, str | None, str | None]], tuple[float, int, int]] = {}
    for i in range(len(candidates)):
        for k in range(i + 1, len(candidates)):
            first, second = candidates[i], candidates[k]
            determinant = 1.0 - cosines[i, k] ** 2
            if first.term.identity == second.term.identity or determinant < MIN_DETERMINANT:
                continue
            a = (projections[i] - cosines[i, k] * projections[k]) / determinant
            b = (projections[k] - cosines[i, k] * projections[i]) / determinant
            if not (_is_allowed(first, a) and _is_allowed(second, b)):
                continue
            gain = float(a * projections[i] + b * projections[k])
            key = frozenset([first.term.identity, second.term.identity])
            if key not in best or gain > best[key][0]:
                best[key] = gain, i, k
    ordered = sorted(best.values(), key=lambda entry: (-entry[0], entry[1:]))
    return [
        (candidates[i], candidates[k])
        if candidates[i].predicted_gain >= candidates[k].predicted_gain
        else (candidates[k], candidates[i])
        for _, i, k in ordered
    ]


def _is_allowed(candidate: Candidate, amount: float) -> bool:
    """Return whether ``amount`` along the candidate's direction has a sign that its first parameter may have."""
    parameter = candidate.term.parameters[0]
    if parameter.neutral is None or candidate.term.number:
        return True
    scale = parameter.typical - parameter.neutral
    room = parameter.upper - parameter.neutral if amount * scale > 0.0 else parameter.neutral - parameter.lower
    return room > 0.0


def _select_best(candidates: Sequence[Candidate], count: int) -> list[Candidate]:
    """Return the best form of each of the ``count`` best causes."""
    best: dict[tuple[str, str | None, str | None], Candidate] = {}
    for candidate in candidates:
        if candidate.predicted_gain > 0.0:
            best.setdefault(candidate.term.identity, candidate)
    return list(best.values())[:count]


def choose_model(models: Sequence[PredictiveModel], folds: NDArray[np.intp]) -> PredictiveModel:
    """Return the simplest of ``models`` within one standard error of the best prediction of ``folds``.

    The standard error is that of the differences between the two models over the folds, which are paired.
    """
    best = min(models, key=lambda model: (float(model.errors[folds].mean()), str(model.terms)))
    good = [model for model in models if _is_as_good(model, best, folds)]
    return min(good, key=lambda model: (len(model.terms), float(model.errors[folds].mean()), str(model.terms)))


def _is_as_good(model: PredictiveModel, best: PredictiveModel, folds: NDArray[np.intp] | None = None) -> bool:
    differences = model.errors - best.errors
    if folds is not None:
        differences = differences[folds]
    standard_error = float(differences.std(ddof=1)) / np.sqrt(len(differences)) if len(differences) > 1 else 0.0
    return float(differences.mean()) <= standard_error
