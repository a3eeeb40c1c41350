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
    leaked: float = 0.0
    """Air lost through a leak since the start [kg]."""
    duty: float = 0.0
    """That an on/off valve was told when its period began, -1 ... 1."""


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
    dead_volume: float
    """[m3]"""
    valve: float
    """Air that came through the valve [kg]; negative: went."""
    leaked: float
    """[kg]"""
    phase: float
    """Of an on/off valve's period after the step [1]."""
    duty: float
    """That it was told when that period began."""
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
    return Gas(air_mass(pressure, volume + supply.dead_volume, supply.temperature) - vented, 0.0, 0.0, 0.0, 0.0, 0.0)


class Pulse(NamedTuple):
    """What an on/off valve does in a step."""

    share: float
    """Of the step in which it is open [1]; negative: towards the room."""
    duty: float
    """That it was told when its period began [1], with the same sign."""
    phase: float
    """Of its period, at the end of the step [1]."""


def pulsed(supply: Supply, opening: float, duty: float, phase: float, step: float) -> Pulse:
    """An on/off valve under ``opening`` (-1 ... 1) for a ``step`` [s] that begins at ``phase`` of its period.

    A pulse as wide as the opening begins with each period; until then the ``duty`` of the last one holds. One that is
    too short is left out, a pause that is too short is filled.
    """
    asked = abs(opening)
    if asked * supply.period < supply.shortest:
        asked = 0.0
    elif (1.0 - asked) * supply.period < supply.shortest:
        asked = 1.0
    fresh = math.copysign(asked, opening)
    if phase == 0.0:
        duty = fresh
    periods = step / supply.period
    end = phase + periods
    wide = abs(duty)
    on = math.copysign(max(min(end, wide, 1.0) - min(phase, wide), 0.0), duty)
    if end >= 1.0:
        whole = math.floor(end - 1.0)
        on += fresh * whole + math.copysign(min(end - 1.0 - whole, asked), fresh)
        duty = fresh
        end -= 1.0 + whole
    return Pulse(on / periods, duty, end)


def opening(supply: Supply, pressure: float, target: float) -> float:
    """Opening of a proportional valve, -1 (exhaust) to 1 (fill), at ``pressure`` with ``target`` asked for [Pa].

    ``gain (target - pressure)``; without a gain fully towards the target.
    """
    if supply.gain == 0.0:
        return 1.0 if target >= pressure else -1.0
    return min(max(supply.gain * (target - pressure), -1.0), 1.0)


def flow(supply: Supply, source: float, pressure: float, opened: float, warmth: float) -> float:
    """Mass flow [kg/s] through a valve that is ``opened`` -1 ... 1, into the muscle; from ``source`` or to the room.

    The air in the muscle has the temperature ``warmth`` [K]. A check valve keeps it from going back into the source
    (assumed).
    """
    inside = pressure + ATMOSPHERE
    if opened >= 0.0:
        way = Restriction(supply.fill * opened, supply.fill_ratio)
        return max(valve.flow(way, source + ATMOSPHERE, inside, supply.temperature), 0.0)
    way = Restriction(-supply.exhaust * opened, supply.exhaust_ratio)
    return -valve.flow(way, inside, ATMOSPHERE, warmth)


def leakage(supply: Supply, pressure: float, warmth: float) -> float:
    """Mass flow [kg/s] out of the leak of a muscle whose air has the temperature ``warmth`` [K]."""
    if supply.leak == 0.0:
        return 0.0
    return valve.flow(Restriction(supply.leak, LEAK_RATIO), pressure + ATMOSPHERE, ATMOSPHERE, warmth)


class _Flow(NamedTuple):
    """A step's flow, for the search of the pressure that it ends at."""

    start: float
    """Pressure before [Pa]."""
    source: float
    """Of the supply [Pa]."""
    target: float
    """That is asked for [Pa]."""
    opened: float
    """Of the valve, if it ``stays``."""
    stays: bool
    """Whether the valve stays as it is, or opens with what is missing."""
    warmth: float
    """Of the air in the muscle [K]."""
    raised: float
    """Pressure per mass that comes in [Pa/kg]."""
    lowered: float
    """Pressure per mass that goes out [Pa/kg]."""
    step: float
    """[s]"""


