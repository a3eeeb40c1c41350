"""Interpolation of the commands between their logged samples: linear, or a zero-order hold of a controller."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from klute_sim.diagnosis.command_delay import has_pressure_misfit, select_pressure_noise
from klute_sim.diagnosis.data_quality import has_repeats
from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.final_model import FinalModel
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.repeats import Noise
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.refits import refit_without_term
from klute_sim.types import ProgressCallback

TIME_SHIFTS = frozenset({"clock_skew", "pressure_delay"})
"""Effects that shift a channel or the command in time, as another interpolation of the command does."""
MAX_HOLD_RESIDUAL_FRACTION = 0.5
"""Largest mean square residual of pressures without repeats with a zero-order hold, over that with linear interpolation
(assumed)."""
MAX_HOLD_RESIDUAL_RATIO = 1.1
"""Largest mean square residual of these pressures with a zero-order hold alone, over that with linear interpolation and
all names (assumed)."""
MAX_LOST_SHIFT_FRACTION = 0.1
"""Part of what a shift in time gains by which a zero-order hold without it may explain less (assumed: a delay can be
adjusted, and follows a step that is not exactly at a sample better than a zero-order hold does)."""
ZERO_ORDER_HOLD_REMARK = (
    "The commands are taken as held until their next sample (zero-order hold); linear interpolation acts up to a "
    "sampling interval earlier"
)
"""Beginning of the remark on a zero-order hold."""


class Preparation(NamedTuple):
    """Trials before any search, for one interpolation of the commands."""

    experiments: list[Experiment]
    """All trials."""
    data: WeightedData
    """The fitted trials."""
    base_fit: Fit
    """Fit without added effects."""
    remarks: list[str]
    """What to say of trials that count less."""


class Outcome(NamedTuple):
    """The model that was selected, for one interpolation of the commands."""

    experiments: list[Experiment]
    """All trials."""
    data: WeightedData
    """The fitted trials."""
    search: ForwardSelection
    """The search for effects."""
    base_fit: Fit
    """Fit without added effects."""
    selected: FinalModel
    """The selected model."""
    remarks: list[str]
    """What to say of trials that count less."""

    @property
    def terms(self) -> tuple[EffectTerm, ...]:
        """Added terms."""
        return self.selected.final_fit.hypothesis.terms

    @property
    def n_time_shifts(self) -> int:
        """Number of terms that shift a command or a channel in time."""
        return sum(term.effect in TIME_SHIFTS for term in self.terms)

    def compute_bic(self, data: WeightedData) -> float:
        """Return the Bayesian information criterion of the final model, fitted to ``data``."""
        final = self.selected.final_fit
        return fit_hypothesis(data, final.hypothesis, final.x).bic(data.n_effective)

    def compute_shift_gain(self) -> float:
        """Return the fall of the Bayesian information criterion by the shifts in time beside the other names."""
        final = fit = self.selected.final_fit
        for term in self.terms:
            if term.effect in TIME_SHIFTS:
                fit = refit_without_term(self.data, fit, term)
        return fit.bic(self.data.n_effective) - final.bic(self.data.n_effective)


STEPS_REMARK = (
    "The commands of trials in which they change in steps are taken as held until their next sample (zero-order hold); "
    "those of the other trials are interpolated linearly"
)
"""Beginning of the remark where only some trials have a zero-order hold."""
PRESSURE_AGREEMENT_REMARK = "and the measured pressure agrees with the zero-order hold only."
"""End of a remark where measured pressures decide."""
GAUGE_EFFECTS = "sensor_gain", "sensor_offset"
"""Faults of a gauge that must not hide which interpolation of the commands the pressures agree with."""
DELAY_TERM = EffectTerm("pressure_delay", "dead_time")
"""Delay of the supply."""
SUPPLY_TERMS = (DELAY_TERM, EffectTerm("pressure_lag", "first_order"))
"""Effects of the supply that must not hide a zero-order hold."""
SUPPLY_FIT_MAX_NFEV = 25
"""Largest number of evaluations of the residuals of a fit with effects of the supply (assumed: with 10, a dead time and
a lag had not converged in one dataset)."""


def prepare_zero_order_hold(
    linear: Preparation, prepare: Callable[[list[Experiment]], Preparation]
) -> tuple[Preparation, str] | None:
    """Return the trials with a zero-order hold, and a remark, if repeats of measured pressures agree with that only.

    They decide before any search: :func:`select_command_interpolation` would choose the zero-order hold whatever is
    named. It may also apply only to trials whose commands change in steps: a program sets a step at a sample of its
    log, and a smooth command between the samples, too. None where interpolation is linear, or the pressures do not
    decide. A wrong gauge, or a late supply, leaves a misfit for every interpolation. So where no interpolation agrees,
    they are compared with :data:`GAUGE_EFFECTS` and :data:`SUPPLY_TERMS`.
    """
    if not has_repeats(linear.data.experiments) or not _has_zero_order_hold_variants(linear.experiments):
        return None
    if not has_pressure_misfit(linear.data, linear.base_fit):
        return None
    changing = [e for e in linear.experiments if e.zero_order_hold_variant]
    preparations = [
        (
            prepare([e.zero_order_hold_variant or e for e in linear.experiments]),
            f"{ZERO_ORDER_HOLD_REMARK}, {PRESSURE_AGREEMENT_REMARK}",
        )
    ]
    if _is_pressure_explained_by_hold(linear, preparations[0][0]):
        return preparations[0]
    if any(e.has_stepped_command for e in changing) and not all(e.has_stepped_command for e in changing):
        stepped = prepare(
            [(e.zero_order_hold_variant or e) if e.has_stepped_command else e for e in linear.experiments]
        )
        preparations.append((stepped, f"{STEPS_REMARK}, {PRESSURE_AGREEMENT_REMARK}"))
        if _is_pressure_explained_by_hold(linear, stepped):
            return preparations[1]
    extended = _fit_gauges_and_supply(linear)
    if not has_pressure_misfit(extended.data, extended.base_fit):  # linear interpolation agrees as well
        return None
    return next(
        (c for c in preparations if _is_pressure_explained_by_hold(extended, _fit_gauges_and_supply(c[0]))), None
    )


def _fit_gauges_and_supply(prepared: Preparation) -> Preparation:
    """Return ``prepared`` with a fit of its pressures with gains and zeros of all gauges, a dead time and a lag.

    A dead time or a lag that the device file declares stays as it is. Of the uncertain numbers, only those of the
    supply are fitted; the pressure hardly depends on others.
    """
    data, device = prepared.data, prepared.base_fit.hypothesis
    pressures = replace(data, noise=select_pressure_noise(data), cache=None)
    supply = tuple((key, std) for key, std in device.uncertainties if key.rpartition("/")[2].startswith("supply."))
    gauges = (EffectTerm(effect, "linear", name) for name in pressures.noise for effect in GAUGE_EFFECTS)
    delays = (term for term in SUPPLY_TERMS if device.device.spec.can_add_effect(term.effect_definition))
    hypothesis = replace(device, uncertainties=supply, registration=(), terms=(*device.terms, *gauges, *delays))
    return prepared._replace(base_fit=fit_hypothesis(pressures, hypothesis, max_nfev=SUPPLY_FIT_MAX_NFEV))


def _has_zero_order_hold_variants(experiments: list[Experiment]) -> bool:
    return any(e.zero_order_hold_variant for e in experiments if e.use == "fit" and e.measured)


def select_command_interpolation(
    linear: Outcome,
    prepare: Callable[[list[Experiment]], Preparation],
    search_model: Callable[[Preparation], Outcome],
    progress: ProgressCallback,
) -> tuple[Outcome, list[str]]:
    """Return the outcome with linear interpolation or a zero-order hold, whichever explains the data better.

    Its remarks follow. A delay of up to a sampling interval of the command may be another interpolation of it.
    ``linear`` is the outcome with linear interpolation. A zero-order hold is tried where it reduces the misfit of the
    device of ``linear`` without effects, where ``linear`` names a shift in time, and where it leaves a misfit of a
    pressure: a large effect, or a wrong rate of the supply, can hide that a zero-order hold fits better. With linear
    interpolation, samples that depend on the interpolation have a smaller weight. With a zero-order hold none has, so
    the two are compared with the weights of the zero-order hold. No model is searched with a zero-order hold where the
    names found with linear interpolation, no shift among them, explain the data worse with it and leave no misfit of a
    pressure.

    A zero-order hold is chosen, whatever is named, if the measured pressures agree with it and not with linear
    interpolation: without any name, or with all names of either outcome, unless it needs a further shift in time.
    Linear interpolation remains where it explains all data to the noise with a shift in time, and better: pressures
    that are half a sampling interval late agree with a zero-order hold, too.
    """
    if not _has_zero_order_hold_variants(linear.experiments):
        return linear, []
    experiments = [e.zero_order_hold_variant or e for e in linear.experiments]
    fitted = [e for e in experiments if e.use == "fit" and e.measured]
    has_less_misfit = _compute_chi2(linear.data.with_experiments(fitted), linear.base_fit) <= linear.base_fit.chi2
    is_doubtful = linear.n_time_shifts > 0 or has_pressure_misfit(linear.data, linear.selected.final_fit)
    if not (has_less_misfit or is_doubtful):
        return linear, []
    progress(0.2, "fitting with a zero-order hold of the commands")
    prepared = prepare(experiments)
    linear_bic = linear.compute_bic(_copy_weights(linear.data, prepared.data))
    is_less_left = _is_less_left_by_hold(linear, prepared)
    if (
        not (is_doubtful or is_less_left)
        and linear.compute_bic(prepared.data) > linear_bic + linear.search.bic_threshold
    ):
        return linear, []
    hold = search_model(prepared)
    difference = linear_bic - hold.compute_bic(hold.data)
    if _is_explained_by_shift(linear, difference):
        return linear, []
    has_further_shift = hold.n_time_shifts > linear.n_time_shifts
    is_decided = _is_pressure_explained_by_hold(linear, hold) or is_less_left
    if is_decided or (not has_further_shift and _is_pressure_explained_by_names(linear, hold)):
        return hold, [f"{ZERO_ORDER_HOLD_REMARK}, {PRESSURE_AGREEMENT_REMARK}"]
    # What the interpolation of the command explains as well needs no name, a shift in time least of all.
    if has_further_shift or hold.selected.verdict == "unexplained" != linear.selected.verdict:
        return linear, []
    has_fewer_names = len(hold.terms) < len(linear.terms)
    # An imperfect law leaves more than the interpolation does, so BIC cannot tell which interpolation is right.
    needs_fewer_names = hold.selected.prediction is not None
    if needs_fewer_names and not has_fewer_names and hold.n_time_shifts == linear.n_time_shifts:
        return linear, []
    min_difference = (-1.0 if has_fewer_names else 1.0) * linear.search.bic_threshold
    if has_fewer_names and hold.n_time_shifts < linear.n_time_shifts:
        min_difference = min(min_difference, -MAX_LOST_SHIFT_FRACTION * linear.compute_shift_gain())
    if not difference > min_difference:
        return linear, []
    more_names = " and more names" if difference < 0.0 else ""
    return hold, [f"{ZERO_ORDER_HOLD_REMARK}; with linear interpolation{more_names}, BIC changes by {difference:+.0f}."]


def reconsider_linear_interpolation(
    hold: Outcome, linear: Preparation, search_model: Callable[[Preparation], Outcome]
) -> Outcome:
    """Return ``hold``, or the outcome with linear interpolation where only that explains the data to the noise.

    The pressures alone chose the zero-order hold (:func:`prepare_zero_order_hold`), and half a sampling interval late
    they look the same: a late gauge, or a delay of the supply. So where something is missing with the zero-order hold,
    and one shift in time of linear commands explains more than the hold without any name does, a model is searched with
    linear interpolation (:func:`_is_explained_by_shift`).
    """
    if hold.selected.verdict == "nothing-missing":
        return hold
    data, threshold = _copy_weights(linear.data, hold.data), hold.search.bic_threshold
    gauges = (EffectTerm("clock_skew", "linear", channel) for channel in select_pressure_noise(data))
    shifted = (linear.base_fit.hypothesis.with_term(term) for term in (DELAY_TERM, *gauges))
    best_bic = min(fit_hypothesis(data, hypothesis).bic(data.n_effective) for hypothesis in shifted)
    if best_bic > hold.base_fit.bic(hold.data.n_effective) - threshold:
        return hold
    outcome = search_model(linear)
    difference = outcome.compute_bic(data) - hold.compute_bic(hold.data)
    return outcome if _is_explained_by_shift(outcome, difference) else hold


def _is_explained_by_shift(linear: Outcome, difference: float) -> bool:
    """Return whether linear commands with a shift in time leave no misfit, and explain more than a zero-order hold.

    ``difference`` is the Bayesian information criterion of ``linear`` minus that with the zero-order hold.
    """
    explains_data = linear.selected.verdict in ("identified", "indistinguishable")
    if not explains_data or linear.selected.prediction is not None or not linear.n_time_shifts:
        return False
    return difference < -max(linear.search.bic_threshold, MAX_LOST_SHIFT_FRACTION * linear.compute_shift_gain())


def _is_pressure_explained_by_hold(linear: Preparation | Outcome, hold: Preparation | Outcome) -> bool:
    """Return whether repeats of the measured pressures show a misfit with linear commands, none with a zero-order hold.

    Nothing is named in either. The law of the muscle is not in a pressure, so that it decides where an imperfect law
    leaves a misfit of the force for either interpolation.
    """
    if not select_pressure_noise(hold.data) or not has_repeats(hold.data.experiments):
        return False
    is_left = has_pressure_misfit(hold.data, hold.base_fit)
    return not is_left and has_pressure_misfit(_copy_weights(linear.data, hold.data), linear.base_fit)


def _is_less_left_by_hold(linear: Outcome, hold: Preparation) -> bool:
    """Return whether a zero-order hold alone leaves far less in pressures without repeats than linear interpolation.

    Nor may it leave more than linear interpolation with all names does.
    """
    noise = select_pressure_noise(hold.data)
    if not noise or has_repeats(hold.data.experiments):
        return False
    left = _compute_mean_square(hold.data, hold.base_fit, noise)
    is_far_less = left < MAX_HOLD_RESIDUAL_FRACTION * _compute_mean_square(linear.data, linear.base_fit, noise)
    return is_far_less and left <= MAX_HOLD_RESIDUAL_RATIO * _compute_mean_square(
        linear.data, linear.selected.final_fit, noise
    )


def _is_pressure_explained_by_names(linear: Outcome, hold: Outcome) -> bool:
    """Return whether the names explain the measured pressures with a zero-order hold, and not with linear commands.

    Linear interpolation must leave a misfit without names, too: proxies for another effect may disturb the pressures.
    """
    if not has_pressure_misfit(_copy_weights(linear.data, hold.data), linear.base_fit):
        return False
    return has_pressure_misfit(linear.data, linear.selected.final_fit) and not has_pressure_misfit(
        hold.data, hold.selected.final_fit
    )


def _compute_mean_square(data: WeightedData, fit: Fit, noise: Mapping[str, Noise]) -> float:
    """Return the mean square of the residuals of ``fit`` in the channels of ``noise``, over that of the noise [1]."""
    rows = data.compute_residuals(fit.hypothesis, [fit.x])[0]
    ratios = [row[name] / noise[name].std for row in rows for name in noise.keys() & row.keys()]
    return float(np.mean(np.concatenate(ratios) ** 2))


def _copy_weights(data: WeightedData, weighted: WeightedData) -> WeightedData:
    """Return the trials of ``data`` with the noise and the weights of the same trials in ``weighted``; not cached."""
    experiments = [
        replace(
            e, noise_scale=w.noise_scale, input_error_scale=w.input_error_scale, input_noise_share=w.input_noise_share
        )
        for e, w in zip(data.experiments, weighted.experiments, strict=True)
    ]
    return WeightedData(weighted.simulator, experiments, weighted.noise)


def _compute_chi2(data: WeightedData, fit: Fit) -> float:
    """Return chi squared of ``data`` at the parameters of ``fit``; infinite where a simulation diverges."""
    residuals = data.weight_residuals(data.compute_residuals(fit.hypothesis, [fit.x], may_diverge=True)[0])
    priors = data.compute_prior_residuals(fit.hypothesis, fit.x)
    return float(residuals @ residuals + priors @ priors)
