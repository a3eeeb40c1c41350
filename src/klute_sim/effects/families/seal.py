"""Friction of seals and guides: dry, growing or falling with speed, or of a seal that deforms before it slides."""

import math
from typing import Any

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.effects.smoothing import smooth_sign, step_bouc_wen, step_follower
from klute_sim.laws.mckibben import MuscleParameters

FILM_TIME_CONSTANT = 5e-3
"""Time constant with which a lubricating film follows the speed [s].

Assumed: friction of lubricated line contacts follows a change of speed after 3 to 9 ms (Hess & Soom, J. Tribology
112:147, 1990; quoted from memory). Without it, sticking and slipping would depend on the time step.
"""
SLIDING_FORCE = EffectParameter(
    key="force_n",
    neutral=0.0,
    lower=0.0,
    upper=500.0,
    typical=15.0,
    source="pneumatic cylinder seals measured: 4.5-15.9 N (docs/real-data.md); upper end assumed",
)
"""Friction of a seal that slides, the same at every pressure."""


def seal_friction(p: Any, state: Any, force: float, velocity: float) -> float:
    """Return the damper tension [N] plus ``F sign(v)``."""
    return force + p.force * smooth_sign(velocity)


def viscous_seal_friction(p: Any, state: Any, force: float, velocity: float) -> float:
    """Return the damper tension [N] plus ``F (sign(v) + v/v_v)``: dry friction, and as much viscous one at v_v."""
    return force + p.force * (smooth_sign(velocity) + velocity / p.viscous_speed)


def stribeck_friction(p: Any, state: Any, force: float, velocity: float) -> float:
    """Return the damper tension [N] plus ``F (1 + stick (1 - z)) sign(v)``, with z the state of the film [1]."""
    return force + p.force * (1.0 + p.stick_fraction * (1.0 - state.film)) * smooth_sign(velocity)


def step_stribeck(
    p: Any,
    state: Any,
    muscle: MuscleParameters,
    pressure: float,
    pressure_change: float,
    length: float,
    stretch: float,
    dt: float,
) -> tuple[float, float, float]:
    """Return the state of the film z [1], the speed [m/s] and the length beyond rest [m] after the step.

    z is 0 at rest and 1 for a film that carries the seal: ``dz/dt = (1 - exp(-(v/vs)^2) - z) / tau``, with tau =
    :data:`FILM_TIME_CONSTANT`. At constant speed this is the curve of Stribeck (Armstrong-Helouvry, Dupont & Canudas de
    Wit, Automatica 30:1083, 1994). The film follows the speed of the preceding step: with that of the same step, the
    force balance could have two solutions.
    """
    x = length - muscle.resting_length
    ratio = state.speed / p.stribeck_speed
    film = step_follower(state.film, 1.0 - math.exp(-ratio * ratio), FILM_TIME_CONSTANT, dt)
    return film, abs(x - state.length) / dt, x


def presliding_friction(p: Any, state: Any, force: float, velocity: float) -> float:
    """Return the damper tension [N] plus ``F u / s``, with u the elastic displacement of the seal."""
    return force + p.force * (state.seal_displacement / p.presliding)


def step_presliding(
    p: Any,
    state: Any,
    muscle: MuscleParameters,
    pressure: float,
    pressure_change: float,
    length: float,
    stretch: float,
    dt: float,
) -> tuple[float, float]:
    """Return the elastic displacement of the seal and the length beyond rest [m] after the step.

    Dahl's model (:func:`~klute_sim.effects.smoothing.step_bouc_wen` with gamma = 0): before it slides with the force F,
    the seal deforms with the stiffness F/s.
    """
    x = length - muscle.resting_length
    return step_bouc_wen(state.seal_displacement, x - state.length, p.presliding, 0.0, dt), x


def pressed_seal_friction(p: Any, state: Any, force: float, velocity: float) -> float:
    """Return the damper tension [N] plus ``k u``, with u the elastic displacement of the seal."""
    return force + p.stiffness * state.seal_displacement


