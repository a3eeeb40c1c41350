"""Air supply: pressure that follows a command, or air that flows through valves and is compressed by the muscle.

SI units; pressure is gauge unless it is called absolute. Without valve, recovery time or tank, the pressure is
independent of the motion and is solved before it, on a grid of ``AIR_STEP`` (``simulate_pressure``). Otherwise it is
integrated with the motion: ``solve_air_stage`` returns the pressure at the end of one implicit stage in which the
muscle moves at ``v``. With the air temperature T and its exponent n, the regulator is

    p = r + d,    dr/dt = regulator,    dd/dt = -n p_abs V'/V - d / recovery,

and the muscle behind a valve, whose walls keep the temperature of the air, is

    dp/dt = R T m' / V - p_abs V'/V,    m' = C rho0 p1 sqrt(T0/T) phi(p2/p1) (ISO 6358) less a leak of the same law,

with a pilot that opens the valve as far as the target requires and the flow allows. A tank with less pressure than the
muscle neither supplies nor accepts air. With a regulator upstream of the restriction the same flow has its other end at
the regulated pressure (``restriction_rate_residual``), which the motion does not change.
"""

import math
from typing import NamedTuple

import numpy as np
from benchmarks.hidden_effects.air_space import air_space
from benchmarks.hidden_effects.compiled import cached_njit
from benchmarks.hidden_effects.law import DISTURBANCE_INDEX, DRAWN_MASS_INDEX, PRESSURE_INDEX, Law

AIR_STEP = 5e-5  # s: grid of the pressure
ATMOSPHERE = 101_325.0  # Pa
GAS_CONSTANT = 287.05  # J/(kg K), dry air
REFERENCE_DENSITY_FACTOR = 1.185 * math.sqrt(293.15)  # kg/m3 sqrt(K): density and temperature of ISO 8778
LEAK_CRITICAL_RATIO = 0.5  # critical pressure ratio of a leak (assumed)
LAMINAR_PRESSURE_RATIO = (
    0.999  # ratio of pressures above which flow is in proportion to their difference (ISO 6358:2013)
)
PRESSURE_TOLERANCE = 1e-4  # Pa: to which a pressure between flows is found
CLOSING_TOLERANCE = 1.0  # Pa: by which a muscle may have passed its tank when it is seen to be closed


class AirSupply(NamedTuple):
    """Limits of the supply and hidden effects of the pressure."""

    supply_pressure: float
    max_rate: float
    lag_time: float
    dead_time: float
    gain: float
    offset: float
    natural_frequency: float  # rad/s of second-order dynamics; 0 for none
    damping_ratio: float
    temperature: float  # K
    fill_conductance: float  # sonic conductances of the valve [m3/(s Pa)]; 0 for a regulator
    exhaust_conductance: float
    critical_ratio: float  # critical, of both
    exponent: float
    recovery_time: float  # s; 0 for a regulator that makes up for everything at once
    leak_conductance: float  # m3/(s Pa)
    leak_is_crack: float  # 1: the leak is a crack, which opens in proportion to the pressure, fully at the supply's
    tank_volume: float  # m3, full at the supply's pressure; 0 for an endless supply
    dead_volume: float  # m3, of fittings and hoses
    regulator_is_upstream: float  # 1: the conductances are of a needle after the regulator, 0: of a controlled valve


@cached_njit
def interpolate_on_grid(t: float, values: np.ndarray, spacing: float) -> float:
    """Interpolate linearly on a regular grid from 0 with constant extrapolation."""
    place = t / spacing
    if place <= 0.0:
        return values[0]
    i = int(place)
    if i >= len(values) - 1:
        return values[-1]
    return values[i] + (place - i) * (values[i + 1] - values[i])


