"""Decision where every model stays above the noise between repeats, because the law itself is imperfect.

See :mod:`klute_sim.diagnosis.selection.predictive_selection` for the selection.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.stats import t as student_t

from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.fitting.confidence_intervals import convert_reciprocal_errors
from klute_sim.diagnosis.fitting.law_error_weights import weight_by_law_error
from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.fitting.systematic_error import CONFIDENCE_LEVEL
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.repeats import Residuals
from klute_sim.diagnosis.noise.trial_noise import estimate_fast_noise
from klute_sim.diagnosis.result import Verdict
from klute_sim.diagnosis.selection.candidates import list_further_terms
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.naming import describe_coincidence, find_naming_obstacle
from klute_sim.diagnosis.selection.predictive_model import (
    MAX_RIVAL_RATIO,
    MIN_STABILITY,
    PredictiveModel,
    PredictiveResult,
    compare_errors,
    count_faults,
)
from klute_sim.diagnosis.selection.predictive_selection import (
    MIN_SHARE,
    PredictiveSelection,
)

FOLD_WORDS = {"condition": "condition", "specimen": "specimen", "part": "part of the trials"}
"""What a fold leaves out -> words."""
MAX_ADEQUATE_MODELS = 3
"""Number of models that are tested for reaching the noise between repeats."""

MIN_EXPLAINED_RMS_RATIO = 1.0
"""Smallest RMS that names explain in some channel, over the noise (assumed: where no model reaches the
noise, the law is off by about as much, and any effect that resembles its error explains it)."""


class ImperfectLawDecision(NamedTuple):
    """What the selection by prediction decides."""

    verdict: Verdict
    """Verdict."""
    reasons: list[str]
    """Sentences that explain it."""


def select_by_prediction(
    search: ForwardSelection,
    experiments: Sequence[Experiment],
    best_fit: Fit,
    report_stage: Callable[[str], None],
    seed: int = 0,
) -> tuple[PredictiveSelection, PredictiveResult]:
    """Return the selection by prediction of the seen ``experiments``, all but those of the test.

    ``best_fit`` is the best model of the selection by significance; its residuals measure the error of the law.
    ``seed`` is that of restarted fits.
    """
    data, seen_fits = search.data, (search.history[0].initial_fit, best_fit)
    seen = data.with_experiments([e for e in experiments if e.use != "test" and e.measured.keys() & data.noise])
    seen, residuals = _drop_diverging_trials(seen, seen_fits)
    weighted = weight_by_law_error(data, seen.experiments, residuals)
    noise_std = {channel: noise.std for channel, noise in data.noise.items()}
    if not search.has_repeats:  # the noise of the data is the misfit itself
        noise_std = estimate_fast_noise(seen.experiments, residuals)
    # With the error of the law as noise, numbers at the limits of their declared uncertainties may move away from them.
    open_terms = {term for fit in seen_fits for term in list_further_terms(search.candidate_terms, fit)}
    candidates = [term for term in search.candidate_terms if term in open_terms]
    selection = PredictiveSelection(weighted, noise_std, candidates, report_stage, seed)
    known = [fit.hypothesis.terms for step in search.history for fit in step.refits[:1] if step.added_term]
    base = replace(best_fit.hypothesis, terms=())
    base_fit = fit_hypothesis(weighted, base)
    return selection, selection.run(base_fit, [best_fit.hypothesis.terms, *known])


def _drop_diverging_trials(data: WeightedData, fits: Sequence[Fit]) -> tuple[WeightedData, Residuals]:
    """Return ``data`` without trials that diverge with one of ``fits``, and the residuals of the last one.

    Such trials are for validation: fits do not diverge in the others.
    """
    residuals = [data.compute_residuals(fit.hypothesis, [fit.x], may_diverge=True)[0] for fit in fits]
    finite = [
        index
        for index, rows in enumerate(zip(*residuals, strict=True))
        if all(np.isfinite(values).all() for row in rows for values in row.values())
    ]
    return data.with_experiments([data.experiments[i] for i in finite]), [residuals[-1][i] for i in finite]


def find_adequate_model(
    search: ForwardSelection, base_fit: Fit, final_fit: Fit, selection: PredictiveSelection, result: PredictiveResult
) -> Fit | None:
    """Return a model of the ``result`` of ``selection`` that reaches the noise between repeats and passes validation.

    None if there is no such model. One-at-a-time search passes by a pair of which neither effect explains much alone. A
    set that predictions refuse because a part of it predicts nearly as well may be the only one that reaches the noise.
    More names are no answer where the ``final_fit`` of that search reaches the noise, too, is better, and may not be
    named because of a value at its bound: the missing effect resembles it.
    """
    n, n_names = search.data.n_effective, len(final_fit.hypothesis.terms)
    max_bic = np.inf if search.has_misfit(final_fit) else final_fit.bic(n) + search.bic_threshold
    by_bic = sorted(
        (model for model in result.models if model.terms and not find_naming_obstacle(selection.data, model.fit)),
        key=lambda model: model.fit.bic(selection.data.n_effective),
    )
    for model in by_bic[:MAX_ADEQUATE_MODELS]:
        refit = search.complete(fit_hypothesis(search.data, model.fit.hypothesis, model.fit.x))
        if search.has_misfit(refit) or find_naming_obstacle(search.data, refit):
            continue
        if len(refit.hypothesis.terms) > n_names and refit.bic(n) > max_bic:
            continue
        if not search.rejection_reason(base_fit, refit, search.compute_validation_gains(base_fit, refit)):
            return refit
    return None


def compute_explained_rms_ratio(selection: PredictiveSelection, result: PredictiveResult) -> float:
    """Return the RMS that the chosen model explains beyond the base model, over the noise of the selection.

    The largest of all channels counts; infinite where no noise is known.
    """
    fractions = []
    for channel, std in selection.noise_std.items():
        before, after = (
            float(np.mean(np.concatenate([row[channel] for row in model.fit.residuals if channel in row]) ** 2))
            for model in (result.base, result.chosen)
        )
        fractions.append(np.sqrt(max(0.0, before - after)) / std)
    return float(max(fractions, default=np.inf))


def decide_verdict(
    result: PredictiveResult,
    *,
    explained_rms_ratio: float = np.inf,
    has_repeats: bool = True,
    has_exact_inputs: bool = True,
    has_one_specimen: bool = True,
) -> ImperfectLawDecision:
    """Return the verdict on ``result`` and its reasons.

    Without repeats an unexplained remainder may be noise, so the data are insufficient where nothing is named.
    ``explained_rms_ratio`` is that of :func:`compute_explained_rms_ratio`.
    ``has_exact_inputs`` says whether the rig does what was logged; a replay of gait simplifies limb and foot.
    """
    unexplained: Verdict = "unexplained" if has_repeats else "insufficient-data"
    chosen, kind = result.chosen, FOLD_WORDS[result.fold_kind]
    cause = (
        "No model that can be named reaches the noise between repeats"
        if has_repeats
        else "Without repeats the noise is unknown"
    )
    law = f"{cause}, so models are judged by the prediction of each {kind} from the others ({result.n_folds} of them)."
    if not chosen.terms:
        return ImperfectLawDecision(unexplained, [law, _explain_no_choice(result)])
    names = _list_terms(chosen)
    stability = ", ".join(f"{term} in {100 * value:.0f} %" for term, value in result.stability.items())
    reasons = [
        law,
        f"{names} {'explain' if len(chosen.terms) > 1 else 'explains'} {100 * result.share:.0f} % of the squared error "
        f"of prediction above the noise; of the selections that leave out one {kind}, these choose it: {stability}.",
    ]
    if result.share >= 1.0 and has_repeats:
        reasons.append(
            "The predictions are closer to the data than the noise between repeats, so this noise is estimated too "
            "large, and nothing is known of what remains."
        )
    if result.share < MIN_SHARE:
        reasons.append(
            f"A share of {100 * result.share:.0f} % is not enough for a name; {100 * MIN_SHARE:.0f} % are required."
        )
        return ImperfectLawDecision(unexplained, reasons)
    if explained_rms_ratio < MIN_EXPLAINED_RMS_RATIO:
        reasons.append(
            f"In the channel that changes most, this is an RMS of {explained_rms_ratio:.2f} times the noise between "
            f"{'repeats' if has_repeats else 'samples'}; {MIN_EXPLAINED_RMS_RATIO:.2f} times are required: the error "
            "of the law is about as large."
        )
        return ImperfectLawDecision(unexplained, reasons)
    if result.has_proxies:
        reasons.append(
            f"Models without {' or without '.join(map(str, chosen.terms))} predict as well, but may not be "
            "named: something else is missing that resembles them, and they are proxies."
        )
        return ImperfectLawDecision(unexplained, reasons)
    coincidence = describe_coincidence(chosen.terms)
    if coincidence:
        return ImperfectLawDecision(unexplained, [*reasons, coincidence])
    leaves_only_noise = has_repeats and has_exact_inputs and has_one_specimen  # if a fault is all that is wrong
    if leaves_only_noise and all(count_faults(model) == len(model.terms) for model in (chosen, *result.rivals)):
        reasons.append(
            "A wrong number or a fault of an instrument alone would leave nothing in trials of one specimen, and this "
            "leaves a misfit. One effect that is not in the catalogue may explain both, so it is a proxy; measure the "
            "number, or calibrate the instrument."
        )
        return ImperfectLawDecision(unexplained, reasons)
    if result.rivals:
        reasons.append(
            f"{_list_rivals(result)} would predict as well: the difference is less than one standard error, or than "
            f"{100 * (MAX_RIVAL_RATIO - 1):.0f} % of the error above the noise."
        )
    if result.certain is not None:
        further = " and ".join(str(t) for t in chosen.terms if t.identity not in result.certain.identities)
        reasons.append(
            f"Other models predict as well without {further}, so this may stand for the error of the law. "
            f"{_list_terms(result.certain)} alone is as likely, although it needs numbers at the limits of their "
            "uncertainties."
        )
    if result.alternatives:
        return ImperfectLawDecision("indistinguishable", reasons)
    if not result.is_stable:
        reasons.append(f"An effect must be chosen in {100 * MIN_STABILITY:.0f} % of these selections.")
        return ImperfectLawDecision(unexplained, reasons)
    return ImperfectLawDecision("identified-in-part", reasons)


def compute_jackknife_intervals(model: PredictiveModel) -> list[tuple[float, float]]:
    """Return the 95 % confidence interval of each parameter in its own unit, from the refits without one fold.

    Jackknife variance ``(G - 1)/G sum (x_g - mean)^2`` with Student's t of G - 1 degrees of freedom (Efron & Tibshirani
    1993, section 11.5), but not less than the variance from the curvature of chi squared with the error of the law as
    noise: a parameter that no fold determines does not move.
    """
    fit, points = model.fit, model.parameters_without_fold
    n_folds = len(points)
    if not len(fit.x):
        return []
    jackknife = (n_folds - 1) / n_folds * ((points - points.mean(axis=0)) ** 2).sum(axis=0)
    curvature = np.maximum(0.0, np.diag(np.linalg.pinv(fit.jacobian.T @ fit.jacobian)))
    half_widths = student_t.ppf(0.5 + 0.5 * CONFIDENCE_LEVEL, n_folds - 1) * np.sqrt(np.maximum(jackknife, curvature))
    half_widths[~np.any(fit.jacobian, axis=0)] = np.inf  # a parameter without influence may have any value
    distances = np.stack([half_widths, half_widths], axis=1)
    for k, both in convert_reciprocal_errors(fit, half_widths).items():
        distances[k] = both
    lower, upper = fit.hypothesis.bounds()
    ends = zip(
        fit.hypothesis.parameters,
        np.clip(fit.x - distances[:, 0], lower, upper),
        np.clip(fit.x + distances[:, 1], lower, upper),
        strict=True,
    )
    intervals = [
        (parameter.denormalize(float(low)), parameter.denormalize(float(high))) for parameter, low, high in ends
    ]
    return [(min(pair), max(pair)) for pair in intervals]


def _explain_no_choice(result: PredictiveResult) -> str:
    """Return why ``result`` chooses no effect."""
    best = next((model for model in result.models if model.terms), None)
    if best is None:
        return "No effect improves the predictions."
    ratio = compare_errors(best, result.base)
    change = "" if ratio is None else f" ({100.0 * (ratio - 1.0):+.0f} % of the squared error)"
    if best.obstacle:
        return (
            f"No effect that may be named improves the predictions enough. {_list_terms(best)} would predict best"
            f"{change}, but may not be named: {best.obstacle}."
        )
    return (
        f"No effect improves the predictions enough. The best, {_list_terms(best)}{change}, is better by less than one "
        "standard error, or fewer effects predict as well."
    )


def _list_rivals(result: PredictiveResult) -> str:
    """Return the rivals of the chosen model; what all of them share with it is said once."""
    models = [set(model.identities) for model in (result.chosen, *result.rivals)]
    shared = set.intersection(*models)
    if not shared or any(model == shared for model in models):
        return " or ".join(map(_list_terms, result.rivals))
    common = " and ".join(str(term) for term in result.chosen.terms if term.identity in shared)
    rest = [[str(term) for term in model.terms if term.identity not in shared] for model in result.rivals]
    return f"Beside {common}, {' or '.join(' with '.join(terms) for terms in rest)}"


def _list_terms(model: PredictiveModel) -> str:
    return " and ".join(map(str, model.terms)) or "no effect"
