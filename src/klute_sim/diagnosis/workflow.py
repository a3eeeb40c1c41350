"""Workflow of a diagnosis: check data, measure noise, fit, select effects, test robustness, evaluate on test trials.

No effect, number or form is chosen with test trials. They are simulated last; then they confirm the names or demote the
verdict, and they decide which device is recommended.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from klute_sim.datasets.dataset import Dataset, split_dataset
from klute_sim.datasets.split import Split
from klute_sim.diagnosis import data_quality
from klute_sim.diagnosis.data_quality import select_usable_data
from klute_sim.diagnosis.device_file import augment_device
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS, Experiment
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.registration import describe_registration
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.confidence_intervals import compute_confidence_intervals
from klute_sim.diagnosis.fitting.fit_cache import FitCache
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit, WeightedData, fit_hypothesis
from klute_sim.diagnosis.held_out import evaluate_held_out
from klute_sim.diagnosis.imperfect_law import (
    ImperfectLawDecision,
    compute_jackknife_intervals,
    decide_verdict,
    find_complete_model,
    select_by_prediction,
)
from klute_sim.diagnosis.noise import repeats
from klute_sim.diagnosis.noise.heteroscedastic import add_noise_scales
from klute_sim.diagnosis.noise.misfit import SIGNIFICANCE_SIGMAS
from klute_sim.diagnosis.noise.quantization import Quantizer, detect_quantizers
from klute_sim.diagnosis.planning.proposals import propose_experiment
from klute_sim.diagnosis.result import Diagnosis, DiagnosisOptions, Verdict
from klute_sim.diagnosis.selection.equation_residuals import EquationResidual, compute_equation_residuals
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.localization import locate_misfit
from klute_sim.diagnosis.selection.predictive_model import PredictiveModel, PredictiveResult
from klute_sim.diagnosis.selection.predictive_selection import PredictiveSelection
from klute_sim.diagnosis.selection.robustness import (
    EquivalentModel,
    check_convergence,
    find_equivalent_models,
    find_smaller_model,
)
from klute_sim.diagnosis.selection.screening import check_effect_names, list_candidate_terms
from klute_sim.diagnosis.selection.sparse_regression import fit_discrepancy_term
from klute_sim.types import ProgressCallback


def diagnose(
    dataset: Dataset,
    options: DiagnosisOptions | None = None,
    progress: ProgressCallback = lambda fraction, stage: None,
) -> Diagnosis:
    """Return which effects the simulation of ``dataset`` lacks.

    Raises InputError when the rig of the dataset cannot simulate its trials.
    """
    options = options or DiagnosisOptions()
    check_effect_names(dataset.device, options.only, options.exclude)
    partition = split_dataset(dataset)
    simulator, cache = Simulator(options.n_jobs), FitCache(f"{dataset.digest} {dataset.device.digest} {options}")
    try:
        # The simulations use all cores; multi-threaded linear algebra would only compete with them.
        with threadpool_limits(1, user_api="blas"):
            diagnosis = _run_workflow(dataset, partition, options, simulator, cache, progress)
    finally:
        simulator.close()
    cache.clear()
    return diagnosis


def _run_workflow(
    dataset: Dataset,
    partition: Split,
    options: DiagnosisOptions,
    simulator: Simulator,
    cache: FitCache,
    progress: ProgressCallback,
) -> Diagnosis:
    progress(0.0, "checking the data")
    experiments, fitted, reasons, problems = select_usable_data(
        dataset, prepare_experiments(dataset, partition), simulator
    )
    if problems:
        return Diagnosis(
            dataset=dataset,
            split=partition,
            verdict="insufficient-data",
            reasons=[*reasons, *problems],
            experiments=experiments,
        )

    quantizers: dict[str, Quantizer] = {}
    if data_quality.has_repeats(fitted):
        experiments, quantizers = detect_quantizers(experiments, fitted)
        experiments, remarks = add_noise_scales(experiments, fitted, simulator)
        reasons += remarks
        fitted = [e for e in experiments if e.use == "fit" and e.measured]
    progress(0.1, "fitting the device without added effects")
    base_fit, data = fit_base_device(dataset, fitted, simulator, cache)
    validation = [e for e in experiments if e.use == "validation" and e.measured.keys() & data.noise]
    validation_data = [
        data.with_experiments([e for e in validation if e.group == group])
        for group in repeats.group_repeats(validation)
    ]
    candidate_terms = list_candidate_terms(data, dataset, options.only, options.exclude)
    search = ForwardSelection(
        data,
        validation_data,
        candidate_terms,
        lambda stage: progress(0.2, stage),
        data_quality.has_repeats(fitted),
        dataset.tolerance,
    )
    is_tolerated = search.is_within_tolerance(base_fit)  # what the user tolerates needs no name
    final_fit = base_fit if is_tolerated else search.run(base_fit)
    selected: _SelectedModel | None = None
    # Without repeats nothing but predictions can tell a misfit from noise.
    if not is_tolerated and (not search.has_repeats or search.has_misfit(final_fit)):
        progress(0.5, "predicting conditions that are left out")
        prediction = select_by_prediction(search, experiments, final_fit, lambda stage: progress(0.5, stage))
        complete_fit = find_complete_model(search, base_fit, *prediction) if search.has_repeats else None
        decision = decide_verdict(prediction[1], has_repeats=search.has_repeats)
        if complete_fit is not None:
            final_fit = complete_fit
        elif decision.verdict in ("identified-in-part", "indistinguishable"):
            selected = _select_imperfect_model(*prediction, decision, options)
        else:  # nothing is named: proxies and a data-driven term follow
            selected = _select_complete_model(search, base_fit, final_fit, options, progress)
            if selected.verdict in ("unexplained", "insufficient-data"):
                both = [*decision.reasons, *selected.reasons]
                selected = selected._replace(verdict=decision.verdict, reasons=both, prediction=prediction[1])
    if selected is None:
        selected = _select_complete_model(search, base_fit, final_fit, options, progress)
    if quantizers and "quantisation" not in options.exclude:
        sentences = [_describe_quantization(c, q) for c, q in quantizers.items()]
        verdict = "identified" if selected.verdict == "nothing-missing" else selected.verdict
        selected = selected._replace(verdict=verdict, reasons=[*sentences, *selected.reasons])
    fit = selected.final_fit
    names = [parameter.name for parameter in fit.hypothesis.parameters]
    reasons += describe_registration(zip(names, fit.values, selected.confidence_intervals, strict=True))
    if not selected.has_converged:
        reasons.append("A fit restarted from another point converged elsewhere; treat the values with caution.")
    data, final_fit, equivalent_models = selected.data, selected.final_fit, selected.equivalent_models
    diagnosis = Diagnosis(
        dataset=dataset,
        split=partition,
        verdict=selected.verdict,
        reasons=[*reasons, *selected.reasons],
        noise=dict(search.data.noise),
        base_fit=selected.base_fit,
        final_fit=final_fit,
        added_terms=final_fit.hypothesis.terms,
        confidence_intervals=selected.confidence_intervals,
        equivalent_models=equivalent_models,
        prediction=selected.prediction,
        misfit_regions=locate_misfit(search.data, base_fit),
        equation_residuals=selected.equation_residuals,
        selection_history=search.history,
        experiments=experiments,
        fitted_experiments=list(selected.data.experiments),
        n_independent=search.data.n_effective,
        quantizers=quantizers,
        has_repeats=search.has_repeats,
        bic_threshold=search.bic_threshold,
    )
    if equivalent_models and dataset.rig == "bench":  # protocols need a tensile tester
        progress(0.85, "searching for an experiment that separates the equivalent models")
        proposal = propose_experiment(data, dataset.device, final_fit, equivalent_models[0].fit)
        diagnosis.next_experiment = proposal.to_dict()
    progress(0.95, "evaluating the test trials")
    evaluate_held_out(diagnosis, search.data)
    diagnosis.n_simulations = simulator.n_rollouts
    diagnosis.fitted_device = augment_device(diagnosis.recommended_fit, dataset.folder.resolve().name)
    progress(1.0, "done")
    return diagnosis


class _SelectedModel(NamedTuple):
    """The model that the selection ends with."""

    verdict: Verdict
    reasons: list[str]
    data: WeightedData
    """Trials of the final fit."""
    base_fit: Fit
    """Fit without added effects to the same trials."""
    final_fit: Fit
    confidence_intervals: list[tuple[float, float]]
    equivalent_models: list[EquivalentModel]
    equation_residuals: list[EquationResidual]
    has_converged: bool
    prediction: PredictiveResult | None = None


def _select_complete_model(
    search: ForwardSelection,
    base_fit: Fit,
    final_fit: Fit,
    options: DiagnosisOptions,
    progress: ProgressCallback,
) -> _SelectedModel:
    """Return the model where the noise between repeats decides."""
    data = search.data
    progress(0.6, "restarting the fit from another point")
    final_fit, has_converged = check_convergence(data, final_fit, np.random.default_rng(options.seed))
    smaller_fit = find_smaller_model(search, final_fit)
    if smaller_fit is not None:
        final_fit, has_converged = check_convergence(data, smaller_fit, np.random.default_rng(options.seed))
    progress(0.7, "searching for equivalent models")
    equivalent_models = find_equivalent_models(search, final_fit)
    if equivalent_models and equivalent_models[0].bic_difference < -search.bic_threshold:
        better_fit = equivalent_models[0].fit
        final_fit, has_converged = check_convergence(data, better_fit, np.random.default_rng(options.seed))
        equivalent_models = find_equivalent_models(search, final_fit)
    verdict, reasons = _decide_verdict(search, final_fit, equivalent_models)
    equation_residuals = compute_equation_residuals(data, final_fit)
    if verdict == "unexplained":
        progress(0.8, "fitting a data-driven term")
        final_fit, has_converged, sentences = _add_discrepancy_term(
            search, final_fit, base_fit, equation_residuals, options, has_converged
        )
        reasons += sentences
        if any(term.effect_definition.data_driven for term in final_fit.hypothesis.terms):
            equivalent_models = []  # these are equivalent to the model without the data-driven term
    intervals = compute_confidence_intervals(data, final_fit)
    return _SelectedModel(
        verdict,
        reasons,
        data,
        base_fit,
        final_fit,
        intervals,
        equivalent_models,
        equation_residuals,
        has_converged,
    )


def _select_imperfect_model(
    selection: PredictiveSelection,
    result: PredictiveResult,
    decision: ImperfectLawDecision,
    options: DiagnosisOptions,
) -> _SelectedModel:
    """Return the model where the prediction of left-out conditions has decided for names."""
    data, base_fit = selection.data, result.base.fit
    final_fit, has_converged = check_convergence(data, result.chosen.fit, np.random.default_rng(options.seed))
    equivalent_models = [
        EquivalentModel(rival.fit, _find_replaced_term(result, rival), rival.error - result.chosen.error)
        for rival in (result.rivals if decision.verdict == "indistinguishable" else ())
    ]
    return _SelectedModel(
        decision.verdict,
        decision.reasons,
        data,
        base_fit,
        final_fit,
        compute_jackknife_intervals(selection.assess(final_fit)),
        equivalent_models,
        compute_equation_residuals(data, final_fit),
        has_converged,
        result,
    )


def _find_replaced_term(result: PredictiveResult, rival: PredictiveModel) -> EffectTerm:
    """Return a term of the chosen model that ``rival`` does not contain."""
    return next(term for term in result.chosen.terms if term.identity not in rival.identities)


def _add_discrepancy_term(
    search: ForwardSelection,
    final_fit: Fit,
    base_fit: Fit,
    equation_residuals: Sequence[EquationResidual],
    options: DiagnosisOptions,
    has_converged: bool,
) -> tuple[Fit, bool, list[str]]:
    """Return the fit with a data-driven term if one is accepted, whether it converged, and sentences about it."""
    discrepancy = fit_discrepancy_term(search, final_fit, base_fit, equation_residuals, options.exclude)
    sentences = [discrepancy.reason]
    if discrepancy.fit is not None:
        final_fit, has_converged = check_convergence(search.data, discrepancy.fit, np.random.default_rng(options.seed))
        misfit = "still show a misfit" if search.has_misfit(final_fit) else "show no misfit"
        sentences[-1] += f" With it, repeats {misfit}."
    return final_fit, has_converged, [*sentences, *_describe_proxies(final_fit)]


def fit_base_device(
    dataset: Dataset, experiments: Sequence[Experiment], simulator: Simulator, cache: FitCache | None = None
) -> tuple[Fit, WeightedData]:
    """Return the fit of the device without added effects, and the data weighted by the noise of its residuals."""
    registration = tuple(experiments[0].registration_deviations.items())
    nominal = Hypothesis(dataset.device, tuple(dataset.uncertainties.items()), (), (), registration)
    unweighted = WeightedData(simulator, experiments, {})
    estimate_noise = (
        repeats.estimate_noise_from_repeats
        if data_quality.has_repeats(experiments)
        else repeats.estimate_noise_from_residuals
    )
    noise = estimate_noise(experiments, unweighted.compute_residuals(nominal, [nominal.initial_point()])[0])
    fit: Fit | None = None
    for _ in range(2):  # input noise passes through the device, so the noise changes slightly with the fit
        deviations = tuple((channel, channel_noise.std) for channel, channel_noise in noise.items())
        hypothesis = replace(nominal, noise_std=deviations)
        data = WeightedData(simulator, experiments, noise, cache)
        fit = fit_hypothesis(data, hypothesis, fit.x if fit else None)
        noise = estimate_noise(experiments, fit.residuals)
    assert fit is not None
    return fit, data


def _decide_verdict(
    search: ForwardSelection, final_fit: Fit, equivalent_models: Sequence[EquivalentModel]
) -> tuple[Verdict, list[str]]:
    """Return the verdict and its reasons."""
    terms = final_fit.hypothesis.terms
    misfits = search.find_relevant_misfits(final_fit)
    if misfits:
        channel = max(misfits, key=lambda channel: misfits[channel].significance)
        worst = misfits[channel]
        sentence = (
            f"All repeats of '{channel}' still show a misfit of {worst.rms / worst.noise_rms:.2f} times the noise "
            f"({worst.significance:.0f} standard errors; {SIGNIFICANCE_SIGMAS:.0f} are allowed)."
        )
        last_step = f"Last step of the selection: {search.history[-1].reason}."
        return "unexplained", [sentence, *([] if terms else [last_step])]
    if not terms and not search.history:
        limits = [
            f"{channel} {tolerance / CHANNEL_UNITS[channel][1]:.4g} {CHANNEL_UNITS[channel][0]}"
            for channel, tolerance in search.tolerance.items()
        ]
        within = ", ".join(limits)
        return "nothing-missing", [f"The misfit is within the stated tolerance ({within})."]
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
        f"{term}: found together with the other effects; one at a time they explain less."
        for term in terms
        if term.identity not in explained
    ]
    if not all(step.validation_gains for step, _ in steps):
        reasons.append(
            "There is no second group of trials for validation: the result rests on the fitted trials alone."
        )
    if not search.has_repeats:
        return "insufficient-data", reasons
    if equivalent_models:
        names = ", ".join(sorted({str(model.fit.hypothesis.terms[-1]) for model in equivalent_models}))
        sentence = (
            f"{names} would explain the data to the noise as well: BIC differs by no more than "
            f"{search.bic_threshold:.0f}, or by a few per cent of what they gain."
        )
        return "indistinguishable", [*reasons, sentence]
    return "identified", reasons


def _describe_quantization(channel: str, quantizer: Quantizer) -> str:
    unit, si = CHANNEL_UNITS[channel]
    return (
        f"'{channel}' is quantised in steps of {quantizer.resolution / si:.4g} {unit}, "
        f"{1.0 / quantizer.dither:.1f} times the noise before quantisation; the step is that of the measured values."
    )


def _describe_proxies(final_fit: Fit) -> list[str]:
    proxies = " and ".join(str(term) for term in final_fit.hypothesis.terms if not term.effect_definition.data_driven)
    return [f"Only a proxy was identified: {proxies} explains a part of the misfit."] if proxies else []