def _stands(supply: Supply, flowing: _Flow, after: float) -> float:
    """Opening of the valve at the pressure ``after`` [Pa]."""
    return flowing.opened if flowing.stays else opening(supply, after, flowing.target)


def _excess(supply: Supply, flowing: _Flow, after: float) -> float:
    """By how much ``after`` [Pa] is above what the flow there leads to; rises with ``after``."""
    through = flow(supply, flowing.source, after, _stands(supply, flowing, after), flowing.warmth)
    out = leakage(supply, after, flowing.warmth)
    came, went = max(through, 0.0) + max(-out, 0.0), max(-through, 0.0) + max(out, 0.0)
    return after - flowing.start - flowing.step * (flowing.raised * came - flowing.lowered * went)


def _settled(supply: Supply, flowing: _Flow) -> float:
    """Pressure [Pa] at the end of a flow: Ridders' method, bracketed by room and source."""
    low, high = min(0.0, flowing.start), max(flowing.start, flowing.source)
    f_low, f_high = _excess(supply, flowing, low), _excess(supply, flowing, high)
    if not f_low < 0.0:
        return low if f_low == f_low else f_low
    if not f_high > 0.0:
        return high if f_high == f_high else f_high
    for _ in range(MOST_ITERATIONS):
        middle = 0.5 * (low + high)
        if high - low <= TOLERANCE * (middle + ATMOSPHERE):
            break
        f_middle = _excess(supply, flowing, middle)
        if f_middle == 0.0:
            return middle
        x = middle - (middle - low) * f_middle / math.sqrt(f_middle * f_middle - f_low * f_high)
        f_x = _excess(supply, flowing, x)
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
    if supply.fill == 0.0:
        return _by_regulator(supply, gas, pressure, target, volume + supply.dead_volume, step)
    return _by_valve(supply, gas, pressure, target, volume, rest_volume, step)


def _by_regulator(supply: Supply, gas: Gas, pressure: float, target: float, whole: float, step: float) -> Charge:
    """:func:`charge` of a regulator that gives any flow; ``whole`` volume [m3]."""
    per_mass, source = AIR_CONSTANT * supply.temperature / whole, upstream(supply, gas.drawn)
    # A tank that has sunk below the muscle cannot fill it: the air is closed in, and can only be let out.
    shut = supply.tank > 0.0 and pressure >= source
    before = pressure if shut else pressure - gas.disturbance
    leaked = min(leakage(supply, before, supply.temperature) * step, max(before, 0.0) / per_mass)
    after = regulate(supply, before - per_mass * leaked, target, step)
    volume, exponent = supply.dead_volume, supply.exponent
    # What the regulator lets in is known when the muscle has moved.
    came = 0.0
    if shut:
        after = min(after, before - per_mass * leaked)
        return Charge(after, 0.0, 1.0, 1.0, whole, volume, came, leaked, gas.phase, gas.duty, True)
    kept = supply.recovery / (supply.recovery + step)
    after = min(after, source)
    return Charge(after, gas.disturbance, kept, exponent, whole, volume, came, leaked, gas.phase, gas.duty, True)


