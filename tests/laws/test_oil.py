"""Viscosity and density of mineral oil."""

import math

import pytest

from klute_sim.laws import oil


@pytest.mark.parametrize(("temperature", "viscosity"), [(40.0, 32.0), (100.0, 5.4), (20.0, 86.3), (0.0, 336.0)])
def test_viscosity_is_that_of_iso_vg_32(temperature: float, viscosity: float) -> None:
    """The first two points define the line of ASTM D341; the others were computed from it with decimal logarithms."""
    assert oil.compute_viscosity(temperature) == pytest.approx(viscosity, rel=2e-3)


def test_chart_of_viscosity_is_straight() -> None:
    def ordinate(temperature: float) -> float:
        return math.log10(math.log10(oil.compute_viscosity(temperature) + 0.7))

    kelvin = [math.log10(t + 273.15) for t in (-10.0, 30.0, 80.0)]
    cold, mild, warm = (ordinate(t) for t in (-10.0, 30.0, 80.0))
    assert (cold - mild) / (kelvin[1] - kelvin[0]) == pytest.approx((mild - warm) / (kelvin[2] - kelvin[1]), rel=1e-9)


def test_oil_expands_with_temperature() -> None:
    assert oil.compute_density_ratio(20.0) == 1.0
    assert oil.compute_density_ratio(40.0) == pytest.approx(1.0 - 20.0 * 6.5e-4)
