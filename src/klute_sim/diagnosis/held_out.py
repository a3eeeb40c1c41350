"""Evaluation on the test trials, with which nothing was chosen: do they confirm what was named?"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from klute_sim.diagnosis import data_quality
from klute_sim.diagnosis.confirmation import (
    exercises_effects,
    leaves_more_than_in_fit,
    record_confirmation,
    record_declared_advantage,
)
from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise import repeats
from klute_sim.diagnosis.noise.misfit import Misfit, estimate_misfit, is_significant
from klute_sim.diagnosis.noise.repeats import Residuals
from klute_sim.diagnosis.noise.trial_noise import estimate_fast_noise
from klute_sim.diagnosis.result import ChannelRms, Diagnosis, RecommendedDevice, Verdict

MAX_UNSEEN_MISFIT = 1.0
"""Largest misfit of the test trials, over the noise, with which nothing is missing (assumed: other trials may show a
quarter of the noise, and test trials may cover conditions that no other trial covers)."""
DEMOTED_VERDICTS: Mapping[Verdict, Verdict] = {
    "nothing-missing": "unexplained",
    "identified": "identified-in-part",
    "indistinguishable": "unexplained",
}
"""Verdict that denies a misfit of the test trials -> verdict that does not."""
NOMINAL_MODEL, BASE_MODEL, FINAL_MODEL = "the declared numbers", "the refitted numbers", "the added effects"
"""Models that are evaluated."""
RECOMMENDATIONS: Mapping[RecommendedDevice, str] = {
    "without-effects": "The refitted device without effects is the one that is recommended.",
    "as-declared": "The device as declared is the one that is recommended.",
}
"""Device that predicts the test trials better than the one with effects -> sentence that recommends it."""


def evaluate_held_out(diagnosis: Diagnosis, data: WeightedData) -> None:
    """Set the residuals of ``diagnosis`` on its test trials, and demote a verdict that they do not confirm.

    An adequate model must take most of the gap beyond noise, and its effects must act there. A model of an imperfect
    law must take at least half of the share there that it takes of the trials that were left out. Nothing is missing,
    and a model is adequate, only if the repeats of test trials share no large misfit, or none once the numbers are
    fitted to these trials as well. Where the simulation of a test trial diverges, the prediction of this trial failed.
    Quantized channels are named where nothing else is missing. ``data`` hold the fitted trials with the noise between
    repeats.
    """
    evaluated, residuals = _compute_residuals(diagnosis, data)
    if diagnosis.evaluated_on == "test":
        misfits = _select_unseen(diagnosis, estimate_misfit(evaluated.experiments, residuals, data.noise))
        if misfits and claims_no_misfit(diagnosis, evaluated):
            record_test_misfit(
                diagnosis,
                misfits,
                estimate_validation_misfits(diagnosis, data),
                is_absorbed=can_refit_explain_all(diagnosis, data, evaluated.experiments),
            )
        if diagnosis.added_terms:
            record_confirmation(
                diagnosis,
                is_exercised=exercises_effects(diagnosis, evaluated, residuals),
                leaves_more=leaves_more_than_in_fit(diagnosis),
            )
    record_divergence(diagnosis)
    if diagnosis.evaluated_on == "test" and NOMINAL_MODEL not in diagnosis.diverged_trials:
        record_declared_advantage(diagnosis)
    if diagnosis.recommended_device in RECOMMENDATIONS:
        diagnosis.reasons.append(RECOMMENDATIONS[diagnosis.recommended_device])
    if diagnosis.verdict == "unexplained":  # proxies have no alternatives
        diagnosis.equivalent_models, diagnosis.direct_measurements, diagnosis.next_experiment = [], [], None
    if diagnosis.quantizers and diagnosis.verdict == "nothing-missing":  # beside them
        diagnosis.verdict = "identified"


def record_divergence(diagnosis: Diagnosis) -> None:
    """State which test trials cannot be simulated; a verdict whose model cannot simulate one is `unexplained`.

    Where only the model without effects can, it is the one that is recommended.
    """
    if not diagnosis.diverged_trials:
        return
    by_trials: dict[tuple[str, ...], list[str]] = {}
    for model, names in diagnosis.diverged_trials.items():
        by_trials.setdefault(names, []).append(model)
    clauses = [f"of {', '.join(map(repr, names))} with {' and with '.join(m)}" for names, m in by_trials.items()]
    diagnosis.reasons.insert(
        0,
        f"The simulation {'; and '.join(clauses)} diverges: the prediction of such a test trial failed, and the gap "
        "leaves it out. Look for what sets it apart (loads, stops, pressures), or give it to the fit as well.",
    )
    failures = set(diagnosis.diverged_trials.get(FINAL_MODEL if diagnosis.added_terms else BASE_MODEL, ()))
    if not failures:
        return
    diagnosis.verdict = "unexplained"
    if diagnosis.added_terms:
        diagnosis.held_out = "not-confirmed"
        if failures - set(diagnosis.diverged_trials.get(BASE_MODEL, ())):
            diagnosis.is_worse_on_test = True


def _select_unseen(diagnosis: Diagnosis, misfits: Mapping[str, Misfit]) -> dict[str, Misfit]:
    """Return the misfits of the test trials that are too large for a model which explains the other trials."""
    return {
        channel: misfit
        for channel, misfit in misfits.items()
        if is_significant(misfit)
        and misfit.rms > MAX_UNSEEN_MISFIT * misfit.noise_rms
        and misfit.rms > diagnosis.dataset.tolerance.get(channel, 0.0)
    }


def claims_no_misfit(diagnosis: Diagnosis, evaluated: WeightedData) -> bool:
    """Return whether the verdict of ``diagnosis`` says that its model reaches the noise, and no other model does so.

    `indistinguishable` stays where one of the equivalent models that reach the noise explains the ``evaluated`` trials,
    or where the best model did not reach the noise on the fitted trials either.
    """
    if diagnosis.verdict != "indistinguishable":
        return diagnosis.verdict in DEMOTED_VERDICTS
    if diagnosis.prediction is not None or _has_misfit_of_fitted_trials(diagnosis):
        return False
    adequate = [model for model in diagnosis.equivalent_models if model.reaches_noise]
    return all(_leaves_misfit(diagnosis, evaluated, model.fit) for model in adequate)


def _has_misfit_of_fitted_trials(diagnosis: Diagnosis) -> bool:
    """Return whether the final model leaves a relevant misfit in the fitted trials."""
    assert diagnosis.final_fit is not None
    misfits = estimate_misfit(diagnosis.fitted_experiments, diagnosis.final_fit.residuals, diagnosis.noise)
    tolerance = diagnosis.dataset.tolerance
    return any(is_significant(misfit) and misfit.rms > tolerance.get(name, 0.0) for name, misfit in misfits.items())


def _leaves_misfit(diagnosis: Diagnosis, evaluated: WeightedData, fit: Fit) -> bool:
    """Return whether ``fit`` leaves a large misfit in the ``evaluated`` trials, or diverges in one of them."""
    residuals = evaluated.compute_residuals(fit.hypothesis, [fit.x], may_diverge=True)[0]
    if not all(np.isfinite(values).all() for row in residuals for values in row.values()):
        return True
    return bool(_select_unseen(diagnosis, estimate_misfit(evaluated.experiments, residuals, evaluated.noise)))


def can_refit_explain_all(diagnosis: Diagnosis, data: WeightedData, test_experiments: Sequence[Experiment]) -> bool:
    """Return whether the final model explains all trials to the noise once it is fitted to all of them.

    Then the fitted trials do not determine its parameters well enough for the test trials, and nothing speaks against
    the model. ``data`` hold the fitted trials.
    """
    assert diagnosis.final_fit is not None
    experiments = [*data.experiments, *test_experiments]
    fit = fit_hypothesis(
        data.with_experiments(experiments), diagnosis.final_fit.hypothesis, diagnosis.final_fit.x, fine=True
    )
    parts = (slice(len(data.experiments)), slice(len(data.experiments), None))
    misfits = [estimate_misfit(experiments[part], fit.residuals[part], data.noise) for part in parts]
    tolerance = diagnosis.dataset.tolerance
    return not any(
        is_significant(misfit) and misfit.rms > tolerance.get(channel, 0.0)
        for part in misfits
        for channel, misfit in part.items()
    )


def estimate_validation_misfits(diagnosis: Diagnosis, data: WeightedData) -> dict[str, Misfit]:
    """Return the misfits of the validation trials that are too large for a model which explains the fitted trials.

    Trials in which the simulation diverges are left out. ``data`` hold the fitted trials.
    """
    assert diagnosis.final_fit is not None
    experiments = [e for e in diagnosis.experiments if e.use == "validation" and e.measured]
    fit = diagnosis.final_fit
    residuals = data.with_experiments(experiments).compute_residuals(fit.hypothesis, [fit.x], may_diverge=True)[0]
    rows = [
        (e, row)
        for e, row in zip(experiments, residuals, strict=True)
        if all(np.isfinite(values).all() for values in row.values())
    ]
    misfits = estimate_misfit([e for e, _ in rows], [row for _, row in rows], data.noise) if rows else {}
    return _select_unseen(diagnosis, misfits)


def record_test_misfit(
    diagnosis: Diagnosis,
    misfits: Mapping[str, Misfit],
    validation_misfits: Mapping[str, Misfit] = MappingProxyType({}),
    *,
    is_absorbed: bool,
) -> None:
    """Demote a verdict that denies the ``misfits`` of the test trials, unless the numbers absorb them.

    The sentence says whether the trials for validation show the misfit as well. One effect may be a part of what is
    missing. Several that reach the noise together on the fitted trials alone have adapted to these.
    """
    channel = max(misfits, key=lambda name: misfits[name].rms / misfits[name].noise_rms)
    ratio = misfits[channel].rms / misfits[channel].noise_rms
    observation = f"All repeats of '{channel}' in the test trials show a misfit of {ratio:.2f} times the noise"
    if is_absorbed:
        diagnosis.reasons.append(
            f"{observation} with the fitted parameters, and none if these are fitted to them as well: the other trials "
            "do not determine the parameters well enough. Set use = 'fit' for some of them."
        )
        return
    has_adapted = diagnosis.verdict == "identified" and len(diagnosis.added_terms) > 1
    diagnosis.verdict = "unexplained" if has_adapted else DEMOTED_VERDICTS[diagnosis.verdict]
    comparison = "which the other trials do not show: the test trials may cover conditions that no other trial covers"
    if channel in validation_misfits:
        other = validation_misfits[channel]
        comparison = (
            f"those for validation {other.rms / other.noise_rms:.2f} times, which the fitted trials do not show: they "
            "may not cover these conditions"
        )
    sentence = f"{observation}, {comparison}. Set use = 'fit' for some of them."
    if has_adapted:
        sentence += " Several effects that explain the fitted trials alone are proxies of what is missing."
    diagnosis.reasons.insert(0, sentence)


def _compute_residuals(diagnosis: Diagnosis, data: WeightedData) -> tuple[WeightedData, Residuals]:
    """Set the residuals of each channel on the test trials, or on the fitted trials where none can be simulated.

    Returns these trials, and their residuals of the final fit.
    """
    assert diagnosis.base_fit is not None
    assert diagnosis.final_fit is not None
    nominal, base_fit, final_fit = diagnosis.base_fit.hypothesis, diagnosis.base_fit, diagnosis.final_fit
    models = {
        NOMINAL_MODEL: (nominal, nominal.initial_point()),
        BASE_MODEL: (base_fit.hypothesis, base_fit.x),
        FINAL_MODEL: (final_fit.hypothesis, final_fit.x),  # equals that before without added effects
    }
    diagnosis.evaluated_on = "test"
    test_data = data.with_experiments(diagnosis.evaluated_experiments)
    by_model = {
        model: test_data.compute_residuals(hypothesis, [x], may_diverge=True)[0]
        for model, (hypothesis, x) in models.items()
    }
    diagnosis.diverged_trials = _find_diverged_trials(test_data.experiments, by_model)
    if not diagnosis.added_terms:
        diagnosis.diverged_trials.pop(FINAL_MODEL, None)
    evaluated = data.with_experiments(diagnosis.evaluated_experiments)
    names = {e.name for e in evaluated.experiments}
    residuals = [
        [row for e, row in zip(test_data.experiments, rows, strict=True) if e.name in names]
        for rows in by_model.values()
    ]
    if not evaluated.experiments:
        diagnosis.evaluated_on, evaluated = "fit", data
        residuals = [evaluated.compute_residuals(hypothesis, [x])[0] for hypothesis, x in models.values()]
    noise = data.noise if data_quality.has_repeats(data.experiments) else {}
    unscaled = [replace(e, noise_scale={}) for e in evaluated.experiments]
    noise = {**noise, **repeats.estimate_noise_from_repeats(unscaled, residuals[2])}
    fast_noise = estimate_fast_noise(evaluated.experiments, residuals[2])
    for channel in repeats.list_channels(evaluated.experiments):
        # Samples after which the inputs are unknown count less, as in the fit.
        weights = np.concatenate(
            [
                np.broadcast_to(1.0 / e.input_error_scale.get(channel, np.ones(1)) ** 2, len(e.measured[channel].time))
                for e in evaluated.experiments
                if channel in e.measured
            ]
        )
        squares = [
            np.concatenate([trial[channel] for trial in trials if channel in trial]) ** 2 for trials in residuals
        ]
        rms = [float(np.sqrt(np.average(each, weights=weights))) for each in squares]
        diagnosis.channel_rms[channel] = ChannelRms(
            nominal=rms[0],
            refitted=rms[1],
            with_effects=rms[2],
            noise_floor=noise[channel].std if channel in noise else None,
            nominal_unweighted=float(np.sqrt(np.mean(squares[0]))) if np.ptp(weights) else None,
            fast_noise=fast_noise.get(channel),
        )
    return evaluated, residuals[2]


def _find_diverged_trials(
    experiments: Sequence[Experiment], residuals: Mapping[str, Residuals]
) -> dict[str, tuple[str, ...]]:
    """Return model -> names of the trials whose ``residuals`` (by model) are infinite."""
    diverged = {
        model: tuple(
            e.name
            for e, row in zip(experiments, rows, strict=True)
            if not all(np.isfinite(values).all() for values in row.values())
        )
        for model, rows in residuals.items()
    }
    return {model: names for model, names in diverged.items() if names}
