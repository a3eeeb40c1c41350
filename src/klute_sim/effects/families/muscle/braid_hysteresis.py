"""Dry friction between the threads of the braid: it opposes motion in both directions and grows with pressure.

A held muscle keeps its friction in all forms but ``coulomb``, which depends on the velocity alone. In muscles of
different diameters the friction is the same share of the gas tension, and reverses within the same distance (assumed),
so both parameters in newtons grow with the square of the diameter.
"""

from typing import Any

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.effects.smoothing import FRICTION_FRACTIONS, smooth_sign, step_bouc_wen, step_slider
from klute_sim.laws.mckibben import MuscleParameters


def coulomb_friction(
    p: Any, state: Any, force: float, muscle: MuscleParameters, pressure: float, length: float, velocity: float
) -> float:
    """Return the tension [N] plus ``n slope P sign(v)``."""
    return force + muscle.n_actuators * p.slope * pressure * smooth_sign(velocity)


def _slip_stretch(p: Any, pressure: float, fraction: float) -> float:
    """Return the stretch [m] at which an element with this ``fraction`` of the friction slips."""
    return 3.0 * fraction * p.slope * pressure / p.stiffness


def maxwell_slip_force(
    p: Any, state: Any, force: float, muscle: MuscleParameters, pressure: float, length: float, velocity: float
) -> float:
    """Return the tension [N] plus ``n sum k/3 (x - a_i)``: three springs on sliders.

    The length beyond rest is x, and the sliders are at a_i.
    """
    x = length - muscle.resting_length
    return force + muscle.n_actuators * p.stiffness / 3.0 * (3.0 * x - state.slider_1 - state.slider_2 - state.slider_3)


def step_sliders(
    p: Any,
    state: Any,
    muscle: MuscleParameters,
    pressure: float,
    pressure_change: float,
    length: float,
    stretch: float,
    dt: float,
) -> tuple[float, float, float]:
    """Return the slider positions [m] after the step.

    A slider moves when its spring carries more than its fraction of ``n slope P``. Elements of constant stiffness whose
    slip force follows the pressure are passive for any pressure history.
    """
    x = length - muscle.resting_length
    return (
        step_slider(state.slider_1, x, _slip_stretch(p, pressure, FRICTION_FRACTIONS[0]), dt),
        step_slider(state.slider_2, x, _slip_stretch(p, pressure, FRICTION_FRACTIONS[1]), dt),
        step_slider(state.slider_3, x, _slip_stretch(p, pressure, FRICTION_FRACTIONS[2]), dt),
    )


def hysteretic_force(
    p: Any, state: Any, force: float, muscle: MuscleParameters, pressure: float, length: float, velocity: float
) -> float:
    """Return the tension [N] plus ``n k u``, with u the hysteretic stretch."""
    return force + muscle.n_actuators * p.stiffness * state.hysteretic_stretch


def step_dahl_stretch(
    p: Any,
    state: Any,
    muscle: MuscleParameters,
    pressure: float,
    pressure_change: float,
    length: float,
    stretch: float,
    dt: float,
) -> tuple[float, float]:
    """Return hysteretic stretch and length beyond rest [m] after the step.

    Dahl's model ``du/dx = 1 - u sign(dx) / r`` with ``r = slope P / k``: u tends to r sign(dx).
    """
    x = length - muscle.resting_length
    return step_bouc_wen(state.hysteretic_stretch, x - state.length, p.slope * pressure / p.stiffness, 0.0, dt), x


def step_bouc_wen_stretch(
    p: Any,
    state: Any,
    muscle: MuscleParameters,
    pressure: float,
    pressure_change: float,
    length: float,
    stretch: float,
    dt: float,
) -> tuple[float, float]:
    """Return hysteretic stretch and length beyond rest [m] after the step.

    :func:`~klute_sim.effects.smoothing.step_bouc_wen` with ``1 / (beta + gamma) = slope P / k``.
    """
    x = length - muscle.resting_length
    max_stretch = p.slope * pressure / p.stiffness
    return step_bouc_wen(state.hysteretic_stretch, x - state.length, max_stretch, p.gamma_over_beta, dt), x


_SLOPE_PARAMETER = EffectParameter(
    key="slope_n_per_bar",
    neutral=0.0,
    lower=0.0,
    upper=200.0,
    typical=8.0,
    source="assumed: a few percent of the tension, as in Tondu 2012 (doi 10.1177/1045389X11435435)",
    diameter_exponent=2.0,
)
_STIFFNESS_PARAMETER = EffectParameter(
    key="stiffness_n_per_mm",
    neutral=None,
    lower=1.0,
    upper=500.0,
    typical=40.0,
    source="assumed: friction reverses within about a millimetre",
    diameter_exponent=2.0,
)

BRAID_HYSTERESIS = Effect(
    name="braid_hysteresis",
    description="Dry friction between the braid's threads: less tension while shortening, more while lengthening.",
    kind="device",
    forms=(
        EffectForm(
            name="maxwell_slip",
            equation="F += n sum_i k/3 (x - a_i), each slipping at its fraction of n slope P",
            parameters=(_SLOPE_PARAMETER, _STIFFNESS_PARAMETER),
            laws={"muscle_force": maxwell_slip_force, "next_state": step_sliders},
            states=("slider_1", "slider_2", "slider_3"),
            holds_friction=True,
        ),
        EffectForm(
            name="coulomb",
            equation="F += n slope P sign(v)",
            parameters=(_SLOPE_PARAMETER,),
            laws={"muscle_force": coulomb_friction},
        ),
        EffectForm(
            name="dahl",
            equation="F += n k u, du/dx = 1 - u sign(dx)/r, r = slope P / k",
            parameters=(_SLOPE_PARAMETER, _STIFFNESS_PARAMETER),
            laws={"muscle_force": hysteretic_force, "next_state": step_dahl_stretch},
            states=("hysteretic_stretch", "length"),
            holds_friction=True,
        ),
        EffectForm(
            name="bouc_wen",
            equation="F += n k u, du/dx = 1 - |u| (beta sign(u dx) + gamma), 1/(beta + gamma) = slope P / k",
            parameters=(
                _SLOPE_PARAMETER,
                _STIFFNESS_PARAMETER,
                EffectParameter(
                    key="gamma_over_beta",
                    neutral=None,
                    lower=0.1,
                    upper=1.0,
                    typical=0.8,
                    source="assumed: 1 unloads along a straight line; 0 would be the form dahl",
                ),
            ),
            laws={"muscle_force": hysteretic_force, "next_state": step_bouc_wen_stretch},
            states=("hysteretic_stretch", "length"),
            holds_friction=True,
        ),
    ),
)
