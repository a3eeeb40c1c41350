"""Effects of the hydraulic damper: what a real piston and a real orifice add to the design's ``c v|v|``."""

import math

from klute_sim.effects.effect import Effect, Form, Numbers, Parameter
from klute_sim.effects.smooth import sign


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
    ),
)
