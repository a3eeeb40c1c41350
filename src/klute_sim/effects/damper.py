"""Effects of the hydraulic damper: what a real piston and a real orifice add to the design's ``c v|v|``."""

import math

from klute_sim.effects.effect import Effect, Form, Numbers, Parameter
from klute_sim.effects.smooth import dragged, sign
from klute_sim.laws.mckibben import Muscle


def discharged(own: Numbers, memory: Numbers, force: float, rate: float) -> float:
    """Tension [N]: ``c v|v| / Cd^2``, from (4.6) with the 1 beside (bore/orifice)^4 neglected (5e-6 of it)."""
    return force / (own[0] * own[0])


def laminar(own: Numbers, memory: Numbers, force: float, rate: float) -> float:
    """Tension [N]: ``c v sqrt(v^2 + vc^2)``: linear below the transition speed, quadratic above."""
    speed = abs(rate)
    if own[0] == 0.0 or speed == 0.0:
        return force
    return force / speed * math.sqrt(speed * speed + own[0] * own[0])


def rubbed(own: Numbers, memory: Numbers, force: float, rate: float) -> float:
    """Tension [N]: ``+ F sign(v)``."""
    return force + own[0] * sign(rate)


def stribeck(own: Numbers, memory: Numbers, force: float, rate: float) -> float:
    """Tension [N]: ``+ F (1 + stick exp(-(v/vs)^2)) sign(v)``, the bracket as of the step before.

    It falls with speed, so with the speed of the same step two forces could balance; a step late there is one.
    """
    return force + own[0] * (1.0 + own[1] * (1.0 - memory[0])) * sign(rate)


def loosened(
    own: Numbers, memory: Numbers, muscle: Muscle, pressure: float, length: float, stretch: float, step: float
) -> tuple[float, float, float]:
    """What the speed before has taken off the peak [1], the speed now [m/s], and the length beyond rest [m]."""
    x = length - muscle.resting_length
    return 1.0 - math.exp(-((memory[1] / own[2]) * (memory[1] / own[2]))), abs(x - memory[2]) / step, x


def cushioned(own: Numbers, memory: Numbers, force: float, rate: float) -> float:
    """Tension [N]: none at a reversal, more the further the piston has come since, all after the dead stroke."""
    if own[0] <= 0.0:
        return force
    engaged = memory[1] if rate > 0.0 else -memory[1]
    return force * 0.5 * (1.0 + engaged)


def compressed(
    own: Numbers, memory: Numbers, muscle: Muscle, pressure: float, length: float, stretch: float, step: float
) -> tuple[float, float]:
    """A slider half a dead stroke behind the piston, and which end of it the piston is at, -1 to 1."""
    x, half = length - muscle.resting_length, 0.5 * own[0]
    if half <= 0.0:
        return 0.0, 0.0
    slider = dragged(memory[0], x, half, step)
    return slider, (x - slider) / half


DISCHARGE = Effect(
    name="discharge_loss",
    sentence="The jet behind a sharp-edged orifice contracts: the damper is stronger than its design.",
    kind="device",
    forms=(
        Form(
            name="constant",
            equation="orifice force / Cd^2",
            parameters=(
                Parameter(
                    key="discharge_coefficient",
                    neutral=1.0,
                    low=0.4,
                    high=1.0,
                    typical=0.7,
                    source="dissertation chapter 4: as low as 0.61 in reality, 1 in the design",
                ),
            ),
            laws={"damper_force": discharged},
        ),
    ),
)

LAMINAR = Effect(
    name="laminar_orifice",
    sentence="At low speed the oil flows in layers: the damper is linear there, and stronger than the square.",
    kind="device",
    forms=(
        Form(
            name="smooth",
            equation="c v sqrt(v^2 + vc^2)",
            parameters=(
                Parameter(
                    key="transition_speed_mm_per_s",
                    neutral=0.0,
                    low=0.0,
                    high=500.0,
                    typical=40.0,
                    source="assumed: an orifice of 1 mm passes its critical Reynolds number at tens of mm/s of piston",
                ),
            ),
            laws={"damper_force": laminar},
        ),
    ),
)

SEAL = Effect(
    name="seal_friction",
    sentence="The piston's seal rubs: a constant force against the motion, whatever the pressure.",
    kind="device",
    forms=(
        Form(
            name="coulomb",
            equation="F += F_seal sign(v)",
            parameters=(
                Parameter(
                    key="force_n",
                    neutral=0.0,
                    low=0.0,
                    high=200.0,
                    typical=15.0,
                    source="pneumatic cylinder seals measured at 7-21 N",
                ),
            ),
            laws={"damper_force": rubbed},
        ),
        Form(
            name="stribeck",
            equation="F += F_seal (1 + stick exp(-(v/vs)^2)) sign(v)",
            parameters=(
                Parameter(
                    key="force_n",
                    neutral=0.0,
                    low=0.0,
                    high=200.0,
                    typical=15.0,
                    source="pneumatic cylinder seals measured at 7-21 N",
                ),
                Parameter(
                    key="stick_fraction",
                    neutral=None,
                    low=0.05,
                    high=3.0,
                    typical=0.6,
                    source="assumed: seals break away at half as much again",
                ),
                Parameter(
                    key="stribeck_speed_mm_per_s",
                    neutral=None,
                    low=1.0,
                    high=200.0,
                    typical=15.0,
                    source="assumed: a lubricating film builds up within tens of mm/s",
                ),
            ),
            laws={"damper_force": stribeck, "remember": loosened},
            memory=3,
        ),
    ),
)

AIR = Effect(
    name="trapped_air",
    sentence="Air in the damper's oil, or play at its ends: after each reversal it brakes only after a dead stroke.",
    kind="device",
    forms=(
        Form(
            name="dead_stroke",
            equation="orifice force times (1 + e)/2, e from -1 at a reversal to 1 after the stroke",
            parameters=(
                Parameter(
                    key="stroke_mm",
                    neutral=0.0,
                    low=0.0,
                    high=20.0,
                    typical=3.0,
                    source="assumed: a bubble of one cubic centimetre under a piston of 20 mm",
                ),
            ),
            laws={"damper_force": cushioned, "remember": compressed},
            memory=2,
        ),
    ),
)
