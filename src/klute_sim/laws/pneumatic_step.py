"""One time step of the muscle's air: regulator or valve, the muscle's volume, leaks and a tank.

A step has two halves. First air flows while the muscle keeps its volume (:func:`charge`);
:mod:`klute_sim.laws.supply_valve` solves for the pressure at the end. Then the muscle moves with its air enclosed
(:func:`pressure_after_motion`): ``p V^n`` is constant. Enclosed air therefore follows its closed form, and at constant
temperature pressure, volume and mass satisfy the gas law to the last bits. Air enters with the supply's temperature and
leaves with that of the muscle, p V/(m R).

A regulator upstream of a fixed restriction holds its pressure there, not in the muscle, and the limit of its rate acts
there (its outlet has no volume, assumed). Air flows from it while the muscle has less, and back while the muscle has
more: the regulator relieves that air into the room, and a tank does not get it back. A tank with less pressure than the
muscle accepts none (a check valve, assumed).

Whether a regulator's tank has less pressure than the muscle is decided at the start of a step. Under a command at or
above the tank's pressure, steps with enclosed air and steps that fill it therefore alternate while the muscle moves: an
error of first order in the time step, however large the tank is.

Three limits keep the absolute pressure and every mass positive for any step; none of them acts unless a step would
move more air than there is. A leak of a muscle on a regulator ends when muscle and room have equal pressures, and the
regulator does not evacuate the muscle. No more of the muscle's air leaves than the muscle holds: what leaves beyond it
is supplied air that passes through. No more air comes from a tank than the tank holds above room pressure.

Pressures are gauge [Pa] unless stated otherwise.
"""

import math
from typing import NamedTuple

from klute_sim.laws.pneumatics import (
    AIR_GAS_CONSTANT,
    ATMOSPHERIC_PRESSURE,
    SupplyParameters,
    air_mass,
    has_regulator_upstream,
    regulate,
)
from klute_sim.laws.supply_valve import (
    FlowProblem,
    fix_opening,
    leak_flow,
    limit_inflow,
    limit_outflow,
    opening_at,
    solve_pressure,
    split_flow,
    step_pwm,
    valve_opening,
)

LOWEST_REGULATED_PRESSURE = -0.5 * ATMOSPHERIC_PRESSURE
"""Gauge pressure below which a regulator lowers no pressure further [Pa] (assumed; a vent cannot evacuate)."""


EMPTY_TANK_PRESSURE = 1e-6
"""Gauge pressure below which a tank is empty, whatever rounding has left in it [Pa] (assumed)."""


class GasState(NamedTuple):
    """Internal state of the supply; all zero for a vented muscle at its resting length and a full tank."""

    surplus_mass: float = 0.0
    """Air in muscle and dead volume beyond that of a vented muscle at its resting length [kg]."""
    drawn_mass: float = 0.0
    """Air drawn from tank or compressor since the start [kg]."""
    pwm_phase: float = 0.0
    """Phase within the period of an on/off valve [1]."""
    pressure_disturbance: float = 0.0
    """Pressure change by volume changes that the regulator has not compensated yet [Pa]; behind a restriction, all by
    which the muscle's pressure exceeds that of the regulator upstream."""
    leaked_mass: float = 0.0
    """Air lost through a leak since the start [kg]."""
    pwm_duty: float = 0.0
    """Commanded duty of an on/off valve at the start of its period, -1 (exhaust) to 1 (fill)."""


N_GAS_STATES = len(GasState._fields)
"""Number of states of the supply."""


def add_disturbance(gas: GasState, change: float) -> GasState:
    """Return ``gas`` after a ``change`` [Pa] of the muscle's pressure that leaves the regulator's as it is."""
    disturbance = gas.pressure_disturbance + change
    return GasState(gas.surplus_mass, gas.drawn_mass, gas.pwm_phase, disturbance, gas.leaked_mass, gas.pwm_duty)


