"""Conical ends: nothing is lost at rest, the loss grows with the contraction, and energy is that of the volume."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from klute_sim.device.device import load_device
from klute_sim.effects import catalogue
from klute_sim.effects.families.muscle.end_taper import cone_force
from klute_sim.laws import mckibben

MUSCLE = load_device("klute-1-1-4-pair").parameters.muscle
PRESSURE = 4e5
CONE = catalogue.find_form("end_taper", "cone")[1]


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
