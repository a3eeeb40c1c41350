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
from compiled import compiled
from law import DISTURBANCE, DRAWN, PRESSURE, Law

AIR_STEP = 5e-5  # s: grid of the pressure
ROOM = 101_325.0  # Pa
GAS_CONSTANT = 287.05  # J/(kg K), dry air
REFERENCE = 1.185 * math.sqrt(293.15)  # kg/m3 sqrt(K): density and temperature of ISO 8778
LEAK_RATIO = 0.5  # critical pressure ratio of a leak (assumed)
LAMINAR = 0.999  # ratio of pressures above which flow is in proportion to their difference (ISO 6358:2013)
NEAR = 1e-4  # Pa: to which a pressure between flows is found
LATE = 1.0  # Pa: by which a muscle may have passed its tank when it is seen to be closed


class Air(NamedTuple):
    """The supply: limits and hidden effects of the pressure."""

    supply: float
    rate: float
    lag: float
    delay: float
    gain: float
    offset: float
    natural: float  # rad/s of second-order dynamics; 0 for none
    damping: float
    temperature: float  # K
    fill: float  # sonic conductances of the valve [m3/(s Pa)]; 0 for a regulator
    exhaust: float
    ratio: float  # critical, of both
    exponent: float
    recovery: float  # s; 0 for a regulator that makes up for everything at once
    leak: float  # m3/(s Pa)
    leak_opens: float  # 1: the leak is a crack, which opens in proportion to the pressure, fully at the supply's
    tank: float  # m3, full at the supply's pressure; 0 for an endless supply


@compiled
def on_grid(t: float, values: np.ndarray, step: float) -> float:
    """Linear interpolation on a regular grid that starts at 0; held outside."""
    place = t / step
    if place <= 0.0:
        return values[0]
    i = int(place)
    if i >= len(values) - 1:
        return values[-1]
    return values[i] + (place - i) * (values[i + 1] - values[i])


@compiled
def pressure_trace(command: np.ndarray, command_step: float, n: int, air: Air) -> np.ndarray:
    """Pressure behind the regulator on the air grid, from a command that is linear between its samples.

    Exact wherever the target is linear within a grid step and the rate limit neither begins nor ends to bind in it.
    """
    out = np.empty(n)
    speed = 0.0
    decay = math.exp(-AIR_STEP / air.lag) if air.lag > 0.0 else 0.0
    before = 0.0
    for k in range(n):
        asked = air.gain * on_grid(k * AIR_STEP - air.delay, command, command_step) + air.offset
        target = min(max(asked, 0.0), air.supply)
        if k == 0:
            out[0] = before = target
            continue
        p, most = out[k - 1], air.rate * AIR_STEP
        if air.natural > 0.0:  # midpoint rule on p'' = w^2 (target - p) - 2 z w p'
            w, mean = air.natural, 0.5 * (before + target)
            speed_mid = speed + 0.5 * AIR_STEP * (w * w * (before - p) - 2.0 * air.damping * w * speed)
            p_mid = p + 0.5 * AIR_STEP * speed
            speed = speed + AIR_STEP * (w * w * (mean - p_mid) - 2.0 * air.damping * w * speed_mid)
            speed = min(max(speed, -air.rate), air.rate)
            wanted = AIR_STEP * min(max(speed_mid, -air.rate), air.rate)
        elif air.lag > 0.0:  # exact response to a linear target
            slope = (target - before) / AIR_STEP
            wanted = (target - slope * air.lag) + (p - before + slope * air.lag) * decay - p
        else:
            wanted = target - p
        out[k] = min(max(p + min(max(wanted, -most), most), 0.0), air.supply)
        before = target
    return out


@compiled
def moves(air: Air) -> bool:
    """Whether the pressure depends on the muscle's motion."""
    return air.fill > 0.0 or air.recovery > 0.0 or air.tank > 0.0


@compiled
def target_at(t: float, command: np.ndarray, command_step: float, air: Air) -> float:
    """What the supply is told to reach."""
    asked = air.gain * on_grid(t - air.delay, command, command_step) + air.offset
    return min(max(asked, 0.0), air.supply)


