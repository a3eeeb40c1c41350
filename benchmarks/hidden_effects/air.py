"""The supply: pressure that follows a command by itself, or air that goes through valves and feels the muscle move.

SI; pressure is gauge unless it is called absolute. Without valve, recovery time or tank the pressure does not depend on
the motion, and is solved before it, on a grid of ``AIR_STEP`` (``pressure_trace``). Else it is integrated with the
motion: ``air_stage`` finds what it is at the end of one implicit stage that moves the muscle at ``v``. With T the air's
temperature and n its exponent, the regulator is

    p = r + d,    dr/dt = regulator,    dd/dt = -n p_abs V'/V - d / recovery,

and the muscle behind a valve, whose walls keep the air's temperature,

    dp/dt = R T m' / V - p_abs V'/V,    m' = C rho0 p1 sqrt(T0/T) phi(p2/p1) (ISO 6358) less a leak of the same law,

with a pilot that opens the valve just as far as the target asks for, if it can. A tank that has sunk below the muscle
gives nothing, and takes nothing back.
"""

import math
from typing import NamedTuple

import numpy as np
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
    """The supply: limits and hidden effects of the pressure."""

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


@cached_njit
def interpolate_on_grid(t: float, values: np.ndarray, spacing: float) -> float:
    """Linear interpolation on a regular grid that starts at 0; held outside."""
    place = t / spacing
    if place <= 0.0:
        return values[0]
    i = int(place)
    if i >= len(values) - 1:
        return values[-1]
    return values[i] + (place - i) * (values[i + 1] - values[i])


@cached_njit
def simulate_pressure(command: np.ndarray, command_step: float, n_samples: int, air: AirSupply) -> np.ndarray:
    """Pressure behind the regulator on the air grid, from a command that is linear between its samples.

    Exact wherever the target is linear within a grid step and the rate limit neither begins nor ends to bind in it.
    """
    out = np.empty(n_samples)
    speed = 0.0
    decay = math.exp(-AIR_STEP / air.lag_time) if air.lag_time > 0.0 else 0.0
    before = 0.0
    for k in range(n_samples):
        asked = air.gain * interpolate_on_grid(k * AIR_STEP - air.dead_time, command, command_step) + air.offset
        target = min(max(asked, 0.0), air.supply_pressure)
        if k == 0:
            out[0] = before = target
            continue
        p, most = out[k - 1], air.max_rate * AIR_STEP
        if air.natural_frequency > 0.0:  # midpoint rule on p'' = w^2 (target - p) - 2 z w p'
            w, mean = air.natural_frequency, 0.5 * (before + target)
            speed_mid = speed + 0.5 * AIR_STEP * (w * w * (before - p) - 2.0 * air.damping_ratio * w * speed)
            p_mid = p + 0.5 * AIR_STEP * speed
            speed = speed + AIR_STEP * (w * w * (mean - p_mid) - 2.0 * air.damping_ratio * w * speed_mid)
            speed = min(max(speed, -air.max_rate), air.max_rate)
            wanted = AIR_STEP * min(max(speed_mid, -air.max_rate), air.max_rate)
        elif air.lag_time > 0.0:  # exact response to a linear target
            slope = (target - before) / AIR_STEP
            wanted = (target - slope * air.lag_time) + (p - before + slope * air.lag_time) * decay - p
        else:
            wanted = target - p
        out[k] = min(max(p + min(max(wanted, -most), most), 0.0), air.supply_pressure)
        before = target
    return out


@cached_njit
def is_coupled_to_motion(air: AirSupply) -> bool:
    """Whether the pressure depends on the muscle's motion."""
    return air.fill_conductance > 0.0 or air.recovery_time > 0.0 or air.tank_volume > 0.0


@cached_njit
def target_pressure(t: float, command: np.ndarray, command_step: float, air: AirSupply) -> float:
    """What the supply is told to reach."""
    asked = air.gain * interpolate_on_grid(t - air.dead_time, command, command_step) + air.offset
    return min(max(asked, 0.0), air.supply_pressure)


