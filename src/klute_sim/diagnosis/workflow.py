"""The whole workflow: check, noise, fit, gap, locate, name, doubt, add, show.

Trials that are kept back to show are not looked at before everything else is decided.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from threadpoolctl import threadpool_limits

from klute_sim.datasets.dataset import Dataset, split_dataset
from klute_sim.datasets.split import Split
from klute_sim.diagnosis.experiments import data_quality
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS, Experiment, Simulator
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.quantization import Quantizer, detect_quantizers
from klute_sim.diagnosis.experiments.usable import select_usable_data
from klute_sim.diagnosis.fitting.confidence_intervals import compute_confidence_intervals
from klute_sim.diagnosis.fitting.fit_cache import FitCache
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit, WeightedData, fit_hypothesis
from klute_sim.diagnosis.noise import repeats as noises
from klute_sim.diagnosis.noise.heteroscedastic import add_noise_scales
from klute_sim.diagnosis.noise.repeats import SIGNIFICANCE_SIGMAS, Noise, is_significant
from klute_sim.diagnosis.planning.proposals import propose_experiment
from klute_sim.diagnosis.selection.equation_residuals import EquationResidual, compute_equation_residuals
from klute_sim.diagnosis.selection.forward_selection import BIC_THRESHOLD, ForwardSelection, SelectionStep
from klute_sim.diagnosis.selection.localization import MisfitRegion, locate_misfit
from klute_sim.diagnosis.selection.robustness import (
    EquivalentModel,
    check_convergence,
    find_equivalent_models,
    find_smaller_model,
)
from klute_sim.diagnosis.selection.screening import check_effect_names, list_candidate_terms
from klute_sim.diagnosis.selection.sparse_regression import fit_discrepancy_term

Verdict = Literal["nothing-missing", "named", "ambiguous", "unexplained", "insufficient-data"]


@dataclass(frozen=True, eq=False, kw_only=True)
class DiagnosisOptions:
    """What the user may choose."""

    only: tuple[str, ...] = ()
    """Effects to look for; none: all."""
    exclude: tuple[str, ...] = ()
    """Effects not to look for."""
    n_jobs: int = 0
    """Threads; 0: all cores."""
    seed: int = 0
    """Of where fits are tried again from."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ChannelRms:
    """Root mean square of measured minus simulated, of one channel, on the trials shown [SI]."""

    nominal: float
    """With the nominal device."""
    refitted: float
    """With the device's uncertain numbers refitted and no effect added."""
    with_effects: float
    """With the effects."""
    noise_floor: float | None
    """What differs between repeats: no model can do better. Nobody knows where nothing was repeated."""


@dataclass(eq=False, kw_only=True)
class Diagnosis:
    """What was found."""

    dataset: Dataset
    split: Split
    verdict: Verdict
    reasons: list[str]
    """In plain words."""
    noise: dict[str, Noise] = field(default_factory=dict)
    base_fit: Fit | None = None
    """The device without effects, its uncertain numbers fitted."""
    final_fit: Fit | None = None
    """With the effects that were accepted."""
    added_terms: tuple[EffectTerm, ...] = ()
    """What was added: effects, and where they do not explain everything, perhaps a data-driven term, the last."""
    confidence_intervals: list[tuple[float, float]] = field(default_factory=list)
    """Of the final fit's unknowns, 95 %."""
    equivalent_models: list[EquivalentModel] = field(default_factory=list)
    misfit_regions: list[MisfitRegion] = field(default_factory=list)
    equation_residuals: list[EquationResidual] = field(default_factory=list)
    """What each equation of the device lacks with nothing added; none where nothing was repeated, or clocks differ."""
    selection_history: list[SelectionStep] = field(default_factory=list)
    channel_rms: dict[str, ChannelRms] = field(default_factory=dict)
    evaluated_on: Literal["show", "fit"] = "show"
    """Which trials :attr:`gap` is of; fitted ones where none was kept back."""
    experiments: list[Experiment] = field(default_factory=list)
    quantizers: dict[str, Quantizer] = field(default_factory=dict)
    """Channels that show whole steps only."""
    n_independent: float = 0.0
    """Independent samples that were fitted."""
    has_repeats: bool = True
    """Whether noise is known from repeats; else all that is left was taken for noise."""
    bic_threshold: float = BIC_THRESHOLD
    """Fall of BIC that was asked for."""
    next_experiment: dict[str, Any] | None = None
    """What to record to tell rivals apart."""
    device_is_representable: bool = True
    """Whether the device as fitted can be a device file."""
    n_simulations: int = 0


