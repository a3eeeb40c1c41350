"""Force over velocity, and how muscle-like it is."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.device.device import load_device
from klute_sim.laws import hill as hill_law
from klute_sim.laws.hill import HillCurve
from klute_sim.laws.hill_tables import GENERIC_CONTRACTILE_ELEMENT, GENERIC_HILL_CURVE
from klute_sim.laws.mckibben import Muscle
from klute_sim.sizing.choices import DesignChoices
from klute_sim.sizing.evaluation import isometric, velocity
from klute_sim.sizing.parts import actuator, damper
from klute_sim.sizing.target import MuscleTarget

PAIR = actuator.build_muscle("klute-3-4", 2, 0.250)
SPEEDS = velocity.velocity_grid(0.150, 0.300)


def curves(
    target: MuscleTarget | None = None, muscle: Muscle = PAIR, ratio: float = 0.96
) -> velocity.ForceVelocityCurves:
    target = target or MuscleTarget()
    sized = damper.size_damper(target, actuator.isometric_force(muscle, 5e5, ratio), DesignChoices())
    return velocity.compute_force_velocity(muscle, sized.to_damper(), target.hill, 0.300, SPEEDS, 5e5, ratio)


def test_the_grid_has_both_ends_and_rest_once() -> None:
    assert SPEEDS[0] == -0.150
    assert SPEEDS[-1] == 0.300
    assert (SPEEDS == 0.0).sum() == 1
    assert (np.diff(SPEEDS) > 0.0).all()


def test_all_four_meet_at_rest_and_the_ends_are_the_design_points() -> None:
    own = curves()
    rest = SPEEDS == 0.0
    for force in (own.muscle, own.actuator_only, own.ideal_damper, own.fixed_orifices):
        assert force[rest] == pytest.approx(own.isometric)
    assert own.fixed_orifices[-1] == pytest.approx(0.0, abs=0.005 * own.isometric)
    assert own.fixed_orifices[0] == pytest.approx(1.3 * own.isometric, rel=0.005)
    assert (own.actuator_only == own.isometric).all()


def test_an_ideal_damper_is_the_muscle_and_fixed_orifices_are_in_between() -> None:
    own = curves()
    alone, ideal, fixed = (
        velocity.compute_rms_error(own, f) for f in (own.actuator_only, own.ideal_damper, own.fixed_orifices)
    )
    assert ideal.concentric < 1e-12
    assert ideal.eccentric < 1e-12
    assert 0.0 < fixed.concentric < alone.concentric
    assert 0.0 < fixed.eccentric < alone.eccentric


def test_the_misfit_is_that_of_the_closed_forms() -> None:
    own = curves(MuscleTarget(hill=GENERIC_HILL_CURVE))
    x = np.linspace(0.0, 1.0, 200_001)
    muscle = 1.0 - 1.28 * x / (x + 0.28)
    fixed = velocity.compute_rms_error(own, own.fixed_orifices).concentric
    assert fixed == pytest.approx(np.sqrt(np.mean((1.0 - x * x - muscle) ** 2)), rel=0.005)
    alone = velocity.compute_rms_error(own, own.actuator_only).concentric
    assert alone == pytest.approx(np.sqrt(np.mean((1.0 - muscle) ** 2)), rel=0.005)


def test_the_ideal_damper_only_brakes() -> None:
    for hill in (GENERIC_HILL_CURVE, HillCurve(0.1, 0.4), HillCurve(0.4, 0.1)):
        own = curves(MuscleTarget(hill=hill))
        assert (own.damping * own.velocity >= 0.0).all()
        assert (own.muscle >= 0.0).all()


def test_the_needed_orifice_gives_the_ideal_damping() -> None:
    own = curves()
    needed = velocity.required_orifice(own, 0.020, 900.0, 1.0)
    assert np.isnan(needed[SPEEDS == 0.0]).all()
    for at in (0, 100, 250, 600):
        oil = abs(SPEEDS[at]) * (0.020 / needed[at]) ** 2
        drop = 0.5 * 900.0 * (oil**2 - SPEEDS[at] ** 2)
        assert drop * np.pi * 0.020**2 / 4.0 == pytest.approx(abs(own.damping[at]))
    shortening = needed[SPEEDS > 0.0]
    assert (np.diff(shortening) > 0.0).all()
    assert shortening[-1] / shortening[0] > 3.0


def test_one_sided_velocities_have_one_misfit() -> None:
    own = velocity.compute_force_velocity(
        PAIR,
        damper.size_damper(MuscleTarget(), 1472.0, DesignChoices()).to_damper(),
        GENERIC_HILL_CURVE,
        0.3,
        SPEEDS[300:],
        5e5,
        1.0,
    )
    assert np.isnan(velocity.compute_rms_error(own, own.fixed_orifices).eccentric)
    assert velocity.compute_rms_error(own, own.fixed_orifices).concentric > 0.0


@given(st.floats(0.15, 0.6))
def test_a_hyperbola_is_found_again(shape: float) -> None:
    x = np.linspace(0.0, 1.0, 101)
    assert isometric.fit_hyperbola(x, 1.0 - (1.0 + shape) * x / (x + shape)) == pytest.approx(shape, rel=0.01)


def test_a_square_law_is_no_hyperbola() -> None:
    x = np.linspace(0.0, 1.0, 101)
    assert isometric.fit_hyperbola(x, 1.0 - x * x) is None
    assert isometric.fit_hyperbola(x, 1.0 - x) is None


@pytest.mark.parametrize("preset", ["klute-1-1-4", "klute-3-4", "klute-1-2"])
def test_the_actuators_isometric_curve_bends_the_wrong_way(preset: str) -> None:
    fitted = isometric.fit_parabola(actuator.build_muscle(preset, 1, 0.200), 5e5)
    assert fitted.k5 > 0.0 > fitted.k6
    missed = {b.name for b in isometric.compare_with_envelope(fitted, None, 1.3) if not b.is_met}
    assert missed == {"k5", "k6", "k7", "a/F0", "b/Vmax"}


def test_the_parabola_is_the_nearest() -> None:
    fitted = isometric.fit_parabola(PAIR, 5e5)
    x = np.linspace(0.65, 1.0, 201)
    force = np.array([actuator.isometric_force(PAIR, 5e5, float(r)) for r in x])
    force /= actuator.isometric_force(PAIR, 5e5, 1.0)

    def error(k: hill_law.ContractileElement) -> float:
        return float(((np.array([hill_law.isometric_force(k, float(r)) for r in x]) - force) ** 2).sum())

    for name in ("k5", "k6", "k7"):
        for change in (-0.05, 0.05):
            assert error(fitted._replace(**{name: getattr(fitted, name) + change})) > error(fitted)


def test_the_generic_muscle_meets_the_envelope() -> None:
    assert all(
        bound.is_met
        for bound in isometric.compare_with_envelope(GENERIC_CONTRACTILE_ELEMENT, GENERIC_HILL_CURVE.a, 1.3)
    )
    for saturation in (1.27, 1.33):
        assert not isometric.compare_with_envelope(GENERIC_CONTRACTILE_ELEMENT, GENERIC_HILL_CURVE.a, saturation)[
            -1
        ].is_met
    for shape in (0.11, 0.42):
        missed = [
            b.name for b in isometric.compare_with_envelope(GENERIC_CONTRACTILE_ELEMENT, shape, 1.3) if not b.is_met
        ]
        assert missed == ["a/F0", "b/Vmax"]


@pytest.mark.parametrize("preset", ["klute-1-1-4", "klute-3-4", "klute-1-2"])
@pytest.mark.parametrize("bar", [2.0, 3.0, 4.0, 5.0])
def test_the_isometric_curve_is_convex_wherever_a_parabola_is_fitted(preset: str, bar: float) -> None:
    muscle = load_device(preset).parameters.muscle
    for low in (0.65, 0.75, 0.85):
        for high in (0.92, 0.96, 1.0):
            assert isometric.fit_parabola(muscle, bar * 1e5, (low, high)).k5 > 0.0


def test_the_sign_of_k7_depends_on_where_the_parabola_is_fitted() -> None:
    muscle = load_device("klute-3-4").parameters.muscle
    assert isometric.fit_parabola(muscle, 5e5).k7 == pytest.approx(0.22, abs=0.005)
    assert isometric.fit_parabola(muscle, 5e5, (0.65, 0.96)).k7 == pytest.approx(-0.60, abs=0.005)
