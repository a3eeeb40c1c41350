"""How a muscle is filled and emptied: valves with a limited flow, the muscle's own volume, leaks, a tank.

One step has two halves. First air flows while the muscle keeps its volume (:func:`charge`): one scalar equation for the
pressure at the end, bracketed and monotone, so that stiff valves and small volumes are no matter. Then the muscle moves
and takes its air along (:func:`felt`): closed, ``p V^n`` stays. Both are exact for their half, so closed air obeys its
closed form, and at constant temperature pressure, volume and mass obey the gas law to the last bits.

Pressures are gauge [Pa] unless said otherwise.
"""

import math
from typing import NamedTuple

from klute_sim.laws import valve
from klute_sim.laws.pneumatics import AIR_CONSTANT, ATMOSPHERE, Supply, air_mass, regulate
from klute_sim.laws.valve import Restriction

LEAK_RATIO = 0.5
"""Critical pressure ratio of a leak (assumed: a hole with rounded edges)."""
TOLERANCE = 1e-12
"""Of the pressure after a flow, relative to the absolute pressure."""
MOST_ITERATIONS = 100


class Gas(NamedTuple):
    """What the supply remembers; all zero for a vented muscle at its resting length and a full tank."""

    surplus: float = 0.0
    """Air in muscle and dead volume [kg], beyond what is in there vented at resting length."""
    drawn: float = 0.0
    """Air taken from tank or compressor since the start [kg]."""
    phase: float = 0.0
    """Of an on/off valve's period [1]."""
    disturbance: float = 0.0
    """What a change of the volume did to the pressure, and the regulator has not made up for [Pa]."""


REMEMBERED = len(Gas._fields)


class Charge(NamedTuple):
    """The muscle's air after the flow of a step, before the muscle moves."""

    pressure: float
    """[Pa]"""
    disturbance: float
    """Still to be made up for, at the start of the step [Pa]."""
    kept: float
    """Share of a disturbance that is left at the end of the step [1]."""
    exponent: float
    """[1]"""
    volume: float
    """With the dead volume, before the muscle moves [m3]."""
    valve: float
    """Air that came through the valve [kg]; negative: went."""
    leaked: float
    """[kg]"""
    phase: float
    """Of an on/off valve's period after the step [1]."""
    draws: bool
    """Whether the valve stands towards the supply."""


def plain(supply: Supply) -> bool:
    """Whether it is an ideal regulator, with nothing to remember."""
    return supply.fill == 0.0 and supply.leak == 0.0 and supply.tank == 0.0 and supply.recovery == 0.0


def upstream(supply: Supply, drawn: float) -> float:
    """Pressure [Pa] that the supply has when ``drawn`` [kg] of air were taken: its own, or what the tank still has."""
    if supply.tank == 0.0:
        return supply.pressure
    left = supply.tank_pressure - drawn * AIR_CONSTANT * supply.temperature / supply.tank
    return min(supply.pressure, max(left, 0.0))


def rested(supply: Supply, pressure: float, volume: float, rest_volume: float) -> Gas:
    """What is remembered after a long time at ``pressure`` in ``volume`` [m3], the tank full again.

    ``rest_volume`` [m3] is that of the muscle at its resting length; both without dead volume.
    """
    vented = air_mass(0.0, rest_volume + supply.dead_volume, supply.temperature)
    return Gas(air_mass(pressure, volume + supply.dead_volume, supply.temperature) - vented, 0.0, 0.0, 0.0)


def pulsed(supply: Supply, opening: float, phase: float, step: float) -> float:
    """Share of a ``step`` [s] in which an on/off valve is open, with the sign of ``opening`` (-1 ... 1), its duty.

    A pulse begins with each period; one that is too short is left out, a pause that is too short is filled.
    """
    duty = abs(opening)
    if duty * supply.period < supply.shortest:
        duty = 0.0
    elif (1.0 - duty) * supply.period < supply.shortest:
        duty = 1.0
    periods = step / supply.period
    end = phase + periods
    open_before = min(phase, duty)
    open_at_end = math.floor(end) * duty + min(end - math.floor(end), duty)
    return math.copysign((open_at_end - open_before) / periods, opening)


def opening(supply: Supply, pressure: float, target: float) -> float:
    """Opening of a proportional valve, -1 (exhaust) to 1 (fill), at ``pressure`` with ``target`` asked for [Pa].

    ``gain (target - pressure)``; without a gain fully towards the target.
    """
    if supply.gain == 0.0:
        return 1.0 if target >= pressure else -1.0
    return min(max(supply.gain * (target - pressure), -1.0), 1.0)


def flow(supply: Supply, source: float, pressure: float, opened: float) -> float:
    """Mass flow [kg/s] through a valve that is ``opened`` -1 ... 1, into the muscle; from ``source`` or to the room."""
    inside = pressure + ATMOSPHERE
    if opened >= 0.0:
        way = Restriction(supply.fill * opened, supply.fill_ratio)
        return valve.flow(way, source + ATMOSPHERE, inside, supply.temperature)
    way = Restriction(-supply.exhaust * opened, supply.exhaust_ratio)
    return -valve.flow(way, inside, ATMOSPHERE, supply.temperature)


def leakage(supply: Supply, pressure: float) -> float:
    """Mass flow [kg/s] out of the leak."""
    if supply.leak == 0.0:
        return 0.0
    return valve.flow(Restriction(supply.leak, LEAK_RATIO), pressure + ATMOSPHERE, ATMOSPHERE, supply.temperature)