@cached_njit
def simulate_pressure(command: np.ndarray, command_step: float, n_samples: int, air: AirSupply) -> np.ndarray:
    """Return the pressure behind the regulator on the air grid for a command that is linear between its samples.

    Exact wherever the target is linear within a grid step and the rate limit neither starts nor stops acting in it.
    """
    out = np.empty(n_samples)
    speed = 0.0
    decay = math.exp(-AIR_STEP / air.lag_time) if air.lag_time > 0.0 else 0.0
    previous_target = 0.0
    for k in range(n_samples):
        commanded = air.gain * interpolate_on_grid(k * AIR_STEP - air.dead_time, command, command_step) + air.offset
        target = min(max(commanded, 0.0), air.supply_pressure)
        if k == 0:
            out[0] = previous_target = target
            continue
        p, max_change = out[k - 1], air.max_rate * AIR_STEP
        if air.natural_frequency > 0.0:  # midpoint rule on p'' = w^2 (target - p) - 2 z w p'
            w, mean = air.natural_frequency, 0.5 * (previous_target + target)
            speed_mid = speed + 0.5 * AIR_STEP * (w * w * (previous_target - p) - 2.0 * air.damping_ratio * w * speed)
            p_mid = p + 0.5 * AIR_STEP * speed
            speed = speed + AIR_STEP * (w * w * (mean - p_mid) - 2.0 * air.damping_ratio * w * speed_mid)
            speed = min(max(speed, -air.max_rate), air.max_rate)
            change = AIR_STEP * min(max(speed_mid, -air.max_rate), air.max_rate)
        elif air.lag_time > 0.0:  # exact response to a linear target
            slope = (target - previous_target) / AIR_STEP
            change = (target - slope * air.lag_time) + (p - previous_target + slope * air.lag_time) * decay - p
        else:
            change = target - p
        out[k] = min(max(p + min(max(change, -max_change), max_change), 0.0), air.supply_pressure)
        previous_target = target
    return out


@cached_njit
def is_coupled_to_motion(air: AirSupply) -> bool:
    """Return whether the pressure depends on the motion of the muscle."""
    return air.fill_conductance > 0.0 or air.recovery_time > 0.0 or air.tank_volume > 0.0


@cached_njit
def target_pressure(t: float, command: np.ndarray, command_step: float, air: AirSupply) -> float:
    """Return the pressure that the supply has to reach."""
    commanded = air.gain * interpolate_on_grid(t - air.dead_time, command, command_step) + air.offset
    return min(max(commanded, 0.0), air.supply_pressure)


@cached_njit
def mass_flow(
    conductance: float, critical_ratio: float, inlet_pressure: float, outlet_pressure: float, temperature: float
) -> float:
    """Return the mass flow [kg/s] between two absolute pressures, negative if the outlet pressure is higher; ISO
    6358.
    """
    up, down = max(inlet_pressure, outlet_pressure), min(inlet_pressure, outlet_pressure)
    beyond = max(0.0, min(down / up, LAMINAR_PRESSURE_RATIO) - critical_ratio) / (1.0 - critical_ratio)
    flow = conductance * REFERENCE_DENSITY_FACTOR / math.sqrt(temperature) * up * math.sqrt(1.0 - beyond * beyond)
    flow *= min(1.0, (1.0 - down / up) / (1.0 - LAMINAR_PRESSURE_RATIO))
    return flow if inlet_pressure >= outlet_pressure else -flow


@cached_njit
def leak_flow(p: float, air: AirSupply) -> float:
    """Return the mass flow [kg/s] out of the leak."""
    if air.leak_conductance == 0.0:
        return 0.0
    opening = max(0.0, p) / air.supply_pressure if air.leak_is_crack != 0.0 else 1.0
    return mass_flow(air.leak_conductance * opening, LEAK_CRITICAL_RATIO, p + ATMOSPHERE, ATMOSPHERE, air.temperature)


@cached_njit
def source_pressure(drawn_mass: float, air: AirSupply) -> float:
    """Return the pressure of the tank or of the unlimited supply."""
    if air.tank_volume == 0.0:
        return air.supply_pressure
    return min(
        air.supply_pressure,
        max(0.0, air.supply_pressure - drawn_mass * GAS_CONSTANT * air.temperature / air.tank_volume),
    )


@cached_njit
def steady_pressure(target: float, air: AirSupply) -> float:
    """Return the pressure after a long time from a full tank: below the target where a leak follows a needle."""
    source = min(target, source_pressure(0.0, air))
    if air.regulator_is_upstream == 0.0:
        return source
    low, high = 0.0, source
    while high - low > PRESSURE_TOLERANCE:
        p = 0.5 * (low + high)
        flow = mass_flow(air.fill_conductance, air.critical_ratio, source + ATMOSPHERE, p + ATMOSPHERE, air.temperature)
        if flow < leak_flow(p, air):
            high = p
        else:
            low = p
    return high


