"""Elastic chambers of the damper against closed forms of a Maxwell element, of a gas and of oil."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from klute_sim.laws import damper as orifice
from klute_sim.laws import damper_chamber
from klute_sim.laws.damper import DamperParameters
from klute_sim.laws.damper_chamber import DamperState
from tests.laws.damper_motion import compute_work, move_piston

AREA = 3.0e-4
PA = 101325.0
OIL_COMPLIANCE = 0.04 / (1.5e9 * AREA)  # m/N of a column of 40 mm


def linear_damper(damping: float, air_volume: float) -> DamperParameters:
    """Return a damper that is linear with ``damping`` [N s/m] at all speeds of the tests."""
    speed = 50.0
    return DamperParameters(damping / speed, damping / speed, AREA, speed, air_volume)


@pytest.mark.parametrize("omega_tau", [0.1, 1.0, 10.0])
@pytest.mark.parametrize("air_volume", [2e-7, 1e-6])
def test_small_cycle_has_area_and_phase_of_a_maxwell_element(omega_tau: float, air_volume: float) -> None:
    """Area ``pi X^2 k wt/(1 + (wt)^2)``, phase lead ``atan(1/(wt))``, with ``1/k = Va/(A^2 pa) + h/(A B)``."""
    stiffness, damping, amplitude = 1.0 / (air_volume / (AREA**2 * PA) + OIL_COMPLIANCE), 800.0, 1e-6
    omega = omega_tau * stiffness / damping
    n = 1500
    time = 2.0 * math.pi / omega / n * np.arange(4 * n + 1)
    x = amplitude * np.sin(omega * time)
    force = move_piston(linear_damper(damping, air_volume), x, time[1])
    last = slice(-n - 1, None)
    area = compute_work(force[last], x[last])
    assert area == pytest.approx(math.pi * amplitude**2 * stiffness * omega_tau / (1.0 + omega_tau**2), rel=0.02)
    sine, cosine = (2.0 / n * np.sum(force[-n:] * wave(omega * time[-n:])) for wave in (np.sin, np.cos))
    assert math.atan2(cosine, sine) == pytest.approx(math.atan(1.0 / omega_tau), abs=0.02)


def test_slow_motion_gives_the_force_of_the_orifice() -> None:
    damper = DamperParameters(2e4, 3e4, AREA, 0.0, 1e-6)
    for velocity in (0.1, -0.1):
        x = velocity * 1e-4 * np.arange(4000)
        assert move_piston(damper, x, 1e-4)[-1] == pytest.approx(orifice.force(damper, velocity), rel=1e-6)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_fast_motion_compresses_air_by_boyle_and_oil_by_hooke(side: float) -> None:
    """The orifice is all but closed."""
    air_volume, stroke = 1e-6, 2.5e-3
    damper = DamperParameters(1e12, 1e12, AREA, 0.0, air_volume)
    force = side * move_piston(damper, side * np.linspace(0.0, stroke, 200), 1e-9)[1:]
    x = np.linspace(0.0, stroke, 200)[1:]
    volume = air_volume - AREA * (x - OIL_COMPLIANCE * force)
    assert (PA + force / AREA) * volume == pytest.approx(PA * air_volume, rel=1e-6)
    assert force[-1] / force[0] > 3.0 * x[-1] / x[0] / 2.0  # it stiffens


def test_compressed_air_returns_its_energy() -> None:
    damper = DamperParameters(1e12, 1e12, AREA, 0.0, 1e-6)
    there = np.linspace(0.0, 2e-3, 2001)
    x = np.concatenate([there, there[-2::-1]])
    force = move_piston(damper, x, 1e-9)
    stored, returned = compute_work(force[:2001], there), -compute_work(force[2000:], x[2000:])
    # Integral of p A over the stroke; the oil's share is below 1 %.
    stroke = 1e-6 / AREA
    assert stored == pytest.approx(PA * AREA * (stroke * math.log(stroke / (stroke - 2e-3)) - 2e-3), rel=0.02)
    assert returned == pytest.approx(stored, rel=1e-3)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    air_volume=st.just(0.0) | st.floats(1e-9, 1e-5),
    transition_speed=st.sampled_from([0.0, 0.04]),
    rod_area=st.sampled_from([0.0, 0.5 * AREA]),
    inverse_charge=st.sampled_from([0.0, 1e-5, 1e-6]),
    dt=st.sampled_from([1e-5, 5e-4, 5e-3]),
)
def test_no_motion_creates_energy(
    seed: int, air_volume: float, transition_speed: float, rod_area: float, inverse_charge: float, dt: float
) -> None:
    random = np.random.default_rng(seed)
    x = np.cumsum(random.normal(0.0, 2e-4, 400) * (random.random(400) < 0.7))
    damper = DamperParameters(3e4, 1e4, AREA, transition_speed, air_volume, rod_area, inverse_charge)
    force = move_piston(damper, x, dt)
    work = np.cumsum(force[1:] * np.diff(x))
    assert work.min() >= -1e-12


@given(st.floats(0.0, 5e3), st.booleans())
def test_compliance_is_the_slope_of_the_compression(force: float, suction: bool) -> None:
    damper = DamperParameters(1e4, 1e4, AREA, 0.0, 1e-6, 0.0, 1.0 / 200e5)
    step = 1e-3 * (1.0 + force)
    before, after = (damper_chamber.compute_compression(damper, AREA, f, suction) for f in (force, force + step))
    slope = after - before
    assert damper_chamber.compute_compliance(damper, AREA, force + 0.5 * step, suction) == pytest.approx(
        slope / step, rel=1e-4
    )


def test_long_step_ends_in_equilibrium() -> None:
    damper = DamperParameters(1e4, 1e4, AREA, 0.0, 1e-6)
    state = damper_chamber.step_chambers(damper, DamperState(500.0, 0.0, 0.0), -0.02, 1e9)
    assert state.force == pytest.approx(0.0, abs=1e-12)
    assert state.length == -0.02


def test_damper_without_air_or_bore_is_rigid() -> None:
    assert not damper_chamber.has_elastic_chambers(DamperParameters(1e4, 1e4, AREA))
    assert not damper_chamber.has_elastic_chambers(DamperParameters(0.0, 0.0, 0.0, 0.0, 1e-6))
    assert damper_chamber.has_elastic_chambers(DamperParameters(1e4, 1e4, AREA, 0.0, 1e-9))


@pytest.mark.parametrize("transition_speed", [0.0, 0.05])
def test_rod_reduces_flow_and_area_of_the_lengthening_side(transition_speed: float) -> None:
    """The force follows from flow ``r A v``, pressure ``c/A^3 q sqrt(q^2 + (A vc)^2)`` and area ``r A``."""
    c, rod_area, speed = 3e4, 0.25 * AREA, 0.1
    damper = DamperParameters(2e4, c, AREA, transition_speed, 0.0, rod_area)
    flow = 0.75 * AREA * speed
    pressure = c / AREA**3 * flow * math.hypot(flow, AREA * transition_speed)
    assert orifice.force(damper, speed) == pytest.approx(0.75 * AREA * pressure)
    assert orifice.force(damper, -speed) == orifice.force(damper._replace(rod_area=0.0), -speed)
    elastic = damper._replace(air_volume=1e-6)
    x = speed * 1e-4 * np.arange(4000)
    assert move_piston(elastic, x, 1e-4)[-1] == pytest.approx(orifice.force(damper, speed), rel=1e-6)
    assert orifice.force(damper._replace(rod_area=2.0 * AREA), speed) == 0.0
    assert move_piston(elastic._replace(rod_area=AREA), x, 1e-4)[-1] == 0.0


def test_trapped_air_on_the_rod_side_acts_on_the_annulus() -> None:
    damper = DamperParameters(1e12, 1e12, AREA, 0.0, 1e-6, 0.25 * AREA)
    force = move_piston(damper, np.array([0.0, 1e-6]), 1e-9)[-1]
    assert force == pytest.approx((0.75 * AREA) ** 2 * PA / 1e-6 * 1e-6, rel=0.01)


@pytest.mark.parametrize(("transition_speed", "rod_area"), [(0.0, 0.0), (0.03, 0.0), (0.0, 0.25 * AREA)])
@pytest.mark.parametrize("charge", [1e5, 3e5])
def test_cavitation_limits_the_force_and_leaves_a_dead_stroke(
    charge: float, transition_speed: float, rod_area: float
) -> None:
    """Strokes X at constant speed: ``(A p0 + F_out)(X - s)`` is lost; the dead stroke s is ``X (v - w)/(v + w)``."""
    damper, speed, stroke, dt = DamperParameters(3e4, 1e4, AREA, transition_speed), 0.3, 0.01, 1e-5
    damper = damper._replace(rod_area=rod_area, inverse_charge=1.0 / charge)
    n = round(stroke / speed / dt)
    x = speed * dt * np.concatenate([-np.arange(n + 1), np.arange(-n + 1, 1)])
    force = move_piston(damper, x, dt)
    limit = charge * (AREA - rod_area)
    assert force.min() == pytest.approx(-limit, rel=1e-12)
    # The flow q at which the orifice carries p0, from p0 = c/A^3 q sqrt(q^2 + (A vc)^2).
    q = np.linspace(0.0, 0.3, 300_001) * AREA
    q_limit = float(np.interp(charge, 3e4 / AREA**3 * q * np.hypot(q, AREA * transition_speed), q))
    w = q_limit / (AREA - rod_area)
    dead = stroke * (speed - w) / (speed + w)
    assert np.count_nonzero(force[n + 1 :] < 0.0) * speed * dt == pytest.approx(dead, abs=3.0 * speed * dt)
    out = orifice.force(damper, speed)
    assert force[-1] == pytest.approx(out)
    assert compute_work(force, x) == pytest.approx((limit + out) * (stroke - dead), rel=0.02)


def test_cavitation_spares_slow_shortening_and_all_lengthening() -> None:
    damper = DamperParameters(3e4, 3e4, AREA, 0.0, 0.0, 0.0, 1e-5)
    for velocity in (-0.03, 0.5):  # 27 N of a limit of 30 N; lengthening compresses
        x = velocity * 1e-4 * np.arange(200)
        assert move_piston(damper, x, 1e-4)[1:] == pytest.approx(orifice.force(damper, velocity))


def test_air_in_a_charged_damper_expands_by_boyle() -> None:
    """The orifice is all but closed, and the air was let in at atmospheric pressure."""
    air_volume, charge = 1e-6, 2e5
    damper = DamperParameters(1e12, 1e12, AREA, 0.0, air_volume, 0.0, 1.0 / charge)
    x = -np.linspace(0.0, 5e-3, 200)
    force = move_piston(damper, x, 1e-9)
    oil = OIL_COMPLIANCE * force
    volume = air_volume * PA / charge - AREA * (x - oil)
    assert (charge + force / AREA) * volume == pytest.approx(PA * air_volume, rel=1e-6)
    assert -charge * AREA < force[-1] < -0.7 * charge * AREA
