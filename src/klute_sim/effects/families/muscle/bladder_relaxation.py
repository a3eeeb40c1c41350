"""Rubber that is stretched gives way with time."""

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter, FloatSequence
from klute_sim.effects.smoothing import step_follower
from klute_sim.laws.mckibben import Muscle


def maxwell_force(
    p: FloatSequence, state: FloatSequence, force: float, muscle: Muscle, pressure: float, length: float, rate: float
) -> float:
    """Tension [N]: ``+ n k (x - s)``, x the length beyond rest, s the relaxed one."""
    return force + muscle.n_actuators * p[0] * (length - muscle.resting_length - state[0])


def step_relaxed_length(
    p: FloatSequence, state: FloatSequence, muscle: Muscle, pressure: float, length: float, stretch: float, dt: float
) -> tuple[float]:
    """``ds/dt = (x - s) / tau``."""
    return (step_follower(state[0], length - muscle.resting_length, p[1], dt),)


BLADDER_RELAXATION = Effect(
    name="bladder_relaxation",
    description="After a change of length the bladder's tension creeps towards its long-term value.",
    kind="device",
    forms=(
        EffectForm(
            name="maxwell",
            equation="F += n k (x - s), ds/dt = (x - s)/tau",
            parameters=(
                EffectParameter(
                    key="stiffness_n_per_mm",
                    neutral=0.0,
                    lower=0.0,
                    upper=50.0,
                    typical=3.0,
                    source="assumed: natural rubber gives way by a few percent per decade of time",
                ),
                EffectParameter(
                    key="time_constant_s",
                    neutral=None,
                    lower=0.02,
                    upper=100.0,
                    typical=1.0,
                    source="assumed: what a bench trial of seconds can show",
                ),
            ),
            laws={"muscle_force": maxwell_force, "remember": step_relaxed_length},
            n_states=1,
        ),
    ),
)
