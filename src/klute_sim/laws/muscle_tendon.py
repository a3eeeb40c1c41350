"""Skeletal muscle-tendon unit of Hill type with a compliant tendon: Geyer and Herr (IEEE TNSRE 18:263, 2010).

Forces are over F_max, fiber lengths over l_opt and velocities over v_max. **Velocity is dl/dt: lengthening is
positive**, as in the laws of the device and opposite to :mod:`klute_sim.laws.hill`, which holds the fits of the
dissertation. Tension is positive.

The tendon is in series with three parallel parts: the contractile element, the parallel elastic element above l_opt,
and a buffer that keeps the fiber from collapsing. A small parallel damper is added to them, so that the fiber velocity
is defined without activation, too (damped equilibrium, Millard et al., J Biomech Eng 135:021005, 2013).
"""

import math
from typing import NamedTuple

WIDTH = 0.56
"""Half-width w of the force-length curve [l_opt] (Geyer and Herr 2010)."""
LOG_FORCE_AT_WIDTH = math.log(0.05)
"""Natural logarithm of the isometric force at l_opt (1 ± w) [1] (Geyer and Herr 2010)."""
CURVATURE = 5.0
"""Curvature K of the force-velocity curve [1] (Geyer and Herr 2010)."""
ECCENTRIC_FORCE = 1.5
"""Force N at lengthening with v_max [1] (Geyer and Herr 2010)."""
LENGTHENING_CURVATURE = 7.56
"""Factor of K while lengthening [1] (Geyer and Herr 2010)."""
REFERENCE_STRAIN = 0.04
"""Strain of the tendon at F_max [1] (Geyer and Herr 2010)."""
DAMPING = 0.02
"""Force of the parallel damper at v_max [F_max] (assumed; Millard et al. 2013 suggest up to 0.1)."""
MIN_LENGTH, MAX_LENGTH = 0.2, 2.0
"""Bracket of the fiber length [l_opt]; the buffer and the parallel element keep the solution far inside."""
FORCE_TOLERANCE = 1e-9
"""Largest accepted imbalance between fiber and tendon [F_max]."""
MAX_ITERATIONS = 60
"""Largest number of iterations of the solver; bisection alone needs 51."""


class MuscleTendon(NamedTuple):
    """Parameters of a muscle-tendon unit."""

    max_force: float
    """Largest isometric force F_max [N]."""
    max_velocity: float
    """Largest shortening velocity v_max [l_opt/s]."""
    optimal_length: float
    """Optimal fiber length l_opt [m]."""
    slack_length: float
    """Slack length of the tendon [m]."""


class FiberState(NamedTuple):
    """Fiber after a time step."""

    length: float
    """Fiber length [l_opt]."""
    velocity: float
    """Rate of the fiber length, lengthening positive [v_max]."""
    active_force: float
    """Force of the contractile element [F_max]."""
    tendon_force: float
    """Tension of the tendon, which both joints and Golgi organs feel [F_max]."""


def force_length(length: float) -> float:
    """Return the isometric force [F_max] at fiber ``length`` [l_opt]: ``exp(c |(l - 1)/w|^3)``."""
    x = abs((length - 1.0) / WIDTH)
    return math.exp(LOG_FORCE_AT_WIDTH * x * x * x)


def force_velocity(velocity: float) -> float:
    """Return the force over the isometric force at fiber ``velocity`` [v_max], lengthening positive.

    Hill's hyperbola while shortening and 0 beyond v_max; while lengthening a hyperbola that saturates near 1.5.
    """
    if velocity < -1.0:
        return 0.0
    if velocity < 0.0:
        return (1.0 + velocity) / (1.0 - CURVATURE * velocity)
    return ECCENTRIC_FORCE + (ECCENTRIC_FORCE - 1.0) * (velocity - 1.0) / (
        1.0 + LENGTHENING_CURVATURE * CURVATURE * velocity
    )


def passive_force(length: float) -> float:
    """Return the force [F_max] of parallel element and buffer at fiber ``length`` [l_opt]; the buffer pushes."""
    if length > 1.0:
        stretch = (length - 1.0) / WIDTH
        return stretch * stretch
    if length < 1.0 - WIDTH:
        compression = (1.0 - WIDTH - length) / (0.5 * WIDTH)
        return -compression * compression
    return 0.0


