"""Metabolic power of a skeletal muscle by two published laws, without the basal rate of the body.

Both laws were fitted to isolated muscle. Between them they differ by tens of per cent in one muscle, so a result that
holds under one law only is not a result; compare conditions in per cent.

Fiber velocity is positive while lengthening (:mod:`klute_sim.laws.muscle_tendon`).
"""

import math

from klute_sim.laws.muscle_tendon import MuscleTendon

MUSCLE_DENSITY = 1059.7
"""Density of muscle [kg/m3] (Umberger et al. 2003)."""
SPECIFIC_TENSION = 250e3
"""Largest isometric stress of muscle [Pa] (Umberger et al. 2003)."""

SLOW_ACTIVATION_HEAT, FAST_ACTIVATION_HEAT = 40.0, 133.0
"""Heat rates of activation of slow and fast fibers [W/kg] (Bhargava et al. 2004)."""
SLOW_MAINTENANCE_HEAT, FAST_MAINTENANCE_HEAT = 74.0, 111.0
"""Heat rates of maintenance of slow and fast fibers [W/kg] (Bhargava et al. 2004)."""
SHORTENING_ISOMETRIC_SHARE, SHORTENING_FORCE_SHARE, LENGTHENING_FORCE_SHARE = 0.16, 0.18, 0.157
"""Heat of shortening over isometric and actual force times velocity, and of lengthening [1] (Bhargava et al. 2004)."""


def muscle_mass(muscle: MuscleTendon) -> float:
    """Return the mass [kg] of the fibers: F_max/σ · l_opt · ρ."""
    return muscle.max_force / SPECIFIC_TENSION * muscle.optimal_length * MUSCLE_DENSITY


def minetti_alexander_power(muscle: MuscleTendon, activation: float, velocity: float) -> float:
    """Return the metabolic power [W] after Minetti and Alexander (J Theor Biol 186:467, 1997).

    ``a F_max v_max Φ(v)`` with the fitted ratio Φ of polynomials in the shortening velocity over v_max. ``velocity``
    [v_max] is limited to -1 ... 1, the range of the fit, and Φ to 0 and above.
    """
    s = min(max(-velocity, -1.0), 1.0)
    rate = (0.054 + 0.506 * s + 2.46 * s * s) / (1.0 - 1.13 * s + 12.8 * s * s - 1.64 * s * s * s)
    return max(rate, 0.0) * activation * muscle.max_force * muscle.max_velocity * muscle.optimal_length


def maintenance_factor(length: float) -> float:
    """Return the factor [1] of the heat of maintenance at fiber ``length`` [l_opt]: piecewise linear, 1 at l_opt."""
    if length <= 0.5:
        return 0.5
    if length <= 1.0:
        return length
    return max(0.0, 3.0 - 2.0 * length)


def bhargava_power(
    muscle: MuscleTendon,
    slow_fraction: float,
    activation: float,
    length: float,
    velocity: float,
    isometric_force: float,
    active_force: float,
) -> float:
    """Return the metabolic power [W] after Bhargava, Pandy and Anderson (J Biomech 37:81, 2004).

    Sum of the heats of activation, maintenance and shortening and of the fiber's work. ``slow_fraction`` is the share
    of slow fibers [1], ``length`` [l_opt], ``velocity`` [v_max]; ``isometric_force`` is the force at this length and
    activation without motion and ``active_force`` that of the contractile element [F_max].

    Excitation is taken to be the activation, and the decay of the activation heat over time is left out, as in the
    implementation of OpenSim. The total is limited to 0 and above: lengthening fibers do not produce fuel.
    """
    angle = 0.5 * math.pi * activation
    slow, fast = slow_fraction * math.sin(angle), (1.0 - slow_fraction) * (1.0 - math.cos(angle))
    activation_heat = SLOW_ACTIVATION_HEAT * slow + FAST_ACTIVATION_HEAT * fast
    maintenance_heat = maintenance_factor(length) * (SLOW_MAINTENANCE_HEAT * slow + FAST_MAINTENANCE_HEAT * fast)
    speed = velocity * muscle.max_velocity * muscle.optimal_length
    if velocity < 0.0:
        coefficient = SHORTENING_ISOMETRIC_SHARE * isometric_force + SHORTENING_FORCE_SHARE * active_force
    else:
        coefficient = LENGTHENING_FORCE_SHARE * active_force
    heat_and_work = -(coefficient + active_force) * speed * muscle.max_force
    return max(0.0, muscle_mass(muscle) * (activation_heat + maintenance_heat) + heat_and_work)
