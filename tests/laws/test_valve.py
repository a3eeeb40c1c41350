"""Air through valves and in chambers: limits, transitions, closed forms."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from klute_sim.laws import valve
from klute_sim.laws.pneumatics import AIR_CONSTANT, ATMOSPHERE
from klute_sim.laws.valve import Chamber, Restriction

VALVE = Restriction(1e-8, 0.4)  # 1 dm3/(s bar)
ROOM = Chamber(1.0, 293.15)
PRESSURES = st.floats(5e4, 1e6)


def test_one_decimetre_per_second_and_bar() -> None:
    # By its definition: at 1 bar absolute upstream, 1 dm3/s of reference air.
    assert valve.flow(VALVE, 1e5, 1e3, 293.15) == pytest.approx(1e-3 * 1.185)


@given(PRESSURES, PRESSURES, st.floats(0.0, 0.9))
def test_flow_goes_down_and_turns_round(first: float, second: float, critical: float) -> None:
    restriction = Restriction(1e-8, critical)
    there, back = valve.flow(restriction, first, second, 300.0), valve.flow(restriction, second, first, 300.0)
    assert there == -back
    assert there * (first - second) >= 0.0
    assert abs(there) <= valve.sonic_flow(restriction, max(first, second), 300.0)


@given(PRESSURES, st.floats(0.0, 0.9), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_flow_never_falls_when_the_outside_does(first: float, critical: float, one: float, other: float) -> None:
    restriction = Restriction(1e-8, critical)
    low, high = sorted((one, other))
    assert valve.flow(restriction, first, low * first, 300.0) >= valve.flow(restriction, first, high * first, 300.0)


@pytest.mark.parametrize("critical", [0.0, 0.3, 0.528, 0.9])
def test_sonic_and_subsonic_flow_join(critical: float) -> None:
    assert valve.flow_share(critical, critical) == 1.0
    assert valve.flow_share(critical + 1e-9, critical) == pytest.approx(1.0, abs=1e-12)
    near = [valve.flow_share(critical + (1.0 - critical) * k, critical) for k in (1e-4, 1e-3)]
    assert near == pytest.approx([1.0 - 0.5e-8, 1.0 - 0.5e-6], abs=1e-9)
    edge = valve.LAMINAR
    assert valve.flow_share(edge - 1e-12, critical) == pytest.approx(valve.flow_share(edge + 1e-12, critical))
    assert valve.flow_share(1.0, critical) == 0.0


def test_an_ideal_nozzle_is_nearly_the_ellipse() -> None:
    """With b = 0.528 the ellipse is within 1 % of an isentropic nozzle's flow."""
    gamma = 1.4

    def nozzle(ratio: float) -> float:
        return math.sqrt(ratio ** (2.0 / gamma) - ratio ** ((gamma + 1.0) / gamma))

    most = nozzle(0.5283)
    for ratio in (0.6, 0.75, 0.9, 0.97):
        assert valve.flow_share(ratio, 0.5283) == pytest.approx(nozzle(ratio) / most, rel=0.011)


@pytest.mark.parametrize("exponent", [1.0, 1.2, 1.4])
def test_filling_and_venting_take_as_long_as_their_closed_forms(exponent: float) -> None:
    chamber, volume = Chamber(exponent, 293.15), 2e-4

    def rate(_: float, state: list[float], source: float) -> list[float]:
        return [valve.pressure_rate(chamber, state[0], volume, valve.flow(VALVE, source, state[0], 293.15), 0.0)]

    fill = valve.filling_time(VALVE, chamber, volume, 8e5, 1e5, 3e5)
    filled = solve_ivp(rate, (0.0, fill), [1e5], args=(8e5,), rtol=1e-10, atol=1e-3).y[0, -1]
    assert filled == pytest.approx(3e5, rel=1e-6)
    vent = valve.venting_time(VALVE, chamber, volume, 6e5, ATMOSPHERE / 0.4)
    vented = solve_ivp(rate, (0.0, vent), [6e5], args=(ATMOSPHERE,), rtol=1e-10, atol=1e-3).y[0, -1]
    assert vented == pytest.approx(ATMOSPHERE / 0.4, rel=1e-6)
    # A 250 mm pair of some 200 cm3 fills to 5 bar in about 0.2 s through 1 dm3/(s bar), if it keeps its temperature.
    if exponent == 1.0:
        assert valve.filling_time(VALVE, chamber, volume, 1.5e6, ATMOSPHERE, 6e5) < 0.2 < 0.5


@pytest.mark.parametrize("exponent", [1.0, 1.3, 1.4])
def test_closed_air_is_squeezed_as_its_walls_let_it(exponent: float) -> None:
    chamber = Chamber(exponent, 293.15)
    expansion = 3e-5

    def rate(time: float, state: list[float]) -> list[float]:
        return [valve.pressure_rate(chamber, state[0], 2e-4 + expansion * time, 0.0, expansion)]

    found = solve_ivp(rate, (0.0, 2.0), [4e5], rtol=1e-11, atol=1e-4).y[0, -1]
    assert found == pytest.approx(valve.compressed(chamber, 4e5, 2e-4, 2.6e-4), rel=1e-8)
    if exponent == 1.0:
        assert found * 2.6e-4 == pytest.approx(4e5 * 2e-4)


def test_mass_is_what_the_gas_law_says_at_constant_temperature() -> None:
    rate = valve.pressure_rate(ROOM, 3e5, 2e-4, 1e-4, 0.0)
    assert rate * 2e-4 / (AIR_CONSTANT * 293.15) == pytest.approx(1e-4)
