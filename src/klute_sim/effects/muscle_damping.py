"""Viscous resistance of the muscle itself."""

from klute_sim.effects.effect import Effect, Form, Numbers, Parameter
from klute_sim.laws.mckibben import Muscle
from klute_sim.units import BAR


def viscous(
    own: Numbers, memory: Numbers, force: float, muscle: Muscle, pressure: float, length: float, rate: float
) -> float:
    """Tension [N]: ``+ n c v``."""
    return force + muscle.actuators * own[0] * rate


def by_pressure(
    own: Numbers, memory: Numbers, force: float, muscle: Muscle, pressure: float, length: float, rate: float
) -> float:
    """Tension [N]: ``+ n c (P / 1 bar) v``."""
    return force + muscle.actuators * own[0] * (pressure / BAR) * rate


EFFECT = Effect(
    name="muscle_damping",
    sentence="The muscle resists in proportion to its speed, as rubber and braid do.",
    kind="device",
    forms=(
        Form(
            name="viscous",
            equation="F += n c v",
            parameters=(
                Parameter(
                    key="coefficient_n_s_per_m",
                    neutral=0.0,
                    low=0.0,
                    high=3000.0,
                    typical=150.0,
                    source="dissertation chapter 3: 6 % less tension at 300 mm/s is about 147 N s/m",
                ),
            ),
            laws={"muscle_force": viscous},
        ),
        Form(
            name="pressure",
            equation="F += n c (P / 1 bar) v",
            parameters=(
                Parameter(
                    key="coefficient_n_s_per_m",
                    neutral=0.0,
                    low=0.0,
                    high=1000.0,
                    typical=40.0,
                    source="assumed: as viscous at 4 bar; grows with pressure as in Serres 2009",
                ),
            ),
            laws={"muscle_force": by_pressure},
        ),
    ),
)
