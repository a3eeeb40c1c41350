"""The device and every hidden effect, written again from the published formulas, and an adaptive integrator.

Nothing here comes from the simulator: a diagnosis that is tested on data of its own code proves nothing. SI throughout;
tension is positive, ``v = dL/dt`` is negative while the muscle shortens, pressure is gauge.

State: muscle length ``L`` and the memories of the effects. Pressure does not depend on the motion in any of these laws,
so it is solved first, on a grid of ``AIR_STEP`` (see ``pressure_trace``). The massless junction

    muscle(P, L) + damper(v) + velocity effects(v) = tendon(unit length - L - slack length)

gives ``v``. The damper is ``v |v|``, whose inverse has an infinite slope at rest: explicit and Jacobian-based steps
crawl or chatter there. Each stage of a two-stage L-stable SDIRK (Alexander 1977, order 2) is instead a scalar equation
in ``v`` that rises with ``v``, solved in a bracket (Chandrupatla's method); steps are controlled by step doubling.
All compiled functions live in this one file, because Numba's cache only notices changes of the file it compiled.
"""

import math
from typing import NamedTuple

import numba
import numpy as np

GAMMA = 1.0 - 1.0 / math.sqrt(2.0)  # makes the two-stage SDIRK of order 2 L-stable
SIGN_SPEED = 1e-3  # m/s: width of the smooth sign
TENDON_SLIP = 0.3e-3  # m: reach of the tendon's slider
CLOSING = 1e-6  # m: over which a tendon with Maxwell memory takes up its load (its law jumps there)
FADE_PRESSURE = 2e5  # Pa: below it the friction offset fades to nothing
AIR_STEP = 5e-5  # s: grid of the pressure
TRACE_STEP = 1e-3  # s: grid of the output and of the prescribed length
SHORTEST = 1e-8  # s: a step this short is taken whatever its error (an impact on a stop)
N_MEMORY = 7  # three braid sliders, bladder branch, tendon slider, tendon branch, Dahl's state


class Law(NamedTuple):
    """Everything the force balance needs; the second half is neutral for a device without hidden effects."""

    count: float
    rest: float
    braid: float
    turns: float
    bladder_gain: float  # wall volume / resting length: times dW/d(lambda) it is the bladder's tension
    hoop: float  # L0^2 / (2 pi N R0)^2
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
    viscous: float
    viscous_pressure: float
    threshold: float
    threshold_rise: float
    tip: float  # c = 4/3 tip length
    taper: float
    relax_stiffness: float
    relax_time: float
    seal: float
    transition: float
    tendon_loss: float
    tendon_stiffness: float
    tendon_time: float
    tendon_slack: float
    # Other functional forms, which are in nobody's catalogue.
    dahl_slope: float
    dahl_reach: float
    power: float
    stribeck: float
    stribeck_rise: float
    stribeck_speed: float
    toe: float


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


@numba.njit(cache=True)
def smooth_sign(v: float) -> float:
    """The sign of ``v``, smooth over 1 mm/s."""
    return v / math.sqrt(v * v + SIGN_SPEED * SIGN_SPEED)


@numba.njit(cache=True)
def felt_pressure(pressure: float, L: float, law: Law) -> float:
    """What is left of the pressure for the muscle once the bladder has met the braid."""
    threshold = law.threshold + law.threshold_rise * (1.0 - L / law.rest)
    return max(pressure - threshold, 0.0) if threshold != 0.0 else pressure


