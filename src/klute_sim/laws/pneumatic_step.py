"""How a muscle is filled and emptied: valves with a limited flow, the muscle's own volume, leaks, a tank.

One step has two halves. First air flows while the muscle keeps its volume (:func:`charge`): one scalar equation for the
pressure at the end, bracketed and monotone, so that stiff valves and small volumes are no matter. Then the muscle moves
and takes its air along (:func:`felt`): closed, ``p V^n`` stays. Closed air therefore obeys its
closed form, and at constant temperature pressure, volume and mass obey the gas law to the last bits. Air comes with the
supply's temperature and leaves with the muscle's own, p V/(m R).

Pressures are gauge [Pa] unless said otherwise.
"""

import math
from typing import NamedTuple

from klute_sim.laws import valve
from klute_sim.laws.pneumatics import AIR_GAS_CONSTANT, ATMOSPHERIC_PRESSURE, Supply, air_mass, regulate
from klute_sim.laws.valve import Restriction

LEAK_CRITICAL_RATIO = 0.5
"""Critical pressure ratio of a leak (assumed: a hole with rounded edges)."""
PRESSURE_TOLERANCE = 1e-12
"""Of the pressure after a flow, relative to the absolute pressure."""
MAX_ITERATIONS = 100


class GasState(NamedTuple):
    """What the supply remembers; all zero for a vented muscle at its resting length and a full tank."""

    surplus_mass: float = 0.0
    """Air in muscle and dead volume [kg], beyond what is in there vented at resting length."""
    drawn_mass: float = 0.0
    """Air taken from tank or compressor since the start [kg]."""
    pwm_phase: float = 0.0
    """Of an on/off valve's period [1]."""
    pressure_disturbance: float = 0.0
    """What a change of the volume did to the pressure, and the regulator has not made up for [Pa]."""
    leaked_mass: float = 0.0
    """Air lost through a leak since the start [kg]."""
    pwm_duty: float = 0.0
    """That an on/off valve was told when its period began, -1 ... 1."""


N_GAS_STATES = len(GasState._fields)


class AirCharge(NamedTuple):
    """The muscle's air after the flow of a step, before the muscle moves."""

    pressure: float
    """[Pa]"""
    pressure_disturbance: float
    """Still to be made up for, at the start of the step [Pa]."""
    disturbance_fraction: float
    """Share of a disturbance that is left at the end of the step [1]."""
    polytropic_exponent: float
    """[1]"""
    volume: float
    """With the dead volume, before the muscle moves [m3]."""
    dead_volume: float
    """[m3]"""
    valve_mass: float
    """Air that came through the valve [kg]; negative: went."""
    leaked_mass: float
    """[kg]"""
    pwm_phase: float
    """Of an on/off valve's period after the step [1]."""
    pwm_duty: float
    """That it was told when that period began."""
    draws_from_supply: bool
    """Whether the valve stands towards the supply."""


def is_ideal(supply: Supply) -> bool:
    """Whether it is an ideal regulator, with nothing to remember."""
    return (
        supply.fill_conductance == 0.0
        and supply.leak_conductance == 0.0
        and supply.tank_volume == 0.0
        and supply.regulator_time_constant == 0.0
    )


def supply_pressure(supply: Supply, drawn_mass: float) -> float:
    """Pressure [Pa] that the supply has when ``drawn`` [kg] of air were taken: its own, or what the tank still has."""
    if supply.tank_volume == 0.0:
        return supply.max_pressure
    left = supply.tank_pressure - drawn_mass * AIR_GAS_CONSTANT * supply.temperature / supply.tank_volume
    return min(supply.max_pressure, max(left, 0.0))


def equilibrium_gas(supply: Supply, pressure: float, volume: float, resting_volume: float) -> GasState:
    """What is remembered after a long time at ``pressure`` in ``volume`` [m3], the tank full again.

    ``rest_volume`` [m3] is that of the muscle at its resting length; both without dead volume.
    """
    vented = air_mass(0.0, resting_volume + supply.dead_volume, supply.temperature)
    return GasState(
        air_mass(pressure, volume + supply.dead_volume, supply.temperature) - vented, 0.0, 0.0, 0.0, 0.0, 0.0
    )


class PwmPulse(NamedTuple):
    """What an on/off valve does in a step."""

    open_fraction: float
    """Of the step in which it is open [1]; negative: towards the room."""
    duty: float
    """That it was told when its period began [1], with the same sign."""
    phase: float
    """Of its period, at the end of the step [1]."""


