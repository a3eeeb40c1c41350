"""Rubber that is stretched gives way with time."""

from klute_sim.effects.effect import Effect, Form, Numbers, Parameter
from klute_sim.effects.smooth import followed
from klute_sim.laws.mckibben import Muscle


def maxwell(
    own: Numbers, memory: Numbers, force: float, muscle: Muscle, pressure: float, length: float, rate: float
) -> float:
    """Tension [N]: ``+ n k (x - s)``, x the length beyond rest, s the relaxed one."""
    return force + muscle.actuators * own[0] * (length - muscle.resting_length - memory[0])


def relaxed(
    own: Numbers, memory: Numbers, muscle: Muscle, pressure: float, length: float, stretch: float, step: float
) -> tuple[float]:
    """``ds/dt = (x - s) / tau``."""
    return (followed(memory[0], length - muscle.resting_length, own[1], step),)


EFFECT = Effect(
    name="bladder_relaxation",
    sentence="After a change of length the bladder's tension creeps towards its long-term value.",
    kind="device",
    forms=(
        Form(
            name="maxwell",
            equation="F += n k (x - s), ds/dt = (x - s)/tau",
            parameters=(
                Parameter(
                    key="stiffness_n_per_mm",
                    neutral=0.0,
                    low=0.0,
                    high=50.0,
                    typical=3.0,
                    source="assumed: natural rubber gives way by a few percent per decade of time",
                ),
                Parameter(
                    key="time_constant_s",
                    neutral=None,
                    low=0.02,
                    high=100.0,
                    typical=1.0,
                    source="assumed: what a bench trial of seconds can show",
                ),
            ),
            laws={"muscle_force": maxwell, "remember": relaxed},
            memory=1,
        ),
    ),
)