class AirCharge(NamedTuple):
    """The muscle's air after the flow of a step, before the muscle moves."""

    pressure: float
    """Gauge pressure without the disturbance [Pa]: that of the regulator, or that behind a valve."""
    pressure_disturbance: float
    """Disturbance that the regulator has not compensated at the start of the step [Pa]."""
    disturbance_fraction: float
    """Fraction of a disturbance that remains at the end of the step [1]."""
    polytropic_exponent: float
    """Polytropic exponent of the air [1]."""
    volume: float
    """Volume of muscle and dead volume before the muscle moves [m3]."""
    dead_volume: float
    """Dead volume [m3]."""
    valve_mass: float
    """Air that entered through the valve [kg]; negative for air that left."""
    leaked_mass: float
    """Air lost through the leak during the step [kg]."""
    pwm_phase: float
    """Phase within the period of an on/off valve after the step [1]."""
    pwm_duty: float
    """Commanded duty at the start of that period, -1 to 1."""
    draws_from_supply: bool
    """Whether the valve connects the muscle to the supply."""
    max_pressure_volume: float
    """Largest absolute pressure times volume [J] that muscle and tank together have air for, at their temperature."""


def is_ideal(supply: SupplyParameters) -> bool:
    """Return whether the supply is an ideal regulator without internal state."""
    return (
        supply.fill_conductance == 0.0
        and supply.leak_conductance == 0.0
        and supply.tank_volume == 0.0
        and supply.regulator_time_constant == 0.0
    )


def supply_pressure(supply: SupplyParameters, drawn_mass: float) -> float:
    """Return the pressure [Pa] upstream of the valve after ``drawn_mass`` [kg] of air has been drawn from a tank."""
    if supply.tank_volume == 0.0:
        return supply.max_pressure
    remaining = supply.tank_pressure - drawn_mass * AIR_GAS_CONSTANT * supply.temperature / supply.tank_volume
    return min(supply.max_pressure, max(remaining, 0.0))


def tank_air_mass(supply: SupplyParameters, drawn_mass: float) -> float:
    """Return the air [kg] that a tank still holds above room pressure after ``drawn_mass`` [kg] has been drawn."""
    full = supply.tank_pressure * supply.tank_volume / (AIR_GAS_CONSTANT * supply.temperature)
    return max(full - drawn_mass, 0.0)


def equilibrium_gas(supply: SupplyParameters, pressure: float, volume: float, resting_volume: float) -> GasState:
    """Return the state after a long time at ``pressure`` [Pa] in ``volume`` [m3], with a full tank.

    ``resting_volume`` [m3] is that of the muscle at its resting length; both are without dead volume.
    """
    vented = air_mass(0.0, resting_volume + supply.dead_volume, supply.temperature)
    return GasState(
        air_mass(pressure, volume + supply.dead_volume, supply.temperature) - vented, 0.0, 0.0, 0.0, 0.0, 0.0
    )


def charge(
    supply: SupplyParameters,
    gas: GasState,
    pressure: float,
    target: float,
    volume: float,
    resting_volume: float,
    dt: float,
) -> AirCharge:
    """Return the air after the flow of one step ``dt`` [s] into a muscle of ``volume`` [m3] at ``pressure`` [Pa].

    ``target`` is the commanded pressure [Pa], or the opening if the supply takes openings. ``resting_volume`` [m3] is
    that of the muscle at its resting length.
    """
    if supply.fill_conductance == 0.0:
        return _charge_by_regulator(supply, gas, pressure, target, volume + supply.dead_volume, resting_volume, dt)
    return _charge_by_valve(supply, gas, pressure, target, volume, resting_volume, dt)


