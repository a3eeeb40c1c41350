"""Delay of the log of a command: when between two samples it acts, which a log does not show.

A delay of at least half a sampling interval is an effect of the supply or a fault of a clock, and has a name. A shorter
one is neither: it belongs to the registration of the walk. It is fitted only where it alone explains what the measured
pressures show, because a fit cannot tell it from a part of a longer delay.
"""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from klute_sim.diagnosis.data_quality import has_repeats
from klute_sim.diagnosis.experiments.registration import COMMAND_DELAY
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.misfit import estimate_misfit, is_significant
from klute_sim.diagnosis.selection.naming import MIN_DELAY_SAMPLES

MIN_BIC_FALL = 10.0
"""Smallest fall of the Bayesian information criterion by which pressures show a delay: very strong evidence after Kass
and Raftery (1995), J. Am. Stat. Assoc. 90, 773-795."""
PERTURBATION = 0.1
"""Delay whose influence is simulated, in sampling intervals."""


def estimate_command_delay(data: WeightedData, base_fit: Fit) -> Mapping[str, float]:
    """Return the name and the standard deviation [ms] of the delay of the command; empty where no pressure shows it.

    ``base_fit`` has no added effects. The delay follows by one linear step from the pressures alone, which depend on
    nothing else but the supply. Its standard deviation is that of a uniform distribution over a sampling interval.
    Without repeats, nothing tells whether the delay explains the pressures.
    """
    interval = max(e.command_interval for e in data.experiments)
    pressures = replace(data, noise={name: data.noise[name] for name in data.noise if name == "pressure"}, cache=None)
    if not (interval and pressures.noise and has_repeats(data.experiments)):
        return {}
    deviation = {COMMAND_DELAY: 1e3 * interval / math.sqrt(12.0)}
    hypothesis = base_fit.hypothesis
    extended = replace(hypothesis, registration=(*hypothesis.registration, *deviation.items()))
    start = np.insert(base_fit.x, hypothesis.n_prior_parameters, 0.0)
    end = start.copy()
    end[hypothesis.n_prior_parameters] = PERTURBATION * math.sqrt(12.0)
    (changes,) = data.compute_changes(
        extended.build_setups(start, data.experiments), [extended.build_setups(end, data.experiments)]
    )
    residuals, derivative = (pressures.weight_residuals(rows) for rows in (base_fit.residuals, changes))
    curvature = float(derivative @ derivative)
    if not (math.isfinite(curvature) and curvature > 0.0):  # a constant command, or one that only starts the trial
        return {}
    slope = float(residuals @ derivative)
    n_intervals = -PERTURBATION * slope / curvature
    bic_fall = slope * slope / curvature - math.log(pressures.n_effective)
    return deviation if bic_fall > MIN_BIC_FALL and abs(n_intervals) < MIN_DELAY_SAMPLES else {}


def has_pressure_misfit(data: WeightedData, fit: Fit) -> bool:
    """Return whether repeats show a misfit of ``fit`` in the measured pressure."""
    misfit = estimate_misfit(data.experiments, fit.residuals, data.noise).get("pressure")
    return misfit is not None and is_significant(misfit)