@numba.njit(cache=True)
def muscle_static(felt: float, L: float, law: Law) -> float:
    """Gas, bladder and friction offset (eq. 3.3) of all actuators at rest."""
    stretch = L / law.rest
    gas = felt * (3.0 * L * L - 2.0 * law.tip * L - law.braid * law.braid) / (4.0 * math.pi * law.turns * law.turns)
    gas *= 1.0 - law.taper * (1.0 - stretch)
    a = stretch * stretch  # squares of the axial, hoop and radial stretches are a, u, 1/(a u)
    u = 1.0 + law.hoop * (1.0 - a)
    da, du = 2.0 * stretch, -2.0 * law.hoop * stretch
    d_volume = da * u + a * du
    d_i1 = da + du - d_volume / (a * u) ** 2
    d_i2 = -da / (a * a) - du / (u * u) + d_volume
    bladder = law.bladder_gain * (law.c10 * d_i1 + law.c01 * d_i2)
    friction = (law.friction_slope * felt + law.friction_offset) * min(1.0, felt / FADE_PRESSURE)
    return law.count * (gas + bladder - friction)


@numba.njit(cache=True)
def moving(felt: float, v: float, law: Law) -> float:
    """Tension that depends on the velocity: damper, seal, and the muscle's own losses."""
    orifice = law.damping_out if v > 0.0 else law.damping_in
    total = orifice * v * math.sqrt(v * v + law.transition * law.transition)
    sign = smooth_sign(v)
    total += law.seal * sign
    if law.stribeck != 0.0:
        bump = v / law.stribeck_speed
        total += law.stribeck * sign * (1.0 + law.stribeck_rise * math.exp(-bump * bump))
    per_muscle = law.coulomb_slope * felt * sign + (law.viscous + law.viscous_pressure * felt) * v
    if law.power != 0.0:
        per_muscle += law.power * v * math.sqrt(abs(v))
    return total + law.count * per_muscle


@numba.njit(cache=True)
def tendon_elastic(stretch: float, law: Law) -> float:
    """Two offset springs (Frisén 1969); never pushes."""
    if stretch <= 0.0:
        return 0.0
    force = law.stiffness_1 * stretch + law.stiffness_2 * max(0.0, stretch - law.engagement)
    return force * math.tanh(stretch / law.toe) if law.toe != 0.0 else force


@numba.njit(cache=True)
def tendon(stretch: float, memory: np.ndarray, law: Law) -> float:
    """Tendon force with its losses; ``stretch`` is already less the dead length."""
    if stretch <= 0.0:
        return 0.0
    force = tendon_elastic(stretch, law)
    force *= 1.0 + law.tendon_loss * (stretch - memory[4]) / TENDON_SLIP
    if law.tendon_stiffness != 0.0:
        force += law.tendon_stiffness * (stretch - memory[5]) * min(1.0, stretch / CLOSING)
    return max(0.0, force)


@numba.njit(cache=True)
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
    """Memories at the end of a stage: sliders dragged from ``old``, linear ones implicit over ``gh`` from ``base``."""
    if law.slip_slope != 0.0:
        stiffness = law.count * law.slip_stiffness / 3.0
        for i in range(3):
            reach = law.count * law.slip_slope * felt * (1.0 + i) / 6.0 / stiffness
            new[i] = min(max(old[i], x - reach), x + reach)
    share = gh / law.relax_time
    new[3] = (base[3] + share * x) / (1.0 + share)
    new[4] = min(max(old[4], stretch - TENDON_SLIP), stretch + TENDON_SLIP)
    share = gh / law.tendon_time
    new[5] = (base[5] + share * max(0.0, stretch)) / (1.0 + share)  # a slack tendon relaxes to slack
    if law.dahl_slope != 0.0:
        new[6] = (base[6] + gh * v / law.dahl_reach) / (1.0 + gh * abs(v) / law.dahl_reach)


@numba.njit(cache=True)
def remembered(memory: np.ndarray, x: float, felt: float, law: Law) -> float:
    """Muscle tension held in the memories."""
    total = law.relax_stiffness * (x - memory[3]) + law.dahl_slope * felt * memory[6]
    if law.slip_slope != 0.0:
        for i in range(3):
            total += law.slip_stiffness / 3.0 * (x - memory[i])
    return law.count * total


