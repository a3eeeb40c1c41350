"""Registration of walks that differs between conditions: other plates, or markers that were placed anew."""

from collections.abc import Iterable, Sequence

import numpy as np

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
    rows = [(name, *_fit_each_condition(data, base_fit, names.index(name), groups.values())) for name in deviations]
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


def _fit_each_condition(
    data: WeightedData, fit: Fit, index: int, conditions: Iterable[Sequence[int]]
) -> tuple[Array, float]:
    """Return parameter ``index`` of ``fit`` in each of ``conditions``, in its unit, and chi squared.

    Conditions are indices of trials. All other parameters are the same in all conditions.
    """
    jacobian, residuals = fit.jacobian, fit.weighted_residuals
    sizes = [
        sum(len(e.measured[channel].time) for channel in weights)
        for e, weights in zip(data.experiments, data.weights, strict=True)
    ]
    ends = np.cumsum(sizes)
    starts = ends - sizes
    own = []
    for members in conditions:
        column = np.zeros(len(jacobian))
        for trial in members:
            rows = slice(starts[trial], ends[trial])
            column[rows] = jacobian[rows, index]
        own.append(column)
    columns = np.column_stack([np.delete(jacobian, index, axis=1), *own])
    step = np.linalg.lstsq(columns, -residuals)[0]
    left = residuals + columns @ step
    parameter = fit.hypothesis.parameters[index]
    values = [parameter.denormalize(float(fit.x[index] + change)) for change in step[-len(own) :]]
    return np.array(values), float(left @ left)
