"""Tests of the force-velocity curves and of the comparison with the design envelope."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.device.device import load_device
from klute_sim.laws import hill as hill_law
from klute_sim.laws.hill import HillCurve
from klute_sim.laws.hill_tables import GENERIC_CONTRACTILE_ELEMENT, GENERIC_HILL_CURVE
from klute_sim.laws.mckibben import MuscleParameters
from klute_sim.sizing.choices import DesignChoices
from klute_sim.sizing.evaluation import isometric, velocity
from klute_sim.sizing.parts import actuator, damper
from klute_sim.sizing.target import MuscleTarget

PAIR = actuator.build_muscle("klute-3-4", 2, 0.250)
SPEEDS = velocity.build_velocity_grid(0.150, 0.300)


def compute_curves(
    target: MuscleTarget | None = None, muscle: MuscleParameters = PAIR, ratio: float = 0.96
) -> velocity.ForceVelocityCurves:
    target = target or MuscleTarget()
    sized = damper.size_damper(target, actuator.compute_isometric_force(muscle, 5e5, ratio), DesignChoices())
    return velocity.compute_force_velocity(muscle, sized.to_damper(), target.hill, 0.300, SPEEDS, 5e5, ratio)


def test_velocity_grid_contains_both_ends_and_one_zero() -> None:
    assert SPEEDS[0] == -0.150
    assert SPEEDS[-1] == 0.300
    assert (SPEEDS == 0.0).sum() == 1
    assert (np.diff(SPEEDS) > 0.0).all()


def test_curves_meet_at_rest_and_end_at_design_points() -> None:
    curves = compute_curves()
    rest = SPEEDS == 0.0
    for force in (curves.muscle, curves.actuator_only, curves.ideal_damper, curves.fixed_orifices):
        assert force[rest] == pytest.approx(curves.isometric)
    assert curves.fixed_orifices[-1] == pytest.approx(0.0, abs=0.005 * curves.isometric)
    assert curves.fixed_orifices[0] == pytest.approx(1.3 * curves.isometric, rel=0.005)
    assert (curves.actuator_only == curves.isometric).all()


def test_fixed_orifices_lie_between_actuator_and_muscle() -> None:
    curves = compute_curves()
    actuator_error, ideal_error, fixed_error = (
        velocity.compute_rms_error(curves, f)
        for f in (curves.actuator_only, curves.ideal_damper, curves.fixed_orifices)
    )
    assert ideal_error.concentric < 1e-12
    assert ideal_error.eccentric < 1e-12
    assert 0.0 < fixed_error.concentric < actuator_error.concentric
    assert 0.0 < fixed_error.eccentric < actuator_error.eccentric


def test_rms_error_matches_closed_form() -> None:
    curves = compute_curves(MuscleTarget(hill=GENERIC_HILL_CURVE))
    x = np.linspace(0.0, 1.0, 200_001)
    muscle = 1.0 - 1.28 * x / (x + 0.28)
    fixed_error = velocity.compute_rms_error(curves, curves.fixed_orifices).concentric
    assert fixed_error == pytest.approx(np.sqrt(np.mean((1.0 - x * x - muscle) ** 2)), rel=0.005)
    actuator_error = velocity.compute_rms_error(curves, curves.actuator_only).concentric
    assert actuator_error == pytest.approx(np.sqrt(np.mean((1.0 - muscle) ** 2)), rel=0.005)


def test_ideal_damper_only_brakes() -> None:
    for hill in (GENERIC_HILL_CURVE, HillCurve(0.1, 0.4), HillCurve(0.4, 0.1)):
        curves = compute_curves(MuscleTarget(hill=hill))
        assert (curves.damping * curves.velocity >= 0.0).all()
        assert (curves.muscle >= 0.0).all()


def test_required_orifice_gives_ideal_damping() -> None:
    curves = compute_curves()
    diameters = velocity.compute_required_orifices(curves, 0.020, 900.0, 1.0)
    assert np.isnan(diameters[SPEEDS == 0.0]).all()
    for index in (0, 100, 250, 600):
        oil = abs(SPEEDS[index]) * (0.020 / diameters[index]) ** 2
        drop = 0.5 * 900.0 * (oil**2 - SPEEDS[index] ** 2)
        assert drop * np.pi * 0.020**2 / 4.0 == pytest.approx(abs(curves.damping[index]))
    shortening = diameters[SPEEDS > 0.0]
    assert (np.diff(shortening) > 0.0).all()
    assert shortening[-1] / shortening[0] > 3.0


def test_one_sided_velocities_have_one_error() -> None:
    curves = velocity.compute_force_velocity(
        PAIR,
        damper.size_damper(MuscleTarget(), 1472.0, DesignChoices()).to_damper(),
        GENERIC_HILL_CURVE,
        0.3,
        SPEEDS[300:],
        5e5,
        1.0,
    )
    assert np.isnan(velocity.compute_rms_error(curves, curves.fixed_orifices).eccentric)
    assert velocity.compute_rms_error(curves, curves.fixed_orifices).concentric > 0.0


@given(st.floats(0.15, 0.6))
def test_fit_recovers_hyperbola(shape: float) -> None:
    x = np.linspace(0.0, 1.0, 101)
    assert isometric.fit_hyperbola(x, 1.0 - (1.0 + shape) * x / (x + shape)) == pytest.approx(shape, rel=0.01)


def test_square_law_has_no_hyperbola() -> None:
    x = np.linspace(0.0, 1.0, 101)
    assert isometric.fit_hyperbola(x, 1.0 - x * x) is None
    assert isometric.fit_hyperbola(x, 1.0 - x) is None


@pytest.mark.parametrize("preset", ["klute-1-1-4", "klute-3-4", "klute-1-2"])
def test_isometric_curve_of_actuator_violates_envelope(preset: str) -> None:
    parabola = isometric.fit_parabola(actuator.build_muscle(preset, 1, 0.200), 5e5)
    assert parabola.k5 > 0.0 > parabola.k6
    violated_bounds = {b.name for b in isometric.compare_with_envelope(parabola, None, 1.3) if not b.is_met}
    assert violated_bounds == {"k5", "k6", "k7", "a/F0", "b/Vmax"}


def test_parabola_minimizes_squared_error() -> None:
    parabola = isometric.fit_parabola(PAIR, 5e5)
    x = np.linspace(0.65, 1.0, 201)
    force = np.array([actuator.compute_isometric_force(PAIR, 5e5, float(r)) for r in x])
    force /= actuator.compute_isometric_force(PAIR, 5e5, 1.0)

    def error(k: hill_law.ContractileElement) -> float:
        return float(((np.array([hill_law.isometric_force(k, float(r)) for r in x]) - force) ** 2).sum())

    for name in ("k5", "k6", "k7"):
        for change in (-0.05, 0.05):
            assert error(parabola._replace(**{name: getattr(parabola, name) + change})) > error(parabola)


def test_generic_muscle_meets_envelope() -> None:
    assert all(
        bound.is_met
        for bound in isometric.compare_with_envelope(GENERIC_CONTRACTILE_ELEMENT, GENERIC_HILL_CURVE.a, 1.3)
    )
    for saturation in (1.27, 1.33):
        assert not isometric.compare_with_envelope(GENERIC_CONTRACTILE_ELEMENT, GENERIC_HILL_CURVE.a, saturation)[
            -1
        ].is_met
    for shape in (0.11, 0.42):
        violated_bounds = [
            b.name for b in isometric.compare_with_envelope(GENERIC_CONTRACTILE_ELEMENT, shape, 1.3) if not b.is_met
        ]
        assert violated_bounds == ["a/F0", "b/Vmax"]


@pytest.mark.parametrize("preset", ["klute-1-1-4", "klute-3-4", "klute-1-2"])
@pytest.mark.parametrize("bar", [2.0, 3.0, 4.0, 5.0])
def test_isometric_curve_is_convex_in_every_range(preset: str, bar: float) -> None:
    muscle = load_device(preset).parameters.muscle
    for low in (0.65, 0.75, 0.85):
        for high in (0.92, 0.96, 1.0):
            assert isometric.fit_parabola(muscle, bar * 1e5, (low, high)).k5 > 0.0


def test_sign_of_k7_depends_on_fit_range() -> None:
    muscle = load_device("klute-3-4").parameters.muscle
    assert isometric.fit_parabola(muscle, 5e5).k7 == pytest.approx(0.22, abs=0.005)
    assert isometric.fit_parabola(muscle, 5e5, (0.65, 0.96)).k7 == pytest.approx(-0.60, abs=0.005)
