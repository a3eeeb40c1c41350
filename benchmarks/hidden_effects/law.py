"""Muscle, damper and tendon with all hidden effects, implemented independently from the published formulas.

This module uses no code of the simulator. SI units; tension is positive, ``v = dL/dt`` is negative while the muscle
shortens, pressure is gauge. ``state`` holds the internal states of the effects at the indices named below.
"""

import math
from typing import NamedTuple

import numpy as np
from benchmarks.hidden_effects.compiled import cached_njit
from benchmarks.hidden_effects.damper import orifice_tension, solve_chamber
from benchmarks.hidden_effects.rubber import bladder_energy_density, thin_bladder_tension, wall_energy

SIGN_SPEED = 0.05e-3  # m/s: width of the smooth sign
TENDON_SLIDER_REACH = 0.05e-3  # m: reach of the tendon's slider
TENDON_CLOSING_STRETCH = 1e-6  # m: over which a tendon takes up the load of its losses (their law jumps there)
FADE_PRESSURE = 2e5  # Pa: below it the friction offset fades to nothing
REFERENCE_DIAMETER = 10e-3  # m: of the bladder whose threshold pressure and passive tension the parameters state
PASSIVE_PRESSURE = 0.1e5  # Pa: over which the passive tension of a muscle at rest appears
TAPER_PRESSURE = 1e5  # Pa: over which the contraction of the middle falls to that at high pressure
FILM_TIME = 5e-3  # s: in which a lubricating film follows the speed (assumed)
COOLING_TIME = 20.0  # s: in which warm oil cools (assumed)
STRETCH_DIFFERENCE = 1e-5  # of the stretch: half the difference that turns the thick wall's energy into a force

# Places in the memory: positions of sliders and branches [m] unless said otherwise.
SLIP_INDEX = 0  # three braid sliders
RELAXED_INDEX = 3  # bladder branch
TENDON_SLIDER_INDEX = 4
TENDON_RELAXED_INDEX = 5
CONTACT_INDEX = 6  # [1]
HYSTERETIC_INDEX = 7  # hysteretic stretch
MAX_ENERGY_INDEX = 8  # greatest energy density of the bladder [J/m3]
FILM_INDEX = 9  # share of the break-away peak that the film has not taken off [1]
CHAMBER_INDEX = 10  # travel of the damper's piston that its oil and air take up; positive: lengthening side
BRISTLE_INDEX = 11
WARMTH_INDEX = 12  # logarithm of what the warm oil has lost of its viscosity [1]
PLAY_INDEX = 13  # sliders of the braid's many elements
N_PLAY_SLIDERS = 8
CREEP_INDEX = PLAY_INDEX + N_PLAY_SLIDERS  # relaxed branches, each slower than the one before
N_CREEP_BRANCHES = 5
PRESSURE_INDEX = CREEP_INDEX + N_CREEP_BRANCHES  # of the air, see air.py: gauge [Pa]
DISTURBANCE_INDEX = PRESSURE_INDEX + 1  # [Pa]
DRAWN_MASS_INDEX = PRESSURE_INDEX + 2  # [kg]
CHAMBER_FORCE_INDEX = PRESSURE_INDEX + 3  # tension of the damper's chambers [N]
SEAL_INDEX = PRESSURE_INDEX + 4  # shear of the pressed seal
TENDON_LAYER_INDEX = PRESSURE_INDEX + 5  # elastic elongation of the tendon's layers, which slide beyond their limit
N_TENDON_LAYERS = 3
TENDON_TAUT_INDEX = TENDON_LAYER_INDEX + N_TENDON_LAYERS  # stretch beyond slack
N_INTERNAL_STATES = TENDON_TAUT_INDEX + 1


