"""Effects of the tendon: play before it pulls, and a loss between pulling and letting go."""

from klute_sim.effects.effect import Effect, Form, Numbers, Parameter
from klute_sim.effects.smooth import dragged, followed
from klute_sim.laws.mckibben import Muscle

REACH = 3e-4
"""Stretch [m] within which the loss turns round (assumed)."""


def slack(own: Numbers, memory: Numbers, stretch: float) -> float:
    """Stretch [m]: less by the dead length."""
    return stretch - own[0]


def stiffened(own: Numbers, memory: Numbers, force: float, stretch: float) -> float:
    """Tension [N]: ``+ c x^2`` while taut, x the stretch beyond slack."""
    if stretch <= 0.0:
        return force
    return force + own[0] * stretch * stretch


def slip(own: Numbers, memory: Numbers, force: float, stretch: float) -> float:
    """Tension [N]: ``F (1 + eta (x - a) / reach)``, the slider ``a`` at most ``reach`` behind the stretch ``x``."""
    return force * (1.0 + own[0] * (stretch - memory[0]) / REACH)


def slider(
    own: Numbers, memory: Numbers, muscle: Muscle, pressure: float, length: float, stretch: float, step: float
) -> tuple[float]:
    """The slider follows when it is pulled."""
    return (dragged(memory[0], stretch, REACH, step),)


def maxwell(own: Numbers, memory: Numbers, force: float, stretch: float) -> float:
    """Tension [N]: ``+ k (x - s)`` while the tendon is taut, s the relaxed stretch."""
    if stretch <= 0.0:
        return force
    return force + own[0] * (stretch - memory[0])


def relaxed(
    own: Numbers, memory: Numbers, muscle: Muscle, pressure: float, length: float, stretch: float, step: float
) -> tuple[float]:
    """``ds/dt = (x - s) / tau``; a slack tendon relaxes to slack."""
    return (followed(memory[0], max(0.0, stretch), own[1], step),)


HYSTERESIS = Effect(
    name="tendon_hysteresis",
    sentence="The tendon gives back less than it took: more tension while stretching, less while shortening.",
    kind="device",
    forms=(
        Form(
            name="slip",
            equation="F (1 + eta (x - a)/d), slider a within d = 0.3 mm of the stretch x",
            parameters=(
                Parameter(
                    key="loss_fraction",
                    neutral=0.0,
                    low=0.0,
                    high=0.5,
                    typical=0.06,
                    source="Achilles tendons lose 5-10 % (Peltonen 2013)",
                ),
            ),
            laws={"tendon_force": slip, "remember": slider},
            memory=1,
        ),
        Form(
            name="maxwell",
            equation="F += k (x - s) while taut, ds/dt = (max(0, x) - s)/tau",
            parameters=(
                Parameter(
                    key="stiffness_n_per_mm",
                    neutral=0.0,
                    low=0.0,
                    high=200.0,
                    typical=10.0,
                    source="assumed: a tenth of the springs' stiffness",
                ),
                Parameter(
                    key="time_constant_s",
                    neutral=None,
                    low=0.01,
                    high=10.0,
                    typical=0.3,
                    source="assumed: what a bench trial of seconds can show",
                ),
            ),
            laws={"tendon_force": maxwell, "remember": relaxed},
            memory=1,
        ),
    ),
)

STIFFENING = Effect(
    name="tendon_stiffening",
    sentence="The tendon's springs stiffen as they are stretched: more tension than their two lines say.",
    kind="device",
    forms=(
        Form(
            name="quadratic",
            equation="F += c x^2 while taut",
            parameters=(
                Parameter(
                    key="stiffening_n_per_mm2",
                    neutral=0.0,
                    low=0.0,
                    high=100.0,
                    typical=2.0,
                    source="assumed: a tenth more tension at a stretch of 10 mm",
                ),
            ),
            laws={"tendon_force": stiffened},
        ),
    ),
)

SLACK = Effect(
    name="tendon_slack",
    sentence="There is play in the tendon's attachment: it pulls only after a dead length.",
    kind="device",
    forms=(
        Form(
            name="dead_length",
            equation="F(x - slack)",
            parameters=(
                Parameter(
                    key="slack_mm",
                    neutral=0.0,
                    low=0.0,
                    high=20.0,
                    typical=1.5,
                    source="assumed: a millimetre or two of play is hardly seen",
                ),
            ),
            laws={"tendon_stretch": slack},
        ),
    ),
)
