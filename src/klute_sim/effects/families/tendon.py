"""Effects of the tendon: play before it pulls, and a loss between pulling and letting go."""

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter, FloatSequence
from klute_sim.effects.smoothing import step_follower, step_slider
from klute_sim.laws.mckibben import Muscle

SLIDER_REACH = 3e-4
"""Stretch [m] within which the loss turns round (assumed)."""


def subtract_slack(p: FloatSequence, state: FloatSequence, stretch: float) -> float:
    """Stretch [m]: less by the dead length."""
    return stretch - p[0]


def stiffening_force(p: FloatSequence, state: FloatSequence, force: float, stretch: float) -> float:
    """Tension [N]: ``+ c x^2`` while taut, x the stretch beyond slack."""
    if stretch <= 0.0:
        return force
    return force + p[0] * stretch * stretch


def slip_force(p: FloatSequence, state: FloatSequence, force: float, stretch: float) -> float:
    """Tension [N]: ``F (1 + eta (x - a) / reach)``, the slider ``a`` at most ``reach`` behind the stretch ``x``."""
    return force * (1.0 + p[0] * (stretch - state[0]) / SLIDER_REACH)


def step_slip_slider(
    p: FloatSequence, state: FloatSequence, muscle: Muscle, pressure: float, length: float, stretch: float, dt: float
) -> tuple[float]:
    """The slider follows when it is pulled."""
    return (step_slider(state[0], stretch, SLIDER_REACH, dt),)


def maxwell_force(p: FloatSequence, state: FloatSequence, force: float, stretch: float) -> float:
    """Tension [N]: ``+ k (x - s)`` while the tendon is taut, s the relaxed stretch."""
    if stretch <= 0.0:
        return force
    return force + p[0] * (stretch - state[0])


def step_relaxed_stretch(
    p: FloatSequence, state: FloatSequence, muscle: Muscle, pressure: float, length: float, stretch: float, dt: float
) -> tuple[float]:
    """``ds/dt = (x - s) / tau``; a slack tendon relaxes to slack."""
    return (step_follower(state[0], max(0.0, stretch), p[1], dt),)


TENDON_HYSTERESIS = Effect(
    name="tendon_hysteresis",
    description="The tendon gives back less than it took: more tension while stretching, less while shortening.",
    kind="device",
    forms=(
        EffectForm(
            name="slip",
            equation="F (1 + eta (x - a)/d), slider a within d = 0.3 mm of the stretch x",
            parameters=(
                EffectParameter(
                    key="loss_fraction",
                    neutral=0.0,
                    lower=0.0,
                    upper=0.5,
                    typical=0.06,
                    source="Achilles tendons lose 5-10 % (Peltonen 2013)",
                ),
            ),
            laws={"tendon_force": slip_force, "remember": step_slip_slider},
            n_states=1,
        ),
        EffectForm(
            name="maxwell",
            equation="F += k (x - s) while taut, ds/dt = (max(0, x) - s)/tau",
            parameters=(
                EffectParameter(
                    key="stiffness_n_per_mm",
                    neutral=0.0,
                    lower=0.0,
                    upper=200.0,
                    typical=10.0,
                    source="assumed: a tenth of the springs' stiffness",
                ),
                EffectParameter(
                    key="time_constant_s",
                    neutral=None,
                    lower=0.01,
                    upper=10.0,
                    typical=0.3,
                    source="assumed: what a bench trial of seconds can show",
                ),
            ),
            laws={"tendon_force": maxwell_force, "remember": step_relaxed_stretch},
            n_states=1,
        ),
    ),
)

TENDON_STIFFENING = Effect(
    name="tendon_stiffening",
    description="The tendon's springs stiffen as they are stretched: more tension than their two lines say.",
    kind="device",
    forms=(
        EffectForm(
            name="quadratic",
            equation="F += c x^2 while taut",
            parameters=(
                EffectParameter(
                    key="stiffening_n_per_mm2",
                    neutral=0.0,
                    lower=0.0,
                    upper=100.0,
                    typical=2.0,
                    source="assumed: a tenth more tension at a stretch of 10 mm",
                ),
            ),
            laws={"tendon_force": stiffening_force},
        ),
    ),
)

TENDON_SLACK = Effect(
    name="tendon_slack",
    description="There is play in the tendon's attachment: it pulls only after a dead length.",
    kind="device",
    forms=(
        EffectForm(
            name="dead_length",
            equation="F(x - slack)",
            parameters=(
                EffectParameter(
                    key="slack_mm",
                    neutral=0.0,
                    lower=0.0,
                    upper=20.0,
                    typical=1.5,
                    source="assumed: a millimetre or two of play is hardly seen",
                ),
            ),
            laws={"tendon_stretch": subtract_slack},
        ),
    ),
)
