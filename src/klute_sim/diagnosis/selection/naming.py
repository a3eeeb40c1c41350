"""Obstacles to a name: a value at its bound, an impossible part or instrument, a short delay, a coincidence."""

import math
from collections.abc import Iterable, Iterator

import numpy as np

from klute_sim.diagnosis.data_quality import has_repeats
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
from klute_sim.diagnosis.fitting.dependent_numbers import limit_to_valid
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, FitParameter, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import COST_TOLERANCE, Fit
from klute_sim.diagnosis.fitting.number_error import BOUND_SIGMAS, EFFECTS, KEYS_WITHOUT_UPPER_LIMIT
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.misfit import has_misfit
from klute_sim.effects.families import instrument

MAX_INSTRUMENT_FRACTION = 0.1
"""Largest plausible error of an instrument, as a fraction of the range of its channel: gain, offset, and drift over the
longest trial (assumed; a worse instrument is seen in its own calibration)."""
MAX_POSSIBLE_GAIN_ERROR = 0.3
"""Largest error of a gain that an instrument may have at all (assumed: three times :data:`MAX_INSTRUMENT_FRACTION`). A
larger one refutes no other cause: a friction that is declared half too small looks like a load cell that reads
double, and no load cell does."""
MIN_DELAY_INTERVALS = 0.5
"""Shortest lag or shift of a clock that is named, in sampling intervals of its channel or of all channels (median),
whichever is longer (assumed: between logged samples the simulation follows a straight line, whose corners may be off by
as much)."""
MIN_SUFFICIENT_DELAY_INTERVALS = 0.1
"""Shortest lag or shift, in the same intervals, that is named where repeats show no misfit beside it (assumed): an
error of straight lines between samples would remain in other channels."""
MIN_SHORT_DELAY_BIC_FALL = 18.0
"""Smallest fall of BIC by which a lag or shift below :data:`MIN_DELAY_INTERVALS` is named: three times what other names
need (assumed: one of a seventh of an interval completed a simulated law that was not exact, with a fall of 10)."""
IMPLAUSIBLE_REASON = "would be further off than instruments are; check the unit and the calibration of its channel"
"""Reason why a large error of an instrument is not named."""
MAX_INSTRUMENT_DELAY_S = 0.1
"""Longest plausible delay of an instrument [s] (assumed: a filter of 1.6 Hz)."""
DELAY_EFFECTS = frozenset({instrument.SENSOR_LAG.name, instrument.CLOCK_SKEW.name})
"""Faults of an instrument that make its channel late or early, as a filter does; the others are of its calibration."""
MAX_NUMBER_SIGMAS = 3.0
"""Error of a number, in plausible errors, up to which it may be the only name, or the first of equivalent ones
(assumed: a larger one is rarer than an effect that is in no catalogue; simulated numbers were wrong by up to three, and
those that two thick walls imitated by 3.4 and 3.7)."""
PLATEAU_LOG_STEP = math.log(1.5)
"""Relative distance from a bound, as a logarithm, at which chi squared is compared with that at the bound (assumed)."""
MIN_SIGMAS_AT_LIMIT = 2.95
"""Error of an uncertain number, in standard deviations, from which on it is at the limit of its uncertainty, which is
:data:`~klute_sim.diagnosis.fitting.hypothesis.PRIOR_BOUND_SIGMAS` (assumed: a fit may stop just short of it)."""
MIN_COINCIDENT_CAUSES = 3
"""Number of independent causes that a fit alone cannot prove at once: kinds (number, instrument, device, mechanism,
body), or faults of numbers and instruments (assumed: three are rarer than one effect outside the catalogue)."""