def passive_energy(muscle: MuscleTendon, length: float) -> float:
    """Return the energy [J] in parallel element and buffer at fiber ``length`` [l_opt]; integral of the force."""
    if length > 1.0:
        x = (length - 1.0) / WIDTH
        return muscle.max_force * muscle.optimal_length * WIDTH * x * x * x / 3.0
    if length < 1.0 - WIDTH:
        x = (1.0 - WIDTH - length) / (0.5 * WIDTH)
        return muscle.max_force * muscle.optimal_length * 0.5 * WIDTH * x * x * x / 3.0
    return 0.0


def tendon_force(strain: float) -> float:
    """Return the tension [F_max] of the tendon at ``strain`` [1]: quadratic, and 0 when slack."""
    if strain <= 0.0:
        return 0.0
    ratio = strain / REFERENCE_STRAIN
    return ratio * ratio


def tendon_energy(muscle: MuscleTendon, strain: float) -> float:
    """Return the elastic energy [J] of the tendon at ``strain`` [1]."""
    if strain <= 0.0:
        return 0.0
    ratio = strain / REFERENCE_STRAIN
    return muscle.max_force * muscle.slack_length * REFERENCE_STRAIN * ratio * ratio * ratio / 3.0


def tendon_strain(muscle: MuscleTendon, length: float, unit_length: float) -> float:
    """Return the strain [1] of the tendon at fiber ``length`` [l_opt] and ``unit_length`` of the whole unit [m]."""
    return (unit_length - length * muscle.optimal_length) / muscle.slack_length - 1.0


def _imbalance_slope(
    muscle: MuscleTendon, activation: float, length: float, velocity: float, strain: float, rate: float
) -> float:
    """Return the derivative of fiber force minus tendon force [F_max/l_opt] with respect to the new length.

    ``rate`` is dv/dl [v_max/l_opt] of the step.
    """
    x = (length - 1.0) / WIDTH
    isometric = force_length(length)
    isometric_slope = isometric * LOG_FORCE_AT_WIDTH * 3.0 * x * abs(x) / WIDTH
    if velocity < -1.0:
        speed_slope = 0.0
    elif velocity < 0.0:
        divisor = 1.0 - CURVATURE * velocity
        speed_slope = (1.0 + CURVATURE) / (divisor * divisor)
    else:
        divisor = 1.0 + LENGTHENING_CURVATURE * CURVATURE * velocity
        speed_slope = (ECCENTRIC_FORCE - 1.0) * (1.0 + LENGTHENING_CURVATURE * CURVATURE) / (divisor * divisor)
    slope = activation * (isometric_slope * force_velocity(velocity) + isometric * speed_slope * rate) + DAMPING * rate
    if length > 1.0:
        slope += 2.0 * x / WIDTH
    elif length < 1.0 - WIDTH:
        slope += 2.0 * (1.0 - WIDTH - length) / (0.25 * WIDTH * WIDTH)
    if strain > 0.0:
        slope += 2.0 * strain / (REFERENCE_STRAIN * REFERENCE_STRAIN) * muscle.optimal_length / muscle.slack_length
    return slope


def step_fiber(
    muscle: MuscleTendon, activation: float, previous_length: float, unit_length: float, dt: float
) -> FiberState:
    """Return the fiber a time step ``dt`` [s] later (backward Euler), at ``unit_length`` [m] of the whole unit.

    Solves ``a f_l(l) f_v(v) + f_passive(l) + d v = f_tendon(l_unit - l)`` with ``v = (l - l_previous)/(dt v_max)`` by
    Newton's method inside a bracket. ``activation`` is 0-1 and ``previous_length`` [l_opt]. The damper makes the
    left side increase with l at every time step of gait, so the solution is unique.
    """
    rate = 1.0 / (dt * muscle.max_velocity)
    low, high, length = MIN_LENGTH, MAX_LENGTH, previous_length
    velocity, active, tension = 0.0, 0.0, 0.0
    for _ in range(MAX_ITERATIONS):
        velocity = (length - previous_length) * rate
        strain = tendon_strain(muscle, length, unit_length)
        active = activation * force_length(length) * force_velocity(velocity)
        tension = tendon_force(strain)
        imbalance = active + passive_force(length) + DAMPING * velocity - tension
        if abs(imbalance) < FORCE_TOLERANCE:
            break
        if imbalance > 0.0:
            high = length
        else:
            low = length
        slope = _imbalance_slope(muscle, activation, length, velocity, strain, rate)
        length -= imbalance / slope if slope > 0.0 else 0.0
        if not low < length < high:
            length = 0.5 * (low + high)
    return FiberState(length, velocity, active, tension)