@cached_njit
def mass_flow(
    conductance: float, critical_ratio: float, inlet_pressure: float, outlet_pressure: float, temperature: float
) -> float:
    """Mass flow [kg/s] from one absolute pressure to another, negative if the other is higher; ISO 6358."""
    up, down = max(inlet_pressure, outlet_pressure), min(inlet_pressure, outlet_pressure)
    beyond = max(0.0, min(down / up, LAMINAR_PRESSURE_RATIO) - critical_ratio) / (1.0 - critical_ratio)
    flow = conductance * REFERENCE_DENSITY_FACTOR / math.sqrt(temperature) * up * math.sqrt(1.0 - beyond * beyond)
    flow *= min(1.0, (1.0 - down / up) / (1.0 - LAMINAR_PRESSURE_RATIO))
    return flow if inlet_pressure >= outlet_pressure else -flow


@cached_njit
def leak_flow(p: float, air: AirSupply) -> float:
    """Mass flow [kg/s] out of the leak."""
    if air.leak_conductance == 0.0:
        return 0.0
    opening = max(0.0, p) / air.supply_pressure if air.leak_is_crack != 0.0 else 1.0
    return mass_flow(air.leak_conductance * opening, LEAK_CRITICAL_RATIO, p + ATMOSPHERE, ATMOSPHERE, air.temperature)


@cached_njit
def source_pressure(drawn_mass: float, air: AirSupply) -> float:
    """Pressure of the tank, or of the endless supply."""
    if air.tank_volume == 0.0:
        return air.supply_pressure
    return min(
        air.supply_pressure,
        max(0.0, air.supply_pressure - drawn_mass * GAS_CONSTANT * air.temperature / air.tank_volume),
    )


@cached_njit
def excess_over_tank(state: np.ndarray, air: AirSupply) -> float:
    """By how much [Pa] a muscle behind a regulator has more than the tank."""
    if air.tank_volume == 0.0 or air.fill_conductance > 0.0:
        return -ATMOSPHERE
    return state[PRESSURE_INDEX] + state[DISTURBANCE_INDEX] - source_pressure(state[DRAWN_MASS_INDEX], air)