def _charge_by_regulator(
    supply: SupplyParameters,
    gas: GasState,
    pressure: float,
    target: float,
    total_volume: float,
    resting_volume: float,
    dt: float,
) -> AirCharge:
    """Return the air after the flow from a regulator of unlimited flow; ``total_volume`` [m3] includes dead volume."""
    thermal = AIR_GAS_CONSTANT * supply.temperature
    per_mass, source = thermal / total_volume, supply_pressure(supply, gas.drawn_mass)
    # A tank at a lower pressure than the muscle cannot fill it: the air is enclosed and can only be exhausted.
    is_enclosed = supply.tank_volume > 0.0 and (pressure >= source or source < EMPTY_TANK_PRESSURE)
    before = pressure if is_enclosed else pressure - gas.pressure_disturbance
    leaked, mass_to_room = leak_flow(supply, pressure, supply.temperature) * dt, pressure / per_mass
    leaked = min(leaked, mass_to_room) if pressure > 0.0 else max(leaked, mass_to_room)
    # Air at a pressure that the regulator does not hold leaks first; the regulator makes up for the rest.
    excess = 0.0 if is_enclosed else gas.pressure_disturbance
    relief = min(max(leaked, 0.0) * per_mass * supply.polytropic_exponent, max(excess, 0.0))
    refilled = leaked - relief / (per_mass * supply.polytropic_exponent)
    after = regulate(supply, before - per_mass * refilled, target, dt)
    dead_volume, exponent, phase, duty = supply.dead_volume, supply.polytropic_exponent, gas.pwm_phase, gas.pwm_duty
    # The inflow is known only after the muscle has moved (update_gas).
    inflow = 0.0
    if is_enclosed:
        enclosed = min(after, before - per_mass * leaked)
        if enclosed < source:
            # The tank makes up for a leak that would lower the muscle below the tank's pressure.
            mass = enclosed_air_mass(supply, gas, pressure, total_volume - dead_volume, resting_volume)
            available = max(mass - leaked, 0.0) + tank_air_mass(supply, gas.drawn_mass)
            refilled_pressure = min(after, source, per_mass * available - ATMOSPHERIC_PRESSURE)
            enclosed = max(enclosed, refilled_pressure)
        after = enclosed
        return AirCharge(after, 0.0, 1.0, 1.0, total_volume, dead_volume, inflow, leaked, phase, duty, True, math.inf)
    fraction = supply.regulator_time_constant / (supply.regulator_time_constant + dt)
    after = min(after, source)
    disturbance, lowest = gas.pressure_disturbance - relief, min(pressure, LOWEST_REGULATED_PRESSURE)
    if after < before and after + disturbance < lowest:
        disturbance = lowest - after
    limit = math.inf
    if supply.tank_volume > 0.0:
        mass = enclosed_air_mass(supply, gas, pressure, total_volume - dead_volume, resting_volume)
        if leaked > mass:
            leaked = max(mass - ATMOSPHERIC_PRESSURE / per_mass, 0.0)
        limit = (mass - leaked + tank_air_mass(supply, gas.drawn_mass)) * thermal
    return AirCharge(
        after, disturbance, fraction, exponent, total_volume, dead_volume, inflow, leaked, phase, duty, True, limit
    )


