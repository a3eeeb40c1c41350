"""Data-driven terms: functions that an equation of the device lacks.

When no named effect explains the data, a diagnosis estimates some of these coefficients by sparse regression
(:mod:`klute_sim.diagnosis.discrepancy.sparse_regression`), and a device file stores them. The terms are not physics:
they may create energy, and they do not extrapolate beyond the data of their fit. Every function is therefore bounded
for any arguments.
"""

import math
from typing import Any

from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.effects.smoothing import smooth_sign, step_slider
from klute_sim.laws.foot import Foot
from klute_sim.laws.mckibben import MuscleParameters
from klute_sim.laws.tendon import TendonParameters
from klute_sim.units import BAR

PRESSURE_SCALE = 5.0 * BAR
"""Pressure that normalizes pressures [Pa]."""
ONSET_PRESSURE = 0.5 * BAR
"""Pressure at which a term that sets in with pressure has half of its final value [Pa]."""
CONTRACTION_SCALE = 0.25
"""Contraction that normalizes contractions, about the largest of a muscle [1]."""
SATURATION_SPEED = 0.1
"""Speed at which speed-dependent terms saturate [m/s]."""
STRETCH_SCALE = 10e-3
"""Stretch that normalizes stretches [m]."""
TOE_STRETCH = 1e-3
"""Stretch at which a term that sets in with stretch has half of its final value [m]."""
MAX_SCALED_INPUT = 2.0
"""Upper limit of normalized pressure, contraction and stretch [1]."""
MAX_TIME_CONSTANT, MAX_DEAD_TIME = 1.0, 0.3
"""Upper limits of the pressure's time constant and of the command's dead time [s]."""


def sparse_force(
    coefficients: Any,
    state: Any,
    force: float,
    muscle: MuscleParameters,
    pressure: float,
    length: float,
    velocity: float,
) -> float:
    """Return the tension [N] plus a combination of functions of pressure, contraction and speed."""
    c = coefficients
    p = min(max(pressure / PRESSURE_SCALE, 0.0), MAX_SCALED_INPUT)
    b = max(pressure, 0.0) / (max(pressure, 0.0) + ONSET_PRESSURE)
    e = min(max((1.0 - length / muscle.resting_length) / CONTRACTION_SCALE, 0.0), MAX_SCALED_INPUT)
    d, s = smooth_sign(velocity), velocity / math.sqrt(velocity * velocity + SATURATION_SPEED * SATURATION_SPEED)
    static = (
        p * (c.pressure + c.pressure_squared * p)
        + b * (c.begin + c.begin_contraction * e)
        + e
        * (
            c.contraction
            + c.contraction_squared * e
            + p * (c.pressure_contraction + c.pressure_contraction_squared * e)
        )
    )
    return force + (
        static
        + d * (c.friction + c.pressure_friction * p + c.contraction_friction * e)
        + s * (c.speed + c.pressure_speed * p + c.speed_squared * abs(s))
    )


def sparse_tendon_force(coefficients: Any, state: Any, force: float, stretch: float, tendon: TendonParameters) -> float:
    """Return the tension [N] plus a combination of functions of the stretch, 0 for a slack tendon."""
    c = coefficients
    x = min(max(stretch / STRETCH_SCALE, 0.0), MAX_SCALED_INPUT)
    t = max(stretch, 0.0) / (max(stretch, 0.0) + TOE_STRETCH)
    return force + (x * (c.stretch + c.stretch_squared * x) + c.toe * t)


def sparse_pressure(coefficients: Any, state: Any, target: float, pressure: float, dt: float) -> float:
    """Return the pressure [Pa] after the step: a shifted target, a dead band around it, and a lag (backward Euler).

    The caller delays the command (:func:`klute_sim.device.dynamics.get_dead_time`).
    """
    k = coefficients
    c = min(target / PRESSURE_SCALE, MAX_SCALED_INPUT)
    shifted_target = target + (k.offset + c * (k.command + c * k.command_squared))
    effective_target = max(step_slider(pressure, shifted_target, k.dead_band, 0.0), 0.0)
    time_constant = k.lag + k.command_lag * c + (k.falling_lag if effective_target < pressure else 0.0)
    if time_constant <= 0.0:
        return effective_target
    time_constant = min(time_constant, MAX_TIME_CONSTANT)
    return pressure + dt / (time_constant + dt) * (effective_target - pressure)


def sparse_ankle_moment(coefficients: Any, foot: Foot) -> Foot:
    """Return the foot with a data-driven moment about the ankle (:func:`klute_sim.laws.foot.unknown_moment`)."""
    c = coefficients
    return foot._replace(
        unknown_offset=c.offset,
        unknown_angle=c.angle,
        unknown_angle_squared=c.angle_squared,
        unknown_load=c.load,
        unknown_load_squared=c.load_squared,
        unknown_load_angle=c.load_angle,
        unknown_force=c.force,
        unknown_load_force=c.load_force,
        unknown_pressure=c.pressure,
        unknown_pressure_angle=c.pressure_angle,
        ankle_friction=foot.ankle_friction + c.friction,
        ankle_damping=foot.ankle_damping + c.damping,
    )


_SOURCE = "assumed: no physics; range and typical value of a relevant force"