def _by_valve(
    supply: Supply, gas: Gas, pressure: float, target: float, volume: float, rest_volume: float, step: float
) -> Charge:
    """:func:`charge` through a valve: ``dp = n/V (R T_in dm_in - R T dm_out)`` with ``p V = m R T`` inside."""
    whole, source = volume + supply.dead_volume, upstream(supply, gas.drawn)
    mass = held(supply, gas, pressure, volume, rest_volume)
    if supply.warming > 0.0 and supply.exponent != 1.0:
        cool = mass * AIR_CONSTANT * supply.temperature / whole - ATMOSPHERE
        pressure += (cool - pressure) * step / (supply.warming + step)
    fixed, stays, phase, duty = 0.0, True, gas.phase, gas.duty
    if supply.opens != 0.0:
        fixed = min(max(target, -1.0), 1.0)
    elif supply.gain == 0.0 or supply.period > 0.0:
        fixed = opening(supply, pressure, target)
    else:
        stays = False
    if supply.period > 0.0:
        pulse = pulsed(supply, fixed, duty, phase, step)
        fixed, duty, phase = pulse.share, pulse.duty, pulse.phase
    inside = pressure + ATMOSPHERE
    flowing = _Flow(
        start=pressure,
        source=source,
        target=target,
        opened=fixed,
        stays=stays,
        warmth=inside * whole / (mass * AIR_CONSTANT),
        raised=supply.exponent * AIR_CONSTANT * supply.temperature / whole,
        lowered=supply.exponent * inside / mass,
        step=step,
    )
    shut = stays and fixed == 0.0
    after = pressure
    if not shut or supply.leak > 0.0:
        after = _settled(supply, flowing)
    if supply.gain == 0.0 and supply.opens == 0.0 and supply.period == 0.0:
        # A perfect pilot closes where it has arrived.
        after = min(after, max(target, pressure)) if fixed >= 0.0 else max(after, target)
        most = supply.rate * step
        after = min(max(after, pressure - most), pressure + most)
    lost = leakage(supply, after, flowing.warmth) * step
    # The valve's part by difference, so that pressure and mass agree to the last bits.
    rest = after - pressure + flowing.lowered * max(lost, 0.0) - flowing.raised * max(-lost, 0.0)
    through = rest / flowing.raised if rest > 0.0 else rest / flowing.lowered
    if shut:
        lost, through = lost - through, 0.0
    # Above the room's pressure, what comes in comes from the tank, wherever a pilot stands that makes up for a leak.
    draws = _stands(supply, flowing, after) >= 0.0 or after > 0.0
    return Charge(after, 0.0, 1.0, supply.exponent, whole, supply.dead_volume, through, lost, phase, duty, draws)


def still(pressure: float) -> Charge:
    """Air that stays at ``pressure`` [Pa] whatever the muscle does."""
    return Charge(pressure, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, True)


def regulated(supply: Supply, pressure: float, target: float, step: float) -> Charge:
    """The same of a supply that is :func:`plain`, which remembers nothing."""
    return still(regulate(supply, pressure, target, step))


def held(supply: Supply, gas: Gas, pressure: float, volume: float, rest_volume: float) -> float:
    """Air in muscle and dead volume [kg]; volumes [m3] as in :func:`rested`."""
    if plain(supply):
        return air_mass(pressure, volume + supply.dead_volume, supply.temperature)
    return gas.surplus + air_mass(0.0, rest_volume + supply.dead_volume, supply.temperature)


def felt(charged: Charge, volume: float) -> float:
    """Pressure [Pa] in the muscle when it has moved to ``volume`` [m3], without the dead volume."""
    if charged.kept == 0.0:
        return charged.pressure
    before = charged.pressure + charged.disturbance + ATMOSPHERE
    ratio = charged.volume / (volume + charged.dead_volume)
    squeezed = before * (math.pow(ratio, charged.exponent) - 1.0)
    return charged.pressure + charged.kept * (charged.disturbance + squeezed)


def booked(supply: Supply, gas: Gas, charged: Charge, pressure: float, volume: float, rest_volume: float) -> Gas:
    """What is remembered when the muscle has moved to ``volume`` [m3], where its air has ``pressure`` [Pa].

    ``rest_volume`` [m3] is that of the muscle at its resting length; both without dead volume.
    """
    if supply.fill == 0.0:
        # A regulator gives whatever the gas law then asks for; being squeezed takes no air.
        squeezed = pressure - charged.pressure
        surplus = rested(supply, charged.pressure + squeezed / charged.exponent, volume, rest_volume).surplus
        through = surplus - gas.surplus + charged.leaked
        drawn, lost = gas.drawn + max(through, 0.0), gas.leaked + charged.leaked
        # Air that is closed in has no regulator that would make up for anything.
        left = squeezed if charged.kept < 1.0 else 0.0
        return Gas(surplus, drawn, charged.phase, left, lost, charged.duty)
    drawn, lost = gas.drawn + (max(charged.valve, 0.0) if charged.draws else 0.0), gas.leaked + charged.leaked
    return Gas(gas.surplus + charged.valve - charged.leaked, drawn, charged.phase, 0.0, lost, charged.duty)
