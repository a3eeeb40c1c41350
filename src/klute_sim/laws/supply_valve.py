"""Flow of one time step through the supply valve and the leak: opening, pulse width modulation and implicit step.

The pressure at the end of the flow is the root of one scalar, monotone, bracketed equation (:func:`solve_pressure`), so
stiff valves and small volumes need no special treatment. Pressures are gauge [Pa].
"""

import math
from typing import NamedTuple

from klute_sim.laws import valve
from klute_sim.laws.pneumatics import ATMOSPHERIC_PRESSURE, SupplyParameters, has_regulator_upstream
from klute_sim.laws.valve import Restriction

LEAK_CRITICAL_RATIO = 0.5
"""Critical pressure ratio of a leak [1] (assumed: a hole with rounded edges)."""
PRESSURE_TOLERANCE = 1e-12
"""Tolerance of the pressure after a flow, relative to the absolute pressure [1]."""
MAX_ITERATIONS = 100
"""Maximum number of iterations for the pressure after a flow."""


class PwmPulse(NamedTuple):
    """Action of an on/off valve during a step."""

    open_fraction: float
    """Fraction of the step in which the valve is open [1]; negative: open to the room."""
    duty: float
    """Commanded duty at the start of the period at the end of the step, -1 to 1."""
    phase: float
    """Phase within the period at the end of the step [1]."""


def step_pwm(supply: SupplyParameters, opening: float, duty: float, phase: float, dt: float) -> PwmPulse:
    """Advance an on/off valve under ``opening`` (-1 to 1) by ``dt`` [s] from ``phase`` of its period.

    Each period begins with a pulse whose width is the opening; until then the ``duty`` of the last period applies. A
    pulse shorter than ``min_pulse`` is omitted, and a pause shorter than that is closed.
    """
    width = abs(opening)
    if width * supply.pwm_period < supply.min_pulse:
        width = 0.0
    elif (1.0 - width) * supply.pwm_period < supply.min_pulse:
        width = 1.0
    new_duty = math.copysign(width, opening)
    if phase == 0.0:
        duty = new_duty
    periods = dt / supply.pwm_period
    end = phase + periods
    old_width = abs(duty)
    open_periods = math.copysign(max(min(end, old_width, 1.0) - min(phase, old_width), 0.0), duty)
    if end >= 1.0:
        full_periods = math.floor(end - 1.0)
        open_periods += new_duty * full_periods + math.copysign(min(end - 1.0 - full_periods, width), new_duty)
        duty = new_duty
        end -= 1.0 + full_periods
    return PwmPulse(open_periods / periods, duty, end)


def valve_opening(supply: SupplyParameters, pressure: float, target: float) -> float:
    """Return the opening of a proportional valve, -1 (exhaust) to 1 (fill), for ``pressure`` and ``target`` [Pa].

    ``gain (target - pressure)``; without a gain the valve is fully open towards the target, as a fixed restriction is.
    """
    if supply.valve_gain == 0.0 or has_regulator_upstream(supply):
        return 1.0 if target >= pressure else -1.0
    return min(max(supply.valve_gain * (target - pressure), -1.0), 1.0)


def valve_flow(
    supply: SupplyParameters,
    source_pressure: float,
    sink_pressure: float,
    pressure: float,
    opening: float,
    gas_temperature: float,
) -> float:
    """Return the mass flow [kg/s] into the muscle through a valve with ``opening`` -1 to 1.

    The air comes from a source at ``source_pressure`` [Pa] or leaves to a sink at ``sink_pressure`` [Pa]. The muscle's
    air has ``pressure`` [Pa] and ``gas_temperature`` [K]. A check valve prevents flow back into the source (assumed).
    """
    inside = pressure + ATMOSPHERIC_PRESSURE
    if opening >= 0.0:
        restriction = Restriction(supply.fill_conductance * opening, supply.fill_critical_ratio)
        return max(
            valve.mass_flow(restriction, source_pressure + ATMOSPHERIC_PRESSURE, inside, supply.temperature), 0.0
        )
    restriction = Restriction(-supply.exhaust_conductance * opening, supply.exhaust_critical_ratio)
    return -valve.mass_flow(restriction, inside, sink_pressure + ATMOSPHERIC_PRESSURE, gas_temperature)


def leak_flow(supply: SupplyParameters, pressure: float, gas_temperature: float) -> float:
    """Return the mass flow [kg/s] out of the leak of a muscle whose air has ``gas_temperature`` [K]."""
    if supply.leak_conductance == 0.0:
        return 0.0
    return valve.mass_flow(
        Restriction(supply.leak_conductance, LEAK_CRITICAL_RATIO),
        pressure + ATMOSPHERIC_PRESSURE,
        ATMOSPHERIC_PRESSURE,
        gas_temperature,
    )


