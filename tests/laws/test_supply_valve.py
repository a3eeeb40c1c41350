"""The pressure after the flow of one step: root of the implicit equation, wherever valve, leak and source lead."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from klute_sim.device.device import load_device
from klute_sim.laws.pneumatics import AIR_GAS_CONSTANT, ATMOSPHERIC_PRESSURE, SupplyParameters
from klute_sim.laws.supply_valve import FlowProblem, leak_flow, opening_at, solve_pressure, valve_flow
from klute_sim.units import BAR

SUPPLY = load_device("klute-1-1-4-pair-valve").parameters.supply
PRESSURES = st.floats(0.0, 8.0 * BAR)


def compute_change(supply: SupplyParameters, problem: FlowProblem, pressure: float) -> float:
    """Return by how much the flow at ``pressure`` [Pa] changes the pressure in the step [Pa]."""
    opening = opening_at(supply, problem, pressure)
    through = valve_flow(
        supply, problem.source_pressure, problem.sink_pressure, pressure, opening, problem.gas_temperature
    )
    net = through - leak_flow(supply, pressure, problem.gas_temperature)
    return problem.dt * problem.pressure_per_inflow * net


@given(
    start=PRESSURES,
    source=PRESSURES,
    target=PRESSURES,
    opening=st.floats(-1.0, 1.0),
    is_fixed=st.booleans(),
    volume=st.floats(1e-6, 1e-3),
    dt=st.floats(1e-5, 1e-2),
    leak=st.sampled_from([0.0, 1e-9, 1e-8]),
)
def test_pressure_after_a_flow_is_the_root_of_the_implicit_step(
    start: float, source: float, target: float, opening: float, is_fixed: bool, volume: float, dt: float, leak: float
) -> None:
    supply = SUPPLY._replace(leak_conductance=leak, valve_gain=1.0 / BAR)
    per_mass = AIR_GAS_CONSTANT * supply.temperature / volume
    problem = FlowProblem(
        start, source, 0.0, target, opening, is_fixed, supply.temperature, per_mass, per_mass, dt, math.inf
    )
    after = solve_pressure(supply, problem)
    expected = brentq(
        lambda pressure: pressure - start - compute_change(supply, problem, pressure),
        min(0.0, start) - 1.0,
        max(start, source) + 1.0,
        xtol=1e-9,
        rtol=1e-14,
    )
    assert after == pytest.approx(expected, abs=1e-9 * (expected + ATMOSPHERIC_PRESSURE))
    change = compute_change(supply, problem, start)
    low, high = sorted((0.0, change))
    assert low - 1e-6 <= after - start <= high + 1e-6, "no farther than the explicit step"
