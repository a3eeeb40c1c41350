"""Effects of the tendon: play at its attachment, stiffening and hysteresis."""

import math
from typing import Any

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.effects.smoothing import FRICTION_FRACTIONS, pull_slider, step_follower, step_slider
from klute_sim.laws.mckibben import MuscleParameters
from klute_sim.laws.tendon import TendonParameters

SLIDER_REACH = 5e-5
"""Half the stretch over which the hysteresis changes its sign after a reversal [m].

Assumed: so short that a cycle from slack to 12 mm loses the stated fraction within 2 %.
"""


def subtract_slack(p: Any, state: Any, stretch: float) -> float:
    """Return the stretch [m] minus the dead length."""
    return stretch - p.slack


def stiffening_force(p: Any, state: Any, force: float, stretch: float, tendon: TendonParameters) -> float:
    """Return the tension [N] plus ``c x^2`` while taut, with x the stretch beyond slack length."""
    if stretch <= 0.0:
        return force
    return force + p.stiffening * stretch * stretch


def gradual_engagement_force(p: Any, state: Any, force: float, stretch: float, tendon: TendonParameters) -> float:
    """Return the tension [N] with a second spring that joins gradually around its engagement stretch x0.

    In place of ``k2 max(0, x - x0)`` it carries ``k2 w (ln(1 + exp((x - x0)/w)) - ln(1 + exp(-x0/w)))``: nothing at
    slack length, and its slope is k2 from a few transition stretches w beyond x0 on. The tension is a function of the
    stretch alone, so it is passive.
    """
    if stretch <= 0.0 or p.transition <= 0.0:
        return force
    offset = math.log1p(math.exp(-tendon.engagement_stretch / p.transition))
    distance = abs(stretch - tendon.engagement_stretch) / p.transition
    return force + tendon.stiffness_2 * p.transition * (math.log1p(math.exp(-distance)) - offset)


def slip_force(p: Any, state: Any, force: float, stretch: float, tendon: TendonParameters) -> float:
    """Return ``F (1 + h (x - a) / d)`` [N], with the slider a at most d = 0.05 mm behind the stretch x.

    Loading takes the work W (1 + h) and unloading returns W (1 - h), so ``h = eta / (2 - eta)`` loses the fraction eta
    of the loading work.
    """
    half_width = p.loss_fraction / (2.0 - p.loss_fraction)
    return force * (1.0 + half_width * (stretch - state.slider) / SLIDER_REACH)


def step_slip_slider(
    p: Any,
    state: Any,
    muscle: MuscleParameters,
    pressure: float,
    pressure_change: float,
    length: float,
    stretch: float,
    dt: float,
) -> tuple[float]:
    """Return the slider's position [m] after the step."""
    return (step_slider(state.slider, stretch, SLIDER_REACH, dt),)


def maxwell_force(p: Any, state: Any, force: float, stretch: float, tendon: TendonParameters) -> float:
    """Return the tension [N] plus ``k (x - s)`` while taut, with s the relaxed stretch."""
    if stretch <= 0.0:
        return force
    return force + p.stiffness * (stretch - state.relaxed_stretch)


def step_relaxed_stretch(
    p: Any,
    state: Any,
    muscle: MuscleParameters,
    pressure: float,
    pressure_change: float,
    length: float,
    stretch: float,
    dt: float,
) -> tuple[float]:
    """Return the relaxed stretch [m] after the step: ``ds/dt = (x - s) / tau``; a slack tendon relaxes to 0."""
    return (step_follower(state.relaxed_stretch, max(0.0, stretch), p.time_constant, dt),)


def viscous_force(p: Any, state: Any, force: float, stretch: float, tendon: TendonParameters) -> float:
    """Return the tension [N] plus ``c dx/dt`` while taut: a damper parallel to the springs.

    This is the model of Kelvin and Voigt (Fung, Biomechanics, Springer, 1993, chapter 2; quoted from memory). Where the
    sum is negative, the tendon does not push: the device clips its tension at 0, which is passive, too.
    """
    if stretch <= 0.0:
        return force
    return force + p.damping * state.stretch_rate


def step_stretch_rate(
    p: Any,
    state: Any,
    muscle: MuscleParameters,
    pressure: float,
    pressure_change: float,
    length: float,
    stretch: float,
    dt: float,
) -> tuple[float, float]:
    """Return the rate [m/s] of the taut stretch ``max(0, x)`` in the step, and the taut stretch [m] after it.

    The rate is that of the step itself (backward Euler), so the damper is stable at any step under a prescribed length.
    A tendon that becomes taut within the step begins at 0, so the tension is continuous in the stretch. On a model's
    free foot the damper acts a step late: with steps of 1 ms the default device chatters in gait at 20 N·s/mm, not at
    10; with those of 0.5 ms not even at 200 (measured by the residual of the energy balance: 6 %, else below 0.03 %).
    """
    taut_stretch = max(0.0, stretch)
    return (taut_stretch - state.taut_stretch) / dt, taut_stretch


