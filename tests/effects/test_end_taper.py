"""Conical ends: nothing is lost at rest, the loss grows with the contraction, and energy is that of the volume."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from klute_sim.device.device import load_device
from klute_sim.effects import catalogue
from klute_sim.effects.families.muscle.end_taper import cone_force, contraction_force, length_force
from klute_sim.laws import mckibben

MUSCLE = load_device("klute-1-1-4-pair").parameters.muscle
PRESSURE = 4e5
CONE, LENGTH, CONTRACTION = (catalogue.find_form("end_taper", name)[1] for name in ("cone", "length", "contraction"))


def lost_tension(cone_ratio: float, contraction: float) -> float:
    length = (1.0 - contraction) * MUSCLE.resting_length
    return -cone_force(CONE.parameter_type(cone_ratio), (), 0.0, MUSCLE, PRESSURE, length, 0.0)


def test_a_muscle_at_rest_has_no_cones() -> None:
    assert lost_tension(1.0, 0.0) == 0.0
    assert lost_tension(1.0, 1e-4) < 1e-3 * mckibben.gas_force(MUSCLE, PRESSURE, MUSCLE.resting_length)


@given(contraction=st.floats(0.0, 0.29), more=st.floats(1e-4, 0.01), ratio=st.floats(0.05, 5.0))
def test_loss_grows_with_contraction_and_is_proportional_to_the_ratio(
    contraction: float, more: float, ratio: float
) -> None:
    assert lost_tension(ratio, contraction + more) > lost_tension(ratio, contraction)
    assert lost_tension(2.0 * ratio, contraction) == pytest.approx(2.0 * lost_tension(ratio, contraction))


def test_lost_work_fills_the_volume_between_cylinder_and_profile() -> None:
    """The volume is that of the profile of the drawing, integrated along the axis."""
    contraction, ratio = 0.22, 1.3
    short = (1.0 - contraction) * MUSCLE.resting_length

    def radius(length: float) -> float:
        return math.sqrt(MUSCLE.braid_length**2 - length**2) / (2.0 * math.pi * MUSCLE.braid_turns)

    cap, wide = radius(MUSCLE.resting_length), radius(short)
    height = ratio * (wide - cap)
    missing = 2.0 * quad(lambda z: math.pi * (wide**2 - (cap + (wide - cap) * z / height) ** 2), 0.0, height)[0]
    work = quad(lambda e: lost_tension(ratio, e) * MUSCLE.resting_length, 0.0, contraction)[0]
    assert work == pytest.approx(MUSCLE.n_actuators * PRESSURE * missing, rel=1e-6)
    assert 0.02 < missing / (math.pi * wide**2 * short) < 0.2


def lost_fraction(muscle: mckibben.MuscleParameters, diameters: float, contraction: float) -> float:
    length = (1.0 - contraction) * muscle.resting_length
    gas = mckibben.gas_force(muscle, PRESSURE, length)
    return 1.0 - length_force(LENGTH.parameter_type(diameters), (), gas, muscle, PRESSURE, length, 0.0) / gas


@given(contraction=st.floats(0.0, 0.25), diameters=st.floats(0.0, 5.0), scale=st.floats(0.2, 5.0))
def test_ends_take_the_same_fraction_of_similar_muscles(contraction: float, diameters: float, scale: float) -> None:
    similar = MUSCLE._replace(
        resting_length=scale * MUSCLE.resting_length,
        braid_length=scale * MUSCLE.braid_length,
        bladder_radius=scale * MUSCLE.bladder_radius,
    )
    expected = diameters * 2.0 * MUSCLE.bladder_radius / MUSCLE.resting_length
    assert lost_fraction(MUSCLE, diameters, contraction) == pytest.approx(expected, abs=1e-12)
    assert lost_fraction(similar, diameters, contraction) == pytest.approx(expected, abs=1e-12)


def test_ends_take_less_of_a_longer_muscle_and_at_most_all() -> None:
    def lost(length_ratio: float) -> float:
        longer = MUSCLE._replace(
            resting_length=length_ratio * MUSCLE.resting_length,
            braid_length=length_ratio * MUSCLE.braid_length,
            braid_turns=length_ratio * MUSCLE.braid_turns,
        )
        return lost_fraction(longer, 2.0, 0.1)

    assert lost(2.0) == pytest.approx(0.5 * lost(1.0))
    assert lost(100.0) < 2e-3
    assert lost(0.01) == 1.0


def contracted_gas(factor: float, low_pressure_factor: float, pressure: float, contraction: float) -> float:
    length = (1.0 - contraction) * MUSCLE.resting_length
    p = CONTRACTION.parameter_type(factor, low_pressure_factor)
    gas = mckibben.gas_force(MUSCLE, pressure, length)
    return contraction_force(p, (), gas, MUSCLE, pressure, length, 0.0)


@given(factor=st.floats(0.8, 3.0), pressure=st.floats(1e4, 7e5))
def test_largest_contraction_shrinks_by_the_factor(factor: float, pressure: float) -> None:
    largest = (1.0 - mckibben.lock_length(MUSCLE) / MUSCLE.resting_length) / factor
    straight = mckibben.gas_force(MUSCLE, pressure, MUSCLE.resting_length)
    assert contracted_gas(factor, 0.0, pressure, largest) == pytest.approx(0.0, abs=1e-9 * straight)
    assert contracted_gas(factor, 0.0, pressure, 0.0) == straight
    assert contracted_gas(factor, 0.0, pressure, 0.9 * largest) > 0.0


@pytest.mark.parametrize("pressure_bar", [0.5, 1.0, 3.0])
def test_factor_of_the_contraction_falls_with_pressure(pressure_bar: float) -> None:
    pressure, contraction = 1e5 * pressure_bar, 0.05
    expected = contracted_gas(1.25 + 4.0 * math.exp(-pressure_bar), 0.0, pressure, contraction)
    assert contracted_gas(1.25, 4.0, pressure, contraction) == pytest.approx(expected, rel=1e-12)
