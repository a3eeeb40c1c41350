"""Dry friction between the threads of the braid: it resists motion either way and grows with pressure."""

import math

from klute_sim.effects.effect import Effect, Form, Numbers, Parameter
from klute_sim.effects.smooth import LONG, dragged, sign
from klute_sim.laws.mckibben import Muscle

SHARES = (1.0 / 6.0, 2.0 / 6.0, 3.0 / 6.0)
"""Of the friction, carried by the three elements of :func:`slip` (assumed); their stiffnesses are equal."""


def coulomb(
    own: Numbers, memory: Numbers, force: float, muscle: Muscle, pressure: float, length: float, rate: float
) -> float:
    """Tension [N]: ``+ n slope P sign(v)``."""
    return force + muscle.actuators * own[0] * pressure * sign(rate)


def _reach(own: Numbers, pressure: float, share: float) -> float:
    """How far an element stretches before it slips [m]."""
    return 3.0 * share * own[0] * pressure / own[1]


def slip(
    own: Numbers, memory: Numbers, force: float, muscle: Muscle, pressure: float, length: float, rate: float
) -> float:
    """Tension [N]: ``+ n sum k/3 (x - a_i)`` of three springs on sliders at ``a_i``, x the length beyond rest."""
    x = length - muscle.resting_length
    return force + muscle.actuators * own[1] / 3.0 * (3.0 * x - memory[0] - memory[1] - memory[2])


def dragged_sliders(
    own: Numbers, memory: Numbers, muscle: Muscle, pressure: float, length: float, stretch: float, step: float
) -> tuple[float, float, float]:
    """Slider ``i`` follows when its spring carries more than its share of ``n slope P``.

    Elements of constant stiffness whose slip force follows the pressure are passive whatever the pressure does.
    """
    x = length - muscle.resting_length
    return (
        dragged(memory[0], x, _reach(own, pressure, SHARES[0]), step),
        dragged(memory[1], x, _reach(own, pressure, SHARES[1]), step),
        dragged(memory[2], x, _reach(own, pressure, SHARES[2]), step),
    )


def hysteretic(
    own: Numbers, memory: Numbers, force: float, muscle: Muscle, pressure: float, length: float, rate: float
) -> float:
    """Tension [N]: ``+ n k u``, u the hysteretic stretch."""
    return force + muscle.actuators * own[1] * memory[0]


def stretched(
    own: Numbers, memory: Numbers, muscle: Muscle, pressure: float, length: float, stretch: float, step: float
) -> tuple[float, float]:
    """``du/dx = 1 - u sign(dx) / r`` with ``r = slope P / k``, solved over the step: u goes to r sign(dx).

    The model of Bouc and Wen with an exponent of 1 and equal shape constants. The stiffness is constant and the limit
    follows the pressure, so that it takes ``k u^2 |dx| / r`` and gives nothing, whatever the pressure does.
    """
    x = length - muscle.resting_length
    moved, reach = x - memory[1], own[0] * pressure / own[1]
    if step >= LONG:
        return 0.0, x
    if moved == 0.0:
        return memory[0], x
    if reach <= 0.0:
        return 0.0, x
    limit = math.copysign(reach, moved)
    return limit + (memory[0] - limit) * math.exp(-abs(moved) / reach), x


_SLOPE = Parameter(
    key="slope_n_per_bar",
    neutral=0.0,
    low=0.0,
    high=60.0,
    typical=8.0,
    source="assumed: a few percent of the tension, as Tondu 2012 (doi 10.1177/1045389X11435435) has it",
)

EFFECT = Effect(
    name="braid_hysteresis",
    sentence="Threads of the braid rub on each other: less tension while shortening, more while lengthening.",
    kind="device",
    forms=(
        Form(name="coulomb", equation="F += n slope P sign(v)", parameters=(_SLOPE,), laws={"muscle_force": coulomb}),
        Form(
            name="maxwell_slip",
            equation="F += n sum_i k/3 (x - a_i), each slipping at its share of n slope P",
            parameters=(
                _SLOPE,
                Parameter(
                    key="stiffness_n_per_mm",
                    neutral=None,
                    low=1.0,
                    high=500.0,
                    typical=40.0,
                    source="assumed: friction turns round within about a millimetre",
                ),
            ),
            laws={"muscle_force": slip, "remember": dragged_sliders},
            memory=3,
        ),
        Form(
            name="bouc_wen",
            equation="F += n k u, du/dx = 1 - u sign(dx)/r, r = slope P / k",
            parameters=(
                _SLOPE,
                Parameter(
                    key="stiffness_n_per_mm",
                    neutral=None,
                    low=1.0,
                    high=500.0,
                    typical=40.0,
                    source="assumed: friction turns round within about a millimetre",
                ),
            ),
            laws={"muscle_force": hysteretic, "remember": stretched},
            memory=2,
        ),
    ),
)