class Law(NamedTuple):
    """Parameters of the force balance; the second half is neutral for a device without hidden effects."""

    n_muscles: float
    resting_length: float
    braid_length: float
    turns: float
    bladder_gain: float  # wall volume / resting length: times dW/d(lambda) it is the bladder's tension
    hoop_factor: float  # L0^2 / (2 pi N R0)^2
    outer_radius: float  # radii of the bladder at rest
    inner_radius: float
    c10: float
    c01: float
    friction_slope: float
    friction_offset: float
    damping_in: float  # N s^2/m^2, shortening
    damping_out: float  # lengthening
    bore_area: float
    slack: float
    stiffness_1: float
    stiffness_2: float
    engagement: float
    coulomb_slope: float
    slip_slope: float
    slip_stiffness: float
    hysteretic_slope: float
    hysteretic_stiffness: float
    hysteretic_gamma: float  # gamma / beta of Bouc and Wen; 0 is Dahl
    viscous: float
    viscous_pressure: float
    sublinear: float  # N s/m at 0.1 m/s
    sublinear_exponent: float
    threshold: float
    threshold_rise: float
    cone_slope: float  # length of a conical end over the growth of the radius
    taper: float
    end_diameters: float  # of both ends together, which do not pull
    middle_contraction: float  # over the contraction of the whole, at high pressure
    middle_excess: float  # of that ratio without pressure
    passive_offset: float
    passive_rise: float
    passive_scale: float  # of the contraction; 0: the rise follows a power of it
    thread_strain: float  # per pressure, at resting length
    thick: float
    softening: float
    softening_energy: float  # J/m3
    relax_stiffness: float
    relax_time: float
    seal: float
    pressed_seal: float
    seal_growth: float  # per pressure
    seal_stiffness: float
    stribeck: float
    stribeck_rise: float
    stribeck_speed: float
    transition: float
    transition_rise: float  # m2/s2: of the square of the transition speed by another viscosity
    damper_air: float  # m3 in each chamber, at atmospheric pressure
    rod_area: float  # on the side that lengthening compresses
    charge: float  # Pa, absolute, of the side that shortening compresses
    stiffening: float  # N/m2
    tendon_loss: float
    tendon_stiffness: float
    tendon_time: float
    tendon_damping: float
    engagement_width: float
    tendon_friction: float
    tendon_presliding: float
    tendon_slack: float
    # Other functional forms, which are in nobody's catalogue.
    contact_slope: float
    contact_growth: float  # per contraction
    contact_reach: float
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


@cached_njit
def smooth_sign(v: float) -> float:
    """Return the sign of ``v``, smoothed over 0.05 mm/s."""
    return v / math.sqrt(v * v + SIGN_SPEED * SIGN_SPEED)


@cached_njit
def effective_pressure(pressure: float, L: float, law: Law) -> float:
    """Return the pressure between bladder and braid: that of the air, less what the bladder needs to meet the braid.

    A bladder that is sucked inwards does not touch the braid.
    """
    threshold = law.threshold + law.threshold_rise * (1.0 - L / law.resting_length)
    return max(pressure - threshold * REFERENCE_DIAMETER / (2.0 * law.outer_radius), 0.0)


@cached_njit
def volume_outside_cones(L: float, law: Law) -> float:
    """Return the volume [m3] that the straight tube has and the two truncated cones at its ends have not."""
    coil = 2.0 * math.pi * law.turns
    wide = math.sqrt(law.braid_length * law.braid_length - L * L) / coil
    narrow = math.sqrt(law.braid_length * law.braid_length - law.resting_length * law.resting_length) / coil
    height = law.cone_slope * (wide - narrow)
    tube = math.pi * wide * wide * height
    truncated_cone = math.pi * height * (wide * wide + wide * narrow + narrow * narrow) / 3.0
    return 2.0 * (tube - truncated_cone)


@cached_njit
def passive_tension(pressure: float, contraction: float, law: Law) -> float:
    """Return the tension that one actuator of the reference diameter loses to rubber and braid."""
    total = -law.passive_offset * math.expm1(-pressure / PASSIVE_PRESSURE)
    if law.passive_scale > 0.0:
        return total - law.passive_rise * math.expm1(-contraction / law.passive_scale)
    return total + law.passive_rise * max(contraction, 0.0) ** (2.0 / 3.0)


