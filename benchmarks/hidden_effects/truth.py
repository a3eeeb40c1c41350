"""The device with all hidden effects, implemented independently from the published formulas, and an adaptive
integrator.

This package uses no code of the simulator: a diagnosis tested on data of its own code would prove nothing. ``law.py``
has the forces and ``air.py`` the supply. SI units throughout.

State: muscle length ``L`` and the internal states of the effects, including those of the air where the pressure depends
on the motion. The massless junction

    muscle(P, L) + damper(v) + velocity effects(v) = tendon(unit length - L - slack length)

determines ``v``. The damper is ``v |v|``, whose inverse has an infinite slope at rest, where explicit and
Jacobian-based integrators become slow or oscillate. Each stage of a two-stage L-stable SDIRK (Alexander 1977, order 2)
is therefore a scalar equation that increases with ``v`` and is solved in a bracket (Chandrupatla's method). Step
doubling controls the step size.
"""

import math
from typing import NamedTuple

import numpy as np
from benchmarks.hidden_effects.air import (
    AIR_STEP,
    CLOSING_TOLERANCE,
    AirSupply,
    close_muscle,
    excess_over_tank,
    interpolate_on_grid,
    is_coupled_to_motion,
    solve_air_stage,
    steady_pressure,
    target_pressure,
)
from benchmarks.hidden_effects.compiled import cached_njit
from benchmarks.hidden_effects.law import (
    DISTURBANCE_INDEX,
    N_INTERNAL_STATES,
    PRESSURE_INDEX,
    Law,
    effective_pressure,
    internal_state_tension,
    rate_dependent_tension,
    set_rest_state,
    state_distance,
    stateful_damping_tension,
    static_muscle_tension,
    tendon_tension,
    update_internal_state,
)

GAMMA = 1.0 - 1.0 / math.sqrt(2.0)  # makes the two-stage SDIRK of order 2 L-stable
TRACE_STEP = 1e-3  # s: grid of the output and of the prescribed length
MIN_TIME_STEP = 1e-8  # s: a step this short is taken whatever its error (an impact on a stop)


class DeviceInputs(NamedTuple):
    """Prescribed inputs of a device."""

    length_spline: np.ndarray
    """Spline coefficients of the unit length; see :func:`evaluate_length_spline`."""
    pressure: np.ndarray
    """Pressure on the air grid, or a disturbance where the air is integrated with the motion."""
    command: np.ndarray
    """Pressure command [Pa]."""
    command_step: float
    """Sampling interval of the command [s]."""


class BoundaryConditions(NamedTuple):
    """Prescribed quantities at one instant."""

    unit_length: float
    """Length of the unit [m]."""
    unit_rate: float
    """Rate of that length [m/s]."""
    pressure: float
    """Air pressure, or its disturbance where the air is integrated with the motion."""
    target: float
    """Target pressure of the supply; unused where the pressure is prescribed."""


@cached_njit
def force_residual(
    v: float,
    L: float,
    boundary: BoundaryConditions,
    gh: float,
    old: np.ndarray,
    base: np.ndarray,
    new: np.ndarray,
    law: Law,
    air: AirSupply,
) -> float:
    """Return muscle tension less tendon tension after a stage from ``L`` at ``v`` for ``gh``; ``new`` receives the
    states.
    """
    L = L + gh * v
    pressure = boundary.pressure
    if is_coupled_to_motion(air):
        pressure += solve_air_stage(v, L, boundary.target, gh, old, base, new, law, air)
    felt = effective_pressure(pressure, L, law)
    x = L - law.resting_length
    stretch = boundary.unit_length - L - law.slack - law.tendon_slack
    update_internal_state(old, base, new, gh, v, x, stretch, felt, law)
    held = static_muscle_tension(felt, L, law) + internal_state_tension(new, x, felt, law)
    return (
        held
        + rate_dependent_tension(felt, v, law)
        + stateful_damping_tension(v, x, old, new, law)
        - tendon_tension(stretch, boundary.unit_rate - v, new, law)
    )


