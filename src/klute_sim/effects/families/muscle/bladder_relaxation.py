"""Stress relaxation of the bladder's rubber, whose cross-section grows with the diameter (walls equally thick)."""

from typing import Any

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.effects.smoothing import step_follower
from klute_sim.laws.mckibben import MuscleParameters


def maxwell_force(
    p: Any, state: Any, force: float, muscle: MuscleParameters, pressure: float, length: float, velocity: float
) -> float:
    """Return the tension [N] plus ``n k (x - s)``, with x the length beyond rest and s the relaxed length."""
    return force + muscle.n_actuators * p.stiffness * (length - muscle.resting_length - state.relaxed_length)


def step_relaxed_length(
    p: Any,
    state: Any,
    muscle: MuscleParameters,
    pressure: float,
    pressure_change: float,
    length: float,
    stretch: float,
    dt: float,
) -> tuple[float]:
    """Return the relaxed length [m] after the step: ``ds/dt = (x - s) / tau``."""
    return (step_follower(state.relaxed_length, length - muscle.resting_length, p.time_constant, dt),)


BLADDER_RELAXATION = Effect(
    name="bladder_relaxation",
    description="After a change of length the bladder's tension relaxes towards its long-term value.",
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
                    source="assumed: natural rubber relaxes by a few percent per decade of time",
                    diameter_exponent=1.0,
                ),
                EffectParameter(
                    key="time_constant_s",
                    neutral=None,
                    lower=0.02,
                    upper=100.0,
                    typical=1.0,
                    source="assumed: observable in a bench trial of a few seconds",
                ),
            ),
            laws={"muscle_force": maxwell_force, "next_state": step_relaxed_length},
            states=("relaxed_length",),
        ),
    ),
)
