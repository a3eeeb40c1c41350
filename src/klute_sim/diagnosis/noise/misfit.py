"""Misfit: the residual that all repeats of a trial share and that noise does not explain."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d

from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.noise.repeats import AlignedRepeats, Noise, Residuals, align_repeats
from klute_sim.types import Array, Mask

SIGNIFICANCE_SIGMAS = 4.0
"""Standard errors of a mean squared misfit above which it is significant (assumed)."""
MIN_MISFIT_FRACTION = 0.25
"""Smallest relevant misfit, as a fraction of the noise (assumed)."""
LOCAL_VARIANCE_WINDOW = 3.0
"""Window of the local noise variance [correlation times] (assumed)."""


class Misfit(NamedTuple):
    """Residual of one channel that all repeats share."""

    rms: float
    """Root mean square [SI]; 0 without misfit."""
    significance: float
    """Mean square over its standard error under noise alone."""
    noise_rms: float
    """Root mean square residual of a perfect model, due to noise [SI]."""


def is_significant(misfit: Misfit) -> bool:
    """Return whether ``misfit`` exceeds both its uncertainty and the smallest relevant size."""
    return misfit.significance > SIGNIFICANCE_SIGMAS and misfit.rms > MIN_MISFIT_FRACTION * misfit.noise_rms


def select_all(repeats: AlignedRepeats) -> Mask | slice:
    """Return all samples of ``repeats``."""
    return slice(None)


def estimate_misfit(
    experiments: Sequence[Experiment],
    residuals: Residuals,
    noise: Mapping[str, Noise],
    select: Callable[[AlignedRepeats], Mask | slice] = select_all,
) -> dict[str, Misfit]:
    """Return the misfit of each repeated channel from the products of different repeats' residuals.

    Noise cancels in the mean of these products. The standard error uses the local noise variance: some states amplify
    input noise more than others, and two noisy intervals correlate by chance. ``select`` returns the samples to use.
    """
    misfits = {}
    for channel, channel_noise in noise.items():
        product, variance, uniform_variance, n_samples = 0.0, 0.0, 0.0, 0
        for repeats in align_repeats(experiments, residuals, channel, with_input_error=True):
            pairs = list(itertools.combinations(repeats.residuals, 2))
            samples = select(repeats)
            count = len(repeats.time[samples])
            if count == 0:
                continue
            correlation_time = channel_noise.correlation_time(repeats.sampling_interval)
            product += count * float(np.mean([np.mean((a * b)[samples]) for a, b in pairs]))
            weight = count * correlation_time / len(pairs)
            variance += weight * float(np.mean(_squared_variance(repeats, correlation_time)[samples]))
            uniform_variance += weight * channel_noise.std**4
            n_samples += count
        if n_samples:
            mean = product / n_samples
            standard_error = np.sqrt(max(variance, uniform_variance)) / n_samples
            misfits[channel] = Misfit(float(np.sqrt(max(0.0, mean))), float(mean / standard_error), channel_noise.std)
    return misfits


def has_misfit(experiments: Sequence[Experiment], residuals: Residuals, noise: Mapping[str, Noise]) -> bool:
    """Return whether repeats show a significant misfit in a channel of ``noise``."""
    return any(map(is_significant, estimate_misfit(experiments, residuals, noise).values()))


def _squared_variance(repeats: AlignedRepeats, correlation_time: float) -> Array:
    """Return the squared local noise variance [SI^4] of ``repeats``: (samples,).

    The local variance is that of a window of :data:`LOCAL_VARIANCE_WINDOW` correlation times, with one degree of
    freedom per correlation time and repeat but one. The square of a variance that is estimated with ``f`` degrees of
    freedom is on average ``1 + 2 / f`` times too large (second moment of the chi-squared distribution).
    """
    n_repeats, n_samples = repeats.residuals.shape
    width = min(n_samples, max(1, round(LOCAL_VARIANCE_WINDOW * correlation_time)))
    local_variance = uniform_filter1d(repeats.variance, width, mode="nearest")
    freedom = (n_repeats - 1) * max(1.0, width / correlation_time)
    return np.asarray(local_variance * local_variance / (1.0 + 2.0 / freedom))