@cached_njit
def static_muscle_tension(pressure: float, L: float, law: Law) -> float:
    """Return gas, bladder and friction offset (eq. 3.3) of all actuators at rest."""
    stretch = L / law.resting_length
    ratio = law.middle_contraction + law.middle_excess * math.exp(-pressure / TAPER_PRESSURE)
    middle = law.resting_length * max(0.0, 1.0 - ratio * (1.0 - stretch))
    gas = (
        pressure
        * (3.0 * middle * middle - law.braid_length * law.braid_length)
        / (4.0 * math.pi * law.turns * law.turns)
    )
    gas *= 1.0 - law.taper * (1.0 - stretch)
    gas *= 1.0 - min(1.0, 2.0 * law.end_diameters * law.outer_radius / law.resting_length)
    if law.cone_slope != 0.0:
        step = STRETCH_DIFFERENCE * law.resting_length
        gas += pressure * (volume_outside_cones(L + step, law) - volume_outside_cones(L - step, law)) / (2.0 * step)
    if law.bulge != 0.0:
        gas *= 1.0 - law.bulge * (1.0 - stretch) ** 2
    if law.thread_strain != 0.0:
        # All threads together carry P dV/dB, proportional to P B L, and stretch in proportion to load and length.
        gain = 1.0 / (1.0 - law.thread_strain * pressure * stretch)
        gas -= (
            pressure
            * law.braid_length
            * law.braid_length
            * (gain * gain - 1.0)
            / (4.0 * math.pi * law.turns * law.turns)
        )
    bladder = thin_bladder_tension(L, law)
    if law.thick != 0.0:
        slope = (wall_energy(stretch + STRETCH_DIFFERENCE, law) - wall_energy(stretch - STRETCH_DIFFERENCE, law)) / (
            2.0 * STRETCH_DIFFERENCE
        )
        bladder += law.thick * (slope - bladder)
    friction = (law.friction_slope * pressure + law.friction_offset) * min(1.0, pressure / FADE_PRESSURE)
    tension = law.n_muscles * (gas + bladder - friction)
    thickness = 2.0 * law.outer_radius / REFERENCE_DIAMETER
    passive = law.n_muscles * thickness * passive_tension(pressure, 1.0 - stretch, law)
    return tension - min(passive, max(tension, 0.0))  # it slackens a muscle, but does not push


@cached_njit
def rate_dependent_tension(pressure: float, v: float, law: Law) -> float:
    """Return the tension that depends on the velocity alone: damper, seal, and losses of the muscle."""
    total = orifice_tension(v, law)
    sign = smooth_sign(v)
    total += law.seal * sign
    per_muscle = law.coulomb_slope * pressure * sign + (law.viscous + law.viscous_pressure * pressure) * v
    if law.power != 0.0:
        per_muscle += law.power * v * math.sqrt(abs(v))
    if law.sublinear != 0.0:  # linear below 5 mm/s; the coefficient is that at 0.1 m/s
        squares = (v * v + 2.5e-5) / (1e-2 + 2.5e-5)
        per_muscle += law.sublinear * v * math.exp(0.5 * (law.sublinear_exponent - 1.0) * math.log(squares))
    return total + law.n_muscles * per_muscle


@cached_njit
def stateful_damping_tension(v: float, x: float, old: np.ndarray, new: np.ndarray, law: Law) -> float:
    """Return the change of :func:`rate_dependent_tension` by internal states.

    The film state is that of the previous step (``old``): friction that decreases with the current speed has no unique
    balance.
    """
    total = 0.0
    if law.damper_air != 0.0 or law.charge != 0.0:
        total += new[CHAMBER_FORCE_INDEX] - orifice_tension(v, law)
    if law.stribeck != 0.0:
        total += law.stribeck * smooth_sign(v) * (1.0 + law.stribeck_rise * old[FILM_INDEX])
    if law.lugre != 0.0:
        total += law.lugre * new[BRISTLE_INDEX] / law.lugre_reach
    if law.pressed_seal != 0.0:
        total += law.seal_stiffness * new[SEAL_INDEX]
    if law.warm != 0.0:
        total += law.warm * v * math.exp(-new[WARMTH_INDEX])
    return total