def step_seal_displacement(
    p: Any,
    state: Any,
    muscle: MuscleParameters,
    pressure: float,
    pressure_change: float,
    length: float,
    stretch: float,
    dt: float,
) -> tuple[float, float]:
    """Return the elastic displacement of the seal and the length beyond rest [m] after the step.

    Dahl's model (:func:`~klute_sim.effects.smoothing.step_bouc_wen` with gamma = 0): before it slides with the force
    ``F (1 + g P)``, the seal deforms with the stiffness k. P is the acting pressure, in a cylinder that of its air.
    """
    x = length - muscle.resting_length
    max_displacement = p.force * (1.0 + p.growth * pressure) / p.stiffness
    return step_bouc_wen(state.seal_displacement, x - state.length, max_displacement, 0.0, dt), x


SEAL_FRICTION = Effect(
    name="seal_friction",
    description="A seal of damper or cylinder, or a guide of the rig, rubs; pressure or speed may add friction.",
    kind="device",
    forms=(
        EffectForm(
            name="coulomb",
            equation="F += F_seal sign(v)",
            parameters=(SLIDING_FORCE,),
            laws={"damper_force": seal_friction},
        ),
        EffectForm(
            name="viscous",
            equation="F += F_seal (sign(v) + v/v_v)",
            parameters=(
                SLIDING_FORCE,
                EffectParameter(
                    key="viscous_speed_mm_per_s",
                    neutral=None,
                    lower=10.0,
                    upper=5000.0,
                    typical=300.0,
                    source="assumed: at 0.3 m/s the viscous friction is as large as the dry one",
                ),
            ),
            laws={"damper_force": viscous_seal_friction},
            # Elsewhere the linear flow of the oil is the same.
            candidate_sections=("cylinder",),
        ),
        EffectForm(
            name="stribeck",
            equation="F += F_seal (1 + stick (1 - z)) sign(v), dz/dt = (1 - exp(-(v/v_s)^2) - z) / 5 ms",
            parameters=(
                SLIDING_FORCE,
                EffectParameter(
                    key="stick_fraction",
                    neutral=None,
                    lower=0.05,
                    upper=3.0,
                    typical=0.6,
                    source="assumed: breakaway friction of seals is about 1.5 times the sliding friction",
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
            laws={"damper_force": stribeck_friction, "next_state": step_stribeck},
            states=("film", "speed", "length"),
        ),
        EffectForm(
            name="presliding",
            equation="F += F_seal u/s, du/dx = 1 - u sign(dx)/s",
            parameters=(
                SLIDING_FORCE,
                EffectParameter(
                    key="presliding_mm",
                    neutral=None,
                    lower=0.05,
                    upper=5.0,
                    typical=0.3,
                    source="pneumatic cylinder seals measured: they deform within a millimetre (docs/real-data.md); "
                    "below 0.05 mm it is Coulomb friction (assumed)",
                ),
            ),
            laws={"damper_force": presliding_friction, "next_state": step_presliding},
            states=("seal_displacement", "length"),
            holds_friction=True,
        ),
        EffectForm(
            name="pressure",
            equation="F += k u, du/dx = 1 - u sign(dx)/r, r = F_seal (1 + g P) / k",
            parameters=(
                EffectParameter(
                    key="force_n",
                    neutral=0.0,
                    lower=0.0,
                    upper=200.0,
                    typical=8.0,
                    source="pneumatic cylinder seals measured at 1 bar: 4.5-7.4 N (docs/real-data.md)",
                ),
                EffectParameter(
                    key="growth_per_bar",
                    neutral=None,
                    lower=0.01,
                    upper=5.0,
                    typical=0.3,
                    source="pneumatic cylinder seals measured: 1.7-3.5 times from 1 to 7 bar, so 0.13-0.71 per bar "
                    "(docs/real-data.md)",
                ),
                EffectParameter(
                    key="stiffness_n_per_mm",
                    neutral=None,
                    lower=1.0,
                    upper=1000.0,
                    typical=50.0,
                    source="pneumatic cylinder seals measured: they deform within a millimetre (docs/real-data.md)",
                    physical_limits=(1000.0,),  # assumed: a stiffer one slides at once, as far as a log shows
                ),
            ),
            laws={"damper_force": pressed_seal_friction, "next_state": step_seal_displacement},
            # The pressure is that of the muscle; the seal of a damper beside it meets the oil.
            candidate_sections=("cylinder", "supply"),
            states=("seal_displacement", "length"),
            holds_friction=True,
        ),
    ),
)
