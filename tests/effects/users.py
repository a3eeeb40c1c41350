"""A user's own effect: the muscle is a little stronger when warm, and warms up while it works."""

from klute_sim.effects.effect import Effect, Form, Parameter
from klute_sim.effects.smooth import followed


def warm(own, memory, force, muscle, pressure, length, rate):
    return force * (1.0 + own[0] * memory[0])


def warming(own, memory, muscle, pressure, length, stretch, step):
    return (followed(memory[0], pressure / 1e5, own[1], step),)


EFFECTS = [
    Effect(
        name="warming",
        sentence="The muscle gets stronger as it warms up under pressure.",
        kind="device",
        forms=(
            Form(
                name="first_order",
                equation="F (1 + a s), ds/dt = (P / 1 bar - s)/tau",
                parameters=(
                    Parameter(key="gain", neutral=0.0, low=0.0, high=0.5, typical=0.02, source="assumed"),
                    Parameter(key="time_constant_s", neutral=None, low=0.1, high=9.0, typical=1.0, source="assumed"),
                ),
                laws={"muscle_force": warm, "remember": warming},
                memory=1,
            ),
        ),
    )
]
