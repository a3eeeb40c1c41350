"""Muscle, damper and tendon with every hidden effect, written again from the published formulas.

Nothing here comes from the simulator. SI throughout; tension is positive, ``v = dL/dt`` is negative while the muscle
shortens, pressure is gauge. ``memory`` holds what the effects remember; its places are named below.
"""

import math
from typing import NamedTuple

import numpy as np
from compiled import compiled

SIGN_SPEED = 1e-3  # m/s: width of the smooth sign
TENDON_SLIP = 0.3e-3  # m: reach of the tendon's slider
CLOSING = 1e-6  # m: over which a tendon with Maxwell memory takes up its load (its law jumps there)
FADE_PRESSURE = 2e5  # Pa: below it the friction offset fades to nothing
FILM_TIME = 1e-4  # s: a lubricating film does not follow the speed at once, or several speeds could balance
WARM_TIME = 20.0  # s: in which warm oil cools (assumed)
NUDGE = 1e-5  # of the stretch: half the difference that turns the thick wall's energy into a force
LAYERS = 8  # of the thick wall, for Simpson's rule

# Places in the memory: positions of sliders and branches [m] unless said otherwise.
SLIP = 0  # three braid sliders
RELAXED = 3  # bladder branch
TENDON_SLIDER = 4
TENDON_RELAXED = 5
DAHL = 6  # [1]
BOUC = 7  # hysteretic stretch
WORST = 8  # greatest energy density of the bladder [J/m3]
FILM = 9  # share of the break-away peak that the film has not taken off [1]
PISTON = 10  # slider behind the damper's piston
BRISTLE = 11
WARMTH = 12  # logarithm of what the warm oil has lost of its viscosity [1]
PLAY = 13  # sliders of the braid's many elements
PLAYS = 8
CREEP = PLAY + PLAYS  # relaxed branches, each slower than the one before
CREEPS = 5
PRESSURE = CREEP + CREEPS  # of the air, see air.py: gauge [Pa]
DISTURBANCE = PRESSURE + 1  # [Pa]
DRAWN = PRESSURE + 2  # [kg]
N_MEMORY = PRESSURE + 3


class Law(NamedTuple):
    """Everything the force balance needs; the second half is neutral for a device without hidden effects."""

    count: float
    rest: float
    braid: float
    turns: float
    bladder_gain: float  # wall volume / resting length: times dW/d(lambda) it is the bladder's tension
    hoop: float  # L0^2 / (2 pi N R0)^2
    outer: float  # radii of the bladder at rest
    inner: float
    c10: float
    c01: float
    friction_slope: float
    friction_offset: float
    damping_in: float  # N s^2/m^2, shortening
    damping_out: float  # lengthening
    slack: float
    stiffness_1: float
    stiffness_2: float
    engagement: float
    coulomb_slope: float
    slip_slope: float
    slip_stiffness: float
    bouc_slope: float
    bouc_stiffness: float
    viscous: float
    viscous_pressure: float
    threshold: float
    threshold_rise: float
    tip: float  # c = 4/3 tip length
    taper: float
    thread_strain: float  # per pressure, at resting length
    thick: float
    softening: float
    softening_energy: float  # J/m3
    relax_stiffness: float
    relax_time: float
    seal: float
    stribeck: float
    stribeck_rise: float
    stribeck_speed: float
    transition: float
    dead_stroke: float
    stiffening: float  # N/m2
    tendon_loss: float
    tendon_stiffness: float
    tendon_time: float
    tendon_slack: float
    # Other functional forms, which are in nobody's catalogue.
    dahl_slope: float
    dahl_reach: float
    play_slope: float
    play_reach: float
    power: float
    warm: float  # N s/m while the oil is cold
    warm_gain: float  # 1/J
    bulge: float
    creep: float  # N/m of each branch
    lugre: float
    lugre_rise: float
    lugre_speed: float
    lugre_reach: float
    toe: float


@compiled
def smooth_sign(v: float) -> float:
    """The sign of ``v``, smooth over 1 mm/s."""
    return v / math.sqrt(v * v + SIGN_SPEED * SIGN_SPEED)


