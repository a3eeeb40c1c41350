"""Tests of the metabolic laws: known points, signs, and scaling with the muscle."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.laws import metabolic_power as law
from klute_sim.laws.muscle_tendon import MuscleTendon

VASTI = MuscleTendon(6000.0, 12.0, 0.114, 0.33)
ACTIVATIONS, VELOCITIES, LENGTHS = st.floats(0.01, 1.0), st.floats(-0.9, 0.9), st.floats(0.5, 1.4)


def bhargava(muscle: MuscleTendon, activation: float, length: float = 1.0, velocity: float = 0.0) -> float:
    force = activation * (1.0 + velocity if velocity < 0.0 else 1.0)
    return law.bhargava_power(muscle, 0.5, activation, length, velocity, activation, force)


def test_published_points() -> None:
    """Minetti and Alexander: 0.054 at rest. Bhargava: at full activation 40 + 74 and 133 + 111 W/kg, half of each."""
    scale = VASTI.max_force * VASTI.max_velocity * VASTI.optimal_length
    assert law.minetti_alexander_power(VASTI, 1.0, 0.0) == pytest.approx(0.054 * scale)
    assert bhargava(VASTI, 1.0) == pytest.approx(0.5 * (40 + 74 + 133 + 111) * law.muscle_mass(VASTI))
    assert law.muscle_mass(VASTI) == pytest.approx(2.899, abs=0.01)


@given(ACTIVATIONS, VELOCITIES, LENGTHS)
def test_power_is_not_negative_and_grows_with_the_muscle(activation: float, velocity: float, length: float) -> None:
    double = VASTI._replace(max_force=2.0 * VASTI.max_force)
    minetti = law.minetti_alexander_power(VASTI, activation, velocity)
    assert minetti >= 0.0
    assert law.minetti_alexander_power(double, activation, velocity) == pytest.approx(2.0 * minetti)
    power = bhargava(VASTI, activation, length, velocity)
    assert power >= 0.0
    assert bhargava(double, activation, length, velocity) == pytest.approx(2.0 * power)


@given(ACTIVATIONS, st.floats(0.01, 0.3))
def test_shortening_costs_more_than_holding_and_lengthening_less(activation: float, speed: float) -> None:
    for power in (
        [law.minetti_alexander_power(VASTI, activation, v) for v in (speed, 0.0, -speed)],
        [bhargava(VASTI, activation, 1.0, v) for v in (speed, 0.0, -speed)],
    ):
        assert power[0] <= power[1] < power[2]


@given(ACTIVATIONS)
def test_slow_fibers_cost_less_than_fast_ones_at_full_activation(activation: float) -> None:
    slow, fast = (law.bhargava_power(VASTI, share, 1.0, 1.0, 0.0, 1.0, 1.0) for share in (1.0, 0.0))
    assert slow < fast
    assert bhargava(VASTI, activation) <= bhargava(VASTI, 1.0)


def test_maintenance_factor_is_continuous() -> None:
    for length, value in ((0.3, 0.5), (0.5, 0.5), (1.0, 1.0), (1.5, 0.0), (2.0, 0.0)):
        assert law.maintenance_factor(length) == pytest.approx(value)
        assert law.maintenance_factor(length + 1e-9) == pytest.approx(value, abs=1e-6)