def diagnose(
    dataset: Dataset, options: DiagnosisOptions | None = None, progress: Callable[[str], None] = lambda sentence: None
) -> Diagnosis:
    """Find what the simulation of ``dataset`` lacks; ``told`` hears what is being done.

    Raises InputError for trials that their rig cannot simulate.
    """
    options = options or DiagnosisOptions()
    check_effect_names(dataset.device, options.only, options.exclude)
    parts = split_dataset(dataset)
    bench, store = Simulator(options.n_jobs), FitCache(f"{dataset.digest} {dataset.device.digest} {options}")
    try:
        # Simulations share the cores already; a linear algebra of many threads would only wait for its turn.
        with threadpool_limits(1, user_api="blas"):
            found = _run_workflow(dataset, parts, options, bench, store, progress)
    finally:
        bench.close()
    store.clear()
    return found


def _run_workflow(
    dataset: Dataset,
    partition: Split,
    options: DiagnosisOptions,
    simulator: Simulator,
    cache: FitCache,
    progress: Callable[[str], None],
) -> Diagnosis:
    progress("checking the data")
    every, fitted, reasons, against = select_usable_data(dataset, prepare_experiments(dataset, partition), simulator)
    if against:
        return Diagnosis(
            dataset=dataset,
            split=partition,
            verdict="insufficient-data",
            reasons=[*reasons, *against],
            experiments=every,
        )

    shown: dict[str, Quantizer] = {}
    if data_quality.has_repeats(fitted):
        every, shown = detect_quantizers(every, fitted)
        every = add_noise_scales(every, fitted, simulator)
        fitted = [e for e in every if e.use == "fit" and e.measured]
    progress("fitting the device as it is")
    base, evidence = fit_base_device(dataset, fitted, simulator, cache)
    kept = [e for e in every if e.use == "select" and e.measured.keys() & evidence.noise]
    selection = [
        evidence.with_experiments([e for e in kept if e.group == group]) for group in noises.group_repeats(kept)
    ]
    candidates = list_candidate_terms(evidence, dataset.device, options.only, options.exclude)
    search = ForwardSelection(evidence, selection, candidates, progress, data_quality.has_repeats(fitted))
    final = search.run(base)
    evidence = search.data
    progress("fitting once more from elsewhere")
    final, sure = check_convergence(evidence, final, np.random.default_rng(options.seed))
    smaller = find_smaller_model(search, final)
    if smaller is not None:
        final, sure = check_convergence(evidence, smaller, np.random.default_rng(options.seed))
    progress("looking for rivals")
    others = find_equivalent_models(search, final)
    if others and others[0].bic_difference < -search.bic_threshold:
        final, sure = check_convergence(evidence, others[0].fit, np.random.default_rng(options.seed))
        others = find_equivalent_models(search, final)
    verdict, why = _decide_verdict(search, final, others)
    if shown and "quantisation" not in options.exclude:
        why = [*(_describe_quantization(c, display) for c, display in shown.items()), *why]
        verdict = "named" if verdict == "nothing-missing" else verdict
    lacks = compute_equation_residuals(evidence, final)
    if verdict == "unexplained":
        progress("looking for a data-driven term")
        extra = fit_discrepancy_term(search, final, base, lacks, options.exclude)
        why.append(extra.reason)
        if extra.fit is not None:
            final, sure = check_convergence(evidence, extra.fit, np.random.default_rng(options.seed))
            others = []  # they are rivals of what was found without it
            rest = "still show a misfit" if search.has_misfit(final) else "show no more misfit"
            why[-1] += f" With it, repeats {rest}."
        why += _describe_proxies(final)
    if not sure:
        reasons.append("The fit does not come back to the same place from elsewhere: take its numbers with care.")
    result = Diagnosis(
        dataset=dataset,
        split=partition,
        verdict=verdict,
        reasons=[*reasons, *why],
        noise=dict(evidence.noise),
        base_fit=base,
        final_fit=final,
        added_terms=final.hypothesis.terms,
        confidence_intervals=compute_confidence_intervals(evidence, final),
        equivalent_models=others,
        misfit_regions=locate_misfit(evidence, base),
        equation_residuals=lacks,
        selection_history=search.history,
        experiments=every,
        n_independent=evidence.n_effective,
        quantizers=shown,
        has_repeats=search.has_repeats,
        bic_threshold=search.bic_threshold,
    )
    if others and dataset.rig == "bench":  # protocols are for a tester
        progress("looking for the experiment that separates them")
        result.next_experiment = propose_experiment(evidence, dataset.device, final, others[0].fit).to_dict()
    progress("showing it on trials kept back")
    _evaluate_held_out(result, evidence)
    result.n_simulations = simulator.n_rollouts
    return result