@cached_njit
def excess_over_tank(state: np.ndarray, air: AirSupply) -> float:
    """Return the pressure [Pa] of a muscle behind a regulator above that of the tank."""
    if air.tank_volume == 0.0 or air.fill_conductance > 0.0:
        return -ATMOSPHERE
    return state[PRESSURE_INDEX] + state[DISTURBANCE_INDEX] - source_pressure(state[DRAWN_MASS_INDEX], air)


@cached_njit
def close_muscle(state: np.ndarray, air: AirSupply) -> None:
    """Clear the disturbance of enclosed air, which no regulator compensates.

    Called between steps, because a stage would interpret the jump as a rate.
    """
    if excess_over_tank(state, air) >= 0.0:
        state[PRESSURE_INDEX] += state[DISTURBANCE_INDEX]
        state[DISTURBANCE_INDEX] = 0.0


@cached_njit
def source_after_regulation(
    r: float,
    start: float,
    disturbance_before: float,
    gh: float,
    volume: float,
    relative_volume_rate: float,
    new: np.ndarray,
    air: AirSupply,
) -> float:
    """Return the source pressure after the regulator has moved from ``start`` to ``r``; ``new`` receives the air
    states.

    ``disturbance_before`` [Pa] is the disturbance at the start; ``new`` still holds the mass drawn until then.
    Compression draws no air: the enclosed air is ``(r + d/n) V / (R T)``, absolute.
    """
    d = 0.0
    if air.recovery_time > 0.0:
        compression = gh * air.exponent * relative_volume_rate
        d = (disturbance_before - compression * (r + ATMOSPHERE)) / (1.0 + gh / air.recovery_time + compression)
    drawn = new[DRAWN_MASS_INDEX]
    if air.tank_volume > 0.0:
        enclosed = r + d / air.exponent
        rise = (enclosed - start - disturbance_before / air.exponent) / gh
        inflow = volume * (rise + (enclosed + ATMOSPHERE) * relative_volume_rate) / (
            GAS_CONSTANT * air.temperature
        ) + leak_flow(r + d, air)
        drawn += gh * max(0.0, inflow)
    new[PRESSURE_INDEX], new[DISTURBANCE_INDEX], new[DRAWN_MASS_INDEX] = r, d, drawn
    return source_pressure(drawn, air)


@cached_njit
def solve_regulator_stage(
    target: float,
    gh: float,
    volume: float,
    relative_volume_rate: float,
    old: np.ndarray,
    base: np.ndarray,
    new: np.ndarray,
    air: AirSupply,
) -> float:
    """Return the pressure behind a regulator at the end of a stage.

    It does not exceed its source. A muscle with a higher pressure is closed: its air can only be released, and keeps
    the temperature of the walls. The state before (``old``) determines whether it is closed, because ``base`` is
    extrapolated.
    """
    start, before = base[PRESSURE_INDEX], base[DISTURBANCE_INDEX]
    share = gh / air.lag_time if air.lag_time > 0.0 else 1e30
    if excess_over_tank(old, air) >= 0.0:
        start, before = start + before, 0.0
        unlimited = (start / share + target) / (1.0 / share + 1.0)
        release = min(0.0, max(unlimited - start, -gh * air.max_rate))
        leak_loss = gh * leak_flow(start, air) * GAS_CONSTANT * air.temperature / volume
        closed = (start + release - leak_loss - gh * relative_volume_rate * ATMOSPHERE) / (
            1.0 + gh * relative_volume_rate
        )
        if closed >= source_pressure(base[DRAWN_MASS_INDEX], air):
            new[PRESSURE_INDEX], new[DISTURBANCE_INDEX], new[DRAWN_MASS_INDEX] = closed, 0.0, base[DRAWN_MASS_INDEX]
            return closed
        # Otherwise the muscle has grown until the tank can fill it again.
    unlimited = (start / share + target) / (1.0 / share + 1.0)
    r = min(max(unlimited, start - gh * air.max_rate), start + gh * air.max_rate)
    new[DRAWN_MASS_INDEX] = base[DRAWN_MASS_INDEX]
    source = source_after_regulation(r, start, before, gh, volume, relative_volume_rate, new, air)
    if source < r:
        low, high = source, r
        while high - low > PRESSURE_TOLERANCE:  # the source pressure falls with the mass drawn
            r = 0.5 * (low + high)
            new[DRAWN_MASS_INDEX] = base[DRAWN_MASS_INDEX]
            if source_after_regulation(r, start, before, gh, volume, relative_volume_rate, new, air) < r:
                high = r
            else:
                low = r
        # The upper bound, so that a muscle at tank pressure counts as closed.
        new[DRAWN_MASS_INDEX] = base[DRAWN_MASS_INDEX]
        source_after_regulation(high, start, before, gh, volume, relative_volume_rate, new, air)
    return new[PRESSURE_INDEX] + new[DISTURBANCE_INDEX]