def _charge_by_valve(
    supply: SupplyParameters,
    gas: GasState,
    pressure: float,
    target: float,
    volume: float,
    resting_volume: float,
    dt: float,
) -> AirCharge:
    """Return the air after the flow through a valve, or through a restriction downstream of a regulator.

    ``dp = n/V (R T_in dm_in - R T dm_out)`` with ``p V = m R T`` in the muscle.
    """
    total_volume, source = volume + supply.dead_volume, supply_pressure(supply, gas.drawn_mass)
    mass = enclosed_air_mass(supply, gas, pressure, volume, resting_volume)
    held = pressure - gas.pressure_disturbance  # by a regulator upstream
    if supply.thermal_time_constant > 0.0 and supply.polytropic_exponent != 1.0:
        isothermal = mass * AIR_GAS_CONSTANT * supply.temperature / total_volume - ATMOSPHERIC_PRESSURE
        pressure += (isothermal - pressure) * dt / (supply.thermal_time_constant + dt)
    opening, opening_is_fixed, phase, duty, sink = 0.0, True, gas.pwm_phase, gas.pwm_duty, 0.0
    is_regulated = has_regulator_upstream(supply)
    if is_regulated:
        target = sink = regulate(supply, held, target, dt)
        source, opening_is_fixed = min(source, target), False
    elif supply.command_is_opening != 0.0:
        opening = min(max(target, -1.0), 1.0)
    elif supply.valve_gain == 0.0 or supply.pwm_period > 0.0:
        opening = valve_opening(supply, pressure, target)
    else:
        opening_is_fixed = False
    if supply.pwm_period > 0.0 and opening_is_fixed:
        pulse = step_pwm(supply, opening, duty, phase, dt)
        opening, duty, phase = pulse.open_fraction, pulse.duty, pulse.phase
    inside = pressure + ATMOSPHERIC_PRESSURE
    problem = FlowProblem(
        initial_pressure=pressure,
        source_pressure=source,
        sink_pressure=sink,
        target_pressure=target,
        opening=opening,
        opening_is_fixed=opening_is_fixed,
        gas_temperature=inside * total_volume / (mass * AIR_GAS_CONSTANT),
        pressure_per_inflow=supply.polytropic_exponent * AIR_GAS_CONSTANT * supply.temperature / total_volume,
        pressure_per_outflow=supply.polytropic_exponent * inside / mass,
        dt=dt,
        max_inflow=math.inf,
    )
    is_controlled = supply.valve_gain == 0.0 and supply.command_is_opening == 0.0 and supply.pwm_period == 0.0
    has_pilot, leaked_to = is_controlled and not is_regulated, pressure
    if has_pilot and supply.leak_conductance > 0.0:
        leaked_to = solve_pressure(supply, fix_opening(problem, 0.0))
        opening = valve_opening(supply, leaked_to, target)
        problem = fix_opening(problem, opening)
    is_closed = opening_is_fixed and opening == 0.0
    after = pressure
    if not is_closed or supply.leak_conductance > 0.0:
        after = solve_pressure(supply, problem)
    if has_pilot:
        # An ideal pilot stage closes the valve at the target; its rate limits what the valve adds to the leak.
        after = min(after, max(target, leaked_to)) if opening >= 0.0 else max(after, target)
        max_change = supply.max_pressure_rate * dt
        after = min(max(after, leaked_to - max_change), leaked_to + max_change)
    leaked, through = split_flow(supply, problem, after)
    # Above room pressure all inflow comes from the supply, also while a pilot stage compensates a leak.
    # A regulator at room pressure lets in air from the room.
    draws_from_supply = target > 0.0 if is_regulated else opening_at(supply, problem, after) >= 0.0 or after > 0.0
    if supply.tank_volume > 0.0 and draws_from_supply and through > tank_air_mass(supply, gas.drawn_mass):
        problem = limit_inflow(problem, tank_air_mass(supply, gas.drawn_mass))
        after = solve_pressure(supply, problem)
        leaked, through = split_flow(supply, problem, after)
    temperature_ratio = problem.pressure_per_outflow / problem.pressure_per_inflow
    leaked, through = limit_outflow(leaked, mass, temperature_ratio), -limit_outflow(-through, mass, temperature_ratio)
    if is_closed:
        leaked, through = leaked - through, 0.0
    regulated = target if is_regulated else after
    return AirCharge(
        regulated,
        after - regulated,
        1.0,
        supply.polytropic_exponent,
        total_volume,
        supply.dead_volume,
        through,
        leaked,
        phase,
        duty,
        draws_from_supply,
        math.inf,
    )


def constant_pressure(pressure: float) -> AirCharge:
    """Return air that keeps ``pressure`` [Pa] for any motion of the muscle."""
    return AirCharge(pressure, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, True, math.inf)


def enclosed_air(supply: SupplyParameters, pressure: float, volume: float) -> AirCharge:
    """Return the air of a muscle with ``volume`` [m3] at ``pressure`` [Pa], which no air enters or leaves."""
    total_volume, exponent = volume + supply.dead_volume, supply.polytropic_exponent
    return AirCharge(pressure, 0.0, 1.0, exponent, total_volume, supply.dead_volume, 0.0, 0.0, 0.0, 0.0, True, math.inf)


def charge_ideal(supply: SupplyParameters, pressure: float, target: float, dt: float) -> AirCharge:
    """Return the air after a step ``dt`` [s] of an ideal regulator (:func:`is_ideal`)."""
    return constant_pressure(regulate(supply, pressure, target, dt))


