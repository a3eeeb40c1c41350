"""Registration that differs between conditions: other plates, markers or specimens mounted anew, zeros set anew.

It is reported, and not corrected: an effect of what is constant within each condition, as of its pressure, looks alike.
"""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
from klute_sim.diagnosis.experiments.bench import LENGTH_PERTURBATION, BenchExperiment
from klute_sim.diagnosis.experiments.registration import COMMAND_DELAY, REGISTRATION_WORDS
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.repeats import group_repeats
from klute_sim.types import Array

MIN_REGISTRATION_SHARE = 0.6
"""Smallest share of the misfit that a number of the registration must take, fitted in each condition, to be reported
(assumed: in four walks with other causes it took 0.00 to 0.13, in one with different plates 0.95)."""
MIN_SPREAD_SIGMAS = 1.0
"""Smallest difference between two conditions, in standard deviations of the number (assumed)."""
MIN_ZERO_SHARE = 0.8
"""Smallest share of the misfit that zeros of their own must take to be reported (assumed)."""
MIN_ZERO_GAIN = 10.0
"""Smallest fall of chi squared by each zero (assumed: noise makes each fall by about 1)."""
MAX_ZERO_FRACTION = 1.0
"""Largest zero, as a fraction of the range of its channel (assumed: a larger one is another mistake, as of a unit)."""
MIN_CONDITIONS = 3
"""Fewest conditions whose zeros tell anything (assumed): two zeros take most of any error of the force."""
LENGTH = "length"
"""Length that a bench prescribes."""


def describe_condition_registration(data: WeightedData, base_fit: Fit) -> list[str]:
    """Return a sentence if one number of the registration, fitted in each condition, explains most of the misfit.

    ``base_fit`` has one registration for all conditions, and no added effects. The number of each condition follows by
    one linear step, together with all other parameters.
    """
    groups = group_repeats(data.experiments)
    names = [parameter.name for parameter in base_fit.hypothesis.parameters]
    deviations = {name: std for name, std in base_fit.hypothesis.registration if name != COMMAND_DELAY}
    misfit = base_fit.chi2 - data.n_effective
    if len(groups) < 2 or misfit <= 0.0 or not deviations:
        return []
    rows = []
    for name in deviations:
        index = names.index(name)
        others = np.delete(base_fit.jacobian, index, axis=1)
        changes, chi2 = _fit_each_condition(data, base_fit, others, base_fit.jacobian[:, index], groups.values())
        parameter = base_fit.hypothesis.parameters[index]
        rows.append((name, [parameter.denormalize(float(base_fit.x[index] + change)) for change in changes], chi2))
    name, values, chi2 = min(rows, key=lambda row: row[2])
    share = (base_fit.chi2 - chi2) / misfit
    if share < MIN_REGISTRATION_SHARE or np.ptp(values) < MIN_SPREAD_SIGMAS * deviations[name]:
        return []
    statement, positive, negative = REGISTRATION_WORDS[name]
    conditions = [
        f"in '{group}' " + statement.format(size=f"{abs(value):.2g}", direction=positive if value > 0.0 else negative)
        for group, value in zip(groups, values, strict=True)
    ]
    return [
        f"A registration of its own in each condition would take {100.0 * min(share, 1.0):.0f} % of the misfit: "
        f"{', '.join(conditions)} than measured. Were the conditions recorded on different plates, or with markers "
        "that were placed anew? Then correct the registration of each, or diagnose them apart."
    ]


def describe_condition_zeros(data: WeightedData, base_fit: Fit) -> list[str]:
    """Return a sentence if the zero of one channel, fitted in each condition, explains most of the misfit.

    ``base_fit`` has no added effects. Channels are the measured ones, and the length that a bench prescribes.
    """
    groups = group_repeats(data.experiments)
    misfit = base_fit.chi2 - data.n_effective
    if len(groups) < MIN_CONDITIONS or misfit <= 0.0 or base_fit.has_diverged:
        return []
    rows = []
    for channel, column in _list_zero_columns(data, base_fit).items():
        changes, chi2 = _fit_each_condition(data, base_fit, base_fit.jacobian, column, groups.values())
        rows.append((channel, changes, chi2))
    channel, changes, chi2 = min(rows, key=lambda row: row[2])
    gain = base_fit.chi2 - chi2
    share = gain / misfit
    if share < MIN_ZERO_SHARE or gain < MIN_ZERO_GAIN * len(groups):
        return []
    if np.abs(changes).max() > MAX_ZERO_FRACTION * _compute_range(data, channel):
        return []
    unit, factor = ("mm", 1e-3) if channel == LENGTH else CHANNEL_UNITS[channel]
    errors = [f"{-change / factor:+.2g} {unit} in '{group}'" for group, change in zip(groups, changes, strict=True)]
    return [
        f"A zero of '{channel}' of its own in each condition would take {100.0 * min(share, 1.0):.0f} % of the misfit: "
        f"it reads {', '.join(errors)}. Was it set anew between conditions? Then correct each zero by a calibration. "
        "Else look for an error that depends on what is constant within a condition."
    ]


def _compute_range(data: WeightedData, channel: str) -> float:
    """Return the range of ``channel`` in all trials [SI]."""
    if channel == LENGTH:
        values = [e.unit_length for e in data.experiments if isinstance(e, BenchExperiment)]
    else:
        values = [e.measured[channel].value for e in data.experiments if channel in e.measured]
    return float(np.ptp(np.concatenate(values)))


def _list_zero_columns(data: WeightedData, fit: Fit) -> Mapping[str, Array]:
    """Return channel -> derivative of the weighted residuals by a correction of its reading [1/SI], (residuals,)."""
    n_priors = fit.hypothesis.n_prior_parameters
    columns = {}
    for channel in data.noise:
        ones = [
            {c: np.full(len(series.time), float(c == channel)) for c, series in e.measured.items()}
            for e in data.experiments
        ]
        columns[channel] = np.concatenate([data.weight_residuals(ones), np.zeros(n_priors)])
    if all(isinstance(e, BenchExperiment) for e in data.experiments):
        moved = data.with_experiments([e.perturb_inputs(lambda command: command)[1] for e in data.experiments])
        before, after = (
            variant.weight_residuals(variant.compute_residuals(fit.hypothesis, [fit.x], may_diverge=True)[0])
            for variant in (data, moved)
        )
        if np.isfinite(after).all():
            columns[LENGTH] = np.concatenate([(after - before) / LENGTH_PERTURBATION, np.zeros(n_priors)])
    return columns


def _fit_each_condition(
    data: WeightedData, fit: Fit, others: Array, column: Array, conditions: Iterable[Sequence[int]]
) -> tuple[Array, float]:
    """Return the change of one parameter in each of ``conditions``, (conditions,), and chi squared.

    Conditions are indices of trials. ``column`` holds the derivatives of the weighted residuals by the parameter, and
    ``others`` those by the parameters that all conditions share, (residuals, parameters).
    """
    sizes = [
        sum(len(e.measured[channel].time) for channel in weights)
        for e, weights in zip(data.experiments, data.weights, strict=True)
    ]
    ends = np.cumsum(sizes)
    condition_columns = []
    for members in conditions:
        part = np.zeros(len(column))
        for trial in members:
            rows = slice(ends[trial] - sizes[trial], ends[trial])
            part[rows] = column[rows]
        condition_columns.append(part)
    columns = np.column_stack([others, *condition_columns])
    step = np.linalg.lstsq(columns, -fit.weighted_residuals)[0]
    remainder = fit.weighted_residuals + columns @ step
    return np.asarray(step[-len(condition_columns) :]), float(remainder @ remainder)
