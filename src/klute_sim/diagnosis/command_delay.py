"""Delay of the log of a command: when between two samples it acts, which a log does not show.

A command that acts later than it is logged, by at least half a sampling interval, has a delay of the supply or a gauge
with another clock, which have names. Other delays belong to the registration: shorter ones, and those of a log that
shows a command only when it has acted. They are fitted only where they alone explain what the measured pressures show,
because a fit cannot tell them from a part of an effect.
"""

import math
from dataclasses import replace

import numpy as np

from klute_sim.diagnosis.data_quality import has_repeats
from klute_sim.diagnosis.experiments.registration import COMMAND_DELAY
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.misfit import has_misfit
from klute_sim.diagnosis.noise.repeats import Noise
from klute_sim.diagnosis.selection.naming import MIN_DELAY_INTERVALS
from klute_sim.types import Array

MIN_BIC_FALL = 10.0
"""Smallest fall of the Bayesian information criterion by which pressures show a delay: very strong evidence after Kass
and Raftery (1995), J. Am. Stat. Assoc. 90, 773-795."""
DELAY_STEP_INTERVALS = 0.1
"""Delay whose influence on the pressures is simulated (assumed)."""
DELAY_DEVIATION_INTERVALS = 0.5
"""Standard deviation of the delay (assumed: a log is late by up to one sample)."""
MAX_DELAY_INTERVALS = 1.4
"""Longest delay of a log (assumed: a fit at its bound of 1.5 has another cause)."""
MAX_ZERO_ORDER_HOLD_DELAY_INTERVALS = 0.25
"""Longest delay, either way, where a zero-order hold is assumed: a hold with a longer one looks like a smooth command
with a delay (assumed)."""


def add_command_delay(data: WeightedData, base_fit: Fit) -> Hypothesis | None:
    """Return the hypothesis of ``base_fit`` with a delay of the command's log; None where no pressure shows one.

    ``base_fit`` has no added effects. The pressures alone decide, because effects that are still missing move the delay
    that a fit of all channels finds. Of the uncertain numbers, only those of the supply matter to them. Without
    repeats, nothing tells whether the delay explains the pressures.
    """
    interval = max(e.command_interval for e in data.experiments)
    pressures = replace(data, noise=select_pressure_noise(data), cache=None)
    if not (interval and pressures.noise and has_repeats(data.experiments)):
        return None
    hypothesis = base_fit.hypothesis
    extended, start = _extend(base_fit, interval)
    end = start.copy()
    end[hypothesis.n_prior_parameters] = DELAY_STEP_INTERVALS / DELAY_DEVIATION_INTERVALS
    (changes,) = data.compute_changes(
        extended.build_setups(start, data.experiments), [extended.build_setups(end, data.experiments)]
    )
    residuals, derivative = (pressures.weight_residuals(rows) for rows in (base_fit.residuals, changes))
    curvature = float(derivative @ derivative)
    if not (math.isfinite(curvature) and curvature > 0.0):  # a constant command, or a simulation that diverges
        return None
    slope = float(residuals @ derivative)
    if slope * slope / curvature - math.log(pressures.n_effective) <= MIN_BIC_FALL:
        return None
    supply = tuple(row for row in hypothesis.uncertainties if row[0].rpartition("/")[2].startswith("supply."))
    shifted = replace(extended, uncertainties=supply, registration=extended.registration[-1:])
    return extended if explains_pressures(pressures, fit_hypothesis(pressures, shifted)) else None


def complete_with_command_delay(data: WeightedData, fit: Fit) -> Fit | None:
    """Return ``fit``, which has added effects, with a delay of the command's log as well; None where that is not one.

    The delay must be one of a log. A caller accepts it only where nothing is missing with it, because effects that are
    still missing move it.
    """
    interval = max(e.command_interval for e in data.experiments)
    names = [parameter.name for parameter in fit.hypothesis.parameters]
    if not interval or COMMAND_DELAY in names or not select_pressure_noise(data):
        return None
    extended = fit_hypothesis(data, *_extend(fit, interval))
    gain = fit.chi2 - extended.chi2 - math.log(data.n_effective)
    return extended if gain > MIN_BIC_FALL and _is_delay_of_log(data, extended, interval) else None


def _extend(fit: Fit, interval: float) -> tuple[Hypothesis, Array]:
    """Return the hypothesis of ``fit`` with a delay of a log with ``interval`` [s], and its point without delay."""
    hypothesis = fit.hypothesis
    added = (COMMAND_DELAY, 1e3 * DELAY_DEVIATION_INTERVALS * interval)
    extended = replace(hypothesis, registration=(*hypothesis.registration, added))
    return extended, np.insert(fit.x, hypothesis.n_prior_parameters, 0.0)


def _is_delay_of_log(data: WeightedData, fit: Fit, interval: float) -> bool:
    """Return whether the delay of the command in ``fit`` is one of a log with ``interval`` [s]."""
    names = [parameter.name for parameter in fit.hypothesis.parameters]
    n_intervals = 1e-3 * fit.values[names.index(COMMAND_DELAY)] / interval
    if any(e.has_zero_order_hold and not e.has_logged_updates for e in data.experiments):  # a hold is assumed
        return abs(n_intervals) < MAX_ZERO_ORDER_HOLD_DELAY_INTERVALS
    return -MIN_DELAY_INTERVALS < n_intervals < MAX_DELAY_INTERVALS


def explains_pressures(data: WeightedData, fit: Fit) -> bool:
    """Return whether the delay of the command in ``fit`` is one of its log, and leaves no misfit of a pressure."""
    interval = max(e.command_interval for e in data.experiments)
    return _is_delay_of_log(data, fit, interval) and not has_misfit(
        data.experiments, fit.residuals, select_pressure_noise(data)
    )


def has_pressure_misfit(data: WeightedData, fit: Fit) -> bool:
    """Return whether repeats of ``data`` show a misfit of ``fit`` in a measured pressure."""
    noise = select_pressure_noise(data)
    return bool(noise) and has_misfit(data.experiments, data.compute_residuals(fit.hypothesis, [fit.x])[0], noise)


def select_pressure_noise(data: WeightedData) -> dict[str, Noise]:
    """Return measured pressure -> its noise."""
    return {name: noise for name, noise in data.noise.items() if is_pressure(name)}


def is_pressure(channel: str) -> bool:
    """Return whether a measured ``channel`` is a pressure."""
    return channel.startswith("pressure")