@numba.njit(cache=True)
def surplus(
    v: float,
    L: float,
    unit: float,
    pressure: float,
    gh: float,
    old: np.ndarray,
    base: np.ndarray,
    new: np.ndarray,
    law: Law,
) -> float:
    """Muscle side less tendon side if the stage moves from ``L`` at ``v`` for ``gh``; memories end in ``new``."""
    L = L + gh * v
    felt = felt_pressure(pressure, L, law)
    x = L - law.rest
    stretch = unit - L - law.slack - law.tendon_slack
    remember(old, base, new, gh, v, x, stretch, felt, law)
    held = muscle_static(felt, L, law) + remembered(new, x, felt, law)
    return held + moving(felt, v, law) - tendon(stretch, new, law)


@numba.njit(cache=True)
def solve_stage(
    guess: float,
    L: float,
    unit: float,
    pressure: float,
    gh: float,
    old: np.ndarray,
    base: np.ndarray,
    new: np.ndarray,
    law: Law,
) -> float:
    """Velocity of a stage, within the stops; memories in ``new``."""
    low, high = (law.braid / math.sqrt(3.0) - L) / gh, (law.rest - L) / gh
    a = min(max(guess, low), high)
    fa = surplus(a, L, unit, pressure, gh, old, base, new, law)
    width = 1e-4 + 0.01 * abs(a)
    b, fb = a, fa
    while fa * fb > 0.0:  # walk towards the root until it is passed, or a stop is reached
        a, fa = b, fb
        b = min(a + width, high) if fa < 0.0 else max(a - width, low)
        if a == b:
            return b  # the stop takes the rest of the force
        fb = surplus(b, L, unit, pressure, gh, old, base, new, law)
        width *= 4.0
    tolerance = 1e-14 / gh  # of the velocity; 1e-14 m of length
    c, fc = a, fa
    t = 0.5
    for _ in range(200):
        if fb == 0.0 or fa == 0.0:
            break
        m = a + t * (b - a)
        fm = surplus(m, L, unit, pressure, gh, old, base, new, law)
        if (fm > 0.0) == (fa > 0.0):
            c, fc = a, fa
        else:
            c, b = b, a
            fc, fb = fb, fa
        a, fa = m, fm
        best = a if abs(fa) < abs(fb) else b
        limit = 2.0 * (4e-16 * abs(best) + tolerance) / max(abs(b - a), 1e-300)
        if limit > 0.5 or fa == 0.0:
            break
        xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
        if phi * phi < xi and (1.0 - phi) * (1.0 - phi) < 1.0 - xi:  # inverse quadratic interpolation is safe
            t = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
        else:
            t = 0.5
        t = min(max(t, limit), 1.0 - limit)
    best = a if abs(fa) < abs(fb) else b
    surplus(best, L, unit, pressure, gh, old, base, new, law)
    return best


@numba.njit(cache=True)
def unit_length(t: float, pieces: np.ndarray) -> float:
    """Prescribed length of the unit: cubic pieces on the trace grid, highest power first."""
    i = min(max(int(t / TRACE_STEP), 0), pieces.shape[1] - 1)
    s = t - i * TRACE_STEP
    return ((pieces[0, i] * s + pieces[1, i]) * s + pieces[2, i]) * s + pieces[3, i]


@numba.njit(cache=True)
def on_grid(t: float, values: np.ndarray, step: float) -> float:
    """Linear interpolation on a regular grid that starts at 0; held outside."""
    place = t / step
    if place <= 0.0:
        return values[0]
    i = int(place)
    if i >= len(values) - 1:
        return values[-1]
    return values[i] + (place - i) * (values[i + 1] - values[i])


@numba.njit(cache=True)
def advance(
    t: float,
    h: float,
    L: float,
    v: float,
    memory: np.ndarray,
    out: np.ndarray,
    work: np.ndarray,
    pieces: np.ndarray,
    pressure: np.ndarray,
    law: Law,
) -> tuple[float, float]:
    """One SDIRK step: length and velocity at its end, memories in ``out``."""
    gh = GAMMA * h
    middle, base = work[0], work[1]
    unit, p = unit_length(t + gh, pieces), on_grid(t + gh, pressure, AIR_STEP)
    v1 = solve_stage(v, L, unit, p, gh, memory, memory, middle, law)
    for i in range(N_MEMORY):
        base[i] = memory[i] + (1.0 - GAMMA) / GAMMA * (middle[i] - memory[i])
    unit, p = unit_length(t + h, pieces), on_grid(t + h, pressure, AIR_STEP)
    start = L + (1.0 - GAMMA) * h * v1
    v2 = solve_stage(v1, start, unit, p, gh, middle, base, out, law)
    return start + gh * v2, v2