def find_naming_obstacle(data: WeightedData, fit: Fit, *, accepts_numbers_at_limit: bool = False) -> str:
    """Return why the terms of ``fit`` may not be named, without a full stop; '' if they may.

    A parameter at its bound says that the effect is something else, or that it is absent; an uncertain number, or the
    registration of a walk, at the limit of its uncertainty says that something else is wrong, unless the caller
    ``accepts_numbers_at_limit`` because the terms do not need it. ``data`` provide the ranges of the channels.
    """
    for term, flaw in find_infeasible_terms(fit).items():
        return f"{term} {flaw}"
    for term, parameter, bound in _iterate_bounds_reached(fit):
        subject = f"{term} is" if term.number else f"{term} has '{parameter.name}'"
        return f"{subject} at its bound, {parameter.denormalize(bound):.4g}"
    numbers = [] if accepts_numbers_at_limit or not fit.hypothesis.terms else find_numbers_at_limit(fit)
    if numbers:
        terms = " and ".join(map(str, fit.hypothesis.terms))
        return f"{terms} would need {numbers[0]} at the limit of its uncertainty"
    implausible = find_implausible_instrument(data, fit)
    if implausible:
        return f"{implausible} {IMPLAUSIBLE_REASON}"
    return next((f"{term} {reason}" for term, reason in find_unresolved_delays(data, fit).items()), "")


def find_infeasible_terms(fit: Fit) -> dict[EffectTerm, str]:
    """Return the terms of ``fit`` whose parameters no part has, each with the reason, without a full stop."""
    flaws = {}
    for term in fit.hypothesis.terms:
        form = term.form_definition
        if form.find_flaw is not None:
            flaws[term] = form.find_flaw(form.pack(_collect_values(fit, term)))
    return {term: flaw for term, flaw in flaws.items() if flaw}


def find_implausible_instrument(data: WeightedData, fit: Fit) -> EffectTerm | None:
    """Return an instrument effect of ``fit`` that is larger than those of working instruments; None without any."""
    for term in fit.hypothesis.terms:
        if term.channel is None or term.effect_definition is instrument.QUANTIZATION:
            continue
        if not _is_plausible_instrument(data, fit, term, term.channel):
            return term
    return None


def has_impossible_instrument(fit: Fit) -> bool:
    """Return whether ``fit`` has a fault of an instrument at its bound, or beyond :data:`MAX_POSSIBLE_GAIN_ERROR`."""
    if any(term.channel is not None for term in find_terms_at_bound(fit)):
        return True
    gains = (term for term in fit.hypothesis.terms if term.effect == instrument.SENSOR_GAIN.name)
    return any(abs(_collect_values(fit, term)["gain"] - 1.0) > MAX_POSSIBLE_GAIN_ERROR for term in gains)


def find_implausible_number(fit: Fit) -> tuple[EffectTerm, float] | None:
    """Return the number of ``fit`` that is further off than all others, and by how many plausible errors.

    Returns None where all are off by at most :data:`MAX_NUMBER_SIGMAS`, not counting increases of
    :data:`KEYS_WITHOUT_UPPER_LIMIT`.
    """
    terms = fit.hypothesis.terms
    errors = [
        (abs(float(x)), terms[parameter.term_index])
        for parameter, x in zip(fit.hypothesis.parameters, fit.x, strict=True)
        if parameter.term_index is not None
        and terms[parameter.term_index].number
        and not (x > 0.0 and parameter.name in KEYS_WITHOUT_UPPER_LIMIT)
    ]
    error, term = max(errors, key=lambda row: row[0], default=(0.0, None))
    return None if term is None or error <= MAX_NUMBER_SIGMAS else (term, error)


def find_unresolved_delays(data: WeightedData, fit: Fit) -> dict[EffectTerm, str]:
    """Return the lags and shifts of instruments that are too short for the sampling of the trials, with the reasons.

    The delays of a channel add up: a filter that is late and a clock that is as early show nothing but their shapes.
    Shorter ones are named where the model with them reaches the noise, unless that includes the error of a law.
    """
    delays = {term: compute_delay(fit, term) for term in fit.hypothesis.terms if term.effect in DELAY_EFFECTS}
    if not delays:
        return {}
    may_reach_noise = has_repeats(data.experiments) and not data.has_law_error
    reaches_noise = may_reach_noise and not has_misfit(data.experiments, fit.residuals, data.noise)
    fraction, limit = (MIN_SUFFICIENT_DELAY_INTERVALS, "a tenth of") if reaches_noise else (MIN_DELAY_INTERVALS, "half")
    reasons = {}
    for term, delay in delays.items():
        shortest = fraction * _find_relevant_interval(data, term.channel)
        if abs(delay) < shortest:
            reasons[term] = f"is shorter than {limit} a sampling interval"
        elif abs(sum(other for one, other in delays.items() if one.channel == term.channel)) < shortest:
            reasons[term] = f"leaves less than {limit} a sampling interval together with the other delay of its channel"
    return reasons