@cached_njit
def solve_stage(
    guess: float,
    L: float,
    boundary: BoundaryConditions,
    gh: float,
    old: np.ndarray,
    base: np.ndarray,
    new: np.ndarray,
    law: Law,
    air: AirSupply,
) -> float:
    """Return the velocity of a stage within the stops; ``new`` receives the states."""
    low, high = (law.braid_length / math.sqrt(3.0) - L) / gh, (law.resting_length - L) / gh
    a = min(max(guess, low), high)
    fa = force_residual(a, L, boundary, gh, old, base, new, law, air)
    width = 1e-4 + 0.01 * abs(a)
    b, fb = a, fa
    while fa * fb > 0.0:  # extend the bracket until it contains the root or reaches a stop
        a, fa = b, fb
        b = min(a + width, high) if fa < 0.0 else max(a - width, low)
        if a == b:
            return b  # the stop takes the rest of the force
        fb = force_residual(b, L, boundary, gh, old, base, new, law, air)
        width *= 4.0
    tolerance = 1e-14 / gh  # of the velocity; 1e-14 m of length
    c, fc = a, fa
    t = 0.5
    for _ in range(200):
        if fb == 0.0 or fa == 0.0:
            break
        m = a + t * (b - a)
        fm = force_residual(m, L, boundary, gh, old, base, new, law, air)
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
    force_residual(best, L, boundary, gh, old, base, new, law, air)
    return best


@cached_njit
def evaluate_length_spline(t: float, length_spline: np.ndarray) -> float:
    """Return the prescribed unit length: cubic pieces on the trace grid, highest power first."""
    i = min(max(int(t / TRACE_STEP), 0), length_spline.shape[1] - 1)
    s = t - i * TRACE_STEP
    return ((length_spline[0, i] * s + length_spline[1, i]) * s + length_spline[2, i]) * s + length_spline[3, i]


@cached_njit
def evaluate_length_rate(t: float, length_spline: np.ndarray) -> float:
    """Return the rate of the prescribed unit length [m/s]; at a knot that of the piece before, in which a step ends."""
    i = min(max(math.ceil(t / TRACE_STEP - 1e-9) - 1, 0), length_spline.shape[1] - 1)
    s = t - i * TRACE_STEP
    return (3.0 * length_spline[0, i] * s + 2.0 * length_spline[1, i]) * s + length_spline[2, i]


@cached_njit
def boundary_conditions_at(t: float, inputs: DeviceInputs, air: AirSupply) -> BoundaryConditions:
    """Return the boundary conditions at ``t``."""
    target = target_pressure(t, inputs.command, inputs.command_step, air) if is_coupled_to_motion(air) else 0.0
    return BoundaryConditions(
        evaluate_length_spline(t, inputs.length_spline),
        evaluate_length_rate(t, inputs.length_spline),
        interpolate_on_grid(t, inputs.pressure, AIR_STEP),
        target,
    )


@cached_njit
def step_sdirk(
    t: float,
    h: float,
    L: float,
    v: float,
    state: np.ndarray,
    new_state: np.ndarray,
    workspace: np.ndarray,
    inputs: DeviceInputs,
    law: Law,
    air: AirSupply,
) -> tuple[float, float]:
    """Take one SDIRK step; return length and velocity at its end, with the states in ``new_state``."""
    gh = GAMMA * h
    middle, base = workspace[0], workspace[1]
    v1 = solve_stage(v, L, boundary_conditions_at(t + gh, inputs, air), gh, state, state, middle, law, air)
    for i in range(N_INTERNAL_STATES):
        base[i] = state[i] + (1.0 - GAMMA) / GAMMA * (middle[i] - state[i])
    start = L + (1.0 - GAMMA) * h * v1
    v2 = solve_stage(v1, start, boundary_conditions_at(t + h, inputs, air), gh, middle, base, new_state, law, air)
    return start + gh * v2, v2