def step_pwm(supply: Supply, opening: float, duty: float, phase: float, dt: float) -> PwmPulse:
    """An on/off valve under ``opening`` (-1 ... 1) for a ``step`` [s] that begins at ``phase`` of its period.

    A pulse as wide as the opening begins with each period; until then the ``duty`` of the last one holds. One that is
    too short is left out, a pause that is too short is filled.
    """
    asked = abs(opening)
    if asked * supply.pwm_period < supply.min_pulse:
        asked = 0.0
    elif (1.0 - asked) * supply.pwm_period < supply.min_pulse:
        asked = 1.0
    fresh = math.copysign(asked, opening)
    if phase == 0.0:
        duty = fresh
    periods = dt / supply.pwm_period
    end = phase + periods
    wide = abs(duty)
    on = math.copysign(max(min(end, wide, 1.0) - min(phase, wide), 0.0), duty)
    if end >= 1.0:
        whole = math.floor(end - 1.0)
        on += fresh * whole + math.copysign(min(end - 1.0 - whole, asked), fresh)
        duty = fresh
        end -= 1.0 + whole
    return PwmPulse(on / periods, duty, end)


def valve_opening(supply: Supply, pressure: float, target: float) -> float:
    """Opening of a proportional valve, -1 (exhaust) to 1 (fill), at ``pressure`` with ``target`` asked for [Pa].

    ``gain (target - pressure)``; without a gain fully towards the target.
    """
    if supply.valve_gain == 0.0:
        return 1.0 if target >= pressure else -1.0
    return min(max(supply.valve_gain * (target - pressure), -1.0), 1.0)


def valve_flow(
    supply: Supply, source_pressure: float, pressure: float, opening: float, gas_temperature: float
) -> float:
    """Mass flow [kg/s] through a valve that is ``opened`` -1 ... 1, into the muscle; from ``source`` or to the room.

    The air in the muscle has the temperature ``warmth`` [K]. A check valve keeps it from going back into the source
    (assumed).
    """
    inside = pressure + ATMOSPHERIC_PRESSURE
    if opening >= 0.0:
        way = Restriction(supply.fill_conductance * opening, supply.fill_critical_ratio)
        return max(valve.mass_flow(way, source_pressure + ATMOSPHERIC_PRESSURE, inside, supply.temperature), 0.0)
    way = Restriction(-supply.exhaust_conductance * opening, supply.exhaust_critical_ratio)
    return -valve.mass_flow(way, inside, ATMOSPHERIC_PRESSURE, gas_temperature)


def leak_flow(supply: Supply, pressure: float, gas_temperature: float) -> float:
    """Mass flow [kg/s] out of the leak of a muscle whose air has the temperature ``warmth`` [K]."""
    if supply.leak_conductance == 0.0:
        return 0.0
    return valve.mass_flow(
        Restriction(supply.leak_conductance, LEAK_CRITICAL_RATIO),
        pressure + ATMOSPHERIC_PRESSURE,
        ATMOSPHERIC_PRESSURE,
        gas_temperature,
    )


class _FlowProblem(NamedTuple):
    """A step's flow, for the search of the pressure that it ends at."""

    initial_pressure: float
    """Pressure before [Pa]."""
    source_pressure: float
    """Of the supply [Pa]."""
    target_pressure: float
    """That is asked for [Pa]."""
    opening: float
    """Of the valve, if it ``stays``."""
    opening_is_fixed: bool
    """Whether the valve stays as it is, or opens with what is missing."""
    gas_temperature: float
    """Of the air in the muscle [K]."""
    pressure_per_inflow: float
    """Pressure per mass that comes in [Pa/kg]."""
    pressure_per_outflow: float
    """Pressure per mass that goes out [Pa/kg]."""
    dt: float
    """[s]"""


def _opening_at(supply: Supply, problem: _FlowProblem, pressure: float) -> float:
    """Opening of the valve at the pressure ``after`` [Pa]."""
    return problem.opening if problem.opening_is_fixed else valve_opening(supply, pressure, problem.target_pressure)


def _pressure_residual(supply: Supply, problem: _FlowProblem, pressure: float) -> float:
    """By how much ``after`` [Pa] is above what the flow there leads to; rises with ``after``."""
    through = valve_flow(
        supply, problem.source_pressure, pressure, _opening_at(supply, problem, pressure), problem.gas_temperature
    )
    out = leak_flow(supply, pressure, problem.gas_temperature)
    came, went = max(through, 0.0) + max(-out, 0.0), max(-through, 0.0) + max(out, 0.0)
    return (
        pressure
        - problem.initial_pressure
        - problem.dt * (problem.pressure_per_inflow * came - problem.pressure_per_outflow * went)
    )