@cached_njit
def elastic_tendon_tension(stretch: float, law: Law) -> float:
    """Return the tension of two offset springs (Frisén 1969), which never push."""
    if stretch <= 0.0:
        return 0.0
    force = law.stiffness_1 * stretch
    if law.engagement_width != 0.0:  # softplus of the stretch beyond engagement, from 0 on
        rest = math.exp(-law.engagement / law.engagement_width)
        loaded = rest * math.exp(stretch / law.engagement_width)
        force += law.stiffness_2 * law.engagement_width * math.log((1.0 + loaded) / (1.0 + rest))
    else:
        force += law.stiffness_2 * max(0.0, stretch - law.engagement)
    if law.stiffening != 0.0:
        force += law.stiffening * stretch * stretch
    return force * math.tanh(stretch / law.toe) if law.toe != 0.0 else force


@cached_njit
def tendon_tension(stretch: float, rate: float, state: np.ndarray, law: Law) -> float:
    """Return the tendon tension with its losses at a ``rate`` of stretching; ``stretch`` excludes the dead length."""
    if stretch <= 0.0:
        return 0.0
    force = elastic_tendon_tension(stretch, law)
    # Of the loading work, the fraction ``tendon_loss`` does not return: the branches are as 1 to 1 - tendon_loss.
    direction = (stretch - state[TENDON_SLIDER_INDEX]) / TENDON_SLIDER_REACH
    force *= (2.0 - law.tendon_loss + law.tendon_loss * direction) / (2.0 - law.tendon_loss)
    if law.tendon_stiffness != 0.0:
        force += (
            law.tendon_stiffness * (stretch - state[TENDON_RELAXED_INDEX]) * min(1.0, stretch / TENDON_CLOSING_STRETCH)
        )
    if law.tendon_damping != 0.0:
        force += law.tendon_damping * rate * min(1.0, stretch / TENDON_CLOSING_STRETCH)
    if law.tendon_friction != 0.0:
        elongation = 0.0
        for i in range(N_TENDON_LAYERS):
            elongation += state[TENDON_LAYER_INDEX + i] / tendon_layer_limit(N_TENDON_LAYERS - 1, law)
        # All slide when their elongations have the mean limit, (n + 1) / 2n of the largest one.
        force += law.tendon_friction * 2.0 / (N_TENDON_LAYERS + 1.0) * elongation
    return max(0.0, force)


@cached_njit
def tendon_layer_limit(i: int, law: Law) -> float:
    """Return the elongation at which the ``i``-th layer of the tendon slides; the last one slides after the others."""
    return law.tendon_presliding * (i + 1.0) / N_TENDON_LAYERS


@cached_njit
def play_slider_reach(i: int, law: Law) -> float:
    """Return the stretch at which the ``i``-th element of the braid slips; the elements are evenly spaced about
    their mean.
    """
    return law.play_reach * 2.0 * (i + 1.0) / (N_PLAY_SLIDERS + 1.0)


@cached_njit
def creep_time(i: int) -> float:
    """Return the time constant of creep branch ``i`` [s]: a factor of five each, over nearly three decades."""
    return 0.02 * 5.0**i


