"""Air supply: a regulator with two lags, or a valve that fills the muscle through a hose from a tank."""

import math

import numpy as np
from benchmarks.hidden_effects.adversary.compiled import compile_cached
from benchmarks.hidden_effects.adversary.rig import ATMOSPHERE, NORMAL_DENSITY, Rig

GAS_CONSTANT = 287.05
HEAT_RATIO = 1.4
VISCOSITY = 1.82e-5
"""Dynamic viscosity of air [Pa s]."""
CRITICAL_RATIO = (2.0 / (HEAT_RATIO + 1.0)) ** (HEAT_RATIO / (HEAT_RATIO - 1.0))
N_HOSE_CELLS = 3
N_SUBSTEPS = 10
DROOP_TIME = 5e-3
"""Time constant with which a regulator answers flow [s] (assumed)."""
TANK_EXPONENT = 1.1
"""Polytropic exponent of a tank that is emptied within seconds (assumed)."""

# State of the air: 0 slewed target, 1 pilot, 2 regulator, 3 droop, 4 muscle (all gauge [Pa]), 5 air mass [kg],
# 6 air temperature [K], 7 tank (gauge), 8... cells of the hose (gauge).
N_AIR_STATES = 8 + N_HOSE_CELLS


@compile_cached
def nozzle_flow(conductance: float, upstream: float, downstream: float) -> float:
    """Return the mass flow [kg/s] between absolute pressures [Pa]: Saint-Venant and Wantzel's isentropic nozzle.

    Scaled so that the sonic flow is ``conductance`` [m³/(s Pa)] times density at reference times upstream pressure.
    """
    if downstream > upstream:
        return -nozzle_flow(conductance, downstream, upstream)
    ratio = max(downstream / upstream, CRITICAL_RATIO)
    share = ratio ** (2.0 / HEAT_RATIO) - ratio ** ((HEAT_RATIO + 1.0) / HEAT_RATIO)
    sonic = CRITICAL_RATIO ** (2.0 / HEAT_RATIO) - CRITICAL_RATIO ** ((HEAT_RATIO + 1.0) / HEAT_RATIO)
    return conductance * NORMAL_DENSITY * upstream * math.sqrt(max(share, 0.0) / sonic)


@compile_cached
def pipe_flow(length: float, upstream: float, downstream: float, rig: Rig) -> float:
    """Return the mass flow [kg/s] through ``length`` of hose: isothermal, turbulent after Blasius (f = 0.316 Re^-¼)."""
    area = 0.25 * math.pi * rig.hose_diameter * rig.hose_diameter
    drive = upstream * upstream - downstream * downstream
    factor = area * area * rig.hose_diameter / (0.316 * length * GAS_CONSTANT * rig.gas_temperature)
    factor *= (rig.hose_diameter / (area * VISCOSITY)) ** 0.25
    soft = 2.0 * ATMOSPHERE * 200.0  # linear below some 200 Pa, where the flow is laminar
    return factor ** (4.0 / 7.0) * drive * (drive * drive + soft * soft) ** (-3.0 / 14.0)


@compile_cached
def rest_air(pressure: float, volume: float, rig: Rig) -> np.ndarray:
    """Return the state of the air at rest at the gauge ``pressure`` in ``volume``."""
    state = np.full(N_AIR_STATES, pressure)
    state[3] = 0.0
    state[5] = (pressure + ATMOSPHERE) * volume / (GAS_CONSTANT * rig.gas_temperature)
    state[6] = rig.gas_temperature
    state[7] = rig.supply_pressure
    return state


@compile_cached
def step_air(state: np.ndarray, command: float, volume: float, rate: float, dt: float, rig: Rig) -> None:
    """Advance the air by ``dt`` in place, for a ``volume`` that grows at ``rate`` [m³/s]."""
    if rig.has_valve:
        _step_valve(state, command, volume, rate, dt, rig)
    else:
        _step_regulator(state, command, rate, dt, rig)


@compile_cached
def _step_regulator(state: np.ndarray, command: float, rate: float, dt: float, rig: Rig) -> None:
    target = min(max(rig.regulator_gain * command, 0.0), rig.supply_pressure)
    reach = rig.pressure_rate * dt
    state[0] += min(max(target - state[0], -reach), reach)
    state[1] = _follow(state[1], state[0], dt, rig.pilot_time)
    state[2] = _follow(state[2], state[1], dt, rig.regulator_time)
    flow = rate * (state[2] + ATMOSPHERE) / ATMOSPHERE
    state[3] = _follow(state[3], rig.flow_droop * flow, dt, DROOP_TIME)
    state[4] = max(state[2] - state[3], 0.0)


@compile_cached
def _follow(value: float, target: float, dt: float, time: float) -> float:
    return target if time <= 0.0 else target + (value - target) * math.exp(-dt / time)


@compile_cached
def _step_valve(state: np.ndarray, command: float, volume: float, rate: float, dt: float, rig: Rig) -> None:
    """Advance valve, hose and muscle: open system with an energy balance, heat exchange with the wall."""
    h, cells = dt / N_SUBSTEPS, 8
    c_v = GAS_CONSTANT / (HEAT_RATIO - 1.0)
    c_p = c_v + GAS_CONSTANT
    area = 0.25 * math.pi * rig.hose_diameter * rig.hose_diameter
    piece = rig.hose_length / N_HOSE_CELLS
    for k in range(N_SUBSTEPS):
        outlet = state[cells] if rig.hose_length > 0.0 else state[4]
        opening = min(max(rig.valve_gain * (command - outlet), -1.0), 1.0)
        if opening >= 0.0:
            flow = nozzle_flow(opening * rig.fill_conductance, state[7] + ATMOSPHERE, outlet + ATMOSPHERE)
        else:
            flow = -nozzle_flow(-opening * rig.exhaust_conductance, outlet + ATMOSPHERE, ATMOSPHERE)
        if rig.tank_volume > 0.0 and flow > 0.0:
            state[7] -= TANK_EXPONENT * GAS_CONSTANT * rig.gas_temperature * flow * h / rig.tank_volume
        if rig.hose_length > 0.0:
            gain = GAS_CONSTANT * rig.gas_temperature * h / (area * piece)
            for i in range(N_HOSE_CELLS):
                after = state[cells + i + 1] if i + 1 < N_HOSE_CELLS else state[4]
                onward = pipe_flow(piece, state[cells + i] + ATMOSPHERE, after + ATMOSPHERE, rig)
                state[cells + i] += gain * (flow - onward)
                flow = onward
        leak = nozzle_flow(rig.leak_conductance, state[4] + ATMOSPHERE, ATMOSPHERE)
        arriving = rig.gas_temperature if flow > 0.0 else state[6]
        now = volume + rate * (h * k - dt)
        energy = state[5] * c_v * state[6]
        energy += h * (c_p * (flow * arriving - leak * state[6]) - (state[4] + ATMOSPHERE) * rate)
        energy += h * state[5] * c_v * (rig.gas_temperature - state[6]) / rig.heat_time
        state[5] = max(state[5] + h * (flow - leak), 1e-9)
        state[6] = energy / (state[5] * c_v)
        state[4] = state[5] * GAS_CONSTANT * state[6] / (now + rate * h) - ATMOSPHERE
