"""Models that are judged by what they predict of trials that were left out: folds, errors, and the choice."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Identity
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.number_error import EFFECTS
from klute_sim.diagnosis.noise.repeats import group_repeats
from klute_sim.diagnosis.selection.naming import has_impossible_instrument
from klute_sim.types import Array, Mask

MIN_CONDITIONS, MIN_SPECIMENS = 3, 3
"""Numbers of conditions and of specimens from which on these are left out (assumed)."""
N_PARTS = 6
"""Number of parts of each trial where there are fewer conditions."""
N_BLOCKS = 60
"""Number of blocks of a trial whose mean pressures measure how much happens in it."""
MIN_TERM_SHARE = 0.02
"""Share of the largest error of prediction that a further term must take (assumed; less is of no use to anybody)."""
MIN_PARTIAL_SHARE = 0.25
"""Share that each further term must take of the error that the terms before leave above the noise (assumed: in 17
simulated laws with known errors, the best wrong term beside the true one took 0 to 0.40, in the median 0.09; the ends
of measured muscles take 0.33 beside a passive tension)."""
MIN_FAULT_SHARE = 0.5
"""The same share of a further term that is a wrong number or a fault of an instrument (assumed: unlike an effect, it
contradicts what was measured or calibrated. In three recorded benchmark verdicts such a term took 0.31, 0.32 and 0.52
beside an effect, and was wrong each time)."""
MAX_ERROR_RATIO = 4.0
"""Largest squared error of prediction, over that of another model, of a model that is as good although it predicts
hardly any fold better (assumed: where a model of an imperfect law is better by so much, this is not chance)."""
MAX_GAIN_FRACTION = 0.1
"""Part of what such a model loses in the other folds that it may gain in some (assumed)."""
MIN_STABILITY = 0.8
"""Fraction of the selections without one fold in which an effect must be chosen again."""
MAX_RIVAL_RATIO = 1.1
"""Error of prediction above the noise of other names over that of the chosen ones, up to which they predict as well
although the difference exceeds its standard error (assumed: an imperfect law differs by as much between forms)."""


class FoldPart(NamedTuple):
    """Part of a trial that a fold leaves out."""

    trial: int
    """Index of the trial."""
    start: float = 0.0
    """Beginning of the part, as a fraction of the trial."""
    end: float = 1.0
    """End of the part; at 1 the last samples belong to it."""

    def select(self, experiment: Experiment, channel: str) -> Mask:
        """Return which samples of ``channel`` belong to the part, (samples,)."""
        phase = (experiment.measured[channel].time - experiment.start_time) / experiment.duration
        return np.asarray((phase >= self.start) & ((phase < self.end) | (self.end >= 1.0)))


@dataclass(frozen=True, eq=False)
class PredictiveModel:
    """A model and its errors of prediction."""

    fit: Fit
    """Fit to all conditions."""
    errors: Array
    """Mean squared error of prediction of each fold that is left out, over that of the law, (folds,)."""
    parameters_without_fold: Array
    """Normalized parameters of the fit without each fold, (folds, parameters)."""
    obstacle: str = ""
    """Why the model may not be named; '' if it may."""
    is_reproducible: bool | None = None
    """Whether a restart of the refined fit agrees with it; None for a fit that was not refined."""
    has_full_fit: bool = False
    """Whether the fit had all the evaluations that a fit may have, instead of a few for the comparison."""

    @property
    def terms(self) -> tuple[EffectTerm, ...]:
        """Added terms."""
        return self.fit.hypothesis.terms

    @property
    def identities(self) -> frozenset[Identity]:
        """What the terms stand for."""
        return frozenset(term.identity for term in self.terms)

    @property
    def error(self) -> float:
        """Mean squared error of prediction."""
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
    """Fraction of the selections without one fold in which each term of the chosen model is chosen again."""
    share: float
    """Share of the explainable error of prediction that the chosen model takes, at most 1; noise is not explained."""
    noise: float
    """Squared error of prediction that the noise between repeats alone makes; without repeats, that of fast noise."""
    fold_kind: str
    """What is left out: 'condition', 'specimen' or 'part'."""
    n_folds: int
    """Number of conditions, specimens or parts."""
    has_proxies: bool = False
    """Whether the terms of the chosen model stand in for what may not be named (:func:`are_proxies`)."""
    certain: PredictiveModel | None = None
    """Model with those names of the chosen one that no other model replaces, with numbers at their limits (None: the
    chosen model has only such names, or they explain too little alone)."""

    @property
    def alternatives(self) -> list[PredictiveModel]:
        """Models that are as likely as the chosen one."""
        return [*self.rivals, *(() if self.certain is None else (self.certain,))]

    @property
    def is_stable(self) -> bool:
        """Whether every effect is chosen again in most selections without one fold."""
        return min(self.stability.values(), default=0.0) >= MIN_STABILITY


def divide_into_folds(experiments: Sequence[Experiment]) -> tuple[list[list[FoldPart]], str]:
    """Return what each fold of ``experiments`` leaves out, and what a fold is.

    Specimens are left out where there are :data:`MIN_SPECIMENS` or more, conditions (groups of repeats) where there are
    :data:`MIN_CONDITIONS` or more, and :data:`N_PARTS` contiguous parts of every trial otherwise: all repeats of a
    condition have the same part of it left out.
    """
    specimens: dict[str, list[FoldPart]] = {}
    for index, e in enumerate(experiments):
        specimens.setdefault(e.specimen, []).append(FoldPart(index))
    if len(specimens) >= MIN_SPECIMENS:
        return list(specimens.values()), "specimen"
    conditions = group_repeats(experiments).values()
    if len(conditions) >= MIN_CONDITIONS:
        return [[FoldPart(index) for index in members] for members in conditions], "condition"
    edges = {index: _divide_condition([experiments[k] for k in members]) for members in conditions for index in members}
    return [
        [FoldPart(index, start, end) for index, trial_edges in edges.items() for start, end in [trial_edges[part]]]
        for part in range(N_PARTS)
    ], "part"


def has_several_specimens(experiments: Sequence[Experiment]) -> bool:
    """Return whether ``experiments`` tested several specimens, which may differ from each other."""
    return len({e.specimen for e in experiments}) > 1


def _divide_condition(repeats: Sequence[Experiment]) -> list[tuple[float, float]]:
    """Return start and end of each part of ``repeats``, as fractions of a trial.

    Parts last equally long. Where only the pressure was measured, half of the measure is the change of the pressure: a
    filling is over in a fraction of the trial, and if it all lay in one part, the difference between two models would
    be as large as its standard error whatever its size.
    """
    edges = np.linspace(0.0, 1.0, N_PARTS + 1)
    if all(e.measured.keys() == {"pressure"} for e in repeats):
        phases = np.linspace(0.0, 1.0, N_BLOCKS + 1)
        means = np.mean([_average_blocks(e, phases) for e in repeats], axis=0)
        change = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(means))), [0.0]])
        change[-1] = change[-2]
        if change[-1] > 0.0:
            edges = np.interp(edges, 0.5 * (phases + change / change[-1]), phases)
    return [(float(start), float(end)) for start, end in pairwise(edges)]


def _average_blocks(experiment: Experiment, phases: Array) -> Array:
    """Return the mean pressure [Pa] of ``experiment`` between each two of ``phases`` (fractions of the trial)."""
    series = experiment.measured["pressure"]
    times = experiment.start_time + phases * experiment.duration
    fine = np.linspace(times[:-1], times[1:], 10)
    means: Array = np.interp(fine, series.time, series.value).mean(axis=0)
    return means


def compare_errors(model: PredictiveModel, base: PredictiveModel) -> float | None:
    """Return the error of ``model`` over that of ``base``; None where a simulation of one of them diverges."""
    return model.error / base.error if np.isfinite([model.error, base.error]).all() else None


def compute_share(base: PredictiveModel, chosen: PredictiveModel, noise: float) -> float:
    """Return the share of the error of ``base`` above ``noise`` that ``chosen`` takes, at most 1.

    It would be more where ``chosen`` predicts better than ``noise`` allows, which then is estimated too large. Folds in
    which ``base`` diverges have no finite error and do not show the size of an effect.
    """
    is_predicted = np.isfinite(base.errors)
    if not is_predicted.any():
        return 0.0
    error, remaining = (float(model.errors[is_predicted].mean()) for model in (base, chosen))
    return min(1.0, (error - remaining) / (error - noise)) if error > noise else 0.0


def rank_model(model: PredictiveModel) -> tuple[float, str]:
    """Return the key that sorts models by their error, and by name where errors are equal."""
    return model.error, str(model.terms)


def count_faults(model: PredictiveModel) -> int:
    """Return the number of terms of ``model`` that are wrong numbers or faults of instruments.

    A number of a declared effect is as good as the law of this effect, so it counts as an effect.
    """
    return sum(
        not term.number.startswith(EFFECTS) if term.number else term.effect_definition.kind == "instrument"
        for term in model.terms
    )


def choose_model(models: Sequence[PredictiveModel], folds: NDArray[np.intp], noise: float = 0.0) -> PredictiveModel:
    """Return the simplest of ``models`` that no larger one predicts decisively better.

    A larger model is decisively better only if three conditions hold:

    - the best prediction of ``folds`` is better by more than one standard error, that of the differences between the
      two models over the folds, which are paired;
    - the best prediction takes at least :data:`MIN_TERM_SHARE` more of the error of the model without terms;
    - a larger model takes, with each of its further terms, at least :data:`MIN_PARTIAL_SHARE` of what the terms before
      leave above ``noise`` (partial coefficients of determination), :data:`MIN_FAULT_SHARE` with a wrong number or a
      fault of an instrument. The error of the law is the same in all specimens, so any flexible term takes a part of
      it, in trials that were left out as well.

    The last condition does not protect the model without terms: how much names must take of its error is decided
    elsewhere.
    """
    errors = {id(model): float(model.errors[folds].mean()) for model in models}

    def rank(model: PredictiveModel) -> tuple[float, str]:
        return errors[id(model)], str(model.terms)

    def reduces_error_enough(larger: PredictiveModel, model: PredictiveModel) -> bool:
        n_further = len(larger.terms) - len(model.terms)
        n_faults = min(n_further, max(0, count_faults(larger) - count_faults(model)))
        left = (1.0 - MIN_PARTIAL_SHARE) ** (n_further - n_faults) * (1.0 - MIN_FAULT_SHARE) ** n_faults
        return n_further > 0 and errors[id(larger)] - noise <= left * (errors[id(model)] - noise)

    best = min(models, key=rank)
    # Other models may predict far worse than the one without terms, and say nothing of what there is to explain.
    unexplained = [errors[id(model)] for model in models if not model.terms]
    margin = MIN_TERM_SHARE * (max(unexplained or errors.values()) - errors[id(best)])
    good = [
        model
        for model in models
        if errors[id(model)] <= errors[id(best)] + margin
        or is_as_good(model, best, folds)
        or (model.terms and not any(reduces_error_enough(larger, model) for larger in models))
    ]
    return min(good, key=lambda model: (len(model.terms), *rank(model)))


def refuse_redundant_terms(
    base: PredictiveModel, models: Sequence[PredictiveModel], n_folds: int, noise: float = 0.0
) -> list[PredictiveModel]:
    """Return ``models``; those that may be named only because of a redundant term get an obstacle.

    Such a model contains a smaller one, of equal forms, that would be chosen before it and has an obstacle, such as a
    parameter at its bound. A further term always moves that parameter a little; that is no evidence for the term.
    """
    folds = np.arange(n_folds)
    smaller = [model for model in models if model.terms and model.obstacle and np.isfinite(model.errors).all()]
    checked = []
    for model in models:
        nested = () if model.obstacle else (m for m in smaller if set(m.terms) < set(model.terms))
        preferred = next((m for m in nested if choose_model([base, m, model], folds, noise) is m), None)
        if preferred is not None:
            names = " and ".join(map(str, preferred.terms))
            obstacle = f"{names} alone would be preferred, but {preferred.obstacle}"
            checked.append(replace(model, obstacle=obstacle))
        else:
            checked.append(model)
    return checked


def list_nameable_models(models: Sequence[PredictiveModel], n_folds: int) -> list[PredictiveModel]:
    """Return those of ``models`` that may be named: without an obstacle, and with fewer terms than folds.

    The error of an imperfect law is about one value per condition, and ``n`` terms explain any ``n`` values.
    """
    return [model for model in models if not model.obstacle and len(model.terms) < n_folds]


def are_proxies(chosen: PredictiveModel, models: Sequence[PredictiveModel], noise: float = 0.0) -> bool:
    """Return whether each term of a ``chosen`` set stands in for something that may not be named.

    Models of ``models`` without such a term predict as well, but have an obstacle, such as a parameter at its bound:
    what is missing resembles both, so neither is its name. A fault that no instrument has resembles nothing. A single
    name is judged by its rivals alone.
    """
    refused = [model for model in models if model.terms and model.obstacle and not has_impossible_instrument(model.fit)]
    margin = compute_rival_margin(chosen.error, models, noise)
    return len(chosen.terms) > 1 and list_replaced_names(chosen, refused, margin) == chosen.identities


def list_reduced_models(
    chosen: PredictiveModel,
    nameable: Sequence[PredictiveModel],
    models: Sequence[PredictiveModel],
    noise: float = 0.0,
) -> list[PredictiveModel]:
    """Return those of ``nameable`` with some of the names of ``chosen``, without one that another model replaces.

    A larger or refused one of ``models`` counts, too. The error of an imperfect law resembles many things, so a further
    name that something else can replace is none.
    """
    replaced = list_replaced_names(chosen, models, compute_rival_margin(chosen.error, models, noise))
    return [m for m in nameable if m.terms and m.identities < chosen.identities and replaced - m.identities]


def list_certain_models(
    chosen: PredictiveModel, models: Sequence[PredictiveModel], noise: float = 0.0
) -> list[PredictiveModel]:
    """Return the refused ones of ``models`` with exactly the names of ``chosen`` that no other model replaces.

    The list is empty where all names of ``chosen`` are replaced, or none.
    """
    margin = compute_rival_margin(chosen.error, models, noise)
    certain = chosen.identities - list_replaced_names(chosen, models, margin)
    if not certain or certain == chosen.identities:
        return []
    return [model for model in models if model.obstacle and model.identities == certain]


def list_replaced_names(
    chosen: PredictiveModel, models: Sequence[PredictiveModel], margin: float
) -> frozenset[Identity]:
    """Return the names of ``chosen`` without which one of ``models`` predicts as well, but for ``margin``."""
    as_good = [model.identities for model in models if model.error <= chosen.error + margin]
    return frozenset(name for name in chosen.identities if any(name not in names for names in as_good))


def choose_stable_model(
    models: Sequence[PredictiveModel], n_folds: int, noise: float = 0.0
) -> tuple[PredictiveModel, dict[EffectTerm, float]]:
    """Return the choice of all folds, and in what fraction of the choices without one fold each of its terms returns.

    Another set of as many terms that predicts the other folds equally well is a rival; it makes no term unstable. If
    only some terms return in most choices, the choice is made again among models of these terms alone: what a single
    fold decides shall not withhold a name that all of them support.
    """
    folds = np.arange(n_folds)
    chosen = choose_model(models, folds, noise)
    choices = [(choose_model(models, rest, noise), rest) for rest in (np.delete(folds, k) for k in range(n_folds))]

    def choose_again(model: PredictiveModel, other: PredictiveModel, rest: NDArray[np.intp]) -> PredictiveModel:
        error, other_error = (float(m.errors[rest].mean()) for m in (model, other))
        is_rival = error <= other_error + compute_rival_margin(other_error, models, noise)
        return model if is_rival and len(model.terms) == len(other.terms) else other

    def measure_stability(model: PredictiveModel) -> dict[EffectTerm, float]:
        again = [choose_again(model, other, rest).identities for other, rest in choices]
        return {term: float(np.mean([term.identity in names for names in again])) for term in model.terms}

    stability = measure_stability(chosen)
    stable = frozenset(term.identity for term, fraction in stability.items() if fraction >= MIN_STABILITY)
    supported = [model for model in models if model.terms and model.identities <= stable]
    if stable and stable != chosen.identities and supported:
        chosen = choose_model(supported, folds, noise)
        stability = measure_stability(chosen)
    return chosen, stability


def compute_rival_margin(best_error: float, models: Sequence[PredictiveModel], noise: float) -> float:
    """Return how much larger the error of a rival may be than ``best_error``, whatever the standard error.

    :data:`MAX_RIVAL_RATIO` is that of the errors above ``noise``. Less than :data:`MIN_TERM_SHARE` of what can be
    explained, by that of ``models`` without terms, is no difference; nor does noise make a margin larger.
    """
    relative = MAX_RIVAL_RATIO - 1.0
    explainable = max((model.error for model in models if not model.terms), default=np.inf) - noise
    return min(relative * best_error, max(0.0, relative * (best_error - noise), MIN_TERM_SHARE * explainable))


def is_as_good(model: PredictiveModel, best: PredictiveModel, folds: NDArray[np.intp] | None = None) -> bool:
    """Return whether ``model`` predicts ``folds`` (all by default) within one standard error as well as ``best``.

    Where one fold shows nearly all of an effect, the standard error is as large as the difference, whatever its size.
    So a model that predicts hardly any fold better is not as good above :data:`MAX_ERROR_RATIO` times the error.
    """
    selected = np.arange(len(best.errors)) if folds is None else folds
    errors, best_errors = model.errors[selected], best.errors[selected]
    differences = errors - best_errors
    losses, gains = np.maximum(differences, 0.0).sum(), np.maximum(-differences, 0.0).sum()
    if errors.sum() > MAX_ERROR_RATIO * best_errors.sum() and gains <= MAX_GAIN_FRACTION * losses:
        return False
    standard_error = float(differences.std(ddof=1)) / np.sqrt(len(differences)) if len(differences) > 1 else 0.0
    return float(differences.mean()) <= standard_error