@numba.njit(cache=True)
def distance(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference of two memories as a length; Dahl's dimensionless state counts as a tenth of a millimetre."""
    worst = 0.0
    for i in range(N_MEMORY - 1):
        worst = max(worst, abs(a[i] - b[i]))
    return max(0.1 * worst, 1e-4 * abs(a[N_MEMORY - 1] - b[N_MEMORY - 1]))


@numba.njit(cache=True)
def rest_length(unit: float, pressure: float, law: Law) -> float:
    """Muscle length at rest with empty memories, found by halving between the stops."""
    low, high = law.braid / math.sqrt(3.0), law.rest
    none = np.zeros(N_MEMORY)
    for _ in range(100):
        middle = 0.5 * (low + high)
        stretch = unit - middle - law.slack - law.tendon_slack
        none[4], none[5] = stretch, max(0.0, stretch)  # both tendon memories start relaxed
        pull = muscle_static(felt_pressure(pressure, middle, law), middle, law) - tendon(stretch, none, law)
        if pull > 0.0:
            high = middle
        else:
            low = middle
    return high


@numba.njit(cache=True)
def integrate(
    pieces: np.ndarray, pressure: np.ndarray, law: Law, tolerance: float
) -> tuple[np.ndarray, np.ndarray, int]:
    """Tendon force and muscle length on the trace grid, and how many steps were taken.

    ``tolerance`` is the allowed length error of one step, in metres. Steps end on the trace grid, so that corners of
    the command, which lie on it, are never inside a step.
    """
    n = pieces.shape[1] + 1
    force, length = np.empty(n), np.empty(n)
    memory, whole, half, final = np.zeros(N_MEMORY), np.zeros(N_MEMORY), np.zeros(N_MEMORY), np.zeros(N_MEMORY)
    work = np.zeros((2, N_MEMORY))
    unit = unit_length(0.0, pieces)
    L, v, h, steps = rest_length(unit, pressure[0], law), 0.0, 1e-5, 0
    memory[0] = memory[1] = memory[2] = memory[3] = L - law.rest
    memory[4] = unit - L - law.slack - law.tendon_slack
    memory[5] = max(0.0, memory[4])
    for k in range(n):
        if k > 0:
            t, end = (k - 1) * TRACE_STEP, k * TRACE_STEP
            while end - t > 1e-12:
                step = end - t
                if step > h:  # two equal steps rather than a long one and a sliver
                    step = min(h, 0.5 * step) if step < 2.0 * h else h
                once, _ = advance(t, step, L, v, memory, whole, work, pieces, pressure, law)
                part, v1 = advance(t, 0.5 * step, L, v, memory, half, work, pieces, pressure, law)
                twice, v2 = advance(t + 0.5 * step, 0.5 * step, part, v1, half, final, work, pieces, pressure, law)
                error = max(abs(once - twice), distance(whole, final)) / 3.0
                scale = min(4.0, max(0.2, 0.85 * (tolerance / max(error, 1e-300)) ** (1.0 / 3.0)))
                if error <= tolerance or step <= SHORTEST:
                    t, L, v = t + step, twice, v2
                    memory[:] = final
                    steps += 1
                h = min(max(step * scale, SHORTEST), TRACE_STEP)
        length[k] = L
        force[k] = tendon(unit_length(k * TRACE_STEP, pieces) - L - law.slack - law.tendon_slack, memory, law)
    return force, length, steps


@numba.njit(cache=True)
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
