"""Air through valves and in chambers: limits, transitions, closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from klute_sim.laws import valve
from klute_sim.laws.pneumatics import AIR_GAS_CONSTANT, ATMOSPHERIC_PRESSURE, speed_of_sound
from klute_sim.laws.valve import Restriction

VALVE = Restriction(1e-8, 0.4)  # 1 dm3/(s bar)
PRESSURES = st.floats(5e4, 1e6)


def test_sonic_conductance_of_one_dm3_per_s_bar() -> None:
    # By its definition: at 1 bar absolute upstream, 1 dm3/s of reference air.
    assert valve.mass_flow(VALVE, 1e5, 1e3, 293.15) == pytest.approx(1e-3 * 1.185)


@given(PRESSURES, PRESSURES, st.floats(0.0, 0.9))
def test_flow_follows_the_pressure_difference_and_reverses(first: float, second: float, critical: float) -> None:
    restriction = Restriction(1e-8, critical)
    there, back = valve.mass_flow(restriction, first, second, 300.0), valve.mass_flow(restriction, second, first, 300.0)
    assert there == -back
    assert there * (first - second) >= 0.0
    assert abs(there) <= valve.sonic_mass_flow(restriction, max(first, second), 300.0)


@given(PRESSURES, st.floats(0.0, 0.9), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_flow_does_not_fall_with_the_downstream_pressure(
    first: float, critical: float, ratio_a: float, ratio_b: float
) -> None:
    restriction = Restriction(1e-8, critical)
    low, high = sorted((ratio_a, ratio_b))
    assert valve.mass_flow(restriction, first, low * first, 300.0) >= valve.mass_flow(
        restriction, first, high * first, 300.0
    )


@pytest.mark.parametrize("critical", [0.0, 0.3, 0.528, 0.9])
def test_sonic_and_subsonic_flow_are_continuous(critical: float) -> None:
    assert valve.flow_function(critical, critical) == 1.0
    assert valve.flow_function(critical + 1e-9, critical) == pytest.approx(1.0, abs=1e-12)
    near = [valve.flow_function(critical + (1.0 - critical) * k, critical) for k in (1e-4, 1e-3)]
    assert near == pytest.approx([1.0 - 0.5e-8, 1.0 - 0.5e-6], abs=1e-9)
    edge = valve.LAMINAR_PRESSURE_RATIO
    assert valve.flow_function(edge - 1e-12, critical) == pytest.approx(valve.flow_function(edge + 1e-12, critical))
    assert valve.flow_function(1.0, critical) == 0.0


def test_flow_function_approximates_an_ideal_nozzle() -> None:
    """With b = 0.528 the ellipse is within 1 % of an isentropic nozzle's flow."""
    gamma = 1.4

    def nozzle(ratio: float) -> float:
        return math.sqrt(ratio ** (2.0 / gamma) - ratio ** ((gamma + 1.0) / gamma))

    max_flow = nozzle(0.5283)
    for ratio in (0.6, 0.75, 0.9, 0.97):
        assert valve.flow_function(ratio, 0.5283) == pytest.approx(nozzle(ratio) / max_flow, rel=0.011)


