"""Terms that dissertation chapter 3 adds to the geometric muscle model, for devices that lack them.

In muscles of different diameters but equal walls (assumed), the part of the friction offset that grows with pressure is
the same share of the gas tension, so it grows with the square of the diameter; the constant part belongs to the wall,
whose cross-section grows with the diameter.
"""

from typing import Any

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.laws import mckibben
from klute_sim.laws.mckibben import MuscleParameters

C01_PER_C10 = 105.7 / 118.4
"""Ratio of the Mooney-Rivlin constants of the dissertation's latex [1]."""


def mooney_rivlin_force(
    p: Any, state: Any, force: float, muscle: MuscleParameters, pressure: float, length: float, velocity: float
) -> float:
    """Return the tension [N] plus ``Vb dW/dL`` of eq. (3.3), with ``C01 = 0.893 C10``."""
    muscle_with_bladder = MuscleParameters(
        muscle.n_actuators,
        muscle.resting_length,
        muscle.braid_length,
        muscle.braid_turns,
        muscle.bladder_radius,
        muscle.bladder_thickness,
        p.c10,
        C01_PER_C10 * p.c10,
        0.0,
        0.0,
    )
    return force + mckibben.bladder_force(muscle_with_bladder, length)


def friction_offset_force(
    p: Any, state: Any, force: float, muscle: MuscleParameters, pressure: float, length: float, velocity: float
) -> float:
    """Return the tension [N] minus ``n (m P + b) min(1, P / 2 bar)``, Table 3.1."""
    fade = min(1.0, pressure / mckibben.FRICTION_FADE_PRESSURE)
    return force - muscle.n_actuators * (p.slope * pressure + p.offset) * fade


BLADDER_RUBBER = Effect(
    name="bladder",
    description="The rubber bladder resists deformation: it reduces the tension of a contracted muscle.",
    kind="device",
    replaces_switch="bladder",
    forms=(
        EffectForm(
            name="mooney_rivlin",
            equation="F += V_b dW/dL, W = C10 (I1 - 3) + 0.893 C10 (I2 - 3)",
            parameters=(
                EffectParameter(
                    key="c10_kpa",
                    neutral=0.0,
                    lower=0.0,
                    upper=2000.0,
                    typical=118.4,
                    source="dissertation chapter 3 (latex); range assumed",
                ),
            ),
            laws={"muscle_force": mooney_rivlin_force},
        ),
    ),
)

FRICTION_OFFSET = Effect(
    name="friction_offset",
    description="Friction reduces tension by an amount that grows with pressure, independent of direction.",
    kind="device",
    replaces_switch="friction",
    forms=(
        EffectForm(
            name="table_3_1",
            equation="F -= n (m P + b) min(1, P / 2 bar)",
            parameters=(
                EffectParameter(
                    key="slope_n_per_bar",
                    neutral=0.0,
                    lower=-100.0,
                    upper=200.0,
                    typical=28.0,
                    source="dissertation Table 3.1: 3.6 to 56.9; range assumed",
                    diameter_exponent=2.0,
                ),
                EffectParameter(
                    key="offset_n",
                    neutral=0.0,
                    lower=-300.0,
                    upper=300.0,
                    typical=30.0,
                    source="dissertation Table 3.1: -38.2 to 109.8; range assumed",
                    diameter_exponent=1.0,
                ),
            ),
            laws={"muscle_force": friction_offset_force},
        ),
    ),
)
