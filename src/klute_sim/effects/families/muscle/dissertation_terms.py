"""The dissertation's own ladder: what chapter 3 adds to the geometric model, for devices that are without it."""

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter, FloatSequence
from klute_sim.laws import mckibben
from klute_sim.laws.mckibben import Muscle

C01_PER_C10 = 105.7 / 118.4
"""C01 over C10 of the dissertation's rubber."""


def mooney_rivlin_force(
    p: FloatSequence, state: FloatSequence, force: float, muscle: Muscle, pressure: float, length: float, rate: float
) -> float:
    """Tension [N]: ``+ Vb dW/dL`` of eq. (3.3), with ``C01 = 0.893 C10``."""
    walled = Muscle(
        muscle.n_actuators,
        muscle.resting_length,
        muscle.braid_length,
        muscle.braid_turns,
        muscle.bladder_radius,
        muscle.bladder_thickness,
        p[0],
        C01_PER_C10 * p[0],
        0.0,
        0.0,
    )
    return force + mckibben.bladder_force(walled, length)


def friction_offset_force(
    p: FloatSequence, state: FloatSequence, force: float, muscle: Muscle, pressure: float, length: float, rate: float
) -> float:
    """Tension [N]: ``- n (m P + b) min(1, P / 2 bar)``, Table 3.1."""
    fade = min(1.0, pressure / mckibben.FRICTION_FADE_PRESSURE)
    return force - muscle.n_actuators * (p[0] * pressure + p[1]) * fade


BLADDER_RUBBER = Effect(
    name="bladder",
    description="The rubber bladder resists being stretched and squeezed: it takes tension from a contracted muscle.",
    kind="device",
    replaces_switch="bladder",
    forms=(
        EffectForm(
            name="mooney_rivlin",
            equation="F += Vb dW/dL, W = C10 (I1 - 3) + 0.893 C10 (I2 - 3)",
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
    description="Friction takes a tension that grows with pressure, whichever way the muscle moves.",
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
                ),
                EffectParameter(
                    key="offset_n",
                    neutral=0.0,
                    lower=-300.0,
                    upper=300.0,
                    typical=30.0,
                    source="dissertation Table 3.1: -38.2 to 109.8; range assumed",
                ),
            ),
            laws={"muscle_force": friction_offset_force},
        ),
    ),
)
