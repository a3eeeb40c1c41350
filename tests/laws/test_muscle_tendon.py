"""Tests of the skeletal muscle-tendon unit: limits, continuity, equilibrium and energy."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.laws import muscle_tendon as law

SOLEUS = law.MuscleTendon(4000.0, 6.0, 0.08, 0.52)
LENGTHS = st.floats(0.3, 1.7)
ACTIVATIONS = st.floats(0.01, 1.0)


def test_published_points_of_the_curves() -> None:
    assert law.force_length(1.0) == 1.0
    assert law.force_length(1.0 + law.WIDTH) == pytest.approx(0.05)
    assert law.force_velocity(0.0) == pytest.approx(1.0)
    assert law.force_velocity(-1.0) == 0.0
    assert law.force_velocity(1.0) == pytest.approx(law.ECCENTRIC_FORCE)
    assert law.tendon_force(law.REFERENCE_STRAIN) == pytest.approx(1.0)
    assert law.tendon_force(-0.01) == law.tendon_force(0.0) == law.passive_force(0.9) == 0.0


@given(st.floats(-2.0, 2.0), st.floats(1e-6, 0.5))
def test_force_rises_with_lengthening_velocity_without_a_jump(velocity: float, difference: float) -> None:
    assert law.force_velocity(velocity + difference) >= law.force_velocity(velocity)
    assert law.force_velocity(velocity + 1e-9) == pytest.approx(law.force_velocity(velocity), abs=1e-6)


@given(LENGTHS)
def test_energies_are_the_integrals_of_the_forces(length: float) -> None:
    step, scale = 1e-6, SOLEUS.max_force * SOLEUS.optimal_length
    energies = [law.passive_energy(SOLEUS, length + sign * step) for sign in (1.0, -1.0)]
    assert (energies[0] - energies[1]) / (2.0 * step) / scale == pytest.approx(law.passive_force(length), abs=1e-5)
    strain = 0.1 * (length - 1.0)
    energies = [law.tendon_energy(SOLEUS, strain + sign * step) for sign in (1.0, -1.0)]
    slope = (energies[0] - energies[1]) / (2.0 * step) / (SOLEUS.max_force * SOLEUS.slack_length)
    assert slope == pytest.approx(law.tendon_force(strain), abs=1e-4)


@given(ACTIVATIONS, LENGTHS, st.floats(0.85, 1.25), st.sampled_from([2.5e-4, 1e-3, 5e-3]))
def test_step_balances_fiber_and_tendon(activation: float, previous: float, ratio: float, dt: float) -> None:
    unit_length = ratio * (SOLEUS.optimal_length + SOLEUS.slack_length)
    fiber = law.step_fiber(SOLEUS, activation, previous, unit_length, dt)
    pull = fiber.active_force + law.passive_force(fiber.length) + law.DAMPING * fiber.velocity
    if law.MIN_LENGTH + 1e-6 < fiber.length < law.MAX_LENGTH - 1e-6:
        assert pull == pytest.approx(fiber.tendon_force, abs=2e-8 * (1.0 + abs(pull)))
    assert fiber.velocity == pytest.approx((fiber.length - previous) / (dt * SOLEUS.max_velocity), abs=1e-9)


@pytest.mark.parametrize("activation", [0.01, 0.3, 1.0])
def test_equilibrium_does_not_depend_on_the_time_step(activation: float) -> None:
    lengths = []
    for dt, n in ((1e-3, 4000), (5e-3, 800)):
        length = 1.0
        for _ in range(n):
            length = law.step_fiber(SOLEUS, activation, length, SOLEUS.optimal_length + SOLEUS.slack_length, dt).length
        lengths.append(length)
    assert lengths[0] == pytest.approx(lengths[1], abs=1e-5)
    assert lengths[0] < 1.0


def test_more_activation_pulls_harder() -> None:
    unit_length = SOLEUS.optimal_length + SOLEUS.slack_length
    forces = [law.step_fiber(SOLEUS, a, 1.0, unit_length, 0.005).tendon_force for a in (0.01, 0.3, 0.6, 1.0)]
    assert forces == sorted(forces)


def test_inactive_muscle_dissipates_in_a_closed_cycle() -> None:
    """Without activation the unit is a spring with a damper: the work that it gives over a cycle is not positive."""
    length, work, n, dt = 1.0, 0.0, 2000, 1e-3
    middle, tension = SOLEUS.optimal_length + SOLEUS.slack_length, 0.0
    for cycle in range(2):
        work = 0.0
        for k in range(n):
            after = middle + 0.03 * math.sin(2.0 * math.pi * (k + 1) / n)
            before = middle + 0.03 * math.sin(2.0 * math.pi * k / n)
            fiber = law.step_fiber(SOLEUS, 0.0, length, after, dt)
            work += 0.5 * (tension + fiber.tendon_force) * SOLEUS.max_force * (before - after)
            length, tension = fiber.length, fiber.tendon_force
        assert work < 0.0 or cycle == 0
    assert -30.0 < work < 0.0
