"""Terms without a name: what an equation of the device lacks, in functions of what acts there.

A diagnosis that no effect explains finds some of these coefficients by sparse regression
(:mod:`klute_sim.diagnosis.selection.sparse_regression`), and a device file carries them. They are no physics: nothing keeps them from
giving energy, and beyond the data they were fitted to they mean little. So every function is bounded,
whatever its arguments.
"""

import math
from collections.abc import Mapping

from klute_sim import units
from klute_sim.effects.effect import Effect, EffectForm, EffectParameter, FloatSequence
from klute_sim.effects.smoothing import smooth_sign, step_slider
from klute_sim.laws.mckibben import Muscle
from klute_sim.units import BAR

PRESSURE_SCALE = 5.0 * BAR
"""Pressure that pressures are divided by [Pa]."""
ONSET_PRESSURE = 0.5 * BAR
"""Pressure at which half of what begins with pressure is there [Pa]."""
CONTRACTION_SCALE = 0.25
"""Contraction that contractions are divided by: about the most that a muscle does [1]."""
SATURATION_SPEED = 0.1
"""Speed [m/s] up to which what depends on speed grows."""
STRETCH_SCALE = 10e-3
"""Stretch that stretches are divided by [m]."""
TOE_STRETCH = 1e-3
"""Stretch [m] at which half of what begins with stretch is there."""
MAX_SCALED_INPUT = 2.0
"""Dimensionless pressure, contraction and stretch beyond which nothing changes any more."""
MAX_TIME_CONSTANT = 1.0
"""Time constant [s] of a pressure, at most."""


def sparse_force(
    coefficients: FloatSequence,
    state: FloatSequence,
    force: float,
    muscle: Muscle,
    pressure: float,
    length: float,
    rate: float,
) -> float:
    """Tension [N]: plus a combination of functions of pressure, contraction and speed."""
    p = min(max(pressure / PRESSURE_SCALE, 0.0), MAX_SCALED_INPUT)
    b = max(pressure, 0.0) / (max(pressure, 0.0) + ONSET_PRESSURE)
    e = min(max((1.0 - length / muscle.resting_length) / CONTRACTION_SCALE, 0.0), MAX_SCALED_INPUT)
    d, s = smooth_sign(rate), rate / math.sqrt(rate * rate + SATURATION_SPEED * SATURATION_SPEED)
    still = (
        p * (coefficients[0] + coefficients[1] * p)
        + b * (coefficients[2] + coefficients[3] * e)
        + e * (coefficients[4] + coefficients[5] * e + p * (coefficients[6] + coefficients[7] * e))
    )
    return force + (
        still
        + d * (coefficients[8] + coefficients[9] * p + coefficients[10] * e)
        + s * (coefficients[11] + coefficients[12] * p + coefficients[13] * abs(s))
    )


def sparse_tendon_force(coefficients: FloatSequence, state: FloatSequence, force: float, stretch: float) -> float:
    """Tension [N]: plus a combination of functions of the tendon's stretch, nothing while it is slack."""
    x, t = (
        min(max(stretch / STRETCH_SCALE, 0.0), MAX_SCALED_INPUT),
        max(stretch, 0.0) / (max(stretch, 0.0) + TOE_STRETCH),
    )
    return force + (x * (coefficients[0] + coefficients[1] * x) + coefficients[2] * t)


def sparse_pressure(
    coefficients: FloatSequence, state: FloatSequence, target: float, pressure: float, dt: float
) -> float:
    """Pressure [Pa] a step later: another target, a dead band around it, and a lag (backward Euler)."""
    c = min(target / PRESSURE_SCALE, MAX_SCALED_INPUT)
    wanted = max(
        step_slider(
            pressure, target + (coefficients[0] + c * (coefficients[1] + c * coefficients[2])), coefficients[3], 0.0
        ),
        0.0,
    )
    slow = coefficients[4] + coefficients[5] * c + (coefficients[6] if wanted < pressure else 0.0)
    if slow <= 0.0:
        return wanted
    slow = min(slow, MAX_TIME_CONSTANT)
    return pressure + dt / (slow + dt) * (wanted - pressure)


_SOURCE = "assumed: no physics; range and size are those of a force worth looking for"


def _signed_parameter(key: str, upper: float, typical: float, *, signed: bool = True) -> EffectParameter:
    low = -upper if signed else 0.0
    return EffectParameter(key=key, neutral=0.0, lower=low, upper=upper, typical=typical, source=_SOURCE)


def _force_parameter(key: str, typical: float = 10.0, *, signed: bool = True) -> EffectParameter:
    return _signed_parameter(key, 1000.0, typical, signed=signed)