def _excess(
    supply: Supply, start: float, source: float, target: float, fixed: float, held: bool, per_mass: float, after: float
) -> float:
    """By how much ``after`` [Pa] is above what the flow there leads to; rises with ``after``."""
    opened = fixed if held else opening(supply, after, target)
    return after - start - per_mass * (flow(supply, source, after, opened) - leakage(supply, after))


def _settled(
    supply: Supply, start: float, source: float, target: float, fixed: float, held: bool, per_mass: float
) -> float:
    """Pressure [Pa] at the end of a flow that began at ``start``: Ridders' method, bracketed by room and source."""
    low, high = min(0.0, start), max(start, source)
    f_low = _excess(supply, start, source, target, fixed, held, per_mass, low)
    f_high = _excess(supply, start, source, target, fixed, held, per_mass, high)
    if not f_low < 0.0:
        return low if f_low == f_low else f_low
    if not f_high > 0.0:
        return high if f_high == f_high else f_high
    for _ in range(MOST_ITERATIONS):
        middle = 0.5 * (low + high)
        if high - low <= TOLERANCE * (middle + ATMOSPHERE):
            break
        f_middle = _excess(supply, start, source, target, fixed, held, per_mass, middle)
        if f_middle == 0.0:
            return middle
        x = middle - (middle - low) * f_middle / math.sqrt(f_middle * f_middle - f_low * f_high)
        f_x = _excess(supply, start, source, target, fixed, held, per_mass, x)
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
    supply: Supply, gas: Gas, pressure: float, target: float, volume: float, rest_volume: float, step: float
) -> Charge:
    """The flow of one ``step`` [s] into a muscle of ``volume`` [m3] (at rest ``rest_volume``), from ``pressure`` [Pa].

    ``target`` is the pressure that is asked for [Pa], or the opening if the supply takes openings.
    """
    whole, rest_whole = volume + supply.dead_volume, rest_volume + supply.dead_volume
    source = upstream(supply, gas.drawn)
    if supply.fill == 0.0:
        per_mass = AIR_CONSTANT * supply.temperature / whole
        held = pressure - gas.disturbance
        leaked = min(leakage(supply, pressure) * step, max(held, 0.0) / per_mass)
        after = min(regulate(supply, held - per_mass * leaked, target, step), max(held, source))
        kept = supply.recovery / (supply.recovery + step)
        # What the regulator lets in is known when the muscle has moved.
        return Charge(after, gas.disturbance, kept, supply.exponent, whole, 0.0, leaked, gas.phase, True)

    per_mass = supply.exponent * AIR_CONSTANT * supply.temperature / whole
    if supply.warming > 0.0 and supply.exponent != 1.0:
        mass = gas.surplus + air_mass(0.0, rest_whole, supply.temperature)
        warm = mass * AIR_CONSTANT * supply.temperature / whole - ATMOSPHERE
        pressure += (warm - pressure) * step / (supply.warming + step)
    fixed, held_open, phase = 0.0, True, gas.phase
    if supply.opens != 0.0:
        fixed = min(max(target, -1.0), 1.0)
    elif supply.gain == 0.0 or supply.period > 0.0:
        fixed = opening(supply, pressure, target)
    else:
        held_open = False
    if supply.period > 0.0:
        fixed = pulsed(supply, fixed, phase, step)
        phase += step / supply.period
        phase -= math.floor(phase)
    shut = held_open and fixed == 0.0
    after = pressure
    if not shut or supply.leak > 0.0:
        after = _settled(supply, pressure, source, target, fixed, held_open, per_mass * step)
    if supply.gain == 0.0 and supply.opens == 0.0:
        # A perfect pilot closes where it has arrived.
        after = min(after, max(target, pressure)) if fixed >= 0.0 else max(after, target)
        most = supply.rate * step
        after = min(max(after, pressure - most), pressure + most)
    # By difference, so that pressure and mass agree to the last bits.
    gained = (after - pressure) / per_mass
    leaked = -gained if shut else leakage(supply, after) * step
    through = gained + leaked
    draws = (fixed if held_open else opening(supply, after, target)) >= 0.0
    return Charge(after, 0.0, 1.0, supply.exponent, whole, through, leaked, phase, draws)


def still(pressure: float) -> Charge:
    """Air that stays at ``pressure`` [Pa] whatever the muscle does."""
    return Charge(pressure, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, True)


def regulated(supply: Supply, pressure: float, target: float, step: float) -> Charge:
    """The same of a supply that is :func:`plain`, which remembers nothing."""
    return still(regulate(supply, pressure, target, step))


def felt(charged: Charge, volume: float) -> float:
    """Pressure [Pa] in the muscle when it has moved to ``volume`` [m3], with the dead volume."""
    if charged.kept == 0.0:
        return charged.pressure
    before = charged.pressure + charged.disturbance + ATMOSPHERE
    squeezed = before * (math.pow(charged.volume / volume, charged.exponent) - 1.0)
    return charged.pressure + charged.kept * (charged.disturbance + squeezed)


def booked(supply: Supply, gas: Gas, charged: Charge, pressure: float, volume: float, rest_volume: float) -> Gas:
    """What is remembered when the muscle has moved to ``volume`` [m3], where its air has ``pressure`` [Pa].

    ``rest_volume`` [m3] is that of the muscle at its resting length; both without dead volume.
    """
    if supply.fill == 0.0:
        # A regulator gives whatever the gas law then asks for.
        surplus = rested(supply, pressure, volume, rest_volume).surplus
        through = surplus - gas.surplus + charged.leaked
        return Gas(surplus, gas.drawn + max(through, 0.0), charged.phase, pressure - charged.pressure)
    drawn = gas.drawn + charged.valve if charged.draws else gas.drawn
    return Gas(gas.surplus + charged.valve - charged.leaked, drawn, charged.phase, 0.0)
