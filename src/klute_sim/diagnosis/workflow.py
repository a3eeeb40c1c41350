"""Workflow of a diagnosis: check data, measure noise, fit, select effects, test robustness, evaluate on test trials.

No effect, number or form is chosen with test trials. They are simulated last; then they confirm the names or demote the
verdict, and they decide which device is recommended.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from threadpoolctl import threadpool_limits

from klute_sim.datasets.dataset import Dataset, split_dataset
from klute_sim.datasets.split import Split
from klute_sim.diagnosis import data_quality
from klute_sim.diagnosis.absent_effect import remove_absent_effects
from klute_sim.diagnosis.command_delay import add_command_delay
from klute_sim.diagnosis.command_interpolation import (
    Outcome,
    Preparation,
    prepare_zero_order_hold,
    reconsider_linear_interpolation,
    select_command_interpolation,
)
from klute_sim.diagnosis.condition_registration import describe_condition_registration, describe_condition_zeros
from klute_sim.diagnosis.data_quality import select_usable_data
from klute_sim.diagnosis.device_file import augment_device
from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.experiments.channel_filter import Filters
from klute_sim.diagnosis.experiments.registration import describe_registration, list_corrections
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.filter_refinement import collect_filters, reconsider_filters, refine_filters
from klute_sim.diagnosis.final_model import (
    FinalModel,
    select_adequate_model,
    select_decisive_term,
    select_imperfect_model,
    select_proxies,
)
from klute_sim.diagnosis.fitting.confidence_intervals import compute_confidence_intervals
from klute_sim.diagnosis.fitting.fit_cache import FitCache
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.fitting.number_error import list_rig_error_candidates
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.held_out import evaluate_held_out
from klute_sim.diagnosis.imperfect_law import (
    compute_explained_rms_ratio,
    compute_jackknife_intervals,
    decide_verdict,
    find_adequate_model,
    select_by_prediction,
)
from klute_sim.diagnosis.initial_friction import reconsider_initial_friction
from klute_sim.diagnosis.localization.misfit_map import map_misfit
from klute_sim.diagnosis.localization.misfit_regions import locate_misfit
from klute_sim.diagnosis.noise import repeats
from klute_sim.diagnosis.noise.filtered_noise import add_low_pass_filters, describe_low_pass_filters
from klute_sim.diagnosis.noise.heteroscedastic import add_noise_scales
from klute_sim.diagnosis.noise.p_value import compute_p_value
from klute_sim.diagnosis.noise.quantization import Quantizer, detect_quantizers
from klute_sim.diagnosis.planning.direct_measurements import list_direct_measurements
from klute_sim.diagnosis.planning.next_experiment import propose_next_experiment
from klute_sim.diagnosis.recording_faults import suspect_absolute_pressures, suspect_wrong_scales
from klute_sim.diagnosis.remarks import (
    describe_contradicted_numbers,
    describe_excessive_commands,
    describe_length_zero,
    describe_mounting_error,
    describe_quantization,
    describe_reference_diameter,
    describe_refitted_numbers,
    describe_rubber,
    describe_tested_candidates,
    describe_tolerance,
    describe_undetermined_parameters,
)
from klute_sim.diagnosis.result import Diagnosis, DiagnosisOptions
from klute_sim.diagnosis.selection.candidates import (
    check_effect_names,
    list_candidate_terms,
    list_specimen_numbers,
    select_by_name,
    select_quantizers,
)
from klute_sim.diagnosis.selection.deviating_specimen import find_deviating_specimen
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.predictive_model import has_several_specimens
from klute_sim.diagnosis.trial_preparation import collect_sampling_rates, prepare_trials
from klute_sim.types import Array, ProgressCallback

N_NOISE_ESTIMATES = 2
"""Number of estimates of the noise without added effects: input noise passes through the device, so the noise changes
slightly with its fit."""


def diagnose(
    dataset: Dataset,
    options: DiagnosisOptions | None = None,
    progress: ProgressCallback = lambda fraction, stage: None,
) -> Diagnosis:
    """Return which effects the simulation of ``dataset`` lacks.

    Raises InputError when the rig of the dataset cannot simulate its trials.
    """
    options = options or DiagnosisOptions()
    check_effect_names(dataset, options.only, options.exclude)
    partition = split_dataset(dataset)
    # The results do not depend on the number of threads.
    settings = replace(options, n_jobs=0)
    simulator, cache = Simulator(options.n_jobs), FitCache(f"{dataset.digest} {dataset.device.digest} {settings}")
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
    prepared, remarks = prepare_trials(dataset, partition, simulator)
    experiments, fitted, reasons, problems = select_usable_data(dataset, prepared, simulator)
    reasons = [*remarks, *describe_excessive_commands(dataset.trials), *reasons]
    if problems:
        return Diagnosis(
            dataset=dataset,
            split=partition,
            verdict="insufficient-data",
            reasons=[*reasons, *problems],
            experiments=experiments,
        )

    quantizers: dict[str, Quantizer] = {}
    other_filters: list[Filters] = []
    if data_quality.has_repeats(fitted):
        if dataset.rig != "gait":  # strides differ by more than noise
            rates = collect_sampling_rates(dataset.trials)
            experiments, other_filters = add_low_pass_filters(experiments, fitted, rates, simulator)
            fitted = [e for e in experiments if e.use == "fit" and e.measured]
        experiments, quantizers = detect_quantizers(experiments, fitted, simulator)
    progress(0.1, "fitting the device without added effects")

    def prepare(trials: list[Experiment]) -> Preparation:
        return _prepare_search(dataset, trials, simulator, cache)

    def search_model(prepared: Preparation) -> Outcome:
        return _search_model(dataset, prepared, options, progress)

    detected = prepare(experiments)
    linear = refine_filters(detected, prepare, other_filters)
    hold = prepare_zero_order_hold(linear, prepare)
    outcome = search_model(hold[0] if hold else linear)
    if hold:
        reconsidered = reconsider_linear_interpolation(outcome, linear, search_model)
        reasons += [hold[1]] if reconsidered is outcome else []
        outcome = reconsidered
    elif outcome.selected.verdict != "nothing-missing":
        outcome, remarks = select_command_interpolation(outcome, prepare, search_model, progress)
        reasons += remarks
    filters = collect_filters(detected.data)
    outcome = reconsider_filters(outcome, prepare, search_model, [filters, *other_filters])
    outcome, remarks = reconsider_initial_friction(outcome, prepare, search_model)
    reasons += [*describe_low_pass_filters(outcome.experiments, filters), *remarks, *outcome.remarks]
    experiments, data, search, base_fit, selected, _ = outcome
    quantizers = select_quantizers(quantizers, options.only, options.exclude)  # all of them are simulated
    if quantizers:
        sentences = [describe_quantization(c, q) for c, q in quantizers.items()]
        selected = selected._replace(reasons=[*sentences, *selected.reasons])
    fit = selected.final_fit
    names = [parameter.name for parameter in fit.hypothesis.parameters]
    corrections = list_corrections(
        zip(names, fit.values, selected.confidence_intervals, strict=True), dict(fit.hypothesis.registration)
    )
    reasons += describe_registration(corrections)
    if selected.verdict != "nothing-missing":
        reasons += describe_condition_registration(data, base_fit)
    if selected.verdict == "unexplained":
        reasons += describe_condition_zeros(data, base_fit)
    # These would make all others void.
    reasons[:0] = filter(None, [suspect_absolute_pressures(dataset.trials, fit)])
    reasons[:0] = suspect_wrong_scales(data.experiments, base_fit)
    reasons += [*describe_contradicted_numbers(fit), *describe_refitted_numbers(fit)]
    reasons += describe_reference_diameter(fit)
    reasons += describe_mounting_error(fit) if dataset.rig == "gait" else []
    fits = [fit, *(model.fit for model in selected.equivalent_models)]
    reasons += [*describe_length_zero(dataset.trials, fits), *describe_rubber(fits)]
    if dataset.tolerance:
        reasons += describe_tolerance(search, base_fit)
    if not selected.has_converged:
        reasons.append(
            "The final fit did not converge, or a restart from another point ended elsewhere; treat its values with "
            "caution."
        )
    final_fit, equivalent_models = selected.final_fit, selected.equivalent_models
    diagnosis = Diagnosis(
        dataset=dataset,
        split=partition,
        options=options,
        verdict=selected.verdict,
        reasons=[*reasons, *selected.reasons],
        noise=dict(search.data.noise),
        base_fit=selected.base_fit,
        final_fit=final_fit,
        added_terms=final_fit.hypothesis.terms,
        absent_terms=selected.absent_terms,
        confidence_intervals=selected.confidence_intervals,
        registration_corrections=corrections,
        equivalent_models=equivalent_models,
        prediction=selected.prediction,
        p_value=compute_p_value(data, base_fit) if search.has_repeats else None,
        misfit_map=map_misfit(data, base_fit) if search.has_repeats else [],
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
    if equivalent_models:
        diagnosis.direct_measurements = list_direct_measurements(
            [final_fit, *(m.fit for m in equivalent_models)],
            partial(_compute_interval, selected),
        )
        progress(0.85, "searching for an experiment that separates the equivalent models")
        diagnosis.next_experiment = propose_next_experiment(selected.data, dataset, final_fit, equivalent_models)
    progress(0.95, "evaluating the test trials")
    evaluate_held_out(diagnosis, search.data)
    if not diagnosis.has_proxies:  # proxies show no effect
        diagnosis.reasons += describe_undetermined_parameters(fit, selected.confidence_intervals)
    diagnosis.reasons += describe_tested_candidates(options.only, options.exclude)
    diagnosis.n_simulations = simulator.n_rollouts
    diagnosis.fitted_device = (
        dataset.device
        if diagnosis.is_declared_best
        else augment_device(diagnosis.recommended_fit, dataset.folder.resolve().name)
    )
    progress(1.0, "done")
    return diagnosis


def _compute_interval(selected: FinalModel, fit: Fit, index: int) -> tuple[float, float]:
    """Return the 95 % interval of the parameter of ``fit`` at ``index``, by what decided for ``selected``."""
    prediction = selected.prediction
    models = () if prediction is None else (prediction.chosen, *prediction.alternatives)
    model = next((model for model in models if model.fit is fit), None)
    if model is not None:
        return compute_jackknife_intervals(model)[index]
    return compute_confidence_intervals(selected.data, fit, [index])[index]


def _prepare_search(
    dataset: Dataset, experiments: list[Experiment], simulator: Simulator, cache: FitCache
) -> Preparation:
    """Return ``experiments`` with the weights of their samples, and the fit of the device without added effects."""
    fitted = [e for e in experiments if e.use == "fit" and e.measured]
    remarks: list[str] = []
    if data_quality.has_repeats(fitted):
        experiments, remarks = add_noise_scales(experiments, fitted, simulator)
        fitted = [e for e in experiments if e.use == "fit" and e.measured]
    base_fit, data = fit_base_device(dataset, fitted, simulator, cache)
    return Preparation(experiments, data, base_fit, remarks)


def _search_model(
    dataset: Dataset, prepared: Preparation, options: DiagnosisOptions, progress: ProgressCallback
) -> Outcome:
    """Return the model that is selected for the ``prepared`` trials."""
    experiments, data, base_fit, remarks = prepared
    validation = [e for e in experiments if e.use == "validation" and e.measured.keys() & data.noise]
    validation_data = [
        data.with_experiments([e for e in validation if e.group == group])
        for group in repeats.group_repeats(validation)
    ]
    search = ForwardSelection(
        data,
        validation_data,
        list_candidate_terms(data, dataset, options.only, options.exclude),
        lambda stage: progress(0.2, stage),
        data_quality.has_repeats(data.experiments),
        dataset.tolerance,
    )
    selected = _select_model(search, experiments, base_fit, options, progress)
    return Outcome(experiments, data, search, base_fit, remove_absent_effects(selected, options.seed), remarks)


def _select_model(
    search: ForwardSelection,
    experiments: Sequence[Experiment],
    base_fit: Fit,
    options: DiagnosisOptions,
    progress: ProgressCallback,
) -> FinalModel:
    """Return the model that ``search`` finds, or, where it cannot be named, one that predictions choose."""
    is_tolerated = search.is_within_tolerance(base_fit)  # what the user tolerates needs no name
    final_fit = base_fit if is_tolerated else search.run(base_fit)
    # Without repeats nothing but predictions can tell a misfit from noise.
    is_unclear = search.has_misfit(final_fit) if search.has_repeats else search.has_relevant_residual(base_fit)
    if is_tolerated or not is_unclear:
        selected = select_adequate_model(search, base_fit, final_fit, options, progress)
    else:
        selected = _select_deviating_specimen(search, base_fit, options, progress)
        if selected is None:
            selected = select_decisive_term(search, base_fit, final_fit, options, progress)
    if selected is not None:
        return selected
    progress(0.5, "predicting conditions that are left out")
    selection, result = select_by_prediction(
        search, experiments, final_fit, lambda stage: progress(0.5, stage), options.seed
    )
    adequate_fit = None
    if search.has_repeats:
        adequate_fit = find_adequate_model(search, base_fit, final_fit, selection, result)
    if adequate_fit is not None:
        selected = select_adequate_model(search, base_fit, adequate_fit, options, progress)
        if selected is not None:
            return selected
    has_exact_inputs = not any(e.preparation_variants for e in experiments)
    decision = decide_verdict(
        result,
        explained_rms_ratio=compute_explained_rms_ratio(selection, result),
        has_repeats=search.has_repeats,
        has_exact_inputs=has_exact_inputs,
        has_one_specimen=not has_several_specimens(experiments),
    )
    if decision.verdict in ("identified-in-part", "indistinguishable"):
        return select_imperfect_model(search, base_fit, selection, result, decision, options, progress)
    return select_proxies(search, base_fit, final_fit, result, decision, options, progress)


def _select_deviating_specimen(
    search: ForwardSelection, base_fit: Fit, options: DiagnosisOptions, progress: ProgressCallback
) -> FinalModel | None:
    """Return the model in which a number of one specimen is wrong; None where it does not reach the noise."""
    data, device = search.data, base_fit.hypothesis.device
    is_bench = not data.experiments[0].has_body and not data.experiments[0].devices
    numbers = list_specimen_numbers(data.experiments, device) if is_bench and search.has_repeats else []
    numbers = select_by_name(numbers, options.only, options.exclude)
    extended = find_deviating_specimen(search, numbers) if numbers else None
    if extended is None:
        return None
    selected = select_adequate_model(extended, base_fit, extended.history[-1].refits[0], options, progress)
    if selected is None or selected.verdict == "unexplained":
        return None
    search.history, search.candidate_terms = extended.history, extended.candidate_terms
    return selected


def fit_base_device(
    dataset: Dataset, experiments: Sequence[Experiment], simulator: Simulator, cache: FitCache | None = None
) -> tuple[Fit, WeightedData]:
    """Return the fit of the device without added effects, and its data, weighted by their noise.

    It corrects the registration, and the delay of a command where this explains the pressures.
    """
    registration = tuple(experiments[0].registration_deviations.items())
    uncertainties = tuple(dataset.uncertainties.items())
    rig_numbers = {**dataset.model_values, **dataset.nominal_numbers, **list_rig_error_candidates(dataset)}
    nominal = Hypothesis(dataset.device, uncertainties, (), (), registration, tuple(rig_numbers.items()))
    fit, data = _fit_with_noise(nominal, experiments, simulator, cache)
    extended = add_command_delay(data, fit)
    return (fit, data) if extended is None else _fit_with_noise(extended, experiments, simulator, cache)


def _fit_with_noise(
    nominal: Hypothesis, experiments: Sequence[Experiment], simulator: Simulator, cache: FitCache | None
) -> tuple[Fit, WeightedData]:
    """Return the fit of ``nominal``, and its data, weighted by the noise of the residuals of the fit before it."""
    unweighted = WeightedData(simulator, experiments, {})
    estimate_noise = (
        repeats.estimate_noise_from_repeats
        if data_quality.has_repeats(experiments)
        else repeats.estimate_noise_from_residuals
    )
    residuals: repeats.Residuals = unweighted.compute_residuals(nominal, [nominal.initial_point()])[0]
    x: Array | None = None
    for _ in range(N_NOISE_ESTIMATES):
        noise = estimate_noise(experiments, residuals)
        deviations = tuple((channel, channel_noise.std) for channel, channel_noise in noise.items())
        data = WeightedData(simulator, experiments, noise, cache)
        fit = fit_hypothesis(data, replace(nominal, noise_std=deviations), x)
        residuals, x = fit.residuals, fit.x
    return fit, data