def fit_base_device(
    dataset: Dataset, experiments: Sequence[Experiment], simulator: Simulator, cache: FitCache | None = None
) -> tuple[Fit, WeightedData]:
    """The device without new effects, and the evidence weighed by the noise of its residuals."""
    plain = Hypothesis(dataset.device, tuple(dataset.uncertainties.items()), ())
    bare = WeightedData(simulator, experiments, {})
    weigh = (
        noises.estimate_noise_from_repeats
        if data_quality.has_repeats(experiments)
        else noises.estimate_noise_from_residuals
    )
    noise = weigh(experiments, bare.compute_residuals(plain, [plain.initial_point()])[0])
    found = None
    for _ in range(2):  # the noise of the inputs shows through the device, so it changes a little with it
        deviations = tuple((channel, each.std) for channel, each in noise.items())
        hypothesis = Hypothesis(plain.device, plain.uncertainties, deviations)
        evidence = WeightedData(simulator, experiments, noise, cache)
        found = fit_hypothesis(evidence, hypothesis, found.x if found else None)
        noise = weigh(experiments, found.residuals)
    assert found is not None
    return found, evidence


def _decide_verdict(
    search: ForwardSelection, final_fit: Fit, equivalent_models: Sequence[EquivalentModel]
) -> tuple[Verdict, list[str]]:
    own = final_fit.hypothesis.terms
    misfits = {channel: each for channel, each in search.compute_misfits(final_fit).items() if is_significant(each)}
    if misfits:
        worst = max(misfits, key=lambda channel: misfits[channel].significance)
        left = (
            f"All repeats of '{worst}' still show a misfit of {misfits[worst].rms / misfits[worst].noise_rms:.2f} times "
            f"the noise ({misfits[worst].significance:.0f} standard errors; {SIGNIFICANCE_SIGMAS:.0f} are allowed)."
        )
        last = f"What was tried last: {search.history[-1].reason}."
        return "unexplained", [left, *([] if own else [last])]
    if not own:
        return "nothing-missing" if search.has_repeats else "insufficient-data", [f"{search.history[-1].reason}."]
    found = {(term.effect, term.channel): term for term in own}  # by now, perhaps, in a simpler form than was added
    kept = [
        s for s in search.history if s.added_term is not None and (s.added_term.effect, s.added_term.channel) in found
    ]
    first = [
        f"{found[s.added_term.effect, s.added_term.channel]}: {s.reason}." for s in kept if s.added_term is not None
    ]
    if not all(step.validation_gains for step in kept):
        first.append("There was no second group of trials to check that by: it rests on the fitted ones alone.")
    if not search.has_repeats:
        return "insufficient-data", first
    if equivalent_models:
        names = ", ".join(sorted({str(rival.fit.hypothesis.terms[-1]) for rival in equivalent_models}))
        return "ambiguous", [
            *first,
            f"{names} would explain the data as well: BIC differs by no more than {search.bic_threshold:.0f}.",
        ]
    return "named", first


def _describe_quantization(channel: str, quantizer: Quantizer) -> str:
    unit, si = CHANNEL_UNITS[channel]
    return (
        f"'{channel}' shows whole steps of {quantizer.resolution / si:.4g} {unit} only, {1.0 / quantizer.dither:.1f} times the "
        "noise before it: a quantisation, read off the data's own grid."
    )


def _describe_proxies(final_fit: Fit) -> list[str]:
    named = " and ".join(str(term) for term in final_fit.hypothesis.terms if not term.effect_definition.data_driven)
    return [f"Only a proxy was found: {named} explains part of the gap."] if named else []


def _evaluate_held_out(result: Diagnosis, data: WeightedData) -> None:
    """Open the trials that were kept back; nothing is decided after this."""
    kept = [e for e in result.experiments if e.use == "show" and e.measured]
    result.evaluated_on = "show" if kept else "fit"
    on = data.with_experiments(kept or data.experiments)
    assert result.base_fit is not None
    assert result.final_fit is not None
    nominal, base, final = result.base_fit.hypothesis, result.base_fit, result.final_fit
    residuals = [
        on.compute_residuals(nominal, [nominal.initial_point()])[0],
        on.compute_residuals(base.hypothesis, [base.x])[0],
        on.compute_residuals(final.hypothesis, [final.x])[0],
    ]
    floors = data.noise if data_quality.has_repeats(data.experiments) else {}
    plain = [replace(e, noise_scale={}) for e in on.experiments]
    floors = {**floors, **noises.estimate_noise_from_repeats(plain, residuals[2])}
    for channel in noises.list_channels(on.experiments):
        rms = [
            float(np.sqrt(np.mean(np.concatenate([found[channel] for found in each if channel in found]) ** 2)))
            for each in residuals
        ]
        floor = floors[channel].std if channel in floors else None
        result.channel_rms[channel] = ChannelRms(
            nominal=rms[0], refitted=rms[1], with_effects=rms[2], noise_floor=floor
        )
