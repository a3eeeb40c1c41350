"""The parameter shared by fits and tuning: normalized coordinates and bounds."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.parameters import Parameter

LINEAR = Parameter(name="length", initial=2.0, scale=-0.5, lower=1.0, upper=4.0, unit="m")
LOGARITHMIC = Parameter(name="stiffness", initial=10.0, scale=0.2, lower=1.0, upper=100.0, is_logarithmic=True)


@pytest.mark.parametrize("parameter", [LINEAR, LOGARITHMIC], ids=lambda parameter: parameter.name)
@given(fraction=st.floats(0.0, 1.0))
def test_normalize_inverts_denormalize_within_the_bounds(parameter: Parameter, fraction: float) -> None:
    lower, upper = parameter.bounds
    x = lower + fraction * (upper - lower)
    value = parameter.denormalize(x)
    assert parameter.lower <= value <= parameter.upper
    assert parameter.normalize(value) == pytest.approx(x, abs=1e-9)
    assert parameter.compute_violation(x) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("parameter", [LINEAR, LOGARITHMIC], ids=lambda parameter: parameter.name)
@pytest.mark.parametrize("x", [-1e5, 1e5])
def test_values_are_clipped_to_the_bounds(parameter: Parameter, x: float) -> None:
    assert parameter.denormalize(x) in (parameter.lower, parameter.upper)
    lower, upper = parameter.bounds
    assert parameter.compute_violation(x) == pytest.approx(lower - x if x < lower else x - upper)


def test_initial_value_is_at_zero_and_one_scale_above_at_one() -> None:
    assert LINEAR.denormalize(0.0) == 2.0
    assert LINEAR.denormalize(1.0) == 1.5
    assert LOGARITHMIC.denormalize(0.0) == 10.0
    assert LOGARITHMIC.denormalize(1.0) == pytest.approx(10.0 * math.exp(0.2))


def test_label_has_the_unit_where_there_is_one() -> None:
    assert LINEAR.label == "length [m]"
    assert LOGARITHMIC.label == "stiffness"