@cached_njit
def close_muscle(state: np.ndarray, air: AirSupply) -> None:
    """Forget the disturbance of air that is closed in: there is nothing that would make up for it.

    Between steps, because a stage would take the jump for a speed.
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
    """What the supply still has once the regulator has gone from ``start`` to ``r``; memories of the air in ``new``.

    ``pushed_before`` is the disturbance [Pa] at the start; ``new`` still holds what was drawn until then. Being
    squeezed takes no air: the air that is held is ``(r + d/n) V / (R T)``, absolute.
    """
    d = 0.0
    if air.recovery_time > 0.0:
        pushed = gh * air.exponent * relative_volume_rate
        d = (disturbance_before - pushed * (r + ATMOSPHERE)) / (1.0 + gh / air.recovery_time + pushed)
    drawn = new[DRAWN_MASS_INDEX]
    if air.tank_volume > 0.0:
        held = r + d / air.exponent
        rise = (held - start - disturbance_before / air.exponent) / gh
        came = volume * (rise + (held + ATMOSPHERE) * relative_volume_rate) / (
            GAS_CONSTANT * air.temperature
        ) + leak_flow(r + d, air)
        drawn += gh * max(0.0, came)
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
    """Pressure behind a regulator at the end of a stage.

    It goes no higher than its source. A muscle with more than that is closed: its air can only be let out, and keeps
    the walls' temperature. Whether it is closed is told by the state before (``old``), not by ``base``, which is only
    extrapolated.
    """
    start, before = base[PRESSURE_INDEX], base[DISTURBANCE_INDEX]
    share = gh / air.lag_time if air.lag_time > 0.0 else 1e30
    if excess_over_tank(old, air) >= 0.0:
        start, before = start + before, 0.0
        wanted = (start / share + target) / (1.0 / share + 1.0)
        let_out = min(0.0, max(wanted - start, -gh * air.max_rate))
        lost = gh * leak_flow(start, air) * GAS_CONSTANT * air.temperature / volume
        closed = (start + let_out - lost - gh * relative_volume_rate * ATMOSPHERE) / (1.0 + gh * relative_volume_rate)
        if closed >= source_pressure(base[DRAWN_MASS_INDEX], air):
            new[PRESSURE_INDEX], new[DISTURBANCE_INDEX], new[DRAWN_MASS_INDEX] = closed, 0.0, base[DRAWN_MASS_INDEX]
            return closed
        # Else the muscle has grown until the tank can fill it again.
    wanted = (start / share + target) / (1.0 / share + 1.0)
    r = min(max(wanted, start - gh * air.max_rate), start + gh * air.max_rate)
    new[DRAWN_MASS_INDEX] = base[DRAWN_MASS_INDEX]
    left = source_after_regulation(r, start, before, gh, volume, relative_volume_rate, new, air)
    if left < r:
        low, high = left, r
        while high - low > PRESSURE_TOLERANCE:  # the more is taken, the less is left
            r = 0.5 * (low + high)
            new[DRAWN_MASS_INDEX] = base[DRAWN_MASS_INDEX]
            if source_after_regulation(r, start, before, gh, volume, relative_volume_rate, new, air) < r:
                high = r
            else:
                low = r
        # The upper one, so that a muscle that is as full as its tank counts as closed.
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
    """By how much faster [Pa/s] than the valve can the pressure would have to change to end at ``p``; rises with it.

    ``rising`` says that the valve fills; the memories of the air are left in ``new``.
    """
    per_mass = GAS_CONSTANT * air.temperature / volume
    lost = leak_flow(p, air)
    needed = (p - base[PRESSURE_INDEX]) / gh + (p + ATMOSPHERE) * relative_volume_rate
    new[PRESSURE_INDEX] = p
    if not is_filling:
        out = mass_flow(air.exhaust_conductance, air.critical_ratio, p + ATMOSPHERE, ATMOSPHERE, air.temperature)
        new[DRAWN_MASS_INDEX] = base[DRAWN_MASS_INDEX]
        return needed - max(-per_mass * (out + lost), -air.max_rate)
    came = needed / per_mass + lost
    new[DRAWN_MASS_INDEX] = base[DRAWN_MASS_INDEX] + gh * max(0.0, came)
    room = source_pressure(new[DRAWN_MASS_INDEX], air)
    flow = 0.0  # a check valve lets no air go back
    if room > p:
        flow = mass_flow(air.fill_conductance, air.critical_ratio, room + ATMOSPHERE, p + ATMOSPHERE, air.temperature)
    return needed - min(per_mass * (flow - lost), air.max_rate)


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
    """Pressure behind the valve at the end of a stage: where the pilot wants it, or as near as the flow allows."""
    share = gh / air.lag_time if air.lag_time > 0.0 else 1e30
    pushed = gh * relative_volume_rate
    wanted = target
    if air.lag_time > 0.0:
        wanted = (base[PRESSURE_INDEX] - pushed * ATMOSPHERE + share * target) / (1.0 + share + pushed)
    lost = gh * GAS_CONSTANT * air.temperature / volume * leak_flow(wanted, air)
    kept = (base[PRESSURE_INDEX] - pushed * ATMOSPHERE - lost) / (1.0 + pushed)  # if nothing came through the valve
    rising = wanted >= kept
    beyond = valve_rate_residual(wanted, rising, gh, volume, relative_volume_rate, base, new, air)
    if (beyond <= 0.0) if rising else (beyond >= 0.0):
        return wanted
    low, high = (-0.99 * ATMOSPHERE, wanted) if rising else (wanted, kept)
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
    found = high if f_low >= 0.0 or abs(f_high) < abs(f_low) else low
    valve_rate_residual(found, rising, gh, volume, relative_volume_rate, base, new, air)
    return found


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
    """Pressure at the end of a stage that moves the muscle at ``v`` to ``L``; the air's memories in ``new``."""
    area = law.braid_length * law.braid_length - L * L  # times 4 pi N^2, as is the volume
    volume = law.n_muscles * L * area / (4.0 * math.pi * law.turns * law.turns)
    growth = (area - 2.0 * L * L) / (L * area) * v  # V'/V
    growth = max(growth, -0.3 / gh)  # while a root is bracketed, the muscle may seem to leap
    if air.fill_conductance > 0.0:
        return solve_valve_stage(target, gh, volume, growth, base, new, air)
    return solve_regulator_stage(target, gh, volume, growth, old, base, new, air)
