"""Cut-off frequencies of low-pass filters, within the uncertainty that the noise leaves.

Short records and coloured noise show a cut-off frequency to a tenth only, and such an error looks like a missing effect
wherever a force jumps. The signals show it much better, but effects that are missing move it. So it is accepted only
where nothing is missing with it.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from klute_sim.diagnosis.command_interpolation import Preparation
from klute_sim.diagnosis.data_quality import has_repeats
from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.noise.misfit import estimate_misfit, is_significant

CUTOFF_DEVIATION = 0.1
"""Standard deviation of the logarithm of a cut-off frequency that the noise shows (assumed: records of 5 s)."""
CUTOFF_FACTORS = np.geomspace(0.75, 1.33, 29)
"""Cut-off frequencies that are tried, over the one that the noise shows."""


def refine_filters(preparation: Preparation, prepare: Callable[[list[Experiment]], Preparation]) -> Preparation:
    """Return ``preparation`` with other cut-off frequencies, by the same factor, where nothing is missing with them.

    ``prepare`` weighs trials and fits the device without added effects to them.
    """
    data, fit = preparation.data, preparation.base_fit
    is_filtered = any(e.filters for e in data.experiments)
    if not (is_filtered and has_repeats(data.experiments) and _has_misfit(preparation)):
        return preparation
    costs = []
    for factor in CUTOFF_FACTORS:
        scaled = data.with_experiments([_scale_cutoffs(e, float(factor)) for e in data.experiments])
        (residuals,) = scaled.compute_residuals(fit.hypothesis, [fit.x], may_diverge=True)
        vector = data.weight_residuals(residuals)
        costs.append(float(vector @ vector + (np.log(factor) / CUTOFF_DEVIATION) ** 2))
    best = float(CUTOFF_FACTORS[int(np.argmin(costs))])
    refined = prepare([_scale_cutoffs(e, best) for e in preparation.experiments])
    return preparation if _has_misfit(refined) else refined


def _scale_cutoffs(experiment: Experiment, factor: float) -> Experiment:
    filters = {c: replace(each, cutoff=factor * each.cutoff) for c, each in experiment.filters.items()}
    return replace(experiment, filters=filters)


def _has_misfit(preparation: Preparation) -> bool:
    """Return whether repeats show a misfit of any channel without added effects."""
    data = preparation.data
    misfits = estimate_misfit(data.experiments, preparation.base_fit.residuals, data.noise)
    return any(map(is_significant, misfits.values()))