@cached_njit
def update_internal_state(
    old: np.ndarray,
    base: np.ndarray,
    new: np.ndarray,
    gh: float,
    v: float,
    x: float,
    stretch: float,
    pressure: float,
    law: Law,
) -> None:
    """Compute the states at the end of a stage: sliders move from ``old``, other states are implicit over ``gh``
    from ``base``.
    """
    if law.slip_slope != 0.0:
        stiffness = law.n_muscles * law.slip_stiffness / 3.0
        for i in range(3):
            reach = law.n_muscles * law.slip_slope * pressure * (1.0 + i) / 6.0 / stiffness
            new[SLIP_INDEX + i] = min(max(old[SLIP_INDEX + i], x - reach), x + reach)
    share = gh / law.relax_time
    new[RELAXED_INDEX] = (base[RELAXED_INDEX] + share * x) / (1.0 + share)
    new[TENDON_SLIDER_INDEX] = min(
        max(old[TENDON_SLIDER_INDEX], stretch - TENDON_SLIDER_REACH), stretch + TENDON_SLIDER_REACH
    )
    share = gh / law.tendon_time
    # A slack tendon relaxes to slack.
    new[TENDON_RELAXED_INDEX] = (base[TENDON_RELAXED_INDEX] + share * max(0.0, stretch)) / (1.0 + share)
    if law.tendon_friction != 0.0:
        # In a slack tendon nothing slides.
        new[TENDON_TAUT_INDEX] = max(0.0, stretch)
        for i in range(N_TENDON_LAYERS):
            limit = tendon_layer_limit(i, law)
            elongation = old[TENDON_LAYER_INDEX + i] + new[TENDON_TAUT_INDEX] - old[TENDON_TAUT_INDEX]
            new[TENDON_LAYER_INDEX + i] = min(max(elongation, -limit), limit)
    if law.contact_slope != 0.0:
        share = gh / law.contact_reach
        new[CONTACT_INDEX] = (base[CONTACT_INDEX] + share * v) / (1.0 + share * abs(v))
    if law.hysteretic_slope != 0.0:
        new[HYSTERETIC_INDEX] = 0.0
        if pressure > 0.0:
            # dz = dx - beta |dx| z - gamma dx |z|, and z is limited by 1 / (beta + gamma).
            beta = law.hysteretic_stiffness / (law.hysteretic_slope * pressure) / (1.0 + law.hysteretic_gamma)
            driven = base[HYSTERETIC_INDEX] + gh * v
            gamma = law.hysteretic_gamma * beta if driven * v > 0.0 else -law.hysteretic_gamma * beta
            new[HYSTERETIC_INDEX] = driven / (1.0 + gh * abs(v) * (beta + gamma))
    if law.softening != 0.0:
        new[MAX_ENERGY_INDEX] = max(old[MAX_ENERGY_INDEX], bladder_energy_density(x + law.resting_length, law))
    if law.stribeck != 0.0:
        share, ratio = gh / FILM_TIME, v / law.stribeck_speed
        new[FILM_INDEX] = (base[FILM_INDEX] + share * math.exp(-ratio * ratio)) / (1.0 + share)
    if law.damper_air != 0.0 or law.charge != 0.0:
        new[CHAMBER_INDEX], new[CHAMBER_FORCE_INDEX] = solve_chamber(v, base[CHAMBER_INDEX], gh, law)
    if law.pressed_seal != 0.0:
        # The rubber shears until it slips: dz = dx (1 - z k / friction sign(dx)).
        friction = law.pressed_seal + law.seal_growth * law.pressed_seal * pressure
        new[SEAL_INDEX] = (base[SEAL_INDEX] + gh * v) / (1.0 + gh * abs(v) * law.seal_stiffness / friction)
    if law.lugre != 0.0:
        ratio = v / law.lugre_speed
        reach = law.lugre_reach * (1.0 + law.lugre_rise * math.exp(-ratio * ratio))
        new[BRISTLE_INDEX] = (base[BRISTLE_INDEX] + gh * v) / (1.0 + gh * abs(v) / reach)
    if law.warm != 0.0:
        new[WARMTH_INDEX] = (base[WARMTH_INDEX] + gh * law.warm_gain * orifice_tension(v, law) * v) / (
            1.0 + gh / COOLING_TIME
        )
    if law.play_slope != 0.0:
        for i in range(N_PLAY_SLIDERS):
            reach = play_slider_reach(i, law)
            new[PLAY_INDEX + i] = min(max(old[PLAY_INDEX + i], x - reach), x + reach)
    if law.creep != 0.0:
        for i in range(N_CREEP_BRANCHES):
            share = gh / creep_time(i)
            new[CREEP_INDEX + i] = (base[CREEP_INDEX + i] + share * x) / (1.0 + share)