@compiled
def felt_pressure(pressure: float, L: float, law: Law) -> float:
    """What is left of the pressure for the muscle once the bladder has met the braid."""
    threshold = law.threshold + law.threshold_rise * (1.0 - L / law.rest)
    return max(pressure - threshold, 0.0) if threshold != 0.0 else pressure


@compiled
def thin_bladder(L: float, law: Law) -> float:
    """Tension of one bladder whose wall all follows the braid: ``Vb dW/dL``."""
    stretch = L / law.rest
    a = stretch * stretch  # squares of the axial, hoop and radial stretches are a, u, 1/(a u)
    u = 1.0 + law.hoop * (1.0 - a)
    da, du = 2.0 * stretch, -2.0 * law.hoop * stretch
    d_volume = da * u + a * du
    d_i1 = da + du - d_volume / (a * u) ** 2
    d_i2 = -da / (a * a) - du / (u * u) + d_volume
    return law.bladder_gain * (law.c10 * d_i1 + law.c01 * d_i2)


@compiled
def rubber_energy(axial: float, hoop: float, law: Law) -> float:
    """Energy density [J/m3] of rubber at two squared stretches; the third follows, because it keeps its volume."""
    radial = 1.0 / (axial * hoop)
    first = axial + hoop + radial - 3.0
    return law.c10 * first + law.c01 * (1.0 / axial + 1.0 / hoop + 1.0 / radial - 3.0)


@compiled
def depth_of(L: float, law: Law) -> float:
    """Energy density [J/m3] of the thin bladder."""
    axial = (L / law.rest) ** 2
    return rubber_energy(axial, 1.0 + law.hoop * (1.0 - axial), law)


@compiled
def wall_energy(stretch: float, law: Law) -> float:
    """Energy per resting length [J/m] of a wall whose outside follows the braid, layer by layer (Simpson's rule).

    Between a layer and the outside there is as much rubber as before, so that the squared radius of the layer differs
    from the outside's by its old difference, divided by the stretch.
    """
    axial = stretch * stretch
    outside = law.outer * law.outer * (1.0 + law.hoop * (1.0 - axial))
    step, total = (law.outer - law.inner) / LAYERS, 0.0
    for i in range(LAYERS + 1):
        radius = law.inner + i * step
        hoop = (outside - (law.outer * law.outer - radius * radius) / stretch) / (radius * radius)
        weight = 1.0 if i in (0, LAYERS) else 4.0 if i % 2 == 1 else 2.0
        total += weight * 2.0 * math.pi * radius * rubber_energy(axial, max(hoop, 1e-3), law)
    return total * step / 3.0


@compiled
def muscle_static(felt: float, L: float, law: Law) -> float:
    """Gas, bladder and friction offset (eq. 3.3) of all actuators at rest."""
    stretch = L / law.rest
    gas = felt * (3.0 * L * L - 2.0 * law.tip * L - law.braid * law.braid) / (4.0 * math.pi * law.turns * law.turns)
    gas *= 1.0 - law.taper * (1.0 - stretch)
    if law.bulge != 0.0:
        gas *= 1.0 - law.bulge * (1.0 - stretch) ** 2
    if law.thread_strain != 0.0:
        # All threads together carry P dV/dB, in proportion to P B L; they are longer by that times their own length.
        gain = 1.0 / (1.0 - law.thread_strain * felt * stretch)
        gas -= felt * law.braid * law.braid * (gain * gain - 1.0) / (4.0 * math.pi * law.turns * law.turns)
    bladder = thin_bladder(L, law)
    if law.thick != 0.0:
        slope = (wall_energy(stretch + NUDGE, law) - wall_energy(stretch - NUDGE, law)) / (2.0 * NUDGE)
        bladder += law.thick * (slope - bladder)
    friction = (law.friction_slope * felt + law.friction_offset) * min(1.0, felt / FADE_PRESSURE)
    return law.count * (gas + bladder - friction)


@compiled
def orifice(v: float, law: Law) -> float:
    """Tension of the damper's orifices."""
    return (law.damping_out if v > 0.0 else law.damping_in) * v * math.sqrt(v * v + law.transition * law.transition)


