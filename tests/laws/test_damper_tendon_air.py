"""Damper, tendon and gas: the source's design numbers, inverses, limits and signs."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.device.device import load_device
from klute_sim.laws import damper, mckibben, pneumatics, tendon
from klute_sim.laws.damper import DamperParameters
from klute_sim.laws.pneumatics import SupplyParameters
from klute_sim.laws.tendon import TendonParameters

OIL = 900.0
SPRINGS = TendonParameters(
    slack_length=0.1, stiffness_1=60e3, stiffness_2=140e3, engagement_stretch=0.005, is_rigid=False
)
SUPPLY = SupplyParameters(max_pressure=5e5, max_pressure_rate=50e5, temperature=293.15)

speeds = st.floats(-1.0, 1.0)


def test_design_points_of_the_pair() -> None:
    assert 1e3 * damper.required_orifice(1472, 0.3, 0.02, OIL, 1.0) == pytest.approx(1.084, abs=5e-4)
    assert 1e3 * damper.required_orifice(400, 0.15, 0.02, OIL, 1.0) == pytest.approx(1.062, abs=5e-4)
    assert 1e3 * damper.required_orifice(441, 0.15, 0.02, OIL, 1.0) == pytest.approx(1.036, abs=6e-4)
    assert damper.required_bore(1472, 4.7e6) == pytest.approx(0.02, rel=2e-3)


def test_default_prosthesis_is_sized_by_the_same_equations() -> None:
    device = load_device("klute-1-1-4-pair")
    muscle, sized = device.parameters.muscle, device.spec.damper
    assert sized is not None
    full = mckibben.force(muscle, 5e5, 0.96 * muscle.resting_length)
    bore = 1e-3 * sized.bore_mm
    assert damper.desired_force(full, 0.0) == pytest.approx(2707, abs=1)
    assert damper.required_bore(full, 4.7e6) == pytest.approx(bore, rel=5e-3)
    assert 1e3 * damper.required_orifice(full, 0.3, bore, OIL, 1.0) == pytest.approx(
        sized.orifice_concentric_mm, abs=1e-3
    )
    eccentric = 1e3 * damper.required_orifice(0.3 * full, 0.15, bore, OIL, 1.0)
    assert eccentric == pytest.approx(sized.orifice_eccentric_mm, abs=1e-3)
    stretch = tendon.stretch_at_tension(device.parameters.tendon, 2234.0)
    unit_length = device.parameters.tendon.slack_length + muscle.resting_length
    assert stretch / unit_length == pytest.approx(0.04, abs=0.002)


@given(st.floats(1.0, 5e3), st.floats(0.01, 1.0), st.floats(0.005, 0.05), st.floats(0.5, 1.0))
def test_orifice_and_coefficient_are_inverse(force: float, speed: float, bore: float, discharge: float) -> None:
    orifice = damper.required_orifice(force, speed, bore, OIL, discharge)
    back = damper.orifice_coefficient(bore, orifice, OIL, discharge) * speed * speed
    assert back == pytest.approx(force, rel=1e-9)


def test_discharge_coefficient_of_0_61_raises_the_coefficient_2_69_times() -> None:
    ratio = damper.orifice_coefficient(0.02, 0.001, OIL, 0.61) / damper.orifice_coefficient(0.02, 0.001, OIL, 1.0)
    assert ratio == pytest.approx(2.69, abs=0.01)


@given(speeds, st.floats(0.0, 1e6), st.floats(0.0, 1e6))
def test_damper_is_passive_and_quadratic(speed: float, concentric: float, eccentric: float) -> None:
    device = DamperParameters(concentric, eccentric)
    force = damper.force(device, speed)
    assert force * speed >= 0.0
    assert damper.force(device, 2.0 * speed) == pytest.approx(4.0 * force)


def test_damper_direction_selects_the_orifice() -> None:
    device = DamperParameters(concentric_coefficient=100.0, eccentric_coefficient=200.0)
    assert damper.force(device, -1.0) == -100.0
    assert damper.force(device, +1.0) == +200.0


@given(st.floats(-0.05, 0.05))
def test_tendon_force_is_the_slope_of_its_energy(stretch: float) -> None:
    d = 1e-7
    slope = (tendon.stored_energy(SPRINGS, stretch + d) - tendon.stored_energy(SPRINGS, stretch - d)) / (2 * d)
    assert tendon.force(SPRINGS, stretch) == pytest.approx(slope, abs=0.02)


@given(st.floats(0.0, 5e3))
def test_stretch_at_tension_inverts_force(force: float) -> None:
    assert tendon.force(SPRINGS, tendon.stretch_at_tension(SPRINGS, force)) == pytest.approx(force, abs=1e-9, rel=1e-12)


def test_tendon_is_bilinear_and_never_pushes() -> None:
    assert tendon.force(SPRINGS, -0.01) == 0.0
    assert tendon.stored_energy(SPRINGS, -0.01) == 0.0
    assert tendon.force(SPRINGS, 0.005) == pytest.approx(300.0)
    assert tendon.force(SPRINGS, 0.010) == pytest.approx(300.0 + 5e-3 * 200e3)
    assert math.isnan(tendon.stretch_at_tension(SPRINGS._replace(is_rigid=True), 1.0))


@given(st.floats(0.0, 5e5), st.floats(-1e6, 2e6), st.floats(1e-5, 0.1))
def test_regulator_respects_range_and_rate_of_the_supply(start: float, command: float, step: float) -> None:
    after = pneumatics.regulate(SUPPLY, start, command, step)
    assert 0.0 <= after <= SUPPLY.max_pressure
    assert abs(after - start) <= SUPPLY.max_pressure_rate * step * (1 + 1e-9)


def test_regulator_reaches_a_reachable_command_exactly() -> None:
    assert pneumatics.regulate(SUPPLY, 1e5, 1.01e5, 1e-3) == 1.01e5
    assert pneumatics.regulate(SUPPLY, 1e5, 5e5, 1e-3) == 1e5 + 50e5 * 1e-3
    assert pneumatics.regulate(SUPPLY, 1e5, 9e5, 1.0) == 5e5


def test_air_mass_of_one_litre_at_atmospheric_pressure() -> None:
    assert pneumatics.air_mass(0.0, 1e-3, 293.15) == pytest.approx(1.204e-3, rel=1e-3)
    assert pneumatics.air_mass(pneumatics.ATMOSPHERIC_PRESSURE, 1e-3, 293.15) == pytest.approx(2 * 1.204e-3, rel=1e-3)
