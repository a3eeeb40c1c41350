"""Viscous resistance of the muscle itself."""

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter, FloatSequence
from klute_sim.laws.mckibben import Muscle
from klute_sim.units import BAR


def viscous_force(
    p: FloatSequence, state: FloatSequence, force: float, muscle: Muscle, pressure: float, length: float, rate: float
) -> float:
    """Tension [N]: ``+ n c v``."""
    return force + muscle.n_actuators * p[0] * rate


def pressure_dependent_force(
    p: FloatSequence, state: FloatSequence, force: float, muscle: Muscle, pressure: float, length: float, rate: float
) -> float:
    """Tension [N]: ``+ n c (P / 1 bar) v``."""
    return force + muscle.n_actuators * p[0] * (pressure / BAR) * rate


MUSCLE_DAMPING = Effect(
    name="muscle_damping",
    description="The muscle resists in proportion to its speed, as rubber and braid do.",
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
                    upper=3000.0,
                    typical=150.0,
                    source="dissertation chapter 3: 6 % less tension at 300 mm/s is about 147 N s/m",
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
                    upper=1000.0,
                    typical=40.0,
                    source="assumed: as viscous at 4 bar; grows with pressure as in Serres 2009",
                ),
            ),
            laws={"muscle_force": pressure_dependent_force},
        ),
    ),
)