@compiled
def through(conductance: float, ratio: float, first: float, second: float, temperature: float) -> float:
    """Mass flow [kg/s] from one absolute pressure to another, negative if the other is higher; ISO 6358."""
    up, down = max(first, second), min(first, second)
    beyond = max(0.0, min(down / up, LAMINAR) - ratio) / (1.0 - ratio)
    flow = conductance * REFERENCE / math.sqrt(temperature) * up * math.sqrt(1.0 - beyond * beyond)
    flow *= min(1.0, (1.0 - down / up) / (1.0 - LAMINAR))
    return flow if first >= second else -flow


@compiled
def leakage(p: float, air: Air) -> float:
    """Mass flow [kg/s] out of the leak."""
    if air.leak == 0.0:
        return 0.0
    opening = max(0.0, p) / air.supply if air.leak_opens != 0.0 else 1.0
    return through(air.leak * opening, LEAK_RATIO, p + ROOM, ROOM, air.temperature)


@compiled
def source(drawn: float, air: Air) -> float:
    """Pressure of the tank, or of the endless supply."""
    if air.tank == 0.0:
        return air.supply
    return min(air.supply, max(0.0, air.supply - drawn * GAS_CONSTANT * air.temperature / air.tank))


@compiled
def beyond_the_tank(memory: np.ndarray, air: Air) -> float:
    """By how much [Pa] a muscle behind a regulator has more than the tank."""
    if air.tank == 0.0 or air.fill > 0.0:
        return -ROOM
    return memory[PRESSURE] + memory[DISTURBANCE] - source(memory[DRAWN], air)


@compiled
def close(memory: np.ndarray, air: Air) -> None:
    """Forget the disturbance of air that is closed in: there is nothing that would make up for it.

    Between steps, because a stage would take the jump for a speed.
    """
    if beyond_the_tank(memory, air) >= 0.0:
        memory[PRESSURE] += memory[DISTURBANCE]
        memory[DISTURBANCE] = 0.0


@compiled
def regulated(
    r: float, start: float, pushed_before: float, gh: float, volume: float, growth: float, new: np.ndarray, air: Air
) -> float:
    """What the supply still has once the regulator has gone from ``start`` to ``r``; memories of the air in ``new``.

    ``pushed_before`` is the disturbance [Pa] at the start; ``new`` still holds what was drawn until then. Being
    squeezed takes no air: the air that is held is ``(r + d/n) V / (R T)``, absolute.
    """
    d = 0.0
    if air.recovery > 0.0:
        pushed = gh * air.exponent * growth
        d = (pushed_before - pushed * (r + ROOM)) / (1.0 + gh / air.recovery + pushed)
    drawn = new[DRAWN]
    if air.tank > 0.0:
        held = r + d / air.exponent
        rise = (held - start - pushed_before / air.exponent) / gh
        came = volume * (rise + (held + ROOM) * growth) / (GAS_CONSTANT * air.temperature) + leakage(r + d, air)
        drawn += gh * max(0.0, came)
    new[PRESSURE], new[DISTURBANCE], new[DRAWN] = r, d, drawn
    return source(drawn, air)


@compiled
def regulator_stage(
    target: float,
    gh: float,
    volume: float,
    growth: float,
    old: np.ndarray,
    base: np.ndarray,
    new: np.ndarray,
    air: Air,
) -> float:
    """Pressure behind a regulator at the end of a stage.

    It goes no higher than its source. A muscle with more than that is closed: its air can only be let out, and keeps
    the walls' temperature. Whether it is closed is told by the state before (``old``), not by ``base``, which is only
    extrapolated.
    """
    start, before = base[PRESSURE], base[DISTURBANCE]
    share = gh / air.lag if air.lag > 0.0 else 1e30
    if beyond_the_tank(old, air) >= 0.0:
        start, before = start + before, 0.0
        wanted = (start / share + target) / (1.0 / share + 1.0)
        let_out = min(0.0, max(wanted - start, -gh * air.rate))
        lost = gh * leakage(start, air) * GAS_CONSTANT * air.temperature / volume
        closed = (start + let_out - lost - gh * growth * ROOM) / (1.0 + gh * growth)
        if closed >= source(base[DRAWN], air):
            new[PRESSURE], new[DISTURBANCE], new[DRAWN] = closed, 0.0, base[DRAWN]
            return closed
        # Else the muscle has grown until the tank can fill it again.
    wanted = (start / share + target) / (1.0 / share + 1.0)
    r = min(max(wanted, start - gh * air.rate), start + gh * air.rate)
    new[DRAWN] = base[DRAWN]
    left = regulated(r, start, before, gh, volume, growth, new, air)
    if left < r:
        low, high = left, r
        while high - low > NEAR:  # the more is taken, the less is left
            r = 0.5 * (low + high)
            new[DRAWN] = base[DRAWN]
            if regulated(r, start, before, gh, volume, growth, new, air) < r:
                high = r
            else:
                low = r
        # The upper one, so that a muscle that is as full as its tank counts as closed.
        new[DRAWN] = base[DRAWN]
        regulated(high, start, before, gh, volume, growth, new, air)
    return new[PRESSURE] + new[DISTURBANCE]


