"""The model that a diagnosis ends with: one that reaches the noise, a named part of the misfit, or proxies."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from klute_sim.diagnosis.discrepancy.data_driven_comparison import compare_with_data_driven_models
from klute_sim.diagnosis.discrepancy.data_driven_rival import (
    compute_bic_difference,
    compute_decisive_threshold,
    compute_refusal_threshold,
    find_data_driven_rival,
    find_decisive_term,
    find_rival_of_number,
)
from klute_sim.diagnosis.discrepancy.sparse_regression import add_data_driven_term
from klute_sim.diagnosis.fitting.confidence_intervals import compute_confidence_intervals
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.imperfect_law import ImperfectLawDecision, compute_jackknife_intervals
from klute_sim.diagnosis.localization.equation_residuals import EquationResidual, compute_equation_residuals
from klute_sim.diagnosis.noise.misfit import SIGNIFICANCE_SIGMAS
from klute_sim.diagnosis.result import DiagnosisOptions, Verdict
from klute_sim.diagnosis.selection.bounds import has_value_at_bound
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.law_error import find_simpler_rival
from klute_sim.diagnosis.selection.main_effect import find_rivals_of_main_effect
from klute_sim.diagnosis.selection.naming import (
    describe_coincidence,
    find_naming_obstacle,
)
from klute_sim.diagnosis.selection.predictive_model import PredictiveResult
from klute_sim.diagnosis.selection.predictive_selection import PredictiveSelection
from klute_sim.diagnosis.selection.robustness import (
    EquivalentModel,
    check_convergence,
    select_final_fit,
)
from klute_sim.types import ProgressCallback


class FinalModel(NamedTuple):
    """The model that a diagnosis ends with."""

    verdict: Verdict
    """Verdict."""
    reasons: list[str]
    """Sentences that explain the verdict."""
    data: WeightedData
    """Trials of the final fit."""
    base_fit: Fit
    """Fit without added effects to the same trials."""
    final_fit: Fit
    """Fit with the added effects."""
    confidence_intervals: list[tuple[float, float]]
    """95 % interval of each parameter of the final fit, in its own unit."""
    equivalent_models: list[EquivalentModel]
    """Models that explain the data as well, or nearly so."""
    equation_residuals: list[EquationResidual]
    """Residuals of the equations of the device, where they locate the misfit."""
    has_converged: bool
    """Whether a restart of the final fit agrees with it."""
    prediction: PredictiveResult | None = None
    """Selection by prediction, where it was made."""
    absent_terms: tuple[EffectTerm, ...] = ()
    """Effects that were found and left out, because their interval contains their absence."""


def select_adequate_model(
    search: ForwardSelection,
    base_fit: Fit,
    final_fit: Fit,
    options: DiagnosisOptions,
    progress: ProgressCallback,
) -> FinalModel | None:
    """Return the model where the noise between repeats decides; None where names would have a value at a bound.

    Such an effect takes a simpler form; if no simpler form reaches the noise, an equivalent model takes its place.
    """
    data = search.data
    progress(0.6, "comparing the effects with a data-driven term")
    data_driven_model = find_data_driven_rival(search, base_fit, final_fit, options.exclude)
    if data_driven_model is not None and data_driven_model.difference < -compute_decisive_threshold(search):
        return _refuse_names(search, base_fit, final_fit, data_driven_model, options)
    final_fit, has_converged, equivalent_models = select_final_fit(search, final_fit, options.seed, progress)
    data_driven_model = find_data_driven_rival(search, base_fit, final_fit, options.exclude)
    if data_driven_model is not None and data_driven_model.difference < -compute_refusal_threshold(search):
        return _refuse_names(search, base_fit, final_fit, data_driven_model, options)
    equivalent_models += [data_driven_model] if data_driven_model else []
    equivalent_models.sort(key=lambda model: model.difference)
    verdict, reasons = _decide_verdict(search, final_fit, equivalent_models)
    if verdict == "identified" and (rival := find_rival_of_number(search, base_fit, final_fit, options.exclude)):
        verdict, equivalent_models, reasons = "indistinguishable", [rival.model], [rival.sentence, *reasons]
    if verdict == "unexplained":  # proxies have no alternatives
        equivalent_models = []
    else:
        if rivals := find_rivals_of_main_effect(search, base_fit, final_fit):
            verdict, equivalent_models = "indistinguishable", [*equivalent_models, *rivals]
            reasons.append(_describe_rivals(final_fit, search.history[0].added_term, rivals))
        simpler = find_simpler_rival(search, base_fit, final_fit)
        if simpler and all(simpler.model.fit.identities != model.fit.identities for model in equivalent_models):
            verdict, equivalent_models = "indistinguishable", [*equivalent_models, simpler.model]
            reasons.append(simpler.sentence)
    if verdict in ("identified", "indistinguishable") and has_value_at_bound(final_fit):
        return None
    return FinalModel(
        verdict,
        reasons,
        data,
        base_fit,
        final_fit,
        compute_confidence_intervals(data, final_fit),
        equivalent_models,
        compute_equation_residuals(data, final_fit),
        has_converged,
    )


def select_decisive_term(
    search: ForwardSelection,
    base_fit: Fit,
    final_fit: Fit,
    options: DiagnosisOptions,
    progress: ProgressCallback,
) -> FinalModel | None:
    """Return the model with a data-driven term where it alone explains the data to the noise; None without such a term.

    ``final_fit`` is the best fit with effects of the catalogue, and leaves a misfit. Without repeats the noise is
    unknown.
    """
    if not search.has_repeats:
        return None
    progress(0.5, "comparing the effects with a data-driven term")
    decisive = find_decisive_term(search, base_fit, final_fit, options.exclude)
    if decisive is None:
        return None
    term_fit, equation = decisive.adequate
    reason = (
        f"A data-driven term in the equation of {equation} explains the data to the noise, and no candidate effects do"
    )
    if decisive.named_fit is None:
        reason += f": the missing effect {options.absence}."
        reasons = [reason, *_describe_misfit(search, final_fit)]
        return _replace_names(search, base_fit, term_fit, reasons, options)
    named_fit = decisive.named_fit
    share = (base_fit.chi2 - named_fit.chi2) / (base_fit.chi2 - term_fit.chi2)
    reason += (
        f". {_list_names(base_fit, named_fit)} would explain {100.0 * share:.0f} % of what the term explains, from "
        f"elsewhere: either this is missing in another form, or the missing effect {options.absence} and resembles it."
    )
    data_driven_model = EquivalentModel(term_fit, compute_bic_difference(search, term_fit, named_fit))
    return FinalModel(
        "indistinguishable",
        [reason, *_describe_misfit(search, named_fit)],
        search.data,
        base_fit,
        named_fit,
        compute_confidence_intervals(search.data, named_fit),
        [data_driven_model, *decisive.rivals],
        compute_equation_residuals(search.data, named_fit),
        named_fit.converged,
    )


def select_proxies(
    search: ForwardSelection,
    base_fit: Fit,
    final_fit: Fit,
    prediction: PredictiveResult,
    decision: ImperfectLawDecision,
    options: DiagnosisOptions,
    progress: ProgressCallback,
) -> FinalModel:
    """Return the model where nothing is named: effects that stand in for what is missing, and a data-driven term."""
    progress(0.6, "restarting the fit from another point")
    final_fit, has_converged = check_convergence(search.data, final_fit, np.random.default_rng(options.seed))
    equation_residuals = compute_equation_residuals(search.data, final_fit)
    reasons = [*decision.reasons, *_describe_misfit(search, final_fit)]
    if decision.verdict == "unexplained":
        progress(0.8, "fitting a data-driven term")
        final_fit, has_converged, sentences = _add_data_driven_term(
            search, final_fit, base_fit, equation_residuals, options, has_converged
        )
        reasons += sentences
    return FinalModel(
        decision.verdict,
        reasons,
        search.data,
        base_fit,
        final_fit,
        compute_confidence_intervals(search.data, final_fit),
        [],
        equation_residuals,
        has_converged,
        prediction,
    )


def _describe_misfit(search: ForwardSelection, fit: Fit) -> list[str]:
    """Return a sentence about the most significant misfit of ``fit``, or about what speaks against its names.

    There is none without repeats.
    """
    misfits = search.find_relevant_misfits(fit)
    if not misfits:
        obstacle = find_naming_obstacle(search.data, fit) if search.has_repeats else ""
        return [f"{obstacle}, so it is not named, although it explains the data to the noise."] if obstacle else []
    channel = max(misfits, key=lambda channel: misfits[channel].significance)
    worst = misfits[channel]
    sentence = (
        f"All repeats of '{channel}' still show a misfit of {worst.rms / worst.noise_rms:.2f} times the noise "
        f"({worst.significance:.0f} standard errors; {SIGNIFICANCE_SIGMAS:.0f} are allowed)."
    )
    last_step = f"Last step of the selection: {search.history[-1].reason}."
    return [sentence, *([] if fit.hypothesis.terms else [last_step])]


def select_imperfect_model(
    search: ForwardSelection,
    base_fit: Fit,
    selection: PredictiveSelection,
    result: PredictiveResult,
    decision: ImperfectLawDecision,
    options: DiagnosisOptions,
    progress: ProgressCallback,
) -> FinalModel:
    """Return the model where the prediction of left-out conditions has decided for names.

    ``base_fit`` is the fit of ``search`` without added effects.
    """
    progress(0.7, "comparing the effects with a data-driven term")
    data_driven_model, data_driven_rival = compare_with_data_driven_models(
        search, base_fit, selection, result, options.exclude
    )
    if data_driven_model is not None:
        reason = (
            f"A data-driven term of the same size {data_driven_model.description} predicts better: it leaves "
            f"{100.0 * data_driven_model.error / result.base.error:.1f} % of the squared error, the effects "
            f"{100.0 * result.chosen.error / result.base.error:.1f} %. The missing effect {options.absence}, and these "
            "effects only imitate it."
        )
        term_fit = base_fit  # no device file holds a term in a reading
        if data_driven_model.fit is not None:
            term_fit = fit_hypothesis(search.data, data_driven_model.fit.hypothesis, data_driven_model.fit.x)
        refused = _replace_names(search, base_fit, term_fit, [*decision.reasons, reason], options)
        return refused._replace(prediction=result)
    equivalent_models = [
        EquivalentModel(
            model.fit, model.error / result.chosen.error - 1.0, "prediction error", model is not result.certain
        )
        for model in (result.alternatives if decision.verdict == "indistinguishable" else ())
    ]
    reasons = decision.reasons
    if data_driven_rival is not None and data_driven_rival.fit is not None:
        reason = (
            f"A data-driven term {data_driven_rival.description}, no larger than the effects, would predict as well: "
            "the missing effect may be there, and in no catalogue."
        )
        reasons = [*reasons, reason]
        difference = data_driven_rival.error / result.chosen.error - 1.0
        equivalent_models.append(EquivalentModel(data_driven_rival.fit, difference, "prediction error"))
        equivalent_models.sort(key=lambda model: model.difference)
    return FinalModel(
        "indistinguishable" if equivalent_models else decision.verdict,
        reasons,
        selection.data,
        result.base.fit,
        result.chosen.fit,
        compute_jackknife_intervals(result.chosen),
        equivalent_models,
        compute_equation_residuals(selection.data, result.chosen.fit),
        bool(result.chosen.is_reproducible),
        result,
    )


def _add_data_driven_term(
    search: ForwardSelection,
    final_fit: Fit,
    base_fit: Fit,
    equation_residuals: Sequence[EquationResidual],
    options: DiagnosisOptions,
    has_converged: bool,
) -> tuple[Fit, bool, list[str]]:
    """Return the fit with a data-driven term if one is accepted, whether it converged, and sentences about it."""
    discrepancy = add_data_driven_term(search, final_fit, base_fit, equation_residuals, options.exclude)
    sentences = [discrepancy.reason]
    if discrepancy.fit is not None:
        final_fit, has_converged = check_convergence(search.data, discrepancy.fit, np.random.default_rng(options.seed))
        misfit = "still show a misfit" if search.has_misfit(final_fit) else "show no misfit"
        sentences[-1] += f" With it, repeats {misfit}."
    return final_fit, has_converged, [*sentences, *_describe_proxies(final_fit)]


def _refuse_names(
    search: ForwardSelection,
    base_fit: Fit,
    named_fit: Fit,
    rival: EquivalentModel,
    options: DiagnosisOptions,
) -> FinalModel:
    """Return the model with the data-driven term of ``rival`` in place of the names of ``named_fit``."""
    reason = (
        f"{_list_names(base_fit, named_fit)} would explain the data to the noise, but a data-driven term in one "
        f"equation explains them better (BIC is lower by {-rival.difference:.0f}): the missing effect is not "
        "in the catalogue, and these effects only imitate it."
    )
    return _replace_names(search, base_fit, rival.fit, [reason], options)


def _list_names(base_fit: Fit, named_fit: Fit) -> str:
    return " and ".join(str(term) for term in named_fit.hypothesis.terms[len(base_fit.hypothesis.terms) :])


def _replace_names(
    search: ForwardSelection, base_fit: Fit, term_fit: Fit, reasons: list[str], options: DiagnosisOptions
) -> FinalModel:
    """Return the model of ``term_fit``, which holds a data-driven term, or nothing, in place of names."""
    final_fit, has_converged = check_convergence(search.data, term_fit, np.random.default_rng(options.seed))
    return FinalModel(
        "unexplained",
        reasons,
        search.data,
        base_fit,
        final_fit,
        compute_confidence_intervals(search.data, final_fit),
        [],
        compute_equation_residuals(search.data, final_fit),
        has_converged,
    )


def _decide_verdict(
    search: ForwardSelection, final_fit: Fit, equivalent_models: Sequence[EquivalentModel]
) -> tuple[Verdict, list[str]]:
    """Return the verdict and its reasons."""
    terms = final_fit.hypothesis.terms
    if search.has_misfit(final_fit):  # an adequate model that lost a term, or restarted elsewhere
        return "unexplained", _describe_misfit(search, final_fit)
    if not terms and not search.history:  # within the tolerance, of which a remark tells
        return "nothing-missing", []
    if not terms:
        return "nothing-missing" if search.has_repeats else "insufficient-data", [f"{search.history[-1].reason}."]
    # A term may have a simpler form than the one that was added.
    final_terms = {term.identity: term for term in terms}
    steps = [
        (step, final_terms[step.added_term.identity])
        for step in search.history
        if step.added_term is not None and step.added_term.identity in final_terms
    ]
    reasons = [f"{term}: {step.reason}." for step, term in steps]
    explained = {term.identity for _, term in steps}
    reasons += [
        f"{term}: found by comparing complete sets of effects; adding one effect at a time chose others."
        for term in terms
        if term.identity not in explained
    ]
    if not all(step.validation_gains for step, _ in steps):
        reasons.append(
            "There is no second group of trials for validation: the result rests on the fitted trials alone."
        )
    if not search.has_repeats:
        return "insufficient-data", reasons
    coincidence = describe_coincidence(terms)
    if coincidence:
        return "unexplained", [coincidence, *reasons]
    if equivalent_models:
        rivals = [model.fit.hypothesis.terms for model in equivalent_models]
        others = [[t for t in rival if t.identity not in final_terms] or rival[-1:] for rival in rivals]
        names = ", ".join(sorted({" with ".join(map(str, replacing)) for replacing in others}))
        difference = max(abs(model.difference) for model in equivalent_models)
        sentence = f"{names} would explain the data as well: BIC differs by less than {math.floor(difference) + 1}."
        return "indistinguishable", [*reasons, sentence]
    return "identified", reasons


def _describe_rivals(final_fit: Fit, main_term: EffectTerm | None, rivals: Sequence[EquivalentModel]) -> str:
    """Return a sentence about the ``rivals`` of ``main_term``, which explains nearly all."""
    names = " or ".join(str(model.fit.hypothesis.terms[-1]) for model in rivals)
    others = [str(term) for term in final_fit.hypothesis.terms if main_term and term.identity != main_term.identity]
    return (
        f"What {' and '.join(others)} {'add' if len(others) > 1 else 'adds'} beside {main_term} is small and may stand "
        f"for an error of its law, so {names} alone is as likely."
    )


def _describe_proxies(final_fit: Fit) -> list[str]:
    proxies = [str(term) for term in final_fit.hypothesis.terms if not term.effect_definition.data_driven]
    if len(proxies) > 1:
        return [f"Only proxies were identified: {' and '.join(proxies)} explain a part of the misfit."]
    return [f"Only a proxy was identified: {proxies[0]} explains a part of the misfit."] if proxies else []
