"""The dissertation's own ladder: what chapter 3 adds to the geometric model, for devices that are without it."""

from klute_sim.effects.effect import Effect, Form, Numbers, Parameter
from klute_sim.laws import mckibben
from klute_sim.laws.mckibben import Muscle

LATEX = 105.7 / 118.4
"""C01 over C10 of the dissertation's rubber."""


def rubber(
    own: Numbers, memory: Numbers, force: float, muscle: Muscle, pressure: float, length: float, rate: float
) -> float:
    """Tension [N]: ``+ Vb dW/dL`` of eq. (3.3), with ``C01 = 0.893 C10``."""
    walled = Muscle(
        muscle.actuators,
        muscle.resting_length,
        muscle.braid_length,
        muscle.turns,
        muscle.bladder_radius,
        muscle.bladder_thickness,
        own[0],
        LATEX * own[0],
        0.0,
        0.0,
    )
    return force + mckibben.bladder_force(walled, length)


def offset(
    own: Numbers, memory: Numbers, force: float, muscle: Muscle, pressure: float, length: float, rate: float
) -> float:
    """Tension [N]: ``- n (m P + b) min(1, P / 2 bar)``, Table 3.1."""
    fade = min(1.0, pressure / mckibben.FRICTION_ONSET)
    return force - muscle.actuators * (own[0] * pressure + own[1]) * fade


BLADDER = Effect(
    name="bladder",
    sentence="The rubber bladder resists being stretched and squeezed: it takes tension from a contracted muscle.",
    kind="device",
    instead_of="bladder",
    forms=(
        Form(
            name="mooney_rivlin",
            equation="F += Vb dW/dL, W = C10 (I1 - 3) + 0.893 C10 (I2 - 3)",
            parameters=(
                Parameter(
                    key="c10_kpa",
                    neutral=0.0,
                    low=0.0,
                    high=2000.0,
                    typical=118.4,
                    source="dissertation chapter 3 (latex); range assumed",
                ),
            ),
            laws={"muscle_force": rubber},
        ),
    ),
)

FRICTION = Effect(
    name="friction_offset",
    sentence="Friction takes a tension that grows with pressure, whichever way the muscle moves.",
    kind="device",
    instead_of="friction",
    forms=(
        Form(
            name="table_3_1",
            equation="F -= n (m P + b) min(1, P / 2 bar)",
            parameters=(
                Parameter(
                    key="slope_n_per_bar",
                    neutral=0.0,
                    low=-100.0,
                    high=200.0,
                    typical=28.0,
                    source="dissertation Table 3.1: 3.6 to 56.9; range assumed",
                ),
                Parameter(
                    key="offset_n",
                    neutral=0.0,
                    low=-300.0,
                    high=300.0,
                    typical=30.0,
                    source="dissertation Table 3.1: -38.2 to 109.8; range assumed",
                ),
            ),
            laws={"muscle_force": offset},
        ),
    ),
)
