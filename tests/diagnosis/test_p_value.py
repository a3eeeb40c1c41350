"""p-values of a shared misfit under the stated null distribution: uniform, bounded and falling with the misfit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import kstest

from klute_sim.diagnosis.noise.p_value import IRRELEVANT_MEAN_SQUARES, IRRELEVANT_SPREAD, convert_to_p_value
from klute_sim.diagnosis.noise.repeat_products import RepeatProducts


def draw_clean_dataset(rng: np.random.Generator, n_products: int = 25) -> RepeatProducts:
    """Return products of noise about an irrelevant misfit that is drawn for the dataset; half have a motion."""
    n_samples = rng.uniform(300.0, 500.0, (n_products, 2)) * np.array([1.0, 0.5 * rng.integers(2)])
    irrelevant = n_samples @ np.array(IRRELEVANT_MEAN_SQUARES)
    irrelevant += IRRELEVANT_SPREAD * rng.normal() * n_samples.sum(axis=1)
    return RepeatProducts(irrelevant + rng.normal(size=n_products) * rng.uniform(20.0, 80.0, n_products), n_samples)


def test_p_values_are_uniform_under_the_null_distribution() -> None:
    rng = np.random.default_rng(5)
    p_values = [convert_to_p_value(draw_clean_dataset(rng)) for _ in range(2000)]
    assert kstest(p_values, "uniform").pvalue > 0.05
    assert np.mean(np.array(p_values) <= 0.05) == pytest.approx(0.05, abs=0.015)


def test_p_value_tells_motions_from_loads() -> None:
    """Datasets with and without a channel of motion have uniform p-values by themselves."""
    rng = np.random.default_rng(5)
    datasets = [draw_clean_dataset(rng) for _ in range(1000)]
    for has_motion in (False, True):
        p_values = [convert_to_p_value(d) for d in datasets if d.n_samples[:, 1].any() == has_motion]
        assert kstest(p_values, "uniform").pvalue > 0.05


@given(st.integers(0, 1000), st.floats(0.0, 1.0))
def test_p_value_falls_with_the_misfit(seed: int, more: float) -> None:
    shared = draw_clean_dataset(np.random.default_rng(seed))
    larger = shared._replace(products=shared.products + more * shared.n_samples.sum(axis=1))
    assert 0.0 <= convert_to_p_value(larger) <= convert_to_p_value(shared) <= 1.0
    if more > 0.3:
        assert convert_to_p_value(larger) < 1e-4


def test_p_value_is_a_half_where_the_misfit_is_what_clean_datasets_share() -> None:
    n_samples = np.tile([100.0, 100.0], (20, 1))
    products = n_samples @ np.array(IRRELEVANT_MEAN_SQUARES) + np.tile([-7.0, 7.0], 10)
    assert convert_to_p_value(RepeatProducts(products, n_samples)) == pytest.approx(0.5)
