"""Passive tension: what it takes grows with contraction, is absent without pressure at rest, and never makes a push."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.device import dynamics
from klute_sim.device.device import load_device
from klute_sim.effects import catalogue
from tests.effects.devices import activate

PAIR = load_device("klute-3-4-pair").parameters
MUSCLE = PAIR.muscle
LARGE_FORCE = 1e4
"""Tension [N] beyond any passive part, so that nothing is limited."""
TYPICAL = {"exponential": (150.0, 25.0, 0.037), "power": (550.0, 25.0)}
FORMS = pytest.mark.parametrize("form", TYPICAL)


def tension(form: str, force: float, pressure: float, contraction: float, *values: float) -> float:
    effect_form = catalogue.find_form("passive_tension", form)[1]
    p = effect_form.parameter_type(*(values or TYPICAL[form]))
    length = (1.0 - contraction) * MUSCLE.resting_length
    return float(effect_form.laws["muscle_force"](p, (), force, MUSCLE, pressure, length, 0.0))


def loss(form: str, pressure: float, contraction: float, *values: float) -> float:
    """Return the tension [N] that one of the two actuators would lose with a bladder of 10 mm."""
    lost = LARGE_FORCE - tension(form, LARGE_FORCE, pressure, contraction, *values)
    return lost / MUSCLE.n_actuators * 0.01 / (2.0 * MUSCLE.bladder_radius)


@FORMS
def test_muscle_at_rest_loses_the_offset_once_it_has_pressure(form: str) -> None:
    assert loss(form, 0.0, 0.0) == 0.0
    assert loss(form, 1e4, 0.0) == pytest.approx(25.0 * (1.0 - math.exp(-1.0)))
    assert loss(form, 5e5, 0.0) == pytest.approx(25.0)
    assert loss(form, 10.0, 0.0) == pytest.approx(25.0 * 1e-3, rel=1e-3)  # no jump at room pressure


def test_rise_is_that_of_the_equation() -> None:
    assert loss("exponential", 5e5, 0.037) == pytest.approx(25.0 + 150.0 * (1.0 - 1.0 / math.e))
    assert loss("exponential", 5e5, 0.3, 150.0, 0.0, 0.002) == pytest.approx(150.0)
    assert loss("exponential", 5e5, 0.02, 150.0, 0.0, 0.002) == pytest.approx(150.0, rel=1e-4)  # nearly a step
    assert loss("power", 5e5, 0.16, 500.0, 0.0) == pytest.approx(4.0 * loss("power", 5e5, 0.02, 500.0, 0.0))
    assert loss("power", 5e5, 0.125, 500.0, 0.0) == pytest.approx(125.0)


@FORMS
@given(contraction=st.floats(0.0, 0.29), more=st.floats(1e-3, 0.01), pressure=st.floats(0.0, 7e5))
def test_loss_grows_with_contraction_and_pressure(form: str, contraction: float, more: float, pressure: float) -> None:
    assert loss(form, pressure, contraction + more) > loss(form, pressure, contraction)
    assert loss(form, pressure + 1e4, contraction) >= loss(form, pressure, contraction)


@FORMS
@given(force=st.floats(-300.0, 1000.0), contraction=st.floats(0.0, 0.3), pressure=st.floats(0.0, 7e5))
def test_tension_is_reduced_but_never_to_a_push(form: str, force: float, contraction: float, pressure: float) -> None:
    reduced = tension(form, force, pressure, contraction)
    assert reduced <= force
    assert reduced >= min(force, 0.0)
    if force <= 0.0:
        assert reduced == force


@FORMS
def test_loss_is_in_proportion_to_the_diameter(form: str) -> None:
    effect_form = catalogue.find_form("passive_tension", form)[1]
    p = effect_form.parameter_type(*TYPICAL[form])
    small, large = (MUSCLE._replace(bladder_radius=radius) for radius in (5e-3, 15e-3))
    losses = [
        LARGE_FORCE - effect_form.laws["muscle_force"](p, (), LARGE_FORCE, m, 5e5, 0.9 * m.resting_length, 0.0)
        for m in (small, large)
    ]
    assert losses[1] == pytest.approx(3.0 * losses[0])
    assert losses[0] == pytest.approx(MUSCLE.n_actuators * loss(form, 5e5, 0.1))


@FORMS
@pytest.mark.parametrize("contraction", [0.0, 0.05, 0.12])
def test_clamped_muscle_keeps_its_slope_over_pressure(form: str, contraction: float) -> None:
    """Only the intercept changes, as in the measurements."""
    slot = catalogue.find_slot("passive_tension", form)
    keys = [parameter.key for parameter in slot.form.parameters]
    device = activate(slot, dict(zip(keys, TYPICAL[form], strict=True)), PAIR)
    length = (1.0 - contraction) * MUSCLE.resting_length
    lost = [
        dynamics.compute_muscle_force(PAIR, dynamics.ZERO_INTERNAL_STATE, pressure, length, 0.0)
        - dynamics.compute_muscle_force(device, dynamics.ZERO_INTERNAL_STATE, pressure, length, 0.0)
        for pressure in (3e5, 4e5, 5e5)
    ]
    assert lost == pytest.approx([lost[0]] * 3)
    diameter_ratio = 2.0 * MUSCLE.bladder_radius / 0.01
    assert lost[0] == pytest.approx(2.0 * diameter_ratio * loss(form, 5e5, contraction))
