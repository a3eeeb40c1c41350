"""The effects of the tendon in closed form: what one unit of each parameter does."""

import pytest

from klute_sim.effects import catalogue
from klute_sim.effects.families import tendon


def test_stiffening_adds_its_coefficient_times_the_squared_stretch() -> None:
    p = catalogue.find_form("tendon_stiffening", "quadratic")[1].parameter_type(2e6)
    assert tendon.stiffening_force(p, (), 100.0, 0.01) == pytest.approx(100.0 + 200.0)
    assert tendon.stiffening_force(p, (), 0.0, -0.01) == 0.0


def test_slack_is_subtracted_from_the_stretch() -> None:
    p = catalogue.find_form("tendon_slack", "dead_length")[1].parameter_type(1.5e-3)
    assert tendon.subtract_slack(p, (), 0.01) == pytest.approx(8.5e-3)
