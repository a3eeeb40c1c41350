"""Weights of trials by the error of an imperfect law, which all repeats of a condition share."""

from collections.abc import Sequence
from dataclasses import replace

from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.repeats import Residuals, estimate_noise_from_residuals, group_repeats


def weight_by_law_error(data: WeightedData, experiments: Sequence[Experiment], residuals: Residuals) -> WeightedData:
    """Return each condition of ``experiments`` once, with the ``residuals`` of the best model as noise.

    Repeats of a condition share the error of the law, so they add nothing: each channel counts in one of them, that
    with the most samples which measured it. Channels without noise in ``data`` do not count.
    """
    plain = [replace(e, noise_scale={}, input_error_scale={}, input_noise_share={}) for e in experiments]
    noise = {}
    for channel, estimate in estimate_noise_from_residuals(plain, residuals).items():
        if channel not in data.noise:
            continue
        noise[channel] = estimate._replace(std=max(estimate.std, data.noise[channel].std))
    experiments_once = []
    for members in group_repeats(plain).values():
        counted: set[str] = set()
        for e in sorted((plain[index] for index in members), key=_count_samples, reverse=True):
            new = {channel: series for channel, series in e.measured.items() if channel not in counted}
            if new:
                experiments_once.append(e if len(new) == len(e.measured) else replace(e, measured=new))
                counted |= new.keys()
    return WeightedData(data.simulator, experiments_once, noise, data.cache, has_law_error=True)


def _count_samples(experiment: Experiment) -> int:
    return sum(len(series.time) for series in experiment.measured.values())
