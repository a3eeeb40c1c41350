"""p-value of the misfit that repeats share, against the misfit of clean simulated datasets.

Simulated datasets without a hidden effect share an irrelevant misfit: the time step leaves one, and so do the
interpolation and the denoising of inputs. It is larger in channels of motion, to which the prescribed length passes
directly. Its distribution was measured on clean datasets: an empirical null distribution (Efron 2004, *Journal of the
American Statistical Association* 99, 96 to 104).
"""

from typing import NamedTuple

import numpy as np
from scipy.stats import t

from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.repeat_products import RepeatProducts, compute_repeat_products

IRRELEVANT_MEAN_SQUARES = (0.0025, 0.008)
"""Mean squares of the irrelevant misfit in channels of loads and of motions, in variances of the noise."""
IRRELEVANT_SPREAD = 0.016
"""Standard deviation of the mean square between datasets, in variances of the noise."""


class NullDistribution(NamedTuple):
    """Distribution of the sum of the products if no relevant misfit is left: Student's t, shifted and scaled."""

    mean: float
    """Mean of the sum."""
    std: float
    """Scale: the standard deviation as it was estimated."""
    degrees_of_freedom: float
    """Degrees of freedom of the estimate."""


def compute_p_value(data: WeightedData, fit: Fit) -> float | None:
    """Return the probability of a misfit as large as that of ``fit`` if no relevant misfit is left, one-sided.

    Returns None without repeats, or where the trials are too short.
    """
    shared = compute_repeat_products(data, fit)
    return None if shared is None else convert_to_p_value(shared)


def convert_to_p_value(
    shared: RepeatProducts,
    mean_squares: tuple[float, float] = IRRELEVANT_MEAN_SQUARES,
    spread: float = IRRELEVANT_SPREAD,
) -> float:
    """Return the p-value of ``shared`` if the irrelevant misfit has these mean squares and this spread."""
    null = compute_null_distribution(shared, mean_squares, spread)
    return float(t.sf((shared.products.sum() - null.mean) / null.std, null.degrees_of_freedom))


def compute_null_distribution(
    shared: RepeatProducts, mean_squares: tuple[float, float], spread: float
) -> NullDistribution:
    """Return the distribution of the sum of the products if no relevant misfit is left.

    The variance has two parts: the sample variance of the products about their shares of the total, to which a misfit
    adds nothing, and ``spread``, the scatter between datasets. Only the first part is estimated from the few products
    of a dataset, so the tails are those of Student's t with the degrees of freedom of the sum (Satterthwaite 1946,
    *Biometrics Bulletin* 2, 110 to 114).
    """
    total, n_products = shared.n_samples.sum(), len(shared.products)
    excess = shared.products - shared.n_samples @ np.array(mean_squares)
    scatter = excess - excess.sum() * shared.n_samples.sum(axis=1) / total
    sampling_variance = n_products / (n_products - 1.0) * float(scatter @ scatter)
    variance = sampling_variance + (spread * total) ** 2
    return NullDistribution(
        mean=float(shared.products.sum() - excess.sum()),
        std=float(np.sqrt(variance)),
        degrees_of_freedom=(n_products - 1.0) * (variance / sampling_variance) ** 2,
    )