@cached_njit
def valve_rate_residual(
    p: float,
    is_filling: bool,
    gh: float,
    volume: float,
    relative_volume_rate: float,
    base: np.ndarray,
    new: np.ndarray,
    air: AirSupply,
) -> float:
    """Return the excess [Pa/s] of the pressure rate that ends at ``p`` over the rate of the valve; it increases with
    ``p``.

    ``is_filling`` tells whether the valve fills; ``new`` receives the air states.
    """
    per_mass = GAS_CONSTANT * air.temperature / volume
    leak_loss = leak_flow(p, air)
    required_rate = (p - base[PRESSURE_INDEX]) / gh + (p + ATMOSPHERE) * relative_volume_rate
    new[PRESSURE_INDEX] = p
    if not is_filling:
        out = mass_flow(air.exhaust_conductance, air.critical_ratio, p + ATMOSPHERE, ATMOSPHERE, air.temperature)
        new[DRAWN_MASS_INDEX] = base[DRAWN_MASS_INDEX]
        return required_rate - max(-per_mass * (out + leak_loss), -air.max_rate)
    inflow = required_rate / per_mass + leak_loss
    new[DRAWN_MASS_INDEX] = base[DRAWN_MASS_INDEX] + gh * max(0.0, inflow)
    source = source_pressure(new[DRAWN_MASS_INDEX], air)
    flow = 0.0  # a check valve lets no air go back
    if source > p:
        flow = mass_flow(air.fill_conductance, air.critical_ratio, source + ATMOSPHERE, p + ATMOSPHERE, air.temperature)
    return required_rate - min(per_mass * (flow - leak_loss), air.max_rate)


@cached_njit
def solve_valve_stage(
    target: float,
    gh: float,
    volume: float,
    relative_volume_rate: float,
    base: np.ndarray,
    new: np.ndarray,
    air: AirSupply,
) -> float:
    """Return the pressure behind the valve at the end of a stage: that of the pilot, or the nearest that the flow
    allows.
    """
    share = gh / air.lag_time if air.lag_time > 0.0 else 1e30
    compression = gh * relative_volume_rate
    unlimited = target
    if air.lag_time > 0.0:
        unlimited = (base[PRESSURE_INDEX] - compression * ATMOSPHERE + share * target) / (1.0 + share + compression)
    leak_loss = gh * GAS_CONSTANT * air.temperature / volume * leak_flow(unlimited, air)
    closed_pressure = (base[PRESSURE_INDEX] - compression * ATMOSPHERE - leak_loss) / (
        1.0 + compression
    )  # with a closed valve
    rising = unlimited >= closed_pressure
    residual = valve_rate_residual(unlimited, rising, gh, volume, relative_volume_rate, base, new, air)
    if (residual <= 0.0) if rising else (residual >= 0.0):
        return unlimited
    low, high = (-0.99 * ATMOSPHERE, unlimited) if rising else (unlimited, closed_pressure)
    f_low = valve_rate_residual(low, rising, gh, volume, relative_volume_rate, base, new, air)
    f_high = valve_rate_residual(high, rising, gh, volume, relative_volume_rate, base, new, air)
    side = 0
    for _ in range(200):  # Illinois: false position, a bound that stays counting half
        if high - low < PRESSURE_TOLERANCE or f_low >= 0.0 or f_high <= 0.0:
            break
        p = (low * f_high - high * f_low) / (f_high - f_low)
        if not low < p < high:
            p = 0.5 * (low + high)
        f = valve_rate_residual(p, rising, gh, volume, relative_volume_rate, base, new, air)
        if f == 0.0:
            low = high = p
        elif f > 0.0:
            high, f_high = p, f
            if side == 1:
                f_low *= 0.5
            side = 1
        else:
            low, f_low = p, f
            if side == -1:
                f_high *= 0.5
            side = -1
    solution = high if f_low >= 0.0 or abs(f_high) < abs(f_low) else low
    valve_rate_residual(solution, rising, gh, volume, relative_volume_rate, base, new, air)
    return solution