@compiled
def beyond_the_valve(
    p: float, rising: bool, gh: float, volume: float, growth: float, base: np.ndarray, new: np.ndarray, air: Air
) -> float:
    """By how much faster [Pa/s] than the valve can the pressure would have to change to end at ``p``; rises with it.

    ``rising`` says that the valve fills; the memories of the air are left in ``new``.
    """
    per_mass = GAS_CONSTANT * air.temperature / volume
    lost = leakage(p, air)
    needed = (p - base[PRESSURE]) / gh + (p + ROOM) * growth
    new[PRESSURE] = p
    if not rising:
        out = through(air.exhaust, air.ratio, p + ROOM, ROOM, air.temperature)
        new[DRAWN] = base[DRAWN]
        return needed - max(-per_mass * (out + lost), -air.rate)
    came = needed / per_mass + lost
    new[DRAWN] = base[DRAWN] + gh * max(0.0, came)
    room = source(new[DRAWN], air)
    flow = 0.0  # a check valve lets no air go back
    if room > p:
        flow = through(air.fill, air.ratio, room + ROOM, p + ROOM, air.temperature)
    return needed - min(per_mass * (flow - lost), air.rate)


@compiled
def valve_stage(
    target: float, gh: float, volume: float, growth: float, base: np.ndarray, new: np.ndarray, air: Air
) -> float:
    """Pressure behind the valve at the end of a stage: where the pilot wants it, or as near as the flow allows."""
    share = gh / air.lag if air.lag > 0.0 else 1e30
    pushed = gh * growth
    wanted = target
    if air.lag > 0.0:
        wanted = (base[PRESSURE] - pushed * ROOM + share * target) / (1.0 + share + pushed)
    lost = gh * GAS_CONSTANT * air.temperature / volume * leakage(wanted, air)
    kept = (base[PRESSURE] - pushed * ROOM - lost) / (1.0 + pushed)  # if nothing came through the valve
    rising = wanted >= kept
    beyond = beyond_the_valve(wanted, rising, gh, volume, growth, base, new, air)
    if (beyond <= 0.0) if rising else (beyond >= 0.0):
        return wanted
    low, high = (-0.99 * ROOM, wanted) if rising else (wanted, kept)
    f_low = beyond_the_valve(low, rising, gh, volume, growth, base, new, air)
    f_high = beyond_the_valve(high, rising, gh, volume, growth, base, new, air)
    side = 0
    for _ in range(200):  # Illinois: false position, a bound that stays counting half
        if high - low < NEAR or f_low >= 0.0 or f_high <= 0.0:
            break
        p = (low * f_high - high * f_low) / (f_high - f_low)
        if not low < p < high:
            p = 0.5 * (low + high)
        f = beyond_the_valve(p, rising, gh, volume, growth, base, new, air)
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
    beyond_the_valve(found, rising, gh, volume, growth, base, new, air)
    return found


@compiled
def air_stage(
    v: float,
    L: float,
    target: float,
    gh: float,
    old: np.ndarray,
    base: np.ndarray,
    new: np.ndarray,
    law: Law,
    air: Air,
) -> float:
    """Pressure at the end of a stage that moves the muscle at ``v`` to ``L``; the air's memories in ``new``."""
    area = law.braid * law.braid - L * L  # times 4 pi N^2, as is the volume
    volume = law.count * L * area / (4.0 * math.pi * law.turns * law.turns)
    growth = (area - 2.0 * L * L) / (L * area) * v  # V'/V
    growth = max(growth, -0.3 / gh)  # while a root is bracketed, the muscle may seem to leap
    if air.fill > 0.0:
        return valve_stage(target, gh, volume, growth, base, new, air)
    return regulator_stage(target, gh, volume, growth, old, base, new, air)