@compiled
def moving(felt: float, v: float, law: Law) -> float:
    """Tension that depends on the velocity alone: damper, seal, and the muscle's own losses."""
    total = orifice(v, law)
    sign = smooth_sign(v)
    total += law.seal * sign
    per_muscle = law.coulomb_slope * felt * sign + (law.viscous + law.viscous_pressure * felt) * v
    if law.power != 0.0:
        per_muscle += law.power * v * math.sqrt(abs(v))
    return total + law.count * per_muscle


@compiled
def haunted(v: float, x: float, old: np.ndarray, new: np.ndarray, law: Law) -> float:
    """What memories take from or add to the tension of :func:`moving`.

    The film is that of before (``old``): friction that falls with the speed of the same moment has no one balance.
    """
    total = 0.0
    if law.dead_stroke != 0.0:
        engaged = (x - new[PISTON]) / (0.5 * law.dead_stroke)
        total -= orifice(v, law) * 0.5 * (1.0 - (engaged if v > 0.0 else -engaged))
    if law.stribeck != 0.0:
        total += law.stribeck * smooth_sign(v) * (1.0 + law.stribeck_rise * old[FILM])
    if law.lugre != 0.0:
        total += law.lugre * new[BRISTLE] / law.lugre_reach
    if law.warm != 0.0:
        total += law.warm * v * math.exp(-new[WARMTH])
    return total


@compiled
def tendon_elastic(stretch: float, law: Law) -> float:
    """Two offset springs (Frisén 1969); never pushes."""
    if stretch <= 0.0:
        return 0.0
    force = law.stiffness_1 * stretch + law.stiffness_2 * max(0.0, stretch - law.engagement)
    if law.stiffening != 0.0:
        force += law.stiffening * stretch * stretch
    return force * math.tanh(stretch / law.toe) if law.toe != 0.0 else force


@compiled
def tendon(stretch: float, memory: np.ndarray, law: Law) -> float:
    """Tendon force with its losses; ``stretch`` is already less the dead length."""
    if stretch <= 0.0:
        return 0.0
    force = tendon_elastic(stretch, law)
    force *= 1.0 + law.tendon_loss * (stretch - memory[TENDON_SLIDER]) / TENDON_SLIP
    if law.tendon_stiffness != 0.0:
        force += law.tendon_stiffness * (stretch - memory[TENDON_RELAXED]) * min(1.0, stretch / CLOSING)
    return max(0.0, force)


@compiled
def play_of(i: int, law: Law) -> float:
    """Stretch at which the ``i``-th of the braid's many elements slips: even steps about their mean."""
    return law.play_reach * 2.0 * (i + 1.0) / (PLAYS + 1.0)


@compiled
def creep_time(i: int) -> float:
    """Time constants of the creep [s]: five to a factor, over nearly three decades."""
    return 0.02 * 5.0**i


@compiled
def remember(
    old: np.ndarray,
    base: np.ndarray,
    new: np.ndarray,
    gh: float,
    v: float,
    x: float,
    stretch: float,
    felt: float,
    law: Law,
) -> None:
    """Memories at the end of a stage: sliders dragged from ``old``, the others implicit over ``gh`` from ``base``."""
    if law.slip_slope != 0.0:
        stiffness = law.count * law.slip_stiffness / 3.0
        for i in range(3):
            reach = law.count * law.slip_slope * felt * (1.0 + i) / 6.0 / stiffness
            new[SLIP + i] = min(max(old[SLIP + i], x - reach), x + reach)
    share = gh / law.relax_time
    new[RELAXED] = (base[RELAXED] + share * x) / (1.0 + share)
    new[TENDON_SLIDER] = min(max(old[TENDON_SLIDER], stretch - TENDON_SLIP), stretch + TENDON_SLIP)
    share = gh / law.tendon_time
    # A slack tendon relaxes to slack.
    new[TENDON_RELAXED] = (base[TENDON_RELAXED] + share * max(0.0, stretch)) / (1.0 + share)
    if law.dahl_slope != 0.0:
        new[DAHL] = (base[DAHL] + gh * v / law.dahl_reach) / (1.0 + gh * abs(v) / law.dahl_reach)
    if law.bouc_slope != 0.0:
        reach = law.bouc_slope * felt / law.bouc_stiffness
        new[BOUC] = (base[BOUC] + gh * v) / (1.0 + gh * abs(v) / reach) if reach > 0.0 else 0.0
    if law.softening != 0.0:
        new[WORST] = max(old[WORST], depth_of(x + law.rest, law))
    if law.stribeck != 0.0:
        share, ratio = gh / FILM_TIME, v / law.stribeck_speed
        new[FILM] = (base[FILM] + share * math.exp(-ratio * ratio)) / (1.0 + share)
    if law.dead_stroke != 0.0:
        half = 0.5 * law.dead_stroke
        new[PISTON] = min(max(old[PISTON], x - half), x + half)
    if law.lugre != 0.0:
        ratio = v / law.lugre_speed
        reach = law.lugre_reach * (1.0 + law.lugre_rise * math.exp(-ratio * ratio))
        new[BRISTLE] = (base[BRISTLE] + gh * v) / (1.0 + gh * abs(v) / reach)
    if law.warm != 0.0:
        new[WARMTH] = (base[WARMTH] + gh * law.warm_gain * orifice(v, law) * v) / (1.0 + gh / WARM_TIME)
    if law.play_slope != 0.0:
        for i in range(PLAYS):
            reach = play_of(i, law)
            new[PLAY + i] = min(max(old[PLAY + i], x - reach), x + reach)
    if law.creep != 0.0:
        for i in range(CREEPS):
            share = gh / creep_time(i)
            new[CREEP + i] = (base[CREEP + i] + share * x) / (1.0 + share)