def _solve_pressure(supply: Supply, problem: _FlowProblem) -> float:
    """Pressure [Pa] at the end of a flow: Ridders' method, bracketed by room and source."""
    low, high = min(0.0, problem.initial_pressure), max(problem.initial_pressure, problem.source_pressure)
    f_low, f_high = _pressure_residual(supply, problem, low), _pressure_residual(supply, problem, high)
    if not f_low < 0.0:
        return low if f_low == f_low else f_low
    if not f_high > 0.0:
        return high if f_high == f_high else f_high
    for _ in range(MAX_ITERATIONS):
        middle = 0.5 * (low + high)
        if high - low <= PRESSURE_TOLERANCE * (middle + ATMOSPHERIC_PRESSURE):
            break
        f_middle = _pressure_residual(supply, problem, middle)
        if f_middle == 0.0:
            return middle
        x = middle - (middle - low) * f_middle / math.sqrt(f_middle * f_middle - f_low * f_high)
        f_x = _pressure_residual(supply, problem, x)
        if f_x == 0.0:
            return x
        if f_middle > 0.0:
            high, f_high = middle, f_middle
        else:
            low, f_low = middle, f_middle
        if low < x < high:
            if f_x > 0.0:
                high, f_high = x, f_x
            else:
                low, f_low = x, f_x
    return low if -f_low < f_high else high


def charge(
    supply: Supply, gas: GasState, pressure: float, target: float, volume: float, resting_volume: float, dt: float
) -> AirCharge:
    """The flow of one ``step`` [s] into a muscle of ``volume`` [m3] (at rest ``rest_volume``), from ``pressure`` [Pa].

    ``target`` is the pressure that is asked for [Pa], or the opening if the supply takes openings.
    """
    if supply.fill_conductance == 0.0:
        return _charge_by_regulator(supply, gas, pressure, target, volume + supply.dead_volume, dt)
    return _charge_by_valve(supply, gas, pressure, target, volume, resting_volume, dt)


def _charge_by_regulator(
    supply: Supply, gas: GasState, pressure: float, target: float, total_volume: float, dt: float
) -> AirCharge:
    """:func:`charge` of a regulator that gives any flow; ``whole`` volume [m3]."""
    per_mass, source = AIR_GAS_CONSTANT * supply.temperature / total_volume, supply_pressure(supply, gas.drawn_mass)
    # A tank that has sunk below the muscle cannot fill it: the air is closed in, and can only be let out.
    shut = supply.tank_volume > 0.0 and pressure >= source
    before = pressure if shut else pressure - gas.pressure_disturbance
    leaked = min(leak_flow(supply, before, supply.temperature) * dt, max(before, 0.0) / per_mass)
    after = regulate(supply, before - per_mass * leaked, target, dt)
    volume, exponent = supply.dead_volume, supply.polytropic_exponent
    # What the regulator lets in is known when the muscle has moved.
    came = 0.0
    if shut:
        after = min(after, before - per_mass * leaked)
        return AirCharge(after, 0.0, 1.0, 1.0, total_volume, volume, came, leaked, gas.pwm_phase, gas.pwm_duty, True)
    kept = supply.regulator_time_constant / (supply.regulator_time_constant + dt)
    after = min(after, source)
    return AirCharge(
        after,
        gas.pressure_disturbance,
        kept,
        exponent,
        total_volume,
        volume,
        came,
        leaked,
        gas.pwm_phase,
        gas.pwm_duty,
        True,
    )


