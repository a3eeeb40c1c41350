"""Muscle: braid with conical ends by virtual work, and bladder by eq. (3.3)."""

import math

from benchmarks.hidden_effects.adversary.compiled import compile_cached
from benchmarks.hidden_effects.adversary.rig import BAR, Rig

THREAD_EXPONENT = 0.8
"""Exponent of the threads' strain over pressure: textile stiffens (assumed)."""
THRESHOLD_SOFTNESS = 0.08e5
"""Pressure over which the bladder comes to bear on the braid [Pa] (assumed)."""
FADE_PRESSURE = 2e5
"""Pressure below which the friction offset fades, the least of the tests that it was fitted to [Pa]."""
MIN_RADIUS = 1e-4


@compile_cached
def radius(length: float, pressure: float, rig: Rig) -> float:
    """Return the radius of the braid's cylinder [m]: (B² - L²) = (2πN R)², with stretched threads."""
    braid = rig.braid_length
    if rig.thread_strain > 0.0 and pressure > 0.0:
        braid *= 1.0 + rig.thread_strain * (pressure / (5.0 * BAR)) ** THREAD_EXPONENT
    square = (braid * braid - length * length) / (4.0 * math.pi**2 * rig.turns * rig.turns)
    return math.sqrt(max(square, MIN_RADIUS * MIN_RADIUS))


@compile_cached
def cap_radius(rig: Rig) -> float:
    """Return the radius of the clamped ends [m], that of the braid at rest."""
    square = rig.braid_length * rig.braid_length - rig.resting_length * rig.resting_length
    return math.sqrt(square) / (2.0 * math.pi * rig.turns)


@compile_cached
def braid_volume(length: float, pressure: float, rig: Rig) -> float:
    """Return the volume of one braid [m³]: a cylinder between two frustums that end on the caps."""
    R, cap = radius(length, pressure, rig), cap_radius(rig)
    cone = rig.cone_slope * max(R - cap, 0.0)
    return math.pi * (R * R * (length - 2.0 * cone) + 2.0 / 3.0 * cone * (R * R + R * cap + cap * cap))


@compile_cached
def braid_area(length: float, pressure: float, rig: Rig) -> float:
    """Return dV/dL of one braid [m²] at constant threads; the tension of the gas is -P dV/dL (virtual work)."""
    R, cap = radius(length, pressure, rig), cap_radius(rig)
    slope = -length / (4.0 * math.pi**2 * rig.turns * rig.turns * R)
    growth = rig.cone_slope if cap < R else 0.0
    cone = growth * (R - cap)
    by_length = R * R
    by_radius = 2.0 * R * (length - 2.0 * cone) - 2.0 * growth * R * R
    by_radius += 2.0 / 3.0 * (growth * (R * R + R * cap + cap * cap) + cone * (2.0 * R + cap))
    return math.pi * (by_length + by_radius * slope)


@compile_cached
def rubber_volume(rig: Rig) -> float:
    """Return the volume of the rubber of one bladder [m³], which is incompressible."""
    inner = rig.bladder_radius - rig.bladder_thickness
    return math.pi * rig.resting_length * (rig.bladder_radius * rig.bladder_radius - inner * inner)


@compile_cached
def air_volume(length: float, pressure: float, rig: Rig) -> float:
    """Return the volume of the air in all muscles and fittings [m³]."""
    return rig.count * (braid_volume(length, pressure, rig) - rubber_volume(rig)) + rig.dead_volume


@compile_cached
def rubber_tension(length: float, rig: Rig) -> float:
    """Return the elastic tension of all bladders [N]: Vb dW/dL of eq. (3.3), below zero when contracted."""
    one = length / rig.resting_length
    shape = rig.resting_length / (2.0 * math.pi * rig.turns * rig.bladder_radius)
    shape *= shape
    s = max(1.0 + shape * (1.0 - one * one), 1e-3)  # square of the hoop stretch
    ds = -2.0 * shape * one
    square = one * one
    first = 2.0 * one + ds - 2.0 / (square * one * s) - ds / (square * s * s)
    second = -2.0 / (square * one) - ds / (s * s) + 2.0 * one * s + square * ds
    return rig.count * rubber_volume(rig) * (rig.c10 * first + rig.c01 * second) / rig.resting_length


@compile_cached
def gas_tension(pressure: float, length: float, rig: Rig) -> float:
    """Return the tension of the gas in all muscles less the friction offset m P + b of Table 3.1 [N]."""
    if pressure <= 0.0:
        return 0.0
    acting = pressure
    if rig.threshold > 0.0:
        bound = rig.threshold * (1.0 + 2.0 * (1.0 - length / rig.resting_length))
        acting = THRESHOLD_SOFTNESS * math.log1p(math.exp(min((pressure - bound) / THRESHOLD_SOFTNESS, 500.0)))
    fade = min(1.0, pressure / FADE_PRESSURE)
    offset = fade * (rig.friction_slope * pressure + rig.friction_offset)
    return rig.count * (-acting * braid_area(length, pressure, rig) - offset)


@compile_cached
def braid_friction_level(pressure: float, length: float, rig: Rig) -> float:
    """Return the friction of all braids [N]: it grows with pressure and with the contact of a wider braid."""
    contraction = max(1.0 - length / rig.resting_length, 0.0)
    return rig.count * rig.braid_friction * max(pressure, 0.0) * (0.7 + 3.0 * contraction)


@compile_cached
def rubber_damping_tension(velocity: float, rig: Rig) -> float:
    """Return the rate-dependent tension of the rubber [N]: linear at rest, a power of 0.6 of the speed above 10 mm/s.

    Elastomers stiffen over a wide spectrum of rates, so their tension grows with less than the speed.
    """
    knee, exponent = 0.01, 0.6
    shape = velocity / knee * (1.0 + (velocity / knee) ** 2) ** (0.5 * (exponent - 1.0))
    reference = 0.1 / knee * (1.0 + (0.1 / knee) ** 2) ** (0.5 * (exponent - 1.0))
    return rig.rubber_damping * shape / reference
