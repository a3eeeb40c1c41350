"""The muscle pulls more when it is warm, and it warms up under pressure."""

import math

import klute_sim as ks


def step_warmth(p, state, muscle, pressure, pressure_change, length, stretch, dt):
    decay = math.exp(-dt / p.time_constant)
    return (decay * state.warmth + (1.0 - decay) * pressure / 1e5,)


@ks.effect(
    name="warming",
    description="The muscle gets stronger as it warms up under pressure.",
    form="first_order",
    equation="F (1 + a s), ds/dt = (P / 1 bar - s)/tau",
    parameters=(
        ks.EffectParameter(key="gain", neutral=0.0, lower=0.0, upper=0.5, typical=0.02, source="assumed"),
        ks.EffectParameter(key="time_constant_s", neutral=None, lower=0.1, upper=9.0, typical=1.0, source="assumed"),
    ),
    states=("warmth",),
    next_state=step_warmth,
    hook="muscle_force",
)
def warm_force(p, state, force, muscle, pressure, length, velocity):
    return force * (1.0 + p.gain * state.warmth)