@cached_njit
def solve_rest_length(unit: float, pressure: float, law: Law) -> float:
    """Return the muscle length at rest with relaxed states, by bisection between the stops."""
    low, high = law.braid_length / math.sqrt(3.0), law.resting_length
    none = np.zeros(N_INTERNAL_STATES)
    for _ in range(100):
        middle = 0.5 * (low + high)
        stretch = unit - middle - law.slack - law.tendon_slack
        set_rest_state(none, middle - law.resting_length, stretch, law)  # with all memories at rest
        pull = static_muscle_tension(effective_pressure(pressure, middle, law), middle, law) - tendon_tension(
            stretch, 0.0, none, law
        )
        if pull > 0.0:
            high = middle
        else:
            low = middle
    return high


@cached_njit
def integrate_device(
    inputs: DeviceInputs, law: Law, air: AirSupply, tolerance: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Return tendon force, muscle length and pressure on the trace grid, and the number of steps.

    ``tolerance`` is the allowed length error of one step [m]. Steps end on the trace grid, which contains the corners
    of the command.
    """
    n = inputs.length_spline.shape[1] + 1
    force, length, pressure = np.empty(n), np.empty(n), np.empty(n)
    memory, whole, half, final = (
        np.zeros(N_INTERNAL_STATES),
        np.zeros(N_INTERNAL_STATES),
        np.zeros(N_INTERNAL_STATES),
        np.zeros(N_INTERNAL_STATES),
    )
    work = np.zeros((2, N_INTERNAL_STATES))
    boundary, is_coupled = boundary_conditions_at(0.0, inputs, air), is_coupled_to_motion(air)
    filled = steady_pressure(boundary.target, air)
    L = solve_rest_length(boundary.unit_length, boundary.pressure + (filled if is_coupled else 0.0), law)
    set_rest_state(memory, L - law.resting_length, boundary.unit_length - L - law.slack - law.tendon_slack, law)
    if is_coupled:
        memory[PRESSURE_INDEX] = filled
    v, h, steps = 0.0, 1e-5, 0
    for k in range(n):
        if k > 0:
            t, end = (k - 1) * TRACE_STEP, k * TRACE_STEP
            while end - t > 1e-12:
                step = end - t
                if step > h:  # two equal steps rather than a long one and a sliver
                    step = min(h, 0.5 * step) if step < 2.0 * h else h
                once, _ = step_sdirk(t, step, L, v, memory, whole, work, inputs, law, air)
                passed = excess_over_tank(memory, air) < 0.0 and excess_over_tank(whole, air) > CLOSING_TOLERANCE
                close_muscle(whole, air)
                part, v1 = step_sdirk(t, 0.5 * step, L, v, memory, half, work, inputs, law, air)
                close_muscle(half, air)
                twice, v2 = step_sdirk(t + 0.5 * step, 0.5 * step, part, v1, half, final, work, inputs, law, air)
                close_muscle(final, air)
                error = max(abs(once - twice), state_distance(whole, final)) / 3.0
                error = max(error, 8.0 * tolerance) if passed else error
                scale = min(4.0, max(0.2, 0.85 * (tolerance / max(error, 1e-300)) ** (1.0 / 3.0)))
                if error <= tolerance or step <= MIN_TIME_STEP:
                    t, L, v = t + step, twice, v2
                    memory[:] = final
                    steps += 1
                h = min(max(step * scale, MIN_TIME_STEP), TRACE_STEP)
        boundary = boundary_conditions_at(k * TRACE_STEP, inputs, air)
        length[k], pressure[k] = L, boundary.pressure
        if is_coupled:
            pressure[k] += memory[PRESSURE_INDEX] + memory[DISTURBANCE_INDEX]
        stretch, rate = boundary.unit_length - L - law.slack - law.tendon_slack, boundary.unit_rate - v
        force[k] = tendon_tension(stretch, rate, memory, law)
    return force, length, pressure, steps