def make_coefficient(key: str, upper: float, typical: float, *, signed: bool = True) -> EffectParameter:
    """Return the coefficient ``key`` of a function, up to ``upper`` in the key's unit; negative where ``signed``."""
    lower = -upper if signed else 0.0
    return EffectParameter(key=key, neutral=0.0, lower=lower, upper=upper, typical=typical, source=_SOURCE)


def _make_force_parameter(key: str, typical: float = 10.0, *, signed: bool = True) -> EffectParameter:
    return make_coefficient(key, 1000.0, typical, signed=signed)


UNKNOWN_FORCE = Effect(
    name="unknown_force",
    description="No known effect explains the force of muscle and damper: a combination of functions fitted to data.",
    kind="device",
    data_driven=True,
    forms=(
        EffectForm(
            name="sparse",
            equation="F += sum_k a_k f_k, f_k: p, p^2, b, b e, e, e^2, p e, p e^2, d, p d, e d, s, p s, "
            "s |s|; p = P/(5 bar), b = P/(P + 0.5 bar), e = (1 - L/L0)/0.25, d = v/sqrt(v^2 + (0.05 mm/s)^2), "
            "s = v/sqrt(v^2 + (100 mm/s)^2); p and e up to 2",
            parameters=(
                _make_force_parameter("pressure_n"),
                _make_force_parameter("pressure_squared_n"),
                _make_force_parameter("begin_n"),
                _make_force_parameter("begin_contraction_n"),
                _make_force_parameter("contraction_n"),
                _make_force_parameter("contraction_squared_n"),
                _make_force_parameter("pressure_contraction_n"),
                _make_force_parameter("pressure_contraction_squared_n"),
                # Negative dry friction would have no solution at rest.
                _make_force_parameter("friction_n", signed=False),
                _make_force_parameter("pressure_friction_n", signed=False),
                _make_force_parameter("contraction_friction_n", signed=False),
                _make_force_parameter("speed_n"),
                _make_force_parameter("pressure_speed_n"),
                _make_force_parameter("speed_squared_n"),
            ),
            laws={"muscle_force": sparse_force},
        ),
    ),
)

UNKNOWN_TENDON_FORCE = Effect(
    name="unknown_tendon_force",
    description="No known effect explains the tendon's force: a combination of functions fitted to data.",
    kind="device",
    data_driven=True,
    forms=(
        EffectForm(
            name="sparse",
            equation="F += sum_k a_k f_k, f_k: x, x^2, t; x = stretch/(10 mm), up to 2, t = stretch/(stretch + 1 mm)",
            parameters=(
                _make_force_parameter("stretch_n", 40.0),
                _make_force_parameter("stretch_squared_n", 40.0),
                _make_force_parameter("toe_n", 40.0),
            ),
            laws={"tendon_force": sparse_tendon_force},
        ),
    ),
)

UNKNOWN_PRESSURE = Effect(
    name="unknown_pressure",
    description="No known effect explains the pressure's response: a combination of functions fitted to data.",
    kind="device",
    acts_in_supply=True,
    data_driven=True,
    forms=(
        EffectForm(
            name="sparse",
            equation="dP/dt = (target - P)/tau, target = command(t - T) + sum_k a_k f_k, f_k: 1, c, c^2, and the dead "
            "band z around the command; tau = sum_k b_k g_k, g_k: 1, c, f; c = command/(5 bar), up to 2, "
            "f = 1 while P falls",
            parameters=(
                make_coefficient("offset_bar", 2.0, 0.1),
                make_coefficient("command_bar", 2.0, 0.1),
                make_coefficient("command_squared_bar", 2.0, 0.1),
                make_coefficient("dead_band_bar", 1.0, 0.1, signed=False),
                make_coefficient("lag_s", MAX_TIME_CONSTANT, 0.02, signed=False),
                make_coefficient("command_lag_s", MAX_TIME_CONSTANT, 0.02),
                make_coefficient("falling_lag_s", MAX_TIME_CONSTANT, 0.02),
                make_coefficient("delay_s", MAX_DEAD_TIME, 0.02, signed=False),
            ),
            laws={"pressure_reached": sparse_pressure},
        ),
    ),
)

UNKNOWN_ANKLE_MOMENT = Effect(
    name="unknown_ankle_moment",
    description="No known effect explains the ankle's moment in a walk: a combination of functions fitted to data.",
    kind="body",
    data_driven=True,
    forms=(
        EffectForm(
            name="sparse",
            equation="M += sum_k a_k f_k, f_k: 1, a, a^2, l, l^2, l a, g, l g, p, p a, r, w; a = D/(15 deg), "
            "l = M_g/(100 N·m), g = F/(1 kN), p = P/(5 bar), w = dD/dt, r = w/|w|; M plantarflexes and M_g "
            "dorsiflexes; a and l and g and p up to 2",
            parameters=(
                *(
                    make_coefficient(f"{name}_n_m", 200.0, 5.0)
                    for name in (
                        *("offset", "angle", "angle_squared", "load", "load_squared", "load_angle"),
                        *("force", "load_force", "pressure", "pressure_angle"),
                    )
                ),
                make_coefficient("friction_n_m", 50.0, 2.0, signed=False),
                make_coefficient("damping_n_m_s", 20.0, 1.0, signed=False),
            ),
            laws={"foot": sparse_ankle_moment},
        ),
    ),
)