def _charge_by_valve(
    supply: Supply, gas: GasState, pressure: float, target: float, volume: float, resting_volume: float, dt: float
) -> AirCharge:
    """:func:`charge` through a valve: ``dp = n/V (R T_in dm_in - R T dm_out)`` with ``p V = m R T`` inside."""
    whole, source = volume + supply.dead_volume, supply_pressure(supply, gas.drawn_mass)
    mass = enclosed_air_mass(supply, gas, pressure, volume, resting_volume)
    if supply.thermal_time_constant > 0.0 and supply.polytropic_exponent != 1.0:
        cool = mass * AIR_GAS_CONSTANT * supply.temperature / whole - ATMOSPHERIC_PRESSURE
        pressure += (cool - pressure) * dt / (supply.thermal_time_constant + dt)
    fixed, stays, phase, duty = 0.0, True, gas.pwm_phase, gas.pwm_duty
    if supply.command_is_opening != 0.0:
        fixed = min(max(target, -1.0), 1.0)
    elif supply.valve_gain == 0.0 or supply.pwm_period > 0.0:
        fixed = valve_opening(supply, pressure, target)
    else:
        stays = False
    if supply.pwm_period > 0.0:
        pulse = step_pwm(supply, fixed, duty, phase, dt)
        fixed, duty, phase = pulse.open_fraction, pulse.duty, pulse.phase
    inside = pressure + ATMOSPHERIC_PRESSURE
    flowing = _FlowProblem(
        initial_pressure=pressure,
        source_pressure=source,
        target_pressure=target,
        opening=fixed,
        opening_is_fixed=stays,
        gas_temperature=inside * whole / (mass * AIR_GAS_CONSTANT),
        pressure_per_inflow=supply.polytropic_exponent * AIR_GAS_CONSTANT * supply.temperature / whole,
        pressure_per_outflow=supply.polytropic_exponent * inside / mass,
        dt=dt,
    )
    shut = stays and fixed == 0.0
    after = pressure
    if not shut or supply.leak_conductance > 0.0:
        after = _solve_pressure(supply, flowing)
    if supply.valve_gain == 0.0 and supply.command_is_opening == 0.0 and supply.pwm_period == 0.0:
        # A perfect pilot closes where it has arrived.
        after = min(after, max(target, pressure)) if fixed >= 0.0 else max(after, target)
        most = supply.max_pressure_rate * dt
        after = min(max(after, pressure - most), pressure + most)
    lost = leak_flow(supply, after, flowing.gas_temperature) * dt
    # The valve's part by difference, so that pressure and mass agree to the last bits.
    rest = (
        after - pressure + flowing.pressure_per_outflow * max(lost, 0.0) - flowing.pressure_per_inflow * max(-lost, 0.0)
    )
    through = rest / flowing.pressure_per_inflow if rest > 0.0 else rest / flowing.pressure_per_outflow
    if shut:
        lost, through = lost - through, 0.0
    # Above the room's pressure, what comes in comes from the tank, wherever a pilot stands that makes up for a leak.
    draws = _opening_at(supply, flowing, after) >= 0.0 or after > 0.0
    return AirCharge(
        after, 0.0, 1.0, supply.polytropic_exponent, whole, supply.dead_volume, through, lost, phase, duty, draws
    )


def constant_pressure(pressure: float) -> AirCharge:
    """Air that stays at ``pressure`` [Pa] whatever the muscle does."""
    return AirCharge(pressure, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, True)


def charge_ideal(supply: Supply, pressure: float, target: float, dt: float) -> AirCharge:
    """The same of a supply that is :func:`plain`, which remembers nothing."""
    return constant_pressure(regulate(supply, pressure, target, dt))


def enclosed_air_mass(supply: Supply, gas: GasState, pressure: float, volume: float, resting_volume: float) -> float:
    """Air in muscle and dead volume [kg]; volumes [m3] as in :func:`rested`."""
    if is_ideal(supply):
        return air_mass(pressure, volume + supply.dead_volume, supply.temperature)
    return gas.surplus_mass + air_mass(0.0, resting_volume + supply.dead_volume, supply.temperature)


def pressure_after_motion(air: AirCharge, volume: float) -> float:
    """Pressure [Pa] in the muscle when it has moved to ``volume`` [m3], without the dead volume."""
    if air.disturbance_fraction == 0.0:
        return air.pressure
    before = air.pressure + air.pressure_disturbance + ATMOSPHERIC_PRESSURE
    ratio = air.volume / (volume + air.dead_volume)
    squeezed = before * (math.pow(ratio, air.polytropic_exponent) - 1.0)
    return air.pressure + air.disturbance_fraction * (air.pressure_disturbance + squeezed)


def update_gas(
    supply: Supply, gas: GasState, air: AirCharge, pressure: float, volume: float, resting_volume: float
) -> GasState:
    """What is remembered when the muscle has moved to ``volume`` [m3], where its air has ``pressure`` [Pa].

    ``rest_volume`` [m3] is that of the muscle at its resting length; both without dead volume.
    """
    if supply.fill_conductance == 0.0:
        # A regulator gives whatever the gas law then asks for; being squeezed takes no air.
        squeezed = pressure - air.pressure
        surplus = equilibrium_gas(
            supply, air.pressure + squeezed / air.polytropic_exponent, volume, resting_volume
        ).surplus_mass
        through = surplus - gas.surplus_mass + air.leaked_mass
        drawn, lost = gas.drawn_mass + max(through, 0.0), gas.leaked_mass + air.leaked_mass
        # Air that is closed in has no regulator that would make up for anything.
        left = squeezed if air.disturbance_fraction < 1.0 else 0.0
        return GasState(surplus, drawn, air.pwm_phase, left, lost, air.pwm_duty)
    drawn, lost = (
        gas.drawn_mass + (max(air.valve_mass, 0.0) if air.draws_from_supply else 0.0),
        gas.leaked_mass + air.leaked_mass,
    )
    return GasState(gas.surplus_mass + air.valve_mass - air.leaked_mass, drawn, air.pwm_phase, 0.0, lost, air.pwm_duty)