def get_min_bic_fall(data: WeightedData, fit: Fit, term: EffectTerm) -> float:
    """Return the smallest fall of BIC by which ``term`` of ``fit`` is named, beside what any term needs.

    It is :data:`MIN_SHORT_DELAY_BIC_FALL` for a lag or a shift of a clock of less than :data:`MIN_DELAY_INTERVALS`.
    """
    if term.effect not in DELAY_EFFECTS:
        return 0.0
    shortest = MIN_DELAY_INTERVALS * _find_relevant_interval(data, term.channel)
    return MIN_SHORT_DELAY_BIC_FALL if abs(compute_delay(fit, term)) < shortest else 0.0


def compute_delay(fit: Fit, term: EffectTerm) -> float:
    """Return how late ``term`` of ``fit``, one of :data:`DELAY_EFFECTS`, makes its channel [s]."""
    return instrument.compute_delay(term.form_definition, _collect_values(fit, term))


def _collect_values(fit: Fit, term: EffectTerm) -> dict[str, float]:
    """Return name -> value of the parameters of ``term`` in ``fit``, each in its own unit."""
    index, rows = fit.hypothesis.terms.index(term), zip(fit.hypothesis.parameters, fit.values, strict=True)
    return {parameter.name: float(value) for parameter, value in rows if parameter.term_index == index}


def _find_relevant_interval(data: WeightedData, channel: str | None) -> float:
    """Return the sampling interval [s] of ``channel``, or of all channels (median) where that is longer.

    The channel itself may be slower than the others, such as markers beside a load cell.
    """
    intervals: dict[str, list[float]] = {}
    for e in data.experiments:
        for name, series in e.measured.items():
            if len(series.time) > 1:
                intervals.setdefault(name, []).append(float(np.median(np.diff(series.time))))
    all_intervals = [interval for values in intervals.values() for interval in values]
    usual = float(np.median(all_intervals)) if all_intervals else 0.0
    channel_intervals = intervals.get(channel or "")
    return max(usual, float(np.median(channel_intervals)) if channel_intervals else 0.0)


def find_terms_at_bound(fit: Fit) -> list[EffectTerm]:
    """Return the terms of ``fit`` that have a parameter at its bound, each once."""
    return list(dict.fromkeys(term for term, _, _ in _iterate_bounds_reached(fit)))


def find_numbers_at_limit(fit: Fit) -> list[str]:
    """Return what ``fit`` moves as far as its uncertainty admits: declared numbers, and the registration of a walk.

    A limit of physics, such as a bladder on its braid, is a value like others.
    """
    n_priors = fit.hypothesis.n_prior_parameters
    deviations = zip(fit.hypothesis.parameters[:n_priors], fit.x[:n_priors], strict=True)
    return [parameter.name for parameter, x in deviations if abs(x) >= MIN_SIGMAS_AT_LIMIT]


def _iterate_bounds_reached(fit: Fit) -> Iterator[tuple[EffectTerm, FitParameter, float]]:
    """Yield term, parameter and normalized bound of each parameter of a term that is at its bound.

    A limit of physics, such as the exponent of an isothermal change or a bladder as wide as its braid, is a value like
    others. So is the upper bound of the rate of a supply: the data do not show how much faster it is. So is the lower
    bound of a number of a declared effect: the device does not have it. Nor does a bound count whose neighbourhood the
    data do not tell from it.
    """
    hypothesis = fit.hypothesis
    for index, bound in fit.find_bounds_reached().items():
        parameter = hypothesis.parameters[index]
        if parameter.term_index is None or _is_undetermined_at_bound(fit, index, bound):
            continue
        term = hypothesis.terms[parameter.term_index]
        limits = _list_admissible_limits(hypothesis, term, parameter)
        if not any(math.isclose(parameter.denormalize(bound), limit) for limit in limits):
            yield term, parameter, bound