@pytest.mark.parametrize("exponent", [1.0, 1.2, 1.4])
@pytest.mark.parametrize("temperature", [293.15, 350.0])
def test_filling_and_venting_match_an_integrator(exponent: float, temperature: float) -> None:
    volume = 2e-4

    def filling(_: float, state: np.ndarray) -> list[float]:
        inflow = valve.mass_flow(VALVE, 8e5, state[0], temperature)
        return [exponent * AIR_GAS_CONSTANT * temperature * inflow / volume]

    fill = valve.filling_time(VALVE, exponent, temperature, volume, 8e5, 1e5, 3e5)
    assert solve_ivp(filling, (0.0, fill), [1e5], rtol=1e-10, atol=1e-3).y[0, -1] == pytest.approx(3e5, rel=1e-6)

    def venting(_: float, state: np.ndarray) -> list[float]:
        pressure, mass = state  # p ~ m^n, and p V = m R T
        outflow = valve.mass_flow(VALVE, pressure, ATMOSPHERIC_PRESSURE, pressure * volume / (mass * AIR_GAS_CONSTANT))
        return [-exponent * pressure / mass * outflow, -outflow]

    low = ATMOSPHERIC_PRESSURE / 0.4
    vent = valve.venting_time(VALVE, exponent, temperature, volume, 6e5, low)
    start = [6e5, 6e5 * volume / (AIR_GAS_CONSTANT * temperature)]
    assert solve_ivp(venting, (0.0, vent), start, rtol=1e-10, atol=1e-9).y[0, -1] == pytest.approx(low, rel=1e-6)
    # A 250 mm pair of some 200 cm3 fills to 5 bar in about 0.2 s through 1 dm3/(s bar), if it keeps its temperature.
    if exponent == 1.0:
        assert valve.filling_time(VALVE, 1.0, temperature, volume, 1.5e6, ATMOSPHERIC_PRESSURE, 6e5) < 0.2


def test_mass_flow_falls_with_temperature() -> None:
    # C rho0 p sqrt(T0/T): 1e-8 1.185 6e5 sqrt(293.15/333.15)
    assert valve.mass_flow(VALVE, 6e5, 1e5, 333.15) == pytest.approx(6.6697e-3, rel=1e-4)


def test_flow_is_linear_at_nearly_equal_pressures() -> None:
    flows = [valve.mass_flow(VALVE, 5e5, 5e5 * (1.0 - x), 293.15) for x in (1e-4, 2e-4, 4e-4)]
    assert flows[1] == pytest.approx(2.0 * flows[0], rel=1e-9)
    assert flows[2] == pytest.approx(4.0 * flows[0], rel=1e-9)


def test_tube_and_series_restrictions() -> None:
    # 1 m of 4 mm: 0.029 1.6e-5/sqrt(1/0.004^1.25 + 510) and 474 C/d^2
    tube = valve.tube_restriction(1.0, 0.004)
    assert tube == pytest.approx((1.1963e-8, 0.35440), rel=1e-3)
    both = valve.combine_in_series(Restriction(1e-8, 0.4), Restriction(2e-8, 0.2))
    # 1/C^3 = 1e24 (1 + 1/8); b = 1 - C^2 (0.6/1e-16 + 0.8/4e-16)
    assert both == pytest.approx((0.96150e-8, 1.0 - 0.92448 * 0.8), rel=1e-4)
    wide = valve.combine_in_series(Restriction(1e-8, 0.4), Restriction(1e-4, 0.1))
    assert wide == pytest.approx((1e-8, 0.4), rel=1e-6)


@pytest.mark.parametrize(("temperature", "speed"), [(273.15, 331.3), (293.15, 343.2), (313.15, 354.7)])
def test_speed_of_sound_is_that_of_tables(temperature: float, speed: float) -> None:
    assert speed_of_sound(temperature) == pytest.approx(speed, rel=1e-3)


@given(PRESSURES, st.floats(0.0, 0.99), st.floats(0.1, 20.0), st.floats(1e-3, 0.02), st.floats(250.0, 330.0))
def test_hose_passes_the_flow_of_an_isothermal_pipe(
    pressure: float, ratio: float, length: float, diameter: float, temperature: float
) -> None:
    """``G^2 f L/(2 d) = int rho dp = (p1^2 - p2^2)/(2 R T)``, with the flow per area G and f = 0.02 after Darcy."""
    downstream = max(ratio * pressure, 1.0)
    area = math.pi * (diameter / 2.0) ** 2
    flow = valve.mass_flow(valve.hose_restriction(length, diameter), pressure, downstream, temperature)
    loss = (flow / area) ** 2 * 0.02 * length / diameter
    assert loss == pytest.approx((pressure**2 - downstream**2) / (287.05 * temperature), rel=1e-3)
