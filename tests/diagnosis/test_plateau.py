"""A fit that ends on a plateau of chi squared is at no bound: where it ends is chance."""

from dataclasses import replace

import numpy as np
import pytest

from klute_sim.diagnosis.selection.naming import find_terms_at_bound
from tests.diagnosis.test_bounds import AT_BOUND, COULOMB, STRIBECK, make_fit


@pytest.mark.parametrize(("sensitivity", "is_found"), [(0.0, False), (1e-5, False), (1e-3, True)])
def test_bound_that_the_data_do_not_tell_from_other_values_does_not_count(sensitivity: float, is_found: bool) -> None:
    """Where a fit ends on a plateau of chi squared is chance. The size of an effect always counts."""
    fit = make_fit(STRIBECK, chi2=100.0, stick_fraction=AT_BOUND)
    jacobian = fit.jacobian.copy()
    jacobian[:, [p.name for p in fit.hypothesis.parameters].index("stick_fraction")] = sensitivity
    assert find_terms_at_bound(replace(fit, jacobian=jacobian)) == ([STRIBECK] if is_found else [])
    largest = replace(make_fit(COULOMB, force_n=500.0), jacobian=np.zeros((1, 1)))
    assert find_terms_at_bound(largest) == [COULOMB]