@cached_njit
def restriction_rate_residual(
    p: float,
    held: float,
    gh: float,
    volume: float,
    relative_volume_rate: float,
    base: np.ndarray,
    new: np.ndarray,
    air: AirSupply,
) -> float:
    """Return the excess [Pa/s] of the pressure rate that ends at ``p`` over that of the flow from a regulator.

    The regulator holds ``held`` [Pa] at the other end of the restriction, if its tank has that much, and gives off a
    higher pressure to the room; it draws nothing while it is open to the room. ``new`` receives the air states.
    """
    per_mass, leak_loss = GAS_CONSTANT * air.temperature / volume, leak_flow(p, air)
    required_rate = (p - base[PRESSURE_INDEX]) / gh + (p + ATMOSPHERE) * relative_volume_rate
    drawn = max(0.0, required_rate / per_mass + leak_loss) if held > 0.0 else 0.0
    new[PRESSURE_INDEX], new[DRAWN_MASS_INDEX] = p, base[DRAWN_MASS_INDEX] + gh * drawn
    source = min(held, source_pressure(new[DRAWN_MASS_INDEX], air))
    flow = 0.0
    if p < source:
        flow = mass_flow(air.fill_conductance, air.critical_ratio, source + ATMOSPHERE, p + ATMOSPHERE, air.temperature)
    elif p > held:
        flow = mass_flow(
            air.exhaust_conductance, air.critical_ratio, held + ATMOSPHERE, p + ATMOSPHERE, air.temperature
        )
    return required_rate - per_mass * (flow - leak_loss)


@cached_njit
def solve_restriction_stage(
    held: float,
    gh: float,
    volume: float,
    relative_volume_rate: float,
    base: np.ndarray,
    new: np.ndarray,
    air: AirSupply,
) -> float:
    """Return the pressure at the end of a stage behind a restriction whose other end is ``held`` [Pa]; bisection."""
    compression = gh * relative_volume_rate
    low, high = -0.99 * ATMOSPHERE, max(held, (base[PRESSURE_INDEX] - compression * ATMOSPHERE) / (1.0 + compression))
    while high - low > PRESSURE_TOLERANCE:
        middle = 0.5 * (low + high)
        if restriction_rate_residual(middle, held, gh, volume, relative_volume_rate, base, new, air) > 0.0:
            high = middle
        else:
            low = middle
    restriction_rate_residual(high, held, gh, volume, relative_volume_rate, base, new, air)
    return high


@cached_njit
def solve_air_stage(
    v: float,
    L: float,
    target: float,
    gh: float,
    old: np.ndarray,
    base: np.ndarray,
    new: np.ndarray,
    law: Law,
    air: AirSupply,
) -> float:
    """Return the pressure at the end of a stage that moves the muscle at ``v`` to ``L``; ``new`` receives the air
    states.
    """
    volume, volume_rate = air_space(L, v, air.dead_volume, law)
    growth = max(volume_rate / volume, -0.3 / gh)  # the bracketing of a root may try very large speeds
    if air.regulator_is_upstream != 0.0:
        return solve_restriction_stage(target, gh, volume, growth, base, new, air)
    if air.fill_conductance > 0.0:
        return solve_valve_stage(target, gh, volume, growth, base, new, air)
    return solve_regulator_stage(target, gh, volume, growth, old, base, new, air)