UNKNOWN_FORCE = Effect(
    name="unknown_force",
    description="Muscle and damper pull otherwise than any known effect explains: a combination fitted to data.",
    kind="device",
    data_driven=True,
    forms=(
        EffectForm(
            name="sparse",
            equation="F += sum of coefficient times function: p, p^2, b, b e, e, e^2, p e, p e^2, d, p d, e d, s, p s, "
            "s |s|; p = P/(5 bar), b = P/(P + 0.5 bar), e = (1 - L/L0)/0.25, d = v/sqrt(v^2 + (1 mm/s)^2), "
            "s = v/sqrt(v^2 + (100 mm/s)^2); p and e up to 2",
            parameters=(
                _force_parameter("pressure_n"),
                _force_parameter("pressure_squared_n"),
                _force_parameter("begin_n"),
                _force_parameter("begin_contraction_n"),
                _force_parameter("contraction_n"),
                _force_parameter("contraction_squared_n"),
                _force_parameter("pressure_contraction_n"),
                _force_parameter("pressure_contraction_squared_n"),
                # Dry friction that pushes has no solution at rest.
                _force_parameter("friction_n", signed=False),
                _force_parameter("pressure_friction_n", signed=False),
                _force_parameter("contraction_friction_n", signed=False),
                _force_parameter("speed_n"),
                _force_parameter("pressure_speed_n"),
                _force_parameter("speed_squared_n"),
            ),
            laws={"muscle_force": sparse_force},
        ),
    ),
)

UNKNOWN_TENDON_FORCE = Effect(
    name="unknown_tendon_force",
    description="The tendon pulls otherwise than any known effect explains: a combination fitted to data.",
    kind="device",
    data_driven=True,
    forms=(
        EffectForm(
            name="sparse",
            equation="F += sum of coefficient times function: x, x^2, t; x = stretch/(10 mm), up to 2, "
            "t = stretch/(stretch + 1 mm)",
            parameters=(
                _force_parameter("stretch_n", 40.0),
                _force_parameter("stretch_squared_n", 40.0),
                _force_parameter("toe_n", 40.0),
            ),
            laws={"tendon_force": sparse_tendon_force},
        ),
    ),
)

UNKNOWN_PRESSURE = Effect(
    name="unknown_pressure",
    description="The pressure follows its command otherwise than any known effect explains: a combination fitted to data.",
    kind="device",
    acts_in_supply=True,
    data_driven=True,
    forms=(
        EffectForm(
            name="sparse",
            equation="dP/dt = (target - P)/tau, target = command + sum of coefficient times function: 1, c, c^2, and a "
            "dead band z around it; tau = sum of coefficient times function: 1, c, f; c = command/(5 bar), up to 2, "
            "f = 1 while P falls",
            parameters=(
                _signed_parameter("offset_bar", 2.0, 0.1),
                _signed_parameter("command_bar", 2.0, 0.1),
                _signed_parameter("command_squared_bar", 2.0, 0.1),
                _signed_parameter("dead_band_bar", 1.0, 0.1, signed=False),
                _signed_parameter("lag_s", MAX_TIME_CONSTANT, 0.02, signed=False),
                _signed_parameter("command_lag_s", MAX_TIME_CONSTANT, 0.02),
                _signed_parameter("falling_lag_s", MAX_TIME_CONSTANT, 0.02),
            ),
            laws={"pressure_reached": sparse_pressure},
        ),
    ),
)

_BASIS_FUNCTIONS = {
    UNKNOWN_FORCE.name: ("p", "p^2", "b", "b e", "e", "e^2", "p e", "p e^2", "d", "p d", "e d", "s", "p s", "s |s|"),
    UNKNOWN_TENDON_FORCE.name: ("x", "x^2", "t"),
    UNKNOWN_PRESSURE.name: ("", "c", "c^2", "", "", "c", "f"),
}
"""Effect -> what each of its parameters is the coefficient of; '': of 1."""
_SUM_LABELS = {
    "dead_band_bar": "dead band =",
    "N": "F +=",
    "bar": "target = command",
    "s": "dP/dt = (target - P)/tau, tau =",
}
"""Parameter, or else its unit -> what it is part of."""
_SYMBOL_MEANINGS = {
    "p": "P/(5 bar)",
    "b": "P/(P + 0.5 bar)",
    "e": "(1 - L/L0)/0.25",
    "d": "v/sqrt(v^2 + (1 mm/s)^2)",
    "s": "v/sqrt(v^2 + (100 mm/s)^2)",
    "x": "stretch/(10 mm)",
    "t": "stretch/(stretch + 1 mm)",
    "c": "command/(5 bar)",
    "f": "1 while P falls",
}


def format_equation(effect: Effect, values: Mapping[str, float]) -> str:
    """The ``effect``, one of this module, with ``values`` of its parameters (in the units of their keys), in a line."""
    sums: dict[str, str] = {}
    used = ""
    for parameter, function in zip(effect.forms[0].parameters, _BASIS_FUNCTIONS[effect.name], strict=True):
        value, unit = values.get(parameter.key, 0.0), units.split_unit(parameter.key)[1]
        if value != 0.0:
            whole = _SUM_LABELS.get(parameter.key) or _SUM_LABELS[unit]
            part = f" {'-' if value < 0.0 else '+'} {abs(value):.3g} {unit} {function}"
            sums[whole] = sums.get(whole, whole) + part.rstrip()
            used += function
    lines = [line.replace("= + ", "= ") for line in sums.values()]
    return "; ".join(
        [*lines, *(f"{symbol} = {meaning}" for symbol, meaning in _SYMBOL_MEANINGS.items() if symbol in used)]
    )