def maxwell_slip_force(p: Any, state: Any, force: float, stretch: float, tendon: TendonParameters) -> float:
    """Return the tension [N] plus ``k sum (x - a_i)`` while taut, ``k = F_f/(2d)``: three equal springs on sliders.

    The springs pull their sliders at stretches of d/3, 2d/3 and d, so beyond a stretch of d they carry the dry
    friction F_f. Many layers of rubber or composite, or the strands of a cable, slide one after the other in this way
    (Iwan, J. Applied Mechanics 33:893, 1966). A short d is Coulomb friction; a long one yields gradually.

    The loss does not depend on the speed: a settled cycle of amplitude A loses ``4 sum k y_i max(0, A - y_i)`` with
    ``y_i = d i/3``, so nothing below d/3 and ``4 F_f (A - 7d/9)`` above d. A reversal begins a branch that is the
    virgin curve at twice its size (Masing), and a minor loop returns to the branch that it left.

    Passive: of the work on an element, ``d(k (x - a_i)^2 / 2)`` is stored and ``k y_i |da_i|`` is lost. Where the
    friction holds the springs back, the device clips the tension at 0. This does not change the order of the branches,
    so every closed loop still loses. No slider is below 0, so the tension is continuous where the tendon becomes slack.
    """
    if stretch <= 0.0:
        return force
    stiffness = 0.5 * p.friction / p.presliding
    return force + stiffness * (3.0 * stretch - state.slider_1 - state.slider_2 - state.slider_3)


def step_tendon_sliders(
    p: Any,
    state: Any,
    muscle: MuscleParameters,
    pressure: float,
    pressure_change: float,
    length: float,
    stretch: float,
    dt: float,
) -> tuple[float, float, float]:
    """Return the slider positions [m] after the step: within d/3, 2d/3 and d of the stretch, at rest while slack.

    The sliders of a tendon at rest have not relaxed, unlike those of other effects: it was pulled from slack to its
    stretch x, so they are at ``max(0, x - y_i)``, and it begins on its virgin curve. That is how a record of a foot or
    a cable begins that is under a preload.
    """
    x = max(0.0, stretch)
    return (
        pull_slider(state.slider_1, x, 2.0 * FRICTION_FRACTIONS[0] * p.presliding),
        pull_slider(state.slider_2, x, 2.0 * FRICTION_FRACTIONS[1] * p.presliding),
        pull_slider(state.slider_3, x, 2.0 * FRICTION_FRACTIONS[2] * p.presliding),
    )


TENDON_HYSTERESIS = Effect(
    name="tendon_hysteresis",
    description="The tendon dissipates energy: more tension while stretching, less while shortening.",
    kind="device",
    forms=(
        EffectForm(
            name="slip",
            equation="F (1 + eta/(2 - eta) (x - a)/d), slider a within d = 0.05 mm of the stretch x",
            parameters=(
                EffectParameter(
                    key="loss_fraction",
                    neutral=0.0,
                    lower=0.0,
                    upper=0.5,
                    typical=0.05,
                    source="fraction of the loading work; human Achilles tendon 5 +- 2 % (Peltonen 2013, abstract)",
                ),
            ),
            laws={"tendon_force": slip_force, "next_state": step_slip_slider},
            states=("slider",),
            holds_friction=True,
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
                    source="assumed: observable in a bench trial of a few seconds",
                ),
            ),
            laws={"tendon_force": maxwell_force, "next_state": step_relaxed_stretch},
            states=("relaxed_stretch",),
        ),
        EffectForm(
            name="viscous",
            equation="F += c dx/dt while taut",
            parameters=(
                EffectParameter(
                    key="damping_n_s_per_mm",
                    neutral=0.0,
                    lower=0.0,
                    upper=200.0,
                    typical=1.0,
                    source="assumed: in a sine of 1 Hz from slack, springs of 100 N/mm lose 10 % of the loading work; "
                    "cycles of 20 s lose as much with 20 times this damping",
                ),
            ),
            laws={"tendon_force": viscous_force, "next_state": step_stretch_rate},
            states=("stretch_rate", "taut_stretch"),
        ),
        EffectForm(
            name="maxwell_slip",
            equation="F += F_f/(2d) sum_i (x - a_i) while taut, slider a_i within d/3 or 2d/3 or d of the stretch x, "
            "at rest as if pulled from slack",
            parameters=(
                EffectParameter(
                    key="friction_n",
                    neutral=0.0,
                    lower=0.0,
                    upper=1000.0,
                    typical=20.0,
                    source="assumed: from slack to 12 mm, springs of 100 N/mm lose 5 % of the loading work",
                ),
                EffectParameter(
                    key="presliding_mm",
                    neutral=None,
                    lower=0.02,
                    upper=50.0,
                    typical=1.0,
                    source="assumed: the layers of a foot or tendon slide one after the other over a millimetre",
                ),
            ),
            laws={"tendon_force": maxwell_slip_force, "next_state": step_tendon_sliders},
            states=("slider_1", "slider_2", "slider_3"),
            holds_friction=True,
        ),
    ),
)

TENDON_STIFFENING = Effect(
    name="tendon_stiffening",
    description="The tendon's springs stiffen with stretch, or the second one joins gradually: no two linear segments.",
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
                    source="assumed: 10 % more tension at a stretch of 10 mm",
                ),
            ),
            laws={"tendon_force": stiffening_force},
        ),
        EffectForm(
            name="gradual_engagement",
            equation="F += k2 w (ln(1 + exp(-|x - x0|/w)) - ln(1 + exp(-x0/w))) while taut, spring k2 joins at x0",
            parameters=(
                EffectParameter(
                    key="transition_mm",
                    neutral=0.0,
                    lower=0.0,
                    upper=10.0,
                    typical=0.5,
                    source="assumed: the coils or strands of the second spring take up their load one after the other",
                ),
            ),
            laws={"tendon_force": gradual_engagement_force},
        ),
    ),
)

TENDON_SLACK = Effect(
    name="tendon_slack",
    description="The tendon's attachment has play: the tendon pulls only after a dead length.",
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
                    source="assumed: 1 to 2 mm of play is hardly visible",
                ),
            ),
            laws={"tendon_stretch": subtract_slack},
        ),
    ),
)
