"""Stiffness and loss of a loading cycle: closed forms against a simulated spring and dashpot, limits and inverses."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.laws.loading_cycle import (
    MAX_LOSS,
    CyclicStiffness,
    compliance,
    in_series,
    lag_of_loss,
    loss_of_lag,
    part_of_compliance,
    part_of_spring_and_dashpot,
    spring_and_dashpot,
)

LOSSES = st.floats(0.01, 0.85)
PARTS = st.builds(CyclicStiffness, st.floats(1e3, 1e6), LOSSES)


@given(PARTS, st.floats(0.05, 2.0))
def test_spring_and_dashpot_have_the_stiffness_and_the_loss(part: CyclicStiffness, cycle_time: float) -> None:
    spring, dashpot = spring_and_dashpot(part, cycle_time)
    assert part_of_spring_and_dashpot(spring, dashpot, cycle_time) == pytest.approx(part, rel=1e-9)
    assert part_of_compliance(compliance(part)) == pytest.approx(part, rel=1e-9)
    assert loss_of_lag(lag_of_loss(part.loss)) == pytest.approx(part.loss, rel=1e-9)


@pytest.mark.parametrize("loss", [0.05, 0.3, 0.7])
def test_simulated_cycle_agrees_with_the_closed_form(loss: float) -> None:
    """Integrate the spring and the dashpot under the load, and measure as a laboratory does."""
    cycle_time, n = 0.5, 20000
    spring, dashpot = spring_and_dashpot(CyclicStiffness(40e3, loss), cycle_time)
    load = 250.0 * (1.0 - np.cos(2.0 * np.pi * np.arange(10 * n) / n))
    deflection, dt = np.zeros(10 * n), cycle_time / n
    for k in range(1, 10 * n):
        deflection[k] = (deflection[k - 1] + dt * load[k] / dashpot) / (1.0 + dt * spring / dashpot)
    load, deflection = load[-n:], deflection[-n:]
    assert np.ptp(load) / np.ptp(deflection) == pytest.approx(40e3, rel=1e-3)
    steps = load * (np.roll(deflection, -1) - deflection)
    assert steps.sum() / steps[steps > 0.0].sum() == pytest.approx(loss, abs=1e-3)


def test_limits() -> None:
    assert loss_of_lag(0.0) == 0.0
    assert loss_of_lag(0.5 * math.pi) == pytest.approx(MAX_LOSS)
    assert spring_and_dashpot(CyclicStiffness(5.0, 0.0), 1.0) == (5.0, 0.0)


@given(LOSSES, LOSSES)
def test_loss_increases_with_the_lag(first: float, second: float) -> None:
    assert (lag_of_loss(first) < lag_of_loss(second)) == (first < second)


@given(PARTS, PARTS)
def test_series_is_softer_than_each_part_and_its_loss_lies_between(
    first: CyclicStiffness, second: CyclicStiffness
) -> None:
    both = in_series(first, second)
    assert both.stiffness < min(first.stiffness, second.stiffness)
    assert min(first.loss, second.loss) - 1e-9 <= both.loss <= max(first.loss, second.loss) + 1e-9
    assert both == pytest.approx(in_series(second, first))
