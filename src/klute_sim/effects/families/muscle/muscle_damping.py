"""Resistance of the muscle that grows with its speed.

That of the rubber grows with the cross-section of the wall, in proportion to the diameter where walls are equally
thick; that of the braid is a share of the gas tension, and grows with the square of the diameter (both assumed).
"""

import math
from dataclasses import replace
from typing import Any

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.laws.mckibben import MuscleParameters
from klute_sim.units import BAR

REFERENCE_SPEED = 0.1
"""Speed at which all exponents have the same force [m/s] (assumed: a middle one of the bench's ramps)."""
TRANSITION_SPEED = 5e-3
"""Speed below which a power law becomes linear [m/s] (assumed: an elastomer has a slowest time of relaxation)."""


def viscous_force(
    p: Any, state: Any, force: float, muscle: MuscleParameters, pressure: float, length: float, velocity: float
) -> float:
    """Return the tension [N] plus ``n c v``."""
    return force + muscle.n_actuators * p.coefficient * velocity


def pressure_dependent_force(
    p: Any, state: Any, force: float, muscle: MuscleParameters, pressure: float, length: float, velocity: float
) -> float:
    """Return the tension [N] plus ``n c (P / 1 bar) v``."""
    return force + muscle.n_actuators * p.coefficient * (pressure / BAR) * velocity


def power_law_force(
    p: Any, state: Any, force: float, muscle: MuscleParameters, pressure: float, length: float, velocity: float
) -> float:
    """Return the tension [N] plus ``n c v ((v^2 + v_t^2) / (v_r^2 + v_t^2))^((m - 1) / 2)``.

    ``v_r`` is :data:`REFERENCE_SPEED` and ``v_t`` :data:`TRANSITION_SPEED`; with ``m = 1`` it is :func:`viscous_force`.
    """
    speed_ratio = math.hypot(velocity, TRANSITION_SPEED) / math.hypot(REFERENCE_SPEED, TRANSITION_SPEED)
    return force + muscle.n_actuators * p.coefficient * velocity * speed_ratio ** (p.exponent - 1.0)


COEFFICIENT = EffectParameter(
    key="coefficient_n_s_per_m",
    neutral=0.0,
    lower=0.0,
    upper=10000.0,
    typical=150.0,
    source="dissertation chapter 3: 6 % less tension at 300 mm/s is about 147 N s/m; upper end assumed",
    diameter_exponent=1.0,
)
"""Tension per speed of one muscle."""

MUSCLE_DAMPING = Effect(
    name="muscle_damping",
    description="Rubber and braid resist motion, and more so the faster it is.",
    kind="device",
    forms=(
        EffectForm(
            name="viscous",
            equation="F += n c v",
            parameters=(COEFFICIENT,),
            laws={"muscle_force": viscous_force},
        ),
        EffectForm(
            name="pressure",
            equation="F += n c (P / 1 bar) v",
            parameters=(
                EffectParameter(
                    key="coefficient_n_s_per_m",
                    neutral=0.0,
                    lower=0.0,
                    upper=4000.0,
                    typical=40.0,
                    source="assumed: as viscous at 4 bar; grows with pressure as in Serres 2009; upper end assumed",
                    diameter_exponent=2.0,
                ),
            ),
            laws={"muscle_force": pressure_dependent_force},
        ),
        EffectForm(
            name="power_law",
            equation="F += n c v ((v^2 + v_t^2) / (v_r^2 + v_t^2))^((m - 1)/2)",
            parameters=(
                replace(
                    COEFFICIENT,
                    source="as viscous, at v_r = 0.1 m/s; linear below v_t = 5 mm/s; both and the upper end assumed",
                ),
                EffectParameter(
                    key="exponent",
                    neutral=None,
                    lower=0.2,
                    upper=1.0,
                    typical=0.5,
                    source="assumed: losses of polymers grow with the root of the rate in a middle range (Rouse 1953)",
                ),
            ),
            laws={"muscle_force": power_law_force},
        ),
    ),
)