@compiled
def remembered(memory: np.ndarray, x: float, felt: float, law: Law) -> float:
    """Muscle tension held in the memories."""
    total = law.relax_stiffness * (x - memory[RELAXED]) + law.dahl_slope * felt * memory[DAHL]
    if law.slip_slope != 0.0:
        for i in range(3):
            total += law.slip_stiffness / 3.0 * (x - memory[SLIP + i])
    if law.bouc_slope != 0.0:
        total += law.bouc_stiffness * memory[BOUC]
    if law.softening != 0.0:
        over = max(0.0, memory[WORST] - depth_of(x + law.rest, law))
        total -= law.softening * math.tanh(over / law.softening_energy) * thin_bladder(x + law.rest, law)
    if law.play_slope != 0.0:
        for i in range(PLAYS):
            total += law.play_slope * felt / PLAYS * (x - memory[PLAY + i]) / play_of(i, law)
    if law.creep != 0.0:
        for i in range(CREEPS):
            total += law.creep * (x - memory[CREEP + i])
    return law.count * total


@compiled
def begin(memory: np.ndarray, x: float, stretch: float, law: Law) -> None:
    """Memories of a device that has rested long: nothing is stretched, no film, the oil is cold."""
    for i in range(N_MEMORY):
        memory[i] = 0.0
    memory[SLIP] = memory[SLIP + 1] = memory[SLIP + 2] = memory[RELAXED] = memory[PISTON] = x
    for i in range(PLAY, CREEP + CREEPS):
        memory[i] = x
    memory[TENDON_SLIDER], memory[TENDON_RELAXED] = stretch, max(0.0, stretch)
    memory[WORST], memory[FILM] = depth_of(x + law.rest, law), 1.0


@compiled
def distance(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference of two memories as a length.

    A tenth of a slider's; of dimensionless numbers, pascals and kilograms, what moves the tendon about as far.
    """
    worst = 0.0
    for i in range(DAHL):
        worst = max(worst, abs(a[i] - b[i]))
    worst = max(0.1 * worst, 1e-4 * abs(a[DAHL] - b[DAHL]))
    for i in range(PLAY, CREEP + CREEPS):
        worst = max(worst, 0.1 * abs(a[i] - b[i]))
    worst = max(worst, 0.1 * abs(a[BOUC] - b[BOUC]), 0.1 * abs(a[BRISTLE] - b[BRISTLE]))
    worst = max(worst, 1e-5 * abs(a[FILM] - b[FILM]), 1e-4 * abs(a[WARMTH] - b[WARMTH]))
    worst = max(worst, 1e-9 * abs(a[PRESSURE] - b[PRESSURE]), 1e-9 * abs(a[DISTURBANCE] - b[DISTURBANCE]))
    return max(worst, 0.3 * abs(a[DRAWN] - b[DRAWN]))
