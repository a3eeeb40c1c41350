"""A user's own effect: the muscle is a little stronger when warm, and warms up while it works."""

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.effects.smoothing import step_follower


def warm(own, memory, force, muscle, pressure, length, rate):
    return force * (1.0 + own[0] * memory[0])


def warming(own, memory, muscle, pressure, length, stretch, step):
    return (step_follower(memory[0], pressure / 1e5, own[1], step),)


EFFECTS = [
    Effect(
        name="warming",
        description="The muscle gets stronger as it warms up under pressure.",
        kind="device",
        forms=(
            EffectForm(
                name="first_order",
                equation="F (1 + a s), ds/dt = (P / 1 bar - s)/tau",
                parameters=(
                    EffectParameter(key="gain", neutral=0.0, lower=0.0, upper=0.5, typical=0.02, source="assumed"),
                    EffectParameter(
                        key="time_constant_s", neutral=None, lower=0.1, upper=9.0, typical=1.0, source="assumed"
                    ),
                ),
                laws={"muscle_force": warm, "remember": warming},
                n_states=1,
            ),
        ),
    )
]