class FlowProblem(NamedTuple):
    """Flow of one step, whose final pressure is to be found."""

    initial_pressure: float
    """Pressure before the step [Pa]."""
    source_pressure: float
    """Pressure of the supply [Pa], or that at which a regulator upstream of a restriction supplies air."""
    sink_pressure: float
    """Pressure to which air leaves [Pa]: 0 in the room, or that which a regulator upstream of a restriction holds."""
    target_pressure: float
    """Commanded pressure [Pa]."""
    opening: float
    """Opening of the valve, if it is fixed, -1 to 1."""
    opening_is_fixed: bool
    """Whether the opening is fixed; otherwise it follows the pressure error."""
    gas_temperature: float
    """Temperature of the air in the muscle [K]."""
    pressure_per_inflow: float
    """Pressure change per mass that enters [Pa/kg]."""
    pressure_per_outflow: float
    """Pressure change per mass that leaves [Pa/kg]."""
    dt: float
    """Time step [s]."""
    max_inflow: float
    """Largest mass that the valve can let in [kg]."""


def fix_opening(problem: FlowProblem, opening: float) -> FlowProblem:
    """Return ``problem`` with a valve that keeps ``opening``, -1 to 1."""
    # numba does not compile NamedTuple._replace.
    return FlowProblem(
        problem.initial_pressure,
        problem.source_pressure,
        problem.sink_pressure,
        problem.target_pressure,
        opening,
        True,
        problem.gas_temperature,
        problem.pressure_per_inflow,
        problem.pressure_per_outflow,
        problem.dt,
        problem.max_inflow,
    )


def limit_inflow(problem: FlowProblem, max_inflow: float) -> FlowProblem:
    """Return ``problem`` with at most ``max_inflow`` [kg] through the valve."""
    # numba does not compile NamedTuple._replace.
    return FlowProblem(
        problem.initial_pressure,
        problem.source_pressure,
        problem.sink_pressure,
        problem.target_pressure,
        problem.opening,
        problem.opening_is_fixed,
        problem.gas_temperature,
        problem.pressure_per_inflow,
        problem.pressure_per_outflow,
        problem.dt,
        max_inflow,
    )


def limit_outflow(outflow: float, mass: float, temperature_ratio: float) -> float:
    """Return the air [kg] that leaves a muscle which holds ``mass`` [kg], for the same change of pressure.

    At most ``mass`` leaves at the muscle's temperature. Beyond it supplied air passes through, at the temperature of
    the supply; ``temperature_ratio`` is that of the muscle's air over that of the supply [1].
    """
    return outflow if outflow <= mass else mass + (outflow - mass) * temperature_ratio


def opening_at(supply: SupplyParameters, problem: FlowProblem, pressure: float) -> float:
    """Return the opening of the valve at the final ``pressure`` [Pa]."""
    return problem.opening if problem.opening_is_fixed else valve_opening(supply, pressure, problem.target_pressure)


def _pressure_residual(supply: SupplyParameters, problem: FlowProblem, pressure: float) -> float:
    """Return ``pressure`` minus the pressure to which the flow at ``pressure`` leads [Pa]; increases with it."""
    through = valve_flow(
        supply,
        problem.source_pressure,
        problem.sink_pressure,
        pressure,
        opening_at(supply, problem, pressure),
        problem.gas_temperature,
    )
    through = min(through, problem.max_inflow / problem.dt)
    out = leak_flow(supply, pressure, problem.gas_temperature)
    inflow, outflow = max(through, 0.0) + max(-out, 0.0), max(-through, 0.0) + max(out, 0.0)
    return (
        pressure
        - problem.initial_pressure
        - problem.dt * (problem.pressure_per_inflow * inflow - problem.pressure_per_outflow * outflow)
    )


def solve_pressure(supply: SupplyParameters, problem: FlowProblem) -> float:
    """Return the pressure [Pa] at the end of a flow by Ridders' method.

    A flow raises or lowers the pressure less than it would at its initial rate, and neither below the room's nor beyond
    the source's. So the initial pressure and the end of this explicit step bracket the root.
    """
    start = problem.initial_pressure
    f_start = _pressure_residual(supply, problem, start)
    if f_start < 0.0:
        low, f_low = start, f_start
        high = min(max(start, problem.source_pressure), start - f_start)
        f_high = _pressure_residual(supply, problem, high)
    else:
        high, f_high = start, f_start
        low = max(min(0.0, start), start - f_start)
        f_low = _pressure_residual(supply, problem, low)
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


def split_flow(supply: SupplyParameters, problem: FlowProblem, after: float) -> tuple[float, float]:
    """Return the air [kg] that leaves through the leak, and that enters through the valve, until pressure ``after``."""
    leaked = leak_flow(supply, after, problem.gas_temperature) * problem.dt
    # The mass through the valve is a difference, so that pressure and mass agree to the last bits.
    difference = (
        after
        - problem.initial_pressure
        + problem.pressure_per_outflow * max(leaked, 0.0)
        - problem.pressure_per_inflow * max(-leaked, 0.0)
    )
    per_mass = problem.pressure_per_inflow if difference > 0.0 else problem.pressure_per_outflow
    return leaked, difference / per_mass
