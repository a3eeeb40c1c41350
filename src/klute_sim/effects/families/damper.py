"""Effects of the hydraulic damper: what a real piston and a real orifice add to the design's ``c v|v|``."""

import math

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter, FloatSequence
from klute_sim.effects.smoothing import smooth_sign, step_slider
from klute_sim.laws.mckibben import Muscle


def apply_discharge_loss(p: FloatSequence, state: FloatSequence, force: float, rate: float) -> float:
    """Tension [N]: ``c v|v| / Cd^2``, from (4.6) with the 1 beside (bore/orifice)^4 neglected (5e-6 of it)."""
    return force / (p[0] * p[0])


def laminar_force(p: FloatSequence, state: FloatSequence, force: float, rate: float) -> float:
    """Tension [N]: ``c v sqrt(v^2 + vc^2)``: linear below the transition speed, quadratic above."""
    speed = abs(rate)
    if p[0] == 0.0 or speed == 0.0:
        return force
    return force / speed * math.sqrt(speed * speed + p[0] * p[0])


def seal_friction(p: FloatSequence, state: FloatSequence, force: float, rate: float) -> float:
    """Tension [N]: ``+ F sign(v)``."""
    return force + p[0] * smooth_sign(rate)


def stribeck_friction(p: FloatSequence, state: FloatSequence, force: float, rate: float) -> float:
    """Tension [N]: ``+ F (1 + stick exp(-(v/vs)^2)) sign(v)``, the bracket as of the step before.

    It falls with speed, so with the speed of the same step two forces could balance; a step late there is one.
    """
    return force + p[0] * (1.0 + p[1] * (1.0 - state[0])) * smooth_sign(rate)


def step_stribeck(
    p: FloatSequence, state: FloatSequence, muscle: Muscle, pressure: float, length: float, stretch: float, dt: float
) -> tuple[float, float, float]:
    """What the speed before has taken off the peak [1], the speed now [m/s], and the length beyond rest [m]."""
    x = length - muscle.resting_length
    return 1.0 - math.exp(-((state[1] / p[2]) * (state[1] / p[2]))), abs(x - state[2]) / dt, x


def trapped_air_force(p: FloatSequence, state: FloatSequence, force: float, rate: float) -> float:
    """Tension [N]: none at a reversal, more the further the piston has come since, all after the dead stroke."""
    if p[0] <= 0.0:
        return force
    engaged = state[1] if rate > 0.0 else -state[1]
    return force * 0.5 * (1.0 + engaged)


def step_dead_stroke(
    p: FloatSequence, state: FloatSequence, muscle: Muscle, pressure: float, length: float, stretch: float, dt: float
) -> tuple[float, float]:
    """A slider half a dead stroke behind the piston, and which end of it the piston is at, -1 to 1."""
    x, half = length - muscle.resting_length, 0.5 * p[0]
    if half <= 0.0:
        return 0.0, 0.0
    slider = step_slider(state[0], x, half, dt)
    return slider, (x - slider) / half


DISCHARGE_LOSS = Effect(
    name="discharge_loss",
    description="The jet behind a sharp-edged orifice contracts: the damper is stronger than its design.",
    kind="device",
    forms=(
        EffectForm(
            name="constant",
            equation="orifice force / Cd^2",
            parameters=(
                EffectParameter(
                    key="discharge_coefficient",
                    neutral=1.0,
                    lower=0.4,
                    upper=1.0,
                    typical=0.7,
                    source="dissertation chapter 4: as low as 0.61 in reality, 1 in the design",
                ),
            ),
            laws={"damper_force": apply_discharge_loss},
        ),
    ),
)

LAMINAR_ORIFICE = Effect(
    name="laminar_orifice",
    description="At low speed the oil flows in layers: the damper is linear there, and stronger than the square.",
    kind="device",
    forms=(
        EffectForm(
            name="smooth",
            equation="c v sqrt(v^2 + vc^2)",
            parameters=(
                EffectParameter(
                    key="transition_speed_mm_per_s",
                    neutral=0.0,
                    lower=0.0,
                    upper=500.0,
                    typical=40.0,
                    source="assumed: an orifice of 1 mm passes its critical Reynolds number at tens of mm/s of piston",
                ),
            ),
            laws={"damper_force": laminar_force},
        ),
    ),
)

SEAL_FRICTION = Effect(
    name="seal_friction",
    description="The piston's seal rubs: a constant force against the motion, whatever the pressure.",
    kind="device",
    forms=(
        EffectForm(
            name="coulomb",
            equation="F += F_seal sign(v)",
            parameters=(
                EffectParameter(
                    key="force_n",
                    neutral=0.0,
                    lower=0.0,
                    upper=200.0,
                    typical=15.0,
                    source="pneumatic cylinder seals measured at 7-21 N",
                ),
            ),
            laws={"damper_force": seal_friction},
        ),
        EffectForm(
            name="stribeck",
            equation="F += F_seal (1 + stick exp(-(v/vs)^2)) sign(v)",
            parameters=(
                EffectParameter(
                    key="force_n",
                    neutral=0.0,
                    lower=0.0,
                    upper=200.0,
                    typical=15.0,
                    source="pneumatic cylinder seals measured at 7-21 N",
                ),
                EffectParameter(
                    key="stick_fraction",
                    neutral=None,
                    lower=0.05,
                    upper=3.0,
                    typical=0.6,
                    source="assumed: seals break away at half as much again",
                ),
                EffectParameter(
                    key="stribeck_speed_mm_per_s",
                    neutral=None,
                    lower=1.0,
                    upper=200.0,
                    typical=15.0,
                    source="assumed: a lubricating film builds up within tens of mm/s",
                ),
            ),
            laws={"damper_force": stribeck_friction, "remember": step_stribeck},
            n_states=3,
        ),
    ),
)

TRAPPED_AIR = Effect(
    name="trapped_air",
    description="Air in the damper's oil, or play at its ends: after each reversal it brakes only after a dead stroke.",
    kind="device",
    forms=(
        EffectForm(
            name="dead_stroke",
            equation="orifice force times (1 + e)/2, e from -1 at a reversal to 1 after the stroke",
            parameters=(
                EffectParameter(
                    key="stroke_mm",
                    neutral=0.0,
                    lower=0.0,
                    upper=20.0,
                    typical=3.0,
                    source="assumed: a bubble of one cubic centimetre under a piston of 20 mm",
                ),
            ),
            laws={"damper_force": trapped_air_force, "remember": step_dead_stroke},
            n_states=2,
        ),
    ),
)
