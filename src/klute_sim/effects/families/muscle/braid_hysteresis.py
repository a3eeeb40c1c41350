"""Dry friction between the threads of the braid: it resists motion either way and grows with pressure."""

import math

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter, FloatSequence
from klute_sim.effects.smoothing import EQUILIBRIUM_TIME_STEP, smooth_sign, step_slider
from klute_sim.laws.mckibben import Muscle

FRICTION_FRACTIONS = (1.0 / 6.0, 2.0 / 6.0, 3.0 / 6.0)
"""Of the friction, carried by the three elements of :func:`slip` (assumed); their stiffnesses are equal."""


def coulomb_friction(
    p: FloatSequence, state: FloatSequence, force: float, muscle: Muscle, pressure: float, length: float, rate: float
) -> float:
    """Tension [N]: ``+ n slope P sign(v)``."""
    return force + muscle.n_actuators * p[0] * pressure * smooth_sign(rate)


def _slip_stretch(p: FloatSequence, pressure: float, fraction: float) -> float:
    """How far an element stretches before it slips [m]."""
    return 3.0 * fraction * p[0] * pressure / p[1]


def maxwell_slip_force(
    p: FloatSequence, state: FloatSequence, force: float, muscle: Muscle, pressure: float, length: float, rate: float
) -> float:
    """Tension [N]: ``+ n sum k/3 (x - a_i)`` of three springs on sliders at ``a_i``, x the length beyond rest."""
    x = length - muscle.resting_length
    return force + muscle.n_actuators * p[1] / 3.0 * (3.0 * x - state[0] - state[1] - state[2])


def step_sliders(
    p: FloatSequence, state: FloatSequence, muscle: Muscle, pressure: float, length: float, stretch: float, dt: float
) -> tuple[float, float, float]:
    """Slider ``i`` follows when its spring carries more than its share of ``n slope P``.

    Elements of constant stiffness whose slip force follows the pressure are passive whatever the pressure does.
    """
    x = length - muscle.resting_length
    return (
        step_slider(state[0], x, _slip_stretch(p, pressure, FRICTION_FRACTIONS[0]), dt),
        step_slider(state[1], x, _slip_stretch(p, pressure, FRICTION_FRACTIONS[1]), dt),
        step_slider(state[2], x, _slip_stretch(p, pressure, FRICTION_FRACTIONS[2]), dt),
    )


def bouc_wen_force(
    p: FloatSequence, state: FloatSequence, force: float, muscle: Muscle, pressure: float, length: float, rate: float
) -> float:
    """Tension [N]: ``+ n k u``, u the hysteretic stretch."""
    return force + muscle.n_actuators * p[1] * state[0]


def step_bouc_wen(
    p: FloatSequence, state: FloatSequence, muscle: Muscle, pressure: float, length: float, stretch: float, dt: float
) -> tuple[float, float]:
    """``du/dx = 1 - u sign(dx) / r`` with ``r = slope P / k``, solved over the step: u goes to r sign(dx).

    The model of Bouc and Wen with an exponent of 1 and equal shape constants. The stiffness is constant and the limit
    follows the pressure, so that it takes ``k u^2 |dx| / r`` and gives nothing, whatever the pressure does.
    """
    x = length - muscle.resting_length
    moved, reach = x - state[1], p[0] * pressure / p[1]
    if dt >= EQUILIBRIUM_TIME_STEP:
        return 0.0, x
    if moved == 0.0:
        return state[0], x
    if reach <= 0.0:
        return 0.0, x
    limit = math.copysign(reach, moved)
    return limit + (state[0] - limit) * math.exp(-abs(moved) / reach), x


_SLOPE_PARAMETER = EffectParameter(
    key="slope_n_per_bar",
    neutral=0.0,
    lower=0.0,
    upper=60.0,
    typical=8.0,
    source="assumed: a few percent of the tension, as Tondu 2012 (doi 10.1177/1045389X11435435) has it",
)

BRAID_HYSTERESIS = Effect(
    name="braid_hysteresis",
    description="Threads of the braid rub on each other: less tension while shortening, more while lengthening.",
    kind="device",
    forms=(
        EffectForm(
            name="coulomb",
            equation="F += n slope P sign(v)",
            parameters=(_SLOPE_PARAMETER,),
            laws={"muscle_force": coulomb_friction},
        ),
        EffectForm(
            name="maxwell_slip",
            equation="F += n sum_i k/3 (x - a_i), each slipping at its share of n slope P",
            parameters=(
                _SLOPE_PARAMETER,
                EffectParameter(
                    key="stiffness_n_per_mm",
                    neutral=None,
                    lower=1.0,
                    upper=500.0,
                    typical=40.0,
                    source="assumed: friction turns round within about a millimetre",
                ),
            ),
            laws={"muscle_force": maxwell_slip_force, "remember": step_sliders},
            n_states=3,
        ),
        EffectForm(
            name="bouc_wen",
            equation="F += n k u, du/dx = 1 - u sign(dx)/r, r = slope P / k",
            parameters=(
                _SLOPE_PARAMETER,
                EffectParameter(
                    key="stiffness_n_per_mm",
                    neutral=None,
                    lower=1.0,
                    upper=500.0,
                    typical=40.0,
                    source="assumed: friction turns round within about a millimetre",
                ),
            ),
            laws={"muscle_force": bouc_wen_force, "remember": step_bouc_wen},
            n_states=2,
        ),
    ),
)
