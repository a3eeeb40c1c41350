"""Damping and relaxation of the muscle in closed form: what one unit of each coefficient does."""

from types import SimpleNamespace

import pytest

from klute_sim.device.device import load_device
from klute_sim.effects.families.muscle import bladder_relaxation, muscle_damping
from klute_sim.units import BAR

PAIR = load_device("klute-3-4-pair").parameters.muscle
"""Two actuators: the force is twice that of one coefficient."""


def test_damping_is_its_coefficient_times_the_speed() -> None:
    p = SimpleNamespace(coefficient=40.0)
    force = muscle_damping.viscous_force(p, (), 100.0, PAIR, 3e5, 0.24, 0.1)
    assert force == pytest.approx(100.0 + 2 * 40.0 * 0.1)
    force = muscle_damping.pressure_dependent_force(p, (), 100.0, PAIR, 3.0 * BAR, 0.24, 0.1)
    assert force == pytest.approx(100.0 + 2 * 40.0 * 3.0 * 0.1)


def test_relaxing_bladder_pulls_with_its_stiffness_times_the_stretch() -> None:
    p, state = SimpleNamespace(stiffness=2e3), SimpleNamespace(relaxed_length=0.001)
    length = PAIR.resting_length + 0.004
    force = bladder_relaxation.maxwell_force(p, state, 100.0, PAIR, 3e5, length, 0.0)
    assert force == pytest.approx(100.0 + 2 * 2e3 * 0.003)
