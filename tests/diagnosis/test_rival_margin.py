"""Other names that predict as well: how much larger their error may be, and that they make no name unstable."""

import pytest

from klute_sim.diagnosis.selection.predictive_model import choose_stable_model, compute_rival_margin
from tests.diagnosis.test_predictive_selection import FRICTION, TAPER, TENSION, make_model


def test_rival_of_a_name_makes_it_not_unstable() -> None:
    """A longer tendon at rest and slack that it has otherwise are one to the data: the last digits decide."""
    first = make_model((FRICTION, TENSION), [0.400, 0.402, 0.400, 0.402])
    second = make_model((FRICTION, TAPER), [0.402, 0.400, 0.402, 0.4005])
    single, base = make_model((FRICTION,), [0.7, 0.8, 0.6, 0.7]), make_model((), [1.0] * 4)
    chosen, stability = choose_stable_model([base, single, first, second], 4, 0.39)
    assert chosen in (first, second)
    assert set(stability.values()) == {1.0}


def test_noise_is_no_part_of_the_error_that_rivals_share() -> None:
    """Where two of five channels show nothing but noise, a tenth of the error is a multiple of what models leave."""
    models = [make_model((), [1.0] * 4), make_model((FRICTION,), [0.41] * 4)]
    assert compute_rival_margin(0.41, models, 0.0) == pytest.approx(0.041)
    assert compute_rival_margin(0.41, models, 0.4) == pytest.approx(0.02 * 0.6)  # negligible
    assert compute_rival_margin(0.8, models, 0.4) == pytest.approx(0.04)
    assert compute_rival_margin(0.41, models[1:], 0.4) == pytest.approx(0.041)  # nobody knows what is negligible
    assert compute_rival_margin(0.39, models[1:], 0.4) == pytest.approx(0.039)
    assert compute_rival_margin(0.3, models, 1.2) == 0.0  # a noise that was estimated too large
