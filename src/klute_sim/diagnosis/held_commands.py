"""Course of the commands between their logged samples: straight lines, or values that a controller holds."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from klute_sim.diagnosis.data_quality import has_repeats
from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.final_model import FinalModel
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.misfit import estimate_misfit, is_significant
from klute_sim.diagnosis.noise.repeats import Noise
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.refits import refit_without_term
from klute_sim.types import ProgressCallback

TIME_SHIFTS = frozenset({"clock_skew", "pressure_delay"})
"""Effects that shift a channel or the command in time, as another course of the command between its samples does."""
MAX_HELD_RESIDUAL_FRACTION = 0.5
"""Part of the mean square that linear commands leave in pressures without repeats, which held ones may leave
(assumed)."""
MAX_HELD_RESIDUAL_RATIO = 1.1
"""Mean square that held commands alone may leave there, over that of linear ones with all names (assumed)."""
MAX_LOST_SHIFT_FRACTION = 0.1
"""Part of what a shift in time gains by which held commands without it may explain less (assumed: a delay can be
adjusted, and follows a step that is not exactly at a sample better than a held command does)."""
HELD_REMARK = (
    "The commands are taken as held until their next sample; straight lines between samples act up to a sampling "
    "interval earlier"
)
"""Beginning of the remark on held commands."""


class Preparation(NamedTuple):
    """Trials before any search, for one course of the commands between their samples."""

    experiments: list[Experiment]
    """All trials."""
    data: WeightedData
    """The fitted trials."""
    base_fit: Fit
    """Fit without added effects."""
    remarks: list[str]
    """What to say of trials that count less."""


class Outcome(NamedTuple):
    """The model that was selected, for one course of the commands between their samples."""

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
    "The commands of trials in which they change in steps are taken as held until their next sample; those of the "
    "other trials are linear between samples"
)
"""Beginning of the remark where commands are held in some trials only."""
AGREEMENT = "and the measured pressure agrees with held ones only."
"""End of a remark where measured pressures decide."""
GAUGE_EFFECTS = "sensor_gain", "sensor_offset"
"""Faults of a gauge that must not hide which course of the commands the pressures agree with."""
SUPPLY_TERMS = (EffectTerm("pressure_delay", "dead_time"), EffectTerm("pressure_lag", "first_order"))
"""Effects of the supply that must not hide it."""
COURSE_MAX_NFEV = 25
"""Largest number of evaluations of the residuals of a fit with these (assumed: with 10, a dead time and a lag had not
converged in one dataset)."""


def prepare_held_commands(
    linear: Preparation, prepare: Callable[[list[Experiment]], Preparation]
) -> tuple[Preparation, str] | None:
    """Return the trials with held commands, and a remark, if repeats of measured pressures agree with those only.

    They decide before any search: :func:`select_command_course` would choose held commands whatever is named. Commands
    may also be held only in trials in which they change in steps: a program sets a step at a sample of its log, and a
    smooth course between the samples, too. None where commands are linear, or the pressures do not decide. A wrong
    gauge, or a late supply, leaves a misfit for every course. So where no course agrees, the courses are compared with
    :data:`GAUGE_EFFECTS` and :data:`SUPPLY_TERMS`.
    """
    if not has_repeats(linear.data.experiments) or not _has_held_variants(linear.experiments):
        return None
    if not _has_misfit(linear.data, linear.base_fit):
        return None
    changing = [e for e in linear.experiments if e.held_variant]
    courses = [(prepare([e.held_variant or e for e in linear.experiments]), f"{HELD_REMARK}, {AGREEMENT}")]
    if _is_pressure_explained_by_course(linear, courses[0][0]):
        return courses[0]
    if any(e.has_stepped_command for e in changing) and not all(e.has_stepped_command for e in changing):
        stepped = prepare([(e.held_variant or e) if e.has_stepped_command else e for e in linear.experiments])
        courses.append((stepped, f"{STEPS_REMARK}, {AGREEMENT}"))
        if _is_pressure_explained_by_course(linear, stepped):
            return courses[1]
    extended = _fit_gauges_and_supply(linear)
    if not _has_misfit(extended.data, extended.base_fit):  # linear commands agree as well
        return None
    return next((c for c in courses if _is_pressure_explained_by_course(extended, _fit_gauges_and_supply(c[0]))), None)


def _fit_gauges_and_supply(prepared: Preparation) -> Preparation:
    """Return ``prepared`` with a fit of its pressures with gains and zeros of all gauges, a dead time and a lag.

    Of the uncertain numbers, only those of the supply are fitted; the pressure hardly depends on others.
    """
    data, device = prepared.data, prepared.base_fit.hypothesis
    pressures = replace(data, noise=_select_pressure_noise(data), cache=None)
    supply = tuple((key, std) for key, std in device.uncertainties if key.rpartition("/")[2].startswith("supply."))
    gauges = (EffectTerm(effect, "linear", name) for name in pressures.noise for effect in GAUGE_EFFECTS)
    hypothesis = replace(device, uncertainties=supply, registration=(), terms=(*device.terms, *gauges, *SUPPLY_TERMS))
    return prepared._replace(base_fit=fit_hypothesis(pressures, hypothesis, max_nfev=COURSE_MAX_NFEV))


def _has_held_variants(experiments: list[Experiment]) -> bool:
    return any(e.held_variant for e in experiments if e.use == "fit" and e.measured)


def select_command_course(
    linear: Outcome,
    prepare: Callable[[list[Experiment]], Preparation],
    search_model: Callable[[Preparation], Outcome],
    progress: ProgressCallback,
) -> tuple[Outcome, list[str]]:
    """Return the outcome with linear or with held commands, whichever explains the data better, and what to say of it.

    A delay of up to a sampling interval of the command may be a course of the command between its samples. ``linear``
    is the outcome with linear commands. Held ones are tried where they reduce the misfit of its device without effects,
    where it names a shift in time, and where it leaves a misfit of a pressure: a large effect, or a wrong rate of the
    supply, can hide that they fit better. With linear commands, samples that depend on their course have a smaller
    weight. With held ones none has, so the two are compared with the weights of held commands. No model is searched
    with held commands where the names found with linear ones, no shift among them, explain the data worse with held
    ones and leave no misfit of a pressure.

    Held commands are chosen, whatever is named, if the measured pressures agree with them and not with linear ones:
    without any name, or with all names of either outcome, unless held commands need a further shift in time.
    """
    if not _has_held_variants(linear.experiments):
        return linear, []
    experiments = [e.held_variant or e for e in linear.experiments]
    fitted = [e for e in experiments if e.use == "fit" and e.measured]
    has_less_misfit = _compute_chi2(linear.data.with_experiments(fitted), linear.base_fit) <= linear.base_fit.chi2
    is_doubtful = linear.n_time_shifts > 0 or _has_misfit(linear.data, linear.selected.final_fit)
    if not (has_less_misfit or is_doubtful):
        return linear, []
    progress(0.2, "fitting with commands that are held until the next sample")
    prepared = prepare(experiments)
    linear_bic = linear.compute_bic(_copy_weights(linear.data, prepared.data))
    is_less_left = _is_less_left_by_course(linear, prepared)
    if (
        not (is_doubtful or is_less_left)
        and linear.compute_bic(prepared.data) > linear_bic + linear.search.bic_threshold
    ):
        return linear, []
    held = search_model(prepared)
    difference = linear_bic - held.compute_bic(held.data)
    has_further_shift = held.n_time_shifts > linear.n_time_shifts
    is_decided = _is_pressure_explained_by_course(linear, held) or is_less_left
    if is_decided or (not has_further_shift and _is_pressure_explained_by_names(linear, held)):
        return held, [f"{HELD_REMARK}, {AGREEMENT}"]
    # What the course of the command explains as well needs no name, a shift in time least of all.
    if has_further_shift or held.selected.verdict == "unexplained" != linear.selected.verdict:
        return linear, []
    has_fewer_names = len(held.terms) < len(linear.terms)
    # An imperfect law leaves more than the course of the command does, so BIC cannot tell which course is right.
    needs_fewer_names = held.selected.prediction is not None
    if needs_fewer_names and not has_fewer_names and held.n_time_shifts == linear.n_time_shifts:
        return linear, []
    min_difference = (-1.0 if has_fewer_names else 1.0) * linear.search.bic_threshold
    if has_fewer_names and held.n_time_shifts < linear.n_time_shifts:
        min_difference = min(min_difference, -MAX_LOST_SHIFT_FRACTION * linear.compute_shift_gain())
    if not difference > min_difference:
        return linear, []
    more_names = " and more names" if difference < 0.0 else ""
    return held, [f"{HELD_REMARK}, and with them{more_names} BIC changes by {difference:+.0f}."]


def _is_pressure_explained_by_course(linear: Preparation | Outcome, held: Preparation | Outcome) -> bool:
    """Return whether repeats of the measured pressures show a misfit with linear commands, and none with held ones.

    Nothing is named in either. The law of the muscle is not in a pressure, so that it decides where an imperfect law
    leaves a misfit of the force for either course.
    """
    if not _select_pressure_noise(held.data) or not has_repeats(held.data.experiments):
        return False
    is_left = _has_misfit(held.data, held.base_fit)
    return not is_left and _has_misfit(_copy_weights(linear.data, held.data), linear.base_fit)


def _is_less_left_by_course(linear: Outcome, held: Preparation) -> bool:
    """Return whether held commands alone leave far less in pressures without repeats than linear ones do.

    Nor may they leave more than linear commands with all names do.
    """
    noise = _select_pressure_noise(held.data)
    if not noise or has_repeats(held.data.experiments):
        return False
    left = _compute_mean_square(held.data, held.base_fit, noise)
    is_far_less = left < MAX_HELD_RESIDUAL_FRACTION * _compute_mean_square(linear.data, linear.base_fit, noise)
    return is_far_less and left <= MAX_HELD_RESIDUAL_RATIO * _compute_mean_square(
        linear.data, linear.selected.final_fit, noise
    )


def _is_pressure_explained_by_names(linear: Outcome, held: Outcome) -> bool:
    """Return whether the names explain the measured pressures with held commands, and not with linear ones.

    Linear commands must leave a misfit without names, too: proxies for another effect may disturb the pressures.
    """
    if not _has_misfit(_copy_weights(linear.data, held.data), linear.base_fit):
        return False
    return _has_misfit(linear.data, linear.selected.final_fit) and not _has_misfit(held.data, held.selected.final_fit)


def _select_pressure_noise(data: WeightedData) -> dict[str, Noise]:
    return {name: value for name, value in data.noise.items() if name.startswith("pressure")}


def _has_misfit(data: WeightedData, fit: Fit) -> bool:
    """Return whether repeats of ``data`` show a misfit of ``fit`` in a measured pressure."""
    noise = _select_pressure_noise(data)
    if not noise:
        return False
    residuals = data.compute_residuals(fit.hypothesis, [fit.x])[0]
    return any(map(is_significant, estimate_misfit(data.experiments, residuals, noise).values()))


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
