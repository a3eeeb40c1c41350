"""Damping and relaxation of the muscle in closed form: what one unit of each coefficient does."""

from types import SimpleNamespace

import numpy as np
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


@pytest.mark.parametrize("exponent", [0.25, 0.5, 1.0])
def test_power_law_has_its_exponent_and_is_linear_at_rest(exponent: float) -> None:
    p = SimpleNamespace(coefficient=40.0, exponent=exponent)

    def compute_force(velocity: float) -> float:
        return muscle_damping.power_law_force(p, (), 0.0, PAIR, 3e5, 0.24, velocity)

    assert compute_force(0.1) == pytest.approx(2 * 40.0 * 0.1)  # all exponents agree at the reference speed
    assert compute_force(2.0) / compute_force(1.0) == pytest.approx(2.0**exponent, rel=1e-4)
    assert compute_force(1e-5) == pytest.approx(2.0 * compute_force(5e-6), rel=1e-5)
    speeds = np.linspace(-0.5, 0.5, 2001)
    forces = np.array([compute_force(float(v)) for v in speeds])
    assert (np.diff(forces) > 0.0).all()
    assert (forces * speeds >= 0.0).all()  # it only dissipates
    np.testing.assert_allclose(forces, -forces[::-1], atol=1e-9)
    if exponent == 1.0:
        np.testing.assert_allclose(forces, 2 * 40.0 * speeds, atol=1e-12)


def test_relaxing_bladder_pulls_with_its_stiffness_times_the_stretch() -> None:
    p, state = SimpleNamespace(stiffness=2e3), SimpleNamespace(relaxed_length=0.001)
    length = PAIR.resting_length + 0.004
    force = bladder_relaxation.maxwell_force(p, state, 100.0, PAIR, 3e5, length, 0.0)
    assert force == pytest.approx(100.0 + 2 * 2e3 * 0.003)
