"""Viscous resistance of the muscle.

That of the rubber grows with the cross-section of the wall, in proportion to the diameter where walls are equally
thick; that of the braid is a share of the gas tension, and grows with the square of the diameter (both assumed).
"""

from typing import Any

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.laws.mckibben import MuscleParameters
from klute_sim.units import BAR


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


MUSCLE_DAMPING = Effect(
    name="muscle_damping",
    description="Rubber and braid resist motion in proportion to its speed.",
    kind="device",
    forms=(
        EffectForm(
            name="viscous",
            equation="F += n c v",
            parameters=(
                EffectParameter(
                    key="coefficient_n_s_per_m",
                    neutral=0.0,
                    lower=0.0,
                    upper=10000.0,
                    typical=150.0,
                    source="dissertation chapter 3: 6 % less tension at 300 mm/s is about 147 N s/m; upper end assumed",
                    diameter_exponent=1.0,
                ),
            ),
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
    ),
)