def _is_undetermined_at_bound(fit: Fit, index: int, bound: float) -> bool:
    """Return whether the shape parameter at ``index`` could be well inside its ``bound``, as far as the data show.

    The last digits of a computer decide where on a plateau of chi squared a fit ends: there it changes by less than the
    accuracy of a fit. It is taken to change as the Jacobian says.
    """
    parameter = fit.hypothesis.parameters[index]
    if not parameter.is_logarithmic:
        return False
    lower, upper = parameter.bounds
    step = min(PLATEAU_LOG_STEP, 0.5 * (upper - lower)) * (1.0 if bound == lower else -1.0)
    change = step * fit.jacobian[:, index]
    rise = float(2.0 * change @ fit.weighted_residuals + change @ change)
    return abs(rise) < COST_TOLERANCE * fit.chi2


def _list_admissible_limits(hypothesis: Hypothesis, term: EffectTerm, parameter: FitParameter) -> tuple[float, ...]:
    """Return the limits at which ``parameter`` of ``term`` may be named, in its unit."""
    if not term.number:
        return next((p.physical_limits for p in term.parameters if p.key == parameter.name), ())
    values = {**hypothesis.device.spec.collect_values(), parameter.name: parameter.initial}
    half_range = BOUND_SIGMAS * parameter.scale
    bounds = parameter.initial - half_range, parameter.initial + half_range
    valid_limits = limit_to_valid(values, parameter.name, *bounds, term.form)
    open_ends = [parameter.upper] if term.number in KEYS_WITHOUT_UPPER_LIMIT else []
    open_ends += [parameter.lower] if term.number.startswith(EFFECTS) else []
    return (*open_ends, *(limit for limit in valid_limits if limit not in bounds))


def _is_plausible_instrument(data: WeightedData, fit: Fit, term: EffectTerm, channel: str) -> bool:
    value, *_ = _collect_values(fit, term).values()
    readings = [e.measured[channel].value for e in data.experiments if channel in e.measured]
    span = float(np.ptp(np.concatenate(readings)))
    limit = MAX_INSTRUMENT_FRACTION * span / CHANNEL_UNITS[channel][1]
    if term.effect == instrument.SENSOR_GAIN.name:
        return abs(value - 1.0) <= MAX_INSTRUMENT_FRACTION
    if term.effect == instrument.SENSOR_OFFSET.name:
        return abs(value) <= limit
    if term.effect == instrument.SENSOR_DRIFT.name:
        return abs(value) * max(e.duration for e in data.experiments) <= limit
    if term.effect == instrument.SENSOR_LAG.name:
        return compute_delay(fit, term) <= MAX_INSTRUMENT_DELAY_S
    return True


def list_kinds(terms: Iterable[EffectTerm]) -> list[str]:
    """Return the kinds of causes among ``terms``: a number, or an effect of device, mechanism, body or instrument."""
    return sorted({"number" if term.number else term.effect_definition.kind for term in terms})


def _identify_fault(term: EffectTerm) -> tuple[str | None, bool]:
    """Return number or channel of ``term``, and whether a channel is late: gain and offset are one calibration."""
    return term.number or term.channel, term.effect in DELAY_EFFECTS


def describe_coincidence(terms: Iterable[EffectTerm]) -> str:
    """Return why ``terms`` that need :data:`MIN_COINCIDENT_CAUSES` coincidences are not named; '' for fewer.

    Coincidences are kinds of causes, or, without an effect among the terms, wrong numbers and faults of instruments.
    """
    terms = tuple(terms)
    kinds = list_kinds(terms)
    faults = {_identify_fault(term) for term in terms}
    if len(kinds) >= MIN_COINCIDENT_CAUSES:
        causes = f"Causes of {len(kinds)} kinds would be needed at once ({', '.join(kinds)})"
    elif len(faults) >= MIN_COINCIDENT_CAUSES and set(kinds) <= {"number", "instrument"}:
        causes = f"{len(faults)} faults of numbers and instruments would be needed at once"
    else:
        return ""
    return f"{causes}. Together they may imitate one missing effect, so they are proxies; measure one of them alone."