def enclosed_air_mass(
    supply: SupplyParameters, gas: GasState, pressure: float, volume: float, resting_volume: float
) -> float:
    """Return the air in muscle and dead volume [kg]; volumes [m3] as in :func:`equilibrium_gas`."""
    if is_ideal(supply):
        return air_mass(pressure, volume + supply.dead_volume, supply.temperature)
    return gas.surplus_mass + air_mass(0.0, resting_volume + supply.dead_volume, supply.temperature)


def pressure_after_motion(air: AirCharge, volume: float) -> float:
    """Return the pressure [Pa] after the muscle has moved to ``volume`` [m3], without the dead volume."""
    pressure = _unlimited_pressure(air, volume)
    if _exhausts_tank(air, volume):
        pressure = min(pressure, air.max_pressure_volume / (volume + air.dead_volume) - ATMOSPHERIC_PRESSURE)
    return pressure


def _unlimited_pressure(air: AirCharge, volume: float) -> float:
    """Return the pressure [Pa] after the motion to ``volume`` [m3] if the supply has air enough."""
    if air.disturbance_fraction == 0.0:
        return air.pressure
    before = air.pressure + air.pressure_disturbance + ATMOSPHERIC_PRESSURE
    ratio = air.volume / (volume + air.dead_volume)
    # Without the power of an isothermal change, a step behind a valve takes a fifth less time.
    expansion = ratio if air.polytropic_exponent == 1.0 else math.pow(ratio, air.polytropic_exponent)
    compression = before * (expansion - 1.0)
    return air.pressure + air.disturbance_fraction * (air.pressure_disturbance + compression)


def _exhausts_tank(air: AirCharge, volume: float) -> bool:
    """Return whether the air for a regulator's pressure in ``volume`` [m3] is more than muscle and tank hold."""
    if air.max_pressure_volume == math.inf:
        return False
    # The compression by the muscle draws no air.
    expanded = air.pressure + (_unlimited_pressure(air, volume) - air.pressure) / air.polytropic_exponent
    return (expanded + ATMOSPHERIC_PRESSURE) * (volume + air.dead_volume) > air.max_pressure_volume


def update_gas(
    supply: SupplyParameters, gas: GasState, air: AirCharge, pressure: float, volume: float, resting_volume: float
) -> GasState:
    """Return the state after the muscle has moved to ``volume`` [m3] and its air has ``pressure`` [Pa].

    ``resting_volume`` [m3] is that of the muscle at its resting length; both are without dead volume.
    """
    if supply.fill_conductance == 0.0:
        # The regulator supplies the mass of the gas law; compression by the muscle draws no air.
        compression = pressure - air.pressure
        surplus = equilibrium_gas(
            supply, air.pressure + compression / air.polytropic_exponent, volume, resting_volume
        ).surplus_mass
        is_tank_empty = _exhausts_tank(air, volume)
        if is_tank_empty:
            vented = air_mass(0.0, resting_volume + supply.dead_volume, supply.temperature)
            surplus = air.max_pressure_volume / (AIR_GAS_CONSTANT * supply.temperature) - vented
        through = surplus - gas.surplus_mass + air.leaked_mass
        drawn, leaked = max(through, 0.0), gas.leaked_mass + air.leaked_mass
        if supply.tank_volume > 0.0:
            # Air that warms up after its compression looks like drawn air, but an empty tank gives none.
            drawn = min(drawn, tank_air_mass(supply, gas.drawn_mass))
        drawn += gas.drawn_mass
        # No regulator compensates the pressure of enclosed air, or has a disturbance when its tank is empty.
        disturbance = compression if air.disturbance_fraction < 1.0 else 0.0
        if is_tank_empty:
            disturbance = 0.0
        return GasState(surplus, drawn, air.pwm_phase, disturbance, leaked, air.pwm_duty)
    drawn = gas.drawn_mass + (max(air.valve_mass, 0.0) if air.draws_from_supply else 0.0)
    leaked, surplus = gas.leaked_mass + air.leaked_mass, gas.surplus_mass + air.valve_mass - air.leaked_mass
    excess = pressure - air.pressure if has_regulator_upstream(supply) else 0.0
    return GasState(surplus, drawn, air.pwm_phase, excess, leaked, air.pwm_duty)