@cached_njit
def internal_state_tension(state: np.ndarray, x: float, pressure: float, law: Law) -> float:
    """Return the muscle tension of the internal states."""
    total = law.relax_stiffness * (x - state[RELAXED_INDEX])
    if law.contact_slope != 0.0:
        growth = 1.0 - law.contact_growth * x / law.resting_length
        total += law.contact_slope * pressure * growth * state[CONTACT_INDEX]
    if law.slip_slope != 0.0:
        for i in range(3):
            total += law.slip_stiffness / 3.0 * (x - state[SLIP_INDEX + i])
    if law.hysteretic_slope != 0.0:
        total += law.hysteretic_stiffness * state[HYSTERETIC_INDEX]
    if law.softening != 0.0:
        over = max(0.0, state[MAX_ENERGY_INDEX] - bladder_energy_density(x + law.resting_length, law))
        total -= (
            law.softening * math.tanh(over / law.softening_energy) * thin_bladder_tension(x + law.resting_length, law)
        )
    if law.play_slope != 0.0:
        for i in range(N_PLAY_SLIDERS):
            total += (
                law.play_slope * pressure / N_PLAY_SLIDERS * (x - state[PLAY_INDEX + i]) / play_slider_reach(i, law)
            )
    if law.creep != 0.0:
        for i in range(N_CREEP_BRANCHES):
            total += law.creep * (x - state[CREEP_INDEX + i])
    return law.n_muscles * total


@cached_njit
def set_rest_state(state: np.ndarray, x: float, stretch: float, law: Law) -> None:
    """Set the state of a device at rest: relaxed branches, a tendon pulled from slack, no film, cold oil."""
    for i in range(N_INTERNAL_STATES):
        state[i] = 0.0
    state[SLIP_INDEX] = state[SLIP_INDEX + 1] = state[SLIP_INDEX + 2] = state[RELAXED_INDEX] = x
    for i in range(PLAY_INDEX, CREEP_INDEX + N_CREEP_BRANCHES):
        state[i] = x
    state[TENDON_SLIDER_INDEX] = stretch
    state[TENDON_RELAXED_INDEX] = state[TENDON_TAUT_INDEX] = max(0.0, stretch)
    for i in range(N_TENDON_LAYERS):
        state[TENDON_LAYER_INDEX + i] = min(max(0.0, stretch), tendon_layer_limit(i, law))
    state[MAX_ENERGY_INDEX], state[FILM_INDEX] = bladder_energy_density(x + law.resting_length, law), 1.0


@cached_njit
def state_distance(a: np.ndarray, b: np.ndarray) -> float:
    """Return the largest difference of two states, expressed as a length.

    Slider differences count a tenth; dimensionless numbers, pascals and kilograms are scaled by their effect on the
    tendon.
    """
    worst = 0.0
    for i in range(CONTACT_INDEX):
        worst = max(worst, abs(a[i] - b[i]))
    worst = max(0.1 * worst, 1e-4 * abs(a[CONTACT_INDEX] - b[CONTACT_INDEX]))
    for i in range(PLAY_INDEX, CREEP_INDEX + N_CREEP_BRANCHES):
        worst = max(worst, 0.1 * abs(a[i] - b[i]))
    worst = max(worst, 0.1 * abs(a[HYSTERETIC_INDEX] - b[HYSTERETIC_INDEX]))
    worst = max(worst, 0.1 * abs(a[BRISTLE_INDEX] - b[BRISTLE_INDEX]), 0.1 * abs(a[SEAL_INDEX] - b[SEAL_INDEX]))
    worst = max(worst, abs(a[CHAMBER_INDEX] - b[CHAMBER_INDEX]))
    for i in range(N_TENDON_LAYERS):
        worst = max(worst, 0.1 * abs(a[TENDON_LAYER_INDEX + i] - b[TENDON_LAYER_INDEX + i]))
    worst = max(worst, 1e-5 * abs(a[FILM_INDEX] - b[FILM_INDEX]), 1e-4 * abs(a[WARMTH_INDEX] - b[WARMTH_INDEX]))
    worst = max(
        worst,
        1e-9 * abs(a[PRESSURE_INDEX] - b[PRESSURE_INDEX]),
        1e-9 * abs(a[DISTURBANCE_INDEX] - b[DISTURBANCE_INDEX]),
    )
    return max(worst, 0.3 * abs(a[DRAWN_MASS_INDEX] - b[DRAWN_MASS_INDEX]))
